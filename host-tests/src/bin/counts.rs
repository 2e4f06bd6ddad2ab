//! Runs an image of `host-tests/counts` on a Cortex-M on the virtual board's core, and prints how many instructions each case took.
//!
//! `counts IMAGE`. A line for each case: its name and the instructions from its first one to the first of `done`.

use std::collections::BTreeMap;
use std::env;
use std::error::Error;
use std::fs;
use std::path::Path;
use std::process::ExitCode;

use armwire_virtual_board::core::{Access, Bus, BusError, Config, Core, Memory, Stop};
use object::elf::{FileHeader32, PT_LOAD};
use object::read::elf::{FileHeader, ProgramHeader};
use object::{Endianness, Object, ObjectSymbol};

/// What the names of cases begin with, and where each ends.
const CASE: &str = "count_";
const DONE: &str = "done";

/// The first case, and what is there once all is well and done.
const NOTHING: &str = "count_nothing";

/// So many instructions an image may take: far more than any does.
const LIMIT: u64 = 200_000_000;

/// The memories that `host-tests/counts` is linked for.
const FLASH: u32 = 0x0800_0000;
const FLASH_SIZE: usize = 512 << 10;
const RAM: u32 = 0x2000_0000;
const RAM_SIZE: usize = 128 << 10;

/// There is nothing besides the memories.
struct Nothing;

impl Bus for Nothing {
    fn read(&mut self, _: Access, _: &mut Memory) -> Result<u32, BusError> {
        Err(BusError)
    }

    fn write(&mut self, _: Access, _: u32, _: &mut Memory) -> Result<(), BusError> {
        Err(BusError)
    }

    fn needs_attention(&self) -> bool {
        false
    }
}

fn main() -> ExitCode {
    match env::args_os()
        .nth(1)
        .ok_or("usage: counts IMAGE".into())
        .and_then(|image| count(Path::new(&image)))
    {
        Ok(counts) => {
            for (name, count) in counts {
                println!("{name} {count}");
            }
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

/// The instructions of each case of an image, without what the empty one takes.
fn count(path: &Path) -> Result<BTreeMap<String, u64>, Box<dyn Error>> {
    let bytes = fs::read(path)?;
    let file = object::File::parse(&*bytes)?;
    let symbols: BTreeMap<u32, String> = file
        .symbols()
        .filter(|symbol| symbol.is_definition())
        .filter_map(|symbol| Some((symbol.address() as u32 & !1, symbol.name().ok()?.to_owned())))
        .filter(|(_, name)| name == DONE || name.starts_with(CASE))
        .collect();
    let mut core = Core::new(
        Config {
            interrupts: 0,
            priority_bits: 4,
            vector_table: FLASH,
            mpu_regions: 0,
            bit_band: false,
        },
        Memory::new(FLASH, flash(&bytes)?, RAM, RAM_SIZE),
    );
    for address in symbols.keys() {
        core.set_breakpoint(*address);
    }
    let mut counts = run(&mut core, &symbols)?;
    for name in symbols.values().filter(|name| *name != DONE) {
        if !counts.contains_key(name) {
            return Err(format!("{name} did not come to its end, or came to another result than it should").into());
        }
    }
    let nothing = counts.remove(NOTHING).ok_or("the image has no empty case")?;
    Ok(counts
        .into_iter()
        .map(|(name, count)| (name, count.saturating_sub(nothing)))
        .collect())
}

/// What the image puts into the flash.
fn flash(image: &[u8]) -> Result<Vec<u8>, Box<dyn Error>> {
    let header = FileHeader32::<Endianness>::parse(image)?;
    let endian = header.endian()?;
    let mut flash = vec![0xFF; FLASH_SIZE];
    for segment in header.program_headers(endian, image)? {
        let data = segment.data(endian, image).map_err(|()| "a segment beyond the end")?;
        let start = segment.p_paddr(endian).wrapping_sub(FLASH) as usize;
        let place = flash.get_mut(start..start.saturating_add(data.len()));
        if let (PT_LOAD, Some(place)) = (segment.p_type(endian), place) {
            place.copy_from_slice(data);
        }
    }
    Ok(flash)
}

/// Runs from the reset until the core has nothing more to do, and notes how many instructions each case took.
fn run(core: &mut Core, symbols: &BTreeMap<u32, String>) -> Result<BTreeMap<String, u64>, Box<dyn Error>> {
    let mut counts = BTreeMap::new();
    let mut begun = None;
    core.reset(&mut Nothing);
    loop {
        match core.run(&mut Nothing, LIMIT) {
            Stop::Breakpoint => {}
            Stop::Deadline => return Ok(counts),
            other => return Err(format!("the core stopped: {other:?}").into()),
        }
        let instructions = core.instructions();
        match symbols.get(&core.pc()) {
            Some(name) if name != DONE => begun = Some((name, instructions)),
            _ => {
                if let Some((name, begin)) = begun.take() {
                    counts.insert(name.clone(), instructions - begin);
                }
            }
        }
    }
}
