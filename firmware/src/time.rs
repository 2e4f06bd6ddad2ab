//! Tells the tasks what there is to do, and the bridge the time when it wants to know it.

use embassy_futures::select::select;
use embassy_futures::yield_now;
use embassy_time::{Instant, Timer};

use crate::adapter::{Adapter, now};
use crate::watchdog::{Task, progress, rest};

/// Looks what the bridge wants whenever something was said to it, or when the time has come that it said.
#[embassy_executor::task]
pub(crate) async fn tick(adapter: &'static Adapter) {
    loop {
        progress(Task::Time);
        let timeout = adapter.tell();
        let resting = rest(Task::Time);
        match timeout {
            Some(at) if at <= now() => {
                adapter.with(|bridge| bridge.tick(now()));
                yield_now().await;
            }
            Some(at) => {
                select(Timer::at(Instant::from_micros(at.0)), adapter.changed.wait()).await;
            }
            None => adapter.changed.wait().await,
        }
        drop(resting);
    }
}
