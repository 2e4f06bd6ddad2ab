//! An arm whose answers identify their requests.

use std::collections::VecDeque;

use armwire::decoder::{Decoder, Kind};
use armwire::ling::{Frame, JOINTS, JointState, Ling, MAX_FRAME, MotionStatus, Response};
use armwire::messages::Messages;
use armwire_bridge::{Duration, Instant};
use armwire_sim::serial::SerialDevice;

use super::requests::encoded;

/// Command and function of the joint request. All [tickets](Ticket) have them too. Only the data identifies the
/// initiator.
const JOINTS_COMMAND: (u8, u8) = (0x06, 0x00);

/// Initiators of tickets: the host on USB, and the host on CAN.
pub(super) const USB: u8 = 0;
pub(super) const CAN: u8 = 1;

/// The data byte of the joint request itself.
const POLL_DATA: [u8; 1] = [0xFE];

/// Bytes of the answer to a ticket.
pub(super) const ANSWER_LEN: u32 = 15;

/// Bits of a number that fit in a joint.
const TICK_BITS: u32 = 12;

/// Silence after which the arm discards an incomplete frame: longer than the adapter allows a host to pause within a
/// request, shorter than its time limit for an answer. The value of a real arm is not known.
const PARTIAL_FRAME_TIMEOUT: Duration = Duration::from_millis(20);

/// A unique request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ticket {
    /// The initiator: 0 is the host on USB, 1 the host on CAN.
    pub initiator: u8,
    /// Number of earlier requests of this initiator.
    pub number: u32,
}

impl Ticket {
    /// The request frame.
    pub fn request(self) -> Vec<u8> {
        let [a, b, c, d] = self.number.to_le_bytes();
        frame(&[self.initiator, a, b, c, d])
    }

    /// The ticket of an answer, and the number of requests answered before. `None` for an answer without a ticket.
    pub fn of_answer(answer: &[u8]) -> Option<(Self, u32)> {
        let &[0xAA, 0x06, 0x00, 9, initiator, a, b, c, d, e, f, g, h, ..] = answer else {
            return None;
        };
        let number = u32::from_le_bytes([a, b, c, d]);
        Some((Self { initiator, number }, u32::from_le_bytes([e, f, g, h])))
    }
}

/// An arm that answers each [`Ticket`] with the ticket, and each joint request with the number of earlier joint
/// requests.
///
/// Other frames get no answer and are recorded.
#[derive(Debug)]
pub struct TicketArm {
    /// The delay of each answer.
    turnaround: Duration,
    /// True if the arm answers nothing.
    pub silent: bool,
    decoder: Decoder<Ling, MAX_FRAME>,
    /// The time at which an incomplete frame is discarded.
    idle_at: Option<Instant>,
    /// Bytes to send, each with its earliest time.
    tx_queue: VecDeque<(Instant, u8)>,
    /// Counts so far.
    pub counts: ArmCounts,
    others: Vec<Vec<u8>>,
}

/// Received and sent traffic of the arm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ArmCounts {
    /// Tickets received from the host on USB.
    pub tickets_usb: u32,
    /// Tickets received from the host on CAN.
    pub tickets_can: u32,
    /// Joint requests received.
    pub polls: u32,
    /// Tickets and joint requests answered.
    pub answers: u32,
    /// Bytes outside frames.
    pub noise_bytes: u32,
    /// Bytes received.
    pub bytes_received: u32,
    /// Bytes sent or queued.
    pub bytes_sent: u32,
}

impl ArmCounts {
    /// Tickets received.
    pub fn tickets(&self) -> u32 {
        self.tickets_usb + self.tickets_can
    }

    /// Bytes of the answers to all tickets of the host on USB.
    pub fn bytes_for_usb(&self) -> u32 {
        self.tickets_usb * ANSWER_LEN
    }

    /// Requests received and not answered.
    pub fn unanswered(&self) -> u32 {
        self.tickets() + self.polls - self.answers
    }
}

impl TicketArm {
    /// An arm with this delay before each answer.
    pub fn new(turnaround: Duration) -> Self {
        Self {
            turnaround,
            silent: false,
            decoder: Decoder::new(),
            idle_at: None,
            tx_queue: VecDeque::new(),
            counts: ArmCounts::default(),
            others: Vec::new(),
        }
    }

    /// Sends `bytes` without a request, after all queued bytes.
    pub fn send(&mut self, bytes: &[u8]) {
        self.enqueue(Instant::ZERO, bytes);
    }

    /// Restarts the arm as its own watchdog would: queued bytes are dropped.
    pub fn restart(&mut self) {
        self.counts.bytes_sent -= self.tx_queue.len() as u32;
        self.tx_queue.clear();
        self.decoder = Decoder::new();
    }

    /// True if bytes are queued.
    pub fn has_pending(&self) -> bool {
        !self.tx_queue.is_empty()
    }

