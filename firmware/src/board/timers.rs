//! Embassy's time driver: the queue of timers. The chip's [`time`] has the counter and its alarm.

use core::task::Waker;

use embassy_time_driver::Driver;
use embassy_time_queue_utils::Queue;

use super::hal::interrupt::typelevel::Handler;
use super::{TimerInterrupt, time};
use crate::ceiling::{Ceiling, DRIVERS};
use crate::pend::pend;

struct Clock(Ceiling<Timers>);

/// The timers that tasks wait for.
struct Timers {
    queue: Queue,
    /// The time of the next alarm.
    alarm: u64,
}

embassy_time_driver::time_driver_impl!(static CLOCK: Clock = Clock(
    Ceiling::new(DRIVERS, Timers { queue: Queue::new(), alarm: u64::MAX })
));

/// Wakes expired timers.
pub(crate) struct TimerHandler;

impl Handler<TimerInterrupt> for TimerHandler {
    unsafe fn on_interrupt() {
        if time::take_alarm() {
            // Usually the timeout of the bridge, and a poll is due.
            pend();
            CLOCK.0.with(Timers::arm);
        }
    }
}

impl Driver for Clock {
    fn now(&self) -> u64 {
        time::micros()
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        self.0.with(|timers| {
            let is_new = timers.queue.schedule_wake(at, waker);
            // A timer that is due no sooner than the alarm is handled at the alarm.
            if is_new && at < timers.alarm {
                timers.arm();
            }
        });
    }
}

impl Timers {
    /// Wakes expired timers, and sets the alarm for the next one.
    fn arm(&mut self) {
        loop {
            let now = time::micros();
            self.alarm = self.queue.next_expiration(now);
            if time::set_next_alarm(now, self.alarm) {
                return;
            }
        }
    }
}
