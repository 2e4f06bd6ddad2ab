//! The firmware image on the virtual board, as its tests use it.
//!
//! A test gets its board from [`on_board`] or [`on_board_with`], which afterwards fail it if the firmware touched what is
//! not modelled, crashed, or started again.

pub mod campaign;
mod can_program;
mod chip;
mod control;
mod figures;
mod hosts;
mod program;
pub mod quiet;
pub mod requests;
mod session;
mod talker;
mod ticket_arm;
mod traffic;

use std::env;
use std::path::PathBuf;

use armwire_bridge::{Counters, Duration};
use armwire_virtual_board::line::{Arm, Direction, Fault, LineByte, Outcome};
use armwire_virtual_board::usb::cdc::LineCoding;
use armwire_virtual_board::usb::host::Request;
use armwire_virtual_board::{Config, Nanos, VirtualBoard};

pub use can_program::CanProgram;
pub use chip::{Facts, chip, facts};
pub use control::Control;
pub use figures::Spread;
pub use hosts::{CanHost, Hosts, RequestTracker, Subscriber, Telemetry, UsbHost};
pub use program::{Program, ProgramOf};
pub use session::{Session, polled, session};
pub use talker::Talker;
pub use ticket_arm::{ArmCounts, Ticket, TicketArm, joint_answer};
pub use traffic::Traffic;

/// The rate of the Ling arm's line, in bits per second.
pub const MEGABAUD: u32 = 1_000_000;

/// Longer than anything waits in the adapter, at 115200 baud and above.
const SETTLING: Duration = Duration::from_millis(10);

/// The firmware image.
///
/// # Panics
///
/// If there is none, with how to make one.
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

/// Runs a test on a board that runs the image, with `arm` on its UART and no USB cable in.
///
/// # Panics
///
/// As [`on_board_with`].
pub fn on_board<A: Arm, R>(arm: A, test: impl FnOnce(&mut VirtualBoard<A>) -> R) -> R {
    on_board_with(Config::new(path(), arm), test)
}

/// The same, with everything about the board said.
///
/// # Panics
///
/// If the board cannot be started, and after the test if the firmware did anything that it must not.
pub fn on_board_with<A: Arm, R>(config: Config<A>, test: impl FnOnce(&mut VirtualBoard<A>) -> R) -> R {
    let mut board = VirtualBoard::start(config).unwrap();
    let result = test(&mut board);
    let report = board.report().unwrap();
    report.check().unwrap();
    assert_eq!(report.restarts, [], "the firmware started again");
    result
}

/// How long after the port is opened a rate that is not the arm's is surely in effect: 100 ms, and the time to change.
const RATE_SETTLES: Nanos = Nanos::from_millis(105);

/// Plugs the cable in, opens the serial port, and waits until its rate is in effect.
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

/// What the adapter has counted.
///
/// # Panics
///
/// If it does not say.
pub fn counters<A: Arm>(board: &mut VirtualBoard<A>) -> Counters {
    let (kind, request) = Counters::READ_REQUEST;
    let answer = board
        .usb()
        .control(Request::read(kind, request, 0, 0, Counters::MAX_LEN as u16));
    Counters::from_bytes(&answer.unwrap()).unwrap()
}

/// Runs until no more bytes come from the adapter, and returns those that did.
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

/// Exchanges `down` and `up` with the arm, both ways at once, and expects every byte.
///
/// # Panics
///
/// If a byte is lost, changed or made up.
pub fn exchange(board: &mut VirtualBoard<Talker>, down: &[u8], up: &[u8]) {
    board.with_arm(|arm| {
        arm.take_received();
        arm.send(up);
    });
    board.usb().write(down).unwrap();
    let received = read_all(board);
    // What the host has to say may take longer than what the arm has.
    while board.usb().unsent() > 0 {
        board.run_for(SETTLING).unwrap();
    }
    board.run_for(SETTLING).unwrap();
    let received_by_arm = board.with_arm(Talker::take_received);
    same_bytes("the host", &received, up);
    same_bytes("the arm", &received_by_arm, down);
}

/// Fails at the first byte that is not as sent, for lists that are too long to print.
///
/// # Panics
///
/// If there is one.
pub fn same_bytes(who: &str, got: &[u8], sent: &[u8]) {
    let place = got.iter().zip(sent).position(|(got, sent)| got != sent);
    assert_eq!(
        place,
        None,
        "{who} got another byte there; {} of {} came",
        got.len(),
        sent.len()
    );
    assert_eq!(got.len(), sent.len(), "{who} got another number of bytes");
}

/// `len` bytes without a pattern, other ones for each `seed`.
pub fn noise(seed: u64, len: usize) -> Vec<u8> {
    // Steele and Vigna's SplitMix64.
    let mut state = seed;
    let mut next = || {
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 56) as u8
    };
    (0..len).map(|_| next()).collect()
}

/// What a receiver that loses nothing makes of the bytes from the arm and their faults.
///
/// # Panics
///
/// If a byte was garbled by a wrong rate or collided: what arrives then is the receiver's affair.
pub fn as_received(line: &[LineByte]) -> Vec<u8> {
    let value = |byte: &LineByte| match byte.outcome {
        Outcome::Arrived | Outcome::Faulty(Fault::Noise | Fault::Parity) => Some(byte.sent),
        Outcome::Faulty(Fault::Framing) => Some(!byte.sent),
        Outcome::Faulty(Fault::Break) => Some(0),
        Outcome::Faulty(Fault::Overrun) | Outcome::Lost => None,
        Outcome::Garbled => panic!("the arm's rate is not the adapter's"),
        Outcome::Collided => panic!("both sides spoke at once"),
    };
    let from_arm = line.iter().filter(|byte| byte.direction == Direction::ToBoard);
    from_arm.filter_map(value).collect()
}

/// The time of a byte at `baud`.
pub const fn byte_time(baud: u32) -> Nanos {
    Nanos(10_000_000_000 / baud as u64)
}
