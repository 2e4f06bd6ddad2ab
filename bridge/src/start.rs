//! The record of starts: it detects a crash loop, which ends in a start with factory settings.
//!
//! The record lies in memory that survives a reset. Firmware only stores its words. A checksum distinguishes it from
//! the contents after power-on.
//!
//! A run that ends in a panic, a hard fault or a watchdog reset within [`STEADY_AFTER`] is a crashed start. After
//! [`MAX_CRASHED_STARTS`] of them in a row the adapter starts in recovery: the configuration in flash is neither read
//! nor written, and the CAN controller stays off. The kind of arm and the timeout of hosts are those that were last in
//! force, so that torque-off still goes out at the arm's rate.

use armwire::time::{Duration, Instant};

use crc::{CRC_32_ISO_HDLC, Crc};

use crate::config::{ArmKind, Config, HostTimeout};

/// Number of crashed starts in a row after which the adapter starts in recovery. After twice as many the last settings
/// in force may be the cause, and are dropped.
pub const MAX_CRASHED_STARTS: u8 = 3;

/// A run that lasts as long is no crashed start.
pub const STEADY_AFTER: Duration = Duration::from_millis(10_000);

/// The cause of a reset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// The supply was switched on, or was too low.
    PowerOn,
    /// The watchdog.
    Watchdog,
    /// The handler of panics.
    Panic,
    /// The handler of hard faults.
    HardFault,
    /// A request, the reset pin or a debugger.
    Other,
}

/// A start in recovery.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Recovery {
    /// A crash interrupted the read of the configuration in flash: it must not be read again.
    pub crashed_in_load: bool,
}

/// Facts about the adapter's previous run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Start {
    /// Panics of the firmware since power-on.
    pub panics: u32,
    /// Resets by the watchdog since power-on.
    pub watchdog_resets: u32,
    /// Hard faults of the firmware since power-on.
    pub hard_faults: u32,
    /// The adapter stopped while it was [armed](crate::Status::is_armed): torque-off goes out first, even if the configuration
    /// that enabled it was not saved.
    pub was_armed: bool,
    /// The saved configuration could not be read.
    pub config_lost: bool,
    /// Starts in recovery since power-on.
    pub recovery_starts: u32,
    /// The adapter starts in recovery: `config` is not the one in flash, and the CAN controller stays off.
    pub recovery: Option<Recovery>,
}

/// The progress of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Stage {
    /// The run has lasted [`STEADY_AFTER`], or there was none.
    #[default]
    Steady,
    /// The configuration is being read from flash.
    Loading,
    /// The configuration is in force.
    Running,
    /// The chip is being set up.
    Starting,
}

/// The record of starts since power-on.
///
/// ```
/// use armwire_bridge::Instant;
/// use armwire_bridge::config::Config;
/// use armwire_bridge::start::{Cause, StartLog};
///
/// let mut log = StartLog::begin([0; StartLog::WORDS], Cause::PowerOn);
/// for _ in 0..3 {
///     assert_eq!(log.recovery(), None);
///     log.running(Instant::from_millis(9_000), &Config::default());
///     log = StartLog::begin(log.to_words(), Cause::Panic);
/// }
/// assert!(log.recovery().is_some());
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StartLog {
    panics: u32,
    watchdog_resets: u32,
    hard_faults: u32,
    recovery_starts: u32,
    /// Crashed starts in a row before this start.
    crashed: u8,
    /// One of them crashed in [`Stage::Loading`].
    crashed_in_load: bool,
    stage: Stage,
    /// The settings last in force.
    kept: Option<(ArmKind, HostTimeout)>,
}

impl StartLog {
    /// Length of the record.
    pub const WORDS: usize = 7;

