//! Reset and clock control (RM0090, chapter 7).
//!
//! Modelled are the oscillators HSI, HSE and LSI with their start-up times, the main PLL, the system clock switch, the
//! prescalers, the crystal's divided clock for the RTC and TIM11, clock enables, resets and reset flags. PLLI2S, clock
//! security, clock outputs, spread spectrum and interrupts have no model.
//!
//! The board sets the start-up time of the crystal, or a crystal that never starts.

use std::ops::RangeInclusive;

use crate::crystal::Divided;
use crate::mcu::common::rcc::{self, AHB_START, Gate, Layout, Register, Source, ahb_divider, apb_rates, apb_start};
use crate::shared::lock;
use crate::soc::peripheral::{Peripheral, Refused, check_modelled, check_reserved, field, forbidden};
use crate::time::Nanos;

const CR: u32 = 0x00;
const PLLCFGR: u32 = 0x04;
const CFGR: u32 = 0x08;
const CIR: u32 = 0x0C;
const AHB1RSTR: u32 = 0x10;
const AHB2RSTR: u32 = 0x14;
const AHB3RSTR: u32 = 0x18;
const APB1RSTR: u32 = 0x20;
const APB2RSTR: u32 = 0x24;
const AHB1ENR: u32 = 0x30;
const AHB2ENR: u32 = 0x34;
const AHB3ENR: u32 = 0x38;
const APB1ENR: u32 = 0x40;
const APB2ENR: u32 = 0x44;
const AHB1LPENR: u32 = 0x50;
const APB2LPENR: u32 = 0x64;
pub(super) const BDCR: u32 = 0x70;
const CSR: u32 = 0x74;
const SSCGR: u32 = 0x80;
const PLLI2SCFGR: u32 = 0x84;
/// The offset of a register that only the STM32F42x has.
const DCKCFGR: u32 = 0x8C;

/// The bits of CIR that clear its flags (7.3.4).
const CIR_CLEAR: u32 = 0x00BF_0000;

/// Bits of CR (7.3.1).
mod cr {
    pub(super) use super::rcc::cr::*;
    pub(super) const HSION: u32 = 1;
    pub(super) const HSIRDY: u32 = 1 << 1;
    /// The reset value of HSITRIM. HSICAL, a factory value, reads 0.
    pub(super) const HSITRIM: u32 = 0x10 << 3;
    /// The bits with a model, or with their reset value.
    pub(super) const MODELLED: u32 = HSION | HSIRDY | HSITRIM | HSEON | HSERDY | HSEBYP | PLLON | PLLRDY;
}

/// Fields of PLLCFGR (7.3.2).
mod pllcfgr {
    pub(super) const M: u32 = 0x3F;
    pub(super) const N_AT: u32 = 6;
    pub(super) const N: u32 = 0x1FF;
    pub(super) const P_AT: u32 = 16;
    pub(super) const P: u32 = 0b11;
    pub(super) const SRC_HSE: u32 = 1 << 22;
    pub(super) const Q_AT: u32 = 24;
    pub(super) const Q: u32 = 0xF;
    pub(super) const AT_RESET: u32 = 0x2400_3010;
    /// Bit 29 is reserved, and set after a reset. Software may keep or clear it, as that of the manufacturer does.
    pub(super) const BITS: u32 = M | N << N_AT | P << P_AT | SRC_HSE | Q << Q_AT | 1 << 29;
}

/// Fields of CFGR (7.3.3).
mod cfgr {
    pub(super) const SW: u32 = 0b11;
    pub(super) const SWS_AT: u32 = 2;
    pub(super) const SWS: u32 = 0b11 << SWS_AT;
    pub(super) const HPRE_AT: u32 = 4;
    pub(super) const PPRE1_AT: u32 = 10;
    pub(super) const PPRE2_AT: u32 = 13;
    pub(super) const RTCPRE_AT: u32 = 16;
    pub(super) const RTCPRE: u32 = 0x1F;
    pub(super) const MODELLED: u32 = SW | 0xF << HPRE_AT | 0b111 << PPRE1_AT | 0b111 << PPRE2_AT | RTCPRE << RTCPRE_AT;
    /// Values of SW and SWS.
    pub(super) const HSI: u32 = 0b00;
    pub(super) const HSE: u32 = 0b01;
    pub(super) const PLL: u32 = 0b10;
}

/// Bits of CSR (7.3.21).
mod csr {
    pub(super) use super::rcc::csr::*;
    pub(super) const RMVF: u32 = 1 << 24;
    pub(super) const BORRSTF: u32 = 1 << 25;
    pub(super) const PORRSTF: u32 = 1 << 27;
    pub(super) const AT_POWER_ON: u32 = BORRSTF | PINRSTF | PORRSTF;
}

