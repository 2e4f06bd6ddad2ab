//! The bus with classic, FD tolerant and FD nodes, and with an FD controller.

use std::collections::VecDeque;

use armwire_bridge::can::FD_LENGTHS;
use armwire_sim::can::{FdFlags, Frame, Id};
use proptest::prelude::*;

use super::absent::Absent;
use super::bus::{Bus, Record};
use super::confinement::Confinement;
use super::*;

const RATE: u32 = 1_000_000;
const DATA_RATE: u32 = 2_000_000;
const FD: fn() -> NodeConfig = || NodeConfig::fd(RATE, DATA_RATE);
/// One bit at [`RATE`].
const BIT: Nanos = Nanos(1_000);
/// Longer than any frame at these rates.
const LONG: Nanos = Nanos(1_000_000);

fn classic(id: u16, data: &[u8]) -> Frame {
    Frame::data_frame(Id::Standard(id), data).unwrap()
}

fn fd(id: u16, data: &[u8]) -> Frame {
    Frame::fd_frame(Id::Standard(id), data, true).unwrap()
}

fn slow_fd(id: u16, data: &[u8]) -> Frame {
    Frame::fd_frame(Id::Standard(id), data, false).unwrap()
}

/// A bus, and a controller on it.
struct Bench<C> {
    bus: Bus,
    controller: C,
    now: Nanos,
}

impl Bench<Absent> {
    /// A bus with joined nodes 0, 1, ... and no board.
    fn of(nodes: &[NodeConfig]) -> Self {
        Bench::with(Absent, nodes)
    }
}

impl<C: Controller> Bench<C> {
    fn with(controller: C, nodes: &[NodeConfig]) -> Self {
        let mut bus = Bus::default();
        for (node, config) in (0..).zip(nodes) {
            bus.join(node, *config);
        }
        let now = Nanos(0);
        let mut bench = Self { bus, controller, now };
        bench.run(LONG);
        bench
    }

    fn send(&mut self, node: u8, frame: Frame) {
        assert!(self.bus.can_send(node, &frame));
        self.bus.send(node, frame);
        self.bus.poll(self.now, &mut self.controller);
    }

    fn run(&mut self, span: Nanos) {
        let until = self.now + span;
        while let Some(next) = self.bus.poll(self.now, &mut self.controller) {
            if next > until {
                break;
            }
            self.now = next;
        }
        self.now = until;
    }

    /// Runs until `count` frames have ended.
    fn run_frames(&mut self, count: usize) {
        while self.bus.records().len() < count {
            match self.bus.poll(self.now, &mut self.controller) {
                Some(next) => self.now = next,
                None => assert_eq!(self.bus.records().len(), count, "no frame is on the way"),
            }
        }
    }

    fn outcomes(&self) -> Vec<Outcome> {
        self.bus.records().iter().map(|record| record.outcome).collect()
    }

    fn errors(&self, node: u8) -> (u32, u32, ErrorState) {
        self.bus.errors(node).unwrap()
    }
}

fn took(record: &Record) -> u64 {
    record.end.since(record.start).0
}

#[test]
fn fd_frame_duration_is_exact_at_all_rates() {
    let data: Vec<u8> = (0..24).collect();
    for (rate, bit) in [(125_000, 8_000), (250_000, 4_000), (500_000, 2_000), (1_000_000, 1_000)] {
        for (data_rate, data_bit) in [(1_000_000, 1_000), (2_000_000, 500), (4_000_000, 250), (5_000_000, 200)] {
            let config = NodeConfig::fd(rate, data_rate);
            let mut bench = Bench::of(&[config, config]);
            bench.send(0, fd(0x610, &data));
            bench.send(0, slow_fd(0x610, &data));
            bench.send(0, classic(0x610, &[]));
            bench.run_frames(3);
            let [fast, slow, classic] = bench.bus.records() else {
                panic!("{:?}", bench.bus.records());
            };
            assert_eq!(took(fast), 27 * bit + 246 * data_bit, "{rate} and {data_rate}");
            assert_eq!(took(slow), 273 * bit);
            assert_eq!(slow.start.since(fast.end), Nanos(3 * bit));
            assert_eq!(classic.outcome, Outcome::Sent);
        }
    }
}

