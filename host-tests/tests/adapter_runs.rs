//! Random runs of the adapter: in each, everything holds that `docs/safety.md` promises.
//!
//! The runs are drawn from a seed and are the same each time. `ARMWIRE_RUNS` sets their number. `ARMWIRE_RUN=1234`
//! executes only the run with this number, and prints its events.

use std::collections::BTreeMap;
use std::panic::catch_unwind;
use std::{env, thread};

use armwire_host_tests::adapter::{self, Conditions};
use armwire_host_tests::random::Random;

const SEED: u64 = 1;

/// Number of runs without `ARMWIRE_RUNS`.
const RUNS: u32 = 1_000;

fn number(name: &str) -> Option<u32> {
    env::var(name)
        .ok()
        .map(|n| n.parse().unwrap_or_else(|_| panic!("{name} is a number")))
}

/// Executes a run. The error is the number of a run that fails.
fn run(number: u32) -> Result<Conditions, u32> {
    catch_unwind(|| adapter::run(Random::new(SEED, number))).map_err(|_| {
        eprintln!("run {number} of seed {SEED} fails: ARMWIRE_RUN={number} executes it alone");
        number
    })
}

/// Executes all runs, on all cores.
fn run_all(runs: u32) -> Vec<Result<Conditions, u32>> {
    let cores = thread::available_parallelism().map_or(1, |count| count.get());
    thread::scope(|scope| {
        let worker = |first: u32| scope.spawn(move || (first..runs).step_by(cores).map(run).collect::<Vec<_>>());
        let workers: Vec<_> = (0..cores as u32).map(worker).collect();
        let results = workers.into_iter().flat_map(|worker| worker.join().unwrap());
        results.collect()
    })
}

#[test]
fn every_promise_holds_in_random_runs() {
    if let Some(number) = number("ARMWIRE_RUN") {
        println!("{:?}", adapter::run_and_print(Random::new(SEED, number)));
        return;
    }
    let runs = number("ARMWIRE_RUNS").unwrap_or(RUNS);
    let results = run_all(runs);
    let mut often = BTreeMap::new();
    for (name, met) in results.iter().flatten().copied().flatten() {
        *often.entry(name).or_insert(0) += u32::from(met);
    }
    println!("{runs} runs, and the number of them with each condition:");
    for (name, count) in &often {
        println!("{count:6} {name}");
    }
    let failed: Vec<u32> = results.into_iter().filter_map(Result::err).collect();
    assert!(failed.is_empty(), "runs {failed:?} of {runs} fail");
    for (name, count) in often {
        assert!(count * 20 >= runs, "{name} in {count} of {runs} runs only");
    }
}

#[test]
fn run_is_the_same_each_time() {
    for number in 0..20 {
        let [first, second] = [0; 2].map(|_| adapter::run(Random::new(SEED, number)));
        assert_eq!(first, second);
    }
}
