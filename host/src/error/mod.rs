//! Errors of ports, arms and adapters.

pub(crate) mod no_control;
pub(crate) mod no_pose;
pub(crate) mod outside;
pub(crate) mod received;
pub(crate) mod text;
pub(crate) mod usb_fault;

use std::error;
use std::fmt::{self, Display};
use std::io;
use std::time::Duration;

use armwire::ErrorFrame;
use armwire::ling::arrival::Away;
use armwire::ling::effect::EffectError;
use armwire::ling::legacy::OlderGeneration;
use armwire::ling::mode_change::ModeError;
use armwire::ling::stop::Stopped;
use armwire::ling::{Immovable, JointState, MotionStatus, SerialNumber};
use armwire_bridge::control::{StopInForce, VERSION};

use crate::error::no_control::NoControl;
use crate::error::no_pose::NoPose;
use crate::error::outside::Outside;
use crate::error::received::Missing;
use crate::error::text::{Remedy, Text};
use crate::error::usb_fault::UsbFault;
use crate::time::silence::SilenceLimit;

/// The reason for a failed call, in one line: [`Display`] is for people, the variant is for programs. Text from outside is
/// escaped: see [`Outside`].
///
/// The text has no words of a certain program. A program with words of its own, such as the name of an option, puts them
/// in with [`with`](Self::with).
#[derive(Debug)]
#[allow(
    missing_docs,
    reason = "`name` is what the user calls the port, `reason` is in words"
)]
#[non_exhaustive]
pub enum Error {
    /// A port that does not exist in this form, or that does not have what was asked of it.
    Port(Text),
    /// A baud rate was set for a port that is no serial port.
    Baud { name: Outside },
    /// Something fails at a port or a host, with a reason for the user only.
    At { name: Outside, reason: Text },
    /// The arm or the adapter refuses the request.
    Refused { name: Outside, reason: Text },
    /// The received bytes are no message of this arm, or an unacceptable one.
    Unacceptable { name: Outside, reason: Outside },
    /// The arm answered with an error frame.
    ErrorFrame { name: Outside, frame: ErrorFrame },
    /// The program's [interrupt](crate::Interrupt) returned this error.
    Interrupted(Box<dyn error::Error + Send + Sync>),
    /// The port or the connection is gone that was open, or its arm: it may come back.
    Lost { name: Outside, reason: Outside },
    /// The torque is on. It was off before the port was lost, and this program has not switched it: nothing was sent.
    TorqueSwitched { name: Outside },
    /// Another program uses the port, or this process does. `user` describes it.
    InUse { name: Outside, user: Outside },
    /// The port accepts no bytes.
    Stuck { name: Outside },
    /// The arm is of the older generation, which is sent nothing.
    Legacy { name: Outside, legacy: OlderGeneration },
    /// The arm or the adapter did not answer, though perhaps bytes came. `hint` is a question that may find the fault.
    NoAnswer {
        name: Outside,
        cause: Outside,
        hint: Text,
        missing: Missing,
        bytes: usize,
    },
    /// The torque is off, as in this status.
    TorqueOff {
        name: Outside,
        status: MotionStatus,
        effect: TorqueOffEffect,
    },
    /// Nothing may move the arm, for this reason other than its torque: a status that no document explains, or another
    /// robot.
    Immovable {
        name: Outside,
        reason: Immovable,
        effect: TorqueOffEffect,
    },
    /// The adapter refuses motion, because of this stop.
    MotionRefused { name: Outside, stop: StopInForce },
    /// A request was sent, but no reading shows its effect.
    NoEffect { name: Outside, cause: EffectError },
    /// The arm is no force-feedback leader: it does not answer the request for its control mode.
    NoForceFeedback { name: Outside },
    /// The arm has not applied a control mode.
    ModeNotApplied { name: Outside, cause: ModeError },
    /// The arm in motion did not answer for [`Ling::SILENCE`](crate::Ling::SILENCE), and was asked to stop.
    Unanswered { name: Outside, silence: Box<SilentMotion> },
    /// The arm did not reach its target: it is at rest elsewhere, or was not seen at rest within this limit and may
    /// move on.
    NotReached {
        name: Outside,
        state: JointState,
        limit: Option<Duration>,
        away: Option<Away>,
    },
    /// The arm did not arrive where it was to be parked, and was told to hold its pose. Its torque stays on.
    NotParked {
        cause: Box<Error>,
        stopped: Result<Stopped, Text>,
    },
    /// No pose is saved in which the arm with this serial number lies.
    NoParkPose { name: Outside, serial: SerialNumber },
    /// The program's [interrupt](crate::Interrupt) returned this error, and the arm was stopped.
    Stopped {
        name: Outside,
        stopped: Stopped,
        reason: Box<dyn error::Error + Send + Sync>,
    },
    /// The port needs a feature of this crate that the build does not have.
    Disabled { name: Outside, feature: &'static str },
    /// There is no pose of the arm that is new enough, or none for that time.
    NoPose { name: Outside, reason: NoPose },
    /// The arm was [taken](crate::Shared::take) out, or its reader has ended.
    Closed { name: Outside },
    /// The arm was not stopped. It may still move.
    NotStopped { name: Outside, cause: Text },
    /// No control port of an adapter is known there.
    NoControl { name: Outside, reason: NoControl },
    /// The control port is there, but cannot be used.
    Usb { name: Outside, fault: UsbFault },
    /// The adapter does not know a request. `version` is that of its control protocol.
    Unsupported { name: Outside, version: u16 },
}

/// The motion of an arm that fell silent.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct SilentMotion {
    /// The cause of the last missing answer.
    pub cause: Text,
    /// The last reading since the move, if there is one.
    pub last: Option<JointState>,
    /// The end of the stop, or the reason why the arm may still move.
    pub stopped: Result<Stopped, Text>,
}

