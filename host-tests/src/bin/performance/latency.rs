//! The latency of the adapter while USB, CAN and its own poll are busy, and its stack usage.
//!
//! All hosts request the joints of a [`TicketArm`]. Its answers contain the number of earlier answers, which identifies
//! each request and each answer of a host on the line.
//!
//! A latency starts when the adapter could act: the data was complete, and the line, endpoint or mailbox was free of
//! earlier traffic.

use armwire::ling::Request;
use armwire_bridge::Duration;
use armwire_bridge::can::{Frame, Function, Id, Node};
use armwire_bridge::control::{Event, Request as ControlRequest};
use armwire_host_tests::image::requests::frame;
use armwire_host_tests::image::{
    BIT_RATE, CanProgram, Control, MEGABAUD, Spread, TicketArm, byte_time, counters, number_of, polled,
    run_until_unread,
};
use armwire_virtual_board::can::{BusFrame, Outcome, Sender};
use armwire_virtual_board::line::{Direction, LineByte};
use armwire_virtual_board::usb::Direction as UsbDirection;
use armwire_virtual_board::usb::cdc::Port;
use armwire_virtual_board::{Nanos, VirtualBoard};

use crate::board::Board;

/// The arm's turnaround.
const TURNAROUND: Duration = Duration::from_micros(100);
/// The adapter's polls per second, each reported in cyclic frames.
const POLL_HZ: u16 = 200;
/// Maximum number of open requests of the host on USB.
const WINDOW: usize = 3;
/// Bytes of the request for the joints, and of its answer.
const REQUEST: usize = 7;
const ANSWER: usize = 21;
/// Transmit mailboxes of the CAN controller.
const MAILBOXES: usize = 3;
/// Polling period of the hosts without received bytes.
const POLL_PERIOD: Nanos = Nanos(250_000);
/// Maximum pauses in nanoseconds: between two requests of the host on USB, two of the host on CAN, and two frames of
/// another node.
const PAUSES: [u64; 3] = [1_700_000, 1_300_000, 1_900_000];

/// Number of runs. In each, the pauses of the hosts begin elsewhere: the longest latency is a matter of phase.
const RUNS: u32 = 8;

/// The ways through the adapter, in the order of [`Latency::ways`].
pub(crate) const WAYS: [&str; 4] = ["answer to USB", "request from USB", "answer to CAN", "request from CAN"];

/// Measured latencies.
pub(crate) struct Latency {
    /// The time that the adapter added on each of the [`WAYS`].
    pub(crate) ways: [Spread; WAYS.len()],
    /// The delays of all stamps relative to the earliest, in microseconds: the clocks of adapter and line have different
    /// origins.
    pub(crate) stamps: Vec<u64>,
    /// The numbers of stamps counted as late by the adapter, and of frames.
    late_stamps: u32,
    frames: u32,
    /// The bytes of stack used.
    pub(crate) stack: u32,
}

impl Latency {
    /// The percentage of stamps that are wrong by more than a microsecond.
    pub(crate) fn wrong_stamps(&self) -> f64 {
        let wrong = self.stamps.iter().filter(|delay| **delay > 1).count();
        100.0 * wrong as f64 / self.stamps.len() as f64
    }

    /// The percentage of stamps counted as late by the adapter.
    pub(crate) fn known_late(&self) -> f64 {
        100.0 * f64::from(self.late_stamps) / f64::from(self.frames)
    }

    /// Adds the measurements of another run.
    fn join(mut self, other: Self) -> Self {
        for (way, other) in self.ways.iter_mut().zip(other.ways) {
            way.join(other);
        }
        self.stamps.extend(other.stamps);
        self.late_stamps += other.late_stamps;
        self.frames += other.frames;
        self.stack = self.stack.max(other.stack);
        self
    }
}

/// The time added to passages with these times: the data was complete, the way out was free, the data was passed on.
fn added(passages: impl Iterator<Item = [Nanos; 3]>) -> Spread {
    passages
        .map(|[complete, free, passed]| passed.since(complete.max(free)))
        .collect()
}

