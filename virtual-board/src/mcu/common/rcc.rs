//! Common parts of reset and clock control: oscillators, prescalers, and the enable and reset bits of each peripheral.

use std::ops::RangeInclusive;

use crate::crystal::Oscillator;
use crate::shared::{Shared, lock};
use crate::soc::chance::Chance;
use crate::soc::machine::Cause;
use crate::soc::peripheral::{Refused, check_modelled, check_reserved};
use crate::time::Nanos;

/// An oscillator or the PLL.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Source {
    pub(crate) on: bool,
    /// The time at which it is ready, while it is on. `None` for a PLL without input, and for a crystal that does not
    /// start.
    pub(crate) ready_at: Option<Nanos>,
}

impl Source {
    /// The chip's initial oscillator.
    pub(crate) const READY: Self = Self {
        on: true,
        ready_at: Some(Nanos(0)),
    };

    /// Switches it on or off. It becomes ready after the time of `takes`, if any.
    pub(crate) fn set(&mut self, on: bool, takes: impl FnOnce() -> Option<Nanos>, now: Nanos) {
        if on != self.on {
            self.on = on;
            self.ready_at = if on { takes().map(|span| now + span) } else { None };
        }
    }

    pub(crate) fn is_ready(self, now: Nanos) -> bool {
        self.ready_at.is_some_and(|at| at <= now)
    }

    /// Locks an enabled PLL once its input is ready, after the time of `takes`.
    pub(crate) fn follow(&mut self, input: Self, takes: impl FnOnce() -> Nanos, now: Nanos) {
        if self.on && !input.is_ready(now) {
            self.ready_at = None;
        } else if self.on && self.ready_at.is_none() {
            self.ready_at = Some(now + takes());
        }
    }

    /// The time at which it becomes ready, if that is after `settled`.
    pub(crate) fn due(&self, settled: Nanos) -> Option<Nanos> {
        self.ready_at.filter(|&at| at > settled)
    }

    /// Its enable and ready bits in a register.
    pub(crate) fn flags(self, on: u32, ready: u32, now: Nanos) -> u32 {
        (if self.on { on } else { 0 }) | if self.is_ready(now) { ready } else { 0 }
    }
}

/// Bits of CR at the same place in both chips.
pub(crate) mod cr {
    pub(crate) const HSEON: u32 = 1 << 16;
    pub(crate) const HSERDY: u32 = 1 << 17;
    pub(crate) const HSEBYP: u32 = 1 << 18;
    pub(crate) const PLLON: u32 = 1 << 24;
    pub(crate) const PLLRDY: u32 = 1 << 25;
}

/// Bits of CSR at the same place in both chips.
pub(crate) mod csr {
    pub(crate) const LSION: u32 = 1;
    pub(crate) const LSIRDY: u32 = 1 << 1;
    pub(crate) const PINRSTF: u32 = 1 << 26;
    pub(crate) const SFTRSTF: u32 = 1 << 28;
    pub(crate) const IWDGRSTF: u32 = 1 << 29;
}

/// The divider of the AHB prescaler, HPRE of CFGR.
pub(crate) fn ahb_divider(hpre: u32) -> u64 {
    match hpre {
        0..=7 => 1,
        8..=11 => 2 << (hpre - 8),
        // 32 does not exist.
        _ => 64 << (hpre - 12),
    }
}

/// The divider of an APB prescaler, PPRE of CFGR.
fn apb_divider(ppre: u32) -> u64 {
    match ppre {
        0..=3 => 1,
        _ => 2 << (ppre - 4),
    }
}

/// The rate of an APB with this PPRE of CFGR, and that of its timers: twice that of a divided bus (RM0090, 7.2; RM0440,
/// 7.2.16).
pub(crate) fn apb_rates(ahb: u64, ppre: u32) -> (u64, u64) {
    let divider = apb_divider(ppre);
    let bus = ahb / divider;
    (bus, if divider == 1 { bus } else { 2 * bus })
}

/// A peripheral's bit in the enable and in the reset register of its bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Gate {
    bus: usize,
    mask: u32,
}

impl Gate {
    /// The bit of this number in the registers of a bus, by its order in [`Gates::new`].
    pub(crate) const fn new(bus: usize, bit: u32) -> Self {
        Self { bus, mask: 1 << bit }
    }
}

/// A register of enables or resets, and its bits.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Register {
    name: &'static str,
    offset: u32,
    bits: u32,
}

impl Register {
    pub(crate) const fn new(name: &'static str, offset: u32, bits: u32) -> Self {
        Self { name, offset, bits }
    }

    fn check(&self, value: u32) -> Result<(), Refused> {
        check_reserved(self.name, value, self.bits)
    }
}

/// The enable and the reset register of a bus, and the enables after a reset.
#[derive(Debug)]
pub(crate) struct Layout {
    pub(crate) enable: Register,
    pub(crate) reset: Register,
    pub(crate) at_reset: u32,
}

