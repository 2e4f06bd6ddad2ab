//! Several things at a time.

use std::sync::Mutex;
use std::{iter, thread};

use anyhow::{Context, Result};

/// Calls `act` for each item, one per core at a time, and returns the results in any order.
///
/// # Errors
///
/// The first error of `act`, with its item.
pub(crate) fn for_each<T: Send>(
    items: &[impl AsRef<str> + Sync],
    act: impl Fn(&str) -> Result<T> + Sync,
) -> Result<Vec<T>> {
    let cores = thread::available_parallelism().map_or(1, usize::from);
    let rest = Mutex::new(items.iter());
    let next = || rest.lock().expect("no worker panics").next();
    let work = || -> Vec<Result<T>> {
        let results = iter::from_fn(next).map(|item| act(item.as_ref()).with_context(|| item.as_ref().to_owned()));
        results.collect()
    };
    thread::scope(|scope| {
        let workers: Vec<_> = (0..cores).map(|_| scope.spawn(work)).collect();
        let results = workers
            .into_iter()
            .flat_map(|worker| worker.join().expect("no worker panics"));
        results.collect()
    })
}
