//! The registers of CAN1, a bxCAN (RM0090 section 32.9): classic CAN.

use core::sync::atomic::{AtomicBool, Ordering};

use armwire_bridge::can::{Frame, Id};
use armwire_bridge::config;
use embassy_stm32::gpio::Flex;
use embassy_stm32::interrupt::typelevel::{CAN1_RX0, CAN1_SCE, CAN1_TX, Handler, Interrupt};
use embassy_stm32::pac;
use embassy_stm32::pac::can::vals::{Ide, Lec, Rtr};
use embassy_stm32::peripherals::CAN1;
use embassy_stm32::{Peri, rcc};

use super::super::can_controller::{ROOM, accepted_ids, bus_off, changed, error, overrun, received, take_pins};
use super::waiting::Waiting;

const CAN: pac::can::Can = pac::CAN1;

/// APB1's clock, which the controller divides.
const CLOCK: u32 = 42_000_000;
/// A bit: one quantum, the quanta before the sample point and those after it. Every supported rate divides `CLOCK` /
/// 14, and 12 of 14 is within CiA 301's 85 % to 90 %.
const SEGMENTS: [u8; 2] = [11, 2];
const QUANTA: u32 = 14;

const _: () = {
    let mut i = 0;
    while i < config::CAN_BIT_RATES.len() {
        assert!(CLOCK.is_multiple_of(QUANTA * config::CAN_BIT_RATES[i]));
        i += 1;
    }
};

/// The pins of CAN1 have it as alternate function 9 (datasheet, "Alternate function mapping").
const ALTERNATE_FUNCTION: u8 = 9;

/// Number of transmit mailboxes.
const MAILBOXES: usize = ROOM as usize;

/// TME0 to TME2 of TSR: the mailboxes that are empty.
const EMPTY: u32 = 0b111 << 26;

/// Polls of the interrupt handler for initialization mode, which takes a few cycles in bus-off.
const INITIALIZATION_TRIES: usize = 16;

/// Recovery from bus-off was started.
static RETURNING: AtomicBool = AtomicBool::new(false);

pub(crate) struct Controller {
    _pins: [Flex<'static>; 2],
}

impl Controller {
    /// A controller that is not on the bus yet.
    pub(super) fn new(_controller: Peri<'static, CAN1>) -> Self {
        let pins = take_pins(ALTERNATE_FUNCTION);
        rcc::enable_and_reset::<CAN1>();
        Self { _pins: pins }
    }

    /// Starts or restarts the controller.
    pub(crate) fn start(&mut self, config: &config::Can) {
        rcc::enable_and_reset::<CAN1>();
        // RM0090 32.4.1. This works without a bus.
        CAN.mcr().modify(|w| {
            w.set_sleep(false);
            w.set_inrq(true);
        });
        while !CAN.msr().read().inak() {}
        CAN.mcr().modify(|w| {
            // Recovery from bus-off is started by the interrupt handler. Automatic recovery could complete before the
            // state is read, and bus-off would go unnoticed (32.7.6).
            w.set_abom(false);
            // Frames leave in the order of their requests, as the frames of an ISO-TP PDU must (32.7.1).
            w.set_txfp(true);
        });
        CAN.btr().write(|w| {
            w.set_brp((CLOCK / QUANTA / config.bit_rate - 1) as u16);
            w.set_ts(0, SEGMENTS[0] - 1);
            w.set_ts(1, SEGMENTS[1] - 1);
            w.set_sjw(SEGMENTS[1] - 1);
        });
        set_filter(accepted_ids(config.node));
        CAN.ier().write(|w| {
            w.set_tmeie(true);
            w.set_fmpie(0, true);
            w.set_fovie(0, true);
            w.set_errie(true);
            w.set_lecie(true);
            w.set_bofie(true);
        });
        // SAFETY: the handlers use only initialised state.
        unsafe {
            CAN1_TX::enable();
            CAN1_RX0::enable();
            CAN1_SCE::enable();
        }
        // The controller joins the bus after 11 idle bits. The code does not wait for that.
        CAN.mcr().modify(|w| w.set_inrq(false));
    }

    /// Number of occupied mailboxes.
    pub(crate) fn waiting(&self) -> u8 {
        ROOM - (CAN.tsr().read().0 & EMPTY).count_ones() as u8
    }

    /// Puts a frame in an empty mailbox. The bridge has no FD frames for this board.
    pub(crate) fn transmit(&mut self, frame: &Frame) {
        let mailbox = CAN.tx(CAN.tsr().read().code().into());
        let mut bytes = [0; 8];
        for (byte, &data) in bytes.iter_mut().zip(frame.data()) {
            *byte = data;
        }
        let [a, b, c, d, e, f, g, h] = bytes;
        mailbox
            .tdtr()
            .write(|w| w.set_dlc(frame.data().len().min(bytes.len()) as u8));
        mailbox.tdlr().write(|w| w.0 = u32::from_le_bytes([a, b, c, d]));
        mailbox.tdhr().write(|w| w.0 = u32::from_le_bytes([e, f, g, h]));
        mailbox.tir().write(|w| {
            w.set_stid(frame.id().get());
            w.set_txrq(true);
        });
    }

