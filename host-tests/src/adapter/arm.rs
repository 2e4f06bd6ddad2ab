//! A virtual Ling arm whose answers say which request they answer.

use std::collections::VecDeque;

use armwire::decoder::{Decoder, Kind};
use armwire::ling::{Frame, Ling, MAX_FRAME};
use armwire_bridge::control::Initiator;

use super::byte_times;
use crate::random::Random;

/// Command and function of a request: its answer has the same.
pub(super) type Key = (u8, u8);

/// Requests of which the arm answers each with its [`Tag`] within 50 ms.
pub(super) const QUERIES: [Key; 7] = [
    (0x06, 0x00),
    (0x06, 0x02),
    (0x01, 0x00),
    (0x77, 0),
    (0x77, 1),
    (0x77, 2),
    (0x77, 3),
];

/// The request that the arm has 500 ms for.
pub(super) const SELF_CHECK: Key = (0xFE, 0x00);

/// What the arm says unasked when somebody presses its button. Nobody asks for it in these runs.
const UNASKED: Key = (0x04, 0x0E);

/// The request that switches the torque on or off.
pub(super) const TORQUE: Key = (0x05, 0x00);
const OFF: u8 = 0;

/// The longest time from the last byte of a request to the last byte of its answer, in µs: an answer that would be later is
/// lost. The adapter tells later ones from those to newer requests no more.
const LATEST: u64 = 100_000;

/// How long the line must be quiet for the arm to give half a frame up, in µs.
const PARTIAL_FRAME_TIMEOUT: u64 = 20_000;

/// Names a request: it is in the data of the request and of its answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Tag {
    /// Who asks.
    pub(super) initiator: Initiator,
    /// How many that initiator had asked before.
    pub(super) number: u32,
}

impl Tag {
    /// The frame of this key that carries it.
    pub(super) fn frame(self, key: Key) -> Vec<u8> {
        let [a, b, c, d] = self.number.to_le_bytes();
        frame(key, &[self.initiator as u8, a, b, c, d])
    }

    /// The key and the tag of a frame. `None` if it has no tag.
    pub(super) fn of(bytes: &[u8]) -> Option<(Key, Self)> {
        let &[0xAA, command, function, 5, initiator, a, b, c, d, _, 0xFF] = bytes else {
            return None;
        };
        let tag = Self::from_data(&[initiator, a, b, c, d])?;
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

/// How the arm answers.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Behavior {
    /// The longest that it thinks, in µs. Each answer takes any time up to this.
    pub(super) slowest: u64,
    /// How many of a hundred answers are lost.
    pub(super) lost: u64,
    /// Whether it answers self-checks.
    pub(super) checks_itself: bool,
}

/// Bytes of the arm.
#[derive(Clone, Debug)]
struct Transmission {
    /// When the last of them is on the line.
    end: u64,
    bytes: Vec<u8>,
}

/// What the arm heard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ArmEvent {
    /// A request for an answer, of which it gives one so late, `None` for never.
    Request(Option<u64>),
    /// Torque-off.
    TorqueOff,
}

/// The arm.
pub(super) struct Arm {
    behavior: Behavior,
    decoder: Decoder<MAX_FRAME>,
    /// Another arm at the same line, which never gives half a frame up: torque-off must reach it all the same.
    without_timeout: Decoder<MAX_FRAME>,
    /// When it gives half a frame up.
    partial_frame_timeout: Option<u64>,
    tx_queue: VecDeque<Transmission>,
    /// How often the adapter has asked for the joints, and what arm it is.
    polls: u32,
    identified: u32,
}

impl Arm {
    /// One that answers like this.
    pub(super) fn new(behavior: Behavior) -> Self {
        Self {
            behavior,
            decoder: Decoder::new(),
            without_timeout: Decoder::new(),
            partial_frame_timeout: None,
            tx_queue: VecDeque::new(),
            polls: 0,
            identified: 0,
        }
    }

