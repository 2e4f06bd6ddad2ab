//! The fault campaign: the image with everybody at work, one thing that goes wrong, sometimes two, and the books of what
//! must be true all the same.
//!
//! A case is made of a seed and a number, and is the same in every run: which fault, in which moment, and how exactly. It
//! runs on the board on which those before it in its [round](ROUND) ran: to translate the firmware for a new one takes
//! several times as long as a case.

mod cable;
mod inject;
mod invariants;
mod matrix;
mod mutations;
mod rig;
mod table;

use std::error::Error;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use armwire_virtual_board::{Nanos, VirtualBoard};

pub use self::cable::{Cable, Damage, Way};
pub use self::invariants::Losses;
pub use self::matrix::{Fault, Moment};
pub use self::mutations::Mutation;
use self::rig::Rig;
pub use self::table::Table;
use crate::random::Random;

/// What a part of a run gives: an error says what was not as it must be.
pub type Result<T = (), E = Box<dyn Error>> = std::result::Result<T, E>;

/// How long everybody works after all that went wrong, with nothing more to be lost.
const CLEAN: Nanos = Nanos::from_millis(30);

/// How many cases are run on one [`Bench`], from each whole multiple of this number on: every fault in one moment.
pub const ROUND: u32 = Fault::ALL.len() as u32;

/// A run of the campaign.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Case {
    /// Of the campaign.
    pub seed: u64,
    /// Its number in the campaign, from 0.
    pub number: u32,
    /// What goes wrong.
    pub fault: Fault,
    /// When.
    pub moment: Moment,
    /// What goes wrong shortly after.
    pub second: Option<Fault>,
}

/// What a run has shown.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Which run.
    pub case: Case,
    /// How long it took from the end of the fault until all traffic was back, and what was counted as lost, by name; or all
    /// that was not as it must be.
    pub result: Result<(Nanos, Losses), String>,
}

impl Case {
    /// The run of this number of the campaign with this seed. Each fault meets each moment, in turn.
    pub fn new(seed: u64, number: u32) -> Self {
        let fault = Fault::ALL[(number % ROUND) as usize];
        let moment = Moment::ALL[(number / ROUND) as usize % Moment::ALL.len()];
        let mut random = Random::new(!seed, number);
        let brief: Vec<Fault> = Fault::ALL.into_iter().filter(|fault| fault.is_brief()).collect();
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

/// A board on which one case runs after the other.
///
/// There is a new one for the first, and after one that failed or had the part start over. Each case has its own arm and
/// its own hosts.
#[derive(Debug, Default)]
pub struct Bench(Option<VirtualBoard<Cable>>);

impl Bench {
    /// Runs a case.
    pub fn run(&mut self, case: Case) -> Outcome {
        self.run_mutated(case, None)
    }

    /// Runs a case, with more wrong in it than it says.
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
            // The counters began anew with the part.
            rig.finish()?;
            rig.reset_accounting();
            rig.resume()?;
        }
        rig.work(CLEAN)?;
        rig.finish()?;
        let faults: Vec<Fault> = [case.fault].into_iter().chain(case.second).collect();
        let losses = rig.check(&faults)?;
        self.0 = Some(rig.board).filter(|_| !restarts);
        Ok((recovery, losses))
    }
}

/// Runs the cases of these numbers, which ascend, as many rounds at once as there are processors, and calls `done` after
/// each.
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

/// Runs cases of one round, and before them those that they come after: nobody wants to know of these.
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
