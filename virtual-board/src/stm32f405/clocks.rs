//! The clock controller (RM0090, chapter 7): the library's, with a crystal that takes its time to start, or never does.
//!
//! The library calls the external oscillator ready after a microsecond. Here it learns of HSEON only when the crystal runs;
//! until then HSEON reads as it was written, and HSERDY as 0.

use std::sync::{Arc, Mutex};

use rigless::device::{Device, DeviceContext, RegisterFile, RequestChange};
use rigless::soc::stm32f427::generated::rcc::{Register, cfgr, cr};
use rigless::soc::stm32f427::peripherals::rcc::{Rcc, SWS};
use rigless::time::{EventId, VirtualNanos};

use crate::crystal::{Divided, Oscillator};
use crate::shared::lock;
use crate::time::Nanos;

/// SWS while the core runs from the internal oscillator (7.3.3).
const INTERNAL: u64 = 0;

/// The clock controller.
#[derive(Debug)]
pub(super) struct Clocks {
    pub(super) library: Rcc,
    oscillator: Arc<Mutex<Oscillator>>,
    /// The firmware has switched the crystal on.
    wanted: bool,
    /// It runs, and the library knows.
    runs: bool,
    /// When it will.
    start: Option<EventId>,
}

impl Clocks {
    pub(super) fn new(oscillator: Arc<Mutex<Oscillator>>) -> Self {
        let crystal = {
            let mut oscillator = lock(&oscillator);
            *oscillator = Oscillator::new(oscillator.crystal);
            oscillator.crystal
        };
        let mut library = Rcc::new();
        library.attach_crystals(crystal.hertz.into(), 0);
        Self {
            library,
            oscillator,
            wanted: false,
            runs: false,
            start: None,
        }
    }

    /// The same after a reset of the part.
    pub(super) fn restarted(&self) -> Self {
        Self::new(self.oscillator.clone())
    }

    /// The crystal starts, if it was switched on and can.
    fn start(&mut self, context: &mut DeviceContext<'_>) {
        let startup = lock(&self.oscillator).crystal.startup;
        if self.wanted
            && !self.runs
            && self.start.is_none()
            && let Some(startup) = startup
        {
            self.start = Some(context.schedule(VirtualNanos::from(Nanos::from(context.now()) + startup)));
        }
    }

    /// Notes what the crystal's clock is and what the core runs from.
    fn follow(&mut self, registers: &RegisterFile, context: &DeviceContext<'_>) {
        let configuration = registers.get(Register::Cfgr);
        let mut oscillator = lock(&self.oscillator);
        oscillator.core_is_internal = SWS.get(configuration) == INTERNAL;
        let divider = cfgr::RTCPRE.get(configuration) as u32;
        let is_ready = cr::HSERDY.is_set(registers.get(Register::Cr));
        oscillator.divided = match oscillator.divided {
            // RTCPRE of 0 and 1 is no clock (7.3.3).
            _ if !is_ready || divider < 2 => None,
            Some(divided) if divided.divider == divider => Some(divided),
            _ => Some(Divided {
                since: context.now().into(),
                hertz: oscillator.crystal.hertz,
                divider,
            }),
        };
    }

    /// CR as the firmware sees it: HSEON is on while the crystal starts.
    fn control(&self, value: u64) -> u64 {
        if self.wanted { cr::HSEON.set(value, 1) } else { value }
    }
}

impl Device for Clocks {
    type Register = Register;

    fn read(
        &mut self,
        register: Register,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        let value = self.library.read(register, registers, context);
        match register {
            Register::Cr => Some(self.control(value.unwrap_or_else(|| registers.get(Register::Cr)))),
            _ => value,
        }
    }

    fn peek(&self, register: Register, registers: &RegisterFile, now: VirtualNanos) -> Option<u64> {
        let value = self.library.peek(register, registers, now);
        match register {
            Register::Cr => Some(self.control(value.unwrap_or_else(|| registers.get(Register::Cr)))),
            _ => value,
        }
    }

    fn write(&mut self, register: Register, value: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if register == Register::Cr {
            let control = registers.get(Register::Cr);
            self.wanted = cr::HSEON.is_set(control);
            if !self.wanted {
                self.start = None;
            }
            if !self.runs {
                registers.set(Register::Cr, cr::HSEON.set(control, 0));
            }
        }
        self.library.write(register, value, registers, context);
        if register == Register::Cr && self.runs {
            // One that clocks the system cannot be switched off.
            self.wanted = cr::HSEON.is_set(registers.get(Register::Cr));
            self.runs = self.wanted;
        }
        self.start(context);
        self.follow(registers, context);
    }

    fn on_event(&mut self, event: EventId, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if self.start == Some(event) {
            self.start = None;
            self.runs = true;
            self.library
                .attach_crystals(lock(&self.oscillator).crystal.hertz.into(), 0);
            let control = cr::HSEON.set(registers.get(Register::Cr), 1);
            registers.set(Register::Cr, control);
            self.library.write(Register::Cr, control, registers, context);
        }
        self.library.on_event(event, registers, context);
        self.follow(registers, context);
    }

    fn on_request(&mut self, change: RequestChange, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.library.on_request(change, registers, context);
    }

    fn poll(&mut self, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.start(context);
    }
}
