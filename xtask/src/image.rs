//! The firmware image.

use std::ffi::OsString;
use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};

use object::Endianness;
use object::elf::{FileHeader32, PT_LOAD};
use object::read::elf::{FileHeader, ProgramHeader};

use crate::Result;
use crate::USAGE;
use crate::process::run;
use crate::toolchain::Toolchain;
use crate::workspace;

/// What the image is compiled for.
pub(crate) const TARGET: &str = "thumbv7em-none-eabihf";

/// Which image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Options {
    /// For boards with a 12 MHz crystal instead of 8 MHz.
    pub(crate) crystal_12mhz: bool,
    /// Log over RTT.
    pub(crate) defmt: bool,
}

impl Options {
    /// All of them.
    pub(crate) const ALL: Self = Self {
        crystal_12mhz: true,
        defmt: true,
    };

    /// From the command line.
    ///
    /// # Errors
    ///
    /// If there is an option that is none of these.
    pub(crate) fn parse(args: &[OsString]) -> Result<Self> {
        let mut options = Self::default();
        for arg in args {
            match arg.to_str() {
                Some("--crystal-12mhz") => options.crystal_12mhz = true,
                Some("--defmt") => options.defmt = true,
                _ => return Err(format!("unknown option `{}`\n\n{USAGE}", arg.display()).into()),
            }
        }
        Ok(options)
    }

    /// The features of `armwire-firmware` that make this image.
    fn features(self) -> Vec<&'static str> {
        let all = [(self.crystal_12mhz, "crystal-12mhz"), (self.defmt, "defmt")];
        all.into_iter()
            .filter_map(|(wanted, feature)| wanted.then_some(feature))
            .collect()
    }
}

/// A firmware image, ready to be flashed or run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Image {
    /// The ELF file.
    pub(crate) path: PathBuf,
    /// Flash it takes, in bytes.
    flash: u64,
    /// RAM it takes without the stack, in bytes.
    ram: u64,
}

impl fmt::Display for Image {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{}: {} bytes of flash, {} bytes of RAM and the stack",
            self.path.display(),
            self.flash,
            self.ram
        )
    }
}

/// Builds the image and puts it in the target directory under a name of its own.
pub(crate) fn build(options: &Options) -> Result<Image> {
    let toolchain = Toolchain::find(&[TARGET])?;
    println!("building the firmware image, one or two minutes the first time");
    let features = options.features();
    let mut cargo = toolchain.cargo("build", TARGET)?;
    cargo.args(["--package", "armwire-firmware", "--profile", "firmware"]);
    cargo.arg(format!("--features={}", features.join(",")));
    run(cargo.current_dir(workspace::root()))?;

    let built = toolchain
        .target_dir()?
        .join(TARGET)
        .join("firmware")
        .join("armwire-firmware");
    let name = [&["armwire-f405"][..], &features].concat().join("-");
    let path = workspace::target_dir()?.join(name + ".elf");
    fs::copy(&built, &path).map_err(|error| format!("cannot copy {}: {error}", built.display()))?;
    let (flash, ram) = size(&path)?;
    Ok(Image { path, flash, ram })
}

/// The bytes of flash and RAM that an ELF file takes.
fn size(path: &Path) -> Result<(u64, u64)> {
    /// Where RAM begins on every Cortex-M.
    const RAM: u64 = 0x2000_0000;
    let bytes = fs::read(path)?;
    let elf = FileHeader32::<Endianness>::parse(&*bytes)?;
    let endian = elf.endian()?;
    let (mut flash, mut ram) = (0, 0);
    for segment in elf.program_headers(endian, &*bytes)? {
        if segment.p_type(endian) != PT_LOAD {
            continue;
        }
        flash += u64::from(segment.p_filesz(endian));
        if u64::from(segment.p_vaddr(endian)) >= RAM {
            ram += u64::from(segment.p_memsz(endian));
        }
    }
    Ok((flash, ram))
}
