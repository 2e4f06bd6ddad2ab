//! What the core's instructions belong to.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::error::Error;
use std::fs;
use std::path::Path;

use addr2line::Context;
use addr2line::gimli::{self, Dwarf, EndianSlice, LittleEndian};
use object::{Object, ObjectSection, SectionKind};

/// What an instruction is a multiple of, in bytes.
const HALFWORD: usize = 2;

/// The standard library's crates: what is inlined of them belongs to whoever uses it.
const STANDARD: [&str; 2] = ["core", "alloc"];

/// A function, or as much of it as is not inlined from another.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Owner {
    /// Its crate, by the folder that it is in, without a version.
    pub package: String,
    /// The file, by its path in the crate's sources.
    pub file: String,
    /// Its name.
    pub function: String,
}

/// How many instructions of each function ran, or how many bytes of code it has, by what the debug information of the image says.
///
/// # Errors
///
/// If the image cannot be read.
pub fn by_owner(image: &Path, profile: &BTreeMap<u64, u64>) -> Result<BTreeMap<Owner, u64>, Box<dyn Error>> {
    let bytes = fs::read(image)?;
    let file = object::File::parse(&*bytes)?;
    let dwarf = Dwarf::load(|section| -> Result<_, gimli::Error> {
        let section = file.section_by_name(section.name());
        let bytes = section.and_then(|section| section.data().ok());
        Ok(EndianSlice::new(bytes.unwrap_or_default(), LittleEndian))
    })?;
    let context = Context::from_dwarf(dwarf)?;
    let mut owners = BTreeMap::new();
    for (address, count) in profile {
        *owners.entry(owner(&context, *address)?).or_default() += count;
    }
    Ok(owners)
}

/// How many bytes of code lie at each place of the image where an instruction can begin.
///
/// # Errors
///
/// If the image cannot be read.
pub fn code(image: &Path) -> Result<BTreeMap<u64, u64>, Box<dyn Error>> {
    let bytes = fs::read(image)?;
    let file = object::File::parse(&*bytes)?;
    let sections = file.sections().filter(|section| section.kind() == SectionKind::Text);
    let places = sections.flat_map(|section| (section.address()..section.address() + section.size()).step_by(HALFWORD));
    Ok(places.map(|place| (place, HALFWORD as u64)).collect())
}

/// How many instructions of each crate ran, or how many bytes of code it has.
pub fn by_package(owners: &BTreeMap<Owner, u64>) -> BTreeMap<&str, u64> {
    let mut packages = BTreeMap::new();
    for (owner, count) in owners {
        *packages.entry(&*owner.package).or_default() += count;
    }
    packages
}

/// The innermost function at this address that is not the standard library's.
fn owner(context: &Context<EndianSlice<'_, LittleEndian>>, address: u64) -> Result<Owner, gimli::Error> {
    let mut frames = context.find_frames(address).skip_all_loads()?;
    let mut owner = Owner {
        package: "?".to_owned(),
        file: String::new(),
        function: String::new(),
    };
    while let Some(frame) = frames.next()? {
        let path = frame.location.and_then(|location| location.file).unwrap_or_default();
        let (package, file) = place(path);
        let function = frame.function.as_ref().map(|name| name.demangle()).transpose()?;
        owner = Owner {
            package: package.to_owned(),
            file: file.to_owned(),
            function: without_hash(&function.unwrap_or(Cow::Borrowed("?"))).to_owned(),
        };
        if !STANDARD.contains(&package) {
            break;
        }
    }
    Ok(owner)
}

/// The crate of a source file, and its path in there: `/somewhere/embassy-sync-0.8.0/src/signal.rs` is `signal.rs` of
/// `embassy-sync`. What a build script has made is in `out`, in a folder with a hash instead of a version.
fn place(path: &str) -> (&str, &str) {
    let last = |folder: &'static str| path.rsplit_once(folder);
    let Some((folder, file)) = last("/src/").or_else(|| last("/out/")) else {
        return (path, "");
    };
    let package = folder.rsplit_once('/').map_or(folder, |(_, package)| package);
    let is_no_name = |part: &str| part.len() == 16 || part.starts_with(|c: char| c.is_ascii_digit());
    let ends = package.match_indices('-').map(|(at, _)| at);
    let end = ends
        .into_iter()
        .find(|at| is_no_name(package[at + 1..].split('-').next().unwrap_or_default()));
    (end.map_or(package, |end| &package[..end]), file)
}

/// A demangled name without the hash at its end.
fn without_hash(name: &str) -> &str {
    match name.rsplit_once("::h") {
        Some((name, hash)) if hash.len() == 16 && hash.bytes().all(|c| c.is_ascii_hexdigit()) => name,
        _ => name,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_of_the_crate_whose_sources_it_is_in() {
        for (path, expected) in [
            ("/a/b/bridge/src/can/frame.rs", ("bridge", "can/frame.rs")),
            ("/r/src/index-1/embassy-usb-0.6.0/src/lib.rs", ("embassy-usb", "lib.rs")),
            (
                "/r/stm32-metapac-21.0.0-rc.1/src/common.rs",
                ("stm32-metapac", "common.rs"),
            ),
            (
                "/t/build/embassy-stm32-fdb56bc17cf96b90/out/_generated.rs",
                ("embassy-stm32", "_generated.rs"),
            ),
            ("/rustc/1.95/library/core/src/cell.rs", ("core", "cell.rs")),
            ("elsewhere.rs", ("elsewhere.rs", "")),
        ] {
            assert_eq!(place(path), expected);
        }
    }

    #[test]
    fn a_name_is_shown_without_its_hash() {
        assert_eq!(without_hash("a::b::h0123456789abcdef"), "a::b");
        assert_eq!(without_hash("a::hear"), "a::hear");
    }
}
