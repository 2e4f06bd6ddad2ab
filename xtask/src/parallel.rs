//! Work on all cores.

use std::process::Command;
use std::sync::Mutex;
use std::time::Instant;
use std::{iter, thread};

use anyhow::Result;

use crate::process::{output, shown};

/// Calls `act` for each item, one per core at a time, and returns the results in any order.
///
/// # Errors
///
/// The first error of `act`.
pub(crate) fn for_each<I: Send, T: Send>(
    items: impl IntoIterator<Item = I, IntoIter: Send>,
    act: impl Fn(I) -> Result<T> + Sync,
) -> Result<Vec<T>> {
    let cores = thread::available_parallelism().map_or(1, usize::from);
    let rest = Mutex::new(items.into_iter());
    let next = || rest.lock().expect("no worker panics").next();
    let work = || -> Vec<Result<T>> { iter::from_fn(next).map(&act).collect() };
    thread::scope(|scope| {
        let workers: Vec<_> = (0..cores).map(|_| scope.spawn(work)).collect();
        let results = workers
            .into_iter()
            .flat_map(|worker| worker.join().expect("no worker panics"));
        results.collect()
    })
}

/// Runs commands, one per core at a time, and prints the output and the duration of each at its end.
///
/// # Errors
///
/// The first command that fails.
pub(crate) fn run_all(commands: Vec<Command>) -> Result<()> {
    let run = |mut command: Command| {
        let start = Instant::now();
        let text = output(&mut command)?;
        println!("`{}` took {:.1?}\n{text}", shown(&command), start.elapsed());
        Ok(())
    };
    for_each(commands, run).map(drop)
}
