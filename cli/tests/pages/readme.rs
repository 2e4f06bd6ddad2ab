//! The commands of the README, with the actual ports and addresses.

use std::any::Any;
use std::io::{BufRead, BufReader};
use std::process::{Child, ChildStdout, Command};

use crate::common::adapter::CanBus;
use crate::common::board::Board;
use crate::common::{PROGRAM, free_path, start, success};

const README: &str = include_str!("../../../README.md");

/// The ports served by a command of the README, until dropped.
struct Served {
    /// The path in the README, and the actual path.
    places: Vec<(String, String)>,
    _running: Vec<Box<dyn Any>>,
}

/// A running `armwire sim`.
struct Sim {
    child: Child,
    /// A reader for the last line of the output.
    _out: BufReader<ChildStdout>,
    place: String,
}

impl Drop for Sim {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        let _ = std::fs::remove_file(&self.place);
    }
}

impl Served {
    /// The port of `armwire sim`.
    fn sim(args: &[&str]) -> Self {
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
        let place = place.unwrap_or_else(|| panic!("{args:?} prints {line}")).to_owned();
        let places = vec![(printed.to_owned(), place.clone())];
        let _out = out;
        let _running: Vec<Box<dyn Any>> = vec![Box::new(Sim { child, _out, place })];
        Self { places, _running }
    }

    /// The ports of `cargo demo`: here an adapter and a bus without a firmware image.
    fn demo(args: &[&str]) -> Self {
        let board = Board::start("readme");
        let bus = CanBus::start_as(1_000_000, 0);
        let mut places = Vec::new();
        for (option, place) in [
            ("--serve", &*board.port),
            ("--control", board.control.strip_prefix("control:").unwrap()),
            ("--slcan", &bus.path),
        ] {
            let at = args.iter().position(|&arg| arg == option);
            places.extend(at.map(|at| (args[at + 1].to_owned(), place.to_owned())));
        }
        let _running: Vec<Box<dyn Any>> = vec![Box::new(board), Box::new(bus)];
        Self { places, _running }
    }

    /// The arguments with the actual ports. `None` if they name no served port.
    fn placed(&self, args: &[&str]) -> Option<Vec<String>> {
        let mut is_served = false;
        let place = |arg: &&str| match self.places.iter().find(|(printed, _)| arg.ends_with(printed)) {
            Some((printed, place)) => {
                is_served = true;
                arg.replace(printed, place)
            }
            None => (*arg).to_owned(),
        };
        let args = args.iter().map(place).collect();
        is_served.then_some(args)
    }
}

#[test]
fn readme_commands_work_on_what_is_served() {
    let mut served: Option<Served> = None;
    let (mut serves, mut calls) = (0, 0);
    for line in README.lines().filter_map(|line| line.strip_prefix("$ ")) {
        let command = line.split('#').next().unwrap_or_default();
        let args = command.split_whitespace().collect::<Vec<_>>();
        match args[..] {
            ["armwire", "sim", ..] => {
                served = Some(Served::sim(&args[1..]));
                serves += 1;
            }
            ["cargo", "demo", "--", "--serve", ..] => {
                served = Some(Served::demo(&args));
                serves += 1;
            }
            ["armwire", ref args @ ..] => match served.as_ref().and_then(|served| served.placed(args)) {
                Some(args) => {
                    let args: Vec<_> = args.iter().map(String::as_str).collect();
                    assert_ne!(success(&args), "", "{command}");
                    calls += 1;
                }
                None => assert!(command.contains("/dev/tty"), "{command}: nothing is served above it"),
            },
            _ => {}
        }
    }
    assert!(
        serves >= 6 && calls >= 9,
        "{serves} of sims and demos, {calls} commands: others are missing"
    );
}
