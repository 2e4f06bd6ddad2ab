//! What hangs on the UART: where its frames begin and end, what a request asks for, and what answers it.

use core::cell::Cell;

use armwire::alpha1::{self, Alpha1, Expect};
use armwire::ling::{self, Ling};
use armwire::{Framing, Micros, Protocol, Reason, Reply, Scan};

use crate::config::ArmKind;
use crate::control::MAX_FRAME;
use crate::{Line, LineCoding};

/// What nobody has asked for, and so may be anything that needs no asking.
pub(crate) const UNASKED: Expect = Expect::Responses(None);

/// What a request that the protocol does not know may get for an answer, as far as its patience goes.
const UNKNOWN_LEN: usize = MAX_FRAME;

impl ArmKind {
    /// What the UART is for this kind, until a host asks for another line coding.
    pub(crate) const fn line(self) -> Line {
        let baud = match self {
            Self::Ling | Self::Raw => LineCoding::LING.baud,
            Self::Alpha1 | Self::Alpha1Servo => 115_200,
        };
        Line {
            coding: LineCoding {
                baud,
                ..LineCoding::LING
            },
            half_duplex: matches!(self, Self::Alpha1Servo),
        }
    }

    /// The shortest frame while `expect` is expected, in bytes.
    const fn shortest(self, expect: Expect) -> usize {
        match (self, expect) {
            (Self::Ling, _) => ling::OVERHEAD,
            (_, Expect::Responses(Some(alpha1::ServoAnswer::Acknowledgement(_)))) => 1,
            (Self::Alpha1 | Self::Alpha1Servo, _) => 4,
            (Self::Raw, _) => MAX_FRAME,
        }
    }

    fn scan(self, window: &[u8], expect: Expect) -> Scan {
        match self {
            Self::Ling => Ling::scan(window, ()),
            Self::Alpha1 | Self::Alpha1Servo => Alpha1::scan(window, expect),
            Self::Raw => Scan::Skip(window.len(), Reason::Stray),
        }
    }

    fn scan_idle(self, window: &[u8], expect: Expect, missing: usize) -> Scan {
        match self {
            Self::Alpha1 | Self::Alpha1Servo => Alpha1::scan_idle(window, expect, missing),
            Self::Ling | Self::Raw => Ling::scan_idle(window, (), missing),
        }
    }

    /// Whether `bytes` are exactly one frame from a host.
    pub(crate) fn is_request(self, bytes: &[u8]) -> bool {
        match self {
            Self::Raw => !bytes.is_empty() && bytes.len() <= MAX_FRAME,
            _ => self.scan(bytes, Expect::Requests) == Scan::Frame(bytes.len()),
        }
    }

    /// What a frame from a host asks for.
    pub(crate) fn asked(self, frame: &[u8]) -> Asked {
        let asked = match self {
            Self::Ling => Ling::asked(frame),
            Self::Alpha1 | Self::Alpha1Servo => Alpha1::asked(frame),
            Self::Raw => None,
        };
        asked.unwrap_or(Asked::NOTHING)
    }

    /// What a frame from the arm is told by.
    pub(crate) fn key_of_answer(self, frame: &[u8]) -> Option<Key> {
        match self {
            Self::Ling => Ling::view(frame).map(Ling::key_of_answer),
            Self::Alpha1 | Self::Alpha1Servo => Alpha1::view(frame).map(Alpha1::key_of_answer),
            Self::Raw => None,
        }
    }

    /// The request that the adapter polls with, at the front of `out`.
    pub(crate) fn poll(self, out: &mut [u8]) -> Option<usize> {
        match self {
            Self::Ling => Ling::encode_request(&ling::Request::ReadJoints, out).ok(),
            Self::Alpha1 => Alpha1::encode_request(&alpha1::Request::ReadServoStates, out).ok(),
            Self::Alpha1Servo | Self::Raw => None,
        }
    }

    /// The request that the arm answers with what it is.
    pub(crate) fn identify(self, out: &mut [u8]) -> Option<usize> {
        match self {
            Self::Ling => Ling::encode_request(&ling::Request::ReadInfo, out).ok(),
            Self::Alpha1 => Alpha1::encode_request(&alpha1::Request::ReadFirmwareVersion, out).ok(),
            Self::Alpha1Servo | Self::Raw => None,
        }
    }

