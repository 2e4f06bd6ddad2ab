//! The firmware image on the virtual board, for tests.
//!
//! A test gets its board from [`on_board`] or [`on_board_with`]. They fail the test afterwards if the firmware used an
//! unmodelled peripheral, crashed, or restarted.

pub mod campaign;
mod can_program;
mod chip;
mod control;
mod figures;
mod hosts;
mod program;
pub mod quiet;
mod raw_arm;
pub mod requests;
mod session;
mod ticket_arm;
mod traffic;

use std::env;
use std::path::PathBuf;

use armwire_bridge::{Counters, Duration};
use armwire_virtual_board::line::{Arm, Direction, Fault, LineByte, Outcome};
use armwire_virtual_board::usb::cdc::LineCoding;
use armwire_virtual_board::usb::host::Request;
use armwire_virtual_board::{Config, Nanos, Rp2040Revision, VirtualBoard};

pub use can_program::CanProgram;
pub use chip::{Facts, chip, facts};
pub use control::{Control, expect_exact, expect_exact_frames};
pub use figures::Spread;
pub use hosts::{CanHost, Hosts, RequestTracker, Subscriber, Telemetry, UsbHost, run_until_unread};
pub use program::{Program, ProgramOf};
pub use raw_arm::RawArm;
pub use session::{Session, for_chip, polled, session};
pub use ticket_arm::{ArmCounts, Ticket, TicketArm, joint_answer, number_of, numbered_answer};
pub use traffic::Traffic;

use crate::random::Random;

/// The rate of the Ling arm's line, in bits per second.
pub const MEGABAUD: u32 = 1_000_000;

/// The rate of the CAN bus, in bits per second.
pub const BIT_RATE: u32 = 1_000_000;

/// Longer than any delay in the adapter, at 115200 baud and above.
const SETTLING: Duration = Duration::from_millis(10);

/// The firmware image.
///
/// # Panics
///
/// If there is none. The message explains how to build one.
pub fn path() -> PathBuf {
    let path = env::var_os("ARMWIRE_IMAGE").map(PathBuf::from);
    let path = path.expect("ARMWIRE_IMAGE does not name a firmware image: run `cargo ci`, or `cargo fw` and set it");
    assert!(
        path.is_file(),
        "ARMWIRE_IMAGE: {} is no file: `cargo fw` makes one",
        path.display()
    );
    path
}

/// A board with the image, whose RP2040 has the revision that `ARMWIRE_RP2040_REVISION` names, by default B2.
///
/// # Panics
///
/// As [`path`], and if there is no such revision.
pub fn board_config<A>(arm: A) -> Config<A> {
    let rp2040_revision = match env::var("ARMWIRE_RP2040_REVISION").as_deref() {
        Ok("B1") => Rp2040Revision::B1,
        Ok("B2") | Err(_) => Rp2040Revision::B2,
        Ok(other) => panic!("ARMWIRE_RP2040_REVISION: {other:?} is neither B1 nor B2"),
    };
    Config {
        rp2040_revision,
        ..Config::new(path(), arm)
    }
}

/// Runs a test on a board that runs the image, with `arm` on its UART and no USB cable in.
///
/// # Panics
///
/// See [`on_board_with`].
pub fn on_board<A: Arm, R>(arm: A, test: impl FnOnce(&mut VirtualBoard<A>) -> R) -> R {
    on_board_with(board_config(arm), test)
}

/// Runs a test on a board with this configuration.
///
/// # Panics
///
/// If the board cannot be started, and after the test if the firmware had a violation.
pub fn on_board_with<A: Arm, R>(config: Config<A>, test: impl FnOnce(&mut VirtualBoard<A>) -> R) -> R {
    let mut board = VirtualBoard::start(config).unwrap();
    let result = test(&mut board);
    let report = board.report();
    report.check().unwrap();
    assert_eq!(report.restarts, [], "the firmware started again");
    result
}

/// Delay from the opening of the port until a rate other than the arm's is in effect: 100 ms, and the time of the
/// change.
const RATE_SETTLES: Nanos = Nanos::from_millis(105);

