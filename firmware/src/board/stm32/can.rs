//! The chip-independent part of the CAN driver: a queue between the interrupt handlers and the task.
//!
//! The HAL's drivers are not used. They report a bus error only to a pending receive call, and lost frames not at all.
//! The driver for FDCAN also lacks transmitter delay compensation, which a data phase above 1 Mbit/s needs. The
//! remaining code is small: [`Controller`] has the registers.

use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use armwire_boards::CanPins;
use armwire_bridge::CanErrors;
use armwire_bridge::can::{Frame, Function, Id, Node};
use armwire_bridge::config;
use embassy_futures::select::select;
use embassy_stm32::gpio::{AfType, Flex, OutputType, Pull, Speed};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use embassy_sync::signal::Signal;
use embassy_time::Timer;

use super::{Controller, THIS, Waiting, pin};

/// Capacity for received frames, besides the controller's own three.
pub(crate) const CAPACITY: usize = 8;

/// Number of frames that a controller can hold for transmission.
pub(super) const ROOM: u8 = 3;

/// Frames from the bus.
static FRAMES: Channel<CriticalSectionRawMutex, Waiting, CAPACITY> = Channel::new();
/// Wakes the task after an interrupt.
static EVENT: Signal<CriticalSectionRawMutex, ()> = Signal::new();
static ERRORS: AtomicU32 = AtomicU32::new(0);
static OVERRUNS: AtomicU32 = AtomicU32::new(0);
static LOST: AtomicBool = AtomicBool::new(false);

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
        CanErrors {
            bus: ERRORS.swap(0, Ordering::Relaxed),
            overruns: OVERRUNS.swap(0, Ordering::Relaxed),
            unsent: core::mem::take(&mut self.unsent),
        }
    }

    /// Returns true if the controller is bus-off, or was since the last call. It recovers by itself.
    pub(crate) fn take_bus_off(&mut self) -> bool {
        LOST.swap(false, Ordering::Relaxed) || self.controller.is_bus_off()
    }
}

/// Connects the board's pins to the controller, which has this alternate function there.
pub(super) fn take_pins(function: u8) -> [Flex<'static>; 2] {
    const PINS: CanPins = THIS.can.expect("pins of the CAN controller");
    // SAFETY: no other peripheral has these pins of the board.
    let pins = unsafe { [pin::take(PINS.rx), pin::take(PINS.tx)] };
    let [mut rx, mut tx] = pins.map(Flex::new);
    // Without a transceiver the bus looks idle.
    rx.set_as_af_unchecked(function, AfType::input(Pull::Up));
    tx.set_as_af_unchecked(function, AfType::output(OutputType::PushPull, Speed::VeryHigh));
    [rx, tx]
}

/// The identifiers of frames to the adapter. The controller rejects all others.
pub(super) fn accepted_ids(node: Node) -> [Id; 4] {
    [
        Function::CommandA,
        Function::CommandB,
        Function::ArmRequest,
        Function::ControlRequest,
    ]
    .map(|function| function.id(node))
}

/// A frame was received.
pub(super) fn received(frame: Waiting) {
    if FRAMES.try_send(frame).is_err() {
        overrun();
    }
    EVENT.signal(());
}

/// A frame was lost because the queue was full.
pub(super) fn overrun() {
    OVERRUNS.fetch_add(1, Ordering::Relaxed);
}

/// The controller saw an error on the bus. Errors alone do not wake the task.
pub(super) fn error() {
    ERRORS.fetch_add(1, Ordering::Relaxed);
}

/// A frame was sent.
pub(super) fn changed() {
    EVENT.signal(());
}

/// The controller went bus-off.
pub(super) fn bus_off() {
    LOST.store(true, Ordering::Relaxed);
    EVENT.signal(());
}