#[test]
fn fd_frames_of_every_length_reach_all_nodes() {
    let mut bench = Bench::of(&[FD(), FD(), FD()]);
    let frames = FD_LENGTHS.map(|len| fd(0x100, &vec![len; len.into()]));
    for frame in frames {
        bench.send(0, frame);
    }
    bench.run_frames(frames.len());
    for node in [1, 2] {
        assert_eq!(bench.bus.take_received_by(node), frames);
        assert_eq!(bench.errors(node), (0, 0, ErrorState::Active));
    }
    assert!(bench.bus.take_received_by(0).is_empty(), "not its own");
}

#[test]
fn classic_node_destroys_fd_frames_until_error_passive() {
    let mut bench = Bench::of(&[FD(), FD(), NodeConfig::classic(RATE)]);
    bench.send(0, fd(0x123, &[]));
    bench.run_frames(16);
    let mut expected = vec![Outcome::Garbled; 15];
    expected.push(Outcome::Sent);
    assert_eq!(bench.outcomes(), expected);
    // Nine for each frame that it destroyed, one for the frame that it could not.
    assert_eq!(bench.errors(2), (0, 136, ErrorState::Passive));
    assert_eq!(bench.errors(0), (119, 0, ErrorState::Active));
    assert_eq!(bench.errors(1), (0, 14, ErrorState::Active));
    assert_eq!(bench.bus.take_received_by(1), [fd(0x123, &[])]);
    assert!(bench.bus.take_received_by(2).is_empty());
    // 17 bits to BRS, 32 of 0.5 us to the CRC delimiter, and an error frame of 14.
    assert_eq!(took(&bench.bus.records()[0]), 17_000 + 16_000 + 14_000);

    bench.send(0, classic(0x123, &[7]));
    bench.run_frames(17);
    assert_eq!(bench.bus.take_received_by(2), [classic(0x123, &[7])]);
    assert_eq!(
        bench.errors(2),
        (0, 120, ErrorState::Active),
        "a valid frame ends error passive"
    );
}

#[test]
fn fd_tolerant_node_ignores_fd_frames() {
    let tolerant = NodeConfig::fd_tolerant(RATE);
    let mut bench = Bench::of(&[FD(), FD(), tolerant]);
    bench.send(0, fd(0x123, &[1; 64]));
    bench.send(0, classic(0x123, &[1]));
    bench.run_frames(2);
    assert_eq!(bench.outcomes(), [Outcome::Sent; 2]);
    assert_eq!(bench.bus.take_received_by(2), [classic(0x123, &[1])]);
    assert_eq!(bench.errors(2), (0, 0, ErrorState::Active));

    let mut bench = Bench::of(&[FD(), tolerant]);
    bench.send(0, fd(0x123, &[1; 64]));
    bench.run_frames(1);
    assert_eq!(bench.outcomes(), [Outcome::Unacknowledged]);
}

#[test]
fn wrong_data_rate_shows_only_in_switching_frames() {
    let mut bench = Bench::of(&[FD(), NodeConfig::fd(RATE, 5_000_000)]);
    bench.send(0, classic(0x123, &[1]));
    bench.send(0, slow_fd(0x123, &[2]));
    bench.send(0, fd(0x123, &[3]));
    bench.run_frames(4);
    assert_eq!(
        bench.outcomes(),
        [Outcome::Sent, Outcome::Sent, Outcome::Garbled, Outcome::Garbled]
    );
    assert_eq!(
        bench.bus.take_received_by(1),
        [classic(0x123, &[1]), slow_fd(0x123, &[2])]
    );
    assert_eq!((bench.errors(0).0, bench.errors(1).1), (16, 18));
}

