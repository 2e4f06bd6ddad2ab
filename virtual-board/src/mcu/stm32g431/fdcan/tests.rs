//! The controller, its registers written by the tests.

use armwire_sim::can::{FdFlags, Frame, Id};

use super::controller::Controller;
use super::registers::*;
use crate::can::{BusError, Capability, Controller as _, ErrorState, Fault};
use crate::time::Nanos;

/// 160 quanta at 80 MHz with the prescaler at 2: 250 kbit/s. The data phase: 20 quanta, 4 Mbit/s.
const NBTP_250K: u32 = 1 << 16 | (139 - 1) << 8 | (20 - 1);
const DBTP_4M: u32 = (14 - 1) << 8 | (5 - 1) << 4;

const BUFFER: u32 = 0x278;
const FIFO_0: u32 = 0x0B0;
const ELEMENT: u32 = 72;

const ID: u32 = 0x123 << 18;
const FD_WITH_SWITCH: u32 = 1 << 21 | 1 << 20;

fn fault(error: BusError) -> Fault {
    Fault {
        error,
        in_data_phase: false,
        is_own: true,
    }
}

/// A controller in configuration mode.
fn open() -> Controller {
    let mut controller = Controller::new();
    controller.set_clock(80_000_000);
    controller.write(CCCR, cccr::INIT).unwrap();
    controller.write(CCCR, cccr::INIT | cccr::CCE).unwrap();
    controller.write(NBTP, NBTP_250K).unwrap();
    controller.write(DBTP, DBTP_4M).unwrap();
    controller
}

/// Ends the wait to join the bus, or to recover from bus-off.
fn join(controller: &mut Controller) -> Nanos {
    let due = controller.due().unwrap();
    controller.come_to(due);
    controller.tick();
    due
}

/// A controller on the bus, with or without CAN FD.
fn on_the_bus(flags: u32) -> Controller {
    let mut controller = open();
    controller.write(CCCR, cccr::INIT | cccr::CCE | flags).unwrap();
    controller.write(CCCR, flags).unwrap();
    join(&mut controller);
    controller
}

/// Puts a frame with this identifier and these two bytes in a buffer, and requests it.
fn request(controller: &mut Controller, buffer: u32, id: u32, kind: u32) {
    let start = BUFFER + buffer * ELEMENT;
    for (word, value) in [id, kind | 2 << 16, 0x0000_BBAA].into_iter().enumerate() {
        controller.ram_mut().write(start + 4 * word as u32, value).unwrap();
    }
    controller.write(TXBAR, 1 << buffer).unwrap();
}

/// Sends the frame that the controller offers.
fn send(controller: &mut Controller) -> Frame {
    let frame = controller.offer().unwrap();
    controller.begin(true);
    controller.end(true, Nanos(0));
    frame
}

#[test]
fn bit_times_come_from_clock_prescaler_and_segments() {
    let mut controller = open();
    assert_eq!(controller.bit(), 4_000_000);
    controller.write(CCCR, cccr::INIT | cccr::CCE | cccr::FDOE).unwrap();
    assert_eq!(controller.capability(), Capability::Fd { data_bit: 250_000 });
    controller.write(CKDIV, 1).unwrap();
    assert_eq!(controller.bit(), 8_000_000);
}

#[test]
fn controller_joins_after_eleven_recessive_bits() {
    let mut controller = open();
    controller.write(CCCR, 0).unwrap();
    assert!(!controller.listens());
    assert_eq!(join(&mut controller), Nanos(44_000));
    assert!(controller.listens());
}

#[test]
fn protected_registers_and_bits_need_cce_and_init() {
    let mut controller = on_the_bus(0);
    for register in [DBTP, NBTP, TDCR, RXGFC, XIDAM, TXBC, CKDIV] {
        assert!(controller.write(register, 0).is_err());
    }
    assert!(controller.write(CCCR, cccr::FDOE).is_err());
    controller.write(CCCR, cccr::CCE).unwrap();
    assert_eq!(controller.read(CCCR), Ok(0), "CCE needs INIT");
}

#[test]
fn timing_registers_read_as_written() {
    let mut controller = open();
    controller.write(DBTP, DBTP_4M | dbtp::TDC).unwrap();
    controller.write(TDCR, 15 << 8).unwrap();
    assert_eq!(controller.read(DBTP), Ok(DBTP_4M | dbtp::TDC));
    assert_eq!(controller.read(TDCR), Ok(15 << 8));
    assert_eq!(controller.read(NBTP), Ok(NBTP_250K));
}

