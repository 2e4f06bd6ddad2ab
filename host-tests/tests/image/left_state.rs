//! A chip that is not in its reset state: a ROM, a boot loader, a debugger or another firmware leaves clocks, interrupts and
//! peripherals as they used them, and starts the image by a jump.

use armwire_host_tests::image::{MEGABAUD, RawArm, board_config, chip, counters, exchange, on_board_with, plug_in};
use armwire_virtual_board::{Chip, Nanos, VirtualBoard};

/// The registers that enable interrupts of the core (ARMv7-M B3.4).
const NVIC_ISER: u64 = 0xE000_E100;

/// A state that another program leaves: the reset state, but for these registers.
#[derive(Clone, Copy, Debug)]
struct Left {
    name: &'static str,
    /// Registers and their values, in the order of the writes, with 5 ms after each: an oscillator starts.
    writes: &'static [(u64, u32)],
}

/// RM0090 7.3, 3.9 and 10.5.
const F405: [Left; 5] = [
    Left {
        name: "the crystal drives the PLL, 60 MHz",
        writes: &[
            (0x4002_3800, 0x0001_0083),
            (0x4002_3C00, 0x0000_0701),
            (0x4002_3804, 0x0541_3C08),
            (0x4002_3800, 0x0101_0083),
            (0x4002_3808, 0x0000_1002),
        ],
    },
    Left {
        name: "HSI drives the PLL, 60 MHz",
        writes: &[
            (0x4002_3C00, 0x0000_0701),
            (0x4002_3804, 0x0501_3C10),
            (0x4002_3800, 0x0100_0083),
            (0x4002_3808, 0x0000_1002),
        ],
    },
    Left {
        name: "USB runs, and its interrupt is enabled",
        writes: &[(0x4002_3834, 1 << 7), (0x5000_0008, 1), (NVIC_ISER + 8, 1 << 3)],
    },
    Left {
        name: "a DMA stream of the arm's UART runs",
        writes: &[(0x4002_3830, 0x0010_0000 | 1 << 21), (0x4002_6088, 0x0800_0441)],
    },
    Left {
        name: "the flash is unlocked, and its caches are on",
        writes: &[
            (0x4002_3C04, 0x4567_0123),
            (0x4002_3C04, 0xCDEF_89AB),
            (0x4002_3C00, 0x0000_0600),
        ],
    },
];

/// RM0440 7.4 and 5.7.
const G431: [Left; 3] = [
    Left {
        name: "HSI16 drives the PLL, 72 MHz",
        writes: &[
            (0x4002_2000, 0x0000_0702),
            (0x4002_100C, 0x0100_2432),
            (0x4002_1000, 0x0100_0500),
            (0x4002_1008, 0x0000_0003),
        ],
    },
    Left {
        name: "USB runs, its pull-up is on, and its interrupt is enabled",
        writes: &[
            (0x4002_1058, 1 << 23 | 1 << 10),
            (0x4000_5C40, 0x0400),
            (0x4000_5C58, 0x8000),
            (NVIC_ISER, 1 << 20),
        ],
    },
    Left {
        name: "the flash is unlocked",
        writes: &[(0x4002_2008, 0x4567_0123), (0x4002_2008, 0xCDEF_89AB)],
    },
];

/// ARMv6-M B3.3 and B3.4, RP2040 datasheet 4.1.4, 4.2.8 and 4.6.5. The emulator's resets of peripherals have no effect.
const RP2040: [Left; 4] = [
    Left {
        name: "each interrupt is enabled",
        writes: &[(NVIC_ISER, 0x03FF_FFFF)],
    },
    Left {
        name: "each interrupt is pending",
        writes: &[(NVIC_ISER + 0x100, 0x03FF_FFFF)],
    },
    Left {
        name: "SysTick runs, with its interrupt",
        writes: &[(0xE000_E014, 1_000), (0xE000_E010, 0b111)],
    },
    Left {
        name: "USB and the arm's UART run, with their interrupts",
        writes: &[
            (0x5011_0040, 1),
            (0x5011_0090, 0x000F_FFFF),
            (0x4003_8030, 0x0301),
            (0x4003_8038, 0x07FF),
            (NVIC_ISER, 1 << 5 | 1 << 21),
        ],
    },
];

#[test]
fn image_starts_in_any_state_that_another_program_leaves() {
    let left: &[Left] = match chip() {
        Chip::Stm32f405 => &F405,
        Chip::Stm32g431 => &G431,
        Chip::Rp2040 => &RP2040,
    };
    for left in left {
        let config = board_config(RawArm::default());
        on_board_with(config, |board: &mut VirtualBoard<RawArm>| {
            println!("{}", left.name);
            board.hold_core();
            for &(register, value) in left.writes {
                board.write_word(register, value).unwrap();
                board.run_for(Nanos::from_millis(5)).unwrap();
            }
            board.let_core_go();
            plug_in(board, MEGABAUD);
            exchange(board, &[1, 2, 3, 4], &[5, 6, 7, 8]);
            let counters = counters(board);
            assert_eq!(
                (counters.watchdog_resets, counters.panics, counters.hard_faults),
                (0, 0, 0)
            );
        });
    }
}
