//! An arm whose answers show which requests they answer.

use std::collections::VecDeque;

use armwire::decoder::{Decoder, Kind};
use armwire::ling::{Frame, JOINTS, JointState, Ling, MAX_FRAME, MotionStatus, Response};
use armwire::messages::Messages;
use armwire_bridge::{Duration, Instant};
use armwire_sim::serial::SerialDevice;

/// Command and function of the question where the joints are. All [tickets](Ticket) have them too, so that only what is in
/// an answer tells whose it is.
const JOINTS_COMMAND: (u8, u8) = (0x06, 0x00);

/// Who asks with tickets: the host on USB, and the one on CAN.
pub(super) const USB: u8 = 0;
pub(super) const CAN: u8 = 1;

/// How many there are.
const INITIATORS: usize = 2;

/// The one data byte of the question itself.
const POLL_DATA: [u8; 1] = [0xFE];

/// Bytes of the answer to a ticket.
const ANSWER_LEN: u32 = 15;

/// Bits of a number that fit in a joint.
const TICK_BITS: u32 = 12;

/// How long the line must be quiet for the arm to give half a frame up: longer than the adapter lets a host pause in the
/// middle of a request, shorter than it waits for an answer. How long a real one waits is not known.
const PARTIAL_FRAME_TIMEOUT: Duration = Duration::from_millis(20);

/// A request that is like no other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ticket {
    /// Who asks: 0 is the host on USB, 1 the one on CAN.
    pub initiator: u8,
    /// How many that initiator had asked before.
    pub number: u32,
}

impl Ticket {
    /// The frame that asks.
    pub fn request(self) -> Vec<u8> {
        frame(&self.data())
    }

    fn data(self) -> Vec<u8> {
        let [a, b, c, d] = self.number.to_le_bytes();
        vec![self.initiator, a, b, c, d]
    }

    /// What an answer answers, and how many requests the arm had answered before. `None` if it is no answer to a ticket.
    pub fn of_answer(answer: &[u8]) -> Option<(Self, u32)> {
        let &[0xAA, 0x06, 0x00, 9, initiator, a, b, c, d, e, f, g, h, ..] = answer else {
            return None;
        };
        let number = u32::from_le_bytes([a, b, c, d]);
        Some((Self { initiator, number }, u32::from_le_bytes([e, f, g, h])))
    }
}

/// The number that the arm put into its joints.
pub(super) fn number_in(state: &JointState) -> u32 {
    let [low, middle, high, ..] = state.joints.map(u32::from);
    low | middle << TICK_BITS | high << (2 * TICK_BITS)
}

/// An arm that answers each [`Ticket`] with the ticket, and each question for its joints with how many it was asked before.
///
/// It answers nothing else, and keeps it.
#[derive(Debug)]
pub struct TicketArm {
    /// How long it thinks.
    turnaround: Duration,
    silent: bool,
    decoder: Decoder<MAX_FRAME>,
    /// When it last heard a byte, and when it looks next whether the line has been quiet since.
    last_rx: Instant,
    idle_check: Option<Instant>,
    /// Each byte, and from when on it may be said.
    tx_queue: VecDeque<(Instant, u8)>,
    arm_counts: ArmCounts,
    others: Vec<Vec<u8>>,
}

/// What it has heard and said.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ArmCounts {
    /// Tickets it heard, of each initiator.
    tickets: [u32; INITIATORS],
    /// Questions for its joints that it heard.
    pub polls: u32,
    /// Both, as far as it answered them.
    pub answers: u32,
    /// Bytes that were in no frame.
    pub noise_bytes: u32,
    /// Bytes that it heard.
    pub bytes_received: u32,
    /// Bytes that it said or is about to.
    pub bytes_sent: u32,
}

impl ArmCounts {
    /// Tickets that it heard.
    pub fn tickets(&self) -> u32 {
        self.tickets.iter().sum()
    }

    /// Tickets of the host on USB that it heard.
    pub fn tickets_of_usb(&self) -> u32 {
        self.tickets[usize::from(USB)]
    }

    /// Bytes of the answers to these, if it answered all of them.
    pub fn bytes_for_usb(&self) -> u32 {
        self.tickets_of_usb() * ANSWER_LEN
    }

    /// Tickets of the host on CAN that it heard.
    pub fn tickets_of_can(&self) -> u32 {
        self.tickets[usize::from(CAN)]
    }

    /// Requests that it heard and did not answer.
    pub fn unanswered(&self) -> u32 {
        self.tickets() + self.polls - self.answers
    }
}

impl TicketArm {
    /// An arm that thinks for `turnaround` before each answer.
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

    /// Lets it hear on, but answer nothing, or answer again.
    pub fn set_silent(&mut self, silent: bool) {
        self.silent = silent;
    }

    /// Says `bytes` unasked, after what it has still to say.
    pub fn send(&mut self, bytes: &[u8]) {
        self.enqueue(Instant::ZERO, bytes);
    }

    /// Starts it anew, as its own watchdog would: what it has still to say it never says.
    pub fn restart(&mut self) {
        self.arm_counts.bytes_sent -= self.tx_queue.len() as u32;
        self.tx_queue.clear();
        self.decoder = Decoder::new();
    }

    /// Whether it has something to say.
    pub fn has_pending(&self) -> bool {
        !self.tx_queue.is_empty()
    }

    /// What it has heard and said so far.
    pub fn arm_counts(&self) -> ArmCounts {
        self.arm_counts
    }

    /// The frames that it heard and does not answer, since this was last asked.
    pub fn take_others(&mut self) -> Vec<Vec<u8>> {
        std::mem::take(&mut self.others)
    }

    fn enqueue(&mut self, due: Instant, bytes: &[u8]) {
        self.arm_counts.bytes_sent += bytes.len() as u32;
        self.tx_queue.extend(bytes.iter().map(|&byte| (due, byte)));
    }

    /// Lets time pass: half a frame is given up once the line has been quiet.
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

    /// Does what is asked in the bytes that it has.
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

/// The answer of an arm that stands still at these joints, in ticks.
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
    fn half_a_frame_is_given_up_in_silence_and_what_seemed_its_rest_is_answered() {
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
