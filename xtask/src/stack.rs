//! `cargo xtask stack`: the most stack that the entry points of the protocol and bridge crates take.
//!
//! The frame of each function is what the compiler says (`-Z emit-stack-sizes`); those of the compiler's own functions,
//! which come compiled, are read from their code. Who calls whom is read from the code. A function that calls itself, or
//! what a pointer points at, has no figure.

mod call_graph;
mod thumb;

use std::collections::{BTreeMap, BTreeSet};
use std::fs;

use crate::Result;
use crate::image::TARGET;
use crate::process::run as run_command;
use crate::toolchain::Toolchain;
use crate::workspace;
use call_graph::{CallGraph, Depth};

/// What has a limit.
const LIMITED: [&str; 2] = ["Decoder<", "Client<"];

/// The most stack that these may take, in bytes.
const LIMIT: u32 = 256;

/// What takes more, and may not take more than it does now. A message is a value, of up to 272 bytes, and is in the
/// hands of several functions on its way.
const MORE: [(&str, u32); 5] = [
    ("Client<Alpha1>::handle", 624),
    ("Client<Alpha1>::poll_transmit", 340),
    ("Client<Legacy>::handle", 288),
    ("Client<Ling>::handle", 416),
    ("Client<XArm>::handle", 968),
];

/// The programs of entry points in `host-tests/no-panic`. One by one, as what is inlined depends on what else is there.
const PROGRAMS: [&str; 2] = ["protocol-stack", "bridge-stack"];

/// Cortex-M0, and Cortex-M4.
const TARGETS: [&str; 2] = ["thumbv6m-none-eabi", TARGET];

/// Prints the table, and checks that decoder and client stay within their limits.
///
/// # Errors
///
/// All that takes more, or of which it cannot be told.
pub(crate) fn run() -> Result {
    let toolchain = Toolchain::find(&TARGETS)?;
    let mut table = BTreeMap::<String, [String; TARGETS.len()]>::new();
    let (mut unknown, mut refused) = (BTreeSet::new(), Vec::new());
    for (column, target) in TARGETS.into_iter().enumerate() {
        for program in PROGRAMS {
            let graph = CallGraph::parse(&link(toolchain, target, program)?)?;
            for (name, depth) in graph.entry_points() {
                let limit = limit(name);
                let shown = match &depth {
                    Ok(depth) => depth.bytes.to_string(),
                    Err(_) => "?".to_owned(),
                };
                table.entry(name.to_owned()).or_default()[column] = shown;
                match depth {
                    Ok(depth) if limit.is_none_or(|limit| depth.bytes <= limit) => {}
                    Ok(depth) => refused.push(format!("{target}: {}", path(&depth))),
                    Err(error) if limit.is_none() => drop(unknown.insert(error.to_string())),
                    Err(error) => refused.push(format!("{target}: {name}: {error}")),
                }
            }
        }
    }
    if !LIMITED
        .iter()
        .all(|limited| table.keys().any(|name| name.starts_with(limited)))
    {
        return Err(format!("no entry point begins with one of {LIMITED:?}").into());
    }
    println!(
        "{:40} {:>20} {:>24}",
        "stack at worst, in bytes", TARGETS[0], TARGETS[1]
    );
    for (name, [first, second]) in table {
        println!("{name:40} {first:>20} {second:>24}");
    }
    for why in unknown {
        println!("? for {why}");
    }
    match refused.is_empty() {
        true => Ok(()),
        false => Err(format!("more stack than is allowed:\n{}", refused.join("\n")).into()),
    }
}

/// The most stack that an entry point may take, in bytes, if there is a limit.
fn limit(name: &str) -> Option<u32> {
    let more = MORE.iter().find(|(more, _)| *more == name).map(|(_, limit)| *limit);
    let limited = LIMITED.iter().any(|limited| name.starts_with(limited));
    more.or(limited.then_some(LIMIT))
}

/// Links a program of entry points, and returns it.
fn link(toolchain: Toolchain, target: &str, program: &str) -> Result<Vec<u8>> {
    let mut cargo = toolchain.cargo("rustc", target)?;
    cargo
        .args(["--release", "--bin", program, "--"])
        // Nothing calls the entry points.
        .args(["-Z", "emit-stack-sizes", "-C", "link-arg=--no-gc-sections"])
        .current_dir(workspace::root().join("host-tests/no-panic"))
        .env("RUSTC_BOOTSTRAP", "1");
    run_command(&mut cargo)?;
    let file = toolchain.target_dir()?.join(target).join("release").join(program);
    Ok(fs::read(file)?)
}

/// Who takes how much.
fn path(depth: &Depth) -> String {
    let parts = depth.path.iter().map(|(name, bytes)| format!("{name} {bytes}"));
    format!("{}: {}", depth.bytes, parts.collect::<Vec<_>>().join(" + "))
}