/// The enables and resets of a bus.
#[derive(Clone, Debug)]
struct Bus {
    layout: &'static Layout,
    enables: u32,
    resets: u32,
}

/// A clock that was enabled, and does not run yet.
#[derive(Clone, Debug)]
struct Starting {
    gate: Gate,
    /// Cycles of the core between the write and the first access.
    wait: u64,
    /// The first cycle of the core at which an access may begin. `None` until [`Gates::start`].
    runs_at: Option<u64>,
}

/// An enable and a reset register for each bus.
#[derive(Clone, Debug)]
pub(crate) struct Gates {
    buses: Vec<Bus>,
    starting: Vec<Starting>,
}

impl Gates {
    /// The reset state.
    pub(crate) fn new(buses: &'static [Layout]) -> Self {
        let bus = |layout: &'static Layout| Bus {
            layout,
            enables: layout.at_reset,
            resets: 0,
        };
        Self {
            buses: buses.iter().map(bus).collect(),
            starting: Vec::new(),
        }
    }

    /// Returns true if the peripheral's clock is on.
    #[inline]
    pub(crate) fn is_enabled(&self, gate: Gate) -> bool {
        self.buses[gate.bus].enables & gate.mask != 0
    }

    /// Returns true if the peripheral's clock does not run yet at this cycle of the core.
    #[inline]
    pub(crate) fn is_starting(&self, gate: Gate, cycle: u64) -> bool {
        let waits = |starting: &Starting| {
            let (bus, mask) = (starting.gate.bus, starting.gate.mask);
            bus == gate.bus && mask & gate.mask != 0 && starting.runs_at.is_some_and(|at| cycle < at)
        };
        self.starting.iter().any(waits)
    }

    /// Returns true if the peripheral is held in reset.
    #[inline]
    pub(crate) fn is_held(&self, gate: Gate) -> bool {
        self.buses[gate.bus].resets & gate.mask != 0
    }

    /// Returns true if any peripheral is held in reset.
    pub(crate) fn holds_any(&self) -> bool {
        self.buses.iter().any(|bus| bus.resets != 0)
    }

    /// Reads the register at an offset of the RCC, if it is one of them.
    pub(crate) fn read(&self, offset: u32) -> Option<u32> {
        self.buses.iter().find_map(|bus| match offset {
            _ if offset == bus.layout.enable.offset => Some(bus.enables),
            _ if offset == bus.layout.reset.offset => Some(bus.resets),
            _ => None,
        })
    }

    /// Writes the register at an offset of the RCC, if it is one of them. A clock starts `wait` cycles of the core after
    /// it is enabled.
    pub(crate) fn write(&mut self, offset: u32, value: u32, wait: u64) -> Option<Result<(), Refused>> {
        let has = |bus: &Bus| offset == bus.layout.enable.offset || offset == bus.layout.reset.offset;
        let number = self.buses.iter().position(has)?;
        let bus = self.buses.get_mut(number)?;
        let Layout { enable, reset, .. } = bus.layout;
        if offset == reset.offset {
            return Some(reset.check(value).map(|()| bus.resets = value));
        }
        let checked = enable.check(value);
        if checked.is_ok() {
            let mask = value & !bus.enables;
            bus.enables = value;
            let gate = Gate { bus: number, mask };
            let runs_at = None;
            self.starting
                .extend((mask != 0).then_some(Starting { gate, wait, runs_at }));
        }
        Some(checked)
    }

    /// Starts the clocks that the core has enabled by an instruction at this cycle.
    pub(crate) fn start(&mut self, cycle: u64) {
        self.starting
            .retain(|starting| starting.runs_at.is_none_or(|at| at > cycle));
        for starting in &mut self.starting {
            starting.runs_at.get_or_insert(cycle + 1 + starting.wait);
        }
    }

    /// All enabled clocks run: the core has read a register of the RCC, which takes longer.
    pub(crate) fn finish_starting(&mut self) {
        self.starting.clear();
    }
}

/// Cycles of the core between the enabling of a clock and the first access to the peripheral (ES0182, "Delay after an RCC
/// peripheral clock enabling"; RM0440, "Peripheral clock enable register"), on the AHB.
pub(crate) const AHB_START: u64 = 2;

/// See [`AHB_START`]: on an APB with this prescaler in CFGR.
pub(crate) fn apb_start(ppre: u32) -> u64 {
    1 + apb_divider(ppre)
}

/// The constants of a chip, and its state that the other does not have.
pub(crate) trait Chip: Default {
    const BUSES: &'static [Layout];
    /// The internal oscillator as source of SYSCLK: SW of CFGR.
    const INTERNAL: u32;
    const PLLCFGR_AT_RESET: u32;
    /// The reset flags of CSR at power-on, and the bit that clears them.
    const FLAGS_AT_POWER_ON: u32;
    const RMVF: u32;
    /// Bits of CR.
    const HSION: u32;
    const HSIRDY: u32;
    /// The start-up time of LSI, in nanoseconds.
    const LSI_START: RangeInclusive<u64>;
}