    /// The request that switches the torque off.
    pub(crate) fn torque_off(self, out: &mut [u8]) -> Option<usize> {
        match self {
            Self::Ling => Ling::encode_request(&ling::Request::SetTorque(ling::Torque::Off), out).ok(),
            Self::Alpha1 | Self::Alpha1Servo | Self::Raw => None,
        }
    }

    /// The request that moves it.
    pub(crate) fn moving(self, target: &ling::Move, out: &mut [u8]) -> Option<usize> {
        match self {
            Self::Ling => Ling::encode_request(&ling::Request::Move(*target), out).ok(),
            Self::Alpha1 | Self::Alpha1Servo | Self::Raw => None,
        }
    }

    /// Where the arm says that it is.
    pub(crate) fn joints(self, frame: &[u8]) -> Option<ling::JointState> {
        match self {
            Self::Ling => match Ling::parse_response(Ling::view(frame)?, ()) {
                Ok(ling::Response::Joints(state)) => Some(state),
                _ => None,
            },
            Self::Alpha1 | Self::Alpha1Servo | Self::Raw => None,
        }
    }
}

/// What an answer is told by: the answer to a request has the same key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Key(u8, u8);

/// What a frame from a host asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Asked {
    pub(crate) key: Key,
    /// What the arm may say to it, for the tap on what the arm says.
    pub(crate) expect: Expect,
    /// The answer to wait for.
    pub(crate) reply: Option<Reply>,
    /// Whether it moves the arm.
    pub(crate) moves: bool,
}

impl Asked {
    const NOTHING: Self = Self {
        key: Key(0, 0),
        expect: UNASKED,
        reply: None,
        moves: false,
    };
}

/// What the adapter must know of a protocol beyond its messages.
trait Arm: Protocol {
    /// How long the arm may think about a request that the protocol does not know.
    const TURNAROUND: Micros;

