//! How much the adapter passes on, beside what the wires allow.

use std::ops::Range;

use armwire::Micros;
use armwire::ling::MAX_FRAME;
use armwire_bridge::Bridge;
use armwire_bridge::can::{Function, Node};
use armwire_bridge::config::{self, Config};
use armwire_bridge::control::Identity;
use armwire_bridge::isotp::{self, Config as IsoTp, Endpoint, Link};
use armwire_sim::ling::LingArm;
use armwire_virtual_board::line::{Direction, LineByte};
use armwire_virtual_board::{Config as BoardConfig, Nanos};

use super::load::joints;
use super::{configure, fastest, unsolicited};
use crate::image::{
    CanProgram, MEGABAUD, Talker, byte_time, counters, exchange, noise, on_board, on_board_with, path, plug_in,
};

/// Bits per second on the bus, and what is between two frames on it (ISO 11898-1).
const BUS_RATE: u32 = 1_000_000;
const INTERMISSION: Nanos = Nanos(3_000);

/// Bits per second of the data phase of an FD bus.
const FD_RATE: u32 = 5_000_000;

/// Something passed on, in units per second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rate {
    /// What was achieved.
    pub achieved: f64,
    /// What the wires allow.
    pub limit: f64,
}

impl Rate {
    /// What was achieved of what the wires allow.
    pub fn share(&self) -> f64 {
        self.achieved / self.limit
    }
}

/// Polls per second, as fast as the wire allows, of an arm that thinks for `turnaround`. The limit is a line without a
/// pause but for that.
///
/// # Panics
///
/// If the firmware did what it must not, or an answer is missing.
pub fn polls(turnaround: Micros) -> Rate {
    let arm = LingArm::new(armwire_sim::ling::Config {
        turnaround,
        ..armwire_sim::ling::Config::follower()
    });
    on_board(arm, |board| {
        plug_in(board, MEGABAUD);
        configure(board, fastest());
        board.run_for(Nanos::from_millis(10)).unwrap();
        board.uart().forget_bytes();
        board.run_for(Nanos::from_millis(1_000)).unwrap();
        assert_eq!(counters(board).unanswered_requests, 0);
        let line = board.uart().bytes();
        let starts = requests(&line);
        let (Some(first), Some(last)) = (starts.first(), starts.last()) else {
            panic!("nobody asked");
        };
        let bytes = last.start - first.start;
        let polls = (starts.len() - 1) as f64;
        let least = bytes as f64 * seconds(byte_time(MEGABAUD)) + polls * seconds(turnaround.into());
        Rate {
            achieved: polls / seconds(line[last.start].at.since(line[first.start].at)),
            limit: polls / least,
        }
    })
}

/// Where on the line the bytes of each request are.
fn requests(line: &[LineByte]) -> Vec<Range<usize>> {
    let mut requests: Vec<Range<usize>> = Vec::new();
    for (place, byte) in line.iter().enumerate() {
        match requests.last_mut() {
            _ if byte.direction == Direction::ToBoard => {}
            Some(last) if last.end == place => last.end = place + 1,
            _ => requests.push(place..place + 1),
        }
    }
    requests
}

/// Bytes per second each way, `count` of them both ways at once at `baud`.
///
/// # Panics
///
/// If the firmware did what it must not, or a byte is lost, changed or made up.
pub fn usb(baud: u32, count: usize) -> Rate {
    let mut config = BoardConfig::new(path(), Talker::default());
    config.arm_baud = baud;
    on_board_with(config, |board| {
        plug_in(board, baud);
        board.uart().forget_bytes();
        let begin = board.now();
        exchange(board, &noise(1, count), &noise(2, count));
        let end = board.uart().bytes().last().expect("bytes").at;
        Rate {
            achieved: count as f64 / seconds(end.since(begin)),
            limit: f64::from(baud) / 10.0,
        }
    })
}

