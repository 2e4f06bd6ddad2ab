//! `cargo xtask counts`: how many instructions decoding, encoding and calling take.
//!
//! On the virtual board's Cortex-M4, and on this machine by valgrind's callgrind if there is one: see `host-tests/counts`.
//! Compiled for speed, as the firmware has what is between the arm and its host.

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::json;

use crate::Result;
use crate::baseline::{Baseline, Figures};
use crate::image::{self, TARGET};
use crate::process::{cargo, output, run as run_command};
use crate::size;
use crate::toolchain::Toolchain;
use crate::workspace;

/// Where the figures are kept.
const FILE: &str = "host-tests/counts/counts.txt";

/// What a processor is called whose code is run.
const HOST: &str = "host";
const CORTEX_M0: &str = "thumbv6m-none-eabi";

/// What the adapter's image is called.
const ADAPTER: &str = "adapter";

/// Ways through the adapter: their names in `adapter_counts`, and what they are.
const PASSAGES: [(&str, &str); 2] = [
    ("request_from_usb", "Adapter: packet from USB to first byte on the line"),
    ("answer_to_usb", "Adapter: last byte of a reply to packet for USB"),
];

/// Ling's checksum: what it is called here, and the feature of `armwire`.
const CHECKSUMS: [(&str, &str); 3] = [
    ("64-byte table", "ling"),
    ("crc-table", "crc-table"),
    ("crc-table16", "crc-table16"),
];

/// A case of `host-tests/counts`.
struct Case {
    /// Its name, without `count_`.
    name: &'static str,
    title: &'static str,
    /// Of how many frames or bytes it is.
    of: u64,
    /// The most it should take of each, with the checksum that is used without a feature, on Cortex-M4.
    goal: Option<u64>,
}

const fn case(name: &'static str, title: &'static str, of: u64, goal: Option<u64>) -> Case {
    Case { name, title, of, goal }
}

const CASES: [Case; 26] = [
    case("ling_checksum", "Ling: checksum of a reply of 21 bytes", 1, None),
    case("ling_decode", "Ling: reply decoded", 1, Some(350)),
    case(
        "ling_decode_chunks",
        "Ling: reply decoded, chunks of 64 bytes",
        64,
        Some(350),
    ),
    case("ling_decode_bytes", "Ling: reply decoded, byte by byte", 64, None),
    case("ling_encode", "Ling: move of 34 bytes encoded", 1, None),
    case("ling_call", "Ling: whole call", 1, Some(650)),
    case("ling_nested", "Ling, hostile: nested headers, a byte", 1400, Some(150)),
    case("ling_headers", "Ling, hostile: all headers, a byte", 1400, Some(150)),
    case("ling_lengths", "Ling, hostile: false lengths, a byte", 1400, Some(150)),
    case("ling_worst", "Ling, hostile: the worst stream, a byte", 1400, Some(150)),
    case("ling_worst_bytes", "Ling, hostile: the same, byte by byte", 1400, None),
    case("ling_worst_byte", "Ling, hostile: one byte that settles 70", 1, None),
    case("xarm_decode", "xArm: reply of 12 bytes decoded", 1, None),
    case(
        "xarm_decode_chunks",
        "xArm: reply decoded, chunks of 64 bytes",
        64,
        None,
    ),
    case("xarm_decode_bytes", "xArm: reply decoded, byte by byte", 64, None),
    case("xarm_encode", "xArm: request encoded", 1, None),
    case("xarm_call", "xArm: whole call", 1, None),
    case("alpha1_checksum", "Alpha1: checksum of a reply of 10 bytes", 1, None),
    case("alpha1_decode", "Alpha1: reply decoded", 1, None),
    case(
        "alpha1_decode_chunks",
        "Alpha1: reply decoded, chunks of 64 bytes",
        64,
        None,
    ),
    case("alpha1_decode_bytes", "Alpha1: reply decoded, byte by byte", 64, None),
    case("alpha1_encode", "Alpha1: request of 10 bytes encoded", 1, None),
    case("alpha1_call", "Alpha1: whole call", 1, None),
    case(
        "alpha1_nested",
        "Alpha1, hostile: nested headers, a byte",
        1400,
        Some(150),
    ),
    case(
        "alpha1_headers",
        "Alpha1, hostile: all headers, a byte",
        1400,
        Some(150),
    ),
    case(
        "alpha1_lengths",
        "Alpha1, hostile: false lengths, a byte",
        1400,
        Some(150),
    ),
];

