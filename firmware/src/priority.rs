//! Task priorities.

use embassy_executor::{Metadata, SpawnError, SpawnToken, Spawner};
use embassy_futures::yield_now;

/// From the lowest to the highest. A task closer to a wire has a higher priority than the tasks that feed it.
#[derive(Clone, Copy)]
pub(crate) enum Priority {
    /// The control port, which can wait.
    Control,
    /// The dispatch of work.
    Time,
    Background,
    Can,
    FromHost,
    /// Bytes from the arm.
    FromArm,
    ToArm,
    ToHost,
    /// USB device: rarely has work, but must first enable the peripheral that the pipes use.
    UsbDevice,
}

impl Priority {
    /// Starts a task with this priority. The task must not be running yet.
    pub(crate) fn start<S>(self, spawner: Spawner, task: Result<SpawnToken<S>, SpawnError>) {
        let task = task.unwrap();
        task.metadata().set_priority(self as u8);
        spawner.spawn(task);
    }
}

/// Lets all other ready tasks run, except those of the lowest priority.
pub(crate) async fn let_others_run() {
    let task = Metadata::for_current_task().await;
    let priority = task.priority();
    task.set_priority(Priority::Time as u8);
    yield_now().await;
    task.set_priority(priority);
}