/// Answers received by the hosts, each with its number of earlier answers.
#[derive(Default)]
struct Received {
    on_can: Vec<usize>,
    /// Answers reported to the subscriber, with their stamps.
    stamps: Vec<(usize, u64)>,
}

/// Runs all hosts until the arm has sent this number of answers, in several runs.
pub(crate) fn measure(board: &Board, answers: u32) -> Latency {
    let mut runs = (0..RUNS).map(|run| measure_run(board, answers / RUNS, run));
    let first = runs.next().expect("there are runs");
    runs.fold(first, Latency::join)
}

fn measure_run(board: &Board, answers: u32, run: u32) -> Latency {
    board.run(TicketArm::new(TURNAROUND), MEGABAUD, |virtual_board| {
        let received = work(virtual_board, answers, run);
        let counters = counters(virtual_board);
        assert_eq!((counters.unanswered_requests, counters.dropped_bytes), (0, 0));
        let exchanges = exchanges(&virtual_board.uart().bytes());
        let [from_usb, to_usb] = usb_ways(virtual_board, &exchanges);
        let [from_can, to_can] = can_ways(&virtual_board.can().frames(), &received.on_can, &exchanges);
        Latency {
            ways: [to_usb, from_usb, to_can, from_can],
            stamps: delays(&received.stamps, &exchanges),
            late_stamps: counters.late_stamps,
            frames: counters.frames,
            stack: board.stack(virtual_board),
        }
    })
}

/// Runs a host on USB, a host on CAN, a subscriber to every frame, and another sending node, until the arm has sent this
/// number of answers and the last have arrived.
fn work(board: &mut VirtualBoard<TicketArm>, answers: u32, run: u32) -> Received {
    board.can().attach(BIT_RATE);
    board.uart().forget_bytes();
    board.usb().forget_packets();
    let mut subscriber = Control::open(board);
    subscriber.order(board, ControlRequest::SetConfig(polled(POLL_HZ)));
    subscriber.subscribe(board);
    let mut can = CanProgram::default();
    let other = Frame::new(Id::new(0x123).expect("11 bits"), &[0x5A; 8]).expect("8 bytes");
    let mut received = Received::default();
    let (mut can_waits, mut usb_open, mut usb_bytes) = (false, 0, 0);
    let (mut due, mut pauses) = ([board.now(); 3], 1_000_003 * u64::from(run));
    // The pauses differ, so the requests occur in all phases of periodic tasks.
    let mut pause = |now: Nanos, nth: usize| {
        pauses += 1;
        now + Nanos(pauses * 618_033_989 % PAUSES[nth])
    };
    loop {
        let now = board.now();
        let requesting = board.with_arm(|arm| arm.counts.answers) < answers;
        if !requesting && !can_waits && usb_open == 0 {
            return received;
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
            received.on_can.push(number_of(&answer));
            can_waits = false;
            due[1] = pause(now, 1);
        }
        if due[2] <= now {
            board.can().send_from(1, &other).expect("it is classic");
            due[2] = pause(now, 2);
        }
        for (stamp, event) in subscriber.take_events(board) {
            if let Event::Frame { bytes, .. } = event {
                received.stamps.push((number_of(&bytes), stamp.0));
            }
        }
        let next = due
            .into_iter()
            .filter(|due| *due > now)
            .fold(now + POLL_PERIOD, Nanos::min);
        run_until_unread(board, next.since(now)).expect("the firmware does not crash");
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
    let exchanges = down.chunks_exact(REQUEST).zip(up.chunks_exact(ANSWER));
    let exchanges = exchanges.enumerate().map(|(nth, (request, answer))| {
        let bytes: Vec<u8> = answer.iter().map(|byte| byte.sent).collect();
        assert_eq!(number_of(&bytes), nth);
        Exchange {
            start: Nanos(request[0].at.0 - byte_time(MEGABAUD).0),
            requested: request[REQUEST - 1].at,
            end: answer[ANSWER - 1].at,
        }
    });
    exchanges.collect()
}

/// Latencies of requests from USB and answers to USB. The endpoint is free once the host has fetched the packet before.
fn usb_ways(board: &mut VirtualBoard<TicketArm>, exchanges: &[Exchange]) -> [Spread; 2] {
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
        let armed = ins[packet].armed.expect("the device sent it");
        [exchanges[*number].end, fetched, armed]
    });
    let arrived: Vec<Nanos> = outs.iter().map(|packet| packet.end).collect();
    [requests(&arrived, &numbers, exchanges), added(answers)]
}

