//! The promises of an adapter, from `docs/safety.md` and from the documentation of `armwire-bridge` on the sharing of
//! the arm.
//!
//! The oracle sees the inputs and outputs of the adapter with their times. If the documents leave an instant open, such
//! as the order of simultaneous events, the oracle allows each case.

use std::collections::{BTreeMap, VecDeque};
use std::ops::Range;

use armwire::decoder::{Decoder, Kind};
use armwire::framing::LONGEST_VOID;
use armwire::ling::{JOINTS, Ling, MAX_FRAME, Request};
use armwire::messages::Messages;
use armwire_bridge::Counters;
use armwire_bridge::config::{Config, Poll};
use armwire_bridge::control::{Event, Failure, Initiator, Refusal, Reply, STOP_MS};

use super::arm::{GRIPPER, Key, SELF_CHECK, TICKS, Tag, UNDOCUMENTED};

/// Time limit from the host timeout to torque-off on the line, in µs.
const TORQUE_OFF_BOUND: u64 = 150_000;
/// Minimum timeout of a host on CAN with a waiting motion, in µs.
const MOTION_WAIT: u64 = 150_000;
/// Tolerance of instants that the documents do not distinguish: a frame on the line at 1 Mbaud.
const INSTANT: u64 = 1_000;
/// The hosts, in the order of their streams.
const HOSTS: [Initiator; 3] = [Initiator::Usb, Initiator::Can, Initiator::Command];
/// Consecutive motions that form a stream.
const STREAM: u32 = 3;

/// Time limit of the arm for an answer, and for the answer to a self-check.
const TURNAROUND: u64 = 50_000;
const SELF_CHECK_TURNAROUND: u64 = 500_000;
/// Stale window: the time for which an answer may be late, and the next request of its kind waits.
const STALE_WINDOW: u64 = 50_000;
/// Time after the turn of another initiator in which the host on USB shares the line.
const SHARED_TIME: u64 = 1_000_000;
/// Maximum wait of others for a host on USB whose bytes form no frame, and tolerance for the answers and for the polls
/// of the line.
const RAW_TURN: u64 = 100_000;
/// Maximum pause of a host on USB within a frame before it loses its turn.
const PAUSE: u64 = 10_000;
const SLACK: u64 = 10_000;

/// Time limit for the end of a host's rate, after the bytes written before its port was closed.
const RATE_BOUND: u64 = 250_000;
/// Maximum duration of the bytes of the host on USB at 2400 baud.
const SLOWEST: u64 = 3_000_000;

/// Time without motion after a stop.
const REFUSAL: u64 = STOP_MS as u64 * 1_000;

/// The adapter's own requests.
const READ_JOINTS: [u8; 7] = [0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF];
const READ_INFO: [u8; 7] = [0xAA, 0x01, 0x00, 0x01, 0xFE, 0x23, 0xFF];
pub(super) const TORQUE_OFF: [u8; 7] = [0xAA, 0x05, 0x00, 0x01, 0x00, 0x6F, 0xFF];

/// State of a host's motion stream.
#[derive(Clone, Copy, Debug, Default)]
struct Stream {
    /// Consecutive motions that certainly count, and the times at which the last arrived and was sent.
    run: u32,
    received: u64,
    sent: u64,
    /// Motions since the stream last ended, including uncertain ones.
    possible_run: u32,
    /// The last possible sign of life, the last certain one, and the last motion that was accepted.
    last_sign: u64,
    last_certain_sign: u64,
    last_accepted: u64,
}

impl Stream {
    /// A motion received at `received` was sent at `sent`.
    fn on_motion(&mut self, received: u64, sent: u64, after: u64) {
        let is_close = |gap: u64| gap + 2 * INSTANT < after;
        let goes_on = self.run > 0 && is_close(received - self.received) && is_close(sent.saturating_sub(self.sent));
        self.run = match self.run {
            // A stream is ended only by its host.
            STREAM.. => STREAM,
            run if goes_on => run + 1,
            _ => 1,
        };
        (self.received, self.sent) = (received, sent);
        self.last_sign = self.last_sign.max(sent);
        self.last_certain_sign = self.last_certain_sign.max(received);
    }

    /// The host is certainly alive at `now`.
    fn on_sign(&mut self, now: u64) {
        (self.last_sign, self.last_certain_sign) = (now, now);
    }

    /// A motion was accepted at `now`.
    fn on_accepted(&mut self, now: u64) {
        self.on_sign(now);
        self.last_accepted = now;
    }

    /// Returns true if a stream has lived for longer than the host timeout without an accepted motion.
    fn outlives(&self, timeout: u64, now: u64) -> bool {
        self.run >= STREAM && now > self.last_accepted + timeout + INSTANT
    }

    fn end(&mut self) {
        (self.run, self.possible_run) = (0, 0);
    }
}

/// State derived from the inputs and outputs of one adapter.
#[derive(Default)]
pub(super) struct Oracle {
    config: Config,
    streams: [Stream; 3],
    /// Time limit for torque-off on the line, and number of reasons for it.
    torque_off_due: Option<u64>,
    torque_offs_due: u32,
    /// A restart of the adapter was requested, or is imminent.
    is_ending: bool,

    /// Bytes of the host on USB not yet on the line, the incomplete request on the line, and true if the last bytes on
    /// the line form no request.
    usb: VecDeque<u8>,
    usb_requests: Decoder<Ling, MAX_FRAME>,
    is_usb_raw: bool,
    /// The line had another rate since the last zeros.
    was_other_rate: bool,
    /// PDUs of hosts on CAN not yet on the line, each with its arrival time.
    can: VecDeque<(u64, Vec<u8>)>,
    /// The newest command, with its arrival time.
    command: Option<(u64, Vec<u8>)>,
    is_identifying: bool,

