//! The arrival of an arm at the target of a move.

use armwire::ling::arrival::{Arrival, Arrived, Away, Tolerances};
use armwire::ling::{Response, Speed};
use armwire::time::Instant;

use super::message::{ARMWIRE_LING_JOINTS, ArmwireLingMove, ArmwireLingResponse};
use crate::memory::{self, Memory};
use crate::status::ArmwireStatus;
use crate::version::ARMWIRE_VERSION;

/// Size of an arrival, in words of 64 bits.
pub const ARMWIRE_LING_ARRIVAL_WORDS: usize = 24;
/// The distance of a joint from its target within which it has arrived, in ticks, as in the vendor's software: 0.1 rad.
pub const ARMWIRE_LING_TOLERANCE: u16 = 65;
// The header needs a literal.
const _: () = assert!(ARMWIRE_LING_TOLERANCE == Tolerances::JOINT);

/// The arrival at the target of a move. The caller owns its memory. The content is private.
#[repr(C)]
pub struct ArmwireLingArrival {
    opaque: [u64; ARMWIRE_LING_ARRIVAL_WORDS],
}

// SAFETY: an array of `u64` in a `repr(C)` structure.
unsafe impl Memory for ArmwireLingArrival {
    type Value = Arrival;
    const TAG: u32 = memory::tag(9);
}

/// The state of an arrival at a reading.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArmwireLingArrivedKind {
    /// The arm moves, or may still begin to.
    NotYet = 0,
    /// The move may be lost: send it once more, unless the arm was stopped meanwhile.
    Resend,
    /// The end: all axes are at rest at the target.
    AtTarget,
    /// The end: the joints are at rest at the target. The gripper stands still away from it: it may hold something.
    GripperStandsStill,
    /// The end: the joints are at rest away from the target.
    Elsewhere,
}

/// The state of an arrival at a reading, and the distances from the target.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct ArmwireLingArrived {
    /// The kind: an `ArmwireLingArrivedKind`.
    pub kind: u32,
    /// The reading of each joint minus its target, in ticks. A load is held by it.
    pub deviation_ticks: [i32; ARMWIRE_LING_JOINTS],
    /// Bit 0 to 5: joint 1 to 6 is away from its target. Bit 6: the gripper is.
    pub away: u8,
}

fn bits(away: Away) -> u8 {
    let axes = away.joints.iter().chain([&away.gripper]);
    axes.rev().fold(0, |bits, axis| bits << 1 | u8::from(axis.is_some()))
}

/// Initializes the arrival at this target of a move that was just sent. `version` is ARMWIRE_VERSION. `within_ticks` is the
/// tolerance of each joint: ARMWIRE_LING_TOLERANCE, for example.
///
/// ARMWIRE_STATUS_VERSION if header and library differ, ARMWIRE_STATUS_OUT_OF_RANGE for a target out of range.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_ling_arrival_init(
    arrival: Option<&mut ArmwireLingArrival>,
    version: u32,
    target: Option<&ArmwireLingMove>,
    within_ticks: u16,
) -> ArmwireStatus {
    if version != ARMWIRE_VERSION {
        return ArmwireStatus::Version;
    }
    match target.map(|target| target.get(Speed::SLOWEST_OF_FORCE_FEEDBACK)) {
        None => ArmwireStatus::Null,
        Some(Ok(target)) => memory::init(arrival, Arrival::new(target, Tolerances::within(within_ticks))).into(),
        Some(Err(_)) => ArmwireStatus::OutOfRange,
    }
}

/// Takes a reading of the joints, at most 150 ms after the one before, until the kind is one of the ends.
///
/// ARMWIRE_STATUS_UNKNOWN_KIND for another response.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_ling_arrival_on_joints(
    arrival: Option<&mut ArmwireLingArrival>,
    now_us: u64,
    joints: Option<&ArmwireLingResponse>,
    arrived: Option<&mut ArmwireLingArrived>,
) -> ArmwireStatus {
    memory::open(arrival)
        .and_then(|arrival| {
            let state = match joints.map(ArmwireLingResponse::get) {
                None => return Err(ArmwireStatus::Null),
                Some(Ok(Response::Joints(state))) => state,
                Some(_) => return Err(ArmwireStatus::UnknownKind),
            };
            let arrived = arrived.ok_or(ArmwireStatus::Null)?;
            let (kind, away) = match arrival.on_joints(Instant::from_micros(now_us), &state) {
                Arrived::NotYet(away) => (ArmwireLingArrivedKind::NotYet, away),
                Arrived::Resend => (ArmwireLingArrivedKind::Resend, arrival.away(&state)),
                Arrived::AtTarget(_) => (ArmwireLingArrivedKind::AtTarget, None),
                Arrived::GripperStandsStill(away) => (ArmwireLingArrivedKind::GripperStandsStill, Some(away)),
                Arrived::Elsewhere(away) => (ArmwireLingArrivedKind::Elsewhere, Some(away)),
            };
            *arrived = ArmwireLingArrived {
                kind: kind as u32,
                deviation_ticks: arrival.target().deviations(&state).0,
                away: away.map_or(0, bits),
            };
            Ok(())
        })
        .into()
}
