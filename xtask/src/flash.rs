//! `cargo fw`: the firmware image, built, and flashed by probe-rs or by a copy to the drive of a Pico's boot loader.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, exit};

use anyhow::{Context, Result, bail, ensure};
use clap::Args;

use crate::board::{Board, Update};
use crate::image;
use crate::process::{output, replace_ourselves};
use crate::rom_drive::{self, LABEL};

#[derive(Args)]
pub(crate) struct FwOptions {
    #[command(flatten)]
    image: image::Options,
    /// Flash it with probe-rs, and start it
    #[arg(long)]
    flash: bool,
    /// Flash it by a copy to the drive of a Pico's boot loader (RPI-RP2), which is mounted at this folder
    #[arg(long, value_name = "FOLDER", requires = "flash")]
    drive: Option<PathBuf>,
}

/// Builds the image. With `--flash` it is flashed and started; with defmt its log is then printed.
///
/// # Errors
///
/// If the build fails, or if probe-rs or the drive is missing.
pub(crate) fn run(options: &FwOptions) -> Result<()> {
    match &options.drive {
        Some(drive) => check_drive(drive, options.image.board)?,
        None if options.flash => check_probe_rs()?,
        None => {}
    }
    let image = image::build(options.image)?;
    println!("{image}");
    let board = options.image.board;
    match options {
        FwOptions { flash: false, .. } => Ok(()),
        FwOptions { drive: Some(drive), .. } => copy_to(drive, &image.path.with_extension(board.update().extension())),
        FwOptions { image: options, .. } if options.defmt => attach(board, &image.path),
        _ => {
            // probe-rs reports failures itself, such as a missing probe.
            let flashed = probe_rs("download", board).arg("--verify").arg(&image.path).status()?;
            if !flashed.success() {
                exit(flashed.code().unwrap_or(1));
            }
            replace_ourselves(&mut probe_rs("reset", board))
        }
    }
}

fn check_probe_rs() -> Result<()> {
    if output(Command::new("probe-rs").arg("--version")).is_err() {
        bail!("probe-rs is not installed; run `cargo install probe-rs-tools --locked`");
    }
    Ok(())
}

/// Checks that a folder is the drive of this board's boot loader.
fn check_drive(drive: &Path, board: Board) -> Result<()> {
    ensure!(
        board.update() == Update::Uf2,
        "--drive: the boot loader of {} has no drive",
        board.name()
    );
    ensure!(
        rom_drive::is_at(drive),
        "{}: not the drive {LABEL}: hold BOOTSEL down while you plug the board in",
        drive.display()
    );
    Ok(())
}

/// Copies an image to the drive. The boot loader flashes it and starts it.
fn copy_to(drive: &Path, image: &Path) -> Result<()> {
    let name = image.file_name().context("an image has a name")?.to_string_lossy();
    let written = rom_drive::write(drive, &name, &fs::read(image)?).and_then(|file| file.sync_all());
    written.with_context(|| format!("cannot write to {}", drive.display()))?;
    println!("{} is on {}: the board starts it", image.display(), drive.display());
    Ok(())
}

/// Flashes and starts a program, and prints its log until interrupted.
fn attach(board: Board, elf: &Path) -> Result<()> {
    replace_ourselves(probe_rs("run", board).arg(elf))
}

fn probe_rs(subcommand: &str, board: Board) -> Command {
    let mut command = Command::new("probe-rs");
    command.args([subcommand, "--chip", board.chip()]);
    command
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cargo::target_dir;
    use crate::files::empty_folder;

    #[test]
    fn only_a_boot_loader_is_a_drive() {
        let folder = target_dir().unwrap().join("flash-test");
        empty_folder(&folder).unwrap();
        let refused = check_drive(&folder, Board::PICO).unwrap_err().to_string();
        assert!(refused.contains("not the drive RPI-RP2"), "{refused}");
        fs::write(
            folder.join("INFO_UF2.TXT"),
            "UF2 Bootloader v2.0\r\nBoard-ID: RPI-RP2\r\n",
        )
        .unwrap();
        check_drive(&folder, Board::PICO).unwrap();
        assert!(check_drive(&folder, Board::STM32F405).is_err());
        fs::write(folder.with_extension("uf2"), [1, 2, 3]).unwrap();
        copy_to(&folder, &folder.with_extension("uf2")).unwrap();
        assert_eq!(fs::read(folder.join("flash-test.uf2")).unwrap(), [1, 2, 3]);
    }
}