    /// Begins a start after a reset. `words` are those of the record before the reset. Without a valid record this is
    /// the first start.
    #[must_use]
    pub fn begin(words: [u32; Self::WORDS], cause: Cause) -> Self {
        let mut log = Self::from_words(words)
            .filter(|_| cause != Cause::PowerOn)
            .unwrap_or_default();
        let counter = match cause {
            Cause::Watchdog => Some(&mut log.watchdog_resets),
            Cause::Panic => Some(&mut log.panics),
            Cause::HardFault => Some(&mut log.hard_faults),
            Cause::PowerOn | Cause::Other => None,
        };
        let is_crashed = counter.is_some() && log.stage != Stage::Steady;
        if let Some(counter) = counter {
            *counter = counter.wrapping_add(1);
        }
        log.crashed = if is_crashed { log.crashed.saturating_add(1) } else { 0 };
        log.crashed_in_load = is_crashed && (log.crashed_in_load || log.stage == Stage::Loading);
        log.stage = Stage::Starting;
        if log.crashed >= MAX_CRASHED_STARTS {
            log.recovery_starts = log.recovery_starts.wrapping_add(1);
            log.stage = Stage::Running;
        }
        if log.crashed >= 2 * MAX_CRASHED_STARTS {
            log.kept = None;
        }
        log
    }

    /// `Some` if this start must not read the configuration in flash, and uses [`config`](Self::config) instead.
    pub fn recovery(&self) -> Option<Recovery> {
        (self.crashed >= MAX_CRASHED_STARTS).then_some(Recovery {
            crashed_in_load: self.crashed_in_load,
        })
    }

    /// The configuration of a start in recovery.
    pub fn config(&self) -> Config {
        let (arm, host_timeout) = self.kept.unwrap_or_default();
        Config {
            arm,
            host_timeout,
            ..Config::default()
        }
    }

    /// The facts for [`Bridge::new`](crate::Bridge::new). `was_armed` and `config_lost` are those of [`Start`].
    pub fn start(&self, was_armed: bool, config_lost: bool) -> Start {
        Start {
            panics: self.panics,
            watchdog_resets: self.watchdog_resets,
            hard_faults: self.hard_faults,
            recovery_starts: self.recovery_starts,
            was_armed,
            config_lost,
            recovery: self.recovery(),
        }
    }

    /// Records that the configuration in flash is about to be read. Returns the record's words, to be stored before that
    /// read. In recovery the record is unchanged.
    #[must_use = "the record is to be stored"]
    pub fn loading(&mut self) -> [u32; Self::WORDS] {
        if self.stage == Stage::Starting {
            self.stage = Stage::Loading;
        }
        self.to_words()
    }

    /// Records that this configuration is in force `uptime` after the start. Call it as soon as the configuration is
    /// known, and at least every second. Returns the words to store, if they have changed.
    #[must_use = "the record is to be stored"]
    pub fn running(&mut self, uptime: Instant, config: &Config) -> Option<[u32; Self::WORDS]> {
        let before = *self;
        self.stage = match self.stage {
            Stage::Steady => Stage::Steady,
            _ if uptime.since(Instant::ZERO) >= STEADY_AFTER => Stage::Steady,
            _ => Stage::Running,
        };
        self.kept = Some((config.arm, config.host_timeout));
        (*self != before).then(|| self.to_words())
    }

    /// The words of the record.
    pub fn to_words(&self) -> [u32; Self::WORDS] {
        let state = [self.crashed, self.crashed_in_load.into(), self.stage as u8, 0];
        let kept = self.kept.map_or([0; 4], |(arm, timeout)| {
            let [low, high] = timeout.after_ms.to_le_bytes();
            [KEPT | arm as u8, timeout.torque_off.into(), low, high]
        });
        let words = [
            self.panics,
            self.watchdog_resets,
            self.hard_faults,
            self.recovery_starts,
            u32::from_le_bytes(state),
            u32::from_le_bytes(kept),
        ];
        let [a, b, c, d, e, f] = words;
        [a, b, c, d, e, f, crc(&words)]
    }

