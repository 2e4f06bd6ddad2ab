//! Receive FIFOs, and the filters in front of them (RM0090, 32.7.3, 32.7.4, 32.9.2 RFxR and IER).

use super::*;

/// FMI of RDTxR.
const FMI: u32 = 0xFF << length::FMI_AT;

/// A controller with only these filters.
fn filtered(writes: &[(u32, u32)]) -> Bench {
    let mut bench = Bench::new();
    bench.write(FMR, 28 << fmr::CAN2SB_AT | fmr::FINIT);
    bench.write(FA1R, 0);
    for &(offset, value) in writes {
        bench.write(offset, value);
    }
    bench.write(FMR, 28 << fmr::CAN2SB_AT);
    bench
}

#[test]
fn fifos_have_own_registers_flags_and_interrupts() {
    // Bank 0 accepts 1 to FIFO 0, bank 1 accepts 2 to FIFO 1.
    let mut bench = filtered(&[
        (FS1R, 0b11),
        (FM1R, 0b11),
        (FFA1R, 0b10),
        (BANKS, 1 << identifier::STID_AT),
        (BANKS + 8, 2 << identifier::STID_AT),
        (BANKS + 12, 2 << identifier::STID_AT),
        (FA1R, 0b11),
    ]);
    bench.write(IER, (ier::FMPIE | ier::FFIE | ier::FOVIE) << 3);
    bench.node_sends(0, 1, &[]);
    bench.run(LONG);
    assert_eq!((bench.core.read(RF0R), bench.core.read(RF1R)), (1, 0));
    assert_eq!(bench.core.interrupts(), [false; 4], "FIFO 0 has none enabled");
    for _ in 0..4 {
        bench.node_sends(0, 2, &[]);
    }
    bench.run(4 * LONG);
    assert_eq!(
        (bench.core.read(RF0R), bench.core.read(RF1R)),
        (1, 3 | rfr::FULL | rfr::FOVR)
    );
    assert_eq!(bench.core.interrupts(), [false, false, true, false]);
    assert_eq!(
        bench.core.read(FIFOS + MAILBOX_SPAN + IDENTIFIER),
        2 << identifier::STID_AT
    );
    for _ in 0..3 {
        bench.write(RF1R, rfr::RFOM | rfr::FULL | rfr::FOVR);
    }
    assert_eq!((bench.core.read(RF0R), bench.core.read(RF1R)), (1, 0));
    assert_eq!(bench.core.interrupts(), [false; 4]);
}

#[test]
fn each_receive_interrupt_needs_its_own_enable() {
    for (enable, frames) in [(ier::FMPIE, 1), (ier::FFIE, 3), (ier::FOVIE, 4)] {
        let mut bench = Bench::new();
        bench.write(IER, enable);
        for nth in 1..=frames {
            assert!(!bench.core.interrupts()[1], "{enable:#x} before {nth}");
            bench.node_sends(0, nth, &[]);
            bench.run(LONG);
        }
        assert!(bench.core.interrupts()[1], "{enable:#x}");
    }
}

#[test]
fn pending_count_follows_and_empty_release_does_nothing() {
    let mut bench = Bench::new();
    let mut counts = Vec::new();
    for id in 1..=2 {
        bench.node_sends(0, id, &[]);
        bench.run(LONG);
        counts.push(bench.core.read(RF0R));
    }
    for _ in 0..3 {
        bench.write(RF0R, rfr::RFOM);
        counts.push(bench.core.read(RF0R));
    }
    assert_eq!(counts, [1, 2, 1, 0, 0]);
    bench.node_sends(0, 3, &[]);
    bench.run(LONG);
    assert_eq!(bench.take(), 3);
}

#[test]
fn unfiltered_frame_is_good_but_reaches_no_fifo() {
    let mut bench = filtered(&[(FS1R, 1), (FM1R, 1), (BANKS, 1 << identifier::STID_AT), (FA1R, 1)]);
    bench.write(IER, ier::FMPIE);
    bench.write(ESR, 7 << esr::LEC_AT);
    bench.node_sends(0, 9, &[]);
    bench.run(LONG);
    assert_eq!((bench.core.read(RF0R), bench.core.interrupts()), (0, [false; 4]));
    assert_eq!(bench.last_error(), 0);
}

#[test]
fn received_frame_has_filter_index_length_and_kind() {
    // Bank 0: two wide identifiers. Bank 1: four narrow ones.
    let narrow = |id: u32| id << 5;
    let mut bench = filtered(&[
        (FS1R, 0b01),
        (FM1R, 0b11),
        (BANKS, 0x1456_7890 << identifier::EXID_AT | identifier::IDE),
        (BANKS + 4, 2 << identifier::STID_AT | identifier::RTR),
        (BANKS + 8, narrow(4) << 16 | narrow(3)),
        (BANKS + 12, narrow(6) << 16 | narrow(5)),
        (FA1R, 0b11),
    ]);
    for (sent, index, registers) in [
        (
            Frame::data_frame(Id::Extended(0x1456_7890), &[1, 2, 3]).unwrap(),
            0,
            (0x1456_7890 << identifier::EXID_AT | identifier::IDE, 3),
        ),
        (
            Frame::remote_frame(Id::Standard(2), 5),
            1,
            (2 << identifier::STID_AT | identifier::RTR, 5),
        ),
        (frame(6, &[7; 8]), 5, (6 << identifier::STID_AT, 8)),
    ] {
        bench.bus.send(0, sent);
        bench.run(2 * LONG);
        let [id, length] = [0, 4].map(|offset| bench.core.read(FIFOS + offset));
        assert_eq!((length & FMI) >> length::FMI_AT, index, "{sent:?}");
        assert_eq!((id, length & length::DLC), registers);
        bench.write(RF0R, rfr::RFOM);
    }
}
