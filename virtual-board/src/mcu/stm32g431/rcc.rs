//! Reset and clock control (RM0440, chapter 7).
//!
//! Modelled are the oscillators HSI16, HSE, HSI48 and LSI with their start-up times, the PLL, the system clock switch, the
//! prescalers, the clock multiplexers of the peripherals in use, the crystal's divided clock for TIM16, clock enables,
//! resets and reset flags. Low-power clock enables, clock security, the clock output and the RTC's clock have no model.

use std::ops::RangeInclusive;

use crate::crystal::Divided;
use crate::mcu::common::rcc::{self, AHB_START, Gate, Layout, Register, Source, ahb_divider, apb_rates, apb_start};
use crate::shared::lock;
use crate::soc::peripheral::{Peripheral, Refused, check_modelled, check_reserved, field, forbidden};
use crate::time::Nanos;

const CR: u32 = 0x00;
const ICSCR: u32 = 0x04;
const CFGR: u32 = 0x08;
const PLLCFGR: u32 = 0x0C;
const CIER: u32 = 0x18;
const CIFR: u32 = 0x1C;
/// The flags that CICR clears (7.4.7).
const CICR_BITS: u32 = 0x73B;
const CICR: u32 = 0x20;
const AHB1RSTR: u32 = 0x28;
const AHB2RSTR: u32 = 0x2C;
const AHB3RSTR: u32 = 0x30;
const APB1RSTR1: u32 = 0x38;
const APB1RSTR2: u32 = 0x3C;
const APB2RSTR: u32 = 0x40;
const AHB1ENR: u32 = 0x48;
const AHB2ENR: u32 = 0x4C;
const AHB3ENR: u32 = 0x50;
const APB1ENR1: u32 = 0x58;
const APB1ENR2: u32 = 0x5C;
const APB2ENR: u32 = 0x60;
const CCIPR: u32 = 0x88;
const BDCR: u32 = 0x90;
const CSR: u32 = 0x94;
const CRRCR: u32 = 0x98;

/// Bits of CR (7.4.1).
mod cr {
    pub(super) use super::rcc::cr::*;
    pub(super) const HSION: u32 = 1 << 8;
    pub(super) const HSIRDY: u32 = 1 << 10;
    /// The modelled bits that software writes.
    pub(super) const MODELLED: u32 = HSION | HSEON | HSEBYP | PLLON;
    pub(super) const READY: u32 = HSIRDY | HSERDY | PLLRDY;
}

/// Fields of CFGR (7.4.3).
mod cfgr {
    pub(super) const SW: u32 = 0b11;
    pub(super) const SWS_AT: u32 = 2;
    pub(super) const SWS: u32 = 0b11 << SWS_AT;
    pub(super) const HPRE_AT: u32 = 4;
    pub(super) const PPRE1_AT: u32 = 8;
    pub(super) const PPRE2_AT: u32 = 11;
    pub(super) const MODELLED: u32 = SW | 0xF << HPRE_AT | 0b111 << PPRE1_AT | 0b111 << PPRE2_AT;
    /// Values of SW and SWS.
    pub(super) const HSI16: u32 = 0b01;
    pub(super) const HSE: u32 = 0b10;
    pub(super) const PLL: u32 = 0b11;
}

