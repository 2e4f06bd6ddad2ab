//! MCAP recordings, in a build without them.

use super::input::Input;
use super::output::Output;
use crate::error::Error;

/// Refuses the recording.
pub(super) fn decode(input: &mut Input<'_>, _out: &dyn Output) -> Result<(), Error> {
    Err(Error::at(input.name(), "this build of armwire reads no MCAP files"))
}