#[test]
fn wrong_nominal_rate_shows_in_every_frame() {
    for frame in [classic(0x123, &[1]), slow_fd(0x123, &[2]), fd(0x123, &[3])] {
        let mut bench = Bench::of(&[FD(), NodeConfig::fd(RATE / 2, DATA_RATE)]);
        bench.send(0, frame);
        bench.run_frames(1);
        assert_eq!(bench.outcomes(), [Outcome::Garbled], "{frame:?}");
        assert!(bench.bus.take_received_by(1).is_empty());
    }
}

#[test]
fn data_rate_errors_cause_bus_off_and_recover() {
    let mut bench = Bench::of(&[FD()]);
    // The attached nodes are never error passive.
    bench.bus.attach_as(NodeConfig::fd(RATE, 5_000_000));
    bench.send(0, fd(0x123, &[]));
    for attempt in 1..32 {
        bench.run_frames(attempt);
        let state = match 8 * attempt {
            ..128 => ErrorState::Active,
            _ => ErrorState::Passive,
        };
        assert_eq!(bench.errors(0), (8 * attempt as u32, 0, state));
    }
    let [.., before, last] = bench.bus.records() else {
        panic!("two");
    };
    assert_eq!(
        last.start.since(before.end),
        Nanos(11 * BIT.0),
        "a passive sender waits"
    );
    assert!(last.frame.fd.unwrap().error_passive && !bench.bus.records()[0].frame.fd.unwrap().error_passive);
    bench.run_frames(32);
    assert_eq!(bench.errors(0).2, ErrorState::BusOff);
    let off = bench.bus.records()[31].end;

    bench.bus.attach_as(FD());
    bench.run_frames(33);
    let recovered = &bench.bus.records()[32];
    // The eleven bits at the end of the last frame count.
    assert_eq!(recovered.start.since(off), Nanos((3 + 127 * 11) * BIT.0));
    assert_eq!((recovered.outcome, recovered.frame), (Outcome::Sent, fd(0x123, &[])));
    assert_eq!(bench.errors(0), (0, 0, ErrorState::Active));
}

#[test]
fn classic_frame_wins_over_fd_frame_of_identifier() {
    let mut bench = Bench::of(&[FD(), FD(), FD()]);
    bench.send(2, fd(0x000, &[]));
    bench.send(0, fd(0x123, &[1]));
    bench.send(1, classic(0x123, &[2]));
    bench.run_frames(3);
    let order: Vec<Sender> = bench.bus.records().iter().map(|record| record.sender).collect();
    assert_eq!(order, [Sender::Node(2), Sender::Node(1), Sender::Node(0)]);
    assert_eq!(bench.outcomes(), [Outcome::Sent; 3]);
}

#[test]
fn silent_node_receives_and_leaves_no_trace() {
    let mut bench = Bench::of(&[FD(), FD().silent(), NodeConfig::classic(RATE).silent()]);
    assert!(!bench.bus.can_send(1, &classic(1, &[])));
    bench.send(0, fd(0x123, &[1]));
    bench.run_frames(1);
    assert_eq!(bench.outcomes(), [Outcome::Unacknowledged], "and not destroyed");
    bench.bus.attach_as(FD());
    bench.run_frames(2);
    assert_eq!(bench.bus.take_received_by(1), [fd(0x123, &[1])]);
}

#[test]
fn node_joining_midframe_receives_the_next_frame() {
    let mut bench = Bench::of(&[FD(), FD()]);
    bench.send(0, fd(1, &[]));
    bench.bus.join(2, FD());
    bench.send(0, fd(2, &[]));
    bench.run_frames(2);
    assert_eq!(bench.bus.take_received_by(1), [fd(1, &[]), fd(2, &[])]);
    assert_eq!(bench.bus.take_received_by(2), [fd(2, &[])]);
}

