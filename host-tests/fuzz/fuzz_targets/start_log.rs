//! The record of starts counts every reset, and a damaged one is that of a first start. Three crashed starts in a row
//! lead to recovery with the kind of arm and the timeout last in force; after a start that is no crash, the next is a
//! usual one.
#![no_main]

use armwire_bridge::config::{ArmKind, Config, HostTimeout};
use armwire_bridge::start::{Cause, MAX_CRASHED_STARTS, STEADY_AFTER, StartLog};
use armwire_bridge::{Instant, Start};
use armwire_fuzz::{Result, Unstructured, any_good_config};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| {
    // A short input is skipped.
    let _ = check(&mut Unstructured::new(input));
});

const CAUSES: [Cause; 5] = [
    Cause::PowerOn,
    Cause::Watchdog,
    Cause::Panic,
    Cause::HardFault,
    Cause::Other,
];

/// The expected contents of the record.
#[derive(Default)]
struct Model {
    /// The resets by the watchdog, by panics and by hard faults, and the starts in recovery.
    counts: [u32; 4],
    crashed: u8,
    crashed_in_load: bool,
    kept: Option<(ArmKind, HostTimeout)>,
}

/// The phase that a run has reached.
#[derive(Clone, Copy, PartialEq)]
enum Run {
    Starting,
    Loading,
    Running,
    Steady,
}

impl Model {
    fn reset(&mut self, cause: Cause, run: Run) {
        let nth = match cause {
            Cause::PowerOn => {
                *self = Self::default();
                return;
            }
            Cause::Other => None,
            Cause::Watchdog => Some(0),
            Cause::Panic => Some(1),
            Cause::HardFault => Some(2),
        };
        nth.into_iter().for_each(|nth: usize| self.counts[nth] += 1);
        if nth.is_some() && run != Run::Steady {
            self.crashed = self.crashed.saturating_add(1);
            self.crashed_in_load |= run == Run::Loading;
        } else {
            (self.crashed, self.crashed_in_load) = (0, false);
        }
        if self.is_recovery() {
            self.counts[3] += 1;
        }
        if self.crashed >= 2 * MAX_CRASHED_STARTS {
            self.kept = None;
        }
    }

    const fn is_recovery(&self) -> bool {
        self.crashed >= MAX_CRASHED_STARTS
    }
}

fn check(u: &mut Unstructured<'_>) -> Result<()> {
    let mut model = Model::default();
    // The contents of memory after power-on are arbitrary.
    let mut log = StartLog::begin(u.arbitrary()?, Cause::PowerOn);
    while !u.is_empty() {
        let mut run = match (model.is_recovery(), u.arbitrary()?) {
            (true, _) => Run::Running,
            (false, true) => Run::Loading,
            (false, false) => Run::Starting,
        };
        // The words in memory.
        let mut words = log.to_words();
        // In recovery it has no effect.
        if run != Run::Starting {
            words = log.loading();
        }
        for _ in 0..u.int_in_range(0..=2)? {
            let (uptime, config) = (Instant::from_millis(u.arbitrary::<u16>()?.into()), any_good_config(u)?);
            words = log.running(uptime, &config).unwrap_or(words);
            assert_eq!(log.running(uptime, &config), None, "nothing has changed");
            if run != Run::Steady {
                let is_steady = uptime >= Instant::ZERO + STEADY_AFTER;
                run = if is_steady { Run::Steady } else { Run::Running };
            }
            model.kept = Some((config.arm, config.host_timeout));
        }
        let cause = *u.choose(&CAUSES)?;
        if u.ratio(1, 8)? {
            // One damaged word.
            let (nth, bits) = (u.choose_index(StartLog::WORDS)?, u.int_in_range(1..=u32::MAX)?);
            words[nth] ^= bits;
            (model, run) = (Model::default(), Run::Steady);
        }
        log = StartLog::begin(words, cause);
        model.reset(cause, run);

        let [watchdog_resets, panics, hard_faults, recovery_starts] = model.counts;
        let recovery = log.recovery();
        assert_eq!(
            recovery.map(|recovery| recovery.crashed_in_load),
            model.is_recovery().then_some(model.crashed_in_load)
        );
        let start = Start {
            panics,
            watchdog_resets,
            hard_faults,
            recovery_starts,
            was_armed: true,
            config_lost: false,
            recovery,
        };
        assert_eq!(log.start(true, false), start);
        let (arm, host_timeout) = model.kept.unwrap_or_default();
        let config = Config {
            arm,
            host_timeout,
            ..Config::default()
        };
        assert_eq!(log.config(), config);
    }
    Ok(())
}