/// Fields of PLLCFGR (7.4.4).
mod pllcfgr {
    pub(super) const SRC: u32 = 0b11;
    pub(super) const SRC_HSI16: u32 = 0b10;
    pub(super) const SRC_HSE: u32 = 0b11;
    pub(super) const M_AT: u32 = 4;
    pub(super) const M: u32 = 0xF;
    pub(super) const N_AT: u32 = 8;
    pub(super) const N: u32 = 0x7F;
    pub(super) const QEN: u32 = 1 << 20;
    pub(super) const Q_AT: u32 = 21;
    pub(super) const REN: u32 = 1 << 24;
    pub(super) const R_AT: u32 = 25;
    /// Q and R divide by 2, 4, 6 or 8.
    pub(super) const DIVIDER: u32 = 0b11;
    /// The enables of the outputs, which may be written while the PLL runs.
    pub(super) const ENABLES: u32 = 1 << 16 | QEN | REN;
    pub(super) const AT_RESET: u32 = 0x10 << N_AT;
    /// P is bit 17, PDIV is bits 27 to 31.
    pub(super) const BITS: u32 =
        SRC | M << M_AT | N << N_AT | ENABLES | 1 << 17 | DIVIDER << Q_AT | DIVIDER << R_AT | 0x1F << 27;
}

/// Fields of CCIPR (7.4.26), each of two bits.
mod ccipr {
    pub(super) const USART2SEL_AT: u32 = 2;
    pub(super) const FDCANSEL_AT: u32 = 24;
    pub(super) const CLK48SEL_AT: u32 = 26;
    pub(super) const MODELLED: u32 = 0b11 << USART2SEL_AT | 0b11 << FDCANSEL_AT | 0b11 << CLK48SEL_AT;
}

/// Bits of CSR (7.4.28).
mod csr {
    pub(super) use super::rcc::csr::*;
    pub(super) const RMVF: u32 = 1 << 23;
    pub(super) const BORRSTF: u32 = 1 << 27;
    pub(super) const AT_POWER_ON: u32 = BORRSTF | PINRSTF;
}

/// Bits of CRRCR (7.4.29).
mod crrcr {
    pub(super) const HSI48ON: u32 = 1;
    pub(super) const HSI48RDY: u32 = 1 << 1;
}

/// The internal oscillator of USB (7.2.5).
const HSI48_HZ: u64 = 48_000_000;

/// Start-up times in nanoseconds: DS12589, tables "HSI16", "HSI48", "LSI" and "PLL characteristics".
const HSI16_START: RangeInclusive<u64> = 800..=1_200;
const HSI48_START: RangeInclusive<u64> = 2_500..=6_000;
const LSI_START: RangeInclusive<u64> = 80_000..=130_000;
const PLL_LOCK: RangeInclusive<u64> = 15_000..=40_000;

/// The divider of the crystal's clock for TIM16 and TIM17 (31.8, OR1).
const HSE_DIVIDER: u32 = 32;

/// Limits of the PLL and of the system clock in hertz (DS12589, table "PLL characteristics").
const PLL_INPUT: RangeInclusive<u64> = 2_660_000..=16_000_000;
const VCO: RangeInclusive<u64> = 96_000_000..=344_000_000;
const MOST: u64 = 170_000_000;

/// The maximum HCLK right after the switch to the PLL, and the time until it may be more (7.2.7).
const MOST_AT_SWITCH: u64 = 80_000_000;
const TRANSITION: Nanos = Nanos(1_000);

/// Buses with an enable and a reset register each (7.4.8 to 7.4.19), by their order in [`BUSES`].
const AHB1: usize = 0;
const AHB2: usize = 1;
const APB1_1: usize = 3;
const APB2: usize = 5;
static BUSES: [Layout; 6] = [
    // The flash interface is enabled.
    Layout {
        enable: Register::new("AHB1ENR", AHB1ENR, 0x111F),
        reset: Register::new("AHB1RSTR", AHB1RSTR, 0x111F),
        at_reset: 1 << 8,
    },
    Layout {
        enable: Register::new("AHB2ENR", AHB2ENR, 0x050F_607F),
        reset: Register::new("AHB2RSTR", AHB2RSTR, 0x050F_607F),
        at_reset: 0,
    },
    Layout {
        enable: Register::new("AHB3ENR", AHB3ENR, 0x101),
        reset: Register::new("AHB3RSTR", AHB3RSTR, 0x101),
        at_reset: 0,
    },
    // The RTC's bus interface is enabled.
    Layout {
        enable: Register::new("APB1ENR1", APB1ENR1, 0xD2FE_CD3F),
        reset: Register::new("APB1RSTR1", APB1RSTR1, 0xD2FE_C13F),
        at_reset: 1 << 10,
    },
    Layout {
        enable: Register::new("APB1ENR2", APB1ENR2, 0x103),
        reset: Register::new("APB1RSTR2", APB1RSTR2, 0x103),
        at_reset: 0,
    },
    Layout {
        enable: Register::new("APB2ENR", APB2ENR, 0x0437_F801),
        reset: Register::new("APB2RSTR", APB2RSTR, 0x0437_F801),
        at_reset: 0,
    },
];

