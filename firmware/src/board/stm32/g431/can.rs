//! The registers of FDCAN1 (RM0440 section 44.4) and its message RAM (44.3.3): CAN and CAN FD.

use armwire_bridge::can::{FD_LENGTHS, Frame, Id, MAX_FD};
use armwire_bridge::config;
use embassy_stm32::gpio::Flex;
use embassy_stm32::interrupt::typelevel::{FDCAN1_IT0, Handler, Interrupt};
use embassy_stm32::pac;
use embassy_stm32::pac::can::vals::{Anfe, Anfs, Tfqm};
use embassy_stm32::peripherals::FDCAN1;
use embassy_stm32::{Peri, rcc};

use super::super::can_controller::{ROOM, accepted_ids, bus_off, changed, error, overrun, received, take_pins};
use super::waiting::Waiting;

const CAN: pac::can::Fdcan = pac::FDCAN1;
const RAM: pac::fdcanram::Fdcanram = pac::FDCANRAM1;

/// PLL1's output Q, which the controller divides.
const CLOCK: u32 = 80_000_000;
/// Maximum number of quanta per bit in the arbitration phase. A smaller divider of the controller's clock makes the two
/// phases fit better.
const MAX_QUANTA: u32 = 160;
/// Maximum number of quanta per bit in the data phase: 1, 32 before the sample point and 16 after it.
const MAX_DATA_QUANTA: u32 = 49;
/// Above this bit rate the sample point comes before the transmitter receives its own bit from the transceiver.
const DELAY_MATTERS: u32 = 1_000_000;

/// The pins of FDCAN1 have it as alternate function 9 (datasheet, "Alternate function").
const ALTERNATE_FUNCTION: u8 = 9;

/// Number of words of a received or transmitted frame: two of header, then the data (RM0440 44.3.3).
const ELEMENT: usize = 2 + MAX_FD / 4;
/// First word of an element: extended identifier, remote frame, position of the 11-bit identifier.
const EXTENDED: u32 = 1 << 30;
const REMOTE: u32 = 1 << 29;
const ID_AT: u32 = 18;
/// Second word of an element: CAN FD, bit rate switch, position of the DLC.
const FD: u32 = 1 << 21;
const RATE_SWITCH: u32 = 1 << 20;
const DLC_AT: u32 = 16;
/// A filter that accepts two identifiers to FIFO 0.
const TWO_IDS: u32 = 0b01 << 30;
const TO_FIFO_0: u32 = 0b001 << 27;

/// Number of transmit buffers.
const BUFFERS: usize = ROOM as usize;

pub(crate) struct Controller {
    _pins: [Flex<'static>; 2],
}

impl Controller {
    /// A controller that is not on the bus yet.
    pub(super) fn new(_controller: Peri<'static, FDCAN1>) -> Self {
        let pins = take_pins(ALTERNATE_FUNCTION);
        rcc::enable_and_reset::<FDCAN1>();
        Self { _pins: pins }
    }

    /// Starts or restarts the controller.
    pub(crate) fn start(&mut self, config: &config::Can) {
        rcc::enable_and_reset::<FDCAN1>();
        CAN.cccr().modify(|w| w.set_init(true));
        while !CAN.cccr().read().init() {}
        CAN.cccr().modify(|w| w.set_cce(true));

        let nominal = nominal(config.bit_rate);
        CAN.nbtp().write(|w| {
            w.set_nbrp(nominal.prescaler - 1);
            w.set_ntseg1(nominal.before - 1);
            w.set_ntseg2(nominal.behind - 1);
            w.set_nsjw(nominal.behind - 1);
        });
        if let Some(rate) = config.data_bit_rate {
            set_data_phase(rate);
        }
        CAN.cccr().modify(|w| {
            w.set_fdoe(config.data_bit_rate.is_some());
            w.set_brse(config.data_bit_rate.is_some());
        });
        set_filter(accepted_ids(config.node));
        // Frames leave in the order of their requests, as the frames of an ISO-TP PDU must.
        CAN.txbc().write(|w| w.set_tfqm(Tfqm::FIFO));
        CAN.txbtie()
            .write(|w| (0..BUFFERS).for_each(|buffer| w.set_tie(buffer, true)));
        CAN.ie().write(|w| {
            w.set_rfne(0, true);
            w.set_rfle(0, true);
            w.set_tce(true);
            w.set_boe(true);
            w.set_peae(true);
            w.set_pede(true);
        });
        CAN.ile().write(|w| w.set_eint0(true));
        // SAFETY: the handler uses only initialised state.
        unsafe { FDCAN1_IT0::enable() };
        // The controller joins the bus after 11 idle bits. The code does not wait for that.
        CAN.cccr().modify(|w| w.set_init(false));
    }

    /// Number of occupied buffers.
    pub(crate) fn waiting(&self) -> u8 {
        CAN.txbrp().read().0.count_ones() as u8
    }

    /// Puts a frame in an empty buffer.
    pub(crate) fn transmit(&mut self, frame: &Frame) {
        let buffer = usize::from(CAN.txfqs().read().tfqpi());
        let [id, kind, data @ ..] = &core::array::from_fn::<_, ELEMENT, _>(|word| RAM.txbuf(buffer * ELEMENT + word));
        let dlc = FD_LENGTHS
            .iter()
            .position(|&len| usize::from(len) == frame.data().len());
        let format = if frame.is_fd() { FD | RATE_SWITCH } else { 0 };
        id.write_value(u32::from(frame.id().get()) << ID_AT);
        kind.write_value(format | (dlc.unwrap_or_default() as u32) << DLC_AT);
        for (word, bytes) in data.iter().zip(frame.data().chunks(4)) {
            let mut whole = [0; 4];
            whole[..bytes.len()].copy_from_slice(bytes);
            word.write_value(u32::from_le_bytes(whole));
        }
        CAN.txbar().write(|w| w.set_ar(buffer, true));
    }