#[test]
fn buffer_header_determines_the_frame() {
    for (flags, kind, fd) in [
        (0, FD_WITH_SWITCH, None),
        (cccr::FDOE, FD_WITH_SWITCH, Some(false)),
        (cccr::FDOE | cccr::BRSE, FD_WITH_SWITCH, Some(true)),
        (cccr::FDOE | cccr::BRSE, 0, None),
    ] {
        let mut controller = on_the_bus(flags);
        request(&mut controller, 0, ID, kind);
        let frame = send(&mut controller);
        assert_eq!((frame.id, frame.payload()), (Id::Standard(0x123), &[0xAA, 0xBB][..]));
        assert_eq!(frame.fd.map(|flags| flags.bit_rate_switch), fd);
    }
}

#[test]
fn transmit_fifo_keeps_order_and_counts_free_buffers() {
    let mut controller = on_the_bus(0);
    for (buffer, id) in [(0, 0x300), (1, 0x100), (2, 0x200)] {
        request(&mut controller, buffer, id << 18, 0);
    }
    assert_eq!(controller.read(TXFQS), Ok(txfqs::TFQF));
    assert_eq!(controller.read(TXBRP), Ok(0b111));
    assert_eq!(send(&mut controller).id, Id::Standard(0x300));
    assert_eq!(controller.read(TXFQS), Ok(1 | 1 << txfqs::TFGI_AT));
    assert_eq!(controller.read(TXBTO), Ok(0b001));
    assert_eq!(send(&mut controller).id, Id::Standard(0x100));
}

#[test]
fn transmit_queue_sends_the_lowest_identifier_first() {
    let mut controller = open();
    controller.write(TXBC, TFQM).unwrap();
    controller.write(CCCR, 0).unwrap();
    join(&mut controller);
    for (buffer, id) in [(0, 0x300), (1, 0x100), (2, 0x200)] {
        request(&mut controller, buffer, id << 18, 0);
    }
    let ids = [(); 3].map(|()| send(&mut controller).id);
    assert_eq!(ids, [0x100, 0x200, 0x300].map(Id::Standard));
}

#[test]
fn sent_frame_interrupts_if_buffer_is_enabled() {
    let mut controller = on_the_bus(0);
    controller.write(TXBTIE, 0b10).unwrap();
    controller.write(IE, ir::TC).unwrap();
    controller.write(ILE, 1).unwrap();
    request(&mut controller, 0, ID, 0);
    send(&mut controller);
    assert_eq!(controller.interrupts(), [false, false]);
    request(&mut controller, 1, ID, 0);
    send(&mut controller);
    assert_eq!(controller.interrupts(), [true, false]);
    controller.write(IR, ir::TC).unwrap();
    assert_eq!(controller.interrupts(), [false, false]);
}

#[test]
fn groups_choose_the_interrupt_line() {
    let mut controller = on_the_bus(0);
    controller.write(IE, ir::RFN).unwrap();
    controller.write(ILS, 1).unwrap();
    controller.write(ILE, 0b11).unwrap();
    controller.receive(&Frame::data_frame(Id::Standard(1), &[]).unwrap());
    assert_eq!(controller.interrupts(), [false, true]);
}

#[test]
fn full_fifo_loses_next_frame_and_flags_it() {
    let mut controller = on_the_bus(0);
    for id in 1..=4 {
        controller.receive(&Frame::data_frame(Id::Standard(id), &[id as u8]).unwrap());
    }
    assert_eq!(controller.read(IR), Ok(ir::RFN | ir::RFF | ir::RFL));
    assert_eq!(controller.read(RXF0S), Ok(3 | rxfs::FF | rxfs::RFL));
    controller.write(RXF0A, 0).unwrap();
    assert_eq!(controller.read(RXF0S), Ok(2 | 1 << rxfs::FGI_AT));
}

#[test]
fn fd_frame_is_received_with_flags_and_data() {
    let mut controller = on_the_bus(cccr::FDOE | cccr::BRSE);
    let flags = FdFlags {
        bit_rate_switch: true,
        error_passive: true,
    };
    controller.receive(&Frame::fd(Id::Standard(0x123), flags, 15, &[0x5A; 64]));
    let word = |offset: u32| controller.ram().read(FIFO_0 + offset).unwrap();
    assert_eq!(word(0), ID | 1 << 31);
    assert_eq!(word(4), FD_WITH_SWITCH | 15 << 16 | 1 << 31);
    assert_eq!(word(ELEMENT - 4), 0x5A5A_5A5A);
}

