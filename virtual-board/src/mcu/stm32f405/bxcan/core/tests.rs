//! The controller by its registers, on a bus with other nodes.

use super::*;
use crate::can::bus::{Bus, Record};
use crate::can::{Outcome, Sender};

/// 42 MHz and 6 times 14 quanta: 500 kbit/s. Segments of 10 and 3 quanta.
const CLOCK: u64 = 42_000_000;
const TIMING: u32 = 5 | 9 << btr::TS1_AT | 2 << btr::TS2_AT;
const RATE: u32 = 500_000;
const BIT: u64 = 2_000;

/// Offsets of a mailbox's length and first data.
const LENGTH: u32 = 0x4;
const DATA_LOW: u32 = 0x8;

mod errors;
mod fifos;
mod mailboxes;

struct Bench {
    core: Core,
    bus: Bus,
}

impl Bench {
    /// A controller out of reset on a bus with nodes.
    fn asleep() -> Self {
        let mut bus = Bus::default();
        bus.attach(RATE);
        let core = Core {
            clock_hz: CLOCK,
            ..Core::new()
        };
        Self { core, bus }
    }

    /// The same in normal mode, with all frames accepted to FIFO 0.
    fn new() -> Self {
        Self::with(TIMING, 0)
    }

    fn with(timing: u32, control: u32) -> Self {
        let mut bench = Self::asleep();
        bench.write(MCR, control | mcr::INRQ);
        bench.write(BTR, timing);
        for (offset, value) in [(FS1R, 1), (FA1R, 1), (FMR, 28 << fmr::CAN2SB_AT), (MCR, control)] {
            bench.write(offset, value);
        }
        bench.run(11);
        assert_eq!(bench.core.read(MSR) & (msr::INAK | msr::SLAK), 0, "normal mode");
        bench
    }

    fn write(&mut self, offset: u32, value: u32) {
        self.core.write(offset, value);
        self.bus.poll(self.core.now, &mut self.core);
    }

    fn run(&mut self, bits: u64) {
        self.run_for(Nanos(bits * BIT));
    }

    fn run_for(&mut self, span: Nanos) {
        let until = self.core.now + span;
        while let Some(next) = self
            .bus
            .poll(self.core.now, &mut self.core)
            .filter(|&next| next <= until)
        {
            self.core.now = next;
        }
        self.core.now = until;
        self.bus.poll(until, &mut self.core);
    }

    /// Requests a transmission of one byte by `mailbox`.
    fn request(&mut self, mailbox: u32, id: u32, byte: u8) {
        let at = MAILBOXES + mailbox * MAILBOX_SPAN;
        self.write(at + LENGTH, 1);
        self.write(at + DATA_LOW, byte.into());
        self.write(at + IDENTIFIER, id << identifier::STID_AT | identifier::TXRQ);
    }

    fn node_sends(&mut self, node: u8, id: u16, data: &[u8]) {
        self.bus.send(node, frame(id, data));
        self.bus.poll(self.core.now, &mut self.core);
    }

    fn ids(&self) -> Vec<(Sender, u32, Outcome)> {
        let each = |record: &Record| (record.sender, record.frame.id.value(), record.outcome);
        self.bus.records().iter().map(each).collect()
    }

    /// TEC and REC.
    fn counters(&self) -> (u32, u32) {
        let status = self.core.read(ESR);
        (status >> esr::TEC_AT & 0xFF, status >> esr::REC_AT)
    }

    fn last_error(&self) -> u32 {
        self.core.read(ESR) >> esr::LEC_AT & esr::LEC
    }

    /// Releases the frame at the front of FIFO 0, and returns its identifier.
    fn take(&mut self) -> u32 {
        let id = self.core.read(FIFOS + IDENTIFIER) >> identifier::STID_AT;
        self.write(RF0R, rfr::RFOM);
        id
    }
}

fn frame(id: u16, data: &[u8]) -> Frame {
    Frame::data_frame(Id::Standard(id), data).unwrap()
}

/// Longer than any frame.
const LONG: u64 = 200;

