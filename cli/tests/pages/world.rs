//! The ports and addresses that the commands of a page name, and the virtual arms and adapters behind them.

use std::any::Any;
use std::io::{BufRead, BufReader, Read};
use std::path::PathBuf;
use std::process::{Child, ChildStdout, Command, Output};

use rustix::process::{Pid, Signal, kill_process};

use crate::common::adapter::CanBus;
use crate::common::board::Board;
use crate::common::{PROGRAM, finish, free_path, retry_while_busy, start, success};

/// The default address of an xArm's reports, in the output of `armwire sim`.
const REPORTS: &str = "127.0.0.1:30002";

/// The arms, boards and programs behind the commands of a page. They end when this is dropped.
pub(crate) struct World {
    /// The folder of the commands.
    folder: PathBuf,
    /// Each name in the page with the actual one. The last counts.
    places: Vec<(String, String)>,
    /// The control port of the adapter on [`ADAPTER`].
    control: Option<String>,
    running: Vec<Box<dyn Any>>,
}

/// The ports of an adapter, of an arm, and the address of an xArm.
const ADAPTER: &str = "/dev/ttyACM0";
const ARM: &str = "/dev/ttyUSB0";
const XARM: &str = "192.168.1.200";

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

impl World {
    pub(crate) fn new(folder: PathBuf) -> Self {
        Self {
            folder,
            places: Vec::new(),
            control: None,
            running: Vec::new(),
        }
    }

    /// Runs `armwire sim` on a free port. Returns its output, with the names of the page.
    pub(crate) fn serve_sim(&mut self, args: &[&str]) -> String {
        let value = |option| Some(args[args.iter().position(|&arg| arg == option)? + 1]);
        let (printed, place) = match (value("--listen"), value("--pty")) {
            (Some(printed), None) => (printed, "127.0.0.1:0".to_owned()),
            (None, Some(printed)) => (printed, free_path("page-arm").to_str().unwrap().to_owned()),
            _ => panic!("no place in {args:?}"),
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
        let mut places = words
            .by_ref()
            .filter(|word| word.starts_with("127.0.0.1:") || **word == place);
        let place = places
            .next()
            .unwrap_or_else(|| panic!("{args:?} prints {line}"))
            .to_owned();
        let mut shown = line.replace(&place, printed);
        if let Some(reports) = places.next() {
            shown = shown.replace(reports, REPORTS);
        }
        self.places.push((printed.to_owned(), place.clone()));
        let _out = out;
        self.running.push(Box::new(Sim { child, _out, place }));
        shown
    }

    /// Serves the ports of `cargo demo`: here an adapter and a bus without a firmware image.
    pub(crate) fn serve_demo(&mut self, args: &[&str]) {
        let board = Board::start("page");
        let bus = CanBus::start_as(1_000_000, 0);
        for (option, place) in [
            ("--serve", &*board.port),
            ("--control", board.control.strip_prefix("control:").unwrap()),
            ("--slcan", &bus.path),
        ] {
            if let Some(at) = args.iter().position(|&arg| arg == option) {
                self.places.push((args[at + 1].to_owned(), place.to_owned()));
            }
        }
        self.running.push(Box::new(board));
        self.running.push(Box::new(bus));
    }

    /// Runs a command, and ends one that does not end by itself, after its first line.
    pub(crate) fn run(&mut self, args: &[&str]) -> Output {
        self.provide(args);
        let args = self.placed(args);
        let is_endless = match &*args[0] {
            "monitor" => !args.iter().any(|arg| arg == "--count"),
            command => matches!(command, "reserve" | "teleop"),
        };
        retry_while_busy(|| {
            let mut child = start(Command::new(PROGRAM).args(&args).current_dir(&self.folder));
            if !is_endless {
                return finish(child);
            }
            let mut out = BufReader::new(child.stdout.take().unwrap());
            let mut first = Vec::new();
            out.read_until(b'\n', &mut first).unwrap();
            kill_process(Pid::from_child(&child), Signal::INT).unwrap();
            out.read_to_end(&mut first).unwrap();
            let mut output = finish(child);
            output.stdout = first;
            output
        })
    }

    /// Starts what is at the usual names in the arguments, unless it runs.
    fn provide(&mut self, args: &[&str]) {
        let has = |name: &str| args.contains(&name);
        if has(ADAPTER) && self.control.is_none() {
            let board = Board::start("page");
            // `monitor --from-adapter` shows polls.
            success(&["config", &board.control, "set", "poll=50"]);
            self.places.push((ADAPTER.to_owned(), board.port.clone()));
            self.control = Some(board.control.clone());
            self.running.push(Box::new(board));
        }
        if has(ARM) {
            // Pages show exact poses.
            let kind = if has("alpha1") {
                &["alpha1"][..]
            } else {
                &["ling", "--plant", "ideal"]
            };
            self.serve_sim(&[&["sim"], kind, &["--pty", ARM]].concat());
        }
        if has(XARM) {
            self.serve_sim(&["sim", "xarm", "--listen", XARM]);
        }
    }

    /// The arguments with the actual names, and fewer readings.
    fn placed(&self, args: &[&str]) -> Vec<String> {
        let mut placed: Vec<_> = args.iter().map(|arg| self.place(arg)).collect();
        if let (true, Some(control)) = (args.contains(&ADAPTER), &self.control) {
            match args[0] {
                "config" | "counters" | "reserve" => placed[1].clone_from(control),
                _ => placed.extend(["--control".to_owned(), control.clone()]),
            }
        }
        if args[0] == "record" && !args.contains(&"--count") {
            placed.extend(["--count".to_owned(), String::new()]);
        }
        if let Some(count) = placed.iter().position(|arg| arg == "--count") {
            placed[count + 1] = "3".to_owned();
        }
        placed
    }

    fn place(&self, arg: &str) -> String {
        let mut places = self.places.iter().rev();
        match places.find(|(printed, _)| arg.ends_with(printed)) {
            Some((printed, place)) => arg.replace(printed, place),
            None => arg.to_owned(),
        }
    }
}