    /// Time limit of the arm for all answers; duration of the longest answer on the line, at a rate other than the
    /// arm's; and the maximum of these durations over all open requests.
    answers_until: u64,
    answer_time: u64,
    slowest_answer: u64,
    is_checking: bool,
    /// Time of the last activity on the line, and start of the current wait.
    last_activity: u64,
    waiting_since: Option<u64>,
    /// Period of the polls at a fixed rate, and the time of the last poll, or the last time at which the host on USB
    /// had the line alone.
    poll_period: Option<u64>,
    last_poll: u64,
    /// Maximum number of requests of the host on USB in flight, the pending answers, and the last request of each kind
    /// and host.
    pub(super) most_in_flight: usize,
    pending_answers: Vec<PendingAnswer>,
    last: BTreeMap<(u8, Key), u32>,
    /// The last turn of an initiator other than the host on USB, and the end of the wait of others for untracked
    /// requests of that host.
    last_other_turn: Option<u64>,
    pub(super) untracked_until: u64,
    /// The request of another initiator that the arm's last frame answers in time.
    timely_answer: Option<Tag>,
    /// The line has the arm's rate; the host on USB requests it; torque-off has revoked another rate.
    at_arms_rate: bool,
    wants_arms_rate: bool,
    is_revoked: bool,
    is_dtr_high: bool,
    /// Bytes for another rate are not sent yet, or the line still has that rate.
    is_other_rate_pending: bool,
    /// Time limit for the arm's rate after the port was closed; true if the change waits for queued bytes.
    rate_ends: Option<u64>,
    is_rate_ending: bool,
    /// The line is reserved by request.
    is_reserved: bool,
    pub(super) may_be_reserved: bool,
    /// Conditions met, for [`Conditions`](super::Conditions).
    pub(super) open_self_check: bool,
    pub(super) half_frame: bool,
    /// The number of zeros that must follow those on the line.
    zeros_due: usize,
    pub(super) torque_offs: u32,
    pub(super) stream_without_room: bool,
    pub(super) stream_without_speed: bool,
    usb_last_sent: u64,

    /// The end of the refusal of motion after a stop.
    stopped_until: Option<u64>,
    /// The time of the first stop without a reply, and the number of holds before it.
    unanswered_stop: (u64, u32),
    /// A stop that is about to be requested is the first, and a stop was done.
    is_stop_new: bool,
    is_stop_done: bool,
    /// Bytes of the host on USB that wait for the rest of their request, and the number of those that were sent.
    gate: Vec<u8>,
    gate_sent: usize,
    /// Requests refused because of a stop, holds since the first stop in force, and all holds.
    refused_stopped: u32,
    holds_since: u32,
    pub(super) holds: u32,
    /// The gripper's goal in the last motion on the line, and true if the adapter may have forgotten it: by a request in a
    /// stop, or by a stop that failed.
    goal: Option<u16>,
    is_goal_unsure: bool,

    line_bytes: u64,
    arm_bytes: u64,
    pub(super) usb_bytes: u64,
    for_others: u64,
    frames: u32,
    wanted: u32,
    pub(super) host_timeouts: u32,
    can_answers: u32,
    can_received: u32,
    /// Another node sent flow control in place of the host.
    pub(super) is_can_disturbed: bool,
    control_requests: u32,
    control_replies: u32,
}

/// An answer that the arm has yet to send.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct PendingAnswer {
    key: Key,
    tag: Tag,
    due: u64,
    /// The answer may match a later request, which could not be delayed.
    is_ambiguous: bool,
}

/// The effect of a host's request.
enum Effect {
    /// An answer.
    Answer(Key, Option<Tag>),
    Motion,
    TorqueOn,
    Nothing,
}

/// The effect of a frame, from the arm's manual.
fn effect_of(frame: &[u8]) -> Effect {
    match frame {
        [_, 0x06, 0x03, ..] => Effect::Motion,
        [_, 0x05, 0x00, _, 1, ..] => Effect::TorqueOn,
        [_, 0x03 | 0x05, ..] => Effect::Nothing,
        [_, command, function, ..] => Effect::Answer((*command, *function), Tag::of(frame).map(|(_, tag)| tag)),
        _ => Effect::Nothing,
    }
}

/// True for the adapter's own requests.
const fn is_own(initiator: Initiator) -> bool {
    matches!(initiator, Initiator::Poll | Initiator::Adapter)
}

/// The tag's initiator of the arm's answers to this initiator: a stop reads the joints by the request of a poll.
fn asker(initiator: Initiator, key: Key) -> Initiator {
    match (initiator, key) {
        (Initiator::Adapter, (0x06, 0x00)) => Initiator::Poll,
        _ => initiator,
    }
}

/// The gripper's goal in a move.
fn gripper_of(frame: &[u8]) -> Option<u16> {
    match Ling.parse_request(frame) {
        Ok(Request::Move(target)) => Some(target.gripper.0.per_mille()),
        _ => None,
    }
}

/// Time limit of the arm for the answer to a request with this key.
fn turnaround(key: Key) -> u64 {
    match key == SELF_CHECK {
        true => SELF_CHECK_TURNAROUND,
        false => TURNAROUND,
    }
}

