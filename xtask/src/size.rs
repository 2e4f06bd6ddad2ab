//! `cargo xtask size`: how much flash, RAM and stack the protocols take, each alone, and the firmware images.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs;

use object::Endianness;
use object::elf::{FileHeader32, STT_FUNC};
use object::read::elf::{FileHeader, Sym};
use serde_json::json;

use crate::Result;
use crate::baseline::{Baseline, Figures};
use crate::board::Board;
use crate::image::{self, Options};
use crate::process::run as run_command;
use crate::program::Program;
use crate::stack::{self, TARGETS};
use crate::toolchain::Toolchain;
use crate::workspace;

/// Where the figures are kept.
const FILE: &str = "host-tests/counts/size.txt";

/// Features of `armwire`.
const PROTOCOLS: [&str; 6] = ["ling", "crc-table", "crc-table16", "xarm", "alpha1", "ling,xarm,alpha1"];

/// What is measured of each, and the feature of the program for it.
const PARTS: [(&str, &str); 2] = [(DECODER, ""), ("decoder and client", "client,")];
const DECODER: &str = "decoder";

/// What a protocol alone should take at most, in bytes.
const GOAL: Size = Size { flash: 1536, ram: 256 };

/// What is in every program that copies, and no part of ours.
const MEMORY_FUNCTIONS: [&str; 5] = ["memcpy", "memmove", "memset", "memclr", "memcmp"];

/// Flash and RAM, in bytes, without the stack.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Size {
    pub(crate) flash: u64,
    pub(crate) ram: u64,
}

/// Prints the tables, and checks that nothing has grown; with `--write`, keeps the figures.
///
/// # Errors
///
/// If one grew by more than 3 %, or something does not build.
pub(crate) fn run(args: &[OsString]) -> Result {
    let write = match args {
        [] => false,
        [option] if option == "--write" => true,
        _ => return Err("usage: cargo xtask size [--write]".into()),
    };
    let toolchain = Toolchain::find(&TARGETS)?;
    let mut rows = Vec::new();
    for target in TARGETS {
        for (part, feature) in PARTS {
            for features in PROTOCOLS {
                let goal = (part != DECODER && !features.contains(',')).then_some(GOAL);
                rows.push((
                    format!("{target}, {part}: {features}"),
                    protocol(toolchain, target, &format!("{feature}{features}"))?,
                    goal,
                ));
            }
        }
    }
    for board in Board::ALL {
        for options in [Options::of(board), Options::all(board)] {
            let image = image::build(&options)?;
            rows.push((format!("image: {}", options.features()), image.size(), None));
        }
    }
    println!("{:60}{:>10}{:>8}", "bytes", "flash", "RAM");
    let mut figures = Figures::new();
    for (name, size, goal) in &rows {
        let missed = goal.is_some_and(|goal| size.flash > goal.flash || size.ram > goal.ram);
        println!(
            "{name:60}{:>10}{:>8}{}",
            size.flash,
            size.ram,
            if missed { "  goal missed" } else { "" }
        );
        figures.insert(format!("{name}, flash"), size.flash);
        figures.insert(format!("{name}, RAM"), size.ram);
    }
    println!("goal of a protocol alone: {} and {}", GOAL.flash, GOAL.ram);
    println!("{:60}{:>10}{:>8}", "stack at worst, bytes", "Cortex-M0", "M4");
    let depths = stack::worst(toolchain)?;
    for (what, [m0, m4]) in &depths {
        println!("{what:60}{m0:>10}{m4:>8}");
        for (target, depth) in TARGETS.iter().zip([m0, m4]) {
            figures.insert(format!("{target}, stack: {what}"), (*depth).into());
        }
    }
    save(&rows, &depths)?;
    Baseline::of(figures, toolchain)?.check(FILE, "cargo xtask size", write)
}

/// What these features of the program take, with `client` decoder and client, without it the decoder alone, besides functions
/// that move memory.
///
/// # Errors
///
/// If they do not build.
pub(crate) fn protocol(toolchain: Toolchain, target: &str, features: &str) -> Result<Size> {
    let empty = program(toolchain, target, "")?;
    let with = program(toolchain, target, features)?;
    Ok(Size {
        flash: with.flash.saturating_sub(empty.flash),
        ram: with.ram.saturating_sub(empty.ram),
    })
}

/// The size of the program with these features, without functions that move memory.
fn program(toolchain: Toolchain, target: &str, features: &str) -> Result<Size> {
    let mut cargo = toolchain.cargo("build", target)?;
    cargo
        .args(["--quiet", "--profile", "size", "--bin", "size", "--no-default-features"])
        .arg(format!("--features=image,{features}"))
        .current_dir(workspace::root().join("host-tests/counts"));
    run_command(&mut cargo)?;
    let elf = fs::read(toolchain.target_dir()?.join(target).join("size/size"))?;
    let program = Program::parse(&elf)?;
    Ok(Size {
        flash: program.flash() - memory_functions(&elf)?,
        ram: program.ram,
    })
}

/// The bytes of all functions that move memory.
fn memory_functions(file: &[u8]) -> Result<u64> {
    let elf = FileHeader32::<Endianness>::parse(file)?;
    let endian = elf.endian()?;
    let symbols = elf
        .sections(endian, file)?
        .symbols(endian, file, object::elf::SHT_SYMTAB)?;
    let mut functions = BTreeMap::new();
    for symbol in symbols.iter() {
        let name = String::from_utf8_lossy(symbol.name(endian, symbols.strings())?);
        let is_one = MEMORY_FUNCTIONS.iter().any(|part| name.contains(part));
        if symbol.st_type() == STT_FUNC && is_one {
            // Several names may be of one function.
            functions.insert(symbol.st_value(endian), symbol.st_size(endian));
        }
    }
    Ok(functions.into_values().map(u64::from).sum())
}

/// Writes `size.json` into the target directory.
fn save(rows: &[(String, Size, Option<Size>)], depths: &BTreeMap<String, [u32; 2]>) -> Result {
    let row = |(name, size, goal): &(String, Size, Option<Size>)| {
        json!({
            "name": name, "flash": size.flash, "ram": size.ram,
            "flash_goal": goal.map(|goal| goal.flash), "ram_goal": goal.map(|goal| goal.ram),
        })
    };
    let file = workspace::target_dir()?.join("size.json");
    let depth = |(name, stack)| json!({ "name": name, "stack": stack, "stack_goal": stack::LIMIT });
    let rows: Vec<_> = rows.iter().map(row).chain(depths.iter().map(depth)).collect();
    fs::write(&file, serde_json::to_string_pretty(&rows)?)?;
    println!("as JSON: {}", file.display());
    Ok(())
}