/// Start-up times in nanoseconds: DS8626, tables "HSI oscillator characteristics", "LSI oscillator characteristics", "Main
/// PLL characteristics". The crystal's is the board's.
const HSI_START: RangeInclusive<u64> = 2_200..=4_000;
const LSI_START: RangeInclusive<u64> = 15_000..=40_000;
const PLL_LOCK: RangeInclusive<u64> = 100_000..=300_000;

/// Limits of the PLL in hertz (DS8626, table "Main PLL characteristics"), and of its multiplier and divider (7.3.2).
const PLL_INPUT: RangeInclusive<u64> = 950_000..=2_100_000;
const VCO: RangeInclusive<u64> = 100_000_000..=432_000_000;
const MULTIPLIERS: RangeInclusive<u32> = 50..=432;
const LEAST_DIVIDER: u32 = 2;

/// The maximum rates of APB1 and APB2 (7.2).
const MOST_APB1: u64 = 42_000_000;
const MOST_APB2: u64 = 84_000_000;

/// Buses with an enable and a reset register each (7.3.5 to 7.3.14), by their order in [`BUSES`].
const AHB1: usize = 0;
const AHB2: usize = 1;
const APB1: usize = 3;
const APB2: usize = 4;
static BUSES: [Layout; 5] = [
    // The core-coupled memory is enabled (7.3.10).
    Layout {
        enable: Register::new("AHB1ENR", AHB1ENR, 0x7E74_11FF),
        reset: Register::new("AHB1RSTR", AHB1RSTR, 0x2260_11FF),
        at_reset: 1 << 20,
    },
    Layout {
        enable: Register::new("AHB2ENR", AHB2ENR, 0xF1),
        reset: Register::new("AHB2RSTR", AHB2RSTR, 0xF1),
        at_reset: 0,
    },
    Layout {
        enable: Register::new("AHB3ENR", AHB3ENR, 1),
        reset: Register::new("AHB3RSTR", AHB3RSTR, 1),
        at_reset: 0,
    },
    Layout {
        enable: Register::new("APB1ENR", APB1ENR, 0x36FE_C9FF),
        reset: Register::new("APB1RSTR", APB1RSTR, 0x36FE_C9FF),
        at_reset: 0,
    },
    Layout {
        enable: Register::new("APB2ENR", APB2ENR, 0x0007_5F33),
        reset: Register::new("APB2RSTR", APB2RSTR, 0x0007_5933),
        at_reset: 0,
    },
];

pub(super) mod gates {
    use super::{AHB1, AHB2, APB1, APB2, Gate};

    pub(in super::super) const DMA1: Gate = Gate::new(AHB1, 21);
    pub(in super::super) const DMA2: Gate = Gate::new(AHB1, 22);
    pub(in super::super) const OTG_FS: Gate = Gate::new(AHB2, 7);
    pub(in super::super) const TIM5: Gate = Gate::new(APB1, 3);
    pub(in super::super) const USART2: Gate = Gate::new(APB1, 17);
    pub(in super::super) const USART3: Gate = Gate::new(APB1, 18);
    pub(in super::super) const CAN1: Gate = Gate::new(APB1, 25);
    pub(in super::super) const PWR: Gate = Gate::new(APB1, 28);
    pub(in super::super) const SYSCFG: Gate = Gate::new(APB2, 14);
    pub(in super::super) const TIM11: Gate = Gate::new(APB2, 18);

    /// GPIOA to GPIOI, by number from 0.
    pub(in super::super) const fn gpio(port: u32) -> Gate {
        Gate::new(AHB1, port)
    }
}

/// The rates of the clocks in hertz, 0 for a stopped clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Clocks {
    /// HCLK: core, memories, AHB.
    pub(super) ahb: u64,
    /// PCLK1.
    pub(super) apb1: u64,
    /// The input of the timers on APB1.
    pub(super) apb1_timers: u64,
    /// PCLK2.
    pub(super) apb2: u64,
    /// The input of the timers on APB2.
    pub(super) apb2_timers: u64,
    /// The 48 MHz of USB.
    pub(super) usb: u64,
}

/// This chip has nothing of its own.
#[derive(Debug, Default)]
pub(crate) struct Chip;

pub(super) type Rcc = rcc::Rcc<Chip>;

