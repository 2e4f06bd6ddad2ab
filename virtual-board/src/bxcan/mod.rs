//! CAN1, a bxCAN (RM0090, chapter 32): [`core`] is the controller, this joins it to the peripheral bus and to the CAN
//! bus.

pub(crate) mod core;
mod filter;
pub(crate) mod registers;

use std::sync::{Arc, Mutex, PoisonError};

use rigless::device::{Device, DeviceContext, Level, RegisterFile};
use rigless::soc::Layout;
use rigless::soc::stm32f427::generated::can1::Register;
use rigless::time::{EventId, VirtualNanos};

use self::core::Core;
use crate::can::bus::Bus;
use crate::time::Nanos;

/// The instance that is modelled. Its interrupt lines are TX, RX0, RX1 and SCE (table 62).
pub(crate) const CAN: &str = "CAN1";

/// The controller, on the CAN bus.
#[derive(Debug)]
pub(crate) struct Can {
    core: Core,
    bus: Arc<Mutex<Bus>>,
    lines: [Level; 4],
    /// The next instant the bus wants, and its event.
    wake: Option<(Nanos, EventId)>,
    /// A frame ended since this was last asked.
    progress: bool,
}

impl Can {
    pub(crate) fn new(bus: Arc<Mutex<Bus>>) -> Self {
        Self {
            core: Core::default(),
            bus,
            lines: [Level::Low; 4],
            wake: None,
            progress: false,
        }
    }

    /// Whether a frame ended since this was last asked.
    pub(crate) fn take_progress(&mut self) -> bool {
        std::mem::take(&mut self.progress)
    }

    /// Whether nodes have received frames from the board that were not read yet.
    pub(crate) fn has_unread(&self) -> bool {
        self.bus.lock().unwrap_or_else(PoisonError::into_inner).unread() > 0
    }

    /// Lets the bus see what changed, and drives the interrupt lines.
    fn settle(&mut self, context: &mut DeviceContext<'_>) {
        let now = Nanos::from(context.now());
        self.core.now = now;
        let mut bus = self.bus.lock().unwrap_or_else(PoisonError::into_inner);
        self.core.keep_from_initialization(bus.keeps_from_initialization());
        let next = bus.poll(now, &mut self.core);
        self.progress |= bus.take_progress();
        drop(bus);
        match (next, &self.wake) {
            (Some(next), Some((at, _))) if next == *at => {}
            (Some(next), _) => self.wake = Some((next, context.schedule(VirtualNanos::from(next)))),
            (None, _) => self.wake = None,
        }
        let wanted = self.core.interrupts().map(Level::from);
        for (position, (line, wanted)) in self.lines.iter_mut().zip(wanted).enumerate() {
            if *line != wanted {
                *line = wanted;
                context.interrupt(position, wanted);
            }
        }
    }

    /// The part restarted at the instant of `context`; the bus did not.
    pub(crate) fn restarted(&mut self, context: &mut DeviceContext<'_>) {
        self.settle(context);
    }
}

impl Device for Can {
    type Register = Register;

    fn read(&mut self, register: Register, _: &mut RegisterFile, _: &mut DeviceContext<'_>) -> Option<u64> {
        Some(self.core.read(register.spec().offset).into())
    }

    fn peek(&self, register: Register, _: &RegisterFile, _: VirtualNanos) -> Option<u64> {
        Some(self.core.read(register.spec().offset).into())
    }

    fn write(&mut self, register: Register, value: u64, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.core.now = context.now().into();
        self.core.write(register.spec().offset, value as u32);
        self.settle(context);
    }

    fn on_event(&mut self, event: EventId, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if self.wake.is_some_and(|(_, wake)| wake == event) {
            self.wake = None;
            self.settle(context);
        }
    }

    fn on_clock(&mut self, hz: u64, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.core.clock_hz = hz;
        self.settle(context);
    }

    fn poll(&mut self, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.settle(context);
    }

    fn reset(&mut self) {
        self.core = Core::default();
        self.lines = [Level::Low; 4];
        self.wake = None;
    }

    fn reset_line(&mut self, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let clock_hz = self.core.clock_hz;
        Device::reset(self);
        self.core.clock_hz = clock_hz;
        self.settle(context);
    }
}
