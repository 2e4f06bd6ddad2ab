//! The force-feedback leader: its control mode, and its force feedback.
//!
//! The vendor's candidate document of September 2026 describes the messages, not the arm. This model assumes:
//!
//! * The arm starts in position mode, with its torque off, and has motors: it moves in position mode with torque on.
//! * A mode is applied a time after the arm has accepted it, which the document only says to be later. A request
//!   meanwhile replaces it.
//! * In current mode the arm makes no moves, holds no pose, and can be moved by hand.
//! * The torque goes off with the return from current to position mode, as in the document.
//! * There is no remote arm: torques and currents are 0.

use std::error::Error;
use std::fmt;
use std::str::FromStr;

use armwire::ling::{
    ControlMode, ForceFeedback, Inhibit, JOINTS, JointForce, JointMask, ModeReply, ModeResult, ModeState, Request,
    Response,
};
use armwire::time::{Duration, Instant};

use super::body::{Body, Drive};

/// What a force-feedback leader does with requests for its mode and its force feedback.
///
/// The text has words, separated by commas:
///
/// | Word | Effect |
/// |---|---|
/// | `apply=TIMEms` | time from the acceptance of a mode until it is applied, 0 to 60000; 100 without this word |
/// | `never` | a mode is accepted, and never applied |
/// | `refuse` | no mode is accepted: unsupported, or not queued |
/// | `teleoperation` | the synchronization is active; without it that inhibits the force feedback |
/// | `stale`, `fault`, `unsupported` | further reasons that inhibit the force feedback |
/// | `blocked=2`, `blocked=3`, `blocked=2+3` | joints that are blocked |
///
/// ```
/// use armwire_sim::ling::{Config, Leader};
///
/// let config = Config { force_feedback: Some("apply=300ms,blocked=2".parse()?), ..Config::leader() };
/// let error = "apply".parse::<Leader>().unwrap_err();
/// assert_eq!(error.to_string(), format!("'apply': expected {}", Leader::WORDS));
/// # Ok::<(), armwire_sim::ling::LeaderError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Leader {
    /// `None`: a mode is never applied.
    apply: Option<Duration>,
    accepts: bool,
    blocked: JointMask,
    inhibit: Inhibit,
}

/// A word of a [`Leader`] that does not exist, or that has no such value.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LeaderError(String);

impl Leader {
    /// The words of a text.
    pub const WORDS: &str =
        "apply=TIMEms, never, refuse, teleoperation, stale, fault, unsupported, blocked=2, blocked=3 or blocked=2+3";

    /// Applies one word. `None` if there is no such word.
    fn refine(&mut self, word: &str) -> Option<()> {
        match word.split_once('=').unwrap_or((word, "")) {
            ("apply", time) => {
                let millis = time.strip_suffix("ms")?.parse().ok()?;
                self.apply = Some(Duration::from_millis(Some(millis).filter(|millis| *millis <= 60_000)?));
            }
            ("blocked", joints) => {
                self.blocked = match joints {
                    "2" => JointMask(0b010),
                    "3" => JointMask(0b100),
                    "2+3" => JointMask(0b110),
                    _ => return None,
                }
            }
            _ => match word {
                "never" => self.apply = None,
                "refuse" => self.accepts = false,
                "teleoperation" => self.inhibit.0 &= !Inhibit::NO_TELEOPERATION,
                "stale" => self.inhibit.0 |= Inhibit::STALE,
                "fault" => self.inhibit.0 |= Inhibit::FAULT,
                "unsupported" => self.inhibit.0 |= Inhibit::UNSUPPORTED,
                _ => return None,
            },
        }
        Some(())
    }
}

impl Default for Leader {
    fn default() -> Self {
        Self {
            apply: Some(Duration::from_millis(100)),
            accepts: true,
            blocked: JointMask(0),
            inhibit: Inhibit(Inhibit::NO_TELEOPERATION),
        }
    }
}

/// The empty text is the default.
impl FromStr for Leader {
    type Err = LeaderError;

    fn from_str(text: &str) -> Result<Self, LeaderError> {
        let mut leader = Self::default();
        for word in text.split(',').filter(|_| !text.is_empty()) {
            leader.refine(word).ok_or_else(|| LeaderError(word.to_owned()))?;
        }
        Ok(leader)
    }
}

impl fmt::Display for LeaderError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "'{}': expected {}", self.0, Leader::WORDS)
    }
}

impl Error for LeaderError {}

/// The state of the electronics.
#[derive(Clone, Debug)]
pub(super) struct Electronics {
    leader: Leader,
    mode: ControlMode,
    /// The accepted mode, and the time at which it is applied. `None` for never.
    accepted: Option<(ControlMode, Option<Instant>)>,
    is_requested: bool,
}

impl Electronics {
    pub(super) const fn new(leader: Leader) -> Self {
        Self {
            leader,
            mode: ControlMode::Position,
            accepted: None,
            is_requested: false,
        }
    }

    /// Applies an accepted mode whose time has come.
    pub(super) fn advance(&mut self, now: Instant, body: &mut Body) {
        if let Some((mode, Some(at))) = self.accepted
            && at <= now
        {
            self.accepted = None;
            body.advance(at);
            let before = std::mem::replace(&mut self.mode, mode);
            match (before, mode) {
                (ControlMode::Current, ControlMode::Position) => {
                    body.set_torque(false);
                    body.set_drive(Drive::Position);
                }
                (ControlMode::Position, ControlMode::Current) => body.set_drive(Drive::Current),
                _ => {}
            }
        }
    }

    /// The answer to a request for the mode or the force feedback. `None` for other requests.
    pub(super) fn execute(&mut self, request: &Request, now: Instant, body: &Body) -> Option<Response> {
        match *request {
            Request::SetMode(mode) => {
                let result = match self.leader.accepts {
                    true => {
                        self.accepted = Some((mode, self.leader.apply.map(|time| now + time)));
                        ModeResult::Accepted
                    }
                    false => ModeResult::Unsupported,
                };
                let requested = mode as u8;
                Some(Response::ModeReply(ModeReply { requested, result }))
            }
            Request::ReadMode => Some(Response::Mode(ModeState {
                mode: self.mode,
                blocked: self.leader.blocked,
                valid: JointMask(0b11_1111),
                joints: [JointForce::default(); JOINTS],
            })),
            Request::SetForceFeedback(is_on) => {
                self.is_requested = is_on;
                Some(Response::ForceFeedback(self.force_feedback(body)))
            }
            Request::ReadForceFeedback => Some(Response::ForceFeedback(self.force_feedback(body))),
            _ => None,
        }
    }

    fn force_feedback(&self, body: &Body) -> ForceFeedback {
        let inhibit = self.leader.inhibit;
        let requested_mode = self.accepted.map_or(self.mode, |(mode, _)| mode);
        ForceFeedback {
            is_requested: self.is_requested,
            is_effective: self.is_requested && inhibit == Inhibit(0),
            inhibit,
            is_sync_active: inhibit.0 & Inhibit::NO_TELEOPERATION == 0,
            is_torque_enabled: body.is_holding(),
            is_torque_requested: body.is_holding(),
            transition: self.accepted.is_some().into(),
            grip: (u32::from(body.gripper()) * 255 / 1000) as u8,
            requested_mode: requested_mode as u8,
        }
    }
}