pub(super) mod gates {
    use super::{AHB1, AHB2, APB1_1, APB2, Gate};

    pub(in super::super) const DMA1: Gate = Gate::new(AHB1, 0);
    pub(in super::super) const DMA2: Gate = Gate::new(AHB1, 1);
    pub(in super::super) const DMAMUX1: Gate = Gate::new(AHB1, 2);
    pub(in super::super) const FLASH: Gate = Gate::new(AHB1, 8);
    pub(in super::super) const TIM2: Gate = Gate::new(APB1_1, 0);
    pub(in super::super) const CRS: Gate = Gate::new(APB1_1, 8);
    pub(in super::super) const USART2: Gate = Gate::new(APB1_1, 17);
    pub(in super::super) const USB: Gate = Gate::new(APB1_1, 23);
    pub(in super::super) const FDCAN: Gate = Gate::new(APB1_1, 25);
    pub(in super::super) const PWR: Gate = Gate::new(APB1_1, 28);
    pub(in super::super) const SYSCFG: Gate = Gate::new(APB2, 0);
    pub(in super::super) const TIM16: Gate = Gate::new(APB2, 17);

    /// GPIOA to GPIOG, by number from 0.
    pub(in super::super) const fn gpio(port: u32) -> Gate {
        Gate::new(AHB2, port)
    }
}

/// The rates of the clocks in hertz, 0 for a stopped clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Clocks {
    /// SYSCLK.
    pub(super) system: u64,
    /// HCLK: core, memories, AHB.
    pub(super) ahb: u64,
    /// PCLK1.
    pub(super) apb1: u64,
    /// The input of the timers on APB1.
    pub(super) apb1_timers: u64,
    /// The input of the timers on APB2.
    pub(super) apb2_timers: u64,
    pub(super) usart2: u64,
    pub(super) fdcan: u64,
    /// The 48 MHz of USB.
    pub(super) usb: u64,
}

/// The state that only this chip has.
#[derive(Debug, Default)]
pub(crate) struct Chip {
    hsi48: Source,
    ccipr: u32,
    /// The time of the last switch of SYSCLK.
    switched: Nanos,
}

pub(super) type Rcc = rcc::Rcc<Chip>;

impl rcc::Chip for Chip {
    const BUSES: &'static [Layout] = &BUSES;
    const INTERNAL: u32 = cfgr::HSI16;
    const PLLCFGR_AT_RESET: u32 = pllcfgr::AT_RESET;
    const FLAGS_AT_POWER_ON: u32 = csr::AT_POWER_ON;
    const RMVF: u32 = csr::RMVF;
    const HSION: u32 = cr::HSION;
    const HSIRDY: u32 = cr::HSIRDY;
    const LSI_START: RangeInclusive<u64> = LSI_START;
}

impl Rcc {
    /// Cycles until a clock runs that is enabled in this register.
    fn start_cycles(&self, offset: u32) -> u64 {
        match offset {
            APB1ENR1 | APB1ENR2 => apb_start(field(self.cfgr, cfgr::PPRE1_AT, 0b111)),
            APB2ENR => apb_start(field(self.cfgr, cfgr::PPRE2_AT, 0b111)),
            _ => AHB_START,
        }
    }

