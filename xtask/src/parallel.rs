//! Work on all cores.

use std::process::Command;
use std::sync::Mutex;
use std::time::Instant;
use std::{iter, thread};

use anyhow::{Result, anyhow};

use crate::process::{output, shown};

/// Calls `act` for each item, one per core at a time, and returns the results in any order.
///
/// # Errors
///
/// An error of `act`. No further item is then begun.
pub(crate) fn for_each<I: Send, T: Send>(
    items: impl IntoIterator<Item = I, IntoIter: Send>,
    act: impl Fn(I) -> Result<T> + Sync,
) -> Result<Vec<T>> {
    let cores = thread::available_parallelism().map_or(1, usize::from);
    let rest = Mutex::new(items.into_iter());
    let next = || rest.lock().expect("no worker panics").next();
    let work = || -> Result<Vec<T>> {
        let results: Result<Vec<T>> = iter::from_fn(next).map(&act).collect();
        if results.is_err() {
            iter::from_fn(next).for_each(drop);
        }
        results
    };
    let results = thread::scope(|scope| -> Result<Vec<_>> {
        let workers: Vec<_> = (0..cores).map(|_| scope.spawn(work)).collect();
        let results = workers
            .into_iter()
            .map(|worker| worker.join().expect("no worker panics"));
        results.collect()
    })?;
    Ok(results.into_iter().flatten().collect())
}

/// Runs commands, one per core at a time, and prints the output and the duration of each at its end.
///
/// # Errors
///
/// A command that fails. Its output is printed.
pub(crate) fn run_all(commands: Vec<Command>) -> Result<()> {
    let run = |mut command: Command| {
        let start = Instant::now();
        let result = output(&mut command);
        let words = shown(&command);
        match &result {
            Ok(text) => println!("`{words}` took {:.1?}\n{text}", start.elapsed()),
            Err(error) => println!("{error}"),
        }
        result.map(drop).map_err(|_| anyhow!("`{words}` failed"))
    };
    for_each(commands, run).map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_item_has_a_result() {
        let mut squares = for_each(0..100, |n| Ok(n * n)).unwrap();
        squares.sort_unstable();
        assert_eq!(squares, (0..100).map(|n| n * n).collect::<Vec<_>>());
    }

    #[test]
    fn no_item_is_begun_after_an_error() {
        let begun = Mutex::new(0);
        let result = for_each(0..1_000_000, |_| -> Result<()> {
            *begun.lock().unwrap() += 1;
            Err(anyhow!("failed"))
        });
        assert_eq!(result.unwrap_err().to_string(), "failed");
        let cores = thread::available_parallelism().map_or(1, usize::from);
        assert!(*begun.lock().unwrap() <= cores);
    }
}
