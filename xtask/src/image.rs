//! The firmware image.

use std::env;
use std::ffi::OsString;
use std::fmt;
use std::fs;
use std::path::PathBuf;

use crate::Result;
use crate::USAGE;
use crate::board::Board;
use crate::dfu;
use crate::process::run;
use crate::program::Program;
use crate::toolchain::Toolchain;
use crate::workspace;

/// What the image is compiled for, whatever the board.
pub(crate) const TARGET: &str = "thumbv7em-none-eabihf";

/// The most flash that the image that ships may take, in bytes. The goal is 48 KiB.
const MAX_FLASH: u64 = 96 * 1024;

/// The most RAM that it may take, in bytes, without the stack.
const MAX_RAM: u64 = 14 * 1024;

/// Which image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Options {
    /// For which board.
    pub(crate) board: Board,
    /// Log over RTT.
    pub(crate) defmt: bool,
}

impl Options {
    /// The image for this board that ships.
    pub(crate) fn of(board: Board) -> Self {
        Self {
            board,
            ..Self::default()
        }
    }

    /// All that this board has.
    pub(crate) fn all(board: Board) -> Self {
        Self { board, defmt: true }
    }

    /// From the command line.
    ///
    /// # Errors
    ///
    /// If there is an option that is none of these, or a board that is not there.
    pub(crate) fn parse(args: &[OsString]) -> Result<Self> {
        let mut options = Self::default();
        let mut args = args.iter();
        while let Some(arg) = args.next() {
            match arg.to_str() {
                Some("--board") => {
                    let name = args.next().ok_or("`--board` needs the name of a board")?;
                    options.board = Board::parse(&name.to_string_lossy())?;
                }
                Some("--defmt") => options.defmt = true,
                _ => return Err(format!("unknown option `{}`\n\n{USAGE}", arg.display()).into()),
            }
        }
        Ok(options)
    }

    /// The features of `armwire-firmware` that make this image.
    pub(crate) fn features(self) -> String {
        [&[self.board.feature()][..], &self.extras()].concat().join(",")
    }

    /// What the image is called.
    fn name(self) -> String {
        [&["armwire", self.board.name()][..], &self.extras()].concat().join("-")
    }

    /// The features besides the board's.
    fn extras(self) -> Vec<&'static str> {
        self.defmt.then_some("defmt").into_iter().collect()
    }
}

/// A firmware image, ready to be flashed or run. Beside the ELF file are two of the same name: `.bin`, flash from its
/// start to the image's end, and `.dfu`, which leaves alone what the image does not use.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Image {
    /// The ELF file.
    pub(crate) path: PathBuf,
    /// Flash it takes, in bytes.
    flash: u64,
    /// RAM it takes without the stack, in bytes.
    ram: u64,
}

impl Image {
    /// Whether an image that ships may be so big.
    ///
    /// # Errors
    ///
    /// If not.
    pub(crate) fn check_size(&self) -> Result {
        if self.flash > MAX_FLASH || self.ram > MAX_RAM {
            return Err(format!("{self}; allowed are {MAX_FLASH} and {MAX_RAM}").into());
        }
        Ok(())
    }
}

impl fmt::Display for Image {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} (and .bin, .dfu): {} bytes of flash, {} bytes of RAM and the stack",
            self.path.display(),
            self.flash,
            self.ram
        )
    }
}

/// The image for the STM32F405 that the virtual board is to run: that which `ARMWIRE_IMAGE` names, or one that is built.
///
/// # Errors
///
/// If it does not build.
pub(crate) fn for_virtual_board() -> Result<PathBuf> {
    match env::var_os("ARMWIRE_IMAGE") {
        Some(image) => Ok(image.into()),
        None => Ok(build(&Options::of(Board::Stm32f405))?.path),
    }
}

/// Builds the image, sees that the board's chip starts it, and puts it in the target directory under a name of its own.
///
/// # Errors
///
/// If it does not build, or its vector table is that of another board.
pub(crate) fn build(options: &Options) -> Result<Image> {
    let toolchain = Toolchain::find(&[TARGET])?;
    let board = options.board.name();
    println!("building the firmware image for {board}, one or two minutes the first time");
    let mut cargo = toolchain.cargo("build", TARGET)?;
    cargo.args(["--package", "armwire-firmware", "--profile", "firmware"]);
    cargo.args(["--no-default-features", &format!("--features={}", options.features())]);
    run(cargo.current_dir(workspace::root()))?;

    let built = toolchain
        .target_dir()?
        .join(TARGET)
        .join("firmware")
        .join("armwire-firmware");
    let elf = fs::read(&built).map_err(|error| format!("cannot read {}: {error}", built.display()))?;
    let program = Program::parse(&elf)?;
    program.check_vectors(options.board.stack_top())?;
    let path = workspace::target_dir()?.join(options.name() + ".elf");
    let write = |extension, bytes: &[u8]| {
        let path = path.with_extension(extension);
        fs::write(&path, bytes).map_err(|error| format!("cannot write {}: {error}", path.display()))
    };
    write("elf", &elf)?;
    write("bin", &program.bin())?;
    write("dfu", &dfu::file(board, &program.segments))?;
    Ok(Image {
        path,
        flash: program.flash(),
        ram: program.ram,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(args: &str) -> Result<Options> {
        let args: Vec<OsString> = args.split_whitespace().map(OsString::from).collect();
        Options::parse(&args)
    }

    #[test]
    fn options_say_which_image() {
        assert_eq!(parse("").unwrap(), Options::of(Board::Stm32f405));
        assert_eq!(parse("--defmt").unwrap(), Options::all(Board::Stm32f405));
        let options = parse("--board stm32g431 --defmt").unwrap();
        assert_eq!(options, Options::all(Board::Stm32g431));
        assert_eq!(options.features(), "board-stm32g431,defmt");
        assert_eq!(options.name(), "armwire-stm32g431-defmt");
    }

    #[test]
    fn options_that_cannot_be_are_refused() {
        let refused = [
            ("--board", "`--board` needs the name of a board"),
            ("--board f405", "there is no board `f405`"),
            ("--crystal-12mhz", "unknown option `--crystal-12mhz`"),
            ("--release", "unknown option `--release`"),
        ];
        for (args, reason) in refused {
            let error = parse(args).unwrap_err().to_string();
            assert!(error.starts_with(reason), "{args}: {error}");
        }
    }

    #[test]
    fn an_image_is_refused_when_it_is_bigger_than_allowed() {
        let image = |flash, ram| Image {
            path: "image.elf".into(),
            flash,
            ram,
        };
        assert!(image(MAX_FLASH, MAX_RAM).check_size().is_ok());
        assert!(image(MAX_FLASH + 1, 0).check_size().is_err());
        assert!(image(0, MAX_RAM + 1).check_size().is_err());
    }
}
