//! The progress of tasks, which the [watchdog](crate::watchdog) supervises.
//!
//! An idle task rests: it waits for a signal, for any time, inside [`rest`]. All other waits, for example for the end
//! of a DMA transfer, are bounded. A task that is not at rest must come to rest, or report [`progress`] from time to
//! time.

use portable_atomic::{AtomicU32, Ordering};

/// Maximum number of rounds of the watchdog for a busy task. At 1200 baud a frame takes half a second.
const MAX_ROUNDS: u32 = 12;

/// Tasks that must make progress, and the service, which never rests.
#[derive(Clone, Copy)]
pub(crate) enum Task {
    Service,
    Line,
    Usb,
    PortToHost,
    PortFromHost,
    ControlToHost,
    ControlFromHost,
    #[cfg(feature = "can")]
    Can,
    Time,
    Action,
}

const TASKS: usize = Task::Action as usize + 1;

/// Number of the current round.
static ROUND: AtomicU32 = AtomicU32::new(0);
/// The round of each task's last progress, or [`AT_REST`].
static LAST_PROGRESS: [AtomicU32; TASKS] = [const { AtomicU32::new(0) }; TASKS];
const AT_REST: u32 = u32::MAX;

/// The task is idle and waits for a signal, until the returned guard is dropped.
pub(crate) fn rest(task: Task) -> Resting {
    LAST_PROGRESS[task as usize].store(AT_REST, Ordering::Relaxed);
    Resting(task)
}

#[must_use]
pub(crate) struct Resting(Task);

impl Drop for Resting {
    fn drop(&mut self) {
        progress(self.0);
    }
}

/// The task has made progress.
pub(crate) fn progress(task: Task) {
    LAST_PROGRESS[task as usize].store(ROUND.load(Ordering::Relaxed), Ordering::Relaxed);
}

/// Ends a round of the watchdog. Returns true if every task rests or has made progress in time.
pub(crate) fn end_round() -> bool {
    let round = ROUND.fetch_add(1, Ordering::Relaxed);
    // `AT_REST` is later than every round.
    let is_late = |last: &AtomicU32| round.saturating_sub(last.load(Ordering::Relaxed)) > MAX_ROUNDS;
    !LAST_PROGRESS.iter().any(is_late)
}
