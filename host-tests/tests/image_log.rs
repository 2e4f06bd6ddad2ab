//! The log of the firmware image with feature `defmt`, as a probe reads it.

use std::path::PathBuf;
use std::{env, fs};

use armwire_bridge::Duration;
use armwire_bridge::control::Request;
use armwire_host_tests::image::requests::motion;
use armwire_host_tests::image::{BIT_RATE, Control, MEGABAUD, TicketArm, open, plug_in, polled};
use armwire_virtual_board::can::NodeConfig;
use armwire_virtual_board::report::{Cause, Crash};
use armwire_virtual_board::{Config, Crystal, Error, Nanos, VirtualBoard};
use defmt_decoder::Table;
use serde_json::Value;

type Board = VirtualBoard<TicketArm>;

/// RTT's control block: the fields of the first up-buffer.
const SIZE: u64 = 32;
const WRITTEN: u64 = 36;
const READ: u64 = 40;
const FLAGS: u64 = 44;
/// The mode that a probe sets, in which firmware would wait for it.
const BLOCK_IF_FULL: u32 = 2;

/// The firmware's clock, and the value of its queue's flag while it is in use: the next user panics.
const CLOCK: &str = "5board6timers5CLOCK";
const IN_USE: u32 = 1;

/// Longer than the watchdog's timeout at its slowest clock, and a start.
const WATCHDOG: Nanos = Nanos::from_millis(5_000);

const fn millis(millis: u64) -> Nanos {
    Nanos::from_millis(millis)
}

fn path() -> PathBuf {
    let path = env::var_os("ARMWIRE_LOG_IMAGE").expect("ARMWIRE_LOG_IMAGE: `cargo fw --defmt` makes such an image");
    path.into()
}

/// A running board whose log was read up to now.
struct Probed {
    board: Board,
    table: Table,
}

impl Probed {
    /// Powers it up, and returns the log of the start.
    fn start(crystal: Crystal) -> (Self, Vec<String>) {
        let config = Config {
            crystal,
            ..Config::new(path(), TicketArm::new(Duration::from_micros(100)))
        };
        let board = VirtualBoard::start(config).unwrap();
        let table = Table::parse(&fs::read(path()).unwrap())
            .unwrap()
            .expect("no log in the image");
        let mut probed = Self { board, table };
        probed.board.run_for(millis(100)).unwrap();
        let log = probed.log();
        (probed, log)
    }

    /// A board with a host on USB, polls and telemetry on CAN.
    fn busy() -> Self {
        let (mut probed, _) = Self::start(Crystal::new(8_000_000));
        plug_in(&mut probed.board, MEGABAUD);
        // It acknowledges frames.
        probed.board.can().join(0, NodeConfig::classic(BIT_RATE));
        let mut control = Control::open(&mut probed.board);
        control.order(&mut probed.board, Request::SetConfig(polled(100)));
        probed.board.run_for(millis(50)).unwrap();
        probed.log();
        probed
    }

    /// The lines since the last call: level and message, without the time.
    fn log(&mut self) -> Vec<String> {
        let mut decoder = self.table.new_stream_decoder();
        decoder.received(&self.board.log());
        let line = || {
            let frame = decoder.decode().ok()?;
            assert!(frame.display_timestamp().is_some());
            let level = frame.level().map(|level| level.as_str());
            Some(format!("{} {}", level.unwrap_or_default(), frame.display_message()))
        };
        std::iter::from_fn(line).collect()
    }

    fn rtt(&self, field: u64) -> u64 {
        self.board.symbol("_SEGGER_RTT").unwrap() + field
    }

    /// Attaches a probe.
    fn attach(&mut self) {
        let flags = self.rtt(FLAGS);
        self.board.write_word(flags, BLOCK_IF_FULL).unwrap();
    }

    /// Fills the buffer of the log: the probe reads nothing more.
    fn fill(&mut self) {
        let [size, written, read] = [SIZE, WRITTEN, READ].map(|field| self.rtt(field));
        let (size, written) = (
            self.board.read_word(size).unwrap(),
            self.board.read_word(written).unwrap(),
        );
        self.board.write_word(read, (written + 1) % size).unwrap();
    }

    /// Makes the firmware panic.
    fn panic(&mut self) {
        let clock = self.board.symbol(CLOCK).unwrap();
        // A user of the queue at that instant clears the flag when done.
        let panics = |board: &mut Board| {
            board.write_word(clock, IN_USE).unwrap();
            matches!(
                board.run_for(millis(20)),
                Err(Error::Crashed {
                    crash: Crash::Panic,
                    ..
                })
            )
        };
        assert!((0..10).any(|_| panics(&mut self.board)), "the firmware does not panic");
    }

    fn restarts(&self) -> Vec<Cause> {
        self.board
            .report()
            .restarts
            .iter()
            .map(|restart| restart.cause)
            .collect()
    }
}

/// Expects lines that contain these texts, in this order.
fn expect(log: &[String], texts: &[&str]) {
    let mut lines = log.iter();
    for text in texts {
        assert!(lines.any(|line| line.contains(text)), "{text:?} is missing in {log:#?}");
    }
}

