//! The poses of arms.

use armwire::ling::JointState;
use armwire::xarm::State;

use crate::describe::xarm::JOINTS;
use crate::time::stamps::HostTime;

/// A pose of an arm.
pub trait Pose: Copy + Send + Sync + 'static {
    /// The pose at this fraction of the way from this one to `later`, in a straight line. Values without an order, such as
    /// a status, are those of the nearer one.
    #[must_use]
    fn between(&self, later: &Self, fraction: f64) -> Self;
}

/// A recipient of each pose that an arm reports, with its time.
pub type OnPose<P> = Box<dyn FnMut(P, HostTime) + Send>;

impl Pose for JointState {
    /// Rounded to the arm's ticks and thousandths.
    fn between(&self, later: &Self, fraction: f64) -> Self {
        let count =
            |from: u16, to: u16| (f64::from(from) + (f64::from(to) - f64::from(from)) * fraction).round() as u16;
        let mut joints = self.joints;
        for (joint, to) in joints.iter_mut().zip(later.joints) {
            *joint = count(*joint, to);
        }
        Self {
            joints,
            gripper: count(self.gripper, later.gripper),
            status: if fraction < 0.5 { self.status } else { later.status },
        }
    }
}

/// The joint positions of an xArm, and its state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct XArmPose {
    /// Positions in radians. An arm with fewer joints uses the first.
    pub joints: [f32; JOINTS],
    /// The arm's state.
    pub state: State,
}

impl Pose for XArmPose {
    fn between(&self, later: &Self, fraction: f64) -> Self {
        let mut joints = self.joints;
        for (joint, to) in joints.iter_mut().zip(later.joints) {
            *joint = (f64::from(*joint) + (f64::from(to) - f64::from(*joint)) * fraction) as f32;
        }
        let state = if fraction < 0.5 { self.state } else { later.state };
        Self { joints, state }
    }
}