impl Oracle {
    pub(super) fn new(config: Config) -> Self {
        Self {
            config,
            poll_period: match config.poll {
                Poll::Hertz(rate) => Some(1_000_000_u64.div_ceil(rate.into())),
                Poll::Off | Poll::Fastest => None,
            },
            at_arms_rate: true,
            wants_arms_rate: true,
            ..Self::default()
        }
    }

    /// The stream of a host. `None` for the adapter itself.
    fn stream(&mut self, initiator: Initiator) -> Option<&mut Stream> {
        let at = HOSTS.iter().position(|host| *host == initiator)?;
        Some(&mut self.streams[at])
    }

    fn after(&self) -> u64 {
        u64::from(self.config.host_timeout.after_ms) * 1_000
    }

    /// Checks that nothing due is missing at `now`.
    pub(super) fn check(&mut self, now: u64) {
        assert!(
            !std::mem::take(&mut self.is_stop_done) || self.holds_since + self.torque_offs + self.torque_offs_due > 0,
            "a stop is done at {now} µs without a hold"
        );
        for (initiator, stream) in HOSTS.into_iter().zip(self.streams) {
            let waits = if initiator == Initiator::Can { MOTION_WAIT } else { 0 };
            let due = stream.last_sign + self.after().max(waits);
            assert!(
                stream.run < STREAM || self.after() == 0 || now <= due + INSTANT,
                "{initiator} has streamed no motion since {} µs, and no host timeout is reported at {now} µs",
                stream.last_sign
            );
        }
        assert!(
            self.torque_off_due.is_none_or(|due| now <= due),
            "torque-off was due at {:?} µs and is not on the line at {now} µs",
            self.torque_off_due
        );
        assert!(
            self.rate_ends.is_none_or(|due| now <= due),
            "the line has another rate at {now} µs, and the port is closed"
        );
        if self.is_reserved || self.is_other_rate_pending || !self.at_arms_rate || !self.wants_arms_rate {
            self.last_poll = now;
        }
        let polls = self.poll_period.is_some_and(|period| now > self.last_poll + period);
        let is_waiting = !self.usb.is_empty() || !self.can.is_empty() || self.is_identifying || polls;
        match (is_waiting, self.waiting_since) {
            (false, _) => self.waiting_since = None,
            (true, None) => self.waiting_since = Some(now),
            (true, Some(since)) => {
                let slow = if self.at_arms_rate { 0 } else { SLOWEST };
                let from = self.answers_until.max(self.last_activity).max(since);
                let until = from + STALE_WINDOW + RAW_TURN + SLACK + slow;
                assert!(
                    now <= until,
                    "the line is blocked at {now} µs: no activity since {} µs, answers were due at {} µs, an initiator has \
                     waited since {since} µs",
                    self.last_activity,
                    self.answers_until
                );
            }
        }
    }

    // ---- Inputs ----

    pub(super) fn on_usb_accepted(&mut self, now: u64, packet: &[u8]) {
        match self.stopped_until {
            Some(_) => self.pass_gate(packet),
            None => self.usb.extend(packet),
        }
        (self.rate_ends, self.is_rate_ending) = (None, false);
        self.is_other_rate_pending |= !self.wants_arms_rate;
        // Bytes at another rate are no sign of life, and a reserved line has no host timeout.
        if self.wants_arms_rate && !self.is_reserved {
            self.streams[0].on_sign(now);
        }
    }

    /// A packet of `len` bytes was refused, and `counted` bytes were counted.
    pub(super) fn on_usb_refused(&mut self, now: u64, len: usize, counted: usize) {
        assert_eq!(counted, len, "bytes that were refused because of their rate");
        let streams = self.streams[1..].iter().any(|stream| stream.possible_run >= STREAM);
        assert!(
            !self.wants_arms_rate || self.is_revoked,
            "bytes at the arm's rate are refused at {now} µs"
        );
        assert!(
            streams || self.is_revoked || self.stopped_until.is_some(),
            "no stream on CAN keeps another rate away at {now} µs"
        );
    }

    /// Torque-off revoked the rate of the host on USB, and `counted` of its bytes were dropped.
    pub(super) fn on_usb_dropped(&mut self, counted: usize) {
        let waiting = self.usb.len() + self.gate.len() - self.gate_sent;
        assert_eq!(counted, waiting, "bytes that waited at another rate");
        self.usb.clear();
        self.gate.clear();
        self.gate_sent = 0;
        self.is_other_rate_pending = false;
        self.usb_requests = Decoder::new();
    }

    /// The host on USB set a rate.
    pub(super) fn on_rate_requested(&mut self, is_arms: bool) {
        (self.wants_arms_rate, self.is_revoked) = (is_arms, false);
    }

    /// The host on USB raised or lowered DTR.
    pub(super) fn on_dtr(&mut self, now: u64, high: bool, byte_nanos: u64) {
        let is_closed = std::mem::replace(&mut self.is_dtr_high, high) && !high;
        self.is_rate_ending |= is_closed && (self.is_other_rate_pending || !self.at_arms_rate);
        if is_closed && !self.at_arms_rate {
            // Queued bytes are sent first.
            let bytes = self.usb.len() + 2 * MAX_FRAME;
            self.rate_ends = Some(now + bytes as u64 * byte_nanos / 1_000 + RATE_BOUND);
        }
    }

    /// A requested reservation begins, or ends.
    pub(super) fn on_reservation(&mut self, is_reserved: bool) {
        assert!(
            !is_reserved || !self.is_armed(),
            "a reservation while a stream is armed"
        );
        self.is_reserved = is_reserved;
    }

