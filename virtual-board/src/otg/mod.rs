//! USB OTG FS as a device (RM0090, chapter 34): [`core`] is the controller, this joins it to the bus and to the wire.

pub(crate) mod core;
pub(crate) mod registers;

use std::sync::{Arc, Mutex, PoisonError};

use rigless::device::{Device, DeviceContext, Level, RegisterFile};
use rigless::soc::{Layout, Peripheral};
use rigless::time::{EventId, VirtualNanos};

use self::core::Core;
use self::registers::{Row, TABLE};
use crate::time::Nanos;
use crate::timing::Clock;
use crate::usb::host::Host;

/// Where the core is (RM0090, table 1), and its interrupt lines (table 62): global and wake-up.
pub(crate) const PERIPHERAL: Peripheral = Peripheral {
    name: "OTG_FS",
    base: 0x5000_0000,
    size: 0x4_0000,
    interrupts: &[67, 42],
    registers: &TABLE,
};

/// The global interrupt's place among the lines.
const GLOBAL: usize = 0;

/// The clock that the PHY needs, and how far off it may be: 0.25 % (34.3, USB 2.0, 7.1.11).
const PHY_HZ: u64 = 48_000_000;
const PHY_TOLERANCE_HZ: u64 = PHY_HZ / 400;

/// The controller, with a host at the other end of the cable.
#[derive(Debug)]
pub(crate) struct Otg {
    core: Core,
    host: Arc<Mutex<Host>>,
    line: Level,
    /// What the session was told of what the manual forbids, each once.
    told: Vec<&'static str>,
    /// The next instant the host wants, and its event.
    wake: Option<(Nanos, EventId)>,
    /// Something happened on the wire since this was last asked.
    progress: bool,
}

impl Otg {
    pub(crate) fn new(host: Arc<Mutex<Host>>, clock: Clock) -> Self {
        Self {
            core: Core::with_clock(clock),
            host,
            line: Level::Low,
            told: Vec::new(),
            wake: None,
            progress: false,
        }
    }

    /// Whether anything happened on the wire since this was last asked that a program may wait for.
    pub(crate) fn take_progress(&mut self) -> bool {
        std::mem::take(&mut self.progress)
    }

    /// Lets the host see what changed, and drives the interrupt line.
    fn settle(&mut self, context: &mut DeviceContext<'_>) {
        let now = Nanos::from(context.now());
        self.core.now = now;
        self.core.advance();
        let mut host = self.host.lock().unwrap_or_else(PoisonError::into_inner);
        let next = host.poll(now, &mut self.core);
        self.progress |= host.take_progress();
        drop(host);
        let next = next.into_iter().chain(self.core.next_step()).min();
        match (next, &self.wake) {
            (Some(next), Some((at, _))) if next == *at => {}
            (Some(next), _) => self.wake = Some((next, context.schedule(VirtualNanos::from(next)))),
            (None, _) => self.wake = None,
        }
        let line = Level::from(self.core.interrupt());
        if line != self.line {
            self.line = line;
            context.interrupt(GLOBAL, line);
        }
    }

    /// The part restarted at the instant of `context`; the host did not.
    pub(crate) fn restarted(&mut self, context: &mut DeviceContext<'_>) {
        self.settle(context);
    }
}

impl Device for Otg {
    type Register = Row;

    fn read(&mut self, row: Row, _: &mut RegisterFile, context: &mut DeviceContext<'_>) -> Option<u64> {
        self.core.now = context.now().into();
        self.core.advance();
        let value = self.core.read(row.offset());
        self.settle(context);
        Some(value.into())
    }

    fn peek(&self, row: Row, _: &RegisterFile, _: VirtualNanos) -> Option<u64> {
        Some(self.core.peek(row.offset()).into())
    }

    fn write(&mut self, row: Row, value: u64, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.core.now = context.now().into();
        self.core.advance();
        self.core.write(row.offset(), value as u32);
        if let Some(reason) = self.core.take_misuse()
            && !self.told.contains(&reason)
        {
            self.told.push(reason);
            context.tell(row.spec().name, reason);
        }
        self.settle(context);
    }

    fn on_event(&mut self, event: EventId, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if self.wake.is_some_and(|(_, wake)| wake == event) {
            self.wake = None;
            self.settle(context);
        }
    }

    fn on_clock(&mut self, hz: u64, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.core.clocked = hz.abs_diff(PHY_HZ) <= PHY_TOLERANCE_HZ;
        self.settle(context);
    }

    fn poll(&mut self, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.settle(context);
    }

    fn reset(&mut self) {
        self.core = self.core.restarted();
        self.line = Level::Low;
        self.wake = None;
    }

    fn reset_line(&mut self, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let clocked = self.core.clocked;
        Device::reset(self);
        self.core.clocked = clocked;
        self.settle(context);
    }
}
