//! Tells the bridge the time when it wants to know it.

use embassy_futures::select::select;
use embassy_futures::yield_now;
use embassy_time::{Instant, Timer};

use crate::adapter::{Adapter, now};
use crate::watchdog::{Task, progress, rest};

/// Calls the bridge when a poll, a time-out or a cyclic frame is due.
#[embassy_executor::task]
pub(crate) async fn tick(adapter: &'static Adapter) {
    loop {
        progress(Task::Time);
        match adapter.look(|bridge| bridge.timeout()) {
            Some(at) if at <= now() => {
                adapter.with(|bridge| bridge.tick(now()));
                yield_now().await;
            }
            Some(at) => {
                let due = Timer::at(Instant::from_micros(at.0));
                let resting = rest(Task::Time);
                select(due, adapter.timeout.wait()).await;
                drop(resting);
            }
            None => {
                let resting = rest(Task::Time);
                adapter.timeout.wait().await;
                drop(resting);
            }
        }
    }
}