/// Prints the counts beside their goals, and checks that none has grown; with `--write`, keeps them.
///
/// # Errors
///
/// If one grew by more than 3 %, or a case does not come to its end.
pub(crate) fn run(args: &[OsString]) -> Result {
    let write = match args {
        [] => false,
        [option] if option == "--write" => true,
        _ => return Err("usage: cargo xtask counts [--write]".into()),
    };
    let toolchain = Toolchain::find(&[TARGET, CORTEX_M0])?;
    let mut figures = Figures::new();
    for target in [TARGET, CORTEX_M0] {
        for (checksum, feature) in CHECKSUMS {
            for line in emulate(&build(toolchain.cargo("build", target)?, "image", feature, target)?)?.lines() {
                let (case, count) = line.rsplit_once(' ').ok_or("the program printed what is no count")?;
                let case = case.trim_start_matches("count_");
                figures.insert(name(target, checksum, case), count.parse()?);
            }
        }
    }
    for line in adapter()?.lines() {
        let (passage, count) = line
            .rsplit_once(' ')
            .ok_or("the virtual board printed what is no count")?;
        figures.insert(format!("{ADAPTER}: {passage}"), count.parse()?);
    }
    match output(Command::new("valgrind").arg("--version")) {
        Ok(_) => {
            for (checksum, feature) in CHECKSUMS {
                let program = build(host_cargo(), "host", feature, "")?;
                let nothing = callgrind(&program, "nothing")?;
                for case in &CASES {
                    let count = callgrind(&program, case.name)?.saturating_sub(nothing);
                    figures.insert(name(HOST, checksum, case.name), count);
                }
            }
        }
        Err(_) => println!("NOT COUNTED on this machine: there is no valgrind"),
    }
    let mut flash = Vec::new();
    for (_, feature) in CHECKSUMS {
        flash.push(size::protocol(toolchain, TARGET, &format!("client,{feature}"))?.flash);
    }
    print(&figures, &flash);
    save(&figures)?;
    Baseline::of(figures, toolchain)?.check(FILE, "cargo xtask counts", write)
}

/// What a count is called where it is kept.
fn name(target: &str, checksum: &str, case: &str) -> String {
    format!("{target}, {checksum}: {case}")
}

/// Builds a program of `host-tests/counts` with this checksum, and returns where it is.
fn build(mut cargo: Command, program: &str, checksum: &str, target: &str) -> Result<PathBuf> {
    let image = if program == "image" { ",image" } else { "" };
    cargo
        .args(["--quiet", "--release", "--bin", program])
        .arg(format!("--features={checksum}{image}"))
        .current_dir(folder());
    run_command(&mut cargo)?;
    let built = cargo.get_envs().find(|(name, _)| *name == "CARGO_TARGET_DIR");
    let folder = built.and_then(|(_, folder)| folder).map(PathBuf::from);
    let folder = folder.map_or_else(workspace::target_dir, Ok)?;
    Ok(folder.join(target).join("release").join(program))
}

/// Cargo for this machine, in the target directory of all.
fn host_cargo() -> Command {
    let mut cargo = cargo();
    cargo.arg("build");
    if let Ok(folder) = workspace::target_dir() {
        cargo.env("CARGO_TARGET_DIR", folder);
    }
    cargo
}

/// Runs an image on the virtual board's core. A line for each case comes out.
fn emulate(image: &Path) -> Result<String> {
    output(on_the_core("counts").arg("--").arg(image))
}

/// Runs the adapter's firmware image on the virtual board. A line for each of [`PASSAGES`] comes out.
fn adapter() -> Result<String> {
    let image = image::for_virtual_board()?;
    output(on_the_core("adapter_counts").env("ARMWIRE_IMAGE", image))
}