impl rcc::Chip for Chip {
    const BUSES: &'static [Layout] = &BUSES;
    const INTERNAL: u32 = cfgr::HSI;
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
            APB1ENR => apb_start(field(self.cfgr, cfgr::PPRE1_AT, 0b111)),
            APB2ENR => apb_start(field(self.cfgr, cfgr::PPRE2_AT, 0b111)),
            _ => AHB_START,
        }
    }

    pub(super) fn pll_is_on(&self) -> bool {
        self.pll.on
    }

    /// Checks for a new crystal: one that did not start may start now.
    pub(super) fn sync(&mut self, now: Nanos) {
        if self.hse.on && self.hse.ready_at.is_none() {
            let startup = lock(&self.oscillator).crystal.startup;
            self.hse.ready_at = startup.map(|startup| now + startup);
        }
    }

    fn multiplier(&self) -> u32 {
        field(self.pllcfgr, pllcfgr::N_AT, pllcfgr::N)
    }

    fn pll_takes_crystal(&self) -> bool {
        self.pllcfgr & pllcfgr::SRC_HSE != 0
    }

    fn pll_input(&self) -> u64 {
        let source = if self.pll_takes_crystal() {
            self.crystal_hz
        } else {
            self.internal_hz
        };
        source.checked_div(u64::from(self.pllcfgr & pllcfgr::M)).unwrap_or(0)
    }

    fn vco(&self) -> u64 {
        self.pll_input() * u64::from(self.multiplier())
    }

    /// The rates at `now`.
    pub(super) fn clocks(&self, now: Nanos) -> Clocks {
        let when = |source: Source, hz| if source.is_ready(now) { hz } else { 0 };
        let vco = when(self.pll, self.vco());
        let system = match self.selected {
            cfgr::HSI => when(self.hsi, self.internal_hz),
            cfgr::HSE => when(self.hse, self.crystal_hz),
            _ => vco / (2 * u64::from(field(self.pllcfgr, pllcfgr::P_AT, pllcfgr::P) + 1)),
        };
        let ahb = system / ahb_divider(field(self.cfgr, cfgr::HPRE_AT, 0xF));
        let (apb1, apb1_timers) = apb_rates(ahb, field(self.cfgr, cfgr::PPRE1_AT, 0b111));
        let (apb2, apb2_timers) = apb_rates(ahb, field(self.cfgr, cfgr::PPRE2_AT, 0b111));
        let usb_divider = u64::from(field(self.pllcfgr, pllcfgr::Q_AT, pllcfgr::Q));
        Clocks {
            ahb,
            apb1,
            apb1_timers,
            apb2,
            apb2_timers,
            usb: vco.checked_div(usb_divider).unwrap_or(0),
        }
    }

    /// Locks the PLL once it is on and its input is ready. Switches the system clock once its source is ready (7.2.6).
    fn settle(&mut self, now: Nanos) {
        if self.hse.is_ready(now) && self.crystal_hz == 0 {
            self.crystal_hz = lock(&self.oscillator).crystal.hertz.into();
        } else if !self.hse.on {
            self.crystal_hz = 0;
        }
        let input = if self.pll_takes_crystal() { self.hse } else { self.hsi };
        let chance = &mut self.chance;
        self.pll.follow(input, || chance.span(PLL_LOCK), now);
        let wanted = match self.cfgr & cfgr::SW {
            cfgr::HSI => self.hsi.is_ready(now),
            cfgr::HSE => self.hse.is_ready(now),
            cfgr::PLL => self.pll.is_ready(now),
            _ => false,
        };
        if wanted {
            self.selected = self.cfgr & cfgr::SW;
        }
        self.follow_divided(now);
        self.settled = now;
    }

    /// Updates the crystal's divided clock, and the source of the core clock.
    fn follow_divided(&self, now: Nanos) {
        let divider = field(self.cfgr, cfgr::RTCPRE_AT, cfgr::RTCPRE);
        let mut oscillator = lock(&self.oscillator);
        oscillator.core_is_internal = self.selected == cfgr::HSI;
        oscillator.divided = match oscillator.divided {
            // RTCPRE of 0 and 1 gives no clock (7.3.3).
            _ if !self.hse.is_ready(now) || divider < 2 => None,
            Some(divided) if divided.divider == divider => Some(divided),
            _ => Some(Divided {
                since: now,
                hertz: self.crystal_hz as u32,
                divider,
            }),
        };
    }

    fn write_cr(&mut self, value: u32, now: Nanos) -> Result<(), Refused> {
        if value & !cr::MODELLED != 0 || value & cr::HSITRIM != cr::HSITRIM {
            return Err(Refused::Unimplemented("CR"));
        }
        let (hsi, hse, pll) = (value & cr::HSION != 0, value & cr::HSEON != 0, value & cr::PLLON != 0);
        let off = |on: bool, source| !on && self.selected == source;
        let input_off = self.selected == cfgr::PLL && self.pll_takes_crystal() && !hse;
        if off(hsi, cfgr::HSI) || off(hse, cfgr::HSE) || off(pll, cfgr::PLL) || input_off {
            return Err(forbidden(
                "CR",
                "7.3.1: the source of the system clock cannot be switched off",
            ));
        }
        self.bypass = value & cr::HSEBYP != 0;
        let chance = &mut self.chance;
        self.hsi.set(hsi, || Some(chance.span(HSI_START)), now);
        self.hse.set(hse, || lock(&self.oscillator).crystal.startup, now);
        if pll && !self.pll.on {
            self.check_pll()?;
        }
        self.pll.set(pll, || None, now);
        Ok(())
    }

    /// Checks the settings of the PLL.
    fn check_pll(&self) -> Result<(), Refused> {
        let divider = field(self.pllcfgr, pllcfgr::Q_AT, pllcfgr::Q);
        if !MULTIPLIERS.contains(&self.multiplier()) || divider < LEAST_DIVIDER {
            return Err(forbidden("PLLCFGR", "7.3.2: a wrong multiplier or divider"));
        }
        // A crystal that has not started has no rate yet.
        let has_input = !self.pll_takes_crystal() || self.crystal_hz > 0;
        if has_input && (!PLL_INPUT.contains(&self.pll_input()) || !VCO.contains(&self.vco())) {
            return Err(forbidden(
                "PLLCFGR",
                "DS8626, main PLL characteristics: input or VCO out of range",
            ));
        }
        Ok(())
    }

    /// The violation of the present rates, independent of supply and flash.
    pub(super) fn fault(&self, now: Nanos) -> Option<Refused> {
        let clocks = self.clocks(now);
        (clocks.apb1 > MOST_APB1 || clocks.apb2 > MOST_APB2)
            .then(|| forbidden("CFGR", "7.2: APB1 above 42 MHz, or APB2 above 84 MHz"))
    }
}