    fn vco(&self, now: Nanos) -> u64 {
        if self.pll.is_ready(now) {
            self.pll_input() * u64::from(self.multiplier())
        } else {
            0
        }
    }

    fn multiplier(&self) -> u32 {
        field(self.pllcfgr, pllcfgr::N_AT, pllcfgr::N)
    }

    fn pll_input(&self) -> u64 {
        let source = match self.pllcfgr & pllcfgr::SRC {
            pllcfgr::SRC_HSI16 => self.internal_hz,
            pllcfgr::SRC_HSE => self.crystal_hz,
            _ => 0,
        };
        source / u64::from(field(self.pllcfgr, pllcfgr::M_AT, pllcfgr::M) + 1)
    }

    fn pll_output(&self, enable: u32, at: u32, now: Nanos) -> u64 {
        if self.pllcfgr & enable == 0 {
            return 0;
        }
        self.vco(now) / (2 * u64::from(field(self.pllcfgr, at, pllcfgr::DIVIDER) + 1))
    }

    /// The rates at `now`.
    pub(super) fn clocks(&self, now: Nanos) -> Clocks {
        let when = |source: Source, hz| if source.is_ready(now) { hz } else { 0 };
        let hsi16 = when(self.hsi, self.internal_hz);
        let hse = when(self.hse, self.crystal_hz);
        let pll_q = self.pll_output(pllcfgr::QEN, pllcfgr::Q_AT, now);
        let system = match self.selected {
            cfgr::HSI16 => hsi16,
            cfgr::HSE => hse,
            _ => self.pll_output(pllcfgr::REN, pllcfgr::R_AT, now),
        };
        let ahb = system / ahb_divider(field(self.cfgr, cfgr::HPRE_AT, 0xF));
        let (apb1, apb1_timers) = apb_rates(ahb, field(self.cfgr, cfgr::PPRE1_AT, 0b111));
        let (_, apb2_timers) = apb_rates(ahb, field(self.cfgr, cfgr::PPRE2_AT, 0b111));
        let select = |at| field(self.chip.ccipr, at, 0b11);
        Clocks {
            system,
            ahb,
            apb1,
            apb1_timers,
            apb2_timers,
            usart2: match select(ccipr::USART2SEL_AT) {
                0 => apb1,
                1 => system,
                2 => hsi16,
                _ => 0,
            },
            fdcan: match select(ccipr::FDCANSEL_AT) {
                0 => hse,
                1 => pll_q,
                2 => apb1,
                _ => 0,
            },
            usb: match select(ccipr::CLK48SEL_AT) {
                0 => when(self.chip.hsi48, HSI48_HZ),
                2 => pll_q,
                _ => 0,
            },
        }
    }

    /// Locks the PLL once it is on and its input is ready. Switches the system clock once its source is ready (7.2.7).
    fn settle(&mut self, now: Nanos) {
        self.settled = now;
        let input = match self.pllcfgr & pllcfgr::SRC {
            pllcfgr::SRC_HSI16 => self.hsi,
            pllcfgr::SRC_HSE => self.hse,
            _ => Source::default(),
        };
        let chance = &mut self.chance;
        self.pll.follow(input, || chance.span(PLL_LOCK), now);
        let wanted = match self.cfgr & cfgr::SW {
            cfgr::HSI16 => self.hsi.is_ready(now),
            cfgr::HSE => self.hse.is_ready(now),
            cfgr::PLL => self.pll.is_ready(now) && self.pllcfgr & pllcfgr::REN != 0,
            _ => false,
        };
        if wanted && self.selected != self.cfgr & cfgr::SW {
            self.selected = self.cfgr & cfgr::SW;
            self.chip.switched = now;
        }
        self.follow_divided(now);
    }

