//! Error counters, error states, bus-off and recovery (RM0090, 32.7.6, 32.9.2 ESR).

use super::*;

impl Bench {
    /// EWGF, EPVF and BOFF.
    fn flags(&self) -> u32 {
        self.core.read(ESR) & 7
    }

    /// Runs until another frame has ended.
    fn run_through_a_frame(&mut self) {
        let ended = self.bus.records().len();
        for _ in 0..2 * LONG {
            if self.bus.records().len() > ended {
                return;
            }
            self.run(1);
        }
        panic!("no frame ended");
    }

    /// In bus-off, by 32 destroyed frames of mailbox 0.
    fn off(control: u32) -> Self {
        let mut bench = Self::with(TIMING, control);
        bench.bus.destroy(32);
        bench.request(0, 0x100, 0);
        for _ in 0..32 {
            bench.run_through_a_frame();
        }
        bench.bus.forget_records();
        assert_eq!(bench.flags(), esr::EWGF | esr::EPVF | esr::BOFF);
        bench
    }
}

#[test]
fn thirty_two_consecutive_destroyed_frames_are_bus_off() {
    let mut bench = Bench::new();
    bench.bus.destroy(100);
    bench.request(0, 1, 0);
    for attempt in 1..32 {
        bench.run_through_a_frame();
        let flags = match 8 * attempt {
            0..96 => 0,
            96..128 => esr::EWGF,
            _ => esr::EWGF | esr::EPVF,
        };
        assert_eq!((bench.counters(), bench.flags()), ((8 * attempt, 0), flags));
        assert_eq!(bench.last_error(), BusError::RecessiveBit as u32);
    }
    bench.run_through_a_frame();
    assert_eq!(bench.flags(), esr::EWGF | esr::EPVF | esr::BOFF);
    bench.run(20 * LONG);
    assert_eq!(bench.ids().len(), 32, "it sends nothing more");
}

#[test]
fn error_flags_clear_below_their_limits() {
    let mut bench = Bench::new();
    bench.bus.destroy(16);
    bench.request(0, 1, 0);
    while bench.counters().0 < 128 {
        bench.run_through_a_frame();
    }
    assert_eq!(bench.flags(), esr::EWGF | esr::EPVF);
    // The seventeenth attempt succeeds.
    bench.run_through_a_frame();
    assert_eq!((bench.counters(), bench.flags()), ((127, 0), esr::EWGF));
    for count in (95..127).rev() {
        bench.request(0, 1, 0);
        bench.run_through_a_frame();
        let flags = if count >= 96 { esr::EWGF } else { 0 };
        assert_eq!((bench.counters(), bench.flags()), ((count, 0), flags));
    }
}

#[test]
fn passive_receiver_is_active_after_one_good_frame() {
    let mut bench = Bench::new();
    bench.bus.attach(250_000);
    for _ in 0..15 {
        bench.node_sends(0, 1, &[]);
    }
    for attempt in 1..=15 {
        bench.run_through_a_frame();
        assert_eq!(bench.counters(), (0, 9 * attempt));
    }
    assert_eq!(bench.flags(), esr::EWGF | esr::EPVF);
    bench.bus.detach();
    bench.run(2 * LONG);
    bench.bus.attach(RATE);
    bench.node_sends(0, 2, &[]);
    bench.run_through_a_frame();
    assert_eq!((bench.counters(), bench.flags()), ((0, 120), esr::EWGF));
    bench.node_sends(0, 3, &[]);
    bench.run_through_a_frame();
    assert_eq!(bench.counters(), (0, 119));
}

#[test]
fn good_frame_clears_last_error_software_sets_it() {
    for own in [false, true] {
        let mut bench = Bench::new();
        bench.write(ESR, 7 << esr::LEC_AT);
        assert_eq!(bench.core.read(ESR), 7 << esr::LEC_AT, "the counters are read-only");
        if own {
            bench.request(0, 1, 0);
        } else {
            bench.node_sends(0, 1, &[]);
        }
        bench.run(LONG);
        assert_eq!(bench.last_error(), 0);
    }
}

#[test]
fn error_with_disabled_interrupt_raises_no_flag() {
    let mut bench = Bench::new();
    bench.write(IER, ier::ERRIE);
    bench.bus.destroy(20);
    bench.request(0, 1, 0);
    bench.run(10 * LONG);
    assert_eq!(
        (bench.core.read(MSR) & msr::ERRI, bench.core.interrupts()),
        (0, [false; 4])
    );
}

