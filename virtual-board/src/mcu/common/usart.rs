//! The registers that the USARTs of both chips share: control bits, flags, the frame format and interrupts.

use crate::line::{Format, Parity};
use crate::soc::peripheral::{Refused, check_modelled, field};

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
pub(crate) fn format(cr1: u32, cr2: u32) -> Format {
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
