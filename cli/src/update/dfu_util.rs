//! dfu-util: its commands, its output and its end.

use std::io;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use super::child::{self, Ended};
use super::dfuse::BOOT_LOADER;

/// The program that talks to the boot loader.
pub(super) const DFU_UTIL: &str = "dfu-util";

/// Maximum durations of a search or a start, and of a write. The write of the largest image takes half a minute.
const LIMIT: Duration = Duration::from_secs(10);
const WRITE_LIMIT: Duration = Duration::from_secs(120);

/// The commands that write an image to flash and start it.
pub(super) struct Commands {
    write: Command,
    leave: Command,
}

impl Commands {
    /// The flash is alternate setting 0 of the boot loader. Only sectors with data in the image are erased. dfu-util 0.11
    /// does not do both in one call: see docs/update.md.
    pub(super) fn new(image: &Path) -> Self {
        let (vendor, product) = BOOT_LOADER;
        let flash = || {
            let mut command = Command::new(DFU_UTIL);
            command.args(["-d", &format!(",{vendor:04x}:{product:04x}"), "-a", "0"]);
            command
        };
        let (mut write, mut leave) = (flash(), flash());
        write.arg("-D").arg(image);
        leave.args(["-s", "0x08000000:leave"]);
        Self { write, leave }
    }

    /// The commands for a user to type.
    pub(super) fn by_hand(&self) -> String {
        format!("'{}' and then '{}'", shown(&self.write), shown(&self.leave))
    }

    /// Writes the image. Prints the command by `report`, and the output of dfu-util if `is_shown`.
    pub(super) fn write(&mut self, is_shown: bool, report: impl FnOnce(String)) -> io::Result<Ended> {
        report(shown(&self.write));
        child::run(&mut self.write, WRITE_LIMIT, is_shown)
    }

    /// Starts the new firmware. Prints the command by `report`, and the output of dfu-util if `is_shown`.
    pub(super) fn leave(&mut self, is_shown: bool, report: impl FnOnce(String)) {
        report(shown(&self.leave));
        // The chip is gone before it has answered, which some versions take for an error.
        let _ = child::run(&mut self.leave, LIMIT, is_shown);
    }
}

/// Returns true if a boot loader is on USB.
pub(super) fn is_listed() -> io::Result<bool> {
    let listed = child::run(Command::new(DFU_UTIL).arg("--list"), LIMIT, false)?;
    let (vendor, product) = BOOT_LOADER;
    let found = format!("Found DFU: [{vendor:04x}:{product:04x}]");
    Ok(String::from_utf8_lossy(&listed.output).contains(&found))
}

/// A command as one would type it.
fn shown(command: &Command) -> String {
    let mut text = command.get_program().to_string_lossy().into_owned();
    for arg in command.get_args().map(|arg| arg.to_string_lossy()) {
        match arg.contains(char::is_whitespace) {
            true => text += &format!(" \"{arg}\""),
            false => text += &format!(" {arg}"),
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn name_with_a_space_is_shown_in_quotes() {
        assert!(shown(&Commands::new(Path::new("my image.dfu")).write).ends_with(" -D \"my image.dfu\""));
    }
}
