//! The commands in the `console` blocks of the pages, run in a folder of each page, against virtual arms and adapters.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;
use std::thread;

use crate::block::{Block, Example, blocks};
use crate::common::dfu::{image, tools, update};
use crate::common::uf2::{self, Folders};
use crate::common::{adapter::CanBus, free_path};
use crate::world::World;

/// Programs whose commands run elsewhere.
const ELSEWHERE: &[&str] = &[
    // Parsed by a test of `xtask`, and run by `cargo ci`: cargo itself, and what its steps install.
    "cargo",
    "cc",
    "cmake",
    // The program that `cc` made.
    "serial",
    "arm-none-eabi-gcc",
    "qemu-system-arm",
    "rustup",
    "python",
    "python3",
    "python3.12",
    "pip",
    "tshark",
    "wireshark",
    "sigrok-cli",
    "mcap",
    "armwire-ros2",
    "ros2",
    "lerobot-teleoperate",
    "lerobot-record",
    "twine",
    // The shell's, and those that change the computer.
    "cd",
    "export",
    "mkdir",
    "cp",
    "git",
    "sudo",
    "sha256sum",
    // A bus, a probe, or a chip is needed.
    "candump",
    "isotprecv",
    "echo",
    "probe-rs",
    "dfu-util",
    "picotool",
    "STM32_Programmer_CLI",
];

/// A log of candump.
const CANDUMP: &[u8] = include_bytes!("../logs/python-can.log");
/// A request and an answer of a Ling arm.
const LINE: &[u8] = b"\xAA\x06\x00\x01\xFE\x9A\xFF\xAA\x04\x0E\x01\x01\x96\xFF";
/// The same by `xxd`.
const DUMP: &[u8] = b"00000000: aa06 0001 fe9a ffaa 040e 0101 96ff       ..............\n";

#[test]
fn documented_commands_run() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut pages = vec![
        root.join("README.md"),
        root.join("cli/README.md"),
        root.join("examples/README.md"),
    ];
    add_pages(&root.join("docs"), &mut pages);
    let results: Vec<_> = thread::scope(|scope| {
        let runs: Vec<_> = pages.iter().map(|page| scope.spawn(|| run_page(page))).collect();
        runs.into_iter().map(|run| run.join()).collect()
    });
    let mut commands = 0;
    let mut failed = Vec::new();
    for (page, result) in pages.iter().zip(results) {
        match result {
            Ok(run) => commands += run,
            // Its own output has the reason.
            Err(_) => failed.push(page),
        }
    }
    assert!(failed.is_empty(), "{failed:?}");
    assert!(commands >= 50, "{commands} commands: others are missing");
}

fn add_pages(folder: &Path, pages: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        match path.extension() {
            _ if path.is_dir() => add_pages(&path, pages),
            Some(extension) if extension == "md" => pages.push(path),
            _ => {}
        }
    }
}

/// Runs the commands of a page. Returns their number.
fn run_page(page: &Path) -> usize {
    let folder = free_path("page");
    fs::create_dir(&folder).unwrap();
    let mut world = World::new(folder.clone());
    let mut commands = 0;
    for Block { line, marker, examples } in blocks(&fs::read_to_string(page).unwrap()) {
        let place = format!("{}:{line}", page.display());
        let ours = examples.iter().filter(|example| example.program == "armwire").count();
        assert!(marker.is_none() || ours > 0, "{place}: a needless marker");
        for example in examples {
            let Example { program, args, .. } = &example;
            let words: Vec<_> = args.iter().map(String::as_str).collect();
            match (program.as_str(), words.as_slice()) {
                ("cargo", ["demo", "--", "--serve", ..]) => world.serve_demo(&words),
                ("armwire", _) if marker.is_some() => {}
                ("armwire", ["sim", ..]) => check_output(&place, &example, &world.serve_sim(&words)),
                ("armwire", ["update", _, image]) => check_update(&place, image),
                ("armwire", _) => {
                    provide(&folder, &words);
                    let output = world.run(&words);
                    assert!(output.status.success(), "{place}: {words:?}: {output:?}");
                    let out = String::from_utf8_lossy(&output.stdout);
                    check_output(&place, &example, &out);
                    if let Some(file) = &example.redirection {
                        fs::write(folder.join(file), &*out).unwrap();
                    }
                }
                _ => assert!(ELSEWHERE.contains(&program.as_str()), "{place}: {program} is unknown"),
            }
        }
        commands += if marker.is_none() { ours } else { 0 };
    }
    drop(world);
    fs::remove_dir_all(folder).unwrap();
    commands
}

/// Compares the output that the page shows. `…` stands for any text.
fn check_output(place: &str, example: &Example, actual: &str) {
    assert!(!actual.is_empty(), "{place}: {:?} prints nothing", example.args);
    let mut lines = actual.lines();
    for shown in &example.output {
        let line = lines.next().unwrap_or_default();
        assert!(is_like(line, shown), "{place}: shown\n{shown}\nactual\n{line}");
    }
}

/// Returns true if a line has the parts of a shown line in their order, and nothing beyond its end.
fn is_like(line: &str, shown: &str) -> bool {
    match shown.split_once('…') {
        None => line == shown,
        Some((start, rest)) => line.strip_prefix(start).is_some_and(|line| {
            let mut ends = line.char_indices().map(|(at, _)| at).chain([line.len()]);
            ends.any(|at| is_like(&line[at..], rest))
        }),
    }
}

/// Writes a recording that a command reads, and that no earlier command has written.
fn provide(folder: &Path, args: &[&str]) {
    if let ["decode", file, ..] = args
        && !folder.join(file).exists()
    {
        let recording = match file.rsplit('.').next() {
            Some("log") => CANDUMP,
            Some("txt") => DUMP,
            _ => LINE,
        };
        fs::write(folder.join(file), recording).unwrap();
    }
}

/// Updates an adapter whose boot loader writes nothing.
fn check_update(place: &str, file: &str) {
    if file.ends_with(".uf2") {
        let folders = Folders::new();
        let bus = CanBus::start_pico(&folders.drive);
        let output = folders.update(&bus.port(), &uf2::image("pico", uf2::RP2040));
        assert!(output.status.success(), "{place}: {output:?}");
        return;
    }
    let bus = CanBus::start();
    let folder = tools("update-example", &bus.boot_loader, 0);
    let file = Path::new(file);
    fs::create_dir_all(folder.join(file).parent().unwrap()).unwrap();
    fs::write(folder.join(file), image("virtual")).unwrap();
    let output: Output = update(&bus.port(), file, &folder);
    assert!(output.status.success(), "{place}: {output:?}");
    fs::remove_dir_all(folder).unwrap();
}
