//! An arm that several threads use.

use std::fmt;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use crate::error::Error;

/// An arm that several threads of a program use, one call at a time, such as its commands and a [`Reader`]. A clone is
/// another handle of the same arm.
///
/// Commands go first: a [`call`](Self::call) waits for the call that runs, and for at most one read of a reader or of a
/// [wait](Self::move_and_wait). These wait for all calls, a wait 0.1 s at most. A call that waits for a motion itself
/// holds the arm meanwhile.
///
/// [`Reader`]: crate::Reader
pub struct Shared<A>(Arc<Inner<A>>);

struct Inner<A> {
    name: String,
    /// `None` once it was taken.
    arm: Mutex<Option<A>>,
    /// The number of calls that wait for the arm.
    waiting: Mutex<usize>,
    /// Notified when no call waits.
    nobody_waits: Condvar,
}

impl<A> Shared<A> {
    /// An arm, by the name that the user calls it.
    pub fn new(name: &str, arm: A) -> Self {
        Self(Arc::new(Inner {
            name: name.to_owned(),
            arm: Mutex::new(Some(arm)),
            waiting: Mutex::new(0),
            nobody_waits: Condvar::new(),
        }))
    }

    /// The arm's name.
    pub fn name(&self) -> &str {
        &self.0.name
    }

    /// Runs `act` with the arm, when no other call uses it. A call inside of `act` would wait for itself.
    ///
    /// # Errors
    ///
    /// [`Error::Closed`] if the arm was [taken](Self::take). Otherwise the error of `act`.
    pub fn call<T, E: From<Error>>(&self, act: impl FnOnce(&mut A) -> Result<T, E>) -> Result<T, E> {
        self.run(self.wait(), act)
    }

    /// Takes the arm out, after the present call. Later calls fail, and readers end.
    pub fn take(&self) -> Option<A> {
        self.wait().take()
    }

    /// Runs `read` with the arm, when nobody else uses it or waits for it.
    ///
    /// # Errors
    ///
    /// As of [`call`](Self::call).
    pub(crate) fn read<T>(&self, read: impl FnOnce(&mut A) -> Result<T, Error>) -> Result<T, Error> {
        let waiting = lock(&self.0.waiting);
        let nobody_waits = self.0.nobody_waits.wait_while(waiting, |waiting| *waiting > 0);
        drop(nobody_waits.unwrap_or_else(PoisonError::into_inner));
        self.run(lock(&self.0.arm), read)
    }

    /// Runs `read` as [`read`](Self::read), but as a [`call`](Self::call) once calls have delayed it for this time.
    ///
    /// # Errors
    ///
    /// As of [`call`](Self::call).
    pub(crate) fn read_within<T>(
        &self,
        patience: Duration,
        read: impl FnOnce(&mut A) -> Result<T, Error>,
    ) -> Result<T, Error> {
        let waiting = lock(&self.0.waiting);
        let waited = self
            .0
            .nobody_waits
            .wait_timeout_while(waiting, patience, |waiting| *waiting > 0);
        let (waiting, waited) = waited.unwrap_or_else(PoisonError::into_inner);
        drop(waiting);
        match waited.timed_out() {
            true => self.call(read),
            false => self.run(lock(&self.0.arm), read),
        }
    }

    /// The number of calls that wait for the arm.
    #[cfg(test)]
    pub(crate) fn waiting(&self) -> usize {
        *lock(&self.0.waiting)
    }

    /// Waits for the arm, ahead of readers.
    fn wait(&self) -> MutexGuard<'_, Option<A>> {
        *lock(&self.0.waiting) += 1;
        let arm = lock(&self.0.arm);
        let mut waiting = lock(&self.0.waiting);
        *waiting -= 1;
        if *waiting == 0 {
            self.0.nobody_waits.notify_all();
        }
        arm
    }

    fn run<T, E: From<Error>>(
        &self,
        mut arm: MutexGuard<'_, Option<A>>,
        act: impl FnOnce(&mut A) -> Result<T, E>,
    ) -> Result<T, E> {
        match &mut *arm {
            Some(arm) => act(arm),
            None => Err(self.closed().into()),
        }
    }

    fn closed(&self) -> Error {
        Error::Closed {
            name: self.name().into(),
        }
    }
}

impl<A> Clone for Shared<A> {
    fn clone(&self) -> Self {
        Self(Arc::clone(&self.0))
    }
}

impl<A> fmt::Debug for Shared<A> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Shared")
            .field("name", &self.0.name)
            .finish_non_exhaustive()
    }
}

/// A panic of another thread's call leaves an arm whose next call begins anew.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;
    use std::thread;

    use super::*;

    #[test]
    fn command_goes_before_the_next_read() {
        let shared = Shared::new("fake", Vec::new());
        let (started, is_started) = mpsc::channel();
        let command = shared.clone();
        let thread = shared
            .read(|order| {
                order.push("read");
                let thread = thread::spawn(move || {
                    started.send(()).unwrap();
                    command.call(|order| {
                        order.push("command");
                        Ok::<_, Error>(())
                    })
                });
                is_started.recv().unwrap();
                // It waits now, or will at once.
                while shared.waiting() == 0 {
                    thread::yield_now();
                }
                Ok(thread)
            })
            .unwrap();
        let order = shared.read(|order| {
            order.push("read");
            Ok(order.clone())
        });
        assert_eq!(order.unwrap(), ["read", "command", "read"]);
        thread.join().unwrap().unwrap();
    }

    #[test]
    fn taken_arm_is_closed_for_others() {
        let shared = Shared::new("fake", 1);
        assert_eq!(shared.take(), Some(1));
        let error = shared.call(|_| Ok::<_, Error>(())).unwrap_err();
        assert_eq!(error.to_string(), "fake: the port is closed");
        assert!(matches!(shared.read(|_| Ok(())), Err(Error::Closed { .. })));
        assert_eq!(shared.take(), None);
    }
}
