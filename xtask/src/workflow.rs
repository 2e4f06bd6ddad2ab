//! `cargo xtask workflow`: the ordinary commands of the firmware, typed in its folder as its README shows them. They make
//! the images of `cargo fw`.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

use anyhow::{Context, Result, ensure};

use crate::board::{Board, TARGET};
use crate::cargo::{cargo, cargo_in_firmware, target_dir};
use crate::files::empty_folder;
use crate::image::{self, Options};
use crate::linker_inputs;
use crate::process::{output, run, shown};
use crate::program::Program;

/// The commands of cargo that build the image of each chip, and that flash it.
const IMAGES: [(Board, &str, &str); 3] = [
    (Board::STM32F405, "build --release", "run --release"),
    (Board::STM32G431, "g431", "run-g431"),
    (Board::PICO, "pico", "run-pico"),
];
/// Those that check the sources.
const LINTS: [&str; 2] = ["check", "clippy"];

/// Types the commands.
///
/// # Errors
///
/// If a command fails, makes another image than `cargo fw`, or flashes another chip, or if the linker reads a file that is no
/// source of the image.
pub(crate) fn check() -> Result<()> {
    for (board, build, flash) in IMAGES {
        compare_images(board, build)?;
        flash_by_stand_in(board, flash)?;
    }
    flash_without_probe_rs()?;
    LINTS
        .into_iter()
        .try_for_each(|words| run(&mut cargo_in_firmware(words)))?;
    expect_warning_in_root()?;
    linker_inputs::compare()
}

/// Compares the image of a command with that of `cargo fw`, which has the same files of cargo: the second build takes no
/// time.
fn compare_images(board: Board, build: &str) -> Result<()> {
    let options = Options::of(board);
    let image = image::build(options)?;
    run(&mut cargo_in_firmware(build))?;
    let program = Program::parse(&fs::read(options.program()?)?)?;
    ensure!(
        program.bin() == fs::read(image.path.with_extension("bin"))?,
        "`cargo {build}` makes another image than `cargo fw --board {}`",
        board.name()
    );
    Ok(())
}

/// Flashes with a program in place of probe-rs, which shows its command and the chip.
fn flash_by_stand_in(board: Board, flash: &str) -> Result<()> {
    let folder = target_dir()?.join("workflow");
    empty_folder(&folder)?;
    let stand_in = folder.join("probe-rs");
    fs::write(&stand_in, "#!/bin/sh\necho \"$1 for $PROBE_RS_CHIP\"\n")?;
    run(Command::new("chmod").arg("+x").arg(stand_in))?;
    let mut folders = path();
    folders.insert(0, folder);
    let shown = output(cargo_in_firmware(flash).env("PATH", env::join_paths(folders)?))?;
    let expected = format!("run for {}\n", board.chip());
    ensure!(shown == expected, "`cargo {flash}` runs probe-rs with {shown}");
    Ok(())
}

/// Without probe-rs, cargo's own error names it.
fn flash_without_probe_rs() -> Result<()> {
    let (_, _, flash) = IMAGES[0];
    let mut folders = path();
    folders.retain(|folder| !folder.join("probe-rs").exists());
    let result = output(cargo_in_firmware(flash).env("PATH", env::join_paths(folders)?));
    let error = result.err().context("cargo needs no probe-rs")?.to_string();
    ensure!(error.contains("could not execute process `probe-rs run "), "{error}");
    Ok(())
}

/// The folders of programs. That of cargo is the first: it has the compiler even where another one has probe-rs, too.
fn path() -> Vec<PathBuf> {
    let cargo = env::var_os("CARGO").map(PathBuf::from);
    let of_cargo = cargo.as_deref().and_then(Path::parent).map(Path::to_owned);
    let others = env::var_os("PATH").unwrap_or_default();
    of_cargo.into_iter().chain(env::split_paths(&others)).collect()
}

/// In the root of the repository cargo warns that it makes another image.
fn expect_warning_in_root() -> Result<()> {
    let mut check = cargo(&format!("check --package armwire-firmware --target {TARGET}"));
    let output = check.output()?;
    let text = String::from_utf8_lossy(&output.stderr);
    ensure!(
        output.status.success() && text.contains("not the image that ships"),
        "`{}`: {text}",
        shown(&check)
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::workspace::{firmware, root};

    /// The commands of cargo in the `console` blocks of a page.
    fn commands(page: &str) -> Vec<String> {
        let text = fs::read_to_string(root().join(page)).unwrap();
        let commands = text.lines().filter_map(|line| line.strip_prefix("$ cargo "));
        let words = |command: &str| command.split('#').next().unwrap().trim().to_owned();
        commands.map(words).collect()
    }

    #[test]
    fn commands_of_the_readmes_are_typed() {
        let mut typed: Vec<_> = IMAGES
            .into_iter()
            .flat_map(|(_, build, flash)| [build, flash])
            .collect();
        typed.extend(LINTS);
        assert_eq!(commands("firmware/README.md"), typed);
        let (_, build, flash) = IMAGES[0];
        let readme = commands("README.md");
        assert!(readme.iter().any(|words| words == build) && readme.iter().any(|words| words == flash));
    }

    /// Cargo only warns about an unknown package.
    #[test]
    fn packages_with_a_level_exist() {
        let lock = fs::read_to_string(root().join("Cargo.lock")).unwrap();
        let config = fs::read_to_string(firmware().join(".cargo/config.toml")).unwrap();
        let packages: Vec<_> = config
            .lines()
            .filter_map(|line| line.split_once(".opt-level = "))
            .collect();
        assert!(!packages.is_empty());
        for (package, _) in packages {
            assert!(lock.contains(&format!("name = \"{package}\"\n")), "{package}");
        }
    }

    #[test]
    fn cargo_embed_knows_each_chip() {
        let embed = fs::read_to_string(firmware().join("Embed.toml")).unwrap();
        for (board, ..) in IMAGES {
            assert!(
                embed.contains(&format!("chip = \"{}\"\n", board.chip())),
                "{}",
                board.name()
            );
        }
    }
}