    pub(super) fn on_reservation_refused(&self, is_stopping: bool) {
        let streams = self.streams.iter().any(|stream| stream.possible_run >= STREAM);
        assert!(
            streams || self.torque_offs_due > 0 || is_stopping && self.stopped_until.is_some(),
            "a reservation is refused without a motion stream or a stop"
        );
    }

    // ---- Stops ----

    /// A stop is about to be requested. With `joins`, an earlier one has no reply yet.
    pub(super) fn on_stop_request(&mut self, now: u64, joins: bool) {
        if self.is_reserved {
            return;
        }
        if self.stopped_until.is_none() {
            self.holds_since = 0;
        }
        if !joins {
            self.unanswered_stop = (now, self.holds);
        }
        self.is_stop_new = self.stopped_until.is_none();
        self.is_goal_unsure |= !self.is_stop_new;
        self.stopped_until = Some(now + REFUSAL);
    }

    /// A stop was requested. Bytes for another rate were dropped before.
    pub(super) fn on_stop(&mut self) {
        self.is_revoked |= !self.wants_arms_rate && self.stopped_until.is_some();
        if !std::mem::take(&mut self.is_stop_new) {
            return;
        }
        self.streams.iter_mut().for_each(Stream::end);
        // A request that was sent in part is cut.
        self.half_frame |= self.usb_requests.pending() > 0;
        // At another rate, in effect or pending, the host loses the line, and none of its bytes is a request.
        self.gate = match self.at_arms_rate && !self.is_other_rate_pending {
            true => self.usb_requests.window().to_vec(),
            false => Vec::new(),
        };
        self.gate_sent = self.gate.len();
        self.usb_requests = Decoder::new();
        self.is_usb_raw = false;
        let queued: Vec<u8> = self.usb.drain(..).collect();
        self.pass_gate(&queued);
    }

    /// Passes whole requests that are no motion, and bytes outside of requests.
    fn pass_gate(&mut self, bytes: &[u8]) {
        let mut decoder = Decoder::<_, MAX_FRAME>::new();
        self.gate.extend(bytes);
        let gated = std::mem::take(&mut self.gate);
        let mut rest = &gated[..];
        while !rest.is_empty() {
            rest = decoder.push(rest);
            while let Some(item) = decoder.next(&Ling, ()) {
                let sent = self.gate_sent.min(item.bytes.len());
                self.gate_sent -= sent;
                let is_frame = item.kind == Kind::Frame;
                if is_frame && (sent > 0 || matches!(effect_of(item.bytes), Effect::Motion)) {
                    self.refused_stopped += 1;
                } else {
                    self.usb.extend(&item.bytes[sent..]);
                }
            }
        }
        self.gate = decoder.window().to_vec();
    }

    /// Handles the end of the refusal of motion.
    pub(super) fn end_stop(&mut self, now: u64) {
        if self.stopped_until.take_if(|until| *until <= now).is_none() {
            return;
        }
        self.is_goal_unsure = true;
        match std::mem::take(&mut self.gate_sent) {
            0 => self.usb.extend(self.gate.drain(..)),
            _ => {
                self.refused_stopped += 1;
                self.gate.clear();
            }
        }
    }

    /// The adapter replied to a stop.
    pub(super) fn on_stop_reply(&mut self, now: u64, reply: &Reply) {
        match reply {
            // The hold that it reports is recorded behind it.
            Reply::Done => self.is_stop_done = true,
            Reply::Failed(Failure::LineReserved) => assert!(self.is_reserved, "the line is reserved at {now} µs"),
            Reply::Failed(Failure::ArmSilent) => {
                let (since, holds) = self.unanswered_stop;
                assert!(
                    self.holds == holds && now + INSTANT >= since + REFUSAL,
                    "a stop fails at {now} µs"
                );
            }
            reply => assert_eq!(*reply, Reply::Failed(Failure::Busy)),
        }
    }

    /// The adapter holds the arm.
    fn on_hold(&mut self, hold: &[u8], now: u64) {
        assert!(self.stopped_until.is_some(), "a hold at {now} µs without a stop");
        let Ok(Request::Move(hold)) = Ling.parse_request(hold) else {
            panic!("a hold is no move: {hold:02X?}");
        };
        let joints = hold.joints.map(|(position, _)| position.ticks());
        let gripper = hold.gripper.0.per_mille();
        let is_reading = self.is_goal_unsure && gripper == GRIPPER;
        let expected = self.goal.filter(|_| !is_reading).unwrap_or(GRIPPER);
        assert_eq!((joints, gripper), ([TICKS; JOINTS], expected), "the pose of a hold");
        self.goal = Some(gripper);
        self.holds_since += 1;
        self.holds += 1;
    }

    /// The host on USB has bytes to send, and the adapter has no room.
    pub(super) fn on_usb_blocked(&mut self, now: u64) {
        if self.at_arms_rate || self.wants_arms_rate || self.is_rate_ending {
            self.streams[0].last_sign = now;
        }
    }

    pub(super) fn on_can_accepted(&mut self, now: u64, pdu: Vec<u8>) {
        if matches!(effect_of(&pdu), Effect::Motion) {
            self.streams[1].on_accepted(now);
            self.streams[1].possible_run += 1;
        }
        self.can.push_back((now, pdu));
    }

    /// A PDU of a host on CAN was refused at `at` because there was no room.
    pub(super) fn on_can_without_room(&mut self, at: u64, pdu: &[u8]) {
        if matches!(effect_of(pdu), Effect::Motion) {
            self.streams[1].on_sign(at);
            let is_supervised = self.after() > 0;
            self.stream_without_room |= is_supervised && self.streams[1].outlives(self.after().max(MOTION_WAIT), at);
        }
    }

