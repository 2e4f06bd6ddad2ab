//! The time that the adapter adds to a call while USB, CAN and its own poll are busy, and its stack meanwhile.
//!
//! All hosts request the joints of a [`TicketArm`]. Its answers contain the number of earlier answers, which identifies
//! each request and each answer of a host on the line.
//!
//! A span that the adapter adds begins when the adapter could act: when what it must pass on was there, and what it must pass
//! it on to was free of what went before. The time before that is not counted.

use armwire::ling::Request;
use armwire_bridge::Duration;
use armwire_bridge::can::{Frame, Function, Id, Node};
use armwire_bridge::control::{Event, Request as ControlRequest};
use armwire_host_tests::image::requests::frame;
use armwire_host_tests::image::{CanProgram, Control, MEGABAUD, TicketArm, byte_time, counters, polled};
use armwire_virtual_board::can::{BusFrame, Outcome, Sender};
use armwire_virtual_board::line::{Direction, LineByte};
use armwire_virtual_board::usb::Direction as UsbDirection;
use armwire_virtual_board::usb::cdc::Port;
use armwire_virtual_board::{Error, Nanos, VirtualBoard};

use crate::board::Board;

/// The time for which the arm thinks.
const TURNAROUND: Duration = Duration::from_micros(100);
/// The adapter's polls per second, each reported in cyclic frames.
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
/// The longest time between two looks of the hosts.
const GLANCE: Nanos = Nanos(250_000);
/// The longest pauses between two requests of the host on USB, of the one on CAN, and between two frames of another node.
const PAUSES: [u64; 3] = [1_700_000, 1_300_000, 1_900_000];

/// The ways through the adapter, in the order of [`Latency::ways`].
pub(crate) const WAYS: [&str; 4] = ["answer to USB", "request from USB", "answer to CAN", "request from CAN"];

/// Measured latencies.
pub(crate) struct Latency {
    pub(crate) ways: [Spans; WAYS.len()],
    /// The delays of all stamps after the earliest, in microseconds: the adapter's clock does not begin with that of the line.
    pub(crate) stamps: Vec<u64>,
    /// The percentage of stamps of which the adapter knew that they are late.
    pub(crate) known_late: f64,
    /// The bytes of stack used.
    pub(crate) stack: u32,
}

impl Latency {
    /// The percentage of stamps that are wrong by more than a microsecond.
    pub(crate) fn wrong_stamps(&self) -> f64 {
        let wrong = self.stamps.iter().filter(|delay| **delay > 1).count();
        100.0 * wrong as f64 / self.stamps.len() as f64
    }
}

/// The passages on one way.
#[derive(Default)]
pub(crate) struct Spans {
    /// The time that the adapter added to each, from the shortest on.
    added: Vec<Nanos>,
}

impl Spans {
    /// Spans of what was there, of what was free since, and of what was passed on, at these times.
    fn new(passages: impl Iterator<Item = [Nanos; 3]>) -> Self {
        let mut added: Vec<_> = passages
            .map(|[there, since, end]| end.since(there.max(since)))
            .collect();
        added.sort_unstable();
        Self { added }
    }

    /// The time that this share of them does not exceed, in microseconds.
    pub(crate) fn quantile(&self, share: f64) -> f64 {
        let place = (self.added.len() as f64 * share).ceil() as usize;
        let span = self.added.get(place.saturating_sub(1));
        span.map_or(f64::NAN, |span| span.0 as f64 / 1e3)
    }
}

/// Records of the hosts: the number of earlier answers in each answer on CAN, and in each answer reported to the
/// subscriber, with its stamp.
#[derive(Default)]
struct Observed {
    by_can: Vec<usize>,
    stamps: Vec<(usize, u64)>,
}

/// Runs all hosts until the arm has given this number of answers.
pub(crate) fn measure(board: &Board, answers: u32) -> Latency {
    board.run(TicketArm::new(TURNAROUND), MEGABAUD, |virtual_board| {
        let observed = work(virtual_board, answers);
        let counters = counters(virtual_board);
        assert_eq!((counters.unanswered_requests, counters.dropped_bytes), (0, 0));
        let exchanges = exchanges(&virtual_board.uart().bytes());
        let [from_usb, to_usb] = usb_ways(virtual_board, &exchanges);
        let [from_can, to_can] = can_ways(&virtual_board.can().frames(), &observed.by_can, &exchanges);
        Latency {
            ways: [to_usb, from_usb, to_can, from_can],
            stamps: delays(&observed.stamps, &exchanges),
            known_late: 100.0 * f64::from(counters.late_stamps) / f64::from(counters.frames),
            stack: board.stack(virtual_board),
        }
    })
}

