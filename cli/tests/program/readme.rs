//! The commands of the README, as printed but for the places of the virtual arms.

use std::io::{BufRead, BufReader};
use std::process::{Child, ChildStdout, Command};

use crate::common::{PROGRAM, free_path, start, success};

const README: &str = include_str!("../../../README.md");

/// A running `armwire sim`: where the README has it, and where it is.
struct Sim {
    child: Child,
    /// Its last words need a reader.
    _out: BufReader<ChildStdout>,
    printed: String,
    place: String,
}

impl Sim {
    fn start(args: &[&str]) -> Self {
        let (printed, place) = match args {
            ["sim", "xarm", "--listen", printed] => (*printed, "127.0.0.1:0".to_owned()),
            ["sim", _, "--pty", printed] => (*printed, free_path("readme").to_str().unwrap().to_owned()),
            other => panic!("no place in {other:?}"),
        };
        let mut command = Command::new(PROGRAM);
        command.args(args.iter().map(|&arg| if arg == printed { &place } else { arg }));
        if args[1] == "xarm" {
            command.args(["--report-listen", &place]);
        }
        let mut child = start(&mut command);
        let mut out = BufReader::new(child.stdout.take().unwrap());
        let mut line = String::new();
        out.read_line(&mut line).unwrap();
        let mut words = line.split([' ', ',', ';']);
        let place = words.find(|word| word.starts_with("127.0.0.1:") || **word == place);
        Self {
            child,
            _out: out,
            printed: printed.to_owned(),
            place: place.unwrap_or_else(|| panic!("{args:?} says {line}")).to_owned(),
        }
    }
}

impl Drop for Sim {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        let _ = std::fs::remove_file(&self.place);
    }
}

#[test]
fn every_command_of_the_readme_works_on_the_virtual_arm_above_it() {
    let mut sim: Option<Sim> = None;
    let (mut sims, mut calls) = (0, 0);
    for line in README.lines().filter_map(|line| line.strip_prefix("$ armwire ")) {
        let command = line.split('#').next().unwrap_or_default();
        let args = command.split_whitespace().collect::<Vec<_>>();
        if args[0] == "sim" {
            sim = Some(Sim::start(&args));
            sims += 1;
            continue;
        }
        let Some(sim) = sim.as_ref().filter(|sim| args.contains(&&*sim.printed)) else {
            assert!(command.contains("/dev/tty"), "{command}: there is no arm above it");
            continue;
        };
        let args = args
            .iter()
            .map(|&arg| if arg == sim.printed { &sim.place } else { arg });
        assert_ne!(success(&args.collect::<Vec<_>>()), "", "{command}");
        calls += 1;
    }
    assert!(
        sims >= 3 && calls >= 6,
        "{sims} virtual arms, {calls} commands: where are the others?"
    );
}