    pub(super) fn on_command_accepted(&mut self, now: u64, request: Vec<u8>) {
        self.streams[2].on_accepted(now);
        self.streams[2].possible_run += 1;
        self.command = Some((now, request));
    }

    /// A command was refused only for its speed.
    pub(super) fn on_command_without_speed(&mut self, now: u64) {
        self.streams[2].on_sign(now);
        let is_supervised = self.after() > 0;
        self.stream_without_speed |= is_supervised && self.streams[2].outlives(self.after(), now);
    }

    /// Polls are switched off.
    pub(super) fn on_polls_off(&mut self) {
        self.poll_period = None;
    }

    pub(super) fn on_control_request(&mut self, identifies: bool) {
        self.control_requests += 1;
        self.is_identifying |= identifies;
    }

    pub(super) fn on_control_reply(&mut self, identified: bool) {
        self.control_replies += 1;
        self.is_identifying &= !identified;
    }

    /// The host on USB has ended its stream on the control port.
    pub(super) fn on_end_stream(&mut self) {
        self.streams[0].end();
    }

    /// A restart of the adapter was requested, or is imminent.
    pub(super) fn on_restart_request(&mut self) {
        self.is_ending = true;
    }

    /// True if a host certainly streams motion, and its timeout would switch the torque off.
    pub(super) fn is_armed(&self) -> bool {
        let streams = self.streams.iter().any(|stream| stream.run >= STREAM);
        streams && self.config.host_timeout.torque_off && self.after() > 0
    }

    /// The adapter was blocked for `span`.
    pub(super) fn on_blocked(&mut self, now: u64, span: u64) {
        self.streams.iter_mut().for_each(|stream| stream.last_sign = now);
        self.last_activity = now;
        self.answers_until += span;
    }

    // ---- Outputs ----

    /// Bytes of this initiator are on the line in this span. Their last `untracked` requests are counted as
    /// untracked.
    pub(super) fn on_sent(&mut self, initiator: Initiator, bytes: &[u8], untracked: u32, now: u64, span: Range<u64>) {
        let Range { start, end } = span;
        self.line_bytes += bytes.len() as u64;
        assert!(
            initiator == Initiator::Usb || self.at_arms_rate,
            "{initiator} sends {bytes:02X?} at another rate than the arm's"
        );
        let is_alone = matches!(initiator, Initiator::Usb | Initiator::Adapter);
        assert!(
            is_alone || !self.is_reserved,
            "{initiator} sends {bytes:02X?} under a reservation"
        );
        assert!(
            self.zeros_due == 0 || initiator == Initiator::Adapter && bytes[0] == 0,
            "{initiator} sends {bytes:02X?} among the zeros at {now} µs"
        );
        self.last_activity = self.last_activity.max(end);
        if initiator != Initiator::Usb && bytes[0] != 0 {
            self.last_other_turn = Some(start);
        }
        self.answer_time = match self.at_arms_rate {
            true => 0,
            false => (end - start) * MAX_FRAME as u64 / bytes.len() as u64,
        };
        match initiator {
            Initiator::Usb => self.on_usb_sent(bytes, untracked, now, end),
            Initiator::Can => {
                let (received, sent_bytes) = self.can.pop_front().expect("no host on CAN has a request");
                assert_eq!(bytes, sent_bytes, "requests on CAN changed or reordered");
                self.on_request(initiator, bytes, received, now, end);
            }
            Initiator::Command => {
                let (received, command) = self.command.take().expect("no command is pending");
                assert_eq!(bytes, command, "the command was another");
                let timeout = u64::from(self.config.can.command_timeout_ms) * 1_000;
                assert!(
                    now <= received + timeout,
                    "a command of {received} µs is sent at {now} µs"
                );
                self.on_request(initiator, bytes, received, now, end);
            }
            Initiator::Poll => {
                assert_eq!(bytes, READ_JOINTS, "the adapter polls");
                self.last_poll = start;
                self.on_request(initiator, bytes, now, start, end);
            }
            Initiator::Adapter if bytes == READ_INFO => {
                assert!(self.is_identifying, "no identification is pending");
                self.on_request(initiator, bytes, now, now, end);
            }
            Initiator::Adapter if bytes == TORQUE_OFF => {
                assert!(
                    self.torque_offs_due > 0,
                    "torque-off at {now} µs, and no stream has ended"
                );
                self.torque_offs_due = 0;
                self.torque_offs += 1;
            }
            Initiator::Adapter if bytes == READ_JOINTS => {
                assert!(self.stopped_until.is_some(), "a reading at {now} µs without a stop");
                self.on_request(initiator, bytes, now, now, end);
            }
            Initiator::Adapter if matches!(effect_of(bytes), Effect::Motion) => self.on_hold(bytes, now),
            Initiator::Adapter => {
                assert!(bytes.iter().all(|byte| *byte == 0), "the adapter sends {bytes:02X?}");
                if self.zeros_due > 0 {
                    self.zeros_due -= bytes.len();
                    return;
                }
                self.zeros_due = LONGEST_VOID - bytes.len();
                self.half_frame |= self.usb_requests.pending() > 0;
                assert!(
                    self.half_frame || self.was_other_rate || self.host_timeouts > 0 || self.stopped_until.is_some(),
                    "zeros without an incomplete request of the host on USB"
                );
                (self.was_other_rate, self.is_usb_raw) = (false, false);
                self.usb_requests = Decoder::new();
            }
        }
    }

