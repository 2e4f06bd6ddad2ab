//! The end of a USB frame, in which the controller gets no packet for the host.
//!
//! A token that comes late there can make a hub damage the host's acknowledgement, after which the controller hangs
//! (RP2040-E15). TinyUSB leaves out the same part (`rp2040_usb.c`, `e15_is_critical_frame_period`).

use core::sync::atomic::{AtomicBool, AtomicU16, AtomicU32, Ordering};

use embassy_rp::pac::{TIMER, USB};

/// The part before the end, in microseconds after the start of the frame.
const TIME: u32 = 800;

/// The duration of a frame in microseconds, and how much longer that of a host may be (USB 2.0, 7.1.12).
const FRAME: u32 = 1_000;
const DRIFT: u32 = 1;

/// A later start is that of another count of frames.
const LATEST: u32 = 500;

/// The bits of a frame's number.
const NUMBER: u16 = 0x7FF;

/// The time of the last start of a frame in microseconds, and its number, if [`IS_KNOWN`].
static START: AtomicU32 = AtomicU32::new(0);
static LAST: AtomicU16 = AtomicU16::new(0);
static IS_KNOWN: AtomicBool = AtomicBool::new(false);

/// Enables the interrupt at the start of a frame.
pub(super) fn enable_interrupt() {
    // The HAL's handler disables others.
    critical_section::with(|_| USB.inte().modify(|w| w.set_dev_sof(true)));
}

/// Takes the start of a frame. Returns false if that is not the reason of the interrupt.
pub(super) fn note_start() -> bool {
    if !USB.ints().read().dev_sof() {
        return false;
    }
    let now = micros();
    let number = take_number();
    let frames = number.wrapping_sub(LAST.load(Ordering::Relaxed)) & NUMBER;
    LAST.store(number, Ordering::Relaxed);
    let expected = START
        .load(Ordering::Relaxed)
        .wrapping_add(u32::from(frames) * (FRAME + DRIFT));
    // The interrupt may have waited for a more urgent one.
    let is_late = IS_KNOWN.load(Ordering::Relaxed) && now.wrapping_sub(expected) < LATEST;
    START.store(if is_late { expected } else { now }, Ordering::Relaxed);
    IS_KNOWN.store(true, Ordering::Relaxed);
    true
}

/// The interrupt has waited for long: the time of the start is that of the next one.
pub(super) fn lose_start() {
    IS_KNOWN.store(false, Ordering::Relaxed);
    take_number();
}

/// The number of the last frame. The read clears the interrupt (4.1.4, SOF_RD).
fn take_number() -> u16 {
    USB.sof_rd().read().count()
}

/// Waits until a frame has this much more time, in microseconds. No frame is waited for longer than it takes.
pub(super) fn wait_for_time(more: u32) {
    let start = micros();
    while !lasts(more) && micros().wrapping_sub(start) < FRAME {}
}

/// Returns true if a frame has time for a packet.
pub(super) fn has_time() -> bool {
    lasts(0)
}

fn lasts(more: u32) -> bool {
    let elapsed = micros().wrapping_sub(START.load(Ordering::Relaxed));
    IS_KNOWN.load(Ordering::Relaxed) && elapsed < TIME - more
}

fn micros() -> u32 {
    TIMER.timerawl().read()
}
