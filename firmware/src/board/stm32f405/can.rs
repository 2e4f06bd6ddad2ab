//! The registers of CAN1, a bxCAN (RM0090 section 32.9): classic CAN, on PB8 and PB9.

use core::sync::atomic::{AtomicBool, Ordering};

use armwire_bridge::can::{Frame, Id};
use armwire_bridge::config;
use embassy_stm32::gpio::{AfType, Flex, OutputType, Pull, Speed};
use embassy_stm32::interrupt::typelevel::{CAN1_RX0, CAN1_SCE, CAN1_TX, Handler, Interrupt};
use embassy_stm32::pac;
use embassy_stm32::pac::can::vals::{Ide, Lec, Rtr};
use embassy_stm32::peripherals::{CAN1, PB8, PB9};
use embassy_stm32::{Peri, rcc};

use super::super::can::{ROOM, changed, error, heard, lost, overrun, received};

const CAN: pac::can::Can = pac::CAN1;

/// APB1's clock, which the controller divides.
const CLOCK: u32 = 42_000_000;
/// A bit: its first quantum, those before the sample point and those behind it. Every rate there is divides
/// `CLOCK` / 14, and 12 of 14 is within CiA 301's 85 % to 90 %.
const SEGMENTS: [u8; 2] = [11, 2];
const QUANTA: u32 = 14;

const _: () = {
    let mut i = 0;
    while i < config::CAN_BIT_RATES.len() {
        assert!(CLOCK.is_multiple_of(QUANTA * config::CAN_BIT_RATES[i]));
        i += 1;
    }
};

/// PB8 and PB9 are CAN1 as alternate function 9 (datasheet, "Alternate function mapping").
const ALTERNATE_FUNCTION: u8 = 9;

/// The mailboxes that frames leave from.
const MAILBOXES: usize = ROOM as usize;

/// How often the interrupt handler looks whether initialization mode was entered, which takes a few cycles at a bus that is
/// lost.
const INITIALIZATION_TRIES: usize = 16;

/// In bus-off: the way back was started.
static RETURNING: AtomicBool = AtomicBool::new(false);

/// The controller.
pub(crate) struct Controller {
    _pins: [Flex<'static>; 2],
}

impl Controller {
    /// A controller that is not on the bus yet.
    pub(super) fn new(_controller: Peri<'static, CAN1>, rx: Peri<'static, PB8>, tx: Peri<'static, PB9>) -> Self {
        let (mut rx, mut tx) = (Flex::new(rx), Flex::new(tx));
        // Without a transceiver the bus looks idle.
        rx.set_as_af_unchecked(ALTERNATE_FUNCTION, AfType::input(Pull::Up));
        tx.set_as_af_unchecked(
            ALTERNATE_FUNCTION,
            AfType::output(OutputType::PushPull, Speed::VeryHigh),
        );
        rcc::enable_and_reset::<CAN1>();
        Self { _pins: [rx, tx] }
    }

    /// Puts the controller on the bus, anew if it is there.
    pub(crate) fn start(&mut self, config: &config::Can) {
        rcc::enable_and_reset::<CAN1>();
        // RM0090 32.4.1. No bus is needed to get there.
        CAN.mcr().modify(|w| {
            w.set_sleep(false);
            w.set_inrq(true);
        });
        while !CAN.msr().read().inak() {}
        CAN.mcr().modify(|w| {
            // After bus-off it waits for the interrupt handler. It would come back without, but of a bus that was lost and
            // is back before anybody looks nothing would be seen (32.7.6).
            w.set_abom(false);
            // Frames leave in the order they came, or those of one ISO-TP PDU would not (32.7.1).
            w.set_txfp(true);
        });
        CAN.btr().write(|w| {
            w.set_brp((CLOCK / QUANTA / config.bit_rate - 1) as u16);
            w.set_ts(0, SEGMENTS[0] - 1);
            w.set_ts(1, SEGMENTS[1] - 1);
            w.set_sjw(SEGMENTS[1] - 1);
        });
        listen(heard(config.node));
        CAN.ier().write(|w| {
            w.set_tmeie(true);
            w.set_fmpie(0, true);
            w.set_fovie(0, true);
            w.set_errie(true);
            w.set_lecie(true);
            w.set_bofie(true);
        });
        // SAFETY: the handlers need nothing that is not there.
        unsafe {
            CAN1_TX::enable();
            CAN1_RX0::enable();
            CAN1_SCE::enable();
        }
        // It is on the bus when that has been idle for 11 bits, which nobody waits for here.
        CAN.mcr().modify(|w| w.set_inrq(false));
    }