    fn on_request(&mut self, initiator: Initiator, frame: &[u8], received: u64, now: u64, end: u64) {
        let after = self.after();
        if matches!(effect_of(frame), Effect::Motion) {
            assert_eq!(
                self.stopped_until, None,
                "motion of {initiator} at {now} µs after a stop"
            );
            self.goal = gripper_of(frame).or(self.goal);
            self.is_goal_unsure = false;
        }
        match effect_of(frame) {
            Effect::Answer(key, tag) => {
                if key.0 == UNDOCUMENTED {
                    self.forget_goal();
                }
                if initiator != Initiator::Usb {
                    self.check_turn(initiator, key, now);
                }
                self.wanted += 1;
                self.is_checking |= key == SELF_CHECK;
                self.slowest_answer = self.slowest_answer.max(self.answer_time);
                self.answers_until = self.answers_until.max(end + self.turnaround() + self.answer_time);
                // The adapter's own requests have no number.
                let own = Tag {
                    initiator: asker(initiator, key),
                    number: 0,
                };
                let tag = tag.or_else(|| is_own(initiator).then_some(own));
                if let Some(tag) = tag {
                    self.pending_answers.push(PendingAnswer {
                        key,
                        tag,
                        due: end + turnaround(key),
                        is_ambiguous: false,
                    });
                    self.last.insert((initiator as u8, key), tag.number);
                }
                let of_usb = |pending: &&PendingAnswer| pending.tag.initiator == Initiator::Usb && now < pending.due;
                let in_flight = self.pending_answers.iter().filter(of_usb).count();
                self.most_in_flight = self.most_in_flight.max(in_flight);
            }
            // At another rate the arm receives no valid request, and a reserved line has no host timeout.
            Effect::Motion | Effect::TorqueOn if !self.at_arms_rate || self.is_reserved => {}
            Effect::Motion => {
                if let Some(stream) = self.stream(initiator) {
                    stream.possible_run += u32::from(initiator == Initiator::Usb);
                    stream.on_motion(received, now, after);
                }
            }
            Effect::TorqueOn => {
                if let Some(stream) = self.stream(initiator) {
                    stream.end();
                }
            }
            Effect::Nothing => {}
        }
    }

    /// The host on USB sends these bytes. Their last `untracked` requests are counted as untracked.
    fn on_usb_sent(&mut self, bytes: &[u8], untracked: u32, now: u64, end: u64) {
        let sent_bytes: Vec<u8> = self.usb.drain(..bytes.len().min(self.usb.len())).collect();
        assert_eq!(bytes, sent_bytes, "bytes of the host on USB changed");
        self.usb_last_sent = end;
        // An incomplete request is not delayed, and no arm answers at another rate.
        let is_free = self.is_usb_raw || self.usb_requests.pending() > 0 || !self.at_arms_rate;
        let is_shared = self.last_other_turn.is_some_and(|at| now + INSTANT < at + SHARED_TIME);
        let is_waited_for = self.can.front().is_some_and(|(received, _)| received + INSTANT < now);
        assert!(
            untracked == 0 || is_free || !is_shared && !is_waited_for,
            "{untracked} requests of the host on USB are not tracked at {now} µs, and others use the line"
        );
        let mut requests = Vec::new();
        let mut rest = bytes;
        while !rest.is_empty() {
            rest = self.usb_requests.push(rest);
            while let Some(item) = self.usb_requests.next(&Ling, ()) {
                self.is_usb_raw = item.kind != Kind::Frame;
                let frame = item.bytes.to_vec();
                let behind = (rest.len() + self.usb_requests.pending()) as u64;
                if !self.is_usb_raw {
                    requests.push((frame, end - (end - now) * behind / bytes.len() as u64));
                }
            }
        }
        for (nth, (frame, end)) in requests.iter().enumerate() {
            match effect_of(frame) {
                Effect::Answer(key, _) if is_free && nth == 0 => self.mark_ambiguous(key),
                Effect::Answer(key, _) => self.check_turn(Initiator::Usb, key, now),
                _ => {}
            }
            self.on_request(Initiator::Usb, frame, now, now, *end);
        }
        let wanted = requests.iter().rev().filter_map(|(frame, end)| match effect_of(frame) {
            Effect::Answer(key, _) => Some(end + turnaround(key) + STALE_WINDOW),
            _ => None,
        });
        let untracked_until = wanted.take(untracked as usize).max();
        self.untracked_until = self.untracked_until.max(untracked_until.unwrap_or(0));
    }

    /// A request of the host on USB with this key is sent in spite of pending answers.
    fn mark_ambiguous(&mut self, key: Key) {
        for pending in self.pending_answers.iter_mut().filter(|pending| pending.key == key) {
            pending.is_ambiguous = true;
        }
    }

    /// Checks that the answer to a request with this key, sent at `now`, differs from all pending ones.
    fn check_turn(&self, initiator: Initiator, key: Key, now: u64) {
        // The host on USB receives all its own answers.
        let is_usb_own = |by: Initiator| by == Initiator::Usb && initiator == Initiator::Usb;
        let may_come = self.pending_answers.iter().find(|pending| {
            pending.key == key
                && now < pending.due + STALE_WINDOW
                && !is_usb_own(pending.tag.initiator)
                && !pending.is_ambiguous
        });
        assert_eq!(
            may_come, None,
            "{initiator} sends a request with a pending answer at {now} µs"
        );
        assert!(
            initiator == Initiator::Usb || now >= self.untracked_until,
            "{initiator} sends a request at {now} µs, and untracked answers may arrive until {} µs",
            self.untracked_until
        );
    }