/// Runs a program of `host-tests` that has the virtual board in it.
fn on_the_core(program: &str) -> Command {
    let mut cargo = cargo();
    cargo
        .args(["run", "--quiet"])
        .args(["--package", "armwire-host-tests", "--features", "image"])
        .args(["--bin", program])
        .current_dir(workspace::root());
    cargo
}

/// The instructions of one case on this machine.
fn callgrind(program: &Path, case: &str) -> Result<u64> {
    let log = workspace::target_dir()?.join("callgrind.log");
    run_command(
        Command::new("valgrind")
            .args(["--tool=callgrind", "--callgrind-out-file=/dev/null"])
            .arg(format!("--log-file={}", log.display()))
            .arg(format!("--toggle-collect=count_{case}"))
            .arg(program),
    )?;
    let said = fs::read_to_string(log)?;
    let count = said.lines().find_map(|line| line.split_once("Collected : "));
    let (_, count) = count.ok_or("callgrind names no count")?;
    Ok(count.trim().parse()?)
}

/// The counts, and what of flash the checksums take with all that Ling has.
fn print(figures: &Figures, flash: &[u64]) {
    println!("{:76}{:>36}{:>36}", "", "Cortex-M4", "Cortex-M0 code");
    print!("{:44}{:>6}", "instructions", "goal");
    for _ in [TARGET, CORTEX_M0, HOST] {
        for (checksum, _) in CHECKSUMS {
            print!("{:>14}", checksum.trim_end_matches(" table"));
        }
    }
    println!();
    for case in &CASES {
        let goal = case.goal.map_or(String::new(), |goal| format!("≤ {goal}"));
        print!("{:44}{goal:>6}", case.title);
        for target in [TARGET, CORTEX_M0, HOST] {
            for (checksum, _) in CHECKSUMS {
                match figures.get(&name(target, checksum, case.name)) {
                    Some(count) => print!("{:>14.0}", each(*count, case)),
                    None => print!("{:>14}", "-"),
                }
            }
        }
        println!("{}", if missed(figures, case) { "  goal missed" } else { "" });
    }
    for (passage, title) in PASSAGES {
        if let Some(count) = figures.get(&format!("{ADAPTER}: {passage}")) {
            println!("{title:50}{count:>14}");
        }
    }
    print!("{:50}", "flash of Ling's client and decoder, bytes");
    for flash in flash {
        print!("{flash:>14}");
    }
    println!();
}

/// What a case takes of each frame or byte.
fn each(count: u64, case: &Case) -> f64 {
    count as f64 / case.of as f64
}

/// Whether a goal is not reached.
fn missed(figures: &Figures, case: &Case) -> bool {
    let count = figures.get(&name(TARGET, CHECKSUMS[0].0, case.name));
    match (case.goal, count) {
        (Some(goal), Some(count)) => *count > goal * case.of,
        _ => false,
    }
}

/// Writes `counts.json` into the target directory.
fn save(figures: &Figures) -> Result {
    let mut all = Vec::new();
    for target in [TARGET, CORTEX_M0, HOST] {
        for (checksum, _) in CHECKSUMS {
            for case in &CASES {
                if let Some(count) = figures.get(&name(target, checksum, case.name)) {
                    all.push(json!({
                        "target": target, "checksum": checksum, "case": case.name, "title": case.title,
                        "instructions": each(*count, case),
                        "goal": case.goal.filter(|_| target == TARGET && checksum == CHECKSUMS[0].0),
                    }));
                }
            }
        }
    }
    for (passage, title) in PASSAGES {
        if let Some(count) = figures.get(&format!("{ADAPTER}: {passage}")) {
            all.push(json!({
                "target": TARGET, "checksum": "crc-table", "case": passage, "title": title, "instructions": count,
            }));
        }
    }
    let file = workspace::target_dir()?.join("counts.json");
    fs::write(&file, serde_json::to_string_pretty(&all)?)?;
    println!("as JSON: {}", file.display());
    Ok(())
}

fn folder() -> PathBuf {
    workspace::root().join("host-tests/counts")
}
