//! The travel of an arm with weight that is held: how far it may sink.

use std::f64::consts::TAU;

use armwire::ling::{GripperSpeed, JOINTS, Move, Opening, Position, Speed, TICKS_PER_TURN};

/// One degree, in ticks.
pub const DEGREE: f64 = TICKS_PER_TURN as f64 / 360.0;
/// The sag of the joints, as shares of the plant's: see [`Plant`](armwire_sim::ling::Plant).
const SHARES: [f64; JOINTS] = [0.0, 1.0, 0.8, 0.0, 0.4, 0.0];

/// The least and the largest position of each joint, in ticks.
pub type Reach = [(u16, u16); JOINTS];

/// A move to these positions, in ticks, at this speed in ticks per second, with the gripper closed.
///
/// # Panics
///
/// If a position or the speed is out of range.
pub fn to(joints: [u16; JOINTS], speed: u16) -> Move {
    Move {
        joints: joints.map(|ticks| (Position::new(ticks).unwrap(), Speed::new(speed).unwrap())),
        gripper: (Opening::CLOSED, GripperSpeed::DEFAULT),
    }
}

/// The distance at which a joint at this position rests below its goal, in ticks, in a plant with this sag.
fn sag_of(sag: f64, joint: usize, ticks: u16) -> f64 {
    let turns = (f64::from(ticks) - f64::from(TICKS_PER_TURN / 2)) / f64::from(TICKS_PER_TURN);
    sag * SHARES[joint] * (turns * TAU).cos()
}

/// The hold of an arm at this pose, raised by its sag: the arm does not sink.
///
/// # Panics
///
/// If a raised position is out of range.
pub fn raised(joints: [u16; JOINTS], sag: f64) -> Move {
    let goals = std::array::from_fn(|joint| {
        let ticks = joints[joint];
        (f64::from(ticks) + sag_of(sag, joint, ticks)).round() as u16
    });
    to(goals, 2_000)
}

/// Adds a pose to what joints have reached.
pub fn extend(reached: &mut Reach, joints: [u16; JOINTS]) {
    for ((low, high), at) in reached.iter_mut().zip(joints) {
        (*low, *high) = ((*low).min(at), (*high).max(at));
    }
}

/// The largest travel beyond that of the same arm without sag, minus the sag at the first or at the last pose, in ticks.
pub fn travel_beyond_sag(reached: &Reach, still: &Reach, poses: [[u16; JOINTS]; 2], sag: f64) -> f64 {
    let travels = reached.iter().zip(still).enumerate().map(|(joint, (at, still))| {
        let beyond = still.0.saturating_sub(at.0).max(at.1.saturating_sub(still.1));
        let [first, last] = poses.map(|pose| sag_of(sag, joint, pose[joint]).abs());
        f64::from(beyond) - first.max(last)
    });
    travels.fold(f64::NEG_INFINITY, f64::max)
}
