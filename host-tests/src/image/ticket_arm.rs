//! An arm whose answers identify their requests.

use std::collections::VecDeque;

use armwire::decoder::{Decoder, Kind};
use armwire::ling::{Frame, JOINTS, JointState, Ling, MAX_FRAME, MotionStatus, Response};
use armwire::messages::Messages;
use armwire_bridge::{Duration, Instant};
use armwire_sim::serial::SerialDevice;

/// Command and function of the joint request. All [tickets](Ticket) have them too. Only the data identifies the
/// initiator.
const JOINTS_COMMAND: (u8, u8) = (0x06, 0x00);

/// Initiators of tickets: the host on USB, and the host on CAN.
pub(super) const USB: u8 = 0;
pub(super) const CAN: u8 = 1;

/// Number of initiators.
const INITIATORS: usize = 2;

/// The data byte of the joint request itself.
const POLL_DATA: [u8; 1] = [0xFE];

/// Bytes of the answer to a ticket.
const ANSWER_LEN: u32 = 15;

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
        frame(&self.data())
    }

    fn data(self) -> Vec<u8> {
        let [a, b, c, d] = self.number.to_le_bytes();
        vec![self.initiator, a, b, c, d]
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

/// The number encoded in the joints.
pub(super) fn number_in(state: &JointState) -> u32 {
    let [low, middle, high, ..] = state.joints.map(u32::from);
    low | middle << TICK_BITS | high << (2 * TICK_BITS)
}

/// An arm that answers each [`Ticket`] with the ticket, and each joint request with the number of earlier joint
/// requests.
///
/// Other frames get no answer and are recorded.
#[derive(Debug)]
pub struct TicketArm {
    /// The delay of each answer.
    turnaround: Duration,
    silent: bool,
    decoder: Decoder<MAX_FRAME>,
    /// The time of the last received byte, and the time of the next check for silence.
    last_rx: Instant,
    idle_check: Option<Instant>,
    /// Bytes to send, each with its earliest time.
    tx_queue: VecDeque<(Instant, u8)>,
    arm_counts: ArmCounts,
    others: Vec<Vec<u8>>,
}

/// Received and sent traffic of the arm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ArmCounts {
    /// Tickets received, by initiator.
    tickets: [u32; INITIATORS],
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
        self.tickets.iter().sum()
    }

    /// Tickets received from the host on USB.
    pub fn tickets_of_usb(&self) -> u32 {
        self.tickets[usize::from(USB)]
    }

    /// Bytes of the answers to all tickets of the host on USB.
    pub fn bytes_for_usb(&self) -> u32 {
        self.tickets_of_usb() * ANSWER_LEN
    }

    /// Tickets received from the host on CAN.
    pub fn tickets_of_can(&self) -> u32 {
        self.tickets[usize::from(CAN)]
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
            last_rx: Instant::ZERO,
            idle_check: None,
            tx_queue: VecDeque::new(),
            arm_counts: ArmCounts::default(),
            others: Vec::new(),
        }
    }

    /// Disables or enables answers. Bytes are received in either case.
    pub fn set_silent(&mut self, silent: bool) {
        self.silent = silent;
    }

    /// Sends `bytes` unasked, after all queued bytes.
    pub fn send(&mut self, bytes: &[u8]) {
        self.enqueue(Instant::ZERO, bytes);
    }

    /// Restarts the arm as its own watchdog would: queued bytes are dropped.
    pub fn restart(&mut self) {
        self.arm_counts.bytes_sent -= self.tx_queue.len() as u32;
        self.tx_queue.clear();
        self.decoder = Decoder::new();
    }

    /// True if bytes are queued.
    pub fn has_pending(&self) -> bool {
        !self.tx_queue.is_empty()
    }

    /// Counts so far.
    pub fn arm_counts(&self) -> ArmCounts {
        self.arm_counts
    }

    /// The frames received without an answer since the last call.
    pub fn take_others(&mut self) -> Vec<Vec<u8>> {
        std::mem::take(&mut self.others)
    }

    fn enqueue(&mut self, due: Instant, bytes: &[u8]) {
        self.arm_counts.bytes_sent += bytes.len() as u32;
        self.tx_queue.extend(bytes.iter().map(|&byte| (due, byte)));
    }

    /// Discards an incomplete frame after silence on the line.
    fn advance(&mut self, now: Instant) {
        if self.idle_check.take_if(|at| *at <= now).is_none() {
            return;
        }
        let quiet = self.last_rx + PARTIAL_FRAME_TIMEOUT;
        if now < quiet {
            self.idle_check = Some(quiet);
            return;
        }
        self.decoder.idle();
        self.handle_frames(now);
    }

    /// Handles received frames.
    fn handle_frames(&mut self, now: Instant) {
        while let Some(item) = self.decoder.next(&Ling, ()) {
            let bytes = item.bytes.to_vec();
            let Some(frame) = Frame::parse(&bytes).filter(|_| item.kind == Kind::Frame) else {
                self.arm_counts.noise_bytes += bytes.len() as u32;
                continue;
            };
            let command = (frame.command, frame.function);
            if command != JOINTS_COMMAND {
                self.others.push(bytes);
            } else if let Some(answer) = self.answer(command, frame.data) {
                self.enqueue(now + self.turnaround, &answer);
            }
        }
    }

    /// The answer to a frame, if it has one.
    fn answer(&mut self, command: (u8, u8), data: &[u8]) -> Option<Vec<u8>> {
        if command != JOINTS_COMMAND {
            return None;
        }
        let answer = if data == POLL_DATA {
            self.arm_counts.polls += 1;
            joints(self.arm_counts.polls - 1)
        } else {
            self.arm_counts.tickets[usize::from(data[0])] += 1;
            let before = self.arm_counts.answers.to_le_bytes();
            frame(&[data, &before].concat())
        };
        (!self.silent).then(|| {
            self.arm_counts.answers += 1;
            answer
        })
    }
}