    /// Updates the crystal's divided clock, which runs with it, and the source of the core clock.
    fn follow_divided(&self, now: Nanos) {
        let mut oscillator = lock(&self.oscillator);
        oscillator.core_is_internal = self.selected == cfgr::HSI16;
        let runs = self.hse.is_ready(now);
        oscillator.divided = oscillator.divided.filter(|_| runs).or(runs.then_some(Divided {
            since: now,
            hertz: self.crystal_hz as u32,
            divider: HSE_DIVIDER,
        }));
    }

    fn write_cr(&mut self, value: u32, now: Nanos) -> Result<(), Refused> {
        check_modelled("CR", value, cr::MODELLED | cr::READY)?;
        let (hsi16, hse, pll) = (value & cr::HSION != 0, value & cr::HSEON != 0, value & cr::PLLON != 0);
        let off = |on: bool, source| !on && self.selected == source;
        if off(hsi16, cfgr::HSI16) || off(hse, cfgr::HSE) || off(pll, cfgr::PLL) {
            return Err(forbidden(
                "CR",
                "7.4.1: the source of the system clock cannot be switched off",
            ));
        }
        self.bypass = value & cr::HSEBYP != 0;
        if hse != self.hse.on {
            self.hse = Source {
                on: hse,
                ready_at: None,
            };
            self.start_crystal(now);
        }
        let chance = &mut self.chance;
        self.hsi.set(hsi16, || Some(chance.span(HSI16_START)), now);
        if pll && !self.pll.on {
            let vco = self.pll_input() * u64::from(self.multiplier());
            if !PLL_INPUT.contains(&self.pll_input()) || !VCO.contains(&vco) {
                return Err(forbidden(
                    "PLLCFGR",
                    "DS12589, PLL characteristics: input or VCO out of range",
                ));
            }
        }
        self.pll.set(pll, || None, now);
        Ok(())
    }

    /// Starts the crystal, if it is switched on and can start.
    fn start_crystal(&mut self, now: Nanos) {
        let crystal = lock(&self.oscillator).crystal;
        if self.hse.on
            && self.hse.ready_at.is_none()
            && let Some(startup) = crystal.startup
        {
            self.crystal_hz = crystal.hertz.into();
            self.hse.ready_at = Some(now + startup);
        }
    }

    /// Checks for another crystal.
    pub(super) fn sync(&mut self, now: Nanos) {
        self.start_crystal(now);
    }

    fn write_pllcfgr(&mut self, value: u32) -> Result<(), Refused> {
        if self.pll.on && (value ^ self.pllcfgr) & !pllcfgr::ENABLES != 0 {
            return Err(forbidden("PLLCFGR", "7.4.4: written while the PLL is on"));
        }
        check_reserved("PLLCFGR", value, pllcfgr::BITS)?;
        self.pllcfgr = value;
        Ok(())
    }

    /// The violation of the present rates, independent of supply and flash.
    pub(super) fn fault(&self, now: Nanos) -> Option<Refused> {
        let clocks = self.clocks(now);
        if clocks.system > MOST || self.pll_output(pllcfgr::QEN, pllcfgr::Q_AT, now) > MOST {
            return Some(forbidden("PLLCFGR", "7.2.4: an output of the PLL above 170 MHz"));
        }
        if self.selected == cfgr::PLL && clocks.ahb > MOST_AT_SWITCH && now < self.chip.switched + TRANSITION {
            return Some(forbidden(
                "CFGR",
                "7.2.7: HCLK above 80 MHz within 1 µs after the switch to the PLL",
            ));
        }
        None
    }
}

/// The refusal of a register without a model.
fn refusal(offset: u32) -> Refused {
    match offset {
        ICSCR => Refused::Unimplemented("ICSCR"),
        CIER | CIFR | CICR => Refused::Unimplemented("CIER/CIFR/CICR"),
        0x68..=0x9C => Refused::Unimplemented("SMENR"),
        _ => Refused::NoRegister,
    }
}