    /// Returns true in bus-off. Call this periodically: it also starts a recovery that the interrupt handler could not
    /// start.
    pub(crate) fn is_bus_off(&self) -> bool {
        // The interrupt handler requests initialization mode, too.
        critical_section::with(|_| leave_initialization());
        let is_off = CAN.esr().read().boff();
        if !RETURNING.swap(is_off, Ordering::Relaxed) && is_off {
            CAN1_SCE::pend();
        }
        is_off
    }
}

/// Accepts data frames with these identifiers to FIFO 0, and rejects all others: bank 0 as a list of four (RM0090
/// 32.7.4).
fn set_filter([a, b, c, d]: [Id; 4]) {
    // The 11 bits of the identifier; RTR, IDE and the bits of an extended identifier are 0.
    let half = |id: Id| u32::from(id.get()) << 5;
    CAN.fmr().modify(|w| w.set_finit(true));
    CAN.fm1r().write(|w| w.set_fbm(0, true));
    CAN.fs1r().write(|w| w.set_fsc(0, false));
    CAN.ffa1r().write(|w| w.set_ffa(0, false));
    CAN.fb(0).fr1().write(|w| w.0 = half(b) << 16 | half(a));
    CAN.fb(0).fr2().write(|w| w.0 = half(d) << 16 | half(c));
    CAN.fa1r().write(|w| w.set_fact(0, true));
    CAN.fmr().modify(|w| w.set_finit(false));
}

/// Handles a mailbox that became empty.
pub(crate) struct TransmitHandler;

impl Handler<CAN1_TX> for TransmitHandler {
    unsafe fn on_interrupt() {
        // Writing 1 clears; writing 0 has no effect on the other bits of this register.
        CAN.tsr()
            .write(|w| (0..MAILBOXES).for_each(|mailbox| w.set_rqcp(mailbox, true)));
        changed();
    }
}

/// Moves frames from FIFO 0 to the queue.
pub(crate) struct ReceiveHandler;

impl Handler<CAN1_RX0> for ReceiveHandler {
    unsafe fn on_interrupt() {
        let fifo = CAN.rfr(0);
        if fifo.read().fovr() {
            fifo.write(|w| w.set_fovr(true));
            overrun();
        }
        while fifo.read().fmp() > 0 {
            if let Some(frame) = frame() {
                received(frame);
            }
            fifo.write(|w| w.set_rfom(true));
            while fifo.read().rfom() {}
        }
    }
}

/// The frame at the front of FIFO 0. `None` if the filter should have rejected it.
fn frame() -> Option<Waiting> {
    let mailbox = CAN.rx(0);
    let header = mailbox.rir().read();
    if header.ide() != Ide::STANDARD || header.rtr() != Rtr::DATA {
        return None;
    }
    let [low, high] = [mailbox.rdlr().read().0, mailbox.rdhr().read().0].map(u32::to_le_bytes);
    let [a, b, c, d] = low;
    let [e, f, g, h] = high;
    Some(Waiting {
        id: Id::new(header.stid()).ok()?,
        len: mailbox.rdtr().read().dlc().into(),
        data: [a, b, c, d, e, f, g, h],
    })
}

/// Counts bus errors, and starts the recovery from bus-off.
pub(crate) struct StatusHandler;

impl Handler<CAN1_SCE> for StatusHandler {
    unsafe fn on_interrupt() {
        // This comes before the read of ESR: a bit set from here on triggers the handler again (RM0090 32.9.2). Writing
        // 1 clears.
        CAN.msr().write(|w| w.set_erri(true));
        let status = CAN.esr().read();
        if !matches!(status.lec(), Lec::NO_ERROR | Lec::CUSTOM) {
            error();
            // This makes each error count once (RM0090 32.9.2, LEC).
            CAN.esr().write(|w| w.set_lec(Lec::CUSTOM));
        }
        if status.boff() {
            bus_off();
            RETURNING.store(true, Ordering::Relaxed);
            // Entering and leaving this mode starts the recovery, at the earliest time that the standard allows
            // (32.7.6).
            CAN.mcr().modify(|w| w.set_inrq(true));
            // If it is not entered by then, `is_bus_off` leaves it.
            (0..INITIALIZATION_TRIES).any(|_| leave_initialization());
        }
    }
}

/// Leaves initialization mode, if it was requested and entered (RM0090 32.4.1). Returns true if it was.
fn leave_initialization() -> bool {
    let is_entered = CAN.mcr().read().inrq() && CAN.msr().read().inak();
    if is_entered {
        CAN.mcr().modify(|w| w.set_inrq(false));
    }
    is_entered
}
