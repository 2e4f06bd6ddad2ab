//! USART2 or USART3, the UART of the arm (RM0090, chapter 30).
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

use crate::line::{Arrival, SECOND};
use crate::mcu::common::shifter::Uart;
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

/// The state that only this chip has.
#[derive(Debug, Default)]
pub(crate) struct Chip {
    /// The value of the last read of SR, until an access to DR ends the sequence.
    seen: Option<u32>,
    /// True if a byte was received since the line was last idle.
    received_since_idle: bool,
}

pub(super) type Usart = usart::Usart<Chip>;

impl usart::Chip for Chip {
    const UE: u32 = cr1::UE;

    /// See 30.3.4.
    fn bit(usart: &Usart) -> u64 {
        let cycles = if usart.cr1 & cr1::OVER8 != 0 {
            usart.brr >> 4 << 3 | usart.brr & 0b111
        } else {
            usart.brr
        };
        (u64::from(cycles) * SECOND).checked_div(usart.clock_hz).unwrap_or(0)
    }
}

impl Usart {
    /// The level of the interrupt line (30.4).
    #[inline]
    pub(super) fn interrupts(&self) -> bool {
        let status = self.data_status();
        let reports_errors = self.cr3 & (cr3::EIE | cr3::DMAR) == cr3::EIE | cr3::DMAR;
        usart::interrupts(self.cr1, status) || reports_errors && status & flag::ERRORS != 0
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
        self.chip.received_since_idle = true;
    }

    fn read_data(&mut self) -> u32 {
        if let Some(seen) = self.chip.seen.take() {
            self.flags &= !(clearing::BY_READING | clearing::IF_SEEN & seen);
        }
        self.received.take().unwrap_or(self.last).into()
    }

    fn write_data(&mut self, value: u32) {
        if self.chip.seen.take().is_some() {
            self.flags &= !clearing::BY_WRITING;
        }
        self.transmit = Some(value as u8);
    }

    /// A 0 clears TC and RXNE, a 1 has no effect. Hardware controls the other flags.
    fn write_status(&mut self, value: u32) {
        self.chip.seen = None;
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
                let status = self.data_status();
                self.chip.seen = Some(status);
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
            self.chip.received_since_idle = false;
        }
        if let Some(arrival) = progress.arrived {
            self.receive(arrival);
            if self.chip.received_since_idle {
                self.shifter.expect_idle(now);
            }
        }
    }

    fn due(&self) -> Option<Nanos> {
        self.shifter.due()
    }

    fn reset(&mut self, now: Nanos) {
        self.restart(now);
    }

    fn peek(&mut self, offset: u32, _: Nanos) -> Result<u32, Refused> {
        match offset {
            SR => Ok(self.data_status()),
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
