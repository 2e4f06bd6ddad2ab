//! `cargo xtask pico`: the image of the Raspberry Pi Pico on an emulated chip, rp2040js.

use std::process::Command;

use anyhow::{Result, ensure};
use clap::Args;

use crate::board::Board;
use crate::examples::install_emulator;
use crate::image::{self, Image};
use crate::process::{output, run};
use crate::workspace::root;

/// The tests of the emulator's differences from the chip.
const EMULATOR_TESTS: &str = "virtual-board/rp2040/rp2040js.test.mjs";

/// Reasons why a test does not run.
const NO_CAN: &str = "it needs CAN";
const NO_CRYSTAL: &str = "the emulator has no crystal";
const NO_FAULT: &str = "the emulator has no hard faults but those of the stack, and no read errors of the flash";
const NO_FACTS: &str = "it knows registers, instructions or pins of an STM32";
const NO_NOISE: &str = "the UART reports no noise, and several errors at once as one";

/// The image tests that do not run, by a part of their names, and the reason.
const NOT_RUN: &[(&str, &str)] = &[
    ("alpha1_works_over_usb_can_and_polls", NO_CAN),
    ("bus_off_is_counted_once", NO_CAN),
    ("can::", NO_CAN),
    ("can_requests_without_room", NO_CAN),
    ("hanging_can_host", NO_CAN),
    ("hold_is_out_within_its_bound", NO_CAN),
    ("silent_arm_is_polled_in_same_slots", NO_CAN),
    ("silent_can_host", NO_CAN),
    ("unsolicited_frames_reach_can", NO_CAN),
    ("crystal_of_another_frequency", NO_CRYSTAL),
    ("crystal_is_known", NO_CRYSTAL),
    ("dead_crystal", NO_CRYSTAL),
    ("late_crystal", NO_CRYSTAL),
    ("unsupported_crystal", NO_CRYSTAL),
    ("watchdog_watches_before_the_clocks_run", NO_CRYSTAL),
    ("crash_loop::", NO_FAULT),
    ("hard_fault_is_counted", NO_FAULT),
    ("adapter_of_exact_cycles", NO_FACTS),
    ("boards::telemetry", NO_CAN),
    ("campaign::", NO_FACTS),
    ("copy::", NO_FACTS),
    ("latency::", NO_FACTS),
    ("core_sleeps_without_the_clock", NO_FACTS),
    ("service_that_stops", NO_FACTS),
    ("errors_in_many_bytes", NO_NOISE),
    ("line_errors_and_strays", NO_NOISE),
    ("noise_is_counted", NO_NOISE),
    ("noise_on_the_line", NO_NOISE),
    ("parity_errors_are_counted", NO_NOISE),
    ("canfd::", NO_CAN),
    ("delayed::", NO_CAN),
    ("port_at_9600_then_1m_spares_can_stream", NO_CAN),
];

/// A part of the names of the tests that run on revision B1, too: its faults concern USB.
const USB: &str = "usb";

#[derive(Args)]
pub(crate) struct Options {
    /// Seconds of the chip's time with 200 polls each
    #[arg(long, default_value_t = 2)]
    seconds: u32,
    /// Run each test on revision B1, too, not those of USB alone
    #[arg(long)]
    all_on_b1: bool,
}

impl Options {
    /// An hour of polls.
    pub(crate) const HOUR: Self = Self {
        seconds: 3600,
        all_on_b1: true,
    };
}

/// Builds the image, installs the emulator, and runs the tests.
///
/// # Errors
///
/// If a build fails, a tool is missing and cannot be installed, or a test fails.
pub(crate) fn test(options: &Options) -> Result<()> {
    let image = image::release(Board::PICO)?;
    install_emulator()?;
    run(Command::new("node")
        .args(["--test", EMULATOR_TESTS])
        .current_dir(root()))?;
    check_not_run(&image)?;
    for (name, reason) in NOT_RUN {
        println!("not run: {name} ({reason})");
    }
    run(tests(&image, "B2").env("ARMWIRE_POLL_SECONDS", options.seconds.to_string()))?;
    let mut on_b1 = tests(&image, "B1");
    if !options.all_on_b1 {
        on_b1.arg(USB);
    }
    run(&mut on_b1)
}

/// The image tests that run, on a chip of this revision.
fn tests(image: &Image, revision: &str) -> Command {
    let mut tests = image.tests();
    tests.env("ARMWIRE_RP2040_REVISION", revision).args(["--quiet", "--"]);
    tests.args(NOT_RUN.iter().flat_map(|(name, _)| ["--skip", name]));
    tests
}

/// Checks that each part of a name is that of a test.
fn check_not_run(image: &Image) -> Result<()> {
    let tests = output(image.tests().args(["--quiet", "--", "--list"]))?;
    for name in NOT_RUN.iter().map(|(name, _)| *name).chain([USB]) {
        ensure!(tests.contains(name), "no image test is named {name}");
    }
    Ok(())
}
