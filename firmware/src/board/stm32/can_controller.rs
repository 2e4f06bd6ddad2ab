//! Parts of every CAN controller: its pins and filters, and the queue from its interrupt handlers to the task.

use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use armwire_boards::CanPins;
use armwire_bridge::can::{Function, Id, Node};
use embassy_stm32::gpio::{AfType, Flex, OutputType, Pull, Speed};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use embassy_sync::signal::Signal;

use super::{Waiting, pin};
use crate::board::this::THIS;

/// Capacity for received frames, besides the controller's own three.
pub(crate) const CAPACITY: usize = 8;

/// Number of frames that a controller can hold for transmission.
pub(super) const ROOM: u8 = 3;

/// Frames from the bus.
pub(super) static FRAMES: Channel<CriticalSectionRawMutex, Waiting, CAPACITY> = Channel::new();
/// Wakes the task after an interrupt.
pub(super) static EVENT: Signal<CriticalSectionRawMutex, ()> = Signal::new();
static ERRORS: AtomicU32 = AtomicU32::new(0);
static OVERRUNS: AtomicU32 = AtomicU32::new(0);
static WAS_BUS_OFF: AtomicBool = AtomicBool::new(false);

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
    WAS_BUS_OFF.store(true, Ordering::Relaxed);
    EVENT.signal(());
}

/// The numbers of bus errors and of lost frames since the last call.
pub(super) fn take_errors() -> [u32; 2] {
    [&ERRORS, &OVERRUNS].map(|count| count.swap(0, Ordering::Relaxed))
}

/// Returns true if the controller went bus-off since the last call.
pub(super) fn take_bus_off() -> bool {
    WAS_BUS_OFF.swap(false, Ordering::Relaxed)
}