/// The effect on a motion of a torque that is off, or of another reason against it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum TorqueOffEffect {
    /// It was off before the motion: nothing was sent.
    NothingSent,
    /// It went off during the motion, which it ended.
    MotionEnded,
}

impl Display for TorqueOffEffect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NothingSent => "nothing was sent",
            Self::MotionEnded => "the arm is not moved",
        })
    }
}

impl Error {
    /// The text, with `words` at the place of each remedy: see [`Text::with`].
    pub fn with(&self, words: impl Fn(Remedy) -> String) -> String {
        self.text().with(words)
    }

    /// The first remedy, if there is one.
    pub fn remedy(&self) -> Option<Remedy> {
        self.text().remedies().next()
    }

    /// An error at `name`.
    pub fn at(name: &str, reason: impl Display) -> Self {
        let (name, reason) = (name.into(), reason.to_string().into());
        Self::At { name, reason }
    }

    /// An arm or an adapter at `name` that refuses a request.
    pub fn refused(name: &str, reason: impl Display) -> Self {
        let (name, reason) = (name.into(), reason.to_string().into());
        Self::Refused { name, reason }
    }

    /// A port that no adapter has.
    pub(crate) fn no_adapter(name: &str) -> Self {
        let (name, reason) = (name.into(), NoControl::NoAdapter);
        Self::NoControl { name, reason }
    }

    /// Unacceptable bytes from `name`.
    pub(crate) fn unacceptable(name: &str, reason: impl Display) -> Self {
        let (name, reason) = (name.into(), reason.to_string().into());
        Self::Unacceptable { name, reason }
    }

    /// A lost connection to `name`.
    pub(crate) fn lost(name: &str, reason: impl Display) -> Self {
        let (name, reason) = (name.into(), reason.to_string().into());
        Self::Lost { name, reason }
    }

    /// The reason of a loss that this error of an opening goes on with.
    pub(crate) fn loss(&self) -> Outside {
        match self {
            Self::Lost { reason, .. } => reason.clone(),
            error => format!("the port is not open again ({error})").into(),
        }
    }

    /// A port that was unplugged.
    pub(crate) fn unplugged(name: &str, error: &io::Error) -> Self {
        Self::lost(name, format_args!("the port is gone ({error}): was it unplugged?"))
    }

