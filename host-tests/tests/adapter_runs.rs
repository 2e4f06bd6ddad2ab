//! Random runs of the adapter: in each, everything holds that `docs/safety.md` promises.
//!
//! The runs are drawn from a seed and are the same each time. `ARMWIRE_RUNS` sets their number. `ARMWIRE_RUN=1234`
//! executes only the run with this number, and prints its events.

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, Ordering};
use std::{env, thread};

use armwire_host_tests::adapter::{self, Circumstances};
use armwire_host_tests::random::Random;

const SEED: u64 = 1;

/// Number of runs without `ARMWIRE_RUNS`.
const RUNS: u32 = 1_000;

fn number(name: &str) -> Option<u32> {
    env::var(name)
        .ok()
        .map(|n| n.parse().unwrap_or_else(|_| panic!("{name} is a number")))
}

/// The runs that fail, and what happened in the others.
fn make(runs: u32) -> (Vec<u32>, Vec<Circumstances>) {
    let next = AtomicU32::new(0);
    let (failed, seen) = (Mutex::new(Vec::new()), Mutex::new(Vec::new()));
    let workers = thread::available_parallelism().map_or(1, |count| count.get());
    thread::scope(|scope| {
        for _ in 0..workers {
            scope.spawn(|| {
                loop {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    if number >= runs {
                        return;
                    }
                    match catch_unwind(AssertUnwindSafe(|| adapter::run(Random::new(SEED, number)))) {
                        Ok(circumstances) => seen.lock().unwrap().push(circumstances),
                        Err(_) => {
                            eprintln!("run {number} of seed {SEED} fails: ARMWIRE_RUN={number} makes it alone");
                            failed.lock().unwrap().push(number);
                        }
                    }
                }
            });
        }
    });
    (failed.into_inner().unwrap(), seen.into_inner().unwrap())
}

#[test]
fn every_promise_holds_in_random_runs() {
    if let Some(number) = number("ARMWIRE_RUN") {
        println!("{:?}", adapter::run_and_print(Random::new(SEED, number)));
        return;
    }
    let runs = number("ARMWIRE_RUNS").unwrap_or(RUNS);
    let (failed, seen) = make(runs);
    let mut often = BTreeMap::new();
    for (name, happened) in seen.iter().flat_map(Circumstances::often) {
        *often.entry(name).or_insert(0) += u32::from(happened);
    }
    println!("{runs} runs, of which so many had:");
    for (name, count) in &often {
        println!("{count:6} {name}");
    }
    assert!(
        failed.is_empty(),
        "{} of {runs} runs fail, the first is {:?}",
        failed.len(),
        failed.iter().min()
    );
    for (name, count) in often {
        assert!(count * 20 >= runs, "{name} in {count} of {runs} runs only");
    }
}

#[test]
fn a_run_is_the_same_each_time() {
    for number in 0..20 {
        let [first, second] = [0; 2].map(|_| adapter::run(Random::new(SEED, number)));
        assert_eq!(first, second);
    }
}
