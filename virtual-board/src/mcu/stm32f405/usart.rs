//! USART2, the UART of the arm (RM0090, chapter 30).
//!
//! | Behaviour | Section |
//! |---|---|
//! | Bit rate from BRR and OVER8 | 30.3.4 |
//! | Transmit data register and shift register; TXE, TC; the idle frame after TE is set | 30.3.2 |
//! | Receive data register; RXNE, ORE; IDLE after an idle frame | 30.3.3 |
//! | Parity with 9 bits; PE | 30.3.7 |
//! | Framing and noise errors: the byte arrives with its flag | 30.3.3 |
//! | Half-duplex mode: the receiver gets the transmitted bytes | 30.3.10 |
//! | DMA requests | 30.3.13 |
//! | Flags cleared by reading SR, then DR; flags cleared by writing 0 | 30.6.1 |
//!
//! A read of DR by the DMA ends the sequence like one of the core. Refused with their name: 7 and 9 data bits, half
//! stop bits, breaks, and all modes except asynchronous.

use crate::line::{AnyLine, Arrival, SECOND};
use crate::mcu::common::shifter::{Settings, Shifter, Uart};
use crate::mcu::common::usart::{self, flag};
use crate::soc::peripheral::{Peripheral, Refused, forbidden};
use crate::time::Nanos;

const SR: u32 = 0x00;
pub(super) const DR: u32 = 0x04;
const BRR: u32 = 0x08;
const CR1: u32 = 0x0C;
const CR2: u32 = 0x10;
const CR3: u32 = 0x14;
const GTPR: u32 = 0x18;

/// Flags of SR (30.6.1), by the event that clears them.
mod clearing {
    use super::flag::{FE, IDLE, NE, ORE, PE, TC};

    /// A read of SR that returns them, followed by a read of DR.
    pub(super) const IF_SEEN: u32 = FE | NE | ORE;
    /// Any read of SR, followed by a read of DR.
    pub(super) const BY_READING: u32 = PE | IDLE;
    /// Any read of SR, followed by a write of DR.
    pub(super) const BY_WRITING: u32 = PE | TC;
}

/// Bits of CR1 (30.6.4).
mod cr1 {
    pub(super) use super::usart::cr1::*;
    pub(super) const UE: u32 = 1 << 13;
    pub(super) const MODELLED: u32 = RE | TE | INTERRUPTS | PS | PCE | M | UE | OVER8;
}

/// Bits of CR3 (30.6.6).
mod cr3 {
    pub(super) use super::usart::cr3::*;
    pub(super) const MODELLED: u32 = EIE | HDSEL | DMAR | DMAT | ONEBIT;
}

#[derive(Debug)]
pub(super) struct Usart {
    shifter: Shifter,
    clock_hz: u64,
    cr1: u32,
    cr2: u32,
    cr3: u32,
    brr: u32,
    gtpr: u32,
    /// PE, FE, NF, ORE, IDLE and TC.
    flags: u32,
    /// The value of the last read of SR, until an access to DR ends the sequence.
    seen: Option<u32>,
    /// The received byte, while RXNE is set, and the last one.
    received: Option<u8>,
    last: u8,
    /// The byte for the transmitter, while TXE is clear.
    transmit: Option<u8>,
    /// True if a byte was received since the line was last idle.
    received_since_idle: bool,
}

impl Usart {
    pub(super) fn new(line: AnyLine) -> Self {
        Self {
            shifter: Shifter::new(line),
            clock_hz: 0,
            cr1: 0,
            cr2: 0,
            cr3: 0,
            brr: 0,
            gtpr: 0,
            flags: flag::TC,
            seen: None,
            received: None,
            last: 0,
            transmit: None,
            received_since_idle: false,
        }
    }

    pub(super) fn set_clock(&mut self, hz: u64, now: Nanos) {
        if hz != self.clock_hz {
            self.clock_hz = hz;
            self.settle(now);
        }
    }

    /// Checks for changes of the line by the program.
    pub(super) fn sync(&mut self, now: Nanos) {
        self.settle(now);
        self.advance(now);
    }

    /// The level of the interrupt line (30.4).
    #[inline]
    pub(super) fn interrupts(&self) -> bool {
        let status = self.status();
        let reports_errors = self.cr3 & (cr3::EIE | cr3::DMAR) == cr3::EIE | cr3::DMAR;
        usart::interrupts(self.cr1, status) || reports_errors && status & flag::ERRORS != 0
    }

    /// Returns true if UE and this bit of CR1 are set.
    fn is_on(&self, bit: u32) -> bool {
        self.cr1 & (cr1::UE | bit) == cr1::UE | bit
    }

    #[inline]
    fn status(&self) -> u32 {
        let when = |set, bit| if set { bit } else { 0 };
        self.flags | when(self.received.is_some(), flag::RXNE) | when(self.transmit.is_none(), flag::TXE)
    }

    /// The bit time in picoseconds, 0 without a divider (30.3.4).
    fn bit(&self) -> u64 {
        let cycles = if self.cr1 & cr1::OVER8 != 0 {
            self.brr >> 4 << 3 | self.brr & 0b111
        } else {
            self.brr
        };
        (u64::from(cycles) * SECOND).checked_div(self.clock_hz).unwrap_or(0)
    }