impl SerialDevice for TicketArm {
    fn receive(&mut self, now: Instant, byte: u8) {
        self.advance(now);
        self.arm_counts.bytes_received += 1;
        self.last_rx = now;
        self.idle_check.get_or_insert(now + PARTIAL_FRAME_TIMEOUT);
        assert!(self.decoder.push(&[byte]).is_empty());
        self.handle_frames(now);
    }

    fn transmit(&mut self, now: Instant) -> Option<u8> {
        self.advance(now);
        self.tx_queue.pop_front_if(|(due, _)| *due <= now).map(|(_, byte)| byte)
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let next_tx = self.tx_queue.front().map(|&(due, _)| due);
        [next_tx, self.idle_check].into_iter().flatten().min()
    }
}

fn frame(data: &[u8]) -> Vec<u8> {
    let (command, function) = JOINTS_COMMAND;
    let mut bytes = [0; MAX_FRAME];
    let len = Frame {
        command,
        function,
        data,
    }
    .encode(&mut bytes)
    .unwrap();
    bytes[..len].to_vec()
}

fn joints(number: u32) -> Vec<u8> {
    let mask = (1 << TICK_BITS) - 1;
    let mut joints = [0; JOINTS];
    for (place, joint) in joints.iter_mut().enumerate().take(3) {
        *joint = (number >> (place as u32 * TICK_BITS) & mask) as u16;
    }
    joint_answer(joints)
}

/// The answer of an idle arm at these joints, in ticks.
///
/// # Panics
///
/// Never.
pub fn joint_answer(joints: [u16; JOINTS]) -> Vec<u8> {
    let state = JointState {
        joints,
        gripper: 0,
        status: MotionStatus::Idle,
    };
    let mut bytes = [0; MAX_FRAME];
    let len = Ling
        .encode_response(&Response::Joints(state), None, &mut bytes)
        .unwrap();
    bytes[..len].to_vec()
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
        assert_eq!(
            (
                ticket_arm.arm_counts().tickets_of_usb(),
                ticket_arm.arm_counts().noise_bytes
            ),
            (1, 11)
        );
        assert!(ticket_arm.has_pending());
    }
}