    /// Hears bytes at its own rate, the first of which starts at `start`.
    pub(super) fn on_bytes(&mut self, bytes: &[u8], start: u64, random: &mut Random, events: &mut Vec<ArmEvent>) {
        let end = start + byte_times(bytes.len());
        self.partial_frame_timeout = Some(end + PARTIAL_FRAME_TIMEOUT);
        let mut rest = bytes;
        while !rest.is_empty() {
            rest = self.decoder.push(rest);
            let behind = rest.len();
            self.answer_all(end, behind, LATEST, random, events);
        }
        let mut rest = bytes;
        while !rest.is_empty() {
            rest = self.without_timeout.push(rest);
            while let Some(item) = self.without_timeout.next(&Ling, ()) {
                let frame = Frame::parse(item.bytes).filter(|_| item.kind == Kind::Frame);
                if frame.is_some_and(|frame| (frame.command, frame.function) == TORQUE && frame.data == [OFF]) {
                    events.push(ArmEvent::TorqueOff);
                }
            }
        }
    }

    /// When [`tick`](Self::tick) or [`transmit`](Self::transmit) has something to do.
    pub(super) fn timeout(&self) -> Option<u64> {
        let next_tx = self.tx_queue.front().map(|transmission| transmission.end);
        [next_tx, self.partial_frame_timeout].into_iter().flatten().min()
    }

    /// Gives half a frame up when the line has been quiet.
    pub(super) fn tick(&mut self, now: u64, random: &mut Random, events: &mut Vec<ArmEvent>) {
        let Some(quiet) = self.partial_frame_timeout.take_if(|at| *at <= now) else {
            return;
        };
        self.decoder.idle();
        // What seemed to be the rest of a frame is heard now, and answered as early as if it had been heard before.
        self.answer_all(quiet, 0, LATEST - PARTIAL_FRAME_TIMEOUT, random, events);
    }

    /// The next bytes that are on the line by `now`, and when the last of them was.
    pub(super) fn transmit(&mut self, now: u64) -> Option<(u64, Vec<u8>)> {
        let transmission = self.tx_queue.pop_front_if(|transmission| transmission.end <= now)?;
        Some((transmission.end, transmission.bytes))
    }

    /// Whether it has something left to say.
    pub(super) fn is_sending(&self) -> bool {
        !self.tx_queue.is_empty()
    }

    /// Says something that nobody asked for.
    pub(super) fn send_unasked(&mut self, now: u64) {
        self.send(now, frame(UNASKED, &[2]));
    }

    /// Answers what it has heard by `end`, when `behind` more bytes had come.
    fn answer_all(&mut self, end: u64, behind: usize, latest: u64, random: &mut Random, events: &mut Vec<ArmEvent>) {
        while let Some(item) = self.decoder.next(&Ling, ()) {
            let Some(Frame {
                command,
                function,
                data,
            }) = Frame::parse(item.bytes).filter(|_| item.kind == Kind::Frame)
            else {
                continue;
            };
            let key = (command, function);
            let answer = match data {
                [0xFE] if key == (0x06, 0x00) => {
                    self.polls += 1;
                    Tag {
                        initiator: Initiator::Poll,
                        number: self.polls,
                    }
                    .frame(key)
                }
                [0xFE] if key == (0x01, 0x00) => {
                    self.identified += 1;
                    Tag {
                        initiator: Initiator::Adapter,
                        number: self.identified,
                    }
                    .frame(key)
                }
                data if QUERIES.contains(&key) || key == SELF_CHECK => match Tag::from_data(data) {
                    Some(tag) => tag.frame(key),
                    None => continue,
                },
                _ => continue,
            };
            let behind = behind + self.decoder.pending();
            let asked = end - byte_times(behind).min(end);
            let delay = self.answer(key, answer, asked, latest, random);
            events.push(ArmEvent::Request(delay));
        }
    }

    /// Answers a request whose last byte was heard at `asked`, and returns how long after that, unless it does not.
    fn answer(&mut self, key: Key, answer: Vec<u8>, asked: u64, latest: u64, random: &mut Random) -> Option<u64> {
        let slowest = match key {
            SELF_CHECK if !self.behavior.checks_itself => return None,
            _ => self.behavior.slowest,
        };
        if random.percent(self.behavior.lost) {
            return None;
        }
        let begin = self.tx_queue.back().map_or(0, |last| last.end);
        let begin = begin.max(asked + random.between(0, slowest));
        let end = begin + byte_times(answer.len());
        if end > asked + latest {
            return None;
        }
        self.tx_queue.push_back(Transmission { end, bytes: answer });
        Some(end - asked)
    }

    /// Puts bytes where the line is free first.
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
