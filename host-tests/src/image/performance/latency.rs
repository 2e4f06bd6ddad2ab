//! What the adapter adds to the time of a call while USB, CAN and its own poll are busy.
//!
//! Everybody asks a [`Witness`] for its joints: its answers have the 21 bytes of the real one's, and tell how many it gave
//! before. So each request and each answer that a host has is known on the line.
//!
//! A span that the adapter adds begins when it could have acted: when what it must pass on was there, and what it must
//! pass it on to was free of what went before. The time before that is another's, and told apart.

use std::collections::VecDeque;
use std::num::NonZeroU32;

use armwire::Micros;
use armwire::ling::Request;
use armwire_bridge::can::{Frame, Function, Id, Node};
use armwire_bridge::control::{Event, Stamp};
use armwire_virtual_board::can::{BusFrame, Outcome, Sender};
use armwire_virtual_board::line::{Direction, LineByte};
use armwire_virtual_board::usb::Direction as UsbDirection;
use armwire_virtual_board::usb::cdc::Port;
use armwire_virtual_board::usb::host::Packet;
use armwire_virtual_board::{Config, Error, Nanos, VirtualBoard};

use super::configure;
use crate::image::requests::frame;
use crate::image::{CanProgram, Control, MEGABAUD, Witness, byte_time, counters, on_board_with, path, plug_in, polled};

/// How long the arm thinks.
const TURNAROUND: Micros = Micros(100);

/// How often the adapter polls it and tells of it by cyclic frames.
const POLL_HZ: u16 = 200;

/// Bits per second on the bus.
const BUS_RATE: u32 = 1_000_000;

/// Requests of the host on USB that are open at once, at most.
const WINDOW: usize = 3;

/// Bytes of the request for the joints, and of its answer.
const REQUEST: usize = 7;
const ANSWER: usize = 21;

/// Mailboxes of the CAN controller for frames to be sent.
const MAILBOXES: usize = 3;

/// How far the board runs between two looks of the hosts if nothing comes, and after how many of them the records of the
/// wires are taken.
const GLANCE: Nanos = Nanos(250_000);
const LOOKS: u32 = 200;

/// From where to where something passes through the adapter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Way {
    /// From an answer's last stop bit until the packet with its last byte is ready for the host.
    AnswerToUsb,
    /// From the end of a request's packet to its first start bit.
    RequestFromUsb,
    /// From an answer's last stop bit until its first frame is with the CAN controller.
    AnswerToCan,
    /// From the end of a request's frame to its first start bit.
    RequestFromCan,
}

impl Way {
    /// Its name in records.
    pub const fn name(self) -> &'static str {
        match self {
            Self::AnswerToUsb => "answer-to-usb",
            Self::RequestFromUsb => "request-from-usb",
            Self::AnswerToCan => "answer-to-can",
            Self::RequestFromCan => "request-from-can",
        }
    }
}

/// One passage through the adapter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Passage {
    /// Which way.
    pub way: Way,
    /// How long it had to wait for what went before: another's exchange on the line, the last packet that the host has
    /// not fetched, full mailboxes.
    pub waited: Nanos,
    /// What the adapter added.
    pub added: Nanos,
}

impl Passage {
    /// One of what was `there`, passed on at `end`, to what was free `since`.
    fn new(way: Way, there: Nanos, since: Nanos, end: Nanos) -> Self {
        Self {
            way,
            waited: since.since(there),
            added: end.since(there.max(since)),
        }
    }
}

/// What was measured.
#[derive(Clone, Debug)]
pub struct Run {
    /// All passages.
    pub passages: Vec<Passage>,
    /// How late the stamp of each answer is that the subscriber was told of, after the earliest: the adapter's clock does
    /// not begin when that of the line does.
    pub stamps: Vec<Micros>,
}

/// Measures until the arm has answered `frames` times. An instruction takes `cost` percent of a cycle.
///
/// # Panics
///
/// If the firmware did what it must not, or lost, changed or swapped an answer.
pub fn measure(cost: NonZeroU32, frames: usize) -> Run {
    let mut config = Config::new(path(), Witness::new(TURNAROUND));
    config.instruction_cost = cost;
    on_board_with(config, |board| {
        plug_in(board, MEGABAUD);
        board.can().attach(BUS_RATE);
        let mut records = Records::new(board);
        configure(board, polled(POLL_HZ));
        let mut hosts = Hosts::new(board);
        while records.exchanges.len() < frames {
            hosts.work(board, &mut records);
        }
        hosts.asks = false;
        while hosts.waits() {
            hosts.work(board, &mut records);
        }
        records.take(board);
        let counters = counters(board);
        assert_eq!((counters.unanswered_requests, counters.dropped_bytes), (0, 0));
        Run {
            passages: records.passages(),
            stamps: records.late_stamps(),
        }
    })
}