#[test]
fn reset_state_is_sleep_and_modes_are_acknowledged() {
    let mut bench = Bench::asleep();
    assert_eq!(bench.core.read(MCR), 0x0001_0002);
    assert_eq!(bench.core.read(MSR), 0x0000_0C02);
    assert_eq!(bench.core.read(TSR), 0x1C00_0000);
    assert_eq!(bench.core.read(FMR), 0x2A1C_0E01);
    bench.write(MCR, mcr::INRQ);
    assert_eq!(bench.core.read(MSR) & (msr::INAK | msr::SLAK), msr::INAK);
    bench.write(BTR, TIMING);
    bench.write(MCR, 0);
    bench.run(10);
    assert_eq!(
        bench.core.read(MSR) & msr::INAK,
        msr::INAK,
        "eleven recessive bits first"
    );
    bench.run(1);
    assert_eq!(bench.core.read(MSR) & msr::INAK, 0);
    bench.write(IER, ier::SLKIE);
    bench.write(MCR, mcr::SLEEP);
    assert_eq!(bench.core.read(MSR) & (msr::SLAK | msr::SLAKI), msr::SLAK | msr::SLAKI);
    assert_eq!(bench.core.interrupts(), [false, false, false, true]);
    bench.write(MSR, msr::SLAKI);
    assert_eq!(bench.core.interrupts(), [false; 4]);
}

#[test]
fn bit_timing_is_written_in_initialization_mode_only() {
    let mut bench = Bench::new();
    bench.write(BTR, 0);
    assert_eq!(bench.core.read(BTR), TIMING);
    assert_eq!(bench.core.bit(), BIT * 1_000);
}

#[test]
fn frame_takes_its_bits_with_stuff_bits() {
    // From the start of frame to the end of the end of frame, as computed by another program.
    for (frame, bits) in [
        (frame(0x123, b"joints"), 92),
        (frame(0, &[0; 8]), 124),
        (frame(0x7FF, &[]), 47),
        (Frame::data_frame(Id::Extended(0x1456_7890), &[1, 2]).unwrap(), 84),
        (Frame::remote_frame(Id::Standard(0x555), 4), 44),
    ] {
        let mut bench = Bench::new();
        let at = MAILBOXES + MAILBOX_SPAN;
        let [low, high] =
            [&frame.data[..4], &frame.data[4..8]].map(|half| u32::from_le_bytes(half.try_into().unwrap()));
        for (offset, value) in [(4, frame.dlc.into()), (8, low), (12, high)] {
            bench.write(at + offset, value);
        }
        let start = bench.core.now;
        bench.write(at, identifier_of(&frame) | identifier::TXRQ);
        bench.run(bits - 1);
        assert_eq!(bench.core.read(TSR) & tsr::RQCP << 8, 0, "{frame:?}");
        assert_eq!(bench.core.read(MSR) & msr::TXM, msr::TXM);
        bench.run(1);
        let done = tsr::RQCP | tsr::TXOK;
        assert_eq!(bench.core.read(TSR) >> 8 & 0xFF, done, "{frame:?}");
        let record = bench.bus.records()[0];
        assert_eq!((record.start, record.end.since(start)), (start, Nanos(bits * BIT)));
        assert_eq!(bench.bus.take_received(), [frame]);
    }
}

#[test]
fn frames_follow_each_other_after_three_bits() {
    let mut bench = Bench::new();
    bench.request(0, 1, 1);
    bench.request(1, 2, 2);
    bench.run(2 * LONG);
    let [first, second] = bench.bus.records() else {
        panic!("{:?}", bench.bus.records());
    };
    assert_eq!(second.start.since(first.end), Nanos(3 * BIT));
}

