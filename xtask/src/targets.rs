//! `cargo xtask targets`: clippy, and therefore the type check, for other targets than this host. Nothing is linked or run:
//! `cargo xtask platforms` links and runs for Windows, `no-panic` and `fw` link for microcontrollers.

use anyhow::Result;

use crate::board::{Board, TARGET};
use crate::image::Options;
use crate::process;
use crate::toolchain::cargo_for;
use crate::workspace::firmware;

/// Targets of the crates without `std`.
const NO_STD_TARGETS: [&str; 3] = ["thumbv6m-none-eabi", TARGET, "riscv32imc-unknown-none-elf"];
const NO_STD: &str = "--package armwire --package armwire-feetech --package armwire-bridge";
/// The supported systems other than Linux, and the crates for them, which need no C compiler.
const OTHER_SYSTEMS: [&str; 2] = ["x86_64-pc-windows-gnu", "x86_64-apple-darwin"];
const PORTABLE: &str = "--package armwire --package armwire-feetech --package armwire-bridge --package armwire-sim \
                        --package armwire-host --package armwire-cli";
const LINK_TEST: &str =
    "--manifest-path=host-tests/benches/Cargo.toml --bin no-panic --features link-test,ling-legacy,bridge";
/// The program whose instructions are counted.
const COUNTED: &str = "--manifest-path=host-tests/benches/Cargo.toml --bin thumb --features thumb";

/// Clippy for microcontrollers, and for Windows and macOS with the tests.
///
/// # Errors
///
/// The first target that fails, or a missing compiler that cannot be installed.
pub(crate) fn check() -> Result<()> {
    microcontrollers()?;
    OTHER_SYSTEMS
        .into_iter()
        .try_for_each(|target| lint(&format!("{PORTABLE} --all-targets"), target))
}

/// Clippy for microcontrollers: the crates without `std`, without features and with all, the firmware, and the programs for
/// its core.
fn microcontrollers() -> Result<()> {
    for target in NO_STD_TARGETS {
        lint(NO_STD, target)?;
        lint(&format!("{NO_STD} --all-features"), target)?;
    }
    for board in Board::CHIPS {
        let words = format!("clippy {}", Options::all(board).features());
        let mut clippy = cargo_for(board.target(), &words)?;
        process::run(clippy.args(["--", "-D", "warnings"]).current_dir(firmware()))?;
    }
    lint(LINK_TEST, TARGET)?;
    lint(COUNTED, TARGET)
}

/// Clippy with these arguments for this target.
fn lint(select: &str, target: &str) -> Result<()> {
    let mut clippy = cargo_for(target, &format!("clippy {select}"))?;
    process::run(clippy.args(["--", "-D", "warnings"]))
}
