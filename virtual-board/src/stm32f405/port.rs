//! The UART that the arm hangs on: the library's USART (RM0090, chapter 30), with the [line](crate::line) at its pins.
//!
//! The USART is the library's; this adds what lies between it and the arm: the rate it really runs at, how a byte
//! arrives, and what happens to bytes while its receiver is off. And what the library does not know:
//!
//! * half-duplex mode (30.3.10): the receiver hears what the transmitter sends, unless it is off;
//! * wrong parity bits (30.3.7): PE, which the interrupt of PEIE and reading SR then DR go with.

use rigless::chip::Timeline;
use rigless::chip::uart::{Errors, Peer, Rate};
use rigless::device::{Device, DeviceContext, Level, RegisterFile, RequestChange};
use rigless::snapshot::Store;
use rigless::soc::stm32f427::generated::usart6::{Register, brr, cr1, cr2, cr3, sr};
use rigless::soc::stm32f427::peripherals::usart::{Kind, Usart};
use rigless::soc::{FieldSpec, Layout, RegisterSpec};
use rigless::time::{EventId, VirtualNanos};

use crate::line::{AnyLine, Arrival, Format, LOW, Parity, SECOND};
use crate::shared::lock;
use crate::time::Nanos;

/// What the USART's clock is until the firmware sets the clock tree up: the internal oscillator (RM0090, 7.2.2).
const RESET_HZ: u64 = 16_000_000;

/// A serial port with an arm at the other end.
#[derive(Debug)]
pub(super) struct Port {
    usart: Usart,
    clock_hz: u64,
    line: AnyLine,
    /// A byte that the firmware wrote and that is not on the wire yet.
    waiting: Option<u8>,
    parity: ParityError,
    /// When the arm next wants to send, and the event that says so.
    wake: Option<(Nanos, EventId)>,
}

/// PE of SR, and what clears it (30.6.1).
#[derive(Clone, Copy, Debug, Default)]
struct ParityError {
    is_set: bool,
    /// A read of SR showed it.
    seen: bool,
    /// It holds the interrupt up.
    interrupts: bool,
}

impl Port {
    pub(super) fn new(line: AnyLine) -> Self {
        let mut usart = Usart::with_clock(Kind::Usart, RESET_HZ);
        usart.attach(End {
            line: line.clone(),
            arriving: None,
            parity_error: false,
            ahead: Errors::default(),
        });
        Self {
            usart,
            clock_hz: RESET_HZ,
            line,
            waiting: None,
            parity: ParityError::default(),
            wake: None,
        }
    }

    /// The part restarted at the instant of `context`; the arm did not.
    pub(super) fn restarted(&mut self, registers: &RegisterFile, context: &mut DeviceContext<'_>) {
        self.settle(registers, context);
    }

    fn end(&mut self) -> &mut End {
        self.usart.chip_mut().expect("attached when it was made")
    }

    /// Readies the USART for the byte that is on its way, and the line's end for the next one.
    ///
    /// The library draws from a rate, when a byte has arrived, whether and how it is wrong. Rates of all or nothing, and
    /// its draws known in advance, let the line decide instead.
    fn prepare(&mut self) {
        let jammed = lock(&self.line).is_jammed();
        let mut arriving = self.end().arriving;
        if let Some(arrival) = &mut arriving {
            arrival.framing |= jammed;
        }
        let errors = self.usart.errors_mut();
        errors.framing = rate("framing", arriving.is_some_and(|arrival| arrival.framing));
        errors.noise = rate("noise", arriving.is_some_and(|arrival| arrival.noise));
        let mut ahead = *errors;
        if arriving.is_some() {
            ahead.next(DATA_BITS);
        }
        self.end().ahead = ahead;
    }

    /// Tells the line of a byte that the transmitter has begun to send: its data register is free again.
    fn follow_transmitter(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let status = registers.get(Register::Sr);
        let Some(byte) = self.waiting.take_if(|_| sr::TXE.is_set(status)) else {
            return;
        };
        let mut line = lock(&self.line);
        if !line.is_half_duplex() {
            return;
        }
        line.board_starts(context.now().into(), byte);
        drop(line);
        self.prepare();
        self.usart.poll(registers, context);
    }

