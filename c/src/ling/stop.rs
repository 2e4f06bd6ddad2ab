//! Stopping an arm, and the meaning of its readings.

use armwire::ling::stop::{Grip, Output, StopError, Stopped};
use armwire::ling::{Immovable, MotionStatus, Opening, Request, Response, Speed, Stop};
use armwire::time::Instant;

use super::message::{ARMWIRE_LING_JOINTS, ArmwireLingMove, ArmwireLingResponse};
use crate::memory::{self, Memory};
use crate::status::ArmwireStatus;
use crate::version::ARMWIRE_VERSION;

/// Size of a stop, in words of 64 bits.
pub const ARMWIRE_LING_STOP_WORDS: usize = 40;

/// A stop of a moving arm, whose torque stays on. The caller owns its memory. The content is private.
#[repr(C)]
pub struct ArmwireLingStop {
    opaque: [u64; ARMWIRE_LING_STOP_WORDS],
}

// SAFETY: an array of `u64` in a `repr(C)` structure.
unsafe impl Memory for ArmwireLingStop {
    type Value = Stop;
    const TAG: u32 = memory::tag(7);
}

/// The kind of an `ArmwireLingStopStep`. The members that it sets are named in parentheses.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArmwireLingStopStepKind {
    /// Poll again at this time. (`until_us`)
    Wait = 0,
    /// Read the joints, and pass the answer to `armwire_ling_stop_on_joints`.
    ReadJoints,
    /// Make this move. (`target`)
    Move,
    /// Switch the torque on. It is on already: for an adapter this ends the host's stream of motion.
    TorqueOn,
    /// The end: the arm is at rest. (`grip_may_loosen`, `deviation_ticks`)
    AtRest,
    /// The end: the arm has no torque. Nothing was sent to it.
    WithoutTorque,
    /// The end: no reading came within 2 s. The arm may still move.
    NoReading,
    /// The end: a joint still moves after 2 s. (`joint`)
    Moving,
    /// The end: a joint's position is not one of 0 to 4095, or the robot is not an Alicia-D. It may still move.
    Unholdable,
    /// The end: readings came within 2 s, but they do not show the arm at rest. It may still move.
    Unconfirmed,
    /// The end: a joint came to the hold, and left it. Another program moves the arm. (`joint`)
    MovedByAnother,
}

/// The next action of a stop. Members that its kind does not set are 0.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct ArmwireLingStopStep {
    /// The kind: an `ArmwireLingStopStepKind`.
    pub kind: u32,
    /// The time of the next poll.
    pub until_us: u64,
    /// The move.
    pub target: ArmwireLingMove,
    /// 1 if the gripper's goal was its reading: a grip may have loosened.
    pub grip_may_loosen: u8,
    /// The joint that moves, from 1.
    pub joint: u8,
    /// The last reading of each joint minus its setpoint, in ticks. A load is held by it.
    pub deviation_ticks: [i32; ARMWIRE_LING_JOINTS],
}

impl ArmwireLingStopStep {
    fn of(output: Output) -> Self {
        let mut step = Self::default();
        let kind = match output {
            Output::Wait(until) => {
                step.until_us = until.as_micros();
                ArmwireLingStopStepKind::Wait
            }
            Output::Request(Request::Move(target)) => {
                step.target = ArmwireLingMove::of(&target);
                ArmwireLingStopStepKind::Move
            }
            Output::Request(Request::SetTorque(_)) => ArmwireLingStopStepKind::TorqueOn,
            Output::Request(_) => ArmwireLingStopStepKind::ReadJoints,
            Output::Done(Ok(Stopped::AtRest { grip, deviations, .. })) => {
                step.deviation_ticks = deviations.0;
                step.grip_may_loosen = (grip == Grip::Reading).into();
                ArmwireLingStopStepKind::AtRest
            }
            Output::Done(Ok(Stopped::WithoutTorque(_))) => ArmwireLingStopStepKind::WithoutTorque,
            Output::Done(Err(StopError::NoReading)) => ArmwireLingStopStepKind::NoReading,
            Output::Done(Err(StopError::Unconfirmed { .. })) => ArmwireLingStopStepKind::Unconfirmed,
            Output::Done(Err(StopError::Moving { joint })) => {
                step.joint = joint;
                ArmwireLingStopStepKind::Moving
            }
            Output::Done(Err(StopError::MovedByAnother { joint })) => {
                step.joint = joint;
                ArmwireLingStopStepKind::MovedByAnother
            }
            Output::Done(Err(_)) => ArmwireLingStopStepKind::Unholdable,
        };
        step.kind = kind as u32;
        step
    }
}

/// Holding of its position by an arm.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArmwireLingHolding {
    /// The status does not show it.
    Unknown = 0,
    /// The torque is off.
    No,
    /// The torque is on.
    Yes,
}

