//! The dispatch of work to the tasks, and the bridge's timeout.

use armwire_bridge::Bridge;
use embassy_futures::select::{Either, select};
use embassy_futures::yield_now;
use embassy_time::{Instant, Timer};

use crate::adapter::{Adapter, Work};
use crate::clock::now;
use crate::progress::{Task, progress, rest};

/// Dispatches after every call of the bridge, and calls it at its timeout.
#[embassy_executor::task]
pub(crate) async fn tick(adapter: &'static Adapter) {
    loop {
        progress(Task::Time);
        // All calls up to now are covered by this dispatch.
        adapter.reset(Work::Dispatch);
        adapter.dispatch();
        // Woken tasks run before the rest, and before bytes that the service has left to later.
        yield_now().await;
        adapter.catch_up();
        adapter.act();
        let timeout = adapter.take(Bridge::timeout);
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
        }
    }
}
