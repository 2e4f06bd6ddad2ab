//! Steps of a long command: each prints its name before and its time after, and the first failure ends the command.

use std::time::{Duration, Instant};

use anyhow::{Context, Result};

/// Steps done so far.
#[derive(Default)]
pub(crate) struct Steps {
    done: u32,
    time: Duration,
}

impl Steps {
    /// Does one step.
    ///
    /// # Errors
    ///
    /// The step's error, with its name.
    pub(crate) fn step<T>(&mut self, name: &str, step: impl FnOnce() -> Result<T>) -> Result<T> {
        println!("\n== {name}");
        let start = Instant::now();
        let result = step();
        let time = start.elapsed();
        self.done += 1;
        self.time += time;
        let end = if result.is_ok() { "passed in" } else { "FAILED after" };
        println!("== {name}: {end} {time:.1?}");
        result.with_context(|| format!("step \"{name}\""))
    }

    /// Prints how many steps there were and how long they took.
    pub(crate) fn finish(self) {
        println!("\nall {} steps passed in {:.0?}", self.done, self.time);
    }
}