#[test]
fn mailboxes_are_ordered_by_identifier_or_request() {
    let ids = |control| {
        let mut bench = Bench::with(TIMING, control);
        // The first is sent at once.
        for (mailbox, id) in [(0, 5), (1, 9), (2, 7)] {
            bench.request(mailbox, id, 0);
        }
        let status = bench.core.read(TSR);
        bench.run(4 * LONG);
        let ids: Vec<u32> = bench.ids().iter().map(|&(_, id, _)| id).collect();
        (ids, status >> tsr::CODE_AT & 3, status >> 29)
    };
    assert_eq!(
        ids(0),
        (vec![5, 7, 9], 1, 0b010),
        "CODE and LOW name the highest identifier"
    );
    assert_eq!(ids(mcr::TXFP), (vec![5, 9, 7], 2, 0b100));
}

#[test]
fn lowest_identifier_wins_the_bus() {
    let mut bench = Bench::new();
    bench.node_sends(0, 0x100, &[0]);
    bench.node_sends(1, 0x300, &[1]);
    bench.node_sends(2, 0x080, &[2]);
    bench.request(0, 0x200, 3);
    bench.run(5 * LONG);
    use Sender::{Board, Node};
    let sent = Outcome::Sent;
    assert_eq!(
        bench.ids(),
        [
            (Node(0), 0x100, sent),
            (Node(2), 0x080, sent),
            (Board, 0x200, sent),
            (Node(1), 0x300, sent)
        ],
        "the first found the bus free"
    );
    assert_eq!(
        bench.core.read(TSR) & 0xFF,
        tsr::RQCP | tsr::TXOK | tsr::ALST,
        "it lost one arbitration"
    );
    assert_eq!([bench.take(), bench.take(), bench.take()], [0x100, 0x080, 0x300]);
}

#[test]
fn one_shot_frame_ends_after_arbitration_loss() {
    let mut bench = Bench::with(TIMING, mcr::NART);
    bench.node_sends(0, 0x100, &[0]);
    bench.node_sends(0, 0x101, &[0]);
    bench.request(0, 0x200, 3);
    bench.run(4 * LONG);
    assert_eq!(bench.core.read(TSR) & 0xFF, tsr::RQCP | tsr::ALST);
    assert_eq!(bench.core.read(TSR) & tsr::TME, tsr::TME);
    assert_eq!(bench.ids().len(), 2);
}

#[test]
fn unacknowledged_frame_is_repeated_until_passive_on_bus() {
    let mut bench = Bench::new();
    bench.bus.detach();
    bench.request(0, 1, 0);
    bench.run(10_000);
    assert!(bench.bus.records().len() > 100);
    assert!(
        bench
            .ids()
            .iter()
            .all(|&(_, _, outcome)| outcome == Outcome::Unacknowledged)
    );
    assert_eq!(bench.counters(), (128, 0));
    assert_eq!(bench.core.read(ESR) & 7, esr::EWGF | esr::EPVF);
    assert_eq!(bench.last_error(), BusError::Acknowledge as u32);
    let [.., before, last] = bench.bus.records() else {
        panic!("two");
    };
    assert_eq!(
        last.start.since(before.end),
        Nanos((3 + 8) * BIT),
        "a passive sender waits"
    );
    bench.bus.attach(RATE);
    bench.run(2 * LONG);
    assert_eq!(bench.counters(), (127, 0));
    assert_eq!(bench.last_error(), 0);
    assert_eq!(bench.core.read(TSR) & 0xFF, tsr::RQCP | tsr::TXOK | tsr::TERR);
}

#[test]
fn one_shot_frame_is_not_repeated() {
    let mut bench = Bench::with(TIMING, mcr::NART);
    bench.bus.set_acknowledging(false);
    bench.request(0, 1, 0);
    bench.run(4 * LONG);
    assert_eq!(bench.core.read(TSR) & 0xFF, tsr::RQCP | tsr::TERR);
    assert_eq!(bench.ids().len(), 1);
}

