//! What an update needs of the boot loader in a chip's ROM.

use crate::error::Error;
use crate::status::StatusArg;

/// A boot loader, with the image that it is to write.
pub(super) trait BootLoader {
    /// Checks, before the adapter is restarted, that the image can be written, and that no other board would take it.
    fn check(&mut self) -> Result<(), Error>;

    /// What a user does to write the image to an adapter in its boot loader, such as `run 'dfu-util …'`.
    fn by_hand(&self) -> String;

    /// The state of the board's pin or button that starts the boot loader at power-on.
    fn entry(&self) -> &'static str;

    /// Returns true if the boot loader of the restarted adapter is there.
    fn is_there(&mut self) -> bool;

    /// The reason why it is not there, and what to do.
    fn absence(&self) -> String;

    /// Writes the image and starts it.
    fn write(&mut self, status: StatusArg) -> Result<(), Error>;
}