    fn key_of_request(frame: Self::Frame<'_>) -> Key;
    fn key_of_answer(frame: Self::Frame<'_>) -> Key;
    fn answer(request: &Self::Request) -> Expect;
    fn moves(request: &Self::Request) -> bool;

    /// What a frame asks for. One that is no message of the protocol may be one of a newer arm.
    fn asked(frame: &[u8]) -> Option<Asked> {
        let frame = Self::view(frame)?;
        let key = Self::key_of_request(frame);
        Some(match Self::parse_request(frame) {
            Ok(request) => Asked {
                key,
                expect: Self::answer(&request),
                reply: Self::reply(&request),
                moves: Self::moves(&request),
            },
            Err(_) => Asked {
                key,
                expect: UNASKED,
                reply: Some(Reply {
                    len: UNKNOWN_LEN,
                    turnaround: Self::TURNAROUND,
                }),
                moves: false,
            },
        })
    }
}

/// Every answer has the command and function of its request (document section 2).
impl Arm for Ling {
    const TURNAROUND: Micros = Micros::from_millis(50);

    fn key_of_request(frame: ling::Frame<'_>) -> Key {
        Key(frame.command, frame.function)
    }

    fn key_of_answer(frame: ling::Frame<'_>) -> Key {
        Key(frame.command, frame.function)
    }

    fn answer(_: &ling::Request) -> Expect {
        UNASKED
    }

    fn moves(request: &ling::Request) -> bool {
        matches!(request, ling::Request::Move(_))
    }
}

/// Every answer has the header of its request, and those of a servo have its id, which is the new one where the request
/// changes it (servo manual).
impl Arm for Alpha1 {
    const TURNAROUND: Micros = Micros::from_millis(100);

    fn key_of_request(frame: alpha1::Frame<'_>) -> Key {
        match frame {
            alpha1::Frame::Message {
                command: SERVO,
                data: &[_, CHANGE_ID, _, id, ..],
            } => Key(SERVO, id),
            frame => Self::key_of_answer(frame),
        }
    }

    fn key_of_answer(frame: alpha1::Frame<'_>) -> Key {
        match frame {
            alpha1::Frame::Message {
                command: command @ (SERVO | SERVO_VERSION),
                data: &[id, ..],
            } => Key(command, id),
            alpha1::Frame::Message { command, .. } => Key(command, 0),
            alpha1::Frame::Byte(byte) => Key(SERVO, byte.wrapping_sub(ACKNOWLEDGEMENT)),
        }
    }

    fn answer(request: &alpha1::Request) -> Expect {
        Self::expect(Some(request))
    }

    fn moves(request: &alpha1::Request) -> bool {
        matches!(
            request,
            alpha1::Request::Act(_) | alpha1::Request::Servo(alpha1::ServoRequest::Move { .. })
        )
    }
}

/// The headers of a servo's frames, the command that changes its id, and what its id is added to where it acknowledges.
const SERVO: u8 = 0xFA;
const SERVO_VERSION: u8 = 0xFC;
const CHANGE_ID: u8 = 0xCD;
const ACKNOWLEDGEMENT: u8 = 0xAA;

/// Listens in on one direction of the line: cuts its bytes into frames and what lies between them.
///
/// It is no [`Decoder`](armwire::Decoder) because the bytes between frames are needed, too: somebody gets them.
pub(crate) struct Tap {
    buf: [u8; MAX_FRAME],
    /// What is not decided on yet: `buf[head..tail]`.
    head: usize,
    tail: usize,
}

/// What a direction of the line consists of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Piece<'a> {
    /// A frame whose envelope is good.
    Frame(&'a [u8]),
    /// Bytes in no frame.
    Noise(&'a [u8]),
    /// Bytes between frames that are no error.
    Fill(&'a [u8]),
}

impl Tap {
    pub(crate) const fn new() -> Self {
        Self {
            buf: [0; MAX_FRAME],
            head: 0,
            tail: 0,
        }
    }

    /// Takes as much of `bytes` as there is room for and returns the rest. Take all that [`next`](Self::next) has to give
    /// before the next.
    pub(crate) fn push<'a>(&mut self, bytes: &'a [u8]) -> &'a [u8] {
        if 0 < self.head && self.head <= self.tail && self.tail <= self.buf.len() {
            // copy_within has a panic that is left when it is not inlined.
            let cells = Cell::from_mut(&mut self.buf[..]).as_slice_of_cells();
            for (to, from) in cells.iter().zip(cells.iter().take(self.tail).skip(self.head)) {
                to.set(from.get());
            }
            self.tail -= self.head;
            self.head = 0;
        }
        let room = self.buf.get_mut(self.tail..).unwrap_or_default();
        let (now, later) = bytes.split_at(bytes.len().min(room.len()));
        if let Some(room) = room.get_mut(..now.len()) {
            room.copy_from_slice(now);
        }
        self.tail = self.tail.saturating_add(now.len()).min(self.buf.len());
        later
    }

    /// The next piece; `None` when more bytes are needed to tell, which on an `idle` line will not come.
    pub(crate) fn next(&mut self, kind: ArmKind, expect: Expect, idle: bool) -> Option<Piece<'_>> {
        let window = self.window();
        if window.is_empty() {
            return None;
        }
        let mut verdict = kind.scan(window, expect);
        if let (Scan::Need(missing), true) = (verdict, idle) {
            verdict = kind.scan_idle(window, expect, missing);
        }
        let head = self.head;
        let (Scan::Frame(n) | Scan::Skip(n, _) | Scan::Fill(n)) = verdict else {
            return None;
        };
        self.head = head.saturating_add(n.max(1)).min(self.tail);
        let bytes = self.buf.get(head..self.head)?;
        Some(match verdict {
            Scan::Frame(_) => Piece::Frame(bytes),
            Scan::Fill(_) => Piece::Fill(bytes),
            _ => Piece::Noise(bytes),
        })
    }

    /// How many more bytes must come before [`next`](Self::next) can have a frame, once it had nothing: at least 1.
    pub(crate) fn need(&self, kind: ArmKind, expect: Expect) -> usize {
        let window = self.window();
        let header = match kind.scan(window, expect) {
            Scan::Need(n) if !window.is_empty() => n,
            _ => 0,
        };
        header.max(kind.shortest(expect).saturating_sub(window.len())).max(1)
    }

    /// The bytes that are not decided on yet.
    pub(crate) fn window(&self) -> &[u8] {
        self.buf.get(self.head..self.tail).unwrap_or_default()
    }

    /// How many these are.
    pub(crate) const fn pending(&self) -> usize {
        self.tail.saturating_sub(self.head)
    }

    pub(crate) const fn clear(&mut self) {
        (self.head, self.tail) = (0, 0);
    }
}