impl Peripheral for Rcc {
    fn read(&mut self, offset: u32, now: Nanos) -> Result<u32, Refused> {
        if let Some(value) = self.gates.read(offset) {
            return Ok(value);
        }
        match offset {
            CR => Ok(self.read_cr(now)),
            CFGR => Ok(self.cfgr & !cfgr::SWS | self.selected << cfgr::SWS_AT),
            PLLCFGR => Ok(self.pllcfgr),
            CCIPR => Ok(self.chip.ccipr),
            CSR => Ok(self.read_csr(now)),
            CRRCR => Ok(self.chip.hsi48.flags(crrcr::HSI48ON, crrcr::HSI48RDY, now)),
            BDCR => Ok(self.bdcr),
            _ => Err(refusal(offset)),
        }
    }

    fn write(&mut self, offset: u32, value: u32, now: Nanos) -> Result<(), Refused> {
        if let Some(written) = self.gates.write(offset, value, self.start_cycles(offset)) {
            return written;
        }
        match offset {
            CR => self.write_cr(value, now)?,
            CFGR => {
                check_modelled("CFGR", value, cfgr::MODELLED | cfgr::SWS)?;
                self.cfgr = value & cfgr::MODELLED;
            }
            PLLCFGR => self.write_pllcfgr(value)?,
            CCIPR => {
                check_modelled("CCIPR", value, ccipr::MODELLED)?;
                self.chip.ccipr = value;
            }
            CSR => self.write_csr(value, now),
            CRRCR => {
                let chance = &mut self.chance;
                self.chip
                    .hsi48
                    .set(value & crrcr::HSI48ON != 0, || Some(chance.span(HSI48_START)), now);
            }
            BDCR => self.write_bdcr(value)?,
            // Without interrupts there are no flags to clear.
            CIER => check_modelled("CIER", value, 0)?,
            CICR => check_reserved("CICR", value, CICR_BITS)?,
            _ => return Err(refusal(offset)),
        }
        self.settle(now);
        Ok(())
    }

    fn advance(&mut self, now: Nanos) {
        self.settle(now);
    }

