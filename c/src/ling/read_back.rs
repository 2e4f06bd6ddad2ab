//! Setting what the arm does not confirm.

use armwire::ling::effect::{Effect, EffectError, Output};
use armwire::ling::{ReadBack, Request, Response, Torque};
use armwire::time::Instant;

use super::message::ArmwireLingResponse;
use crate::memory::{self, Memory};
use crate::status::ArmwireStatus;
use crate::version::ARMWIRE_VERSION;

/// Size of a read-back, in words of 64 bits.
pub const ARMWIRE_LING_READ_BACK_WORDS: usize = 16;

/// A request that the arm does not answer, and the read-back of its effect. The caller owns its memory. The content is
/// private.
#[repr(C)]
pub struct ArmwireLingReadBack {
    opaque: [u64; ARMWIRE_LING_READ_BACK_WORDS],
}

// SAFETY: an array of `u64` in a `repr(C)` structure.
unsafe impl Memory for ArmwireLingReadBack {
    type Value = ReadBack;
    const TAG: u32 = memory::tag(8);
}

/// The effect of a request that the arm does not answer.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArmwireLingEffect {
    /// The torque is off: a load that the arm holds falls.
    TorqueOff = 0,
    /// The torque is on.
    TorqueOn,
    /// The present pose is zero. The arm switches its torque off: a load that it holds falls.
    Zero,
}

/// The kind of an `ArmwireLingReadBackStep`. The members that it sets are named in parentheses.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArmwireLingReadBackStepKind {
    /// Poll again at this time. (`until_us`)
    Wait = 0,
    /// Read the joints, and pass the answer to `armwire_ling_read_back_on_joints`.
    ReadJoints,
    /// Switch the torque. (`torque_on`)
    SetTorque,
    /// Make the present pose zero.
    SetZero,
    /// The end: a reading shows the effect.
    Confirmed,
    /// The end: the last reading shows neither the effect nor its absence, for example because the arm is overheating.
    NotShown,
    /// The end: the last reading, 0.5 s after the request, shows that the effect is missing.
    Contradicted,
    /// The end: no reading came within 0.5 s.
    NoReading,
}

/// The next action of a read-back. Members that its kind does not set are 0.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct ArmwireLingReadBackStep {
    /// The kind: an `ArmwireLingReadBackStepKind`.
    pub kind: u32,
    /// The time of the next poll.
    pub until_us: u64,
    /// Torque: 1 on, 0 off.
    pub torque_on: u8,
}

impl ArmwireLingReadBackStep {
    fn of(output: Output) -> Self {
        let mut step = Self::default();
        let kind = match output {
            Output::Wait(until) => {
                step.until_us = until.as_micros();
                ArmwireLingReadBackStepKind::Wait
            }
            Output::Request(Request::SetTorque(torque)) => {
                step.torque_on = (torque == Torque::On).into();
                ArmwireLingReadBackStepKind::SetTorque
            }
            Output::Request(Request::SetZero) => ArmwireLingReadBackStepKind::SetZero,
            Output::Request(_) => ArmwireLingReadBackStepKind::ReadJoints,
            Output::Done(Ok(outcome)) => match outcome.is_shown {
                true => ArmwireLingReadBackStepKind::Confirmed,
                false => ArmwireLingReadBackStepKind::NotShown,
            },
            Output::Done(Err(EffectError::Contradicted { .. })) => ArmwireLingReadBackStepKind::Contradicted,
            Output::Done(Err(_)) => ArmwireLingReadBackStepKind::NoReading,
        };
        step.kind = kind as u32;
        step
    }
}

/// Initializes a read-back. `version` is ARMWIRE_VERSION, `effect` an `ArmwireLingEffect`.
///
/// ARMWIRE_STATUS_VERSION if header and library differ, ARMWIRE_STATUS_OUT_OF_RANGE for another effect.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_ling_read_back_init(
    read_back: Option<&mut ArmwireLingReadBack>,
    version: u32,
    effect: u32,
) -> ArmwireStatus {
    if version != ARMWIRE_VERSION {
        return ArmwireStatus::Version;
    }
    let effects = [
        (ArmwireLingEffect::TorqueOff, Effect::Torque(Torque::Off)),
        (ArmwireLingEffect::TorqueOn, Effect::Torque(Torque::On)),
        (ArmwireLingEffect::Zero, Effect::Zero),
    ];
    match effects.into_iter().find(|(code, _)| *code as u32 == effect) {
        Some((_, effect)) => memory::init(read_back, ReadBack::new(effect)).into(),
        None => ArmwireStatus::OutOfRange,
    }
}

/// The next action. `now_us` is the time of a monotonic clock. Call it until its kind is one of the ends.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_ling_read_back_poll(
    read_back: Option<&mut ArmwireLingReadBack>,
    now_us: u64,
    step: Option<&mut ArmwireLingReadBackStep>,
) -> ArmwireStatus {
    memory::open(read_back)
        .and_then(|read_back| {
            let step = step.ok_or(ArmwireStatus::Null)?;
            *step = ArmwireLingReadBackStep::of(read_back.poll(Instant::from_micros(now_us)));
            Ok(())
        })
        .into()
}

/// Takes a reading of the joints. After a failed read poll again: it is repeated.
///
/// ARMWIRE_STATUS_UNKNOWN_KIND for another response.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_ling_read_back_on_joints(
    read_back: Option<&mut ArmwireLingReadBack>,
    now_us: u64,
    joints: Option<&ArmwireLingResponse>,
) -> ArmwireStatus {
    memory::open(read_back)
        .and_then(|read_back| match joints.map(ArmwireLingResponse::get) {
            None => Err(ArmwireStatus::Null),
            Some(Ok(Response::Joints(state))) => {
                read_back.on_joints(Instant::from_micros(now_us), &state);
                Ok(())
            }
            Some(_) => Err(ArmwireStatus::UnknownKind),
        })
        .into()
}
