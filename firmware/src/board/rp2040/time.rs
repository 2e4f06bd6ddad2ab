//! The clock: the chip's 64-bit timer, which counts microseconds (4.6), for the [timers](crate::board::timers).
//!
//! The HAL's driver is not used: its alarm does not run the service. Further alarms start and end a burst, and detect
//! an idle line.

use core::ops::Add;

use armwire_bridge::{Duration, Instant};
use embassy_rp::interrupt::typelevel::Interrupt;
use embassy_rp::pac::TIMER;

use super::{BurstInterrupt, IdleInterrupt, TimerInterrupt};
use crate::clock::now;

/// The alarms: the next timer, the start and end of a burst, and an idle line.
const NEXT: usize = 0;
const BURST: usize = 1;
const IDLE: usize = 2;

/// The longest time to an alarm, which compares 32 bits.
const LONGEST: u64 = 1 << 31;

/// The lower half of a time in microseconds: the DMA stamps bytes with it, and an alarm compares it.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) struct Stamp(u32);

impl Stamp {
    pub(crate) const fn from_bits(bits: u32) -> Self {
        Self(bits)
    }

    pub(crate) const fn to_bits(self) -> u32 {
        self.0
    }

    /// The last time with this lower half.
    pub(crate) fn latest(self) -> Instant {
        let now = now();
        now - Duration::from_micros(Self::from(now).0.wrapping_sub(self.0).into())
    }

    /// Returns true if this time is at most half a turn of the counter ago.
    pub(crate) fn has_passed(self) -> bool {
        TIMER.timerawl().read().wrapping_sub(self.0) <= i32::MAX as u32
    }
}

impl From<Instant> for Stamp {
    fn from(at: Instant) -> Self {
        Self(at.as_micros() as u32)
    }
}

impl Add<Duration> for Stamp {
    type Output = Self;

    fn add(self, time: Duration) -> Self {
        Self(self.0.wrapping_add(time.as_micros() as u32))
    }
}

/// Starts the alarms. The timer runs.
pub(super) fn start() {
    TIMER.inte().write(|w| {
        for alarm in [NEXT, BURST, IDLE] {
            w.set_alarm(alarm, true);
        }
    });
    // SAFETY: the handler uses only initialised state.
    unsafe { TimerInterrupt::enable() };
}

/// Starts the transmit DMA at `at`, or at once if that has passed.
///
/// The interrupt handler starts it: no task would be as punctual.
pub(crate) fn transmit_at(at: Instant) {
    set_alarm::<BurstInterrupt>(BURST, at.into());
}

/// Looks for the end of a burst at `at`.
pub(crate) fn set_end_alarm(at: Instant) {
    set_alarm::<BurstInterrupt>(BURST, at.into());
}

/// Clears the interrupt of the alarm of a burst.
pub(crate) fn clear_burst_alarm() {
    TIMER.intr().write(|w| w.set_alarm(BURST, true));
}

/// Looks for an idle line at `at`.
pub(crate) fn set_idle_alarm(at: Stamp) {
    set_alarm::<IdleInterrupt>(IDLE, at);
}

/// Clears the interrupt of the alarm for an idle line.
pub(crate) fn clear_idle_alarm() {
    TIMER.intr().write(|w| w.set_alarm(IDLE, true));
}

/// Sets an alarm, at most half a turn of the counter away. Its interrupt comes at once if the time has passed.
fn set_alarm<I: Interrupt>(alarm: usize, at: Stamp) {
    TIMER.alarm(alarm).write_value(at.to_bits());
    // The counter may have passed it in between.
    if at.has_passed() {
        I::pend();
    }
}

/// The time in microseconds.
pub(in crate::board) fn micros() -> u64 {
    loop {
        let high = TIMER.timerawh().read();
        let low = TIMER.timerawl().read();
        if TIMER.timerawh().read() == high {
            return u64::from(high) << 32 | u64::from(low);
        }
    }
}

/// Sets the alarm of the next timer. Returns false if its time has come.
pub(in crate::board) fn set_next_alarm(now: u64, at: u64) -> bool {
    // A later timer is checked again then.
    let at = at.min(now + LONGEST);
    TIMER.alarm(NEXT).write_value(at as u32);
    // The counter may have passed it in between.
    micros() < at
}

/// Clears the interrupt of the alarm. Returns true: a timer may have expired.
pub(in crate::board) fn take_alarm() -> bool {
    TIMER.intr().write(|w| w.set_alarm(NEXT, true));
    true
}
