//! State at the board's connectors, shared by the chip and the program. A board may move to another thread, hence the
//! lock.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Shared state.
pub(crate) type Shared<T> = Arc<Mutex<T>>;

/// Locks the state.
pub(crate) fn lock<T: ?Sized>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}
