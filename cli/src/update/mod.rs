//! `armwire update`: another firmware for an adapter, over USB and the boot loader that ST put into the chip.

mod child;
mod dfu_util;
mod dfuse;
mod interruption;

use std::fmt::Display;
use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::path::PathBuf;
use std::thread;
use std::time::Duration;

use armwire_bridge::control::Request;
use clap::Args;

use crate::adapter::{AdapterPort, describe};
use crate::error::Error;
use crate::output::print_line;
use crate::status::StatusArg;
use dfu_util::{Commands, DFU_UTIL, is_listed};
use dfuse::Image;
use interruption::Interruption;

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
    #[command(flatten)]
    status: StatusArg,
}

impl Update {
    pub(crate) fn run(&self) -> Result<(), Error> {
        if let Some(name) = self.adapter.virtual_board() {
            let what = "a virtual board has no boot loader: start it again, with the new image";
            return Err(Error::at(&name, what));
        }
        let image = self.image()?;
        let interruption = Interruption::catch()?;
        let mut dfu_util = Commands::new(&self.image);
        let by_hand = dfu_util.by_hand();
        // Before anything is restarted: without dfu-util the arm would be left without its adapter.
        if is_listed().map_err(unusable)? {
            let what = format!(
                "a board is already in the boot loader: unplug it. If it is the board to update, run {by_hand}"
            );
            return Err(Error::at(DFU_UTIL, what));
        }

        let mut control = self.adapter.open()?;
        let name = control.name().to_owned();
        let identity = control.identify()?;
        if image.board != identity.board.as_str() {
            let what = format!(
                "the image is for the board {}, the adapter is a {}",
                image.board, identity.board
            );
            return Err(Error::at(&name, what));
        }
        progress(format!("{name}: {}", describe(&identity)));
        interruption.commit(&name)?;
        control.call(Request::RestartIntoBootLoader)?;
        drop(control);
        progress(format!(
            "{name}: restarts into its boot loader, to take {} bytes; if interrupted, run {by_hand}",
            image.len
        ));

        self.write(&name, &mut dfu_util, &by_hand)
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
    fn write(&self, name: &str, dfu_util: &mut Commands, by_hand: &str) -> Result<(), Error> {
        if self
            .repeat("the boot loader", || is_listed().ok().filter(|&is| is))
            .is_none()
        {
            let (vendor, product) = dfuse::BOOT_LOADER;
            let what = format!(
                "no boot loader ({vendor:04x}:{product:04x}) in 'dfu-util --list': is the adapter's USB connected to this \
                 computer, and does your user have permission? Run {by_hand}, or unplug and replug the adapter: it still \
                 has its old firmware"
            );
            return Err(Error::at(name, what));
        }
        let again = format!("try again, the boot loader cannot be overwritten. Run {by_hand}");
        let is_shown = self.status.is_shown();
        let ended = dfu_util
            .write(is_shown, progress)
            .map_err(|error| Error::at(DFU_UTIL, format!("{error}; {again}")))?;
        if !ended.status.success() {
            let what = format!("failed ({}){}; {again}", ended.status, ended.last_line());
            return Err(Error::at(DFU_UTIL, what));
        }
        dfu_util.leave(is_shown, progress);
        let back = || self.adapter.open().and_then(|mut control| Ok(control.identify()?)).ok();
        match self.repeat("the adapter", back) {
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

    /// Repeats a search for `what` until it succeeds, [`TRIES`] times with pauses.
    fn repeat<T>(&self, what: &str, mut look: impl FnMut() -> Option<T>) -> Option<T> {
        let mut status = self.status.bar(TRIES as u64);
        for tried in 1..TRIES {
            let found = look();
            if found.is_some() {
                return found;
            }
            status.show_at(tried as u64, || format!("waiting for {what}"));
            thread::sleep(RETRY_PERIOD);
        }
        look()
    }
}

/// Prints a line. The update goes on if the reader of the output is gone.
fn progress(line: impl Display) {
    let _ = print_line(line);
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
