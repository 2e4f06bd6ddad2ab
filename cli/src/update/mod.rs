//! `armwire update`: another firmware for an adapter, over USB and the boot loader in its chip's ROM.
//!
//! ```text
//! Update        the command: checks, the restart, the wait for the adapter
//!  ├ image      what is in the file: DfuSe, UF2
//!  └ BootLoader what is done with it
//!     ├ DfuUtil ST's boot loader: dfu-util, a child
//!     └ Drive   the RP2040's: a file on a drive, among the volumes of this computer
//! ```

mod boot_loader;
mod child;
mod dfu_util;
mod drive;
mod image;
mod interruption;
mod rom_drive;
mod text;
mod volumes;

use std::fs::File;
use std::io::Read;
use std::path::PathBuf;
use std::thread;
use std::time::Duration;

use armwire_bridge::control::Request;
use clap::Args;

use crate::adapter::{AdapterPort, describe};
use crate::error::Error;
use crate::output::print_line;
use crate::status::StatusArg;
use boot_loader::BootLoader;
use dfu_util::DfuUtil;
use drive::Drive;
use image::{Format, Image};
use interruption::Interruption;
use text::{as_word, progress};
use volumes::Volumes;

/// Number of bytes at the start of a file that are read first. They show its format and length.
const HEAD: usize = 32;
/// Number of searches for the boot loader or the adapter, and the time between them.
const TRIES: usize = 20;
const RETRY_PERIOD: Duration = Duration::from_millis(500);

/// The arguments of `armwire update`.
#[derive(Args)]
pub(crate) struct Update {
    #[command(flatten)]
    adapter: AdapterPort,
    /// The firmware: a .dfu file for an STM32, or a .uf2 file for a Raspberry Pi Pico.
    image: PathBuf,
    /// Folder at which the drive of a Pico's boot loader (RPI-RP2) is mounted. By default all drives are searched.
    #[arg(long, value_name = "FOLDER")]
    drive: Option<PathBuf>,
    #[command(flatten)]
    status: StatusArg,
}

impl Update {
    pub(crate) fn run(&self) -> Result<(), Error> {
        if let Some(name) = self.adapter.virtual_board() {
            let what = "a virtual board has no boot loader: start it again, with the new image";
            return Err(Error::at(&name, what));
        }
        let (image, bytes) = self.image()?;
        let mut boot_loader = self.boot_loader(&image, bytes)?;
        let interruption = Interruption::catch()?;
        boot_loader.check()?;

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
            "{name}: restarts into its boot loader, to take {} bytes; if interrupted, {}",
            image.len,
            boot_loader.by_hand()
        ));

        self.write(&name, &mut *boot_loader)
    }

    /// The boot loader that takes the image.
    fn boot_loader(&self, image: &Image, bytes: Vec<u8>) -> Result<Box<dyn BootLoader>, Error> {
        match (image.format, &self.drive) {
            (Format::DfuSe, None) => Ok(Box::new(DfuUtil::new(&self.image))),
            (Format::DfuSe, Some(_)) => Err(Error::Usage("--drive is for a .uf2 file only".to_owned())),
            (Format::Uf2, drive) => {
                let volumes = Volumes::new();
                Ok(Box::new(Drive::new(&self.image, bytes, drive.as_deref(), volumes)))
            }
        }
    }

    /// The image to write, and the whole file. A file with another head is not read further.
    fn image(&self) -> Result<(Image, Vec<u8>), Error> {
        let name = self.image.display().to_string();
        let failed = |error| Error::at(&name, error);
        let unfit = |unfit| Error::at(&name, unfit);
        let file = File::open(&self.image).map_err(failed)?;
        let mut bytes = Vec::new();
        let read = |count: usize, bytes: &mut Vec<u8>| (&file).take(count as u64).read_to_end(bytes);
        read(HEAD, &mut bytes).map_err(failed)?;
        let len = image::file_len(&bytes).map_err(unfit)?;
        // One byte more shows a longer file.
        read((len + 1).saturating_sub(bytes.len()), &mut bytes).map_err(failed)?;
        Ok((image::parse(&bytes).map_err(unfit)?, bytes))
    }

    /// Writes the image, starts the adapter and prints its identity.
    fn write(&self, name: &str, boot_loader: &mut dyn BootLoader) -> Result<(), Error> {
        let found = self.repeat("the boot loader", || boot_loader.is_there().then_some(()));
        if found.is_none() {
            return Err(Error::at(name, boot_loader.absence()));
        }
        boot_loader.write(self.status)?;
        let back = || self.adapter.open().and_then(|mut control| Ok(control.identify()?)).ok();
        match self.repeat("the adapter", back) {
            Some(identity) => print_line(format!("{name}: {}", describe(&identity))),
            None => {
                let what = format!(
                    "image written, but the adapter did not return: unplug and replug it. If that fails, replug with {} \
                     and {}",
                    boot_loader.entry(),
                    boot_loader.by_hand()
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
