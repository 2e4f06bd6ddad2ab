//! The firmware image.

use std::env;
use std::fmt;
use std::fs;
use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context, Result, ensure};
use clap::Args;

use crate::board::{Board, Update};
use crate::cargo::{cargo, target_dir};
use crate::dfu;
use crate::process::run;
use crate::program::Program;
use crate::toolchain::cargo_for;
use crate::uf2;
use crate::workspace::firmware;

/// Flash that every image leaves, in bytes: another compiler needs some. That of the STM32G431 with a log, which is not
/// shipped, has less than a kilobyte.
const MIN_FLASH_LEFT: u64 = 512;

#[derive(Args, Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Options {
    /// Board of the image
    #[arg(long, default_value = "stm32f405")]
    pub(crate) board: Board,
    /// Log over RTT
    #[arg(long)]
    pub(crate) defmt: bool,
}

impl Options {
    /// The shipped image for this board.
    pub(crate) fn of(board: Board) -> Self {
        Self { board, defmt: false }
    }

    /// The image for this board with every option.
    pub(crate) fn all(board: Board) -> Self {
        Self { board, defmt: true }
    }

    /// Cargo's arguments for the features of this image. The image for the STM32F405 has the default features, as by a plain
    /// `cargo build`: without the feature `default`, the same code has another order.
    pub(crate) fn features(self) -> String {
        let chip = self.board.feature();
        let no_default = if chip == Board::default().feature() {
            ""
        } else {
            "--no-default-features "
        };
        let log = if self.defmt { ",defmt" } else { "" };
        format!("{no_default}--features {chip}{log}")
    }

    /// The program that cargo makes.
    pub(crate) fn program(self) -> Result<PathBuf> {
        let folder = target_dir()?.join(self.board.target());
        Ok(folder.join(self.board.profile(self.defmt)).join("armwire-firmware"))
    }

    /// The image's file name.
    fn name(self) -> String {
        format!(
            "armwire-{}{}",
            self.board.name(),
            if self.defmt { "-defmt" } else { "" }
        )
    }
}

/// A firmware image. Beside the ELF file are two files of the same name: `.bin` is the flash from its start to the image's
/// end, that [for the boot loader](Board::update) leaves unused sectors unchanged.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Image {
    /// The ELF file.
    pub(crate) path: PathBuf,
    board: Board,
    /// Flash usage in bytes.
    flash: u64,
    /// Unused flash in bytes.
    flash_left: u64,
    /// RAM usage without the stack, in bytes.
    ram: u64,
    /// RAM that is left for data, in bytes.
    ram_left: u64,
}

impl Image {
    /// The image tests, with this image.
    pub(crate) fn tests(&self) -> Command {
        let mut test = cargo("test --package armwire-host-tests --features image --test image");
        test.env("ARMWIRE_IMAGE", &self.path);
        test
    }

    /// Checks that the image leaves enough flash.
    fn check_flash(&self) -> Result<()> {
        ensure!(
            self.flash_left >= MIN_FLASH_LEFT,
            "{self}; {MIN_FLASH_LEFT} must be left"
        );
        Ok(())
    }

    /// Checks the sizes of a shipped image.
    fn check_sizes(&self) -> Result<()> {
        let (flash, ram) = (self.board.max_flash(), self.board.max_ram());
        ensure!(self.flash <= flash, "{self}; the limit is {flash} bytes of flash");
        ensure!(self.ram <= ram, "{self}; the limit is {ram} bytes of RAM");
        Ok(())
    }
}

impl fmt::Display for Image {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} (and .bin, .{}): {} bytes of flash, {} left, {} bytes of RAM, {} left, and a stack of {}",
            self.path.display(),
            self.board.update().extension(),
            self.flash,
            self.flash_left,
            self.ram,
            self.ram_left,
            self.board.stack()
        )
    }
}

