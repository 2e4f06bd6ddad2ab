//! `armwire update`: another firmware for an adapter, over USB and the boot loader that ST put into the chip.

mod dfuse;

use std::fmt::Display;
use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::thread;
use std::time::Duration;

use armwire_bridge::control::Request;
use clap::Args;

use crate::adapter::{AdapterPort, describe, identify};
use crate::error::Error;
use crate::output::print_line;
use dfuse::Image;

/// The program that talks to the boot loader.
const DFU_UTIL: &str = "dfu-util";
/// Number of searches for the boot loader or the adapter, and the time between them.
const TRIES: usize = 20;
const RETRY_PERIOD: Duration = Duration::from_millis(500);

/// The arguments of `armwire update`.
#[derive(Args)]
pub(crate) struct Update {
    #[command(flatten)]
    adapter: AdapterPort,
    /// The firmware, as a DfuSe file.
    #[arg(value_name = "IMAGE.dfu")]
    image: PathBuf,
}

impl Update {
    pub(crate) fn run(&self) -> Result<(), Error> {
        if let Some(name) = self.adapter.virtual_board() {
            let what = "a virtual board has no boot loader: start it again, with the new image";
            return Err(Error::at(&name, what));
        }
        let image = self.image()?;
        let [write, leave] = commands(&self.image);
        let by_hand = format!("'{}' and then '{}'", shown(&write), shown(&leave));
        // Before anything is restarted: without dfu-util the arm would be left without its adapter.
        if is_listed().map_err(unusable)? {
            let what = format!(
                "a board is already in the boot loader: unplug it. If it is the board to update, run {by_hand}"
            );
            return Err(Error::at(DFU_UTIL, what));
        }

        let mut control = self.adapter.open()?;
        let name = control.name().to_owned();
        let identity = identify(&mut control)?;
        if image.board != identity.board.as_str() {
            let what = format!(
                "the image is for the board {}, the adapter is a {}",
                image.board, identity.board
            );
            return Err(Error::at(&name, what));
        }
        progress(format!("{name}: {}", describe(&identity)));
        control.call(Request::RestartIntoBootLoader)?;
        drop(control);
        progress(format!(
            "{name}: restarts into its boot loader, to take {} bytes",
            image.len
        ));

        self.write(&name, write, leave, &by_hand)
    }

    /// The image to write. A file with another head is not read further.
    fn image(&self) -> Result<Image, Error> {
        let name = self.image.display().to_string();
        let failed = |error| Error::at(&name, error);
        let unfit = |unfit| Error::at(&name, unfit);
        let file = File::open(&self.image).map_err(failed)?;
        let mut bytes = Vec::new();
        let read = |count: usize, bytes: &mut Vec<u8>| (&file).take(count as u64).read_to_end(bytes);
        read(dfuse::PREFIX, &mut bytes).map_err(failed)?;
        let len = dfuse::file_len(&bytes).map_err(unfit)?;
        // One byte more shows a longer file.
        read(len + 1 - bytes.len(), &mut bytes).map_err(failed)?;
        dfuse::parse(&bytes).map_err(unfit)
    }

    /// Writes the image, starts the adapter and prints its identity.
    fn write(&self, name: &str, mut write: Command, mut leave: Command, by_hand: &str) -> Result<(), Error> {
        if repeat(|| is_listed().ok().filter(|&is| is)).is_none() {
            let (vendor, product) = dfuse::BOOT_LOADER;
            let what = format!(
                "no boot loader ({vendor:04x}:{product:04x}) in 'dfu-util --list': is the adapter's USB connected to this \
                 computer, and does your user have permission? Run {by_hand}, or unplug and replug the adapter: it still \
                 has its old firmware"
            );
            return Err(Error::at(name, what));
        }
        progress(shown(&write));
        let status = write
            .status()
            .map_err(|error| Error::at(DFU_UTIL, format!("cannot be run: {error}")))?;
        if !status.success() {
            let what = format!("failed ({status}): try again, the boot loader cannot be overwritten. Run {by_hand}");
            return Err(Error::at(DFU_UTIL, what));
        }
        progress(shown(&leave));
        // The chip is gone before it has answered, which some versions take for an error.
        let _ = leave.status();
        let back = || self.adapter.open().and_then(|mut control| identify(&mut control)).ok();
        match repeat(back) {
            Some(identity) => print_line(format!("{name}: {}", describe(&identity))),
            None => {
                let what = format!(
                    "image written, but the adapter did not return: unplug and replug it. If that fails, replug with BOOT0 \
                     high and run {by_hand}"
                );
                Err(Error::at(name, what))
            }
        }
    }
}

/// Prints a line. The update goes on if the reader of the output is gone.
fn progress(line: impl Display) {
    let _ = print_line(line);
}

/// Repeats a search until it succeeds, [`TRIES`] times with pauses.
fn repeat<T>(mut look: impl FnMut() -> Option<T>) -> Option<T> {
    for _ in 1..TRIES {
        let found = look();
        if found.is_some() {
            return found;
        }
        thread::sleep(RETRY_PERIOD);
    }
    look()
}

/// Returns true if a boot loader is on USB.
fn is_listed() -> io::Result<bool> {
    let output = Command::new(DFU_UTIL).arg("--list").output()?;
    let (vendor, product) = dfuse::BOOT_LOADER;
    let found = format!("Found DFU: [{vendor:04x}:{product:04x}]");
    Ok(String::from_utf8_lossy(&output.stdout).contains(&found))
}

/// The commands that write the image to flash, alternate setting 0 of the boot loader, and start it. Only sectors with
/// data in the image are erased. dfu-util 0.11 does not do both in one call: see docs/update.md.
fn commands(image: &Path) -> [Command; 2] {
    let (vendor, product) = dfuse::BOOT_LOADER;
    let flash = || {
        let mut command = Command::new(DFU_UTIL);
        command.args(["-d", &format!(",{vendor:04x}:{product:04x}"), "-a", "0"]);
        command
    };
    let (mut write, mut leave) = (flash(), flash());
    write.arg("-D").arg(image);
    leave.args(["-s", "0x08000000:leave"]);
    [write, leave]
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn name_with_a_space_is_shown_in_quotes() {
        assert!(shown(&commands(Path::new("my image.dfu"))[0]).ends_with(" -D \"my image.dfu\""));
    }
}