    /// The maximum time limit of the pending answers.
    fn turnaround(&self) -> u64 {
        match self.is_checking {
            true => SELF_CHECK_TURNAROUND,
            false => TURNAROUND,
        }
    }

    /// The arm received torque-off from any initiator.
    pub(super) fn on_torque_off(&mut self) {
        self.torque_off_due = None;
        self.forget_goal();
    }

    /// The arm may have another goal than that of the last motion. A stop has the goal of its begin.
    fn forget_goal(&mut self) {
        match self.stopped_until {
            None => self.goal = None,
            Some(_) => self.is_goal_unsure = true,
        }
    }

    pub(super) fn on_arm_sent(&mut self, now: u64, bytes: &[u8]) {
        self.arm_bytes += bytes.len() as u64;
        let Some((key, mut tag)) = Tag::of(bytes) else { return };
        if is_own(tag.initiator) {
            tag.number = 0;
        }
        // The adapter's own requests have no number: the answer belongs to the last.
        let answered = self
            .pending_answers
            .iter()
            .rposition(|pending| pending.key == key && pending.tag == tag)
            .map(|at| {
                // An arm answers in order: the overdue answers before this one do not come.
                let earlier = self.pending_answers.drain(..at).filter(|pending| now < pending.due);
                let earlier: Vec<_> = earlier.collect();
                let answered = self.pending_answers.remove(0);
                self.pending_answers.splice(0..0, earlier);
                answered
            });
        let is_in_time = answered.is_some_and(|pending| now <= pending.due && !pending.is_ambiguous);
        self.timely_answer = is_in_time.then_some(tag).filter(|tag| tag.initiator != Initiator::Usb);
        if answered.is_some() || is_own(tag.initiator) {
            // The time limit of the later answers starts now.
            self.answers_until = self.answers_until.max(now + self.turnaround() + self.slowest_answer);
        }
    }

    /// Handles time: requests whose answers would have arrived by now are no longer in flight.
    pub(super) fn tick(&mut self, now: u64) {
        self.half_frame |= self.usb_requests.pending() > 0 && now > self.usb_last_sent + PAUSE;
        if now > self.answers_until + STALE_WINDOW {
            self.open_self_check |= self.pending_answers.iter().any(|pending| pending.key == SELF_CHECK);
            self.pending_answers.clear();
            (self.is_checking, self.slowest_answer) = (false, 0);
        }
    }

    /// The rate of the line changed.
    pub(super) fn on_rate_changed(&mut self, now: u64, at_arms_rate: bool) {
        let streams = self.streams[1..].iter().any(|stream| stream.run >= STREAM);
        assert!(
            at_arms_rate || !streams,
            "another rate while a host on CAN streams motion"
        );
        (self.last_activity, self.at_arms_rate) = (now, at_arms_rate);
        self.zeros_due = 0;
        // Bytes before and after the change form no frame.
        self.half_frame |= self.usb_requests.pending() > 0;
        self.usb_requests = Decoder::new();
        self.was_other_rate |= !at_arms_rate;
        self.rate_ends.take_if(|_| at_arms_rate);
        self.is_rate_ending &= !at_arms_rate;
        self.is_other_rate_pending &= !at_arms_rate;
    }

    /// A host on CAN received a PDU.
    pub(super) fn on_can_received(&mut self, pdu: &[u8]) {
        self.can_received += 1;
        let tag = Tag::of(pdu).map(|(_, tag)| tag.initiator);
        assert_eq!(
            tag,
            Some(Initiator::Can),
            "a host on CAN received the answer for another host: {pdu:02X?}"
        );
    }

    /// A subscriber received an event. Returns true if the PDU of a host on CAN in transfer was refused.
    pub(super) fn on_event(&mut self, now: u64, at: u64, event: &Event) -> bool {
        match event {
            Event::Refused {
                initiator,
                reason: Refusal::LineReserved,
            } => {
                assert!(
                    self.is_reserved || self.may_be_reserved || self.is_other_rate_pending || !self.wants_arms_rate,
                    "{initiator} is refused at {now} µs, and the line is not reserved"
                );
                match initiator {
                    // A request accepted earlier is refused first.
                    Initiator::Can => return self.can.pop_front().is_none(),
                    Initiator::Command => drop(self.command.take()),
                    _ => {}
                }
            }
            Event::Refused {
                initiator,
                reason: Refusal::Stopped,
            } => {
                // A cut request ends with the stop.
                assert!(
                    self.stopped_until.is_some() || *initiator == Initiator::Usb,
                    "{initiator} is refused at {now} µs without a stop"
                );
                match initiator {
                    Initiator::Can => {
                        self.refused_stopped += 1;
                        // Waiting motion is refused first.
                        let is_motion = |(_, pdu): &(u64, Vec<u8>)| matches!(effect_of(pdu), Effect::Motion);
                        let waiting = self.can.iter().position(is_motion);
                        return waiting.and_then(|nth| self.can.remove(nth)).is_none();
                    }
                    Initiator::Command => {
                        self.refused_stopped += 1;
                        self.command = None;
                    }
                    _ => {}
                }
            }
            Event::Frame { initiator, bytes } => self.on_frame(*initiator, bytes),
            Event::HostSilent {
                initiator,
                dropped,
                torque_off,
            } => self.on_host_timeout(*initiator, (*dropped).into(), *torque_off, now, at),
            Event::Refused {
                initiator: Initiator::Can,
                ..
            } => return true,
            Event::Refused {
                initiator: Initiator::Command,
                reason: Refusal::Stale,
            } => {
                // The command was too old, or a repeat.
                let timeout = u64::from(self.config.can.command_timeout_ms) * 1_000;
                self.command.take_if(|(received, _)| now >= *received + timeout);
            }
            _ => {}
        }
        false
    }

