//! The poses of arms, and how they are read.

use std::time::Instant;

use armwire::ling::{JointState, Ling as LingProtocol};
use armwire::messages::Messages;
use armwire::xarm::State;
use armwire_bridge::config::ArmKind;

use crate::control::Adapter;
use crate::describe::xarm::JOINTS;
use crate::error::Error;
use crate::ling::Ling;
use crate::xarm::XArm;

/// A pose of an arm.
pub trait Pose: Copy + Send + Sync + 'static {
    /// The pose at this fraction of the way from this one to `later`, in a straight line. Values without an order, such as
    /// a status, are those of the nearer one.
    #[must_use]
    fn between(&self, later: &Self, fraction: f64) -> Self;
}

/// A recipient of each pose that an arm reports.
pub type OnPose<P> = Box<dyn FnMut(P) + Send>;

/// An arm whose pose can be read at a rate.
///
/// An Alpha1 is none: its servos switch their motors off to answer.
pub trait Readable: Send + 'static {
    /// Its pose.
    type Pose: Pose;

    /// The name of its port, as typed by the user.
    fn name(&self) -> &str;

    /// The adapter on its port. `None` without one.
    ///
    /// # Errors
    ///
    /// Errors of the control port.
    fn adapter(&self) -> Result<Option<Adapter>, Error>;

    /// The kind of arm that an adapter polls for it.
    const KIND: Option<ArmKind>;

    /// The pose in a frame of the arm.
    fn pose(frame: &[u8]) -> Option<Self::Pose>;

    /// Reads the pose once. Returns false without an answer until this time. [`OnPose`] gets it.
    ///
    /// # Errors
    ///
    /// Errors of the line, and an answer that cannot be accepted.
    fn read_pose(&mut self, until: Instant) -> Result<bool, Error>;

    /// The recipient of each pose, of all reads. `None` without one.
    fn on_pose(&mut self) -> &mut Option<OnPose<Self::Pose>>;
}

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

impl Readable for Ling {
    type Pose = JointState;

    const KIND: Option<ArmKind> = Some(ArmKind::Ling);

    fn name(&self) -> &str {
        self.name()
    }

    fn adapter(&self) -> Result<Option<Adapter>, Error> {
        self.find_adapter()
    }

    fn pose(frame: &[u8]) -> Option<JointState> {
        LingProtocol.parse_response(frame, ()).ok()?.try_into().ok()
    }

    fn read_pose(&mut self, until: Instant) -> Result<bool, Error> {
        self.read_joints_until(until)
    }

    fn on_pose(&mut self) -> &mut Option<OnPose<JointState>> {
        &mut self.on_pose
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

impl Readable for XArm {
    type Pose = XArmPose;

    const KIND: Option<ArmKind> = None;

    fn name(&self) -> &str {
        self.name()
    }

    fn adapter(&self) -> Result<Option<Adapter>, Error> {
        Ok(None)
    }

    fn pose(_: &[u8]) -> Option<XArmPose> {
        None
    }

    fn read_pose(&mut self, until: Instant) -> Result<bool, Error> {
        self.read_joints_until(until)
    }

    fn on_pose(&mut self) -> &mut Option<OnPose<XArmPose>> {
        &mut self.on_pose
    }
}