/// Plugs in the cable, opens the serial port, and waits until its rate is in effect.
///
/// # Panics
///
/// If that fails.
pub fn plug_in<A: Arm>(board: &mut VirtualBoard<A>, baud: u32) {
    board.usb().attach();
    open(board, baud);
    if baud != MEGABAUD {
        board.run_for(RATE_SETTLES).unwrap();
    }
}

/// Opens the serial port.
///
/// # Panics
///
/// If that fails.
pub fn open<A: Arm>(board: &mut VirtualBoard<A>, baud: u32) {
    board.usb().open(0, LineCoding::new(baud)).unwrap();
}

/// The adapter's counters.
///
/// # Panics
///
/// If the request fails.
pub fn counters<A: Arm>(board: &mut VirtualBoard<A>) -> Counters {
    let (kind, request) = Counters::READ_REQUEST;
    let answer = board
        .usb()
        .control(Request::read(kind, request, 0, 0, Counters::MAX_LEN as u16));
    Counters::from_bytes(&answer.unwrap()).unwrap()
}

/// Runs until no more bytes arrive from the adapter. Returns all bytes.
///
/// # Panics
///
/// If the firmware crashes.
pub fn read_all<A: Arm>(board: &mut VirtualBoard<A>) -> Vec<u8> {
    let mut bytes = board.usb().read();
    loop {
        board.run_for(SETTLING).unwrap();
        let more = board.usb().read();
        if more.is_empty() {
            return bytes;
        }
        bytes.extend(more);
    }
}

/// Exchanges `down` and `up` with the arm, in both directions at once, and checks every byte.
///
/// # Panics
///
/// If a byte is lost, changed or inserted.
pub fn exchange(board: &mut VirtualBoard<RawArm>, down: &[u8], up: &[u8]) {
    board.with_arm(|arm| {
        arm.take_received();
        arm.send(up);
    });
    board.usb().write(down).unwrap();
    let received = read_all(board);
    // The host's bytes may take longer than the arm's.
    while board.usb().unsent() > 0 {
        board.run_for(SETTLING).unwrap();
    }
    board.run_for(SETTLING).unwrap();
    let received_by_arm = board.with_arm(RawArm::take_received);
    same_bytes("the host", &received, up);
    same_bytes("the arm", &received_by_arm, down);
}

/// Compares byte sequences that are too long to print.
///
/// # Panics
///
/// If there is a difference.
pub fn same_bytes(receiver: &str, received: &[u8], sent: &[u8]) {
    let place = received.iter().zip(sent).position(|(received, sent)| received != sent);
    let lengths = (received.len(), sent.len());
    assert_eq!(
        place, None,
        "first difference at {receiver}; {lengths:?} bytes received and sent"
    );
    assert_eq!(lengths.0, lengths.1, "wrong number of bytes at {receiver}");
}

/// `len` pseudo-random bytes from `seed`.
pub fn noise(seed: u64, len: usize) -> Vec<u8> {
    let mut random = Random::Seeded(seed);
    (0..len).map(|_| (random.any() >> 56) as u8).collect()
}

/// The bytes from the arm and their faults, as seen by a lossless receiver.
///
/// # Panics
///
/// If a byte was garbled by a wrong rate or collided: the received value is undefined.
pub fn as_received(line: &[LineByte]) -> Vec<u8> {
    let value = |byte: &LineByte| match byte.outcome {
        Outcome::Arrived | Outcome::Faulty(Fault::Noise | Fault::Parity) => Some(byte.sent),
        Outcome::Faulty(Fault::Framing) => Some(!byte.sent),
        Outcome::Faulty(Fault::Break) => Some(0),
        Outcome::Faulty(Fault::Overrun) | Outcome::Lost => None,
        Outcome::Garbled => panic!("the arm's rate is not the adapter's"),
        Outcome::Collided => panic!("both sides sent at once"),
    };
    let from_arm = line.iter().filter(|byte| byte.direction == Direction::ToBoard);
    from_arm.filter_map(value).collect()
}

/// The time of a byte at `baud`.
pub const fn byte_time(baud: u32) -> Nanos {
    Nanos(10_000_000_000 / baud as u64)
}
