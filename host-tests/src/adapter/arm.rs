//! A virtual Ling arm whose answers identify their requests.

use std::collections::VecDeque;

use armwire::decoder::{Decoder, Kind};
use armwire::ling::{Frame, JOINTS, Ling, MAX_FRAME, MotionStatus};
use armwire_bridge::control::Initiator;

use super::byte_times;
use crate::random::Random;

/// Command and function of a request and of its answer.
pub(super) type Key = (u8, u8);

/// Requests that the arm answers within 50 ms, each with its [`Tag`].
pub(super) const QUERIES: [Key; 7] = [
    READ_JOINTS,
    (0x06, 0x02),
    (0x01, 0x00),
    (UNDOCUMENTED, 0),
    (UNDOCUMENTED, 1),
    (UNDOCUMENTED, 2),
    (UNDOCUMENTED, 3),
];

/// A command that no document explains: it may change the arm's goal.
pub(super) const UNDOCUMENTED: u8 = 0x77;

/// The request of the joints.
const READ_JOINTS: Key = (0x06, 0x00);

/// The request with a time limit of 500 ms.
pub(super) const SELF_CHECK: Key = (0xFE, 0x00);

/// Unsolicited frame for a pressed button. No host requests it in these runs.
const UNSOLICITED: Key = (0x04, 0x0E);

/// The request that switches the torque on or off.
pub(super) const TORQUE: Key = (0x05, 0x00);
const OFF: u8 = 0;

/// The maximum time from the last byte of a request to the last byte of its answer, in µs. Later answers are dropped,
/// as the adapter cannot distinguish them from the answers to newer requests.
const LATEST: u64 = 100_000;
/// The additional time of a self-check.
const CHECKING: u64 = 450_000;

/// The adapter's time limit for an answer, in µs. A later answer is late.
const PROMPT: u64 = 50_000;

/// Silence after which the arm discards an incomplete frame, in µs.
const PARTIAL_FRAME_TIMEOUT: u64 = 20_000;

/// The identity of a request, in the data of the request and of its answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Tag {
    pub(super) initiator: Initiator,
    /// Number of earlier requests of this initiator.
    pub(super) number: u32,
}

impl Tag {
    /// The tag of a reading of the joints, which has no room for one: only the adapter's own requests are answered by it.
    const OF_READING: Self = Self {
        initiator: Initiator::Poll,
        number: 0,
    };

    /// The tag of this initiator's next request, after this number of requests.
    pub(super) fn next(initiator: Initiator, requests: &mut u32) -> Self {
        *requests += 1;
        Self {
            initiator,
            number: *requests,
        }
    }

    /// The frame with this key and tag.
    pub(super) fn frame(self, key: Key) -> Vec<u8> {
        let [a, b, c, d] = self.number.to_le_bytes();
        frame(key, &[self.initiator as u8, a, b, c, d])
    }

    /// The key and the tag of a frame. `None` without a tag.
    pub(super) fn of(bytes: &[u8]) -> Option<(Key, Self)> {
        let &[0xAA, command, function, len, ref data @ .., _, 0xFF] = bytes else {
            return None;
        };
        if usize::from(len) != data.len() {
            return None;
        }
        let tag = match ((command, function), data.len()) {
            (READ_JOINTS, READING) => Self::OF_READING,
            _ => Self::from_data(data)?,
        };
        Some(((command, function), tag))
    }

    fn from_data(data: &[u8]) -> Option<Self> {
        let &[initiator, a, b, c, d] = data else { return None };
        let all = [
            Initiator::Usb,
            Initiator::Can,
            Initiator::Poll,
            Initiator::Command,
            Initiator::Adapter,
        ];
        let initiator = all.into_iter().find(|kind| *kind as u8 == initiator)?;
        let number = u32::from_le_bytes([a, b, c, d]);
        Some(Self { initiator, number })
    }
}

/// A Ling frame.
pub(super) fn frame((command, function): Key, data: &[u8]) -> Vec<u8> {
    let mut out = [0; MAX_FRAME];
    let frame = Frame {
        command,
        function,
        data,
    };
    let len = frame.encode(&mut out).expect("it is no longer than the longest");
    out[..len].to_vec()
}

/// The joints and the gripper in each reading of the adapter.
pub(super) const TICKS: u16 = 2_048;
pub(super) const GRIPPER: u16 = 310;

/// The length of a reading. Another is of another robot.
const READING: usize = 2 * (JOINTS + 1) + 1;

/// The answer to a reading of the joints by the adapter.
fn reading(is_holding: bool) -> Vec<u8> {
    let status = if is_holding {
        MotionStatus::Locked
    } else {
        MotionStatus::Idle
    };
    let values = [TICKS; JOINTS].into_iter().chain([GRIPPER]);
    let data: Vec<u8> = values.flat_map(u16::to_le_bytes).chain([status.into()]).collect();
    frame(READ_JOINTS, &data)
}

/// The arm's answering behaviour.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Behavior {
    /// The maximum delay of an answer, in µs. Each answer has a random delay up to this.
    pub(super) slowest: u64,
    /// Percentage of lost answers.
    pub(super) lost: u64,
    /// The maximum delay of the answer to a self-check, in µs. `None` without an answer.
    pub(super) self_check: Option<u64>,
}

/// Bytes sent together by the arm.
#[derive(Clone, Debug)]
struct Transmission {
    /// The end of the last byte on the line.
    end: u64,
    bytes: Vec<u8>,
}

