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

use crate::line::{AnyLine, Arrival, Format, Parity, SECOND};
use crate::mcu::common::shifter::{Settings, Shifter, Uart};
use crate::soc::peripheral::{Peripheral, Refused, field, forbidden};
use crate::time::Nanos;

const SR: u32 = 0x00;
pub(super) const DR: u32 = 0x04;
const BRR: u32 = 0x08;
const CR1: u32 = 0x0C;
const CR2: u32 = 0x10;
const CR3: u32 = 0x14;
const GTPR: u32 = 0x18;

/// Flags of SR (30.6.1).
mod sr {
    pub(super) const PE: u32 = 1;
    pub(super) const FE: u32 = 1 << 1;
    pub(super) const NF: u32 = 1 << 2;
    pub(super) const ORE: u32 = 1 << 3;
    pub(super) const IDLE: u32 = 1 << 4;
    pub(super) const RXNE: u32 = 1 << 5;
    pub(super) const TC: u32 = 1 << 6;
    pub(super) const TXE: u32 = 1 << 7;
    /// Cleared by a read of SR that returns them, followed by a read of DR.
    pub(super) const CLEARED_IF_SEEN: u32 = FE | NF | ORE;
    /// Cleared by any read of SR, followed by a read of DR.
    pub(super) const CLEARED_BY_READING: u32 = PE | IDLE;
    /// Cleared by any read of SR, followed by a write of DR.
    pub(super) const CLEARED_BY_WRITING: u32 = PE | TC;
}

/// Bits of CR1 (30.6.4).
mod cr1 {
    pub(super) const RE: u32 = 1 << 2;
    pub(super) const TE: u32 = 1 << 3;
    pub(super) const IDLEIE: u32 = 1 << 4;
    pub(super) const RXNEIE: u32 = 1 << 5;
    pub(super) const TCIE: u32 = 1 << 6;
    pub(super) const TXEIE: u32 = 1 << 7;
    pub(super) const PEIE: u32 = 1 << 8;
    pub(super) const PS: u32 = 1 << 9;
    pub(super) const PCE: u32 = 1 << 10;
    pub(super) const M: u32 = 1 << 12;
    pub(super) const UE: u32 = 1 << 13;
    pub(super) const OVER8: u32 = 1 << 15;
    pub(super) const MODELLED: u32 = RE | TE | IDLEIE | RXNEIE | TCIE | TXEIE | PEIE | PS | PCE | M | UE | OVER8;
}

/// STOP of CR2 (30.6.5).
mod cr2 {
    pub(super) const STOP_AT: u32 = 12;
    pub(super) const STOP: u32 = 0b11;
    pub(super) const ONE: u32 = 0b00;
    pub(super) const TWO: u32 = 0b10;
    pub(super) const MODELLED: u32 = STOP << STOP_AT;
}

/// Bits of CR3 (30.6.6).
mod cr3 {
    pub(super) const EIE: u32 = 1;
    pub(super) const HDSEL: u32 = 1 << 3;
    pub(super) const DMAR: u32 = 1 << 6;
    pub(super) const DMAT: u32 = 1 << 7;
    pub(super) const ONEBIT: u32 = 1 << 11;
    pub(super) const MODELLED: u32 = EIE | HDSEL | DMAR | DMAT | ONEBIT;
}

/// The USART.
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
            flags: sr::TC,
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
        let enabled = |enable: u32, flags: u32| self.cr1 & enable != 0 && status & flags != 0;
        enabled(cr1::TXEIE, sr::TXE)
            || enabled(cr1::TCIE, sr::TC)
            || enabled(cr1::RXNEIE, sr::RXNE | sr::ORE)
            || enabled(cr1::IDLEIE, sr::IDLE)
            || enabled(cr1::PEIE, sr::PE)
            || self.cr3 & (cr3::EIE | cr3::DMAR) == cr3::EIE | cr3::DMAR && status & (sr::FE | sr::NF | sr::ORE) != 0
    }

    /// Returns true if UE and this bit of CR1 are set.
    fn is_on(&self, bit: u32) -> bool {
        self.cr1 & (cr1::UE | bit) == cr1::UE | bit
    }

    #[inline]
    fn status(&self) -> u32 {
        let when = |set, bit| if set { bit } else { 0 };
        self.flags | when(self.received.is_some(), sr::RXNE) | when(self.transmit.is_none(), sr::TXE)
    }

    fn format(&self) -> Format {
        let parity = match (self.cr1 & cr1::PCE, self.cr1 & cr1::PS) {
            (0, _) => Parity::None,
            (_, 0) => Parity::Even,
            _ => Parity::Odd,
        };
        Format {
            parity,
            two_stop_bits: field(self.cr2, cr2::STOP_AT, cr2::STOP) == cr2::TWO,
        }
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
            format: self.format(),
            half_duplex: self.cr3 & cr3::HDSEL != 0,
            transmits: self.is_on(cr1::TE),
            receives: self.is_on(cr1::RE),
        };
        self.shifter.set(settings, now);
    }

    /// Handles a received byte. One that arrives while RXNE is set is lost, including its errors (30.3.3).
    fn receive(&mut self, arrival: Arrival) {
        if self.received.is_some() {
            self.flags |= sr::ORE;
            return;
        }
        let flag = |set, bit| if set { bit } else { 0 };
        let noise = arrival.noise && self.cr3 & cr3::ONEBIT == 0;
        self.flags |= flag(arrival.parity, sr::PE) | flag(arrival.framing, sr::FE) | flag(noise, sr::NF);
        self.received = Some(arrival.value);
        self.last = arrival.value;
        self.received_since_idle = true;
    }

    fn read_data(&mut self) -> u32 {
        if let Some(seen) = self.seen.take() {
            self.flags &= !(sr::CLEARED_BY_READING | sr::CLEARED_IF_SEEN & seen);
        }
        self.received.take().unwrap_or(self.last).into()
    }

    fn write_data(&mut self, value: u32) {
        if self.seen.take().is_some() {
            self.flags &= !sr::CLEARED_BY_WRITING;
        }
        self.transmit = Some(value as u8);
    }

    /// A 0 clears TC and RXNE, a 1 has no effect. Hardware controls the other flags.
    fn write_status(&mut self, value: u32) {
        self.seen = None;
        self.flags &= value | !sr::TC;
        if value & sr::RXNE == 0 {
            self.received = None;
        }
    }

    fn write_cr1(&mut self, value: u32) -> Result<(), Refused> {
        if value & !cr1::MODELLED != 0 {
            return Err(Refused::Unimplemented("CR1"));
        }
        if (value & cr1::PCE != 0) != (value & cr1::M != 0) {
            return Err(Refused::Unimplemented("CR1.M: 7 or 9 data bits"));
        }
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
                let stop = field(value, cr2::STOP_AT, cr2::STOP);
                if value & !cr2::MODELLED != 0 || !matches!(stop, cr2::ONE | cr2::TWO) {
                    return Err(Refused::Unimplemented("CR2"));
                }
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
            self.flags |= sr::TC;
        }
        if progress.idle {
            self.flags |= sr::IDLE;
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
