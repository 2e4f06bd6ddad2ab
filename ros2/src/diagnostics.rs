//! The diagnostics of one arm: counts, the last warning, and the resulting level.

use std::time::{Duration, Instant};

use armwire::ling::MotionStatus;
use armwire_host::stamps;

use crate::messages::{DiagnosticArray, DiagnosticStatus, Header, KeyValue, Time};
use crate::motion::End;
use crate::trajectory::Refusal;

/// The time for which a refusal or an abort is a warning.
const RECENT: Duration = Duration::from_secs(5);
/// Minimum time between two of them in the log.
const LOG_PERIOD: Duration = Duration::from_secs(1);

const OK: u8 = 0;
const WARN: u8 = 1;
const ERROR: u8 = 2;

/// The diagnostics of one arm.
#[derive(Debug, Default)]
pub(crate) struct Diagnostics {
    port: String,
    /// The reason why the arm is not served now.
    pub(crate) failure: Option<String>,
    /// The clock of the stamps.
    pub(crate) stamps: &'static str,
    pub(crate) status: Option<MotionStatus>,
    pub(crate) is_moving: bool,
    pub(crate) readings: u64,
    /// Readings that DDS did not accept.
    pub(crate) dropped: u64,
    /// Readings with a joint out of the protocol's range.
    pub(crate) unusable: u64,
    /// Readings more than two periods after the previous one, or received more than two periods after their stamp.
    pub(crate) late: u64,
    pub(crate) reconnects: u64,
    trajectories: Trajectories,
    /// Requests to services that could not be decoded.
    pub(crate) undecodable: u64,
    last_warning: Option<(Instant, String)>,
    logged: Option<Instant>,
    /// The last event of the adapter, for example a silent host.
    pub(crate) adapter_event: Option<String>,
}

/// Counts of trajectories. Each accepted one has one end, or is played or waits.
#[derive(Debug, Default)]
struct Trajectories {
    accepted: u64,
    refused: u64,
    /// Messages that were sent, but not received.
    lost: u64,
    finished: u64,
    replaced: u64,
    cancelled: u64,
    aborted: u64,
}

impl Diagnostics {
    /// The diagnostics of the arm on a port.
    pub(crate) fn new(port: String) -> Self {
        Self {
            port,
            ..Self::default()
        }
    }

    pub(crate) fn accept(&mut self) {
        self.trajectories.accepted += 1;
    }

    /// Counts lost messages with a trajectory.
    pub(crate) fn lose(&mut self, messages: u64) {
        self.trajectories.lost += messages;
    }

    /// Counts the end of an accepted trajectory. Returns the text to log, if it was aborted.
    pub(crate) fn end(&mut self, now: Instant, end: &End) -> Option<String> {
        match end {
            End::Finished => self.trajectories.finished += 1,
            End::Replaced => self.trajectories.replaced += 1,
            End::Cancelled => self.trajectories.cancelled += 1,
            End::Aborted(abort) => {
                self.trajectories.aborted += 1;
                return self.warn(now, format!("trajectory aborted: {abort}"));
            }
        }
        None
    }

    /// Counts a refused trajectory. Returns the text to log.
    pub(crate) fn refuse(&mut self, now: Instant, refusal: &Refusal) -> Option<String> {
        self.trajectories.refused += 1;
        self.warn(now, format!("trajectory refused: {refusal}"))
    }

    /// Keeps a warning. Returns it if it must be logged: a sender may repeat its cause at a high rate.
    fn warn(&mut self, now: Instant, warning: String) -> Option<String> {
        self.last_warning = Some((now, warning.clone()));
        let is_logged = self
            .logged
            .is_none_or(|logged| now.duration_since(logged) >= LOG_PERIOD);
        if is_logged {
            self.logged = Some(now);
        }
        is_logged.then_some(warning)
    }

    fn level(&self, now: Instant) -> (u8, String) {
        if let Some(failure) = &self.failure {
            return (ERROR, failure.clone());
        }
        match &self.last_warning {
            Some((at, warning)) if now.duration_since(*at) < RECENT => (WARN, warning.clone()),
            _ => match self.status {
                None => (WARN, "no reading".to_owned()),
                Some(MotionStatus::OverheatProtection) => (WARN, MotionStatus::OverheatProtection.to_string()),
                Some(status) => match status.is_holding() {
                    None => (WARN, status.to_string()),
                    Some(false) => (OK, "torque off".to_owned()),
                    Some(true) if self.is_moving => (OK, "moving".to_owned()),
                    Some(true) => (OK, "holding".to_owned()),
                },
            },
        }
    }

