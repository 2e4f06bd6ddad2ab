//! `cargo xtask stack`: the most stack that the entry points of the protocol and bridge crates take.
//!
//! The frame of each function is what the compiler says (`-Z emit-stack-sizes`); those of the compiler's own functions,
//! which come compiled, are read from their code. Who calls whom is read from the code. A function that calls itself, or
//! what a pointer points at, has no figure.

mod call_graph;
mod thumb;

use std::collections::BTreeMap;
use std::fs;

use crate::Result;
use crate::image::TARGET;
use crate::process::run as run_command;
use crate::toolchain::Toolchain;
use crate::workspace;
use call_graph::{CallGraph, Depth};

/// What may take no more than [`LIMIT`].
const LIMITED: [&str; 2] = ["Decoder<", "Client<"];

/// The most stack that these may take, in bytes.
const LIMIT: u32 = 256;

/// Cortex-M0, and Cortex-M4.
const TARGETS: [&str; 2] = ["thumbv6m-none-eabi", TARGET];

/// Prints the table, and checks that decoder and client stay within [`LIMIT`].
///
/// # Errors
///
/// All that takes more, or of which it cannot be told.
pub(crate) fn run() -> Result {
    let toolchain = Toolchain::find(&TARGETS)?;
    let mut table = BTreeMap::<String, [String; TARGETS.len()]>::new();
    let mut refused = Vec::new();
    for (column, target) in TARGETS.into_iter().enumerate() {
        let graph = CallGraph::parse(&link(toolchain, target)?)?;
        for (name, depth) in graph.entry_points() {
            let limited = LIMITED.iter().any(|limited| name.starts_with(limited));
            let shown = match &depth {
                Ok(depth) => depth.bytes.to_string(),
                Err(_) => "?".to_owned(),
            };
            table.entry(name.to_owned()).or_default()[column] = shown;
            match depth {
                Ok(depth) if depth.bytes > LIMIT && limited => refused.push(format!("{target}: {}", path(&depth))),
                Ok(_) => {}
                Err(error) if limited => refused.push(format!("{target}: {name}: {error}")),
                Err(error) => println!("{target}: {name}: not known: {error}"),
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
    match refused.is_empty() {
        true => Ok(()),
        false => Err(format!("more than {LIMIT} bytes of stack:\n{}", refused.join("\n")).into()),
    }
}

/// Links the entry points, and returns the program.
fn link(toolchain: Toolchain, target: &str) -> Result<Vec<u8>> {
    let mut cargo = toolchain.cargo("rustc", target)?;
    cargo
        .args(["--release", "--bin", "stack", "--"])
        // Nothing calls the entry points.
        .args(["-Z", "emit-stack-sizes", "-C", "link-arg=--no-gc-sections"])
        .current_dir(workspace::root().join("host-tests/no-panic"))
        .env("RUSTC_BOOTSTRAP", "1");
    run_command(&mut cargo)?;
    let program = toolchain.target_dir()?.join(target).join("release/stack");
    Ok(fs::read(program)?)
}

/// Who takes how much.
fn path(depth: &Depth) -> String {
    let parts = depth.path.iter().map(|(name, bytes)| format!("{name} {bytes}"));
    format!("{}: {}", depth.bytes, parts.collect::<Vec<_>>().join(" + "))
}