    /// The adapter matched this frame to a request of `initiator`.
    fn on_frame(&mut self, initiator: Option<Initiator>, bytes: &[u8]) {
        self.frames += 1;
        if let Some(tag) = self.timely_answer.take() {
            let key = (bytes[1], bytes[2]);
            assert_eq!(
                initiator.map(|initiator| asker(initiator, key)),
                Some(tag.initiator),
                "an answer in time counts as late or unsolicited: {bytes:02X?}"
            );
        }
        let Some(initiator) = initiator else { return };
        if initiator != Initiator::Usb {
            self.for_others += bytes.len() as u64;
        }
        if initiator == Initiator::Can {
            self.can_answers += 1;
        }
        let Some((key, tag)) = Tag::of(bytes) else {
            panic!("{initiator} did not request {bytes:02X?}");
        };
        assert_eq!(
            tag.initiator,
            asker(initiator, key),
            "an answer goes to another: {bytes:02X?}"
        );
        if initiator == Initiator::Can {
            let last = self.last.get(&(initiator as u8, key)).copied();
            assert_eq!(
                last,
                Some(tag.number),
                "an answer to an earlier request on CAN is taken for a newer one's"
            );
        }
    }

    fn on_host_timeout(&mut self, initiator: Initiator, dropped: usize, torque_off: bool, now: u64, at: u64) {
        self.host_timeouts += 1;
        let stream = self.stream(initiator).expect("only a host has a timeout");
        let ended = *stream;
        stream.end();
        if !self.is_ending {
            assert!(
                ended.possible_run >= STREAM,
                "{initiator} streams nothing and is silent at {at} µs"
            );
            assert!(
                at + INSTANT >= ended.last_certain_sign + self.after(),
                "{initiator} is not silent at {at} µs: last activity at {} µs",
                ended.last_certain_sign
            );
        }
        assert_eq!(
            torque_off, self.config.host_timeout.torque_off,
            "torque-off at the host timeout"
        );
        if torque_off {
            self.is_revoked |= !self.wants_arms_rate;
            self.torque_offs_due += 1;
            self.torque_off_due.get_or_insert(now.max(at) + TORQUE_OFF_BOUND);
        }
        match initiator {
            Initiator::Usb => {
                assert_eq!(dropped, self.usb.len(), "bytes of the host on USB that are dropped");
                self.usb.clear();
                // Other initiators are served again if these bytes were for a rate that the host has given up.
                self.is_other_rate_pending &= !self.at_arms_rate || !self.wants_arms_rate;
                self.usb_requests = Decoder::new();
            }
            Initiator::Can => {
                let waiting: usize = self.can.iter().map(|(_, pdu)| pdu.len()).sum();
                assert_eq!(dropped, waiting, "bytes of hosts on CAN that are dropped");
                self.can.clear();
            }
            _ => {
                let waiting = self.command.take().map_or(0, |(_, command)| command.len());
                assert_eq!(dropped, waiting, "bytes of a command that is dropped");
            }
        }
    }

    /// True if no initiator waits.
    pub(super) fn is_idle(&self) -> bool {
        self.usb.is_empty()
            && self.can.is_empty()
            && self.control_requests == self.control_replies
            && self.pending_answers.is_empty()
    }

    pub(super) fn check_restart(&self, now: u64) {
        assert!(!self.is_armed(), "it restarts at {now} µs and forgets a stream");
        assert_eq!(self.torque_off_due, None, "it restarts at {now} µs with torque-off due");
    }

    /// Checks the totals at the end. The counts of requests are exact if the host on USB wrote complete requests only.
    pub(super) fn check_totals(&self, c: &Counters, is_whole: bool) {
        assert!(
            self.usb.is_empty(),
            "{} bytes of the host on USB are never sent",
            self.usb.len()
        );
        assert!(self.can.is_empty(), "requests on CAN are never sent: {:02X?}", self.can);
        assert_eq!(u64::from(c.host_to_arm_bytes), self.line_bytes, "bytes to the arm");
        assert_eq!(u64::from(c.arm_to_host_bytes), self.arm_bytes, "bytes of the arm");
        assert_eq!(c.refused_bytes, 0, "bytes that were taken without room");
        assert_eq!(c.host_silences, self.host_timeouts, "host timeouts");
        assert_eq!(c.refused_stopped, self.refused_stopped, "requests refused by a stop");
        assert_eq!(
            self.control_replies, self.control_requests,
            "requests on the control port"
        );
        if self.frames == c.frames {
            let lost = u64::from(c.dropped_bytes + c.undelivered_bytes);
            assert_eq!(
                self.usb_bytes + self.for_others + lost,
                self.arm_bytes,
                "bytes of the arm: {} at the host on USB, {} of others, {lost} counted as lost",
                self.usb_bytes,
                self.for_others
            );
            let gone = c.dropped_can_answers + c.isotp_failures;
            // After another node's flow control, the adapter may send before the host is ready.
            assert!(
                self.is_can_disturbed || (self.can_received..=self.can_received + gone).contains(&self.can_answers),
                "{} answers for CAN, {} received, {gone} counted as lost",
                self.can_answers,
                self.can_received
            );
        }
        let answered = c.frames - c.late_answers - c.unsolicited_frames;
        if is_whole {
            assert_eq!(
                answered + c.unanswered_requests + c.untracked_requests,
                self.wanted,
                "requests answered, unanswered or untracked"
            );
        }
    }
}
