//! What hangs on the UART: where its frames begin and end, what a request asks for, and what answers it.

use core::cell::Cell;

use armwire::alpha1::{self, Alpha1, Expect, ServoAnswer, ServoId};
use armwire::framing::{Framing, Reason, Scan};
use armwire::ling::{self, Ling};
use armwire::messages::Messages;

use crate::config::ArmKind;
use crate::control::MAX_FRAME;
use crate::{Line, LineCoding};

/// What nobody has asked for, and so may be anything that needs no asking.
pub(crate) const UNASKED: Expect = Expect::Responses(None);

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

    /// Whether the arm's rate is known: a raw one has the rate that the host on USB sets.
    pub(crate) const fn has_own_rate(self) -> bool {
        !matches!(self, Self::Raw)
    }

    /// What the first request of these bytes asks for. `None` if they do not begin with a whole one.
    pub(crate) fn asked_first(self, bytes: &[u8]) -> Option<Asked> {
        match self.scan(bytes, Expect::Requests) {
            Scan::Frame(len) => Some(self.asked(bytes.get(..len)?)),
            _ => None,
        }
    }

    /// The shortest frame while `expect` is expected, in bytes.
    const fn shortest(self, expect: Expect) -> usize {
        match (self, expect) {
            (Self::Ling, _) => ling::OVERHEAD,
            (_, Expect::Responses(Some(ServoAnswer::Acknowledgement(_)))) => 1,
            (Self::Alpha1 | Self::Alpha1Servo, _) => 4,
            (Self::Raw, _) => MAX_FRAME,
        }
    }

    /// The byte with which every frame ends, if there is one.
    const fn end_mark(self, expect: Expect) -> Option<u8> {
        match (self, expect) {
            (Self::Ling, _) => Some(ling::TAIL),
            (_, Expect::Responses(Some(ServoAnswer::Acknowledgement(_)))) => None,
            (Self::Alpha1 | Self::Alpha1Servo, _) => Some(alpha1::TAIL),
            (Self::Raw, _) => None,
        }
    }

    fn scan(self, window: &[u8], expect: Expect) -> Scan {
        let verdict = match self {
            Self::Ling => Ling.scan(window, ()),
            Self::Alpha1 | Self::Alpha1Servo => Alpha1.scan(window, expect),
            Self::Raw => Scan::Noise(window.len(), Reason::Stray),
        };
        match verdict {
            // There is no room for a frame that long.
            Scan::Need(missing) if window.len().saturating_add(missing) > MAX_FRAME => Scan::Noise(1, Reason::Stray),
            verdict => verdict,
        }
    }

    fn scan_idle(self, window: &[u8], expect: Expect) -> Scan {
        match self {
            Self::Alpha1 | Self::Alpha1Servo => Alpha1.scan_idle(window, expect),
            Self::Ling => Ling.scan_idle(window, ()),
            Self::Raw => self.scan(window, expect),
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
        match self {
            Self::Ling => asked_of_ling(frame),
            Self::Alpha1 | Self::Alpha1Servo => asked_of_alpha1(frame),
            Self::Raw => Asked::NOTHING,
        }
    }

    /// What a frame from the arm is told by.
    pub(crate) fn key_of_answer(self, frame: &[u8]) -> Option<Key> {
        match (self, frame) {
            (Self::Ling, &[_, command, function, ..]) => Some(Key(command, function)),
            (Self::Alpha1 | Self::Alpha1Servo, &[byte]) => Some(Key(SERVO, byte.wrapping_sub(ACKNOWLEDGEMENT))),
            (Self::Alpha1 | Self::Alpha1Servo, &[command @ (SERVO | SERVO_VERSION), _, id, ..]) => {
                Some(Key(command, id))
            }
            (Self::Alpha1 | Self::Alpha1Servo, &[command, ..]) => Some(Key(command, 0)),
            _ => None,
        }
    }

    /// The request that the adapter polls with.
    pub(crate) const fn poll(self) -> Option<&'static [u8]> {
        match self {
            Self::Ling => Some(&READ_JOINTS),
            Self::Alpha1 => Some(&READ_SERVO_STATES),
            Self::Alpha1Servo | Self::Raw => None,
        }
    }

    /// The request that the arm answers with what it is.
    pub(crate) const fn identify(self) -> Option<&'static [u8]> {
        match self {
            Self::Ling => Some(&READ_INFO),
            Self::Alpha1 => Some(&READ_FIRMWARE_VERSION),
            Self::Alpha1Servo | Self::Raw => None,
        }
    }

    /// The request that switches the torque off.
    pub(crate) const fn torque_off(self) -> Option<&'static [u8]> {
        match self {
            Self::Ling => Some(&TORQUE_OFF),
            Self::Alpha1 | Self::Alpha1Servo | Self::Raw => None,
        }
    }

    /// The request that moves it.
    pub(crate) fn moving(self, target: &ling::Move, out: &mut [u8]) -> Option<usize> {
        match self {
            Self::Ling => Ling.encode_request(&ling::Request::Move(*target), out).ok(),
            Self::Alpha1 | Self::Alpha1Servo | Self::Raw => None,
        }
    }

    /// Where the arm says that it is.
    pub(crate) fn joints(self, frame: &[u8]) -> Option<ling::JointState> {
        match self {
            Self::Ling => match Ling.parse_response(frame, ()) {
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
    pub(crate) reply: Option<Answer>,
    /// Whether it moves the arm.
    pub(crate) moves: bool,
    /// Whether it switches the torque on: the arm is to stay where it is.
    pub(crate) holds: bool,
}

/// How long to wait for an answer: a [`ResponseTiming`](armwire::dialect::ResponseTiming) in fewer bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Answer {
    /// How long the arm may think, in µs.
    pub(crate) turnaround: u32,
    /// The longest that the answer may be, in bytes.
    pub(crate) len: u8,
}

impl Asked {
    const NOTHING: Self = Self {
        key: Key(0, 0),
        expect: UNASKED,
        reply: None,
        moves: false,
        holds: false,
    };

    const fn answered(key: Key, turnaround: u32, len: u8) -> Self {
        Self {
            key,
            reply: Some(Answer { turnaround, len }),
            ..Self::NOTHING
        }
    }
}

// What follows is as `armwire` has it, which a test holds it to: all of its messages, only to learn what gets an
// answer, take 4 kB that the adapter does not have.

const READ_JOINTS: [u8; 7] = [0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF];
const READ_INFO: [u8; 7] = [0xAA, 0x01, 0x00, 0x01, 0xFE, 0x23, 0xFF];
const TORQUE_OFF: [u8; 7] = [0xAA, 0x05, 0x00, 0x01, 0x00, 0x6F, 0xFF];
const READ_SERVO_STATES: [u8; 10] = [0xEF, 0xFE, 0, 0, 0, 0, 0, 0, 0, 0xED];
const READ_FIRMWARE_VERSION: [u8; 10] = [0xF5, 0x5F, 1, 0, 0, 0, 0, 0, 1, 0xED];

/// Ling document, section 2. Every answer has the command and function of its request. What is not in the document may
/// be of a newer arm.
fn asked_of_ling(frame: &[u8]) -> Asked {
    let &[_, command, function, _, data, ..] = frame else {
        return Asked::NOTHING;
    };
    let key = Key(command, function);
    let set = match (command, function, data) {
        (0x06, 0x01, 0xFE) | (0x04, 0x0E, _) => false,
        (0x03, 0, _) | (0x04 | 0x05, _, _) | (0x06, 0x01 | 0x03, _) => true,
        _ => false,
    };
    match set {
        true => Asked {
            key,
            moves: key == Key(0x06, 0x03),
            holds: (command, function, data) == (0x05, 0, 1),
            ..Asked::NOTHING
        },
        false if command == 0xFE => Asked::answered(key, 500_000, 30),
        false => Asked::answered(key, 50_000, 30),
    }
}

/// Alpha1 document and servo manual. Every answer has the header of its request, and those of a servo have its id,
/// which is the new one where the request changes it.
fn asked_of_alpha1(frame: &[u8]) -> Asked {
    let &[command, _, ref rest @ ..] = frame else {
        return Asked::NOTHING;
    };
    // What a short frame does not have decides nothing.
    let [first, second, third, fourth] = [0, 1, 2, 3].map(|at| rest.get(at).copied().unwrap_or(0));
    let key = Key(command, 0);
    match (command, second) {
        (SERVO, MOVE | LED) => Asked {
            // What is told to all of them none acknowledges.
            key: Key(SERVO, first),
            expect: Expect::Responses(ServoId::new(first).ok().map(ServoAnswer::Acknowledgement)),
            reply: (first != 0).then_some(Answer {
                turnaround: SERVO_TURNAROUND,
                len: 1,
            }),
            // FF in place of an angle switches the motor off.
            moves: second == MOVE && third != 0xFF,
            holds: false,
        },
        (SERVO, CHANGE_ID) => Asked::answered(Key(SERVO, fourth), SERVO_TURNAROUND, 10),
        (SERVO | SERVO_VERSION, _) => Asked::answered(Key(command, first), SERVO_TURNAROUND, 10),
        (ACT, _) => Asked {
            moves: first == 1,
            ..Asked::answered(key, 100_000, 10)
        },
        (0xF3 | 0xF4 | 0xF9, _) => Asked::answered(key, 1_000_000, 4),
        _ => Asked::answered(key, 100_000, MAX_FRAME as u8),
    }
}

/// The headers of an action and of a servo's frames, the commands to it, what its id is added to where it acknowledges,
/// and how long it thinks.
const ACT: u8 = 0xFB;
const SERVO: u8 = 0xFA;
const SERVO_VERSION: u8 = 0xFC;
const MOVE: u8 = 0x01;
const LED: u8 = 0x04;
const CHANGE_ID: u8 = 0xCD;
const ACKNOWLEDGEMENT: u8 = 0xAA;
const SERVO_TURNAROUND: u32 = 400;

/// Listens in on one direction of the line: cuts its bytes into frames and what lies between them.
///
/// It is no [`Decoder`](armwire::decoder::Decoder) because the bytes between frames are needed, too: somebody gets them.
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

    /// Takes as much of `bytes` as there is room for and returns the rest. Take all that [`next`](Self::next) has to
    /// give before the next.
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
        if let (Scan::Need(_), true) = (verdict, idle) {
            verdict = kind.scan_idle(window, expect);
        }
        let head = self.head;
        let (Scan::Frame(n) | Scan::Noise(n, _) | Scan::Padding(n)) = verdict else {
            return None;
        };
        self.head = head.saturating_add(n.max(1)).min(self.tail);
        let bytes = self.buf.get(head..self.head)?;
        Some(match verdict {
            Scan::Frame(_) => Piece::Frame(bytes),
            Scan::Padding(_) => Piece::Fill(bytes),
            _ => Piece::Noise(bytes),
        })
    }

    /// How many more bytes must come before [`next`](Self::next) can have a frame, once it had nothing: at least 1.
    pub(crate) fn need(&self, kind: ArmKind, expect: Expect) -> usize {
        let window = self.window();
        if window.is_empty() {
            return kind.shortest(expect).max(1);
        }
        let header = match kind.scan(window, expect) {
            Scan::Need(n) => n,
            _ => 0,
        };
        header.max(kind.shortest(expect).saturating_sub(window.len())).max(1)
    }

    /// The byte with which the next frame ends and the least that it has, as long as nothing is known of it but that.
    pub(crate) fn ending(&self, kind: ArmKind, expect: Expect) -> Option<(u8, usize)> {
        let mark = kind.end_mark(expect).filter(|_| self.pending() == 0)?;
        Some((mark, kind.shortest(expect)))
    }

    /// The bytes that are not decided on yet.
    pub(crate) fn window(&self) -> &[u8] {
        self.buf.get(self.head..self.tail).unwrap_or_default()
    }

    /// Where they begin.
    pub(crate) const fn head(&self) -> usize {
        self.head
    }

    /// The `len` bytes from `start` on, which [`next`](Self::next) has given since the last [`push`](Self::push).
    pub(crate) fn given(&self, start: usize, len: usize) -> &[u8] {
        self.buf.get(start..start.saturating_add(len)).unwrap_or_default()
    }

    /// How many these are.
    pub(crate) const fn pending(&self) -> usize {
        self.tail.saturating_sub(self.head)
    }

    pub(crate) const fn clear(&mut self) {
        (self.head, self.tail) = (0, 0);
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec::Vec;

    use armwire::alpha1::{
        Action, Address, Angle, Interval, Led, MoveTime, Offset, OffsetTool, Request, SERVOS, ServoRequest, Text,
        UsbType,
    };
    use armwire::dialect::Dialect;
    use armwire::ling::{self, GripperSpeed, Opening, Position, Speed, Stroke, TemperatureLimit, Torque};
    use armwire::time::Duration;

    use super::*;

    fn encoded<M: Messages>(messages: &M, request: &M::Request<'_>) -> Vec<u8> {
        let mut out = [0; MAX_FRAME];
        let n = messages.encode_request(request, &mut out).unwrap();
        out[..n].to_vec()
    }

    /// What is known of a request is what the protocol says of it.
    fn same_as<M: Messages>(kind: ArmKind, messages: &M, request: &M::Request<'_>, expect: Expect) {
        let bytes = encoded(messages, request);
        let (asked, info) = (kind.asked(&bytes), messages.request(&bytes).unwrap());
        let turnaround = |us: u32| Duration::from_micros(us.into());
        assert_eq!(
            asked.reply.map(|reply| turnaround(reply.turnaround)),
            info.response.map(|response| response.turnaround),
            "{request:?}"
        );
        // No longer one is received.
        let longest = info
            .response
            .map_or(0, |response| response.longest.min(MAX_FRAME as u16));
        assert!(
            asked.reply.is_none_or(|answer| u16::from(answer.len) >= longest),
            "{request:?}"
        );
        if let Expect::Responses(Some(ServoAnswer::Acknowledgement(_))) = expect {
            assert_eq!(asked.expect, expect, "{request:?}");
        } else {
            assert_eq!(asked.expect, UNASKED, "{request:?}");
        }
        assert!(kind.is_request(&bytes));
    }

    #[test]
    fn what_is_known_of_lings_requests_is_what_the_protocol_says() {
        use armwire::ling::Request::*;
        let target = ling::Move {
            joints: [(Position::CENTRE, Speed::MAX); 6],
            gripper: (Opening::CLOSED, GripperSpeed(0)),
        };
        let stroke = Stroke::Mm50;
        let limit = TemperatureLimit::new(60).unwrap();
        let requests = [
            ReadInfo,
            SetZero,
            SetStroke(stroke),
            ReadStroke,
            SetTorque(Torque::Off),
            SetTorque(Torque::On),
            ReadJoints,
            ReadTemperatures,
            SetTemperatureLimit(limit),
            ReadVelocities,
            Move(target),
            SelfCheck,
        ];
        for request in requests {
            same_as(ArmKind::Ling, &Ling, &request, UNASKED);
            let asked = ArmKind::Ling.asked(&encoded(&Ling, &request));
            assert_eq!(asked.moves, matches!(request, Move(_)), "{request:?}");
        }
        assert_eq!(ArmKind::Ling.poll().unwrap(), encoded(&Ling, &ReadJoints));
        assert_eq!(ArmKind::Ling.identify().unwrap(), encoded(&Ling, &ReadInfo));
        assert_eq!(
            ArmKind::Ling.torque_off().unwrap(),
            encoded(&Ling, &SetTorque(Torque::Off))
        );
        let moving = ArmKind::Ling.moving(&target, &mut [0; MAX_FRAME]);
        assert_eq!(moving, Some(encoded(&Ling, &Move(target)).len()));
    }

    #[test]
    fn what_is_known_of_alpha1s_requests_is_what_the_protocol_says() {
        let servo = ServoId::new(7).unwrap();
        let angle = Angle::new(90).unwrap();
        let (time, interval) = (MoveTime::new(5), Interval::new(9));
        let action = Action {
            angles: [Some(angle); SERVOS],
            time,
            interval,
        };
        let mut requests = Vec::from([
            Request::ReadHardwareVersion,
            Request::ReadServoStates,
            Request::Stop,
            Request::ReadFirmwareVersion,
            Request::Act(action),
            Request::SetOffsetTool(OffsetTool::Connect),
            Request::SetUsbType(UsbType::Hid),
            Request::Play(Text::new(b"dance").unwrap()),
            Request::Play(Text::new(b"").unwrap()),
        ]);
        for to in [Address::One(servo), Address::All] {
            requests.extend(
                [
                    ServoRequest::Move {
                        to,
                        angle,
                        time,
                        lock: interval,
                    },
                    ServoRequest::Release(to),
                    ServoRequest::SetLed { to, led: Led(1) },
                ]
                .map(Request::Servo),
            );
        }
        requests.extend(
            [
                ServoRequest::ReadAngles(servo),
                ServoRequest::ChangeId {
                    from: ServoId::new(1).unwrap(),
                    to: servo,
                },
                ServoRequest::SetOffset(servo, Offset::new(3).unwrap()),
                ServoRequest::ReadOffset(servo),
                ServoRequest::ReadVersion(servo),
            ]
            .map(Request::Servo),
        );
        for request in requests {
            let moves = matches!(request, Request::Act(_) | Request::Servo(ServoRequest::Move { .. }));
            let bytes = encoded(&Alpha1, &request);
            same_as(
                ArmKind::Alpha1,
                &Alpha1,
                &request,
                Alpha1.request(&bytes).unwrap().expect,
            );
            assert_eq!(ArmKind::Alpha1.asked(&bytes).moves, moves, "{request:?}");
            // Every answer has the same key: those of servos their id.
            let asked = ArmKind::Alpha1Servo.asked(&encoded(&Alpha1, &request));
            if let (Request::Servo(_), Some(_)) = (request, asked.reply) {
                let header = encoded(&Alpha1, &request)[0];
                let frame = [header, header.rotate_left(4), servo.get(), 0xAA, 0, 0, 0, 0, 0, 0xED];
                assert_eq!(
                    ArmKind::Alpha1Servo.key_of_answer(&frame),
                    Some(asked.key),
                    "{request:?}"
                );
                assert_eq!(
                    ArmKind::Alpha1Servo.key_of_answer(&[0xB1]).unwrap() == asked.key,
                    header == SERVO
                );
            }
        }
        assert_eq!(
            ArmKind::Alpha1.poll().unwrap(),
            encoded(&Alpha1, &Request::ReadServoStates)
        );
        assert_eq!(
            ArmKind::Alpha1.identify().unwrap(),
            encoded(&Alpha1, &Request::ReadFirmwareVersion)
        );
    }

    #[test]
    fn what_no_protocol_knows_is_given_the_time_of_a_question() {
        let asked = ArmKind::Ling.asked(&[0xAA, 0x77, 3, 0, 0, 0xFF]);
        assert_eq!(asked, Asked::answered(Key(0x77, 3), 50_000, 30));
        assert_eq!(ArmKind::Raw.asked(b"anything"), Asked::NOTHING);
    }

    #[test]
    fn a_raw_request_has_as_many_bytes_as_a_frame_may_have() {
        for (len, is_request) in [(0, false), (1, true), (MAX_FRAME, true), (MAX_FRAME + 1, false)] {
            let bytes = [7; MAX_FRAME + 1];
            assert_eq!(ArmKind::Raw.is_request(&bytes[..len]), is_request, "{len} bytes");
        }
    }

    #[test]
    fn zeros_between_frames_of_alpha1_are_no_noise() {
        let mut tap = Tap::new();
        assert!(tap.push(&[0, 0, 0xF2]).is_empty());
        assert_eq!(tap.next(ArmKind::Alpha1, UNASKED, false), Some(Piece::Fill(&[0, 0])));
        assert_eq!(tap.next(ArmKind::Alpha1, UNASKED, false), None);
    }

    #[test]
    fn what_a_tap_has_given_ends_where_what_it_has_not_decided_on_begins() {
        let mut tap = Tap::new();
        assert!(tap.push(&[&READ_JOINTS[..], &READ_INFO[..3]].concat()).is_empty());
        let frame = tap.next(ArmKind::Ling, UNASKED, false);
        assert_eq!(frame, Some(Piece::Frame(&READ_JOINTS)));
        assert_eq!(tap.given(0, tap.head()), READ_JOINTS);
        assert_eq!(tap.window(), &READ_INFO[..3]);
    }
}
