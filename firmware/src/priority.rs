//! Task priorities.

use embassy_executor::{SpawnError, SpawnToken, Spawner};

/// From the lowest to the highest. A task closer to a wire has a higher priority than the tasks that feed it.
#[derive(Clone, Copy)]
pub(crate) enum Priority {
    /// The control port, which can wait.
    Control,
    /// The dispatch of work.
    Time,
    Background,
    #[cfg(feature = "can")]
    Can,
    FromHost,
    /// Changes of the line to the arm.
    Line,
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
