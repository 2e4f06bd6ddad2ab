//! How much the adapter passes on, beside what the wires allow.

use std::ops::Range;

use armwire::Micros;
use armwire_bridge::can::Node;
use armwire_bridge::config::{self, Config, Poll};
use armwire_sim::ling::LingArm;
use armwire_virtual_board::line::{Direction, LineByte};
use armwire_virtual_board::{Config as BoardConfig, Error, Nanos};

use super::configure;
use super::load::joints;
use crate::image::{
    CanProgram, MEGABAUD, Talker, byte_time, counters, exchange, noise, on_board, on_board_with, path, plug_in,
};

/// Bits per second on the bus, and what is between two frames on it (ISO 11898-1).
const BUS_RATE: u32 = 1_000_000;
const INTERMISSION: Nanos = Nanos(3_000);

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
        let poll = Poll::Fastest;
        configure(
            board,
            Config {
                poll,
                ..Config::default()
            },
        );
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
        let can = config::Can {
            unsolicited: true,
            ..config::Can::default()
        };
        configure(
            board,
            Config {
                can,
                ..Config::default()
            },
        );
        board.with_arm(|arm| arm.say(&joints((span.0 / byte_time(MEGABAUD).0) as usize)));
        let mut program = CanProgram::new(Node::default());
        board.can().forget_frames();
        let (begin, mut bytes) = (board.now(), 0);
        while board.now().since(begin) < span {
            bytes += program.poll(board).map_or(0, |frame| frame.len());
            match board.run_until(Nanos::from_millis(1), |board| board.can().unread() > 0) {
                Ok(_) | Err(Error::TimedOut { .. }) => {}
                Err(error) => panic!("{error}"),
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

fn seconds(span: Nanos) -> f64 {
    span.0 as f64 / 1e9
}