#[test]
fn destroyed_frame_counts_eight_and_goes_again() {
    let mut bench = Bench::new();
    bench.bus.destroy(2);
    bench.request(0, 1, 0);
    bench.run(5 * LONG);
    let outcomes: Vec<Outcome> = bench.ids().iter().map(|&(_, _, outcome)| outcome).collect();
    assert_eq!(outcomes, [Outcome::Destroyed, Outcome::Destroyed, Outcome::Sent]);
    assert_eq!(bench.counters(), (15, 0));
    let [first, second, _] = bench.bus.records() else {
        panic!("three");
    };
    let bits = u64::from(first.frame.bits_through_acknowledge() + 6 + 8);
    assert_eq!(first.end.since(first.start), Nanos(bits * BIT));
    assert_eq!(second.start.since(first.end), Nanos(3 * BIT));
}

#[test]
fn abort_empties_waiting_mailbox_but_spares_current_frame() {
    let mut bench = Bench::new();
    bench.request(0, 1, 0);
    bench.request(1, 2, 0);
    bench.write(TSR, tsr::ABRQ | tsr::ABRQ << 8);
    assert_eq!(bench.core.read(TSR) >> 8 & 0xFF, tsr::RQCP);
    assert_eq!(bench.core.read(TSR) & 0xFF, tsr::ABRQ, "on the bus");
    bench.run(2 * LONG);
    assert_eq!(bench.core.read(TSR) & 0xFF, tsr::RQCP | tsr::TXOK);
    assert_eq!(bench.ids().len(), 1);

    bench.bus.destroy(1);
    bench.request(0, 1, 0);
    bench.write(TSR, tsr::ABRQ);
    bench.run(2 * LONG);
    assert_eq!(bench.core.read(TSR) & 0xFF, tsr::RQCP | tsr::TERR, "it is not repeated");
}

#[test]
fn mailbox_in_use_is_write_protected() {
    let mut bench = Bench::new();
    bench.request(0, 1, 7);
    bench.write(MAILBOXES + DATA_LOW, 9);
    bench.write(MAILBOXES + IDENTIFIER, 0);
    bench.run(LONG);
    assert_eq!(bench.bus.take_received(), [frame(1, &[7])]);
}

#[test]
fn received_frame_is_in_fifo_one_bit_early() {
    let mut bench = Bench::new();
    bench.write(IER, ier::FMPIE);
    let sent = frame(0x123, b"joints");
    bench.node_sends(0, 0x123, b"joints");
    bench.run(u64::from(sent.bits_on_the_wire()) - 2);
    assert_eq!(bench.core.read(RF0R), 0);
    assert_eq!(bench.core.read(MSR) & (msr::RXM | msr::TXM), msr::RXM);
    bench.run(1);
    assert_eq!(bench.core.read(RF0R), 1);
    assert_eq!(bench.core.interrupts(), [false, true, false, false]);
    let registers = [0, 4, 8, 12].map(|offset| bench.core.read(FIFOS + offset));
    let [low, high] = [b"join", b"ts\0\0"].map(|half| u32::from_le_bytes(*half));
    assert_eq!(registers, [0x123 << identifier::STID_AT, 6, low, high]);
    bench.write(RF0R, rfr::RFOM);
    assert_eq!((bench.core.read(RF0R), bench.core.interrupts()), (0, [false; 4]));
}

#[test]
fn fourth_frame_replaces_third_unless_fifo_is_locked() {
    for (control, ids) in [(0, [1, 2, 4]), (mcr::RFLM, [1, 2, 3])] {
        let mut bench = Bench::with(TIMING, control);
        bench.write(IER, ier::FFIE | ier::FOVIE);
        for id in 1..=3 {
            bench.node_sends(0, id, &[]);
        }
        bench.run(3 * LONG);
        assert_eq!(bench.core.read(RF0R), 3 | rfr::FULL);
        bench.node_sends(0, 4, &[]);
        bench.run(LONG);
        assert_eq!(bench.core.read(RF0R), 3 | rfr::FULL | rfr::FOVR);
        assert_eq!([bench.take(), bench.take(), bench.take()], ids);
        assert!(bench.core.interrupts()[1]);
        bench.write(RF0R, rfr::FULL | rfr::FOVR);
        assert!(!bench.core.interrupts()[1]);
    }
}