/// Runs a host on USB, a host on CAN, a subscriber to every frame, and another sending node, until the arm has given
/// this number of answers and the last have arrived.
fn work(board: &mut VirtualBoard<TicketArm>, answers: u32) -> Observed {
    board.can().attach(BUS_RATE);
    board.uart().forget_bytes();
    board.usb().forget_packets();
    let mut subscriber = Control::open(board);
    subscriber.order(board, ControlRequest::SetConfig(polled(POLL_HZ)));
    subscriber.subscribe(board);
    let mut can = CanProgram::new(Node::default());
    let other = Frame::new(Id::new(0x123).expect("11 bits"), &[0x5A; 8]).expect("8 bytes");
    let mut observed = Observed::default();
    let (mut can_waits, mut usb_open, mut usb_bytes) = (false, 0, 0);
    let (mut due, mut pauses) = ([board.now(); 3], 0);
    // Another pause each time: the next request meets another phase of all that is periodic.
    let mut pause = |now: Nanos, nth: usize| {
        pauses += 1;
        now + Nanos(pauses * 618_033_989 % PAUSES[nth])
    };
    loop {
        let now = board.now();
        let requesting = board.with_arm(|arm| arm.arm_counts().answers) < answers;
        if !requesting && !can_waits && usb_open == 0 {
            return observed;
        }
        usb_bytes += board.usb().read().len();
        usb_open -= usb_bytes / ANSWER;
        usb_bytes %= ANSWER;
        if requesting && usb_open < WINDOW && due[0] <= now {
            board.usb().write(&frame(Request::ReadJoints)).expect("it is open");
            usb_open += 1;
            due[0] = pause(now, 0);
        }
        if requesting && !can_waits && due[1] <= now {
            can.send(&frame(Request::ReadJoints));
            can_waits = true;
        }
        if let Some(answer) = can.poll(board) {
            observed.by_can.push(number_of(&answer));
            can_waits = false;
            due[1] = pause(now, 1);
        }
        if due[2] <= now {
            board.can().send_from(1, &other).expect("it is classic");
            due[2] = pause(now, 2);
        }
        for (stamp, event) in subscriber.take_events(board) {
            if let Event::Frame { bytes, .. } = event {
                observed.stamps.push((number_of(&bytes), stamp.0));
            }
        }
        let next = due.into_iter().filter(|due| *due > now).fold(now + GLANCE, Nanos::min);
        let news = |board: &mut VirtualBoard<TicketArm>| board.usb().unread() > 0 || board.can().unread() > 0;
        match board.run_until(next.since(now), news) {
            Ok(_) | Err(Error::TimedOut { .. }) => {}
            Err(error) => panic!("{error}"),
        }
    }
}

/// A request on the line and its answer.
struct Exchange {
    /// Start of the request's first start bit, and end of its last stop bit.
    start: Nanos,
    requested: Nanos,
    /// End of the answer's last stop bit.
    end: Nanos,
}

/// All exchanges on the line. The arm answers in order.
fn exchanges(line: &[LineByte]) -> Vec<Exchange> {
    let (up, down): (Vec<&LineByte>, Vec<&LineByte>) =
        line.iter().partition(|byte| byte.direction == Direction::ToBoard);
    let exchange = |(nth, (request, answer)): (usize, (&[&LineByte], &[&LineByte]))| {
        let bytes: Vec<u8> = answer.iter().map(|byte| byte.sent).collect();
        assert_eq!(number_of(&bytes), nth);
        let start = Nanos(request[0].at.0 - byte_time(MEGABAUD).0);
        let [requested, end] = [request[REQUEST - 1].at, answer[ANSWER - 1].at];
        Exchange { start, requested, end }
    };
    let exchanges = down.chunks_exact(REQUEST).zip(up.chunks_exact(ANSWER));
    exchanges.enumerate().map(exchange).collect()
}

/// Requests from USB and answers to USB. An answer waits while the last packet has not been fetched by the host.
fn usb_ways(board: &mut VirtualBoard<TicketArm>, exchanges: &[Exchange]) -> [Spans; 2] {
    let device = board.usb().device().expect("a device").configuration.clone();
    let port = Port::find(&device)[0];
    let mut packets = board.usb().packets();
    packets.retain(|packet| match packet.direction {
        UsbDirection::In => packet.endpoint == port.input.number,
        UsbDirection::Out => packet.endpoint == port.output.number,
    });
    let (ins, outs): (Vec<_>, Vec<_>) = packets.iter().partition(|packet| packet.direction == UsbDirection::In);
    let bytes = ins
        .iter()
        .enumerate()
        .flat_map(|(nth, packet)| packet.data.iter().map(move |byte| (*byte, nth)));
    let (bytes, places): (Vec<u8>, Vec<usize>) = bytes.unzip();
    let numbers: Vec<usize> = bytes.chunks_exact(ANSWER).map(number_of).collect();
    let answers = numbers.iter().zip(places.chunks_exact(ANSWER)).map(|(number, places)| {
        let packet = places[ANSWER - 1];
        let fetched = packet.checked_sub(1).map_or(Nanos(0), |before| ins[before].end);
        [
            exchanges[*number].end,
            fetched,
            ins[packet].armed.expect("the device sent it"),
        ]
    });
    let there: Vec<Nanos> = outs.iter().map(|packet| packet.end).collect();
    [requests(&there, &numbers, exchanges), Spans::new(answers)]
}

