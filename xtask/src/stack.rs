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

/// The most stack that these may take, in bytes: half as much again as they do, so that a new compiler breaks nothing.
pub(crate) const LIMIT: u32 = 512;

/// The programs of entry points in `host-tests/no-panic`. One by one, as what is inlined depends on what else is there.
const PROGRAMS: [&str; 2] = ["protocol-stack", "bridge-stack"];

/// Cortex-M0, and Cortex-M4.
pub(crate) const TARGETS: [&str; 2] = ["thumbv6m-none-eabi", TARGET];

/// What is known of the stack of each entry point on each of [`TARGETS`], by its name.
type Depths = BTreeMap<String, [Option<Result<Depth>>; TARGETS.len()]>;

/// Prints the table, and checks that decoder and client stay within their limits.
///
/// # Errors
///
/// All that takes more, or of which it cannot be told.
pub(crate) fn run() -> Result {
    let depths = depths(Toolchain::find(&TARGETS)?)?;
    if !LIMITED
        .iter()
        .all(|limited| depths.keys().any(|name| name.starts_with(limited)))
    {
        return Err(format!("no entry point begins with one of {LIMITED:?}").into());
    }
    println!(
        "{:40} {:>20} {:>24}",
        "stack at worst, in bytes", TARGETS[0], TARGETS[1]
    );
    let (mut unknown, mut refused) = (BTreeSet::new(), Vec::new());
    for (name, depths) in &depths {
        let [first, second] = depths.each_ref().map(shown);
        println!("{name:40} {first:>20} {second:>24}");
        let limited = is_limited(name);
        for (target, depth) in TARGETS.iter().zip(depths) {
            match depth {
                Some(Ok(depth)) if limited && depth.bytes > LIMIT => {
                    refused.push(format!("{target}: {}", path(depth)));
                }
                Some(Ok(_)) | None => {}
                Some(Err(error)) if !limited => drop(unknown.insert(error.to_string())),
                Some(Err(error)) => refused.push(format!("{target}: {name}: {error}")),
            }
        }
    }
    for why in unknown {
        println!("? for {why}");
    }
    match refused.is_empty() {
        true => Ok(()),
        false => Err(format!("more stack than is allowed:\n{}", refused.join("\n")).into()),
    }
}

/// The most stack that decoder and client of each protocol take, in bytes, on each of [`TARGETS`].
///
/// # Errors
///
/// If they do not build, or what an entry point takes cannot be told.
pub(crate) fn worst(toolchain: Toolchain) -> Result<BTreeMap<String, [u32; TARGETS.len()]>> {
    let mut worst = BTreeMap::<String, [u32; TARGETS.len()]>::new();
    for (name, depths) in depths(toolchain)? {
        if !is_limited(&name) {
            continue;
        }
        let of = name.split("::").next().unwrap_or(&name).to_owned();
        for (most, depth) in worst.entry(of).or_default().iter_mut().zip(depths) {
            *most = depth.transpose()?.map_or(*most, |depth| depth.bytes.max(*most));
        }
    }
    Ok(worst)
}

/// Links the programs of entry points, and reads what each takes.
fn depths(toolchain: Toolchain) -> Result<Depths> {
    let mut depths = Depths::new();
    for (column, target) in TARGETS.into_iter().enumerate() {
        for program in PROGRAMS {
            let graph = CallGraph::parse(&link(toolchain, target, program)?)?;
            for (name, depth) in graph.entry_points() {
                depths.entry(name.to_owned()).or_default()[column] = Some(depth);
            }
        }
    }
    Ok(depths)
}

/// A cell of the table.
fn shown(depth: &Option<Result<Depth>>) -> String {
    match depth {
        Some(Ok(depth)) => depth.bytes.to_string(),
        Some(Err(_)) => "?".to_owned(),
        None => String::new(),
    }
}

/// Whether an entry point may take [`LIMIT`] and no more.
fn is_limited(name: &str) -> bool {
    LIMITED.iter().any(|limited| name.starts_with(limited))
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