    /// Passes changes on to the line.
    fn settle(&mut self, now: Nanos) {
        let settings = Settings {
            bit: self.bit(),
            format: usart::format(self.cr1, self.cr2),
            half_duplex: self.cr3 & cr3::HDSEL != 0,
            transmits: self.is_on(cr1::TE),
            receives: self.is_on(cr1::RE),
        };
        self.shifter.set(settings, now);
    }

    /// Handles a received byte. One that arrives while RXNE is set is lost, including its errors (30.3.3).
    fn receive(&mut self, arrival: Arrival) {
        if self.received.is_some() {
            self.flags |= flag::ORE;
            return;
        }
        let flag = |set, bit| if set { bit } else { 0 };
        let noise = arrival.noise && self.cr3 & cr3::ONEBIT == 0;
        self.flags |= flag(arrival.parity, flag::PE) | flag(arrival.framing, flag::FE) | flag(noise, flag::NE);
        self.received = Some(arrival.value);
        self.last = arrival.value;
        self.received_since_idle = true;
    }

    fn read_data(&mut self) -> u32 {
        if let Some(seen) = self.seen.take() {
            self.flags &= !(clearing::BY_READING | clearing::IF_SEEN & seen);
        }
        self.received.take().unwrap_or(self.last).into()
    }

    fn write_data(&mut self, value: u32) {
        if self.seen.take().is_some() {
            self.flags &= !clearing::BY_WRITING;
        }
        self.transmit = Some(value as u8);
    }

    /// A 0 clears TC and RXNE, a 1 has no effect. Hardware controls the other flags.
    fn write_status(&mut self, value: u32) {
        self.seen = None;
        self.flags &= value | !flag::TC;
        if value & flag::RXNE == 0 {
            self.received = None;
        }
    }

    fn write_cr1(&mut self, value: u32) -> Result<(), Refused> {
        usart::check_cr1(value, cr1::MODELLED)?;
        let was_enabled = self.is_on(cr1::TE);
        self.cr1 = value;
        if was_enabled && value & (cr1::UE | cr1::TE) == cr1::UE && self.shifter.cut() {
            return Err(forbidden("CR1", "30.3.2: TE cleared while a byte is sent"));
        }
        Ok(())
    }

    fn write_register(&mut self, offset: u32, value: u32) -> Result<(), Refused> {
        match offset {
            SR => self.write_status(value),
            DR => self.write_data(value),
            BRR => self.brr = value & 0xFFFF,
            CR1 => self.write_cr1(value)?,
            CR2 => {
                usart::check_cr2(value)?;
                self.cr2 = value;
            }
            CR3 if value & !cr3::MODELLED != 0 => return Err(Refused::Unimplemented("CR3")),
            CR3 => self.cr3 = value,
            // It has no effect in asynchronous mode.
            GTPR => self.gtpr = value,
            _ => return Err(Refused::NoRegister),
        }
        Ok(())
    }
}

impl Uart for Usart {
    #[inline]
    fn requests_receive(&self) -> bool {
        self.cr3 & cr3::DMAR != 0 && self.received.is_some()
    }

    #[inline]
    fn requests_transmit(&self) -> bool {
        self.cr3 & cr3::DMAT != 0 && self.transmit.is_none()
    }

    fn transmits(&self) -> bool {
        self.is_on(cr1::TE)
    }
}

impl Peripheral for Usart {
    fn read(&mut self, offset: u32, now: Nanos) -> Result<u32, Refused> {
        match offset {
            SR => {
                let status = self.status();
                self.seen = Some(status);
                Ok(status)
            }
            DR => {
                let value = self.read_data();
                self.advance(now);
                Ok(value)
            }
            _ => self.peek(offset, now),
        }
    }

    fn write(&mut self, offset: u32, value: u32, now: Nanos) -> Result<(), Refused> {
        let had_transmitter = self.cr1 & cr1::TE != 0;
        let written = self.write_register(offset, value);
        if !matches!(offset, SR | DR) {
            self.settle(now);
        }
        if self.is_on(cr1::TE) && !had_transmitter {
            // 30.3.2: an idle frame comes first.
            self.shifter.send_idle_frame(now);
        }
        self.shifter.start_to_send(now, &mut self.transmit);
        self.shifter.listen(now);
        written
    }

    fn advance(&mut self, now: Nanos) {
        let progress = self.shifter.advance(now, &mut self.transmit);
        if progress.complete {
            self.flags |= flag::TC;
        }
        if progress.idle {
            self.flags |= flag::IDLE;
            self.received_since_idle = false;
        }
        if let Some(arrival) = progress.arrived {
            self.receive(arrival);
            if self.received_since_idle {
                self.shifter.expect_idle(now);
            }
        }
    }

    fn due(&self) -> Option<Nanos> {
        self.shifter.due()
    }

    /// Resets the USART, but not the line and the clock.
    fn reset(&mut self, now: Nanos) {
        *self = Self {
            clock_hz: self.clock_hz,
            ..Self::new(self.shifter.line().clone())
        };
        self.settle(now);
    }

    fn peek(&mut self, offset: u32, _: Nanos) -> Result<u32, Refused> {
        match offset {
            SR => Ok(self.status()),
            DR => Ok(self.received.unwrap_or(self.last).into()),
            BRR => Ok(self.brr),
            CR1 => Ok(self.cr1),
            CR2 => Ok(self.cr2),
            CR3 => Ok(self.cr3),
            GTPR => Ok(self.gtpr),
            _ => Err(Refused::NoRegister),
        }
    }
}
