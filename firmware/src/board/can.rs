//! The CAN controller, whatever the chip: what its interrupts bring waits here until somebody takes it.
//!
//! The HAL's drivers are not used. They tell of an error on the bus only whoever waits for a frame, and of lost frames
//! nobody. The one for FDCAN also leaves out the compensation of the transmitter's delay, which a data phase above
//! 1 Mbit/s needs. What is left is little: [`Controller`] has the registers.

use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use armwire_bridge::CanErrors;
use armwire_bridge::can::{Frame, Function, Id, Node};
use armwire_bridge::config;
use embassy_futures::select::select;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use embassy_sync::signal::Signal;
use embassy_time::Timer;

use super::{Controller, Waiting};

/// How many frames may wait to be taken, beside the controller's own three.
pub(crate) const CAPACITY: usize = 8;

/// How many frames a controller has room for on their way to the bus.
pub(super) const ROOM: u8 = 3;

/// Frames from the bus.
static FRAMES: Channel<CriticalSectionRawMutex, Waiting, CAPACITY> = Channel::new();
/// What the interrupt handlers have to say.
static EVENT: Signal<CriticalSectionRawMutex, ()> = Signal::new();
static ERRORS: AtomicU32 = AtomicU32::new(0);
static OVERRUNS: AtomicU32 = AtomicU32::new(0);
static LOST: AtomicBool = AtomicBool::new(false);

/// How long nobody looks at the bus when nothing happens, in milliseconds. A controller that comes back from bus-off
/// does not say so.
const LOOK_MS: u64 = 5;

/// The CAN bus.
pub(crate) struct Can {
    controller: Controller,
    /// Frames that were forgotten, since somebody asked.
    unsent: u32,
}

impl Can {
    /// A controller that is not on the bus yet.
    pub(super) fn new(controller: Controller) -> Self {
        Self { controller, unsent: 0 }
    }

    /// Puts the controller on the bus, anew if it is there. Frames that it has not sent are forgotten.
    pub(crate) fn start(&mut self, config: &config::Can) {
        self.unsent += u32::from(self.waiting());
        self.controller.start(config);
        EVENT.signal(());
    }

    /// Waits until something may have happened: a frame came or went out, or the bus was lost or is back.
    pub(crate) async fn event(&self) {
        select(EVENT.wait(), Timer::after_millis(LOOK_MS)).await;
    }

    /// The next frame for this adapter.
    pub(crate) fn receive(&mut self) -> Option<Frame> {
        FRAMES.try_receive().ok()?.into_frame()
    }

    /// How many frames have not left yet.
    pub(crate) fn waiting(&self) -> u8 {
        self.controller.waiting()
    }

    /// Whether there is room for a frame to the bus.
    pub(crate) fn has_room(&self) -> bool {
        self.waiting() < ROOM
    }

    /// Sends a frame as soon as the bus is free, after those before it. Only when there is room.
    pub(crate) fn transmit(&mut self, frame: &Frame) {
        self.controller.transmit(frame);
    }

    /// What went wrong since this was last asked.
    pub(crate) fn take_errors(&mut self) -> CanErrors {
        CanErrors {
            bus: ERRORS.swap(0, Ordering::Relaxed),
            overruns: OVERRUNS.swap(0, Ordering::Relaxed),
            unsent: core::mem::take(&mut self.unsent),
        }
    }

    /// Whether the controller is off the bus because of too many errors, or was since this was last asked. It comes back by
    /// itself.
    pub(crate) fn take_bus_off(&mut self) -> bool {
        LOST.swap(false, Ordering::Relaxed) || self.controller.is_bus_off()
    }
}

/// The identifiers of frames to the adapter. The controller lets no other pass.
pub(super) fn heard(node: Node) -> [Id; 4] {
    [
        Function::CommandA,
        Function::CommandB,
        Function::ArmRequest,
        Function::ControlRequest,
    ]
    .map(|function| function.id(node))
}

/// A frame came.
pub(super) fn received(frame: Waiting) {
    if FRAMES.try_send(frame).is_err() {
        overrun();
    }
    EVENT.signal(());
}

/// A frame was lost because the ones before it had not been taken.
pub(super) fn overrun() {
    OVERRUNS.fetch_add(1, Ordering::Relaxed);
}

/// The controller saw an error on the bus. A bus that brings nothing else does not wake anybody.
pub(super) fn error() {
    ERRORS.fetch_add(1, Ordering::Relaxed);
}

/// A frame went out.
pub(super) fn changed() {
    EVENT.signal(());
}

/// The bus was lost.
pub(super) fn lost() {
    LOST.store(true, Ordering::Relaxed);
    EVENT.signal(());
}