#[test]
fn controller_at_other_rate_destroys_frames_until_passive() {
    let mut bench = Bench::new();
    bench.bus.attach(250_000);
    bench.node_sends(0, 1, &[]);
    bench.run(60 * LONG);
    let outcomes: Vec<Outcome> = bench.ids().iter().map(|&(_, _, outcome)| outcome).collect();
    assert_eq!(outcomes.len(), 16, "15 times 9 is beyond 127");
    assert_eq!((outcomes[14], outcomes[15]), (Outcome::Garbled, Outcome::Sent));
    assert_eq!(bench.counters().1, 15 * 9 + 1);
    assert_eq!(bench.core.read(RF0R), 0);

    bench.bus.forget_records();
    bench.request(0, 1, 0);
    bench.run(LONG);
    assert_eq!(bench.ids()[0].2, Outcome::Garbled);
    assert!(bench.bus.take_received().is_empty());
}

#[test]
fn shorted_bus_means_bus_off_until_software_recovery() {
    let mut bench = Bench::new();
    bench.write(IER, ier::ERRIE | ier::BOFIE);
    bench.bus.set_shorted(true);
    bench.request(0, 1, 0);
    bench.run(1_000);
    assert_eq!(bench.core.read(ESR) & 7, esr::EWGF | esr::EPVF | esr::BOFF);
    assert_eq!(bench.last_error(), BusError::DominantBit as u32);
    assert_eq!(bench.core.interrupts(), [false, false, false, true]);
    // 16 errors in the first attempt, until its error flag is passive, then one in each.
    assert_eq!(bench.ids().len(), 17);
    let end = bench.bus.records().last().unwrap().end;

    bench.bus.set_shorted(false);
    bench.run(20_000);
    assert!(
        bench.core.read(ESR) & esr::BOFF != 0,
        "without ABOM it waits for software"
    );
    assert_eq!(bench.bus.records().last().unwrap().end, end);
    bench.write(MCR, mcr::INRQ);
    bench.write(MCR, 0);
    bench.run(11 + 128 * 11 - 1);
    assert!(bench.core.read(ESR) & esr::BOFF != 0);
    bench.run(1);
    assert_eq!(bench.core.read(ESR) & 7, 0);
    assert_eq!(bench.counters(), (0, 0));
    bench.run(LONG);
    assert_eq!(
        bench.ids().last(),
        Some(&(Sender::Board, 1, Outcome::Sent)),
        "the mailbox still waited"
    );
}

#[test]
fn abom_recovers_bus_off_until_lasting_short_repeats() {
    let mut bench = Bench::with(TIMING, mcr::ABOM);
    bench.bus.set_shorted(true);
    bench.request(0, 1, 0);
    bench.run(1_000);
    let off = bench.bus.records().last().unwrap().end;
    bench.run(1_000);
    let again = bench.bus.records()[17].start;
    assert_eq!(again.since(off), Nanos((3 + 128 * 11) * BIT));
    bench.bus.set_shorted(false);
    bench.run(4_000);
    assert_eq!(bench.ids().last(), Some(&(Sender::Board, 1, Outcome::Sent)));
}

#[test]
fn busy_bus_frames_count_towards_the_128() {
    let mut bench = Bench::with(TIMING, mcr::ABOM);
    bench.bus.set_shorted(true);
    bench.request(0, 0x7FF, 0);
    bench.run(700);
    assert!(bench.core.read(ESR) & esr::BOFF != 0);
    bench.bus.set_shorted(false);
    bench.bus.forget_records();
    bench.bus.set_flood(Some(frame(0, &[0])));
    bench.run(127 * LONG);
    let frames = bench.bus.records().len();
    assert!(bench.core.read(ESR) & esr::BOFF == 0 && frames > 127, "{frames}");
    bench.bus.set_flood(None);
    bench.run(2 * LONG);
    assert_eq!(bench.ids().last(), Some(&(Sender::Board, 0x7FF, Outcome::Sent)));
}