    pub(crate) fn to_message(&self, arm: &str, now: Instant) -> DiagnosticArray {
        let (level, message) = self.level(now);
        let last = self.last_warning.as_ref().map_or("", |(_, warning)| warning);
        let event = self.adapter_event.as_deref().unwrap_or_default();
        let values = [
            ("port", self.port.clone()),
            ("stamps", self.stamps.to_owned()),
            (
                "motion_status",
                self.status.map_or_else(String::new, |status| status.to_string()),
            ),
            ("readings", self.readings.to_string()),
            ("readings_late", self.late.to_string()),
            ("readings_dropped", self.dropped.to_string()),
            ("readings_unusable", self.unusable.to_string()),
            ("reconnects", self.reconnects.to_string()),
            ("trajectories_accepted", self.trajectories.accepted.to_string()),
            ("trajectories_finished", self.trajectories.finished.to_string()),
            ("trajectories_replaced", self.trajectories.replaced.to_string()),
            ("trajectories_cancelled", self.trajectories.cancelled.to_string()),
            ("trajectories_aborted", self.trajectories.aborted.to_string()),
            ("trajectories_refused", self.trajectories.refused.to_string()),
            ("trajectories_lost", self.trajectories.lost.to_string()),
            ("requests_undecodable", self.undecodable.to_string()),
            ("last_warning", last.to_owned()),
            ("last_adapter_event", event.to_owned()),
        ];
        let values = values
            .map(|(key, value)| KeyValue {
                key: key.to_owned(),
                value,
            })
            .to_vec();
        let status = DiagnosticStatus {
            level,
            name: format!("armwire: {arm}"),
            message,
            hardware_id: self.port.clone(),
            values,
        };
        let header = Header {
            stamp: Time::from_nanos(stamps::now()),
            frame_id: String::new(),
        };
        DiagnosticArray {
            header,
            status: vec![status],
        }
    }
}

#[cfg(test)]
mod tests {
    use armwire_bridge::control::{Initiator, StopInForce};

    use super::*;
    use crate::motion::Abort;

    #[test]
    fn refusal_is_a_warning_for_five_seconds() {
        let mut diagnostics = Diagnostics {
            status: Some(MotionStatus::Locked),
            ..Default::default()
        };
        let now = Instant::now();
        diagnostics.refuse(now, &Refusal::unknown("x"));
        let level = |seconds| diagnostics.level(now + Duration::from_secs(seconds)).0;
        assert_eq!([level(0), level(4), level(5)], [WARN, WARN, OK]);
    }

    #[test]
    fn repeated_refusals_are_logged_once_a_second() {
        let mut diagnostics = Diagnostics::default();
        let now = Instant::now();
        let refuse = |ms| diagnostics.refuse(now + Duration::from_millis(ms), &Refusal::NoArm);
        let logged: Vec<_> = (0..3_000).filter_map(refuse).collect();
        assert_eq!(logged, ["trajectory refused: the arm does not answer"; 3]);
    }

    #[test]
    fn each_end_of_a_trajectory_is_counted() {
        let mut diagnostics = Diagnostics::default();
        let now = Instant::now();
        let ends = [
            End::Finished,
            End::Replaced,
            End::Cancelled,
            End::Aborted(Abort::Stopped(Some(StopInForce {
                by: Initiator::Usb,
                left_ms: 1_200,
            }))),
        ];
        let logged = ends.map(|end| diagnostics.end(now, &end));
        let stopped = "stopped by a host on USB";
        assert_eq!(
            logged,
            [
                None,
                None,
                None,
                Some(format!(
                    "trajectory aborted: the adapter stopped the arm, motion is refused for 1.2 s more: {stopped}"
                ))
            ]
        );
        let message = diagnostics.to_message("arm", now);
        for end in ["finished", "replaced", "cancelled", "aborted"] {
            let key = format!("trajectories_{end}");
            let value = message.status[0].values.iter().find(|value| value.key == key);
            assert_eq!(value.map(|value| &*value.value), Some("1"), "{key}");
        }
    }

    #[test]
    fn overheating_is_a_warning() {
        let level = |status| {
            let status = Some(status);
            let diagnostics = Diagnostics {
                status,
                ..Default::default()
            };
            diagnostics.level(Instant::now())
        };
        assert_eq!(level(MotionStatus::Overheating).0, WARN);
        assert_eq!(level(MotionStatus::OverheatProtection).0, WARN);
        assert_eq!(level(MotionStatus::Idle), (OK, "torque off".to_owned()));
        assert_eq!(level(MotionStatus::Locked), (OK, "holding".to_owned()));
    }

    #[test]
    fn holding_needs_a_reading_that_shows_it() {
        let level = |status| {
            let diagnostics = Diagnostics {
                status,
                ..Default::default()
            };
            diagnostics.level(Instant::now())
        };
        assert_eq!(level(None), (WARN, "no reading".to_owned()));
        assert_eq!(
            level(Some(MotionStatus::Other(0x42))),
            (WARN, "unknown status 0x42".to_owned())
        );
    }

    #[test]
    fn absent_arm_is_an_error() {
        let failure = Some("no such port".to_owned());
        let diagnostics = Diagnostics {
            failure,
            ..Default::default()
        };
        assert_eq!(diagnostics.level(Instant::now()), (ERROR, "no such port".to_owned()));
    }
}
