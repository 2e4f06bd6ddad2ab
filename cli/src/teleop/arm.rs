//! The arm of either side.

use std::num::NonZeroU32;

use armwire::ling::Kind;
use armwire_host::{Ling, Options, Port};

use crate::error::Error;
use crate::monitor::Recorder;

/// Opens an arm, which must be of this kind.
pub(super) fn open(port: &Port, baud: Option<NonZeroU32>, kind: Kind) -> Result<Ling, Error> {
    let mut arm = port.open(Options::default().with_baud(baud))?.ling()?;
    match arm.read_info() {
        Ok(info) if info.serial.kind() == Some(kind) => Ok(arm),
        Ok(info) => {
            let serial = info.serial;
            let reason = match info.serial.kind() {
                Some(other) => format!("this is a {other} ({serial}), where a {kind} is expected: LEADER FOLLOWER"),
                None => format!("the kind of this arm is unknown ({serial}), where a {kind} is expected"),
            };
            Err(Error::refused(arm.name(), reason))
        }
        Err(error) => Err(Error::from(error).explained(|error| arm.explain(error))),
    }
}

/// Reads what a recording needs.
pub(super) fn prepare(arm: &mut Ling, recorder: &Recorder) -> Result<(), Error> {
    if recorder.is_on() {
        // The answer is for the recording: without the stroke, an opening is no length.
        arm.read_stroke()?;
    }
    Ok(())
}
