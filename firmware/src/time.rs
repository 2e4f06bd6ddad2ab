//! Tells the tasks what there is to do, and the bridge the time when it wants to know it.

use armwire_bridge::Bridge;
use embassy_futures::select::{Either, select};
use embassy_futures::yield_now;
use embassy_time::{Instant, Timer};

use crate::adapter::{Adapter, Work, now};
use crate::watchdog::{Task, progress, rest};

/// Looks what there is to do whenever the bridge was called, and calls it when the time has come that it said.
#[embassy_executor::task]
pub(crate) async fn tick(adapter: &'static Adapter) {
    loop {
        progress(Task::Time);
        // What was said until now is looked at now, all of it.
        adapter.reset(Work::Dispatch);
        adapter.dispatch();
        // Those that were woken do not wait for the rest.
        yield_now().await;
        let timeout = adapter.take(|bridge| Bridge::timeout(bridge));
        let resting = rest(Task::Time);
        let is_due = match timeout {
            Some(at) => {
                let due = Timer::at(Instant::from_micros(at.as_micros()));
                matches!(select(due, adapter.wait(Work::Dispatch)).await, Either::First(()))
            }
            None => {
                adapter.wait(Work::Dispatch).await;
                false
            }
        };
        drop(resting);
        if is_due {
            adapter.with(|bridge| bridge.tick(now()));
            // A poll that is due is to be on its way before anything else is looked at.
            yield_now().await;
        }
    }
}
