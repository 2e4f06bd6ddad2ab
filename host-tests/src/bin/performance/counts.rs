//! Instructions, stack and flash of the protocols, on the virtual board's core.

use std::path::Path;

use armwire_virtual_board::core::{Config, Core, Memory, NoPeripherals, Register, Stop, Width};

use crate::Result;
use crate::elf::{Elf, FLASH, PAINT, RAM, used, words};

/// The cases of a protocol, in the order of the program `host-tests/benches/thumb.rs`.
pub(crate) const CASES: [&str; 4] = [
    "reply decoded",
    "reply decoded byte by byte",
    "request encoded",
    "whole call",
];

/// The protocols in the order of the program, and their limits: instructions of each case, and bytes of flash of decoder
/// and client. The limits are 5 % to 10 % above the measurements.
pub(crate) const PROTOCOLS: [(&str, [u64; 4], usize); 3] = [
    ("Ling", [310, 1460, 136, 1880], 15_600),
    ("xArm", [175, 1620, 75, 1560], 9_700),
    ("Alpha1", [275, 1480, 44, 1820], 13_600),
];

/// Maximum stack of a case, in bytes. It includes the answer to a call, up to 264 bytes for an xArm.
const STACK_LIMIT: u32 = 760;

/// The program's RAM, and the painted part of its stack, in bytes.
const RAM_SIZE: usize = 128 * 1024;
const STACK: u32 = 16 * 1024;
/// Maximum number of cycles between two breakpoints.
const MAX_CYCLES: u64 = 1_000_000;

const CORTEX_M4: Config = Config {
    interrupts: 82,
    priority_bits: 4,
    vector_table: FLASH,
    mpu_regions: 8,
    bit_band: true,
};

/// The cost of a case: instructions, bytes of stack, and bytes of its state (the decoder or the client).
#[derive(Clone, Copy)]
pub(crate) struct Case {
    pub(crate) instructions: u64,
    pub(crate) stack: u32,
    pub(crate) state: u32,
}

/// A protocol: its cases, and the flash of decoder and client in bytes.
pub(crate) struct Protocol {
    pub(crate) cases: Vec<Case>,
    pub(crate) flash: usize,
}

/// Runs the program with all protocols, and compares the sizes of the programs with one. They are in `folder`.
pub(crate) fn measure(folder: &Path) -> Result<Vec<Protocol>> {
    let elf = |name: &str| Elf::read(&folder.join(name).with_extension("elf"));
    let cases = run(elf("all")?)?;
    let none = elf("none")?.flash_bytes;
    let protocol = |(cases, (name, ..)): (&[Case], (&str, _, _))| {
        let (cases, flash) = (cases.to_vec(), elf(name)?.flash_bytes - none);
        Ok(Protocol { cases, flash })
    };
    cases.chunks(CASES.len()).zip(PROTOCOLS).map(protocol).collect()
}

/// Counts each case of a program, without the cost of the first, which is empty.
fn run(elf: Elf) -> Result<Vec<Case>> {
    assert_eq!(elf.ram_bytes, 0, "nothing initializes variables");
    let mut core = Core::new(CORTEX_M4, Memory::new(FLASH, elf.flash, RAM, RAM_SIZE));
    let mark = elf.symbols["mark"];
    core.set_breakpoint(mark);
    core.reset(&mut NoPeripherals);
    let next = |core: &mut Core| {
        let stop = core.run(&mut NoPeripherals, core.cycle() + MAX_CYCLES);
        let good = stop == Stop::Breakpoint && core.pc() == mark;
        let error = || format!("a case did not end: {stop:?} at {:#x}", core.pc());
        good.then(|| core.register(Register::R(0))).ok_or_else(error)
    };
    let (mut cases, mut empty) = (Vec::new(), None);
    while let state @ 1.. = next(&mut core)? {
        let top = core.register(Register::R(13));
        let (stack, before) = ([top - STACK, top], core.instructions());
        for address in words(stack) {
            core.memory_mut().write(address, Width::Word, PAINT);
        }
        next(&mut core)?;
        let instructions = core.instructions() - before;
        let stack = used(stack, |address| core.memory().read(address, Width::Word).unwrap_or(0));
        match empty {
            None => empty = Some(instructions),
            Some(empty) => {
                let instructions = instructions - empty;
                cases.push(Case {
                    instructions,
                    stack,
                    state,
                });
            }
        }
    }
    Ok(cases)
}

/// The figures that exceed their limits.
pub(crate) fn failures(protocols: &[Protocol]) -> Vec<String> {
    let mut failures = Vec::new();
    for (protocol, (name, limits, flash)) in protocols.iter().zip(PROTOCOLS) {
        if protocol.flash > flash {
            failures.push(format!(
                "{name}: {} bytes of flash, the limit is {flash}",
                protocol.flash
            ));
        }
        for ((case, case_name), limit) in protocol.cases.iter().zip(CASES).zip(limits) {
            let Case {
                instructions, stack, ..
            } = case;
            if *instructions > limit || *stack > STACK_LIMIT {
                let limits = format!("the limits are {limit} and {STACK_LIMIT}");
                failures.push(format!(
                    "{name}, {case_name}: {instructions} instructions, {stack} bytes of stack, {limits}"
                ));
            }
        }
    }
    failures
}