    fn text(&self) -> Text {
        let at = |name: &Outside, reason: &str| Text::from(format!("{name}: {reason}"));
        match self {
            Self::Port(reason) => reason.clone(),
            Self::Baud { name } => at(name, "a baud rate applies to serial ports only"),
            Self::At { name, reason } | Self::Refused { name, reason } => at(name, "").append(reason),
            Self::Unacceptable { name, reason } | Self::Lost { name, reason } => at(name, reason.as_str()),
            Self::Usb { name, fault } => at(name, &fault.to_string()),
            Self::ErrorFrame { name, frame } => {
                let what = format!("the arm answered with an error frame, which no document explains: {frame}");
                at(name, &what)
            }
            Self::Interrupted(reason) => reason.to_string().into(),
            Self::TorqueSwitched { name } => at(
                name,
                "the torque is on, and was off before the port was lost, so nothing was sent: switch it first",
            ),
            Self::InUse { name, user } => at(name, &format!("in use by {user}: close that one first")),
            Self::Stuck { name } => at(name, "the port accepts no bytes: is the device behind it stuck?"),
            Self::Legacy { name, legacy } => at(name, &format!("this is {legacy}")).remedy(Remedy::Listen),
            Self::NoAnswer { name, cause, hint, .. } => at(name, &format!("{cause}: ")).append(hint),
            Self::TorqueOff { name, status, effect } => {
                at(name, &format!("the torque is off (status {status}), so {effect}")).remedy(Remedy::TorqueOn)
            }
            Self::Immovable { name, reason, effect } => at(name, &format!("{reason}, so {effect}")),
            Self::MotionRefused { name, stop } => at(name, &stop.to_string()),
            Self::NoEffect { name, cause } => at(name, &cause.to_string()),
            Self::NoForceFeedback { name } => at(
                name,
                "not supported: the arm answers, but not for its control mode, so it is no force-feedback leader",
            ),
            Self::ModeNotApplied { name, cause } => at(name, &cause.to_string()),
            Self::Unanswered { name, silence } => {
                let seconds = SilenceLimit::STOP.least().as_micros() / 1_000_000;
                let what = at(name, &format!("no answer for {seconds} s during a motion (")).append(&silence.cause);
                match (&silence.stopped, silence.last) {
                    (Ok(Stopped::AtRest { state, .. }), _) => what.and(&format!("), so the arm was stopped: {state}")),
                    (Ok(Stopped::WithoutTorque(state)), _) => what.and(&format!("); the torque is off: {state}")),
                    (Err(cause), None) => what.and("), and the arm is not stopped: ").append(cause),
                    (Err(cause), Some(last)) => what
                        .and("), and the arm is not stopped: ")
                        .append(cause)
                        .and(&format!("; last reading of the motion: {last}")),
                }
            }
            Self::NotReached {
                name,
                state,
                limit,
                away,
            } => {
                let what = match (limit, away) {
                    (None, None) => "target not reached".to_owned(),
                    (None, Some(away)) => format!("at rest away from the target: {away}"),
                    (Some(limit), None) => format!("not seen at rest after {} s", limit.as_secs_f32()),
                    (Some(limit), Some(away)) => {
                        format!("target not reached after {} s: {away}", limit.as_secs_f32())
                    }
                };
                let error = at(name, &format!("{what} (status {})", state.status));
                match limit {
                    Some(_) => error.remedy(Remedy::Stop),
                    None => error,
                }
            }
            Self::NotParked { cause, stopped } => {
                let what = Text::from(format!("{cause}; not parked, "));
                match stopped {
                    Ok(Stopped::AtRest { state, .. }) => what.and(&format!("the arm holds its pose: {state}")),
                    Ok(Stopped::WithoutTorque(state)) => what.and(&format!("the torque is off: {state}")),
                    Err(cause) => what.append(cause),
                }
            }
            Self::NoParkPose { name, serial } => {
                let what = format!("no pose is saved in which the arm {serial} lies without torque");
                at(name, &what).remedy(Remedy::SaveParkPose)
            }
            Self::Stopped { name, reason, .. } => at(name, &format!("stopped: {reason}")),
            Self::Disabled { name, feature } => at(
                name,
                &format!("not supported by this build, which is without the feature '{feature}'"),
            ),
            Self::NoPose { name, reason } => at(name, &reason.to_string()),
            Self::Closed { name } => at(name, "the port is closed"),
            Self::NotStopped { name, cause } => at(name, "not stopped: ").append(cause),
            Self::NoControl { name, reason } => at(name, "").append(&reason.text()),
            Self::Unsupported { name, version } => {
                let what = format!(
                    "the adapter does not support this request: its control protocol is version {version}, this \
                     program's is {VERSION}"
                );
                at(name, &what)
            }
        }
    }
}

impl Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.text().fmt(f)
    }
}

impl error::Error for Error {}