    /// `None` if they are no record.
    fn from_words(words: [u32; Self::WORDS]) -> Option<Self> {
        let [
            panics,
            watchdog_resets,
            hard_faults,
            recovery_starts,
            state,
            kept,
            check,
        ] = words;
        if check != crc(&[panics, watchdog_resets, hard_faults, recovery_starts, state, kept]) {
            return None;
        }
        let [crashed, crashed_in_load, stage, _] = state.to_le_bytes();
        let [arm, torque_off, low, high] = kept.to_le_bytes();
        let arm = ArmKind::ALL.into_iter().find(|kind| KEPT | *kind as u8 == arm);
        let host_timeout = HostTimeout {
            after_ms: u16::from_le_bytes([low, high]),
            torque_off: torque_off != 0,
        };
        Some(Self {
            panics,
            watchdog_resets,
            hard_faults,
            recovery_starts,
            crashed,
            crashed_in_load: crashed_in_load != 0,
            stage: [Stage::Loading, Stage::Running, Stage::Starting]
                .into_iter()
                .find(|other| *other as u8 == stage)
                .unwrap_or_default(),
            kept: arm.map(|arm| (arm, host_timeout)),
        })
    }
}

/// The mark of kept settings, in the byte of the kind of arm.
const KEPT: u8 = 0x80;

static CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// The checksum of the words' little-endian bytes. Bit by bit it would delay the arm's bytes for 30 µs.
fn crc(words: &[u32]) -> u32 {
    let mut digest = CRC.digest();
    for word in words {
        digest.update(&word.to_le_bytes());
    }
    digest.finalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    const CRASHES: [Cause; 3] = [Cause::Watchdog, Cause::Panic, Cause::HardFault];

    fn torque_off(arm: ArmKind) -> Config {
        Config {
            arm,
            host_timeout: HostTimeout {
                after_ms: 321,
                torque_off: true,
            },
            ..Config::default()
        }
    }

    fn power_on() -> StartLog {
        StartLog::begin([0; StartLog::WORDS], Cause::PowerOn)
    }

    /// The next start, after a run of this many milliseconds. `None` crashes in the load.
    fn next(mut log: StartLog, run_ms: Option<u64>, cause: Cause) -> StartLog {
        let mut words = log.loading();
        for run_ms in run_ms.into_iter().flat_map(|run_ms| [0, run_ms]) {
            let changed = log.running(Instant::from_millis(run_ms), &torque_off(ArmKind::Alpha1));
            words = changed.unwrap_or(words);
        }
        StartLog::begin(words, cause)
    }

    #[test]
    fn third_crashed_start_leads_to_recovery() {
        let mut log = power_on();
        for cause in CRASHES {
            assert_eq!(log.recovery(), None);
            log = next(log, Some(9_999), cause);
        }
        let crashed_in_load = false;
        assert_eq!(log.recovery(), Some(Recovery { crashed_in_load }));
        let start = log.start(true, false);
        assert_eq!(
            (
                start.panics,
                start.watchdog_resets,
                start.hard_faults,
                start.recovery_starts
            ),
            (1, 1, 1, 1)
        );
        assert_eq!((start.was_armed, start.recovery), (true, log.recovery()));
    }

    #[test]
    fn ten_seconds_of_run_reset_count() {
        let mut log = power_on();
        for run_ms in [9_999, 9_999, 10_000, 9_999, 9_999, 60_000].repeat(3) {
            log = next(log, Some(run_ms), Cause::Panic);
            assert_eq!(log.recovery(), None);
        }
        assert_eq!(log.start(false, false).panics, 18);
    }

    #[test]
    fn power_on_and_requested_restarts_reset_count() {
        for cause in [Cause::PowerOn, Cause::Other] {
            let mut log = power_on();
            for cause in [Cause::Panic, Cause::Panic, cause, Cause::Panic, Cause::Panic] {
                log = next(log, None, cause);
                assert_eq!(log.recovery(), None);
            }
            let counted = if cause == Cause::PowerOn { 2 } else { 4 };
            assert_eq!(log.start(false, false).panics, counted);
        }
    }

    #[test]
    fn crash_in_load_forbids_reads_of_store() {
        for place in 0..3 {
            let mut log = power_on();
            for nth in 0..3 {
                log = next(log, (nth != place).then_some(5), Cause::HardFault);
            }
            let crashed_in_load = true;
            assert_eq!(log.recovery(), Some(Recovery { crashed_in_load }));
            // A crash of recovery itself changes nothing.
            log = next(log, Some(5), Cause::HardFault);
            assert_eq!(log.recovery(), Some(Recovery { crashed_in_load }));
        }
    }

    #[test]
    fn crash_before_load_leaves_store_readable() {
        let mut log = power_on();
        for _ in 0..4 {
            log = StartLog::begin(log.to_words(), Cause::HardFault);
        }
        let crashed_in_load = false;
        assert_eq!(log.recovery(), Some(Recovery { crashed_in_load }));
    }

    #[test]
    fn recovery_keeps_arm_and_host_timeout() {
        for arm in ArmKind::ALL {
            let mut log = power_on();
            let mut words = log.running(Instant::from_millis(20_000), &torque_off(arm)).unwrap();
            for _ in 0..4 {
                log = StartLog::begin(words, Cause::Watchdog);
                words = log.to_words();
            }
            assert!(log.recovery().is_some());
            assert_eq!(log.config(), torque_off(arm));
            assert_eq!(log.config().check(), Ok(()));
        }
    }

    #[test]
    fn recovery_without_kept_settings_is_factory() {
        let mut log = power_on();
        for _ in 0..3 {
            log = next(log, None, Cause::Panic);
        }
        assert_eq!(log.config(), Config::default());
    }

    #[test]
    fn settings_that_crash_recovery_are_dropped() {
        let mut log = power_on();
        for crashed in 1..=6 {
            log = next(log, Some(5), Cause::Panic);
            let kept = if crashed < 6 {
                torque_off(ArmKind::Alpha1)
            } else {
                Config::default()
            };
            assert_eq!(log.config(), kept, "{crashed}");
        }
        assert!(log.recovery().is_some());
    }

    #[test]
    fn recovery_that_runs_ends_with_next_reset() {
        for cause in [Cause::Panic, Cause::Other, Cause::PowerOn] {
            let mut log = power_on();
            for _ in 0..3 {
                log = next(log, None, Cause::Panic);
            }
            assert!(log.recovery().is_some());
            assert_eq!(next(log, Some(10_000), cause).recovery(), None, "{cause:?}");
        }
    }

    #[test]
    fn any_flipped_bit_makes_first_start() {
        let mut log = power_on();
        for _ in 0..3 {
            log = next(log, Some(7), Cause::Panic);
        }
        let words = log.to_words();
        assert!(StartLog::begin(words, Cause::Panic).recovery().is_some());
        for bit in 0..32 * StartLog::WORDS {
            let mut flipped = words;
            flipped[bit / 32] ^= 1 << (bit % 32);
            let log = StartLog::begin(flipped, Cause::Panic);
            assert_eq!((log.recovery(), log.config()), (None, Config::default()), "{bit}");
            assert_eq!(log.start(false, false).panics, 1);
        }
        for fill in [0, u32::MAX, 0xA5A5_A5A5] {
            assert_eq!(StartLog::from_words([fill; StartLog::WORDS]), None);
        }
    }

    #[test]
    fn record_is_stored_when_it_changes() {
        let mut log = power_on();
        let config = Config::default();
        let mut is_stored = |ms, config: Config| match log.running(Instant::from_millis(ms), &config) {
            Some(words) => {
                assert_eq!(words, log.to_words());
                true
            }
            None => false,
        };
        assert!(is_stored(0, config));
        assert!(!is_stored(9_999, config));
        assert!(is_stored(9_999, torque_off(ArmKind::Raw)));
        assert!(is_stored(10_000, torque_off(ArmKind::Raw)));
        assert!(!is_stored(20_000, torque_off(ArmKind::Raw)));
    }

    #[test]
    fn checksum_is_the_standard_one() {
        // The check value of "12345678".
        assert_eq!(crc(&[0x3433_3231, 0x3837_3635]), 0x9AE0_DAAF);
    }
}