/// Requests from CAN and answers to CAN. An answer waits while all mailboxes have frames of the adapter in them.
fn can_ways(frames: &[BusFrame], numbers: &[usize], exchanges: &[Exchange]) -> [Spans; 2] {
    // ISO 15765-2: a request is a single frame, an answer begins with a first frame.
    let is = |seen: &BusFrame, function: Function, kind: u8| {
        assert_eq!(seen.outcome, Outcome::Sent, "the bus has no faults");
        let frame = seen.frame.as_ref().expect("a frame with an 11-bit identifier");
        frame.id() == function.id(Node::default()) && frame.data().first().is_some_and(|pci| pci >> 4 == kind)
    };
    let (ours, others): (Vec<&BusFrame>, Vec<&BusFrame>) = frames.iter().partition(|seen| seen.sender == Sender::Board);
    let there = others.iter().filter(|seen| is(seen, Function::ArmRequest, 0));
    let there: Vec<Nanos> = there.map(|seen| seen.end).collect();
    let requested = |seen: &BusFrame| seen.requested.expect("the board sent it");
    let rooms = rooms(&ours.iter().map(|seen| (requested(seen), seen.end)).collect::<Vec<_>>());
    let begun = ours.iter().filter(|seen| is(seen, Function::ArmAnswer, 1));
    assert_eq!(begun.clone().count(), numbers.len());
    let answers = numbers.iter().zip(begun).map(|(number, seen)| {
        let at = requested(seen);
        let room = rooms[..rooms.partition_point(|room| *room <= at)].last();
        [exchanges[*number].end, room.copied().unwrap_or_default(), at]
    });
    [requests(&there, numbers, exchanges), Spans::new(answers)]
}

/// The requests of one host on their way to the line. The line is free again after the answer in an exchange of another
/// host, and after the request in an own exchange: a host may send further requests.
fn requests(there: &[Nanos], numbers: &[usize], exchanges: &[Exchange]) -> Spans {
    assert_eq!(there.len(), numbers.len());
    Spans::new(there.iter().zip(numbers).enumerate().map(|(nth, (there, &number))| {
        let own = nth > 0 && numbers[nth - 1] + 1 == number;
        let before = number.checked_sub(1).map(|before| &exchanges[before]);
        let free = before.map_or(Nanos(0), |before| if own { before.requested } else { before.end });
        [*there, free, exchanges[number].start]
    }))
}

/// Times at which a full set of mailboxes had room again. Each frame: time of the request, time of its end.
fn rooms(frames: &[(Nanos, Nanos)]) -> Vec<Nanos> {
    // Frames are in the order in which they ended: at the end of the n-th, those that had been requested and end later are
    // still there.
    let still = |nth: usize, end| {
        frames[nth + 1..]
            .iter()
            .take(MAILBOXES)
            .filter(|later| later.0 < end)
            .count()
    };
    let full = |&(nth, &(_, end)): &(usize, &(Nanos, Nanos))| 1 + still(nth, end) >= MAILBOXES;
    frames
        .iter()
        .enumerate()
        .filter(full)
        .map(|(_, &(_, end))| end)
        .collect()
}

/// The delays of stamps after the earliest, in microseconds.
fn delays(stamps: &[(usize, u64)], exchanges: &[Exchange]) -> Vec<u64> {
    let ahead =
        |&(number, stamp): &(usize, u64)| stamp.wrapping_sub(exchanges[number].end.instant().as_micros()) as i64;
    let least = stamps.iter().map(ahead).min().unwrap_or_default();
    stamps.iter().map(|stamp| (ahead(stamp) - least) as u64).collect()
}

/// The number of answers before this one.
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
    fn added_span_starts_when_adapter_can_act() {
        let passages = [[100, 40, 130], [100, 120, 130]];
        let spans = Spans::new(passages.into_iter().map(|passage| passage.map(Nanos)));
        assert_eq!(spans.added, [Nanos(10), Nanos(30)]);
        assert_eq!([0.5, 0.51, 1.0].map(|share| spans.quantile(share)), [0.01, 0.03, 0.03]);
    }

    #[test]
    fn mailbox_room_starts_after_first_of_three_frames() {
        let rooms = |frames: &[(u64, u64)]| {
            let frames: Vec<_> = frames
                .iter()
                .map(|&(requested, end)| (Nanos(requested), Nanos(end)))
                .collect();
            super::rooms(&frames).iter().map(|room| room.0).collect::<Vec<_>>()
        };
        assert_eq!(rooms(&[(0, 10), (1, 20)]), [0; 0]);
        assert_eq!(rooms(&[(0, 10), (1, 20), (2, 30)]), [10]);
        // The fourth takes the room at once, and they are full until the second has gone.
        assert_eq!(rooms(&[(0, 10), (1, 20), (2, 30), (11, 40)]), [10, 20]);
    }
}