/// Everybody who uses the arm.
struct Hosts {
    /// Is told of every frame.
    subscriber: Control,
    can: CanProgram,
    /// Whether the host on CAN waits for an answer, and when it asks next if not.
    can_waits: bool,
    can_next: Nanos,
    /// How many answers the host on USB waits for, and when it asks next.
    usb_open: usize,
    usb_bytes: usize,
    usb_next: Nanos,
    /// When another node sends next, which has nothing to do with the adapter.
    other_next: Nanos,
    asks: bool,
    looks: u32,
    asked: u64,
}

impl Hosts {
    fn new(board: &mut VirtualBoard<Witness>) -> Self {
        let mut subscriber = Control::open(board);
        subscriber.subscribe(board);
        Self {
            subscriber,
            can: CanProgram::new(Node::default()),
            can_waits: false,
            can_next: board.now(),
            usb_open: 0,
            usb_bytes: 0,
            usb_next: board.now(),
            other_next: board.now(),
            asks: true,
            looks: 0,
            asked: 0,
        }
    }

    fn waits(&self) -> bool {
        self.can_waits || self.usb_open > 0
    }

    /// A pause up to `longest`, another one each time: the next request meets another phase of all that is periodic.
    fn pause(&mut self, longest: u64) -> Nanos {
        self.asked += 1;
        Nanos(self.asked * 618_033_989 % longest)
    }

    /// Everybody does what they have to do now, then the board runs until there may be more.
    fn work(&mut self, board: &mut VirtualBoard<Witness>, records: &mut Records) {
        let now = board.now();
        self.usb_bytes += board.usb().read().len();
        self.usb_open -= self.usb_bytes / ANSWER;
        self.usb_bytes %= ANSWER;
        if self.asks && self.usb_open < WINDOW && self.usb_next <= now {
            board.usb().write(&frame(Request::ReadJoints)).expect("it is open");
            self.usb_open += 1;
            self.usb_next = now + self.pause(1_700_000);
        }
        if self.asks && !self.can_waits && self.can_next <= now {
            self.can.send(&frame(Request::ReadJoints));
            self.can_waits = true;
        }
        if let Some(answer) = self.can.poll(board) {
            records.can_answers.push(number_of(&answer));
            self.can_waits = false;
            self.can_next = now + self.pause(1_300_000);
        }
        if self.other_next <= now {
            let other = Frame::new(Id::new(0x123).expect("11 bits"), &[0x5A; 8]).expect("8 bytes");
            board.can().send_from(1, &other).expect("it is classic");
            self.other_next = now + self.pause(1_900_000);
        }
        for (stamp, event) in self.subscriber.take_events(board) {
            if let Event::Frame { bytes, .. } = event {
                records.stamps.push((number_of(&bytes), stamp));
            }
        }
        self.looks += 1;
        if self.looks.is_multiple_of(LOOKS) {
            records.take(board);
        }
        let dues = [self.usb_next, self.can_next, self.other_next].into_iter();
        let due = dues.filter(|due| *due > now).fold(now + GLANCE, Nanos::min);
        let news = |board: &mut VirtualBoard<Witness>| board.usb().unread() > 0 || board.can().unread() > 0;
        match board.run_until(due.since(now), news) {
            Ok(_) | Err(Error::TimedOut { .. }) => {}
            Err(error) => panic!("{error}"),
        }
    }
}

/// A request on the line and its answer.
#[derive(Clone, Copy, Debug, Default)]
struct Exchange {
    /// When the request's first start bit began, and its last stop bit ended.
    start: Nanos,
    asked: Nanos,
    /// When the answer's last stop bit ended.
    end: Nanos,
}

