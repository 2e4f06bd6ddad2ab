//! The bytes of a packet.
//!
//! ```text
//!   0    1    2    3     4      5 .. n-1   n-1
//! +----+----+----+-----+------+----------+-------+
//! | FF | FF | ID | LEN | CODE | DATA     | CHECK |
//! +----+----+----+-----+------+----------+-------+
//! ```
//!
//! LEN counts the bytes after it. CODE is the instruction of a request, and the error byte of an answer. CHECK is the
//! complement of the sum of all bytes between FF FF and CHECK. There is no terminator, and nothing tells a request from an
//! answer: a ping is also the answer of a servo with a voltage error.

use core::ops::RangeInclusive;

use armwire::framing::{Framing, Reason, Scan};

use crate::Feetech;

/// The longest packet, in bytes: the limit of the maker's SDK.
pub const MAX_FRAME: usize = 250;

/// The highest id of a servo.
pub const MAX_ID: u8 = 253;

/// The id that addresses all servos. None answers to it, except to PING.
pub const BROADCAST: u8 = 0xFE;

const HEADER: u8 = 0xFF;

/// The number of bytes that LEN does not count.
const OVERHEAD: usize = 4;

/// The range of LEN.
const LEN: RangeInclusive<u8> = 2..=(MAX_FRAME - OVERHEAD) as u8;

/// The codes of requests.
pub(crate) mod code {
    pub(crate) const PING: u8 = 0x01;
    pub(crate) const READ: u8 = 0x02;
    pub(crate) const WRITE: u8 = 0x03;
    pub(crate) const REG_WRITE: u8 = 0x04;
    pub(crate) const ACTION: u8 = 0x05;
    pub(crate) const FACTORY_RESET: u8 = 0x06;
    pub(crate) const REBOOT: u8 = 0x08;
    pub(crate) const RESET_TURNS: u8 = 0x0A;
    pub(crate) const SYNC_READ: u8 = 0x82;
    pub(crate) const SYNC_WRITE: u8 = 0x83;
}

/// The complement of the sum of `bytes`: the checksum of a packet whose bytes between header and checksum they are.
///
/// ```
/// assert_eq!(armwire_feetech::checksum([0x01, 0x02, 0x01]), 0xFB); // ping of servo 1
/// ```
pub fn checksum(bytes: impl IntoIterator<Item = u8>) -> u8 {
    !bytes.into_iter().fold(0, u8::wrapping_add)
}

/// The side that sends the next packet. No answer comes from [`BROADCAST`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Expect {
    /// Packets of the host.
    Requests,
    /// Packets of servos.
    Responses,
}

impl Framing for Feetech {
    // A packet ends with its checksum: zeros may complete a cut one.
    const VOID: Option<usize> = None;
    type Expect = Expect;

    fn scan(&self, window: &[u8], expect: Expect) -> Scan {
        let need = |total: usize| Scan::Need(total.saturating_sub(window.len()).max(1));
        let is_wrong = |id| id == HEADER || id == BROADCAST && expect == Expect::Responses;
        match *window {
            [first, ref rest @ ..] if first != HEADER => {
                let stray = rest.iter().take_while(|byte| **byte != HEADER).count();
                Scan::Noise(1 + stray, Reason::Stray)
            }
            [_, second, ..] if second != HEADER => Scan::Noise(1, Reason::Stray),
            [_, _, id, ..] if is_wrong(id) => Scan::Noise(1, Reason::Stray),
            [_, _, _, len, ..] if !LEN.contains(&len) => {
                let (min, max, got) = ((*LEN.start()).into(), (*LEN.end()).into(), len.into());
                Scan::Noise(1, Reason::Length { min, max, got })
            }
            [_, _, _, len, ..] => match window.get(2..usize::from(len) + OVERHEAD) {
                Some(&[ref covered @ .., got]) => match checksum(covered.iter().copied()) {
                    expected if expected == got => Scan::Frame(covered.len() + 3),
                    expected => Scan::Noise(1, Reason::Checksum { expected, got }),
                },
                _ => need(usize::from(len) + OVERHEAD),
            },
            _ => need(self.shortest(expect)),
        }
    }

    fn terminator(&self, _expect: Expect) -> Option<u8> {
        None
    }

    fn shortest(&self, _expect: Expect) -> usize {
        6
    }

    fn requests(&self) -> Expect {
        Expect::Requests
    }

    fn unsolicited(&self) -> Expect {
        Expect::Responses
    }
}