    pub(crate) fn is_bus_off(&self) -> bool {
        CAN.psr().read().bo()
    }
}

/// The division of a bit: one quantum, the quanta before the sample point and those after it.
struct Timing {
    prescaler: u16,
    before: u8,
    behind: u8,
}

impl Timing {
    /// A bit of at most `max_quanta`, with one in `behind` after the sample point.
    const fn new(bit_rate: u32, max_quanta: u32, behind: u32) -> Self {
        let ticks = CLOCK / bit_rate;
        let prescaler = ticks.div_ceil(max_quanta);
        let quanta = ticks / prescaler;
        let behind = quanta / behind;
        Self {
            prescaler: prescaler as u16,
            before: (quanta - 1 - behind) as u8,
            behind: behind as u8,
        }
    }

    /// Returns true if the timing gives this bit rate exactly.
    const fn makes(&self, bit_rate: u32) -> bool {
        (1 + self.before as u32 + self.behind as u32) * self.prescaler as u32 * bit_rate == CLOCK
    }
}

/// The timing of the arbitration phase: its sample point is at 87.5 %, as in CiA 301.
const fn nominal(bit_rate: u32) -> Timing {
    Timing::new(bit_rate, MAX_QUANTA, 8)
}

/// The timing of the data phase: its sample point is at 75 %.
const fn data(bit_rate: u32) -> Timing {
    Timing::new(bit_rate, MAX_DATA_QUANTA, 4)
}

const _: () = {
    let mut i = 0;
    while i < config::CAN_BIT_RATES.len() {
        assert!(nominal(config::CAN_BIT_RATES[i]).makes(config::CAN_BIT_RATES[i]));
        i += 1;
    }
    let mut i = 0;
    while i < config::CAN_DATA_BIT_RATES.len() {
        let timing = data(config::CAN_DATA_BIT_RATES[i]);
        assert!(timing.makes(config::CAN_DATA_BIT_RATES[i]));
        assert!(timing.before <= 32 && timing.behind <= 16);
        i += 1;
    }
};

fn set_data_phase(bit_rate: u32) {
    let timing = data(bit_rate);
    let compensate = bit_rate > DELAY_MATTERS;
    CAN.dbtp().write(|w| {
        w.set_dbrp(timing.prescaler as u8 - 1);
        w.set_dtseg1(timing.before - 1);
        w.set_dtseg2(timing.behind - 1);
        w.set_dsjw(timing.behind - 1);
        w.set_tdc(compensate);
    });
    // The second sample point is as far after the bit's echo as the first is after its start, in ticks of the clock
    // (44.4.14). At the rates where it matters the prescaler is 1; compensation requires 1 or 2.
    CAN.tdcr().write(|w| w.set_tdco(1 + timing.before));
}

/// Accepts data frames with these identifiers to FIFO 0, and rejects all others.
fn set_filter([a, b, c, d]: [Id; 4]) {
    let filter = |one: Id, other: Id| TWO_IDS | TO_FIFO_0 | u32::from(one.get()) << 16 | u32::from(other.get());
    RAM.flssa(0).write_value(filter(a, b));
    RAM.flssa(1).write_value(filter(c, d));
    CAN.rxgfc().write(|w| {
        w.set_lss(2);
        w.set_anfs(Anfs::REJECT);
        w.set_anfe(Anfe::REJECT);
        w.set_rrfs(true);
        w.set_rrfe(true);
    });
}

/// Moves frames from FIFO 0 to the queue, counts errors, and starts the recovery from bus-off.
pub(crate) struct InterruptHandler;

impl Handler<FDCAN1_IT0> for InterruptHandler {
    unsafe fn on_interrupt() {
        let flags = CAN.ir().read();
        // Writing 1 clears.
        CAN.ir().write_value(flags);
        if flags.rfl(0) {
            overrun();
        }
        while CAN.rxfs(0).read().ffl() > 0 {
            let index = CAN.rxfs(0).read().fgi();
            if let Some(frame) = frame(index.into()) {
                received(Waiting(frame));
            }
            CAN.rxfa(0).write(|w| w.set_fai(index));
        }
        let is_off = CAN.psr().read().bo();
        // During recovery from bus-off each sequence of 11 idle bits looks like an error (44.4.13).
        if (flags.pea() || flags.ped()) && !is_off {
            error();
        }
        if flags.bo() && is_off {
            bus_off();
            // INIT keeps the controller off the bus; clearing it starts the recovery, at the earliest time that the
            // standard allows.
            CAN.cccr().modify(|w| w.set_init(false));
        }
        if flags.tc() {
            changed();
        }
    }
}

/// The frame at this index of FIFO 0. `None` if the filter should have rejected it.
fn frame(index: usize) -> Option<Frame> {
    let word = |i| RAM.rxfifo0(index * ELEMENT + i).read();
    let (header, kind) = (word(0), word(1));
    if header & (EXTENDED | REMOTE) != 0 {
        return None;
    }
    let id = Id::new((header >> ID_AT) as u16 & Id::MAX.get()).ok()?;
    let len = usize::from(FD_LENGTHS[(kind >> DLC_AT & 0xF) as usize]);
    let mut bytes = [0; MAX_FD];
    for (i, bytes) in bytes.as_chunks_mut().0.iter_mut().enumerate().take(len.div_ceil(4)) {
        *bytes = word(2 + i).to_le_bytes();
    }
    if kind & FD != 0 {
        Frame::new_fd(id, &bytes[..len]).ok()
    } else {
        // A DLC above 8 means 8 in a classic frame (ISO 11898-1).
        Frame::new(id, &bytes[..len.min(8)]).ok()
    }
}
