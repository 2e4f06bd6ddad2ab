//! The image's `memcpy`, called on the virtual board's core.

use std::fs;

use armwire_host_tests::image::path;
use armwire_virtual_board::core::{Config, Core, Memory, NoPeripherals, Register, Stop, Width};
use object::{Object, ObjectSegment, ObjectSymbol};

const FLASH: u32 = 0x0800_0000;
const RAM: u32 = 0x2000_0000;
const RAM_SIZE: usize = 16 * 1024;
/// The places of the copy, of its bytes, and the top of the stack.
const TARGET: u32 = RAM + 0x400;
const SOURCE: u32 = RAM + 0x800;
const STACK: u32 = RAM + 0x1000;

const CORTEX_M4: Config = Config {
    interrupts: 82,
    priority_bits: 4,
    vector_table: FLASH,
    mpu_regions: 8,
    bit_band: true,
};

/// A core with the image in its flash, and the address of a function of the image.
fn core_with(function: &str) -> (Core, u32) {
    let bytes = fs::read(path()).unwrap();
    let file = object::File::parse(&*bytes).unwrap();
    let mut flash = Vec::new();
    for segment in file.segments().filter(|segment| segment.address() < RAM.into()) {
        flash.resize((segment.address() as u32 - FLASH) as usize, 0xFF);
        flash.extend(segment.data().unwrap());
    }
    let named = |symbol: &object::Symbol<'_, '_>| symbol.name() == Ok(function);
    let symbol = file.symbols().find(named).expect("the image has the function");
    let mut core = Core::new(CORTEX_M4, Memory::new(FLASH, flash, RAM, RAM_SIZE));
    core.reset(&mut NoPeripherals);
    (core, symbol.address() as u32 & !1)
}

#[test]
fn copies_of_any_length_and_alignment_are_exact() {
    /// Instructions of a copy, and of each of its words.
    const FIXED: u64 = 30;
    const A_WORD: u64 = 3;
    let (mut core, memcpy) = core_with("__aeabi_memcpy");
    // The start of the vector table: nothing runs there.
    core.set_breakpoint(FLASH);
    for len in 0..=70 {
        for (to, from) in (0..4).flat_map(|to| (0..4).map(move |from| (TARGET + to, SOURCE + from))) {
            core.memory_mut().fill_ram(|| 0xEE);
            for nth in 0..len {
                core.memory_mut().write(from + nth, Width::Byte, nth + 1);
            }
            let arguments = [to, from, len]
                .into_iter()
                .chain([0; 10])
                .chain([STACK, FLASH | 1, memcpy]);
            for (number, value) in (0..).zip(arguments) {
                core.set_register(Register::R(number), value);
            }
            let before = core.instructions();
            assert_eq!(core.run(&mut NoPeripherals, core.cycle() + 10_000), Stop::Breakpoint);
            assert_eq!(core.register(Register::R(13)), STACK);
            let written = (to - 8..to + len + 8).map(|at| core.memory().read(at, Width::Byte).unwrap());
            let expected = [0xEE; 8].into_iter().chain(1..=len).chain([0xEE; 8]);
            assert!(written.eq(expected), "{len} bytes from {from:#x} to {to:#x}");
            let taken = core.instructions() - before;
            let limit = FIXED + A_WORD * u64::from(len / 4);
            assert!(
                taken <= limit,
                "{len} bytes from {from:#x} to {to:#x}: {taken} instructions"
            );
        }
    }
}
