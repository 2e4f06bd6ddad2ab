//! The boot loader in ST's chips, through dfu-util.

use std::io::{self, ErrorKind};
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use super::boot_loader::BootLoader;
use super::image::dfuse::BOOT_LOADER;
use super::{as_word, child, progress};
use crate::error::Error;
use crate::status::StatusArg;

/// The program that talks to the boot loader.
const DFU_UTIL: &str = "dfu-util";

/// Maximum durations of a search or a start, and of a write. The write of the largest image takes half a minute.
const LIMIT: Duration = Duration::from_secs(10);
const WRITE_LIMIT: Duration = Duration::from_secs(120);

/// The commands that write an image to flash and start it.
pub(super) struct DfuUtil {
    write: Command,
    leave: Command,
}

impl DfuUtil {
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
}

impl BootLoader for DfuUtil {
    /// Without dfu-util the arm would be left without its adapter.
    fn check(&mut self) -> Result<(), Error> {
        if !is_listed().map_err(unusable)? {
            return Ok(());
        }
        let by_hand = self.by_hand();
        let what = format!("a board is already in the boot loader: unplug it. If it is the board to update, {by_hand}");
        Err(Error::at(DFU_UTIL, what))
    }

    fn by_hand(&self) -> String {
        format!("run '{}' and then '{}'", shown(&self.write), shown(&self.leave))
    }

    fn entry(&self) -> &'static str {
        "BOOT0 high"
    }

    fn is_there(&mut self) -> bool {
        is_listed().is_ok_and(|is| is)
    }

    fn absence(&self) -> String {
        let (vendor, product) = BOOT_LOADER;
        let by_hand = self.by_hand();
        format!(
            "no boot loader ({vendor:04x}:{product:04x}) in 'dfu-util --list': is the adapter's USB connected to this \
             computer, and does your user have permission? Then {by_hand}, or unplug and replug the adapter: it still has \
             its old firmware"
        )
    }

    fn write(&mut self, status: StatusArg) -> Result<(), Error> {
        let is_shown = status.is_shown();
        let again = format!("try again, the boot loader cannot be overwritten: {}", self.by_hand());
        progress(shown(&self.write));
        let ended = child::run(&mut self.write, WRITE_LIMIT, is_shown)
            .map_err(|error| Error::at(DFU_UTIL, format!("{error}; {again}")))?;
        if !ended.status.success() {
            let what = format!("failed ({}){}; {again}", ended.status, ended.last_line());
            return Err(Error::at(DFU_UTIL, what));
        }
        progress(shown(&self.leave));
        // The chip is gone before it has answered, which some versions take for an error.
        let _ = child::run(&mut self.leave, LIMIT, is_shown);
        Ok(())
    }
}

/// Returns true if a boot loader is on USB.
fn is_listed() -> io::Result<bool> {
    let listed = child::run(Command::new(DFU_UTIL).arg("--list"), LIMIT, false)?;
    let (vendor, product) = BOOT_LOADER;
    let found = format!("Found DFU: [{vendor:04x}:{product:04x}]");
    Ok(String::from_utf8_lossy(&listed.output).contains(&found))
}

/// The error of a dfu-util that cannot be used.
fn unusable(error: io::Error) -> Error {
    let what = match error.kind() {
        ErrorKind::NotFound => {
            "not installed: 'sudo apt install dfu-util' or the like installs it (docs/update.md)".to_owned()
        }
        _ => format!("cannot be run: {error}"),
    };
    Error::at(DFU_UTIL, format_args!("{what}; nothing was restarted"))
}

/// A command as one would type it.
fn shown(command: &Command) -> String {
    let mut text = command.get_program().to_string_lossy().into_owned();
    for arg in command.get_args() {
        text += &format!(" {}", as_word(&arg.to_string_lossy()));
    }
    text
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn name_is_shown_as_a_shell_takes_it() {
        for (name, word) in [
            ("new.dfu", "new.dfu"),
            ("my image.dfu", "'my image.dfu'"),
            ("a\\b.dfu", "'a\\b.dfu'"),
            ("$(it's).dfu", r"'$(it'\''s).dfu'"),
        ] {
            let command = shown(&DfuUtil::new(Path::new(name)).write);
            assert!(command.ends_with(&format!(" -D {word}")), "{command}");
        }
    }
}