/// Bytes of the arm's frames per second to a host on a classic bus, by ISO-TP, while the arm says more than fits. The limit
/// is a bus without a pause between the frames that this takes, flow control and stuff bits included.
///
/// # Panics
///
/// If the firmware did what it must not, or a transfer fails.
pub fn classic_can(span: Nanos) -> Rate {
    on_board(Talker::default(), |board| {
        plug_in(board, MEGABAUD);
        board.can().attach(BUS_RATE);
        configure(board, unsolicited());
        board.with_arm(|arm| arm.say(&joints((span.0 / byte_time(MEGABAUD).0) as usize)));
        let mut program = CanProgram::new(Node::default());
        board.can().forget_frames();
        let (begin, mut bytes) = (board.now(), 0);
        while board.now().since(begin) < span {
            bytes += program.poll(board).map_or(0, |frame| frame.len());
            if let Err(error) = board.run_until_heard(Nanos::from_millis(1)) {
                panic!("{error}");
            }
        }
        let frames = board.can().frames();
        let busy: f64 = frames
            .iter()
            .map(|frame| seconds(frame.end.since(frame.start) + INTERMISSION))
            .sum();
        Rate {
            achieved: bytes as f64 / seconds(board.now().since(begin)),
            limit: bytes as f64 / busy,
        }
    })
}

/// Bytes of the arm's frames per second to a host on a CAN FD bus, while the arm says frames without a pause at 1 Mbaud. The
/// limit is what the line carries.
///
/// The image is for a controller without CAN FD, so that this is the bridge alone: it takes no time to think, and the bus
/// is as slow as it can be with the frames that it is given.
///
/// # Panics
///
/// If a frame is lost or changed.
pub fn can_fd(span: Nanos) -> Rate {
    let can = config::Can {
        data_bit_rate: Some(FD_RATE),
        unsolicited: true,
        ..config::Can::default()
    };
    let identity = Identity {
        can_fd: true,
        ..Identity::default()
    };
    let mut bridge = Bridge::new(
        identity,
        Config {
            can,
            ..Config::default()
        },
    );
    let mut host = Endpoint::<MAX_FRAME, MAX_FRAME>::new(IsoTp::new(Link::Fd, Function::ArmRequest.id(can.node)));
    let said = joints((span.0 / byte_time(MEGABAUD).0) as usize);
    let (mut heard, mut free, mut now) = (Vec::new(), Nanos(0), Nanos(0));
    for byte in &said {
        now = now + byte_time(MEGABAUD);
        bridge.tick(now.micros());
        bridge.uart_received(&[*byte], now.micros());
        while free <= now
            && let Some(frame) = bridge.can_transmit(now.micros())
        {
            free = now + longest_on_bus(frame.data().len());
            if frame.id() == Function::ArmAnswer.id(can.node) {
                for event in host.receive(frame.data(), now.micros()) {
                    assert_eq!(event, isotp::Event::Received);
                }
                heard.extend_from_slice(host.received().unwrap_or_default());
                host.release();
            }
        }
    }
    // What is still on its way at the end is at most what one frame of the bus takes, and the frame behind it.
    assert!(said.starts_with(&heard) && said.len() - heard.len() <= 2 * MAX_FRAME);
    Rate {
        achieved: heard.len() as f64 / seconds(now),
        limit: f64::from(MEGABAUD) / 10.0,
    }
}

/// How long an FD frame with so many bytes takes with all stuff bits that there can be, at 1 Mbit/s and [`FD_RATE`], the
/// intermission included (ISO 11898-1).
fn longest_on_bus(bytes: usize) -> Nanos {
    // From the start of frame to the bit rate switch, 17 bits and a stuff bit behind each four; and from the CRC
    // delimiter on.
    let slow = 17 + 17 / 4 + 13;
    // ESI and DLC, the data, stuff bits; the stuff count, the CRC and their fixed stuff bits.
    let data = 5 + 8 * bytes as u64;
    let check = if bytes > 16 { 4 + 21 + 7 } else { 4 + 17 + 6 };
    let fast = data + data / 4 + check;
    Nanos(slow * 1_000_000_000 / u64::from(BUS_RATE) + fast * 1_000_000_000 / u64::from(FD_RATE))
}

fn seconds(span: Nanos) -> f64 {
    span.0 as f64 / 1e9
}