/// What was on the wires, as far as it matters.
struct Records {
    port: Port,
    exchanges: Vec<Exchange>,
    /// When each byte of the requests began that have no answer yet, and the bytes of the next answer so far.
    starts: VecDeque<Nanos>,
    answer: Vec<u8>,
    /// When each request of the host on USB was with the adapter.
    usb_requests: Vec<Nanos>,
    /// When each packet for the host was ready, and when the host had it.
    usb_packets: Vec<(Nanos, Nanos)>,
    /// Bytes of an answer that is not whole.
    usb_bytes: Vec<u8>,
    /// Each answer for the host on USB: which of the arm's it is, and in which of the packets its last byte was.
    usb_answers: Vec<(usize, usize)>,
    /// When each request of the host on CAN was with the adapter.
    can_requests: Vec<Nanos>,
    /// Each frame of the adapter: when it was with the controller, when it had gone, and whether it begins an answer.
    can_frames: Vec<(Nanos, Nanos, bool)>,
    /// Each answer for the host on CAN: which of the arm's it is.
    can_answers: Vec<usize>,
    /// Each answer that the subscriber was told of: which of the arm's it is, and its stamp.
    stamps: Vec<(usize, Stamp)>,
}

impl Records {
    fn new(board: &mut VirtualBoard<Witness>) -> Self {
        let device = board.usb().device().expect("a device").configuration.clone();
        let [port] = Port::find(&device)[..] else {
            panic!("not one serial port: {device:?}");
        };
        let mut records = Self {
            port,
            exchanges: Vec::new(),
            starts: VecDeque::new(),
            answer: Vec::new(),
            usb_requests: Vec::new(),
            usb_packets: Vec::new(),
            usb_bytes: Vec::new(),
            usb_answers: Vec::new(),
            can_requests: Vec::new(),
            can_frames: Vec::new(),
            can_answers: Vec::new(),
            stamps: Vec::new(),
        };
        records.take(board);
        records
    }

    /// Takes what was on the wires since this was last called.
    fn take(&mut self, board: &mut VirtualBoard<Witness>) {
        for byte in board.uart().bytes() {
            self.byte(byte);
        }
        board.uart().forget_bytes();
        for packet in board.usb().packets() {
            self.packet(&packet);
        }
        board.usb().forget_packets();
        for frame in board.can().frames() {
            self.can_frame(&frame);
        }
        board.can().forget_frames();
    }

    fn byte(&mut self, byte: LineByte) {
        match byte.direction {
            Direction::ToArm => self.starts.push_back(Nanos(byte.at.0 - byte_time(MEGABAUD).0)),
            Direction::ToBoard => {
                self.answer.push(byte.sent);
                if self.answer.len() == ANSWER {
                    assert_eq!(number_of(&self.answer), self.exchanges.len());
                    self.answer.clear();
                    let request: Vec<Nanos> = self.starts.drain(..REQUEST).collect();
                    self.exchanges.push(Exchange {
                        start: request[0],
                        asked: request[REQUEST - 1] + byte_time(MEGABAUD),
                        end: byte.at,
                    });
                }
            }
        }
    }

    fn packet(&mut self, packet: &Packet) {
        match packet.direction {
            UsbDirection::Out if packet.endpoint == self.port.output.number => self.usb_requests.push(packet.end),
            UsbDirection::In if packet.endpoint == self.port.input.number => {
                let nth = self.usb_packets.len();
                self.usb_packets
                    .push((packet.armed.expect("the device sent it"), packet.end));
                self.usb_bytes.extend(&packet.data);
                while let Some((answer, rest)) = self.usb_bytes.split_at_checked(ANSWER) {
                    self.usb_answers.push((number_of(answer), nth));
                    self.usb_bytes = rest.to_vec();
                }
            }
            _ => {}
        }
    }

    fn can_frame(&mut self, seen: &BusFrame) {
        assert_eq!(seen.outcome, Outcome::Sent, "nobody disturbs the bus");
        let frame = seen.frame.as_ref().expect("nobody sends others");
        let is = |function: Function, kind: u8| {
            frame.id() == function.id(Node::default()) && frame.data().first().is_some_and(|pci| pci >> 4 == kind)
        };
        // ISO 15765-2: a request is a single frame, an answer begins with a first frame.
        match seen.sender {
            Sender::Board => {
                let requested = seen.requested.expect("the board sent it");
                self.can_frames.push((requested, seen.end, is(Function::ArmAnswer, 1)));
            }
            _ if is(Function::ArmRequest, 0) => self.can_requests.push(seen.end),
            _ => {}
        }
    }

    /// How late each stamp is, after the earliest.
    fn late_stamps(&self) -> Vec<Micros> {
        let ahead = |&(number, stamp): &(usize, Stamp)| {
            let end: Micros = self.exchanges[number].end.micros();
            stamp.0.wrapping_sub(end.0) as i64
        };
        let ahead: Vec<i64> = self.stamps.iter().map(ahead).collect();
        let least = ahead.iter().min().copied().unwrap_or_default();
        ahead.into_iter().map(|ahead| Micros((ahead - least) as u64)).collect()
    }