#[test]
fn sender_leaving_midframe_cuts_its_frame() {
    let mut bench = Bench::of(&[FD(), FD()]);
    bench.send(0, fd(1, &[]));
    bench.bus.leave(0);
    bench.run(LONG);
    assert_eq!(bench.outcomes(), [Outcome::Cut]);
    assert!(bench.bus.take_received_by(1).is_empty());
}

/// An FD controller, with a record of its calls.
struct Device {
    data_bit: u64,
    queue: VecDeque<Frame>,
    is_sending: bool,
    confinement: Confinement,
    received: Vec<Frame>,
    faults: Vec<(bool, Fault)>,
}

impl Device {
    fn new(data_bit: u64, queue: &[Frame]) -> Self {
        Self {
            data_bit,
            queue: queue.iter().copied().collect(),
            is_sending: false,
            confinement: Confinement::default(),
            received: Vec::new(),
            faults: Vec::new(),
        }
    }
}

impl Controller for Device {
    fn bit(&self) -> u64 {
        1_000_000
    }

    fn capability(&self) -> Capability {
        let data_bit = self.data_bit;
        Capability::Fd { data_bit }
    }

    fn listens(&self) -> bool {
        self.state() != ErrorState::BusOff
    }

    fn drives(&self) -> bool {
        true
    }

    fn state(&self) -> ErrorState {
        self.confinement.state()
    }

    fn offer(&self) -> Option<Frame> {
        self.queue
            .front()
            .copied()
            .filter(|_| self.listens() && !self.is_sending)
    }

    fn requested(&self) -> Option<Nanos> {
        None
    }

    fn sends(&self) -> bool {
        self.is_sending
    }

    fn begin(&mut self, own: bool) {
        self.is_sending = own;
    }

    fn lose(&mut self) {}

    fn receive(&mut self, frame: &Frame) {
        self.confinement.received();
        self.received.push(*frame);
    }

    fn receive_error(&mut self, fault: Fault) {
        self.confinement.receive_fault(fault);
        self.faults.push((false, fault));
    }

    fn transmit_error(&mut self, fault: Fault) {
        self.confinement.transmit_error(fault.error);
        self.faults.push((true, fault));
    }

    fn end(&mut self, sent: bool, _: Nanos) {
        if sent {
            self.queue.pop_front();
            self.confinement.transmitted();
        }
        self.is_sending = false;
    }

    fn due(&self) -> Option<Nanos> {
        None
    }

    fn tick(&mut self) {}
}

const HALF: u64 = 500_000;
const FIFTH: u64 = 200_000;

#[test]
fn controller_and_nodes_exchange_fd_frames() {
    let mut bench = Bench::with(Device::new(HALF, &[]), &[FD(), FD()]);
    bench.controller.queue.push_back(fd(0x200, &[2; 64]));
    bench.send(0, fd(0x100, &[1; 48]));
    bench.run_frames(2);
    assert_eq!(bench.controller.received, [fd(0x100, &[1; 48])]);
    assert_eq!(
        bench.bus.take_received_by(1),
        [fd(0x100, &[1; 48]), fd(0x200, &[2; 64])]
    );
    assert!(bench.controller.faults.is_empty() && bench.controller.queue.is_empty());
}

#[test]
fn controller_alone_acknowledges_a_node() {
    let mut bench = Bench::with(Device::new(HALF, &[]), &[FD()]);
    bench.send(0, fd(0x100, &[1; 48]));
    bench.run_frames(1);
    assert_eq!(bench.outcomes(), [Outcome::Sent]);
}