/// The refusal of a register without a model.
fn refusal(offset: u32) -> Refused {
    match offset {
        CIR => Refused::Unimplemented("CIR"),
        AHB1LPENR..=APB2LPENR => Refused::Unimplemented("AHBxLPENR/APBxLPENR"),
        SSCGR => Refused::Unimplemented("SSCGR"),
        PLLI2SCFGR => Refused::Unimplemented("PLLI2SCFGR"),
        DCKCFGR => Refused::Unimplemented("DCKCFGR"),
        _ => Refused::NoRegister,
    }
}

impl Peripheral for Rcc {
    fn read(&mut self, offset: u32, now: Nanos) -> Result<u32, Refused> {
        if let Some(value) = self.gates.read(offset) {
            return Ok(value);
        }
        match offset {
            CR => Ok(cr::HSITRIM | self.read_cr(now)),
            PLLCFGR => Ok(self.pllcfgr),
            CFGR => Ok(self.cfgr | self.selected << cfgr::SWS_AT),
            BDCR => Ok(self.bdcr),
            CSR => Ok(self.read_csr(now)),
            _ => Err(refusal(offset)),
        }
    }

    fn write(&mut self, offset: u32, value: u32, now: Nanos) -> Result<(), Refused> {
        if let Some(written) = self.gates.write(offset, value, self.start_cycles(offset)) {
            return written;
        }
        match offset {
            CR => self.write_cr(value, now)?,
            PLLCFGR if self.pll.on => {
                return Err(forbidden("PLLCFGR", "7.3.2: written while the PLL is on"));
            }
            PLLCFGR => {
                check_reserved("PLLCFGR", value, pllcfgr::BITS)?;
                self.pllcfgr = value;
            }
            CFGR => {
                check_modelled("CFGR", value, cfgr::MODELLED | cfgr::SWS)?;
                self.cfgr = value & cfgr::MODELLED;
            }
            // Without interrupts there are no flags to clear.
            CIR => check_modelled("CIR", value, CIR_CLEAR)?,
            BDCR => self.write_bdcr(value)?,
            CSR => self.write_csr(value, now),
            _ => return Err(refusal(offset)),
        }
        self.settle(now);
        Ok(())
    }

    fn advance(&mut self, now: Nanos) {
        self.settle(now);
    }

    fn due(&self) -> Option<Nanos> {
        self.next_ready()
    }
}