#[test]
fn start_is_logged_with_version_clock_and_configuration() {
    let (mut probed, log) = Probed::start(Crystal::new(8_000_000));
    let version = format!("info armwire {}, commit ", env!("CARGO_PKG_VERSION"));
    let board = format!("board {}", probed.board.chip());
    expect(
        &log,
        &[
            "info clock: 16",
            &version,
            "info configuration: Config {",
            "info CAN: Can {",
        ],
    );
    assert!(log.iter().any(|line| line.contains(&board)), "{log:#?}");
    assert!(!log.iter().any(|line| line.contains("since power-on")), "{log:#?}");

    plug_in(&mut probed.board, 115_200);
    probed.board.run_for(millis(50)).unwrap();
    expect(
        &probed.log(),
        &[
            "info USB: configured by a host: true",
            "info USB: port open: true",
            "info reservation of the line: OtherRate",
            "info line: UartConfig { coding: LineCoding { baud: 115200,",
        ],
    );
    let mut control = Control::open(&mut probed.board);
    control.order(&mut probed.board, Request::SaveConfig);
    assert_eq!(probed.log(), ["info configuration saved"]);
}

#[test]
fn dead_crystal_is_logged() {
    let (mut probed, _) = Probed::start(Crystal::dead());
    probed.board.run_for(millis(2_000)).unwrap();
    expect(&probed.log(), &["warn the crystal does not run"]);
}

#[test]
fn bus_off_and_recovery_are_logged() {
    let mut probed = Probed::busy();
    probed.board.can().short();
    probed.board.run_for(millis(100)).unwrap();
    assert_eq!(probed.log(), ["warn CAN: bus-off"]);
    probed.board.can().release();
    probed.board.run_for(millis(100)).unwrap();
    assert_eq!(probed.log(), ["info CAN: recovered from bus-off"]);
}

#[test]
fn silent_host_is_logged() {
    let mut probed = Probed::busy();
    for _ in 0..5 {
        probed.board.usb().write(&motion()).unwrap();
        probed.board.run_for(millis(20)).unwrap();
    }
    assert_eq!(probed.log(), Vec::<String>::new());
    probed.board.run_for(millis(600)).unwrap();
    assert_eq!(
        probed.log(),
        ["warn the host on Usb went silent: 0 bytes dropped, torque off: false"]
    );
}

#[test]
fn traffic_is_not_logged() {
    let mut probed = Probed::busy();
    probed.board.run_for(millis(1_000)).unwrap();
    assert_eq!(probed.log(), Vec::<String>::new());
}

#[test]
fn panic_reaches_the_probe_before_the_restart() {
    let mut probed = Probed::busy();
    probed.attach();
    probed.panic();
    probed.board.run_for(millis(20)).unwrap();
    assert_eq!(probed.restarts(), []);
    expect(&probed.log(), &["error panicked at"]);
    probed.board.run_for(millis(100)).unwrap();
    assert_eq!(probed.restarts(), [Cause::Software]);
    expect(
        &probed.log(),
        &["warn since power-on: 1 panics, 0 resets by the watchdog, 0 hard faults"],
    );
}

#[test]
fn restart_reaches_the_probe_before_the_reset() {
    let mut probed = Probed::busy();
    probed.attach();
    let mut control = Control::open(&mut probed.board);
    control.order(&mut probed.board, Request::Restart);
    probed.board.run_for(millis(200)).unwrap();
    assert_eq!(probed.restarts(), []);
    expect(&probed.log(), &["info a host requested a restart"]);
    probed.board.run_for(millis(100)).unwrap();
    assert_eq!(probed.restarts(), [Cause::Software]);
}

#[test]
fn missing_probe_delays_no_restart() {
    let mut probed = Probed::busy();
    probed.panic();
    probed.board.run_for(millis(20)).unwrap();
    assert_eq!(probed.restarts(), [Cause::Software]);
}

#[test]
fn lost_probe_stops_nothing_but_a_restart() {
    let mut probed = Probed::busy();
    probed.attach();
    probed.fill();
    probed.board.can().short();
    probed.board.run_for(WATCHDOG).unwrap();
    assert_eq!(probed.restarts(), []);
    open(&mut probed.board, MEGABAUD);
    let mut control = Control::open(&mut probed.board);
    control.order(&mut probed.board, Request::Restart);
    probed.board.run_for(WATCHDOG).unwrap();
    assert_eq!(probed.restarts(), [Cause::Watchdog]);
}

#[test]
fn page_explains_every_line() {
    const PAGE: &str = include_str!("../../docs/logs.md");
    let (probed, _) = Probed::start(Crystal::new(8_000_000));
    let mut lines = 0;
    for symbol in probed.table.raw_symbols() {
        let symbol: Value = serde_json::from_str(symbol).unwrap();
        let [package, tag, text] = ["package", "tag", "data"].map(|key| symbol[key].as_str().unwrap());
        let level = tag.strip_prefix("defmt_").unwrap_or_default().to_uppercase();
        // Other tags are parts of messages. A panic has only its own text.
        if !package.starts_with("armwire-") || !["INFO", "WARN", "ERROR"].contains(&&*level) || text == "{}" {
            continue;
        }
        let text = text.split('{').next().unwrap();
        assert!(PAGE.contains(&format!("| `{level} {text}")), "{level} {text}");
        lines += 1;
    }
    assert!(lines > 15, "{lines} lines");
}