pub(super) struct Arm {
    behavior: Behavior,
    decoder: Decoder<Ling, MAX_FRAME>,
    /// A second arm on the same line, which never discards an incomplete frame: torque-off must reach it as well.
    without_timeout: Decoder<Ling, MAX_FRAME>,
    /// The time at which an incomplete frame is discarded.
    partial_frame_timeout: Option<u64>,
    tx_queue: VecDeque<Transmission>,
    /// The torque is on.
    is_holding: bool,
    /// Number of identity requests of the adapter.
    identified: u32,
    /// An answer ended more than [`PROMPT`] after the last byte of its request.
    pub(super) has_answered_late: bool,
}

impl Arm {
    /// An arm with this behaviour.
    pub(super) fn new(behavior: Behavior) -> Self {
        Self {
            behavior,
            decoder: Decoder::new(),
            without_timeout: Decoder::new(),
            partial_frame_timeout: None,
            tx_queue: VecDeque::new(),
            is_holding: true,
            identified: 0,
            has_answered_late: false,
        }
    }

    /// Receives bytes at the arm's rate. The first starts at `start`. Returns true for torque-off.
    pub(super) fn on_bytes(&mut self, bytes: &[u8], start: u64, random: &mut Random) -> bool {
        let end = start + byte_times(bytes.len());
        self.partial_frame_timeout = Some(end + PARTIAL_FRAME_TIMEOUT);
        let mut rest = bytes;
        while !rest.is_empty() {
            rest = self.decoder.push(rest);
            let behind = rest.len();
            self.answer_all(end, behind, LATEST, random);
        }
        let mut is_torque_off = false;
        let mut rest = bytes;
        while !rest.is_empty() {
            rest = self.without_timeout.push(rest);
            while let Some(item) = self.without_timeout.next(&Ling, ()) {
                let frame = Frame::parse(item.bytes).filter(|_| item.kind == Kind::Frame);
                let Some(frame) = frame.filter(|frame| (frame.command, frame.function) == TORQUE) else {
                    continue;
                };
                self.is_holding = frame.data != [OFF];
                is_torque_off |= !self.is_holding;
            }
        }
        is_torque_off
    }

    /// The time of the next [`tick`](Self::tick) or [`transmit`](Self::transmit).
    pub(super) fn timeout(&self) -> Option<u64> {
        let next_tx = self.tx_queue.front().map(|transmission| transmission.end);
        [next_tx, self.partial_frame_timeout].into_iter().flatten().min()
    }

    /// Discards an incomplete frame after silence on the line.
    pub(super) fn tick(&mut self, now: u64, random: &mut Random) {
        let Some(quiet) = self.partial_frame_timeout.take_if(|at| *at <= now) else {
            return;
        };
        self.decoder.idle();
        // Frames within the discarded bytes are received now. Their answers are as early as without the delay.
        self.answer_all(quiet, 0, LATEST - PARTIAL_FRAME_TIMEOUT, random);
    }

    /// The next bytes that are on the line by `now`, and the end of the last of them.
    pub(super) fn transmit(&mut self, now: u64) -> Option<(u64, Vec<u8>)> {
        let transmission = self.tx_queue.pop_front_if(|transmission| transmission.end <= now)?;
        Some((transmission.end, transmission.bytes))
    }

    /// True if bytes are queued.
    pub(super) fn is_sending(&self) -> bool {
        !self.tx_queue.is_empty()
    }

    /// Sends an unsolicited frame.
    pub(super) fn send_unsolicited(&mut self, now: u64) {
        self.send(now, frame(UNSOLICITED, &[2]));
    }

    /// Answers frames received by `end`, with `behind` further bytes not yet decoded.
    fn answer_all(&mut self, end: u64, behind: usize, latest: u64, random: &mut Random) {
        while let Some(item) = self.decoder.next(&Ling, ()) {
            let Some(frame) = Frame::parse(item.bytes).filter(|_| item.kind == Kind::Frame) else {
                continue;
            };
            let key = (frame.command, frame.function);
            let tag = match frame.data {
                [0xFE] if key == READ_JOINTS => Some(Tag::OF_READING),
                [0xFE] if key == (0x01, 0x00) => Some(Tag::next(Initiator::Adapter, &mut self.identified)),
                data if QUERIES.contains(&key) || key == SELF_CHECK => Tag::from_data(data),
                _ => None,
            };
            if let Some(tag) = tag {
                let behind = behind + self.decoder.pending();
                let requested = end - byte_times(behind).min(end);
                self.answer(key, tag, requested, latest, random);
            }
        }
    }

    /// Answers a request whose last byte arrived at `requested`.
    fn answer(&mut self, key: Key, tag: Tag, requested: u64, latest: u64, random: &mut Random) {
        let (slowest, latest, prompt) = match (key, self.behavior.self_check) {
            (SELF_CHECK, None) => return,
            (SELF_CHECK, Some(slowest)) => (slowest, latest + CHECKING, PROMPT + CHECKING),
            _ => (self.behavior.slowest, latest, PROMPT),
        };
        if random.percent(self.behavior.lost) {
            return;
        }
        let bytes = match tag.initiator {
            Initiator::Poll => reading(self.is_holding),
            _ => tag.frame(key),
        };
        let begin = self.tx_queue.back().map_or(0, |last| last.end);
        let begin = begin.max(requested + random.between(0, slowest));
        let end = begin + byte_times(bytes.len());
        if end > requested + latest {
            return;
        }
        self.tx_queue.push_back(Transmission { end, bytes });
        self.has_answered_late |= end > requested + prompt;
    }

    /// Queues bytes at the first free place on the line.
    fn send(&mut self, now: u64, bytes: Vec<u8>) {
        let takes = byte_times(bytes.len());
        let mut end = now + takes;
        let mut place = 0;
        for transmission in &self.tx_queue {
            let begin = transmission.end - byte_times(transmission.bytes.len());
            if end <= begin {
                break;
            }
            end = end.max(transmission.end + takes);
            place += 1;
        }
        self.tx_queue.insert(place, Transmission { end, bytes });
    }
}