    /// An access to DR clears PE if a read of SR showed it.
    fn forget_parity(&mut self) {
        if self.parity.seen {
            self.parity = ParityError {
                interrupts: self.parity.interrupts,
                ..ParityError::default()
            };
        }
    }

    /// PE follows what has arrived, and the interrupt follows PE. While it is up, the library's own changes of it must not
    /// take it down.
    fn follow_parity(&mut self, registers: &RegisterFile, context: &mut DeviceContext<'_>) {
        self.parity.is_set |= std::mem::take(&mut self.end().parity_error);
        let interrupts = self.parity.is_set && cr1::PEIE.is_set(registers.get(Register::Cr1));
        if interrupts {
            context.interrupt(INTERRUPT, Level::High);
        } else if self.parity.interrupts {
            context.interrupt(INTERRUPT, Level::from(interrupt_of(registers)));
        }
        self.parity.interrupts = interrupts;
    }

    /// Tells the line what changed, and schedules what the arm wants to say.
    fn settle(&mut self, registers: &RegisterFile, context: &mut DeviceContext<'_>) {
        self.follow_parity(registers, context);
        let now = Nanos::from(context.now());
        let control = registers.get(Register::Cr1);
        let listens = cr1::UE.is_set(control) && cr1::RE.is_set(control) && self.clock_hz > 0;
        let mut line = lock(&self.line);
        line.set_board_bit(bit(registers, self.clock_hz));
        line.set_board_format(format(registers));
        line.set_half_duplex(cr3::HDSEL.is_set(registers.get(Register::Cr3)));
        let was_low = line.is_pin_low();
        line.set_transmits(cr1::UE.is_set(control) && cr1::TE.is_set(control));
        if line.is_pin_low() && !was_low {
            context.tell(Register::Cr1.spec().name, LOW);
        }
        if !listens {
            line.nobody_receives(now);
        }
        let due = line.due();
        drop(line);
        if !listens {
            self.end().arriving = None;
        }
        match (due, &self.wake) {
            (Some(due), Some((at, _))) if due == *at => {}
            (Some(due), _) if due > now => self.wake = Some((due, context.schedule(VirtualNanos::from(due)))),
            _ => self.wake = None,
        }
    }
}

/// One bit in picoseconds, 0 while nothing divides the clock (RM0090, 30.3.4).
fn bit(registers: &RegisterFile, clock_hz: u64) -> u64 {
    let divisor = registers.get(Register::Brr);
    let (mantissa, fraction) = (brr::DIV_MANTISSA.get(divisor), brr::DIV_FRACTION.get(divisor));
    let cycles = if cr1::OVER8.is_set(registers.get(Register::Cr1)) {
        mantissa << 3 | fraction & 7
    } else {
        mantissa << 4 | fraction
    };
    (cycles * SECOND).checked_div(clock_hz).unwrap_or(0)
}

/// What the USART puts around eight data bits (30.6.4, 30.6.5). Parity takes the ninth bit of M; seven data bits, and half
/// stop bits, are not told apart.
fn format(registers: &RegisterFile) -> Format {
    let control = registers.get(Register::Cr1);
    let parity = match (
        cr1::M.is_set(control) && cr1::PCE.is_set(control),
        cr1::PS.is_set(control),
    ) {
        (false, _) => Parity::None,
        (true, false) => Parity::Even,
        (true, true) => Parity::Odd,
    };
    Format {
        parity,
        two_stop_bits: cr2::STOP.get(registers.get(Register::Cr2)) == 2,
    }
}

/// The interrupt's place among the instance's.
const INTERRUPT: usize = 0;

/// Whether the library holds the interrupt up (30.4, table 147).
fn interrupt_of(registers: &RegisterFile) -> bool {
    let [status, first, second, third] =
        [Register::Sr, Register::Cr1, Register::Cr2, Register::Cr3].map(|register| registers.get(register));
    let is = |flag: &FieldSpec| flag.is_set(status);
    cr1::TXEIE.is_set(first) && is(sr::TXE)
        || cr1::TCIE.is_set(first) && is(sr::TC)
        || cr1::RXNEIE.is_set(first) && (is(sr::RXNE) || is(sr::ORE))
        || cr1::IDLEIE.is_set(first) && is(sr::IDLE)
        || cr2::LBDIE.is_set(second) && is(sr::LBD)
        || cr3::CTSIE.is_set(third) && is(sr::CTS)
        || cr3::EIE.is_set(third) && cr3::DMAR.is_set(third) && (is(sr::FE) || is(sr::ORE) || is(sr::NF))
}