/// Latencies of requests from CAN and answers to CAN. An answer waits while all mailboxes are full.
fn can_ways(frames: &[BusFrame], numbers: &[usize], exchanges: &[Exchange]) -> [Spread; 2] {
    // ISO 15765-2: a request is a single frame, an answer begins with a first frame.
    let is = |sent: &BusFrame, function: Function, kind: u8| {
        assert_eq!(sent.outcome, Outcome::Sent, "the bus has no faults");
        let frame = sent.frame.as_ref().expect("a frame with an 11-bit identifier");
        frame.id() == function.id(Node::default()) && frame.data().first().is_some_and(|pci| pci >> 4 == kind)
    };
    let (ours, others): (Vec<&BusFrame>, Vec<&BusFrame>) = frames.iter().partition(|sent| sent.sender == Sender::Board);
    let arrived = others.iter().filter(|sent| is(sent, Function::ArmRequest, 0));
    let arrived: Vec<Nanos> = arrived.map(|sent| sent.end).collect();
    let requested = |sent: &BusFrame| sent.requested.expect("the board sent it");
    let rooms = rooms(&ours.iter().map(|sent| (requested(sent), sent.end)).collect::<Vec<_>>());
    let first_frames = ours.iter().filter(|sent| is(sent, Function::ArmAnswer, 1));
    assert_eq!(first_frames.clone().count(), numbers.len());
    let answers = numbers.iter().zip(first_frames).map(|(number, sent)| {
        let at = requested(sent);
        let room = rooms[..rooms.partition_point(|room| *room <= at)].last();
        [exchanges[*number].end, room.copied().unwrap_or_default(), at]
    });
    [requests(&arrived, numbers, exchanges), added(answers)]
}

/// Latencies of the requests of one host. The line is free after the answer of another host's exchange, and after the
/// request of an exchange of the same host, which may send further requests.
fn requests(arrived: &[Nanos], numbers: &[usize], exchanges: &[Exchange]) -> Spread {
    assert_eq!(arrived.len(), numbers.len());
    added(
        arrived
            .iter()
            .zip(numbers)
            .enumerate()
            .map(|(nth, (arrived, &number))| {
                let own = nth > 0 && numbers[nth - 1] + 1 == number;
                let before = number.checked_sub(1).map(|before| &exchanges[before]);
                let free = before.map_or(Nanos(0), |before| if own { before.requested } else { before.end });
                [*arrived, free, exchanges[number].start]
            }),
    )
}

/// Times at which a full set of mailboxes had room again. Each frame: time of the request, time of its end.
fn rooms(frames: &[(Nanos, Nanos)]) -> Vec<Nanos> {
    let full = frames.iter().enumerate().filter(|&(nth, &(_, end))| {
        // Frames are in the order of their ends: later ones that were requested before this end are still there.
        let later = frames[nth + 1..].iter().take(MAILBOXES);
        1 + later.filter(|later| later.0 < end).count() >= MAILBOXES
    });
    full.map(|(_, &(_, end))| end).collect()
}

/// The delays of stamps relative to the earliest, in microseconds.
fn delays(stamps: &[(usize, u64)], exchanges: &[Exchange]) -> Vec<u64> {
    let ahead = |&(number, stamp): &(usize, u64)| {
        let end = exchanges[number].end.instant().as_micros();
        stamp.wrapping_sub(end) as i64
    };
    let least = stamps.iter().map(ahead).min().unwrap_or_default();
    stamps.iter().map(|stamp| (ahead(stamp) - least) as u64).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn added_span_starts_when_adapter_can_act() {
        let passages = [[100, 40, 130], [100, 120, 130]];
        let added = added(passages.into_iter().map(|passage| passage.map(Nanos)));
        assert_eq!([0.0, 1.0].map(|share| added.quantile(share)), [0.01, 0.03]);
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