#[test]
fn bus_off_during_handler_needs_flag_cleared_first() {
    #[derive(Debug, PartialEq)]
    enum Step {
        Clear,
        Read,
    }
    use Step::{Clear, Read};
    // The handler's steps, the step at which the 32nd frame is destroyed, and the call that sees bus-off.
    for (steps, off_before, is_seen) in [
        ([Clear, Read], 0, true),
        ([Clear, Read], 1, true),
        ([Clear, Read], 2, true),
        ([Read, Clear], 0, true),
        ([Read, Clear], 1, false),
        ([Read, Clear], 2, true),
    ] {
        let mut bench = Bench::new();
        bench.write(IER, ier::ERRIE | ier::LECIE | ier::BOFIE);
        bench.bus.destroy(32);
        bench.request(0, 1, 0);
        for _ in 0..30 {
            bench.run_through_a_frame();
            bench.write(MSR, msr::ERRI);
            bench.write(ESR, 7 << esr::LEC_AT);
        }
        bench.run_through_a_frame();
        assert_eq!(bench.core.interrupts(), [false, false, false, true]);
        let mut seen = 0;
        for (at, step) in steps.iter().enumerate() {
            if at == off_before {
                bench.run_through_a_frame();
            }
            match step {
                Clear => bench.write(MSR, msr::ERRI),
                Read => seen |= bench.flags() & esr::BOFF,
            }
        }
        if off_before == steps.len() {
            bench.run_through_a_frame();
        }
        assert_ne!(bench.flags() & esr::BOFF, 0);
        let is_called_again = bench.core.interrupts()[3];
        assert_eq!(
            seen != 0 || is_called_again,
            is_seen,
            "{steps:?}, off before {off_before}"
        );
    }
}

#[test]
fn bus_off_controller_neither_receives_nor_sends() {
    let mut bench = Bench::off(0);
    bench.node_sends(0, 5, &[]);
    bench.run(3 * LONG);
    assert_eq!(bench.core.read(RF0R), 0);
    assert_eq!(bench.ids(), [(Sender::Node(0), 5, Outcome::Sent)]);
    assert_eq!(bench.core.read(TSR) & tsr::TME, 0, "its frame waits");
}

#[test]
fn initialization_mode_ignores_bus_and_keeps_bus_off() {
    let mut bench = Bench::off(0);
    bench.write(MCR, mcr::INRQ);
    bench.run(5_000);
    assert_ne!(bench.flags() & esr::BOFF, 0);
    bench.write(MCR, 0);
    bench.run(11 + 128 * 11 - 1);
    assert_ne!(
        bench.flags() & esr::BOFF,
        0,
        "128 times 11 bits count from when it left"
    );
    bench.run(1);
    assert_eq!((bench.flags(), bench.counters()), (0, (0, 0)));
}

#[test]
fn abom_set_in_bus_off_starts_recovery() {
    let mut bench = Bench::off(0);
    bench.run(1_000);
    bench.write(MCR, mcr::ABOM);
    bench.run(128 * 11 - 1);
    assert_ne!(bench.flags() & esr::BOFF, 0);
    bench.run(1);
    assert_eq!(bench.flags(), 0);
    bench.run(LONG);
    assert_eq!(bench.ids(), [(Sender::Board, 0x100, Outcome::Sent)]);
}

#[test]
fn interrupted_recovery_restarts_only_its_eleven_bits() {
    let mut bench = Bench::off(mcr::ABOM);
    // From the end of the intermission: ten times eleven bits, and ten bits that do not count.
    let off = bench.core.now;
    bench.run(3 + 10 * 11 + 10);
    bench.node_sends(0, 0x200, &[]);
    bench.run_through_a_frame();
    let [record] = bench.bus.records() else {
        panic!("one frame");
    };
    assert_eq!(record.start.since(off), Nanos(123 * BIT));
    // The frame ends with eleven recessive bits, including the three of its intermission; 117 times remain.
    let back = record.end + Nanos((3 + 117 * 11) * BIT);
    bench.run_for(Nanos(back.since(bench.core.now).0 - BIT));
    assert_ne!(bench.flags() & esr::BOFF, 0);
    bench.run(1);
    assert_eq!(bench.flags(), 0);
}