/// Reset and clock control.
#[derive(Debug)]
pub(crate) struct Rcc<C> {
    pub(crate) oscillator: Shared<Oscillator>,
    /// The rate of HSI.
    pub(crate) internal_hz: u64,
    /// The rate of the crystal.
    pub(crate) crystal_hz: u64,
    pub(crate) chance: Chance,
    pub(crate) hsi: Source,
    pub(crate) hse: Source,
    pub(crate) lsi: Source,
    pub(crate) pll: Source,
    pub(crate) bypass: bool,
    pub(crate) cfgr: u32,
    /// The source of SYSCLK: SWS.
    pub(crate) selected: u32,
    pub(crate) pllcfgr: u32,
    pub(crate) bdcr: u32,
    pub(crate) gates: Gates,
    /// The reset flags of CSR.
    flags: u32,
    /// The time up to which due events have been executed.
    pub(crate) settled: Nanos,
    pub(crate) chip: C,
}

impl<C: Chip> Rcc<C> {
    /// The power-on reset state, with this crystal.
    pub(crate) fn new(oscillator: Shared<Oscillator>, seed: u64) -> Self {
        let internal_hz = {
            let mut oscillator = lock(&oscillator);
            *oscillator = Oscillator::new(oscillator.crystal, oscillator.internal_hz, oscillator.lsi_hz);
            oscillator.internal_hz.into()
        };
        Self {
            oscillator,
            internal_hz,
            crystal_hz: 0,
            chance: Chance::new(seed, "RCC"),
            hsi: Source::READY,
            hse: Source::default(),
            lsi: Source::default(),
            pll: Source::default(),
            bypass: false,
            cfgr: C::INTERNAL,
            selected: C::INTERNAL,
            pllcfgr: C::PLLCFGR_AT_RESET,
            bdcr: 0,
            gates: Gates::new(C::BUSES),
            flags: C::FLAGS_AT_POWER_ON,
            settled: Nanos(0),
            chip: C::default(),
        }
    }

    /// A reset by this cause. Flags of earlier resets stay.
    pub(crate) fn reset(&mut self, cause: Cause) {
        let flags = match cause {
            Cause::Power => C::FLAGS_AT_POWER_ON,
            Cause::Software => self.flags | csr::SFTRSTF | csr::PINRSTF,
            Cause::Watchdog => self.flags | csr::IWDGRSTF | csr::PINRSTF,
        };
        *self = Self {
            chance: self.chance.clone(),
            flags,
            bdcr: if cause == Cause::Power { 0 } else { self.bdcr },
            settled: self.settled,
            ..Self::new(self.oscillator.clone(), 0)
        };
    }

    #[inline]
    pub(crate) fn gates(&self) -> &Gates {
        &self.gates
    }

    pub(crate) fn gates_mut(&mut self) -> &mut Gates {
        &mut self.gates
    }

    /// The watchdog keeps the low-speed oscillator on.
    pub(crate) fn keep_lsi_on(&mut self, now: Nanos) {
        self.set_lsi(true, now);
    }

    fn set_lsi(&mut self, on: bool, now: Nanos) {
        let chance = &mut self.chance;
        self.lsi.set(on, || Some(chance.span(C::LSI_START)), now);
    }

    /// The bits of CR for HSI, HSE and the PLL.
    pub(crate) fn read_cr(&self, now: Nanos) -> u32 {
        let oscillators = self.hsi.flags(C::HSION, C::HSIRDY, now) | self.hse.flags(cr::HSEON, cr::HSERDY, now);
        let bypass = if self.bypass { cr::HSEBYP } else { 0 };
        oscillators | bypass | self.pll.flags(cr::PLLON, cr::PLLRDY, now)
    }

    pub(crate) fn read_csr(&self, now: Nanos) -> u32 {
        self.flags | self.lsi.flags(csr::LSION, csr::LSIRDY, now)
    }

    pub(crate) fn write_csr(&mut self, value: u32, now: Nanos) {
        if value & C::RMVF != 0 {
            self.flags = 0;
        }
        self.set_lsi(value & csr::LSION != 0, now);
    }

    /// Writes BDCR. RTCSEL, RTCEN and BDRST are stored: they have no effect without the RTC.
    pub(crate) fn write_bdcr(&mut self, value: u32) -> Result<(), Refused> {
        const RTCSEL: u32 = 0b11 << 8;
        const RTCEN: u32 = 1 << 15;
        const BDRST: u32 = 1 << 16;
        check_modelled("BDCR", value, RTCSEL | RTCEN | BDRST)?;
        self.bdcr = if value & BDRST != 0 { BDRST } else { value };
        Ok(())
    }

    /// The time at which HSI, HSE, LSI or the PLL becomes ready.
    pub(crate) fn next_ready(&self) -> Option<Nanos> {
        let sources = [self.hsi, self.hse, self.lsi, self.pll];
        sources.iter().filter_map(|source| source.due(self.settled)).min()
    }
}
