//! A GPIO port of an STM32 (RM0440, chapter 9; RM0090, chapter 8). The two differ only in BRR.
//!
//! Input pins are unconnected: they read the level of their pull resistor, low without one.

use crate::line::Pin;
use crate::soc::peripheral::{Peripheral, Refused, field};
use crate::time::Nanos;

const MODER: u32 = 0x00;
const OTYPER: u32 = 0x04;
const OSPEEDR: u32 = 0x08;
const PUPDR: u32 = 0x0C;
const IDR: u32 = 0x10;
const ODR: u32 = 0x14;
const BSRR: u32 = 0x18;
const LCKR: u32 = 0x1C;
const AFRL: u32 = 0x20;
const AFRH: u32 = 0x24;
const BRR: u32 = 0x28;

/// Number of pins of a port.
const PINS: u32 = 16;
const ALL_PINS: u32 = 0xFFFF;

/// Values of a pin's two bits in MODER and in PUPDR.
const ANALOG: u32 = 0b11;
const OUTPUT: u32 = 0b01;
const ALTERNATE: u32 = 0b10;
const PULL_UP: u32 = 0b01;

/// The port-specific reset values.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AtReset {
    moder: u32,
    ospeedr: u32,
    pupdr: u32,
}

impl AtReset {
    pub(crate) const fn new(moder: u32, ospeedr: u32, pupdr: u32) -> Self {
        Self { moder, ospeedr, pupdr }
    }
}

/// A port.
#[derive(Clone, Debug)]
pub(crate) struct Gpio {
    at_reset: AtReset,
    has_brr: bool,
    moder: u32,
    otyper: u32,
    ospeedr: u32,
    pupdr: u32,
    odr: u32,
    afr: [u32; 2],
}

impl Gpio {
    /// A port with these reset values, with or without BRR.
    pub(crate) fn new(at_reset: AtReset, has_brr: bool) -> Self {
        Self {
            at_reset,
            has_brr,
            moder: at_reset.moder,
            otyper: 0,
            ospeedr: at_reset.ospeedr,
            pupdr: at_reset.pupdr,
            odr: 0,
            afr: [0; 2],
        }
    }

    /// The driver of a pin on which a UART may send.
    pub(crate) fn driver(&self, pin: u32) -> Pin {
        match field(self.moder, 2 * pin, 0b11) {
            ALTERNATE => Pin::Uart,
            OUTPUT if self.odr >> pin & 1 == 0 => Pin::Low,
            _ => Pin::Free,
        }
    }

    fn levels(&self) -> u32 {
        let high = |pin: &u32| match field(self.moder, 2 * pin, 0b11) {
            ANALOG => false,
            OUTPUT => self.odr >> pin & 1 != 0,
            _ => field(self.pupdr, 2 * pin, 0b11) == PULL_UP,
        };
        (0..PINS).filter(high).fold(0, |levels, pin| levels | 1 << pin)
    }
}

impl Peripheral for Gpio {
    fn read(&mut self, offset: u32, _: Nanos) -> Result<u32, Refused> {
        match offset {
            MODER => Ok(self.moder),
            OTYPER => Ok(self.otyper),
            OSPEEDR => Ok(self.ospeedr),
            PUPDR => Ok(self.pupdr),
            IDR => Ok(self.levels()),
            ODR => Ok(self.odr),
            BSRR => Ok(0),
            LCKR => Err(Refused::Unimplemented("LCKR")),
            AFRL => Ok(self.afr[0]),
            AFRH => Ok(self.afr[1]),
            BRR if self.has_brr => Ok(0),
            _ => Err(Refused::NoRegister),
        }
    }

    fn write(&mut self, offset: u32, value: u32, _: Nanos) -> Result<(), Refused> {
        match offset {
            MODER => self.moder = value,
            OTYPER => self.otyper = value & ALL_PINS,
            OSPEEDR => self.ospeedr = value,
            PUPDR => self.pupdr = value,
            IDR => {}
            ODR => self.odr = value & ALL_PINS,
            // The set half has priority over the reset half.
            BSRR => self.odr = self.odr & !(value >> PINS) | value & ALL_PINS,
            LCKR => return Err(Refused::Unimplemented("LCKR")),
            AFRL => self.afr[0] = value,
            AFRH => self.afr[1] = value,
            BRR if self.has_brr => self.odr &= !value,
            _ => return Err(Refused::NoRegister),
        }
        Ok(())
    }

    /// Resets the port.
    fn reset(&mut self, _: Nanos) {
        *self = Self::new(self.at_reset, self.has_brr);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOW: Nanos = Nanos(0);

    fn port() -> Gpio {
        Gpio::new(AtReset::new(0xABFF_FFFF, 0x0C00_0000, 0x6400_0000), true)
    }

    #[test]
    fn bsrr_sets_and_resets_and_brr_resets() {
        let mut port = port();
        port.write(BSRR, 0x0000_00F0, NOW).unwrap();
        port.write(BSRR, 0x0011_0001, NOW).unwrap();
        assert_eq!(port.read(ODR, NOW), Ok(0xE1));
        port.write(BRR, 0x0000_0041, NOW).unwrap();
        assert_eq!(port.read(ODR, NOW), Ok(0xA0));
    }

    #[test]
    fn pin_reads_its_output_or_its_pull() {
        let mut port = port();
        port.write(ODR, 0xFFFF, NOW).unwrap();
        assert_eq!(
            port.read(IDR, NOW),
            Ok(1 << 13 | 1 << 15),
            "the debugger's pins are pulled up"
        );
        port.write(MODER, 0xABFF_FFFD, NOW).unwrap();
        assert_eq!(port.read(IDR, NOW), Ok(1 << 13 | 1 << 15 | 1));
    }

    #[test]
    fn port_without_brr_has_no_register_there() {
        let mut port = Gpio::new(port().at_reset, false);
        assert_eq!(port.read(BRR, NOW), Err(Refused::NoRegister));
        assert_eq!(port.write(0x2C, 0, NOW), Err(Refused::NoRegister));
    }
}
