//! The GNU C library that programs for Linux need.

use anyhow::{Context, Result, ensure};
use object::Endianness;
use object::elf::{FileHeader32, FileHeader64};
use object::read::elf::FileHeader;
use object::read::{self, FileKind};

/// The oldest version that released programs need: that of Rust's own library.
pub(crate) const OLDEST: &str = "2.17";

/// Checks that a program or library needs no newer version than [`OLDEST`].
///
/// # Errors
///
/// If a symbol has a newer version, or none has a version: the file is no ELF file that is linked with the library.
pub(crate) fn check(file: &[u8]) -> Result<()> {
    let needed = needed(file)?;
    ensure!(
        needed <= numbers(OLDEST)?,
        "a symbol needs glibc {needed:?}, newer than {OLDEST}"
    );
    Ok(())
}

/// The highest version of a symbol, such as `[2, 17]`.
fn needed(file: &[u8]) -> Result<Vec<u32>> {
    let names = match FileKind::parse(file)? {
        FileKind::Elf32 => versions::<FileHeader32<Endianness>>(file)?,
        _ => versions::<FileHeader64<Endianness>>(file)?,
    };
    let texts = names.iter().filter_map(|name| name.strip_prefix("GLIBC_"));
    let newest = texts.map(numbers).collect::<Result<Vec<_>>>()?.into_iter().max();
    newest.context("no symbol has a version of glibc")
}

/// The names of all versions that symbols of other libraries have, such as `GLIBC_2.17`.
fn versions<Header: FileHeader<Endian = Endianness>>(file: &[u8]) -> read::Result<Vec<String>> {
    let elf = Header::parse(file)?;
    let endian = elf.endian()?;
    let sections = elf.sections(endian, file)?;
    let mut names = Vec::new();
    if let Some((libraries, strings)) = sections.gnu_verneed(endian, file)? {
        let strings = sections.strings(endian, file, strings)?;
        for library in libraries {
            let (_, versions) = library?;
            for version in versions {
                names.push(String::from_utf8_lossy(version?.name(endian, strings)?).into_owned());
            }
        }
    }
    Ok(names)
}

fn numbers(version: &str) -> Result<Vec<u32>> {
    let numbers = version.split('.').map(str::parse).collect::<Result<_, _>>();
    numbers.with_context(|| format!("{version} is no version"))
}

#[cfg(all(test, target_os = "linux", target_env = "gnu"))]
mod tests {
    use std::{env, fs};

    use super::*;

    #[test]
    fn versions_are_compared_by_number() {
        let numbers = |text| numbers(text).unwrap();
        assert!(numbers("2.2.5") < numbers("2.17") && numbers("2.4") < numbers("2.17"));
        assert!(numbers("2.34") > numbers("2.17") && numbers("3.0") > numbers("2.17"));
        assert!(super::numbers("PRIVATE").is_err());
    }

    /// This program is linked with the library of this machine, which Rust 1.93 needs to be 2.17 or newer.
    #[test]
    fn version_of_this_program_is_found() {
        let needed = needed(&fs::read(env::current_exe().unwrap()).unwrap()).unwrap();
        assert!(needed >= numbers(OLDEST).unwrap(), "{needed:?}");
    }

    #[test]
    fn other_files_are_refused() {
        assert!(check(b"not an ELF file, but as long as one").is_err());
    }
}
