//! The chip-independent part of the CAN driver, for the task. [`Controller`] has the registers.
//!
//! The HAL's drivers are not used. They report a bus error only to a pending receive call, and lost frames not at all.
//! The driver for FDCAN also lacks transmitter delay compensation, which a data phase above 1 Mbit/s needs. The
//! remaining code is small.

use armwire_bridge::CanErrors;
use armwire_bridge::can::Frame;
use armwire_bridge::config;
use embassy_futures::select::select;
use embassy_time::Timer;

use super::Controller;
use super::can_controller::{self, EVENT, FRAMES, ROOM};

/// Polling period without an event, in milliseconds: the controller does not report a recovery from bus-off.
const POLL_PERIOD_MS: u64 = 5;

/// The CAN bus.
pub(crate) struct Can {
    controller: Controller,
    /// Unsent frames that were dropped, since they were last reported.
    unsent: u32,
}

impl Can {
    /// A controller that is not on the bus yet.
    pub(super) fn new(controller: Controller) -> Self {
        Self { controller, unsent: 0 }
    }

    /// Starts or restarts the controller. Its unsent frames are dropped.
    pub(crate) fn start(&mut self, config: &config::Can) {
        self.unsent += u32::from(self.waiting());
        self.controller.start(config);
        EVENT.signal(());
    }

    /// Waits for a possible event: a frame was received or sent, or the bus state changed.
    pub(crate) async fn event(&self) {
        select(EVENT.wait(), Timer::after_millis(POLL_PERIOD_MS)).await;
    }

    /// The next frame for this adapter.
    pub(crate) fn receive(&mut self) -> Option<Frame> {
        FRAMES.try_receive().ok()?.into_frame()
    }

    /// Number of frames in the controller.
    pub(crate) fn waiting(&self) -> u8 {
        self.controller.waiting()
    }

    /// Returns true if the controller can take a frame.
    pub(crate) fn has_room(&self) -> bool {
        self.waiting() < ROOM
    }

    /// Queues a frame for transmission. Call this only if [`has_room`](Self::has_room) returns true.
    pub(crate) fn transmit(&mut self, frame: &Frame) {
        self.controller.transmit(frame);
    }

    /// The errors since the last call.
    pub(crate) fn take_errors(&mut self) -> CanErrors {
        let [bus, overruns] = can_controller::take_errors();
        CanErrors {
            bus,
            overruns,
            unsent: core::mem::take(&mut self.unsent),
        }
    }

    /// Returns true if the controller is bus-off, or was since the last call. It recovers by itself.
    pub(crate) fn take_bus_off(&mut self) -> bool {
        can_controller::take_bus_off() || self.controller.is_bus_off()
    }
}
