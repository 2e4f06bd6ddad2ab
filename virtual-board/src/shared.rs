//! Things at the board's edges, which the chip and the program share. A board may go to another thread, hence the lock.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A thing at the board's edge.
pub(crate) type Shared<T> = Arc<Mutex<T>>;

/// Gives the thing to use.
pub(crate) fn lock<T: ?Sized>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}
