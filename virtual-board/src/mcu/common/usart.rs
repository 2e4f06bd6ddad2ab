//! The parts that the USARTs of both chips share: control bits, flags, the frame format, interrupts and data registers.

use super::shifter::{Settings, Shifter};
use crate::line::{AnyLine, Format, Parity};
use crate::soc::peripheral::{Peripheral, Refused, check_modelled, field};
use crate::time::Nanos;

/// Bits of CR1.
pub(crate) mod cr1 {
    pub(crate) const RE: u32 = 1 << 2;
    pub(crate) const TE: u32 = 1 << 3;
    pub(crate) const IDLEIE: u32 = 1 << 4;
    pub(crate) const RXNEIE: u32 = 1 << 5;
    pub(crate) const TCIE: u32 = 1 << 6;
    pub(crate) const TXEIE: u32 = 1 << 7;
    pub(crate) const PEIE: u32 = 1 << 8;
    pub(crate) const PS: u32 = 1 << 9;
    pub(crate) const PCE: u32 = 1 << 10;
    /// Nine bits, the parity included. The STM32G431 names it M0.
    pub(crate) const M: u32 = 1 << 12;
    pub(crate) const OVER8: u32 = 1 << 15;
    pub(crate) const INTERRUPTS: u32 = IDLEIE | RXNEIE | TCIE | TXEIE | PEIE;
}

/// STOP of CR2.
pub(crate) mod cr2 {
    pub(crate) const STOP_AT: u32 = 12;
    pub(crate) const STOP: u32 = 0b11;
    pub(crate) const ONE: u32 = 0b00;
    pub(crate) const TWO: u32 = 0b10;
    pub(crate) const MODELLED: u32 = STOP << STOP_AT;
}

/// Bits of CR3.
pub(crate) mod cr3 {
    pub(crate) const EIE: u32 = 1;
    pub(crate) const HDSEL: u32 = 1 << 3;
    pub(crate) const DMAR: u32 = 1 << 6;
    pub(crate) const DMAT: u32 = 1 << 7;
    pub(crate) const ONEBIT: u32 = 1 << 11;
}

/// Flags of SR (STM32F405) and ISR (STM32G431).
pub(crate) mod flag {
    pub(crate) const PE: u32 = 1;
    pub(crate) const FE: u32 = 1 << 1;
    /// The STM32F405 names it NF.
    pub(crate) const NE: u32 = 1 << 2;
    pub(crate) const ORE: u32 = 1 << 3;
    pub(crate) const IDLE: u32 = 1 << 4;
    pub(crate) const RXNE: u32 = 1 << 5;
    pub(crate) const TC: u32 = 1 << 6;
    pub(crate) const TXE: u32 = 1 << 7;
    /// The flags that EIE makes interrupts.
    pub(crate) const ERRORS: u32 = FE | NE | ORE;
}

/// The format of a byte by these values of CR1 and CR2.
fn format(cr1: u32, cr2: u32) -> Format {
    let parity = match (cr1 & cr1::PCE, cr1 & cr1::PS) {
        (0, _) => Parity::None,
        (_, 0) => Parity::Even,
        _ => Parity::Odd,
    };
    Format {
        parity,
        two_stop_bits: field(cr2, cr2::STOP_AT, cr2::STOP) == cr2::TWO,
    }
}

/// Returns true if a flag interrupts by its enable in CR1.
#[inline]
pub(crate) fn interrupts(cr1: u32, status: u32) -> bool {
    let enabled = |enable: u32, flags: u32| cr1 & enable != 0 && status & flags != 0;
    enabled(cr1::TXEIE, flag::TXE)
        || enabled(cr1::TCIE, flag::TC)
        || enabled(cr1::RXNEIE, flag::RXNE | flag::ORE)
        || enabled(cr1::IDLEIE, flag::IDLE)
        || enabled(cr1::PEIE, flag::PE)
}

/// Checks a value for CR1. It has eight data bits.
pub(crate) fn check_cr1(value: u32, modelled: u32) -> Result<(), Refused> {
    check_modelled("CR1", value, modelled)?;
    if (value & cr1::PCE != 0) != (value & cr1::M != 0) {
        return Err(Refused::Unimplemented("CR1.M: 7 or 9 data bits"));
    }
    Ok(())
}

/// Checks a value for CR2. It has one or two stop bits.
pub(crate) fn check_cr2(value: u32) -> Result<(), Refused> {
    let stop = field(value, cr2::STOP_AT, cr2::STOP);
    if value & !cr2::MODELLED != 0 || !matches!(stop, cr2::ONE | cr2::TWO) {
        return Err(Refused::Unimplemented("CR2"));
    }
    Ok(())
}

/// The constants of a chip's USART, and its state that the other does not have.
pub(crate) trait Chip: Default {
    /// The enable in CR1.
    const UE: u32;

    /// The bit time in picoseconds, 0 without a divider.
    fn bit(usart: &Usart<Self>) -> u64;
}

/// A USART.
#[derive(Debug)]
pub(crate) struct Usart<C> {
    pub(crate) shifter: Shifter,
    pub(crate) clock_hz: u64,
    pub(crate) cr1: u32,
    pub(crate) cr2: u32,
    pub(crate) cr3: u32,
    pub(crate) brr: u32,
    pub(crate) gtpr: u32,
    /// PE, FE, NE, ORE, IDLE and TC.
    pub(crate) flags: u32,
    /// The received byte, while RXNE is set, and the last one.
    pub(crate) received: Option<u8>,
    pub(crate) last: u8,
    /// The byte for the transmitter, while TXE is clear.
    pub(crate) transmit: Option<u8>,
    pub(crate) chip: C,
}

impl<C: Chip> Usart<C> {
    pub(crate) fn new(line: AnyLine) -> Self {
        Self {
            shifter: Shifter::new(line),
            clock_hz: 0,
            cr1: 0,
            cr2: 0,
            cr3: 0,
            brr: 0,
            gtpr: 0,
            flags: flag::TC,
            received: None,
            last: 0,
            transmit: None,
            chip: C::default(),
        }
    }

    pub(crate) fn set_clock(&mut self, hz: u64, now: Nanos) {
        if hz != self.clock_hz {
            self.clock_hz = hz;
            self.settle(now);
        }
    }

    /// Checks for changes of the line by the program.
    pub(crate) fn sync(&mut self, now: Nanos)
    where
        Self: Peripheral,
    {
        self.settle(now);
        self.advance(now);
    }

    /// Resets the USART, but not the line and the clock.
    pub(crate) fn restart(&mut self, now: Nanos) {
        *self = Self {
            clock_hz: self.clock_hz,
            ..Self::new(self.shifter.line().clone())
        };
        self.settle(now);
    }

    /// Returns true if UE and this bit of CR1 are set.
    pub(crate) fn is_on(&self, bit: u32) -> bool {
        self.cr1 & (C::UE | bit) == C::UE | bit
    }

    /// The flags, RXNE and TXE.
    #[inline]
    pub(crate) fn data_status(&self) -> u32 {
        let when = |set, bit| if set { bit } else { 0 };
        self.flags | when(self.received.is_some(), flag::RXNE) | when(self.transmit.is_none(), flag::TXE)
    }

    /// Passes changes on to the line.
    pub(crate) fn settle(&mut self, now: Nanos) {
        let settings = Settings {
            bit: C::bit(self),
            format: format(self.cr1, self.cr2),
            half_duplex: self.cr3 & cr3::HDSEL != 0,
            transmits: self.is_on(cr1::TE),
            receives: self.is_on(cr1::RE),
            completes: false,
        };
        self.shifter.set(settings, now);
    }
}