#[test]
fn filters_choose_the_fifo_or_reject() {
    let mut controller = open();
    // A range to FIFO 1, two identifiers rejected, a mask to FIFO 0; all others are rejected.
    for (number, filter) in [
        0b010 << 27 | 0x100 << 16 | 0x10F,
        0b01 << 30 | 0b011 << 27 | 0x200 << 16 | 0x201,
        0b10 << 30 | 0b001 << 27 | 0x200 << 16 | 0x7F0_u32,
    ]
    .into_iter()
    .enumerate()
    {
        controller.ram_mut().write(4 * number as u32, filter).unwrap();
    }
    controller.write(RXGFC, 3 << 16 | 0b10 << 4 | 0b10 << 2).unwrap();
    controller.write(CCCR, 0).unwrap();
    join(&mut controller);
    let mut levels = |id| {
        controller.receive(&Frame::data_frame(id, &[]).unwrap());
        [RXF0S, RXF1S].map(|register| controller.read(register).unwrap() & 0xF)
    };
    assert_eq!(levels(Id::Standard(0x108)), [0, 1]);
    assert_eq!(levels(Id::Standard(0x201)), [0, 1]);
    assert_eq!(levels(Id::Standard(0x202)), [1, 1]);
    assert_eq!(levels(Id::Standard(0x300)), [1, 1]);
    assert_eq!(levels(Id::Extended(0x108)), [1, 1]);
}

#[test]
fn errors_lead_to_bus_off_which_sets_init() {
    let mut controller = on_the_bus(0);
    request(&mut controller, 0, ID, 0);
    for _ in 0..32 {
        controller.begin(true);
        controller.transmit_error(fault(BusError::RecessiveBit));
        controller.end(false, Nanos(0));
    }
    assert_eq!(
        controller.read(PSR).unwrap() & (psr::BO | 0b111),
        psr::BO | BusError::RecessiveBit as u32
    );
    assert_eq!(controller.read(CCCR), Ok(cccr::INIT));
    assert_eq!(controller.read(IR).unwrap(), ir::PEA | ir::EW | ir::EP | ir::BO);
    assert_eq!(
        controller.read(PSR).unwrap() & 0b111,
        psr::UNCHANGED,
        "reading resets it"
    );
}

#[test]
fn recovery_takes_129_times_eleven_recessive_bits() {
    let mut controller = on_the_bus(0);
    request(&mut controller, 0, ID, 0);
    for _ in 0..32 {
        controller.begin(true);
        controller.transmit_error(fault(BusError::RecessiveBit));
        controller.end(false, Nanos(44_000));
    }
    controller.come_to(Nanos(100_000));
    controller.write(CCCR, 0).unwrap();
    assert_eq!(controller.state(), ErrorState::BusOff);
    assert_eq!(join(&mut controller), Nanos(100_000 + 129 * 44_000));
    assert_eq!(controller.state(), ErrorState::Active);
    assert!(controller.offer().is_some(), "the frame waits still");
}

#[test]
fn data_phase_error_has_its_own_code() {
    let mut controller = on_the_bus(cccr::FDOE | cccr::BRSE);
    controller.receive_error(Fault {
        in_data_phase: true,
        ..fault(BusError::Stuff)
    });
    assert_eq!(controller.read(IR), Ok(ir::PED));
    let status = controller.read(PSR).unwrap();
    assert_eq!(
        (status & 7, status >> psr::DLEC_AT & 7),
        (psr::UNCHANGED, BusError::Stuff as u32)
    );
}

#[test]
fn reconfiguration_drops_pending_frames() {
    let mut controller = on_the_bus(0);
    request(&mut controller, 0, ID, 0);
    controller.begin(true);
    controller.write(CCCR, cccr::INIT).unwrap();
    assert!(!controller.sends());
    controller.write(CCCR, cccr::INIT | cccr::CCE).unwrap();
    assert_eq!(controller.read(TXBRP), Ok(0));
}

#[test]
fn cancelled_frame_does_not_go() {
    let mut controller = on_the_bus(0);
    request(&mut controller, 0, ID, 0);
    request(&mut controller, 1, ID, 0);
    controller.write(TXBCR, 1).unwrap();
    assert_eq!((controller.read(TXBRP), controller.read(TXBCF)), (Ok(0b10), Ok(0b01)));
}

#[test]
fn without_retransmission_a_frame_has_one_attempt() {
    let mut controller = on_the_bus(cccr::DAR);
    request(&mut controller, 0, ID, 0);
    controller.begin(true);
    controller.transmit_error(fault(BusError::Acknowledge));
    controller.end(false, Nanos(0));
    assert!(controller.offer().is_none());
}

#[test]
fn reserved_bits_cannot_be_set() {
    for (register, bit) in [
        (DBTP, 13),
        (NBTP, 7),
        (TDCR, 7),
        (IR, 24),
        (IE, 24),
        (ILS, 7),
        (ILE, 2),
        (RXGFC, 6),
        (XIDAM, 29),
        (RXF0A, 3),
        (RXF1A, 3),
        (TXBC, 0),
        (TXBAR, 3),
        (TXBCR, 3),
        (TXBTIE, 3),
        (TXBCIE, 3),
        (CKDIV, 4),
    ] {
        let mut controller = open();
        let before = controller.read(register);
        assert!(controller.write(register, 1 << bit).is_err(), "{register:#x}");
        assert_eq!(controller.read(register), before, "{register:#x}");
    }
}