#[test]
fn error_interrupts_come_at_their_thresholds() {
    for (enable, attempts) in [(ier::LECIE, 1), (ier::EWGIE, 12), (ier::EPVIE, 16)] {
        let mut bench = Bench::new();
        bench.write(IER, enable | ier::ERRIE);
        bench.bus.destroy(attempts);
        bench.request(0, 1, 0);
        while bench.bus.records().len() + 1 < attempts as usize {
            bench.run(1);
        }
        assert!(!bench.core.interrupts()[3], "{enable:#x}");
        bench.run(LONG);
        assert!(bench.core.interrupts()[3], "{enable:#x}");
        bench.write(MSR, msr::ERRI);
        assert!(!bench.core.interrupts()[3]);
    }
}

#[test]
fn loop_back_mode_receives_only_own_frames() {
    for silent in [0, btr::SILM] {
        let mut bench = Bench::with(TIMING | btr::LBKM | silent, 0);
        bench.node_sends(0, 9, &[]);
        bench.request(0, 5, 0x42);
        bench.run(LONG);
        assert_eq!(bench.core.read(TSR) & 0xFF, tsr::RQCP | tsr::TXOK);
        assert_eq!((bench.core.read(RF0R), bench.core.read(FIFOS + DATA_LOW)), (1, 0x42));
        assert_eq!(bench.take(), 5);
        assert_eq!(bench.ids(), [(Sender::Node(0), 9, Outcome::Sent)]);
    }
}

#[test]
fn silent_mode_receives_and_sends_nothing() {
    let mut bench = Bench::with(TIMING | btr::SILM, 0);
    bench.node_sends(0, 9, &[]);
    bench.request(0, 5, 0);
    bench.run(3 * LONG);
    assert_eq!(bench.take(), 9);
    assert_eq!(bench.ids(), [(Sender::Node(0), 9, Outcome::Sent)]);
    assert_eq!(bench.core.read(TSR) & tsr::TME, 0, "its frame waits");
}

#[test]
fn start_of_frame_wakes_controller_for_next_frame() {
    let mut bench = Bench::with(TIMING, mcr::AWUM);
    bench.write(IER, ier::WKUIE);
    bench.write(MCR, mcr::AWUM | mcr::SLEEP);
    bench.node_sends(0, 1, &[]);
    assert_eq!(bench.core.interrupts(), [false, false, false, true]);
    bench.node_sends(0, 2, &[]);
    bench.run(3 * LONG);
    assert_eq!(bench.core.read(MSR) & (msr::SLAK | msr::WKUI), msr::WKUI);
    assert_eq!((bench.core.read(RF0R) & 3, bench.take()), (1, 2));
}

#[test]
fn initialization_waits_for_the_frame_on_the_bus() {
    let mut bench = Bench::new();
    bench.request(0, 1, 0);
    bench.write(MCR, mcr::INRQ);
    assert_eq!(bench.core.read(MSR) & msr::INAK, 0);
    bench.run(LONG);
    assert_eq!(bench.core.read(MSR) & msr::INAK, msr::INAK);
    assert_eq!(bench.ids(), [(Sender::Board, 1, Outcome::Sent)]);
}

#[test]
fn only_a_flood_with_lower_identifier_blocks_board() {
    for (flood, gets_through) in [(0, false), (0x7FF, true)] {
        let mut bench = Bench::new();
        bench.bus.set_flood(Some(frame(flood, &[0; 8])));
        bench.run(LONG);
        bench.request(0, 0x100, 0);
        bench.run(20 * LONG);
        let through = bench.ids().iter().any(|&(sender, ..)| sender == Sender::Board);
        assert_eq!(through, gets_through);
    }
}

#[test]
fn reset_cuts_the_frame_in_transmission() {
    let mut bench = Bench::new();
    bench.request(0, 1, 0);
    bench.run(10);
    bench.write(MCR, mcr::RESET);
    bench.run(LONG);
    assert_eq!(bench.ids(), [(Sender::Board, 1, Outcome::Cut)]);
    assert_eq!(bench.core.read(MSR) & msr::SLAK, msr::SLAK);
    assert!(bench.bus.take_received().is_empty());
}