/// The image for the virtual board: that of `ARMWIRE_IMAGE`, or a new build for the STM32F405.
///
/// # Errors
///
/// If the build fails.
pub(crate) fn for_virtual_board() -> Result<PathBuf> {
    match env::var_os("ARMWIRE_IMAGE") {
        Some(image) => Ok(image.into()),
        None => Ok(build(Options::of(Board::STM32F405))?.path),
    }
}

/// Builds the shipped image for this board, prints its sizes, and checks them.
///
/// # Errors
///
/// If the build fails, or a size exceeds its limit.
pub(crate) fn release(board: Board) -> Result<Image> {
    let image = build(Options::of(board))?;
    println!("{image}");
    image.check_sizes()?;
    Ok(image)
}

/// Builds the image, checks its vector table and what it leaves of the flash, and copies it to the target directory under
/// its own name.
///
/// # Errors
///
/// If the build fails, the vector table is that of another board, or the image is too large.
pub(crate) fn build(options: Options) -> Result<Image> {
    let board = options.board.name();
    println!("building the firmware image for {board}, one or two minutes the first time");
    let target = options.board.target();
    let profile = options.board.profile(options.defmt);
    let mut build = cargo_for(target, &format!("build --profile {profile} {}", options.features()))?;
    match Board::CHIPS.contains(&options.board) {
        // The variable makes cargo link again, and each chip has a plain build without it.
        true => build.env_remove("ARMWIRE_BOARD"),
        false => build.env("ARMWIRE_BOARD", board),
    };
    run(build.current_dir(firmware()))?;

    let built = options.program()?;
    let elf = fs::read(&built).with_context(|| format!("cannot read {}", built.display()))?;
    let program = Program::parse(&elf)?;
    program.check_vectors(options.board.vectors(), options.board.stack())?;
    let path = target_dir()?.join(options.name() + ".elf");
    let write = |extension, bytes: &[u8]| {
        let path = path.with_extension(extension);
        fs::write(&path, bytes).with_context(|| format!("cannot write {}", path.display()))
    };
    write("elf", &elf)?;
    write("bin", &program.bin())?;
    let update = options.board.update();
    write(
        update.extension(),
        &match update {
            Update::Dfu => dfu::file(board, &program.segments),
            Update::Uf2 => uf2::file(board, &program.segments),
        },
    )?;
    let image = Image {
        path,
        board: options.board,
        flash: program.flash(),
        flash_left: program.flash_left()?,
        ram: program.ram,
        ram_left: program.ram_left()?,
    };
    image.check_flash()?;
    Ok(image)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_name_features_and_files() {
        let options = Options::of(Board::STM32F405);
        assert_eq!(options.features(), "--features board-stm32f405");
        assert_eq!(options.name(), "armwire-stm32f405");
        let options = Options::all(Board::STM32G431);
        assert_eq!(
            options.features(),
            "--no-default-features --features board-stm32g431,defmt"
        );
        assert_eq!(options.name(), "armwire-stm32g431-defmt");
        let options = Options::of(Board::PICO);
        assert_eq!(options.features(), "--no-default-features --features board-rp2040");
        assert_eq!(options.name(), "armwire-pico");
    }

    #[test]
    fn oversized_image_is_refused() {
        let board = Board::PICO;
        let image = |flash, flash_left, ram| Image {
            path: "image.elf".into(),
            board,
            flash,
            flash_left,
            ram,
            ram_left: 0,
        };
        assert!(image(0, MIN_FLASH_LEFT, 0).check_flash().is_ok());
        assert!(image(0, MIN_FLASH_LEFT - 1, 0).check_flash().is_err());
        let (flash, ram) = (board.max_flash(), board.max_ram());
        assert!(image(flash, 0, ram).check_sizes().is_ok());
        assert!(image(flash + 1, 0, ram).check_sizes().is_err());
        assert!(image(flash, 0, ram + 1).check_sizes().is_err());
    }
}
