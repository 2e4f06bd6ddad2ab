//! The shift registers of the arm's UART, a PL011 (4.2). The emulator has its registers, and the receive FIFO.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::messages::{ByteErrors, Commands};
use crate::line::{AnyLine, Format, Parity, SECOND};
use crate::mcu::common::shifter::{Settings, Shifter};
use crate::time::Nanos;

/// Bits of UARTLCR_H (4.2.8).
const PEN: u32 = 1 << 1;
const EPS: u32 = 1 << 2;
const STP2: u32 = 1 << 3;

/// Bits of UARTCR (4.2.8).
const UARTEN: u32 = 1;
const TXE: u32 = 1 << 8;
const RXE: u32 = 1 << 9;

#[derive(Debug)]
pub(super) struct Uart {
    shifter: Shifter,
    settings: Settings,
    /// The next byte of the transmit FIFO, and those after it.
    next: Option<u8>,
    fifo: VecDeque<u8>,
    /// The line's request to lose a byte.
    starve: Arc<AtomicBool>,
}

impl Uart {
    pub(super) fn new(line: AnyLine, starve: Arc<AtomicBool>) -> Self {
        Self {
            shifter: Shifter::new(line),
            settings: Settings::default(),
            next: None,
            fifo: VecDeque::new(),
            starve,
        }
    }

    /// Resets the UART, but not the line.
    pub(super) fn reset(&mut self, now: Nanos) {
        *self = Self::new(self.shifter.line().clone(), self.starve.clone());
        self.shifter.set(self.settings, now);
    }

    /// Applies a bit time, UARTLCR_H and UARTCR, and one wire for both directions or two.
    ///
    /// A UART that is disabled completes its byte (4.2.8, UARTCR). One whose line coding changes meanwhile is garbled here.
    pub(super) fn configure(&mut self, bit: u64, format: u32, control: u32, half_duplex: bool, now: Nanos) {
        let is_on = |bit| control & (UARTEN | bit) == UARTEN | bit;
        let settings = Settings {
            bit,
            format: Format {
                parity: match (format & PEN, format & EPS) {
                    (0, _) => Parity::None,
                    (_, 0) => Parity::Odd,
                    _ => Parity::Even,
                },
                two_stop_bits: format & STP2 != 0,
            },
            half_duplex,
            transmits: is_on(TXE),
            receives: is_on(RXE),
            completes: true,
        };
        if (settings.bit, settings.format) != (self.settings.bit, self.settings.format) {
            self.shifter.garble();
        }
        self.settings = settings;
        self.shifter.set(self.settings, now);
    }

    /// Checks for changes of the line by the program.
    pub(super) fn sync(&mut self, now: Nanos, commands: &mut Commands) {
        self.shifter.set(self.settings, now);
        self.advance(now, commands);
    }

    /// A byte was written to the transmit FIFO.
    pub(super) fn write(&mut self, byte: u8, now: Nanos, commands: &mut Commands) {
        if self.next.is_some() {
            self.fifo.push_back(byte);
            return;
        }
        self.next = Some(byte);
        self.shifter.start_to_send(now, &mut self.next);
        self.refill(commands);
    }

    /// Executes due events.
    pub(super) fn advance(&mut self, now: Nanos, commands: &mut Commands) {
        let overrun = self.starve.load(Ordering::Relaxed);
        let was_sending = self.shifter.is_sending();
        let had_next = self.next.is_some();
        let progress = self.shifter.advance(now, &mut self.next);
        if had_next {
            self.refill(commands);
        }
        if was_sending && !self.shifter.is_sending() {
            commands.sent();
        }
        if let Some(arrival) = progress.arrived {
            let errors = ByteErrors {
                framing: arrival.framing,
                parity: arrival.parity,
                line_break: arrival.framing && arrival.value == 0,
                overrun,
            };
            commands.received(arrival.value, errors);
        }
    }

    /// The time of the next event.
    pub(super) fn due(&self) -> Option<Nanos> {
        self.shifter.due()
    }

    /// Moves the FIFO on, if the shift register has taken its next byte.
    fn refill(&mut self, commands: &mut Commands) {
        if self.next.is_none() {
            commands.taken();
            self.next = self.fifo.pop_front();
        }
    }
}

/// The bit time in picoseconds, by the divisor of the clock in 64ths (4.2.7.1) and the clock in hertz; 0 without a clock.
pub(super) fn bit(divisor: u32, clock: u32) -> u64 {
    (u64::from(divisor) * SECOND / 4).checked_div(clock.into()).unwrap_or(0)
}