#[test]
fn controller_at_wrong_data_rate_sees_phase_errors() {
    let mut bench = Bench::with(Device::new(FIFTH, &[]), &[FD(), FD()]);
    bench.send(0, classic(0x100, &[1]));
    bench.send(0, fd(0x100, &[2]));
    bench.run_frames(2);
    assert_eq!(bench.controller.received, [classic(0x100, &[1])]);
    let fault = Fault {
        error: BusError::Stuff,
        in_data_phase: true,
        is_own: true,
    };
    assert_eq!(bench.controller.faults, [(false, fault)]);
    bench.run_frames(17);
    assert_eq!(bench.controller.state(), ErrorState::Passive);
    assert_eq!(bench.outcomes().last(), Some(&Outcome::Sent));

    bench.controller.queue.push_back(fd(0x200, &[3]));
    bench.run_frames(18);
    let fault = Fault {
        error: BusError::RecessiveBit,
        ..fault
    };
    assert_eq!(bench.controller.faults.last(), Some(&(true, fault)));
}

#[test]
fn controller_sees_error_flag_of_classic_node() {
    let mut bench = Bench::with(Device::new(HALF, &[]), &[FD(), NodeConfig::classic(RATE)]);
    bench.send(0, fd(0x100, &[2]));
    bench.run_frames(1);
    let fault = Fault {
        error: BusError::Stuff,
        in_data_phase: true,
        is_own: false,
    };
    assert_eq!(bench.controller.faults, [(false, fault)]);
    assert_eq!(bench.controller.confinement.receive(), 1);
}

fn nodes() -> impl Strategy<Value = NodeConfig> {
    prop_oneof![
        4 => Just(FD()),
        1 => Just(FD().silent()),
        1 => Just(NodeConfig::classic(RATE)),
        1 => Just(NodeConfig::classic(RATE).silent()),
        1 => Just(NodeConfig::fd_tolerant(RATE)),
        1 => Just(NodeConfig::fd(RATE, 5_000_000)),
        1 => Just(NodeConfig::fd(RATE / 4, DATA_RATE)),
    ]
}

fn frames() -> impl Strategy<Value = Frame> {
    let id = prop_oneof![
        (0..=0x7FF_u16).prop_map(Id::Standard),
        (0..=Id::MAX_EXTENDED).prop_map(Id::Extended),
    ];
    let kind = prop::option::of(any::<bool>());
    (id, kind, any::<bool>(), 0..16_u8, any::<[u8; 64]>()).prop_map(|(id, kind, remote, dlc, data)| match kind {
        None => Frame::classic(id, remote, dlc, &data),
        Some(bit_rate_switch) => {
            let flags = FdFlags {
                bit_rate_switch,
                error_passive: false,
            };
            Frame::fd(id, flags, dlc, &data)
        }
    })
}

proptest! {
    #[test]
    fn frame_reaches_every_fd_node_or_none(
        frame in frames(),
        others in prop::collection::vec(nodes(), 1..5),
    ) {
        let mut bench = Bench::of(&[&[FD()], &others[..]].concat());
        bench.send(0, frame);
        for attempt in 1..40 {
            if bench.bus.records().last().is_some_and(|record| record.outcome == Outcome::Sent) {
                break;
            }
            if bench.errors(0).2 == ErrorState::BusOff {
                break;
            }
            bench.run_frames(attempt);
            let record = bench.bus.records()[attempt - 1];
            for (node, config) in (1..).zip(&others) {
                let received = bench.bus.take_received_by(node);
                let follows = *config == FD() || *config == FD().silent();
                match record.outcome {
                    Outcome::Sent if follows => prop_assert_eq!(received, vec![record.frame]),
                    Outcome::Sent => prop_assert!(received.is_empty() || received == [record.frame]),
                    _ => prop_assert!(received.is_empty()),
                }
            }
            let sent = Frame { fd: frame.fd.map(|flags| FdFlags { error_passive: errors_passive(&record), ..flags }), ..frame };
            prop_assert_eq!(record.frame, sent);
        }
    }
}

/// ESI of a frame.
fn errors_passive(record: &Record) -> bool {
    record.frame.fd.is_some_and(|flags| flags.error_passive)
}