/// Data bits of a byte.
const DATA_BITS: u32 = 8;

fn rate(name: &'static str, always: bool) -> Rate {
    Rate {
        name,
        per_million: if always { Rate::EVERY_WORD } else { 0 },
    }
}

/// The bits that the library will flip in the next byte, if that has these errors.
fn flips(mut errors: Errors, framing: bool, noise: bool) -> u16 {
    errors.framing = rate("framing", framing);
    errors.noise = rate("noise", noise);
    errors.next(DATA_BITS).flipped
}

/// The line's end at the USART.
struct End {
    line: AnyLine,
    arriving: Option<Arrival>,
    /// A byte with a wrong parity bit has arrived.
    parity_error: bool,
    /// What the library will draw from for the byte after the one that is on its way.
    ahead: Errors,
}

impl std::fmt::Debug for End {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("End")
            .field("arriving", &self.arriving)
            .finish_non_exhaustive()
    }
}

impl Store for End {}

impl Peer for End {
    fn receive(&mut self, word: u16, timeline: &mut Timeline<'_, '_>) {
        lock(&self.line).board_sent(timeline.now().into(), word as u8);
    }

    fn transmit(&mut self, now: VirtualNanos) -> Option<u16> {
        // It asks for the next byte once it has this one.
        self.parity_error |= self.arriving.is_some_and(|arrival| arrival.parity);
        self.arriving = lock(&self.line).board_receives(now.into());
        let arrival = self.arriving?;
        // What the library will flip is flipped already: it arrives as the line has it.
        let flips = match (arrival.framing, arrival.noise) {
            (true, _) => flips(self.ahead, true, false),
            (_, true) => flips(self.ahead, false, true),
            _ => 0,
        };
        Some(u16::from(arrival.value) ^ flips)
    }
}

impl Device for Port {
    type Register = Register;

    fn layout(&self) -> &'static [RegisterSpec] {
        self.usart.layout()
    }

    fn read(
        &mut self,
        register: Register,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        self.prepare();
        let mut value = self.usart.read(register, registers, context);
        match register {
            Register::Sr if self.parity.is_set => {
                value = value.map(|status| sr::PE.set(status, 1));
                self.parity.seen = true;
            }
            Register::Dr => self.forget_parity(),
            _ => {}
        }
        self.settle(registers, context);
        value
    }

    fn peek(&self, register: Register, registers: &RegisterFile, now: VirtualNanos) -> Option<u64> {
        self.usart.peek(register, registers, now)
    }

    fn write(&mut self, register: Register, value: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        // The line must know a new rate before a byte starts at it.
        let mut line = lock(&self.line);
        line.set_board_bit(bit(registers, self.clock_hz));
        line.set_board_format(format(registers));
        drop(line);
        self.prepare();
        self.usart.write(register, value, registers, context);
        if register == Register::Dr {
            self.forget_parity();
            self.waiting = Some(value as u8);
        }
        self.follow_transmitter(registers, context);
        self.settle(registers, context);
    }

    fn on_event(&mut self, event: EventId, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        lock(&self.line).jam(context.now().into());
        self.prepare();
        if self.wake.is_some_and(|(_, wake)| wake == event) {
            self.wake = None;
        }
        self.usart.on_event(event, registers, context);
        self.follow_transmitter(registers, context);
        self.prepare();
        self.usart.poll(registers, context);
        self.settle(registers, context);
    }

    fn on_request(&mut self, change: RequestChange, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.usart.on_request(change, registers, context);
    }

    fn on_clock(&mut self, hz: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.clock_hz = hz;
        self.usart.on_clock(hz, registers, context);
        self.settle(registers, context);
    }

    fn poll(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.prepare();
        self.usart.poll(registers, context);
        self.settle(registers, context);
    }

    fn reset(&mut self) {
        // A fresh USART, with the same line at its pins.
        *self = Self::new(self.line.clone());
    }

    fn reset_line(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let clock_hz = self.clock_hz;
        self.usart.reset_line(registers, context);
        self.clock_hz = clock_hz;
        self.waiting = None;
        self.parity = ParityError::default();
        self.wake = None;
        self.settle(registers, context);
    }
}