    /// What all of it says about the adapter.
    fn passages(&self) -> Vec<Passage> {
        let usb_numbers: Vec<usize> = self.usb_answers.iter().map(|&(number, _)| number).collect();
        let usb_requests = self.requests(Way::RequestFromUsb, &self.usb_requests, &usb_numbers);
        let can_requests = self.requests(Way::RequestFromCan, &self.can_requests, &self.can_answers);
        let to_usb = self.usb_answers.iter().map(|&(number, packet)| {
            let (armed, _) = self.usb_packets[packet];
            let fetched = packet
                .checked_sub(1)
                .map_or(Nanos(0), |before| self.usb_packets[before].1);
            Passage::new(Way::AnswerToUsb, self.exchanges[number].end, fetched, armed)
        });
        let begun: Vec<Nanos> = self
            .can_frames
            .iter()
            .filter_map(|&(at, _, begins)| begins.then_some(at))
            .collect();
        assert_eq!(begun.len(), self.can_answers.len());
        let rooms = rooms(&self.can_frames);
        let to_can = self.can_answers.iter().zip(begun).map(|(&number, at)| {
            let room = rooms[..rooms.partition_point(|room| *room <= at)].last();
            let room = room.copied().unwrap_or_default();
            Passage::new(Way::AnswerToCan, self.exchanges[number].end, room, at)
        });
        usb_requests
            .into_iter()
            .chain(can_requests)
            .chain(to_usb)
            .chain(to_can)
            .collect()
    }

    /// Each of these requests of one host, which have these answers, on its way to the line. That is free of another's
    /// exchange once it was answered, and of one of its own once it was asked: a host may ask on.
    fn requests(&self, way: Way, there: &[Nanos], numbers: &[usize]) -> Vec<Passage> {
        assert_eq!(there.len(), numbers.len());
        let passage = |(nth, (&there, &number)): (usize, (&Nanos, &usize))| {
            let own = nth > 0 && numbers[nth - 1] + 1 == number;
            let free = number.checked_sub(1).map_or(Nanos(0), |before| {
                let before = self.exchanges[before];
                if own { before.asked } else { before.end }
            });
            Passage::new(way, there, free, self.exchanges[number].start)
        };
        there.iter().zip(numbers).enumerate().map(passage).collect()
    }
}

/// When there was room in the mailboxes again after all of them were full.
fn rooms(frames: &[(Nanos, Nanos, bool)]) -> Vec<Nanos> {
    // Frames are in the order in which they ended: at the end of the n-th, those that had been requested and end later are
    // still there.
    let mut rooms = Vec::new();
    for (nth, &(_, end, _)) in frames.iter().enumerate() {
        let later = frames[nth + 1..].iter().take(MAILBOXES);
        if 1 + later.filter(|&&(requested, _, _)| requested < end).count() >= MAILBOXES {
            rooms.push(end);
        }
    }
    rooms
}

/// How many answers the arm gave before this one.
fn number_of(answer: &[u8]) -> usize {
    let [0xAA, 0x06, 0x00, _, a, b, c, d, e, f, ..] = *answer else {
        panic!("no answer with joints: {answer:02X?}");
    };
    let joint = |low: u8, high: u8| usize::from(u16::from_le_bytes([low, high]));
    joint(a, b) | joint(c, d) << 12 | joint(e, f) << 24
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_adapter_adds_begins_when_it_could_act() {
        let passage = |there, since, end| {
            let Passage { waited, added, .. } =
                Passage::new(Way::RequestFromUsb, Nanos(there), Nanos(since), Nanos(end));
            (waited.0, added.0)
        };
        assert_eq!(passage(100, 40, 130), (0, 30));
        assert_eq!(passage(100, 120, 130), (20, 10));
    }

    #[test]
    fn there_is_room_again_when_the_first_of_three_frames_has_gone() {
        let frame = |requested, end| (Nanos(requested), Nanos(end), false);
        assert_eq!(rooms(&[frame(0, 10), frame(1, 20)]), []);
        assert_eq!(rooms(&[frame(0, 10), frame(1, 20), frame(2, 30)]), [Nanos(10)]);
        // The fourth takes the room at once, and they are full until the second has gone.
        let four = [frame(0, 10), frame(1, 20), frame(2, 30), frame(11, 40)];
        assert_eq!(rooms(&four), [Nanos(10), Nanos(20)]);
    }
}