    /// The frames received without an answer since the last call.
    pub fn take_others(&mut self) -> Vec<Vec<u8>> {
        std::mem::take(&mut self.others)
    }

    fn enqueue(&mut self, due: Instant, bytes: &[u8]) {
        self.counts.bytes_sent += bytes.len() as u32;
        self.tx_queue.extend(bytes.iter().map(|&byte| (due, byte)));
    }

    /// Discards an incomplete frame after silence on the line.
    fn advance(&mut self, now: Instant) {
        if self.idle_at.take_if(|at| *at <= now).is_some() {
            self.decoder.idle();
            self.handle_frames(now);
        }
    }

    /// Handles received frames.
    fn handle_frames(&mut self, now: Instant) {
        while let Some(item) = self.decoder.next(&Ling, ()) {
            let bytes = item.bytes.to_vec();
            let Some(frame) = Frame::parse(&bytes).filter(|_| item.kind == Kind::Frame) else {
                self.counts.noise_bytes += bytes.len() as u32;
                continue;
            };
            if (frame.command, frame.function) != JOINTS_COMMAND {
                self.others.push(bytes);
                continue;
            }
            let answer = self.answer(frame.data);
            if !self.silent {
                self.counts.answers += 1;
                self.enqueue(now + self.turnaround, &answer);
            }
        }
    }

    /// Counts a request with these data, and returns the answer.
    fn answer(&mut self, data: &[u8]) -> Vec<u8> {
        if data == POLL_DATA {
            self.counts.polls += 1;
            return numbered_answer(self.counts.polls - 1);
        }
        match data[0] {
            USB => self.counts.tickets_usb += 1,
            CAN => self.counts.tickets_can += 1,
            other => panic!("a ticket of initiator {other}"),
        }
        frame(&[data, &self.counts.answers.to_le_bytes()].concat())
    }
}

impl SerialDevice for TicketArm {
    fn receive(&mut self, now: Instant, byte: u8) {
        self.advance(now);
        self.counts.bytes_received += 1;
        self.idle_at = Some(now + PARTIAL_FRAME_TIMEOUT);
        assert!(self.decoder.push(&[byte]).is_empty());
        self.handle_frames(now);
    }

    fn transmit(&mut self, now: Instant) -> Option<u8> {
        self.advance(now);
        self.tx_queue.pop_front_if(|(due, _)| *due <= now).map(|(_, byte)| byte)
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let next_tx = self.tx_queue.front().map(|&(due, _)| due);
        [next_tx, self.idle_at].into_iter().flatten().min()
    }
}

fn frame(data: &[u8]) -> Vec<u8> {
    let (command, function) = JOINTS_COMMAND;
    let frame = Frame {
        command,
        function,
        data,
    };
    encoded(|bytes| frame.encode(bytes))
}

/// The answer of an idle arm whose first three joints encode this number.
pub fn numbered_answer(number: u32) -> Vec<u8> {
    let mask = (1 << TICK_BITS) - 1;
    let mut joints = [0; JOINTS];
    for (place, joint) in joints.iter_mut().enumerate().take(3) {
        *joint = (number >> (place as u32 * TICK_BITS) & mask) as u16;
    }
    joint_answer(joints)
}

/// The number in a [`numbered_answer`].
///
/// # Panics
///
/// For any other frame.
pub fn number_of(answer: &[u8]) -> usize {
    match Ling.parse_response(answer, ()) {
        Ok(Response::Joints(state)) => number_in(&state) as usize,
        other => panic!("{other:?} is no answer with joints"),
    }
}

/// The number encoded in the joints.
pub(super) fn number_in(state: &JointState) -> u32 {
    let [low, middle, high, ..] = state.joints.map(u32::from);
    low | middle << TICK_BITS | high << (2 * TICK_BITS)
}

/// The answer of an idle arm at these joints, in ticks.
pub fn joint_answer(joints: [u16; JOINTS]) -> Vec<u8> {
    let state = JointState {
        joints,
        gripper: 0,
        status: MotionStatus::Idle,
    };
    encoded(|bytes| Ling.encode_response(&Response::Joints(state), None, bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn incomplete_frame_is_discarded_and_its_rest_answered() {
        let mut ticket_arm = TicketArm::new(Duration::from_micros(500));
        let [first, second] = [0, 1].map(|number| Ticket { initiator: USB, number }.request());
        let mut longer = first;
        longer[3] |= 0x20;
        for byte in longer.into_iter().chain(second) {
            ticket_arm.receive(Instant::from_micros(100), byte);
        }
        assert_eq!(
            ticket_arm.transmit(Instant::from_micros(100) + PARTIAL_FRAME_TIMEOUT),
            None
        );
        assert_eq!((ticket_arm.counts.tickets_usb, ticket_arm.counts.noise_bytes), (1, 11));
        assert!(ticket_arm.has_pending());
    }
}