    fn due(&self) -> Option<Nanos> {
        let hsi48 = self.chip.hsi48.due(self.settled);
        [self.next_ready(), hsi48].into_iter().flatten().min()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use super::*;
    use crate::crystal::{Crystal, INTERNAL_HZ, LSI_HZ, Oscillator};
    use crate::soc::machine::Cause;

    /// 8 MHz / 2 * 80 / 2 = 160 MHz, Q is 80 MHz.
    const PLLCFGR_160: u32 = 0b11 | 1 << 4 | 80 << 8 | 1 << 20 | 1 << 21 | 1 << 24;

    fn with_crystal(crystal: Crystal) -> Rcc {
        Rcc::new(Arc::new(Mutex::new(Oscillator::new(crystal, INTERNAL_HZ, LSI_HZ))), 0)
    }

    fn rcc() -> Rcc {
        with_crystal(Crystal::new(8_000_000))
    }

    /// Advances the time until no event is due.
    fn wait(rcc: &mut Rcc, now: Nanos) -> Nanos {
        let mut now = now;
        while let Some(due) = rcc.due() {
            now = due;
            rcc.advance(now);
        }
        now
    }

    fn with_pll() -> (Rcc, Nanos) {
        with_pll_divided(0)
    }

    /// The PLL as system clock, with these prescalers.
    fn with_pll_divided(prescalers: u32) -> (Rcc, Nanos) {
        let mut rcc = rcc();
        rcc.write(CR, cr::HSION | cr::HSEON, Nanos(0)).unwrap();
        let now = wait(&mut rcc, Nanos(0));
        rcc.write(PLLCFGR, PLLCFGR_160, now).unwrap();
        rcc.write(CR, cr::HSION | cr::HSEON | cr::PLLON, now).unwrap();
        let now = wait(&mut rcc, now);
        rcc.write(CFGR, cfgr::PLL | prescalers, now).unwrap();
        (rcc, now)
    }

    #[test]
    fn oscillators_and_the_pll_take_their_time() {
        let mut rcc = rcc();
        rcc.write(CR, cr::HSION | cr::HSEON, Nanos(0)).unwrap();
        assert_eq!(rcc.read(CR, Nanos(1_000)).unwrap() & cr::HSERDY, 0);
        assert_ne!(rcc.read(CR, Nanos(2_000_000)).unwrap() & cr::HSERDY, 0);
        rcc.write(CRRCR, crrcr::HSI48ON, Nanos(0)).unwrap();
        assert_eq!(rcc.read(CRRCR, Nanos(1_000)), Ok(crrcr::HSI48ON));
        assert_eq!(rcc.read(CRRCR, Nanos(6_000)), Ok(crrcr::HSI48ON | crrcr::HSI48RDY));
    }

    #[test]
    fn dead_crystal_is_never_ready_until_replaced() {
        let mut rcc = with_crystal(Crystal::dead());
        rcc.write(CR, cr::HSION | cr::HSEON, Nanos(0)).unwrap();
        assert_eq!(rcc.due(), None);
        assert_eq!(
            rcc.read(CR, Nanos::from_millis(1_000)).unwrap() & (cr::HSEON | cr::HSERDY),
            cr::HSEON
        );
        lock(&rcc.oscillator).crystal = Crystal::new(8_000_000);
        rcc.sync(Nanos::from_millis(1_000));
        assert_eq!(rcc.due(), Some(Nanos::from_millis(1_002)));
        assert_ne!(rcc.read(CR, Nanos::from_millis(1_002)).unwrap() & cr::HSERDY, 0);
    }

    #[test]
    fn system_clock_comes_from_locked_pll() {
        let (mut rcc, now) = with_pll();
        assert_eq!(rcc.read(CFGR, now), Ok(cfgr::PLL | cfgr::PLL << cfgr::SWS_AT));
        let clocks = rcc.clocks(now);
        assert_eq!(
            (clocks.system, clocks.ahb, clocks.apb1, clocks.usart2),
            (160_000_000, 160_000_000, 160_000_000, 160_000_000)
        );
        assert_eq!(clocks.usb, 0, "HSI48 is off");
    }

    #[test]
    fn switch_waits_for_unready_source() {
        let mut rcc = rcc();
        rcc.write(CR, cr::HSION | cr::HSEON, Nanos(0)).unwrap();
        rcc.write(CFGR, cfgr::HSE, Nanos(0)).unwrap();
        assert_eq!(rcc.clocks(Nanos(0)).system, 16_000_000);
        let now = wait(&mut rcc, Nanos(0));
        assert_eq!(rcc.clocks(now).system, 8_000_000);
    }

    #[test]
    fn multiplexers_choose_the_clocks_of_peripherals() {
        let (mut rcc, now) = with_pll();
        rcc.write(CCIPR, 0b10 << 2 | 0b01 << 24 | 0b10 << 26, now).unwrap();
        let clocks = rcc.clocks(now);
        assert_eq!(
            (clocks.usart2, clocks.fdcan, clocks.usb),
            (16_000_000, 80_000_000, 80_000_000)
        );
    }

    #[test]
    fn prescaled_buses_give_timers_twice_their_clock() {
        let (mut rcc, now) = with_pll();
        rcc.write(CFGR, cfgr::PLL | 0b1000 << 4 | 0b101 << 8, now).unwrap();
        let clocks = rcc.clocks(now);
        assert_eq!(
            (clocks.ahb, clocks.apb1, clocks.apb1_timers),
            (80_000_000, 20_000_000, 40_000_000)
        );
        assert_eq!([ahb_divider(11), ahb_divider(12), ahb_divider(15)], [16, 64, 512]);
    }

    #[test]
    fn pll_in_use_cannot_change_or_stop() {
        let (mut rcc, now) = with_pll();
        assert!(rcc.write(PLLCFGR, PLLCFGR_160 ^ 1 << 8, now).is_err());
        assert!(rcc.write(CR, cr::HSION | cr::HSEON, now).is_err());
        assert_eq!(rcc.clocks(now).system, 160_000_000);
    }

    #[test]
    fn pll_out_of_its_range_is_refused() {
        let mut rcc = rcc();
        rcc.write(CR, cr::HSION | cr::HSEON, Nanos(0)).unwrap();
        let now = wait(&mut rcc, Nanos(0));
        rcc.write(PLLCFGR, 0b11 | 127 << 8, now).unwrap();
        assert!(rcc.write(CR, cr::HSION | cr::HSEON | cr::PLLON, now).is_err());
    }

    #[test]
    fn reset_flags_give_the_cause_until_cleared() {
        let mut rcc = rcc();
        assert_eq!(rcc.read(CSR, Nanos(0)), Ok(csr::BORRSTF | csr::PINRSTF));
        rcc.write(CSR, csr::RMVF, Nanos(0)).unwrap();
        rcc.reset(Cause::Watchdog);
        rcc.reset(Cause::Software);
        assert_eq!(rcc.read(CSR, Nanos(0)), Ok(csr::IWDGRSTF | csr::SFTRSTF | csr::PINRSTF));
        rcc.reset(Cause::Power);
        assert_eq!(rcc.read(CSR, Nanos(0)), Ok(csr::BORRSTF | csr::PINRSTF));
    }

    #[test]
    fn enables_and_resets_are_the_peripherals_own() {
        let mut rcc = rcc();
        assert!(rcc.gates.is_enabled(gates::FLASH) && !rcc.gates.is_enabled(gates::USART2));
        rcc.write(APB1ENR1, 1 << 17, Nanos(0)).unwrap();
        rcc.write(APB1RSTR1, 1 << 23, Nanos(0)).unwrap();
        assert!(
            rcc.gates.is_enabled(gates::USART2) && rcc.gates.is_held(gates::USB) && !rcc.gates.is_held(gates::USART2)
        );
    }

    #[test]
    fn fast_clock_needs_a_microsecond_at_half() {
        let (rcc, now) = with_pll();
        assert!(rcc.fault(now).is_some(), "160 MHz at once");
        let half = |after| {
            let (mut rcc, now) = with_pll_divided(0b1000 << cfgr::HPRE_AT);
            assert_eq!((rcc.clocks(now).ahb, rcc.fault(now)), (80_000_000, None));
            let now = now + after;
            rcc.write(CFGR, cfgr::PLL, now).unwrap();
            (rcc.clocks(now).ahb, rcc.fault(now).is_some())
        };
        assert_eq!(half(Nanos(999)), (160_000_000, true));
        assert_eq!(half(Nanos(1_000)), (160_000_000, false));
    }

    #[test]
    fn reserved_bits_cannot_be_set() {
        for (register, bit) in [
            (AHB1ENR, 5),
            (AHB1RSTR, 9),
            (AHB2ENR, 7),
            (AHB2RSTR, 25),
            (AHB3ENR, 1),
            (AHB3RSTR, 9),
            (APB1ENR1, 9),
            (APB1RSTR1, 11),
            (APB1ENR2, 2),
            (APB1RSTR2, 7),
            (APB2ENR, 1),
            (APB2RSTR, 27),
            (PLLCFGR, 2),
        ] {
            let mut rcc = rcc();
            let before = rcc.read(register, Nanos(0)).unwrap();
            assert!(
                rcc.write(register, before | 1 << bit, Nanos(0)).is_err(),
                "{register:#x}"
            );
            assert_eq!(rcc.read(register, Nanos(0)), Ok(before), "{register:#x}");
        }
    }
}