/// Whether an arm may be moved.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArmwireLingMotion {
    /// It may.
    Allowed = 0,
    /// The torque is off.
    TorqueOff,
    /// No document explains the status. A stop is possible.
    UnknownStatus,
    /// It is another robot than an Alicia-D (`foreign_data_bytes`). Nothing holds it, either.
    Foreign,
    /// The response is not one of kind JOINTS.
    NoReading,
}

/// Initializes a stop. `version` is ARMWIRE_VERSION. `opening_per_mille` is the last goal of the gripper, 0 to 1000, or
/// NULL if it is unknown: the goal is the reading then, and a grip may loosen.
///
/// ARMWIRE_STATUS_VERSION if header and library differ, ARMWIRE_STATUS_OUT_OF_RANGE for another opening.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_ling_stop_init(
    stop: Option<&mut ArmwireLingStop>,
    version: u32,
    opening_per_mille: Option<&u16>,
) -> ArmwireStatus {
    if version != ARMWIRE_VERSION {
        return ArmwireStatus::Version;
    }
    match opening_per_mille.copied().map(Opening::new).transpose() {
        Ok(gripper) => memory::init(stop, Stop::new(gripper)).into(),
        Err(_) => ArmwireStatus::OutOfRange,
    }
}

/// Initializes a stop of an arm whose last move was `last`: if it stands within 40 ticks of that, it is held there, and
/// does not move. Use `armwire_ling_stop_init` if the arm may have had no torque since then, or another program may have
/// moved it. `version` is ARMWIRE_VERSION.
///
/// ARMWIRE_STATUS_VERSION if header and library differ, ARMWIRE_STATUS_OUT_OF_RANGE for a move out of range.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_ling_stop_init_after(
    stop: Option<&mut ArmwireLingStop>,
    version: u32,
    last: Option<&ArmwireLingMove>,
) -> ArmwireStatus {
    if version != ARMWIRE_VERSION {
        return ArmwireStatus::Version;
    }
    match last.map(|last| last.get(Speed::SLOWEST_OF_FORCE_FEEDBACK)) {
        None => ArmwireStatus::Null,
        Some(Ok(last)) => memory::init(stop, Stop::after(&last)).into(),
        Some(Err(_)) => ArmwireStatus::OutOfRange,
    }
}

/// The next action. `now_us` is the time of a monotonic clock. Call it until its kind is one of the ends.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_ling_stop_poll(
    stop: Option<&mut ArmwireLingStop>,
    now_us: u64,
    step: Option<&mut ArmwireLingStopStep>,
) -> ArmwireStatus {
    memory::open(stop)
        .and_then(|stop| {
            let step = step.ok_or(ArmwireStatus::Null)?;
            *step = ArmwireLingStopStep::of(stop.poll(Instant::from_micros(now_us)));
            Ok(())
        })
        .into()
}

/// Takes a reading of the joints. After a failed read poll again: it is repeated.
///
/// ARMWIRE_STATUS_UNKNOWN_KIND for another response.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_ling_stop_on_joints(
    stop: Option<&mut ArmwireLingStop>,
    now_us: u64,
    joints: Option<&ArmwireLingResponse>,
) -> ArmwireStatus {
    memory::open(stop)
        .and_then(|stop| match joints.map(ArmwireLingResponse::get) {
            None => Err(ArmwireStatus::Null),
            Some(Ok(Response::Joints(state))) => {
                stop.on_joints(Instant::from_micros(now_us), &state);
                Ok(())
            }
            Some(_) => Err(ArmwireStatus::UnknownKind),
        })
        .into()
}

/// Holding of its position by an arm with this `motion_status`. It has no meaning for another robot
/// (`foreign_data_bytes`).
#[unsafe(no_mangle)]
pub extern "C" fn armwire_ling_holding(motion_status: u8) -> ArmwireLingHolding {
    match MotionStatus::from(motion_status).is_holding() {
        None => ArmwireLingHolding::Unknown,
        Some(false) => ArmwireLingHolding::No,
        Some(true) => ArmwireLingHolding::Yes,
    }
}

/// Whether the arm with this response of kind JOINTS may be moved. Ask it before the first move: the client sends any.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_ling_check_motion(joints: Option<&ArmwireLingResponse>) -> ArmwireLingMotion {
    let Some(Ok(Response::Joints(state))) = joints.map(ArmwireLingResponse::get) else {
        return ArmwireLingMotion::NoReading;
    };
    match state.status.check_motion() {
        Ok(()) => ArmwireLingMotion::Allowed,
        Err(Immovable::TorqueOff(_)) => ArmwireLingMotion::TorqueOff,
        Err(Immovable::UnknownStatus(_)) => ArmwireLingMotion::UnknownStatus,
        Err(_) => ArmwireLingMotion::Foreign,
    }
}
