//! Which task runs first of those that have something to do.

use embassy_executor::{Metadata, SpawnError, SpawnToken, Spawner};
use embassy_futures::yield_now;

/// From the one that runs last to the one that runs first: what is nearer to a wire goes before what leads to it.
#[derive(Clone, Copy)]
pub(crate) enum Priority {
    /// What hosts say and are told beside what the arm does: it can wait.
    Control,
    /// Looks what else there is to do.
    Time,
    Background,
    Can,
    FromHost,
    /// What the arm says.
    FromArm,
    ToArm,
    ToHost,
    /// Seldom has anything to do; switches on, first of all, the peripheral that others look at.
    UsbDevice,
}

impl Priority {
    /// Starts a task with this priority, one that does not run yet.
    pub(crate) fn start<S>(self, spawner: Spawner, task: Result<SpawnToken<S>, SpawnError>) {
        let task = task.unwrap();
        task.metadata().set_priority(self as u8);
        spawner.spawn(task);
    }
}

/// Lets all others run that have something to do, but those who can wait.
pub(crate) async fn let_others_run() {
    let task = Metadata::for_current_task().await;
    let priority = task.priority();
    task.set_priority(Priority::Time as u8);
    yield_now().await;
    task.set_priority(priority);
}
