//! The fault campaign: the image under full load, one injected fault, sometimes two, and the check of the invariants.
//!
//! A case is derived from a seed and a number, and is the same in every run: fault, moment and details. It runs on the
//! board of the earlier cases of its [round](ROUND): the translation of the firmware for a new board takes several
//! times as long as a case.

mod cable;
mod inject;
mod invariants;
mod matrix;
mod mutations;
mod result;
mod rig;
mod table;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use armwire_virtual_board::{Nanos, VirtualBoard};
use strum::VariantArray;

use self::cable::Cable;
pub use self::invariants::Losses;
pub use self::matrix::{Fault, Moment};
pub use self::mutations::Mutation;
pub use self::result::Result;
use self::rig::Rig;
pub use self::table::table;
use crate::random::Random;

/// Duration of the load without faults after the recovery.
const CLEAN: Nanos = Nanos::from_millis(30);

/// Number of cases on one [`Bench`], from each whole multiple of this number: every fault in one moment.
pub const ROUND: u32 = Fault::VARIANTS.len() as u32;

/// A run of the campaign.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Case {
    /// The seed of the campaign.
    pub seed: u64,
    /// The number in the campaign, from 0.
    pub number: u32,
    /// The fault.
    pub fault: Fault,
    /// The moment of the fault.
    pub moment: Moment,
    /// A second fault, shortly after the first.
    pub second: Option<Fault>,
}

/// The result of a run.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The run.
    pub case: Case,
    /// The time from the end of the fault until all traffic was back, and the counted losses by name. The error lists
    /// all violated invariants.
    pub result: Result<(Nanos, Losses), String>,
}

impl Case {
    /// The run with this number in the campaign with this seed. Each fault meets each moment, in turn.
    pub fn new(seed: u64, number: u32) -> Self {
        let fault = Fault::VARIANTS[(number % ROUND) as usize];
        let moment = Moment::VARIANTS[(number / ROUND) as usize % Moment::VARIANTS.len()];
        let mut random = Random::new(!seed, number);
        let brief: Vec<Fault> = Fault::VARIANTS
            .iter()
            .copied()
            .filter(|fault| fault.is_brief())
            .collect();
        let second = (fault.restart().is_none() && random.between(0, 3) == 0).then(|| random.one_of(&brief));
        Self {
            seed,
            number,
            fault,
            moment,
            second,
        }
    }
}

/// A board for consecutive cases.
///
/// The first case, and each case after a failure or a restart of the board, has a new board. Each case has its own arm
/// and hosts.
#[derive(Debug, Default)]
pub struct Bench(Option<VirtualBoard<Cable>>);

impl Bench {
    /// Runs a case.
    pub fn run(&mut self, case: Case) -> Outcome {
        self.run_mutated(case, None)
    }

    /// Runs a case with a mutation that its invariants must detect.
    pub fn run_mutated(&mut self, case: Case, mutation: Option<Mutation>) -> Outcome {
        let attempt = catch_unwind(AssertUnwindSafe(|| {
            self.attempt(case, mutation).map_err(|error| error.to_string())
        }));
        let result = attempt.unwrap_or_else(|panic| {
            let message = panic.downcast_ref::<String>().cloned();
            let message = message.or_else(|| panic.downcast_ref::<&str>().map(|message| (*message).to_owned()));
            Err(message.unwrap_or_else(|| "a panic".to_owned()))
        });
        Outcome { case, result }
    }

    fn attempt(&mut self, case: Case, mutation: Option<Mutation>) -> Result<(Nanos, Losses)> {
        let mut rig = Rig::start(self.0.take(), Random::new(case.seed, case.number))?;
        rig.reach(case.moment)?;
        let mut over = rig.inject(case.fault)?;
        let mut limit = case.fault.limit();
        if let Some(second) = case.second {
            rig.work_between(0, 5_000)?;
            over = rig.inject(second)?;
            limit = Nanos(limit.0.max(second.limit().0));
        }
        if let Some(mutation) = mutation {
            rig.mutate(mutation)?;
            over = rig.board.now();
        }
        let recovery = rig.recover(over, limit)?;
        let restarts = case.fault.restart().is_some();
        if restarts {
            rig.restart_accounting()?;
        }
        rig.work(CLEAN)?;
        rig.finish()?;
        let faults: Vec<Fault> = [case.fault].into_iter().chain(case.second).collect();
        let losses = rig.check(&faults)?;
        self.0 = Some(rig.board).filter(|_| !restarts);
        Ok((recovery, losses))
    }
}

/// Runs the cases with these numbers, in ascending order, and calls `done` after each. Rounds run in parallel, one per
/// processor.
pub fn run(seed: u64, numbers: &[u32], done: impl Fn(&Outcome) + Sync) -> Vec<Outcome> {
    let rounds: Vec<&[u32]> = numbers.chunk_by(|a, b| a / ROUND == b / ROUND).collect();
    let next = AtomicUsize::new(0);
    let outcomes = Mutex::new(Vec::new());
    let workers = thread::available_parallelism().map_or(1, |count| count.get());
    thread::scope(|scope| {
        for _ in 0..workers {
            scope.spawn(|| {
                while let Some(&round) = rounds.get(next.fetch_add(1, Ordering::Relaxed)) {
                    run_round(seed, round, |outcome| {
                        done(&outcome);
                        outcomes.lock().unwrap().push(outcome);
                    });
                }
            });
        }
    });
    let mut outcomes = outcomes.into_inner().unwrap();
    outcomes.sort_by_key(|outcome| outcome.case.number);
    outcomes
}

/// Runs cases of one round, after the earlier cases of the round, which are not reported.
fn run_round(seed: u64, numbers: &[u32], mut done: impl FnMut(Outcome)) {
    let (Some(first), Some(&last)) = (numbers.first(), numbers.last()) else {
        return;
    };
    let mut bench = Bench::default();
    for number in first / ROUND * ROUND..=last {
        let outcome = bench.run(Case::new(seed, number));
        if numbers.contains(&number) {
            done(outcome);
        }
    }
}