    /// How many mailboxes are not empty.
    pub(crate) fn waiting(&self) -> u8 {
        let status = CAN.tsr().read();
        (0..MAILBOXES).map(|mailbox| u8::from(!status.tme(mailbox))).sum()
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

    /// Whether the controller has left the bus because of too many errors. To be asked now and then: nothing else sees to
    /// a way back that was not started.
    pub(crate) fn is_bus_off(&self) -> bool {
        // The interrupt handler asks for initialization mode, too.
        critical_section::with(|_| leave_initialization());
        let is_off = CAN.esr().read().boff();
        if !RETURNING.swap(is_off, Ordering::Relaxed) && is_off {
            CAN1_SCE::pend();
        }
        is_off
    }
}

/// Lets data frames with these identifiers into FIFO 0, and no others: bank 0 as a list of four (RM0090 32.7.4).
fn listen([a, b, c, d]: [Id; 4]) {
    // The 11 bits of the identifier; RTR, IDE and what an extended identifier has more are 0.
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

/// Notes that a mailbox is empty again.
pub(crate) struct TransmitHandler;

impl Handler<CAN1_TX> for TransmitHandler {
    unsafe fn on_interrupt() {
        // Writing 1 clears; the other bits of this register do nothing when 0 is written.
        CAN.tsr()
            .write(|w| (0..MAILBOXES).for_each(|mailbox| w.set_rqcp(mailbox, true)));
        changed();
    }
}

/// Takes frames from FIFO 0.
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

/// A frame that waits to be taken: a classic one, in a quarter of the room.
pub(crate) struct Waiting {
    id: Id,
    len: usize,
    data: [u8; 8],
}

impl Waiting {
    pub(crate) fn into_frame(self) -> Option<Frame> {
        // A DLC above 8 means 8 in a classic frame (ISO 11898-1).
        Frame::new(self.id, &self.data[..self.len.min(8)]).ok()
    }
}

/// The frame at the front of FIFO 0: `None` if it is none that the filter lets pass.
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

/// Counts errors on the bus, and brings the controller back from bus-off.
pub(crate) struct StatusHandler;

impl Handler<CAN1_SCE> for StatusHandler {
    unsafe fn on_interrupt() {
        // Before ESR is read: what is set in it from here on brings the handler here again (RM0090 32.9.2). Writing 1
        // clears.
        CAN.msr().write(|w| w.set_erri(true));
        let status = CAN.esr().read();
        if !matches!(status.lec(), Lec::NO_ERROR | Lec::CUSTOM) {
            error();
            // So that it is counted once (RM0090 32.9.2, LEC).
            CAN.esr().write(|w| w.set_lec(Lec::CUSTOM));
        }
        if status.boff() {
            lost();
            RETURNING.store(true, Ordering::Relaxed);
            // To enter and leave this mode is what starts the way back, as soon as the standard allows (32.7.6).
            CAN.mcr().modify(|w| w.set_inrq(true));
            // What is not entered by then is left when somebody asks for bus-off.
            (0..INITIALIZATION_TRIES).any(|_| leave_initialization());
        }
    }
}

/// Ends initialization mode, if it was asked for and entered (RM0090 32.4.1). Returns whether it was.
fn leave_initialization() -> bool {
    let is_entered = CAN.mcr().read().inrq() && CAN.msr().read().inak();
    if is_entered {
        CAN.mcr().modify(|w| w.set_inrq(false));
    }
    is_entered
}
