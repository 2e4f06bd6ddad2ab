//! How the poses of arms are read.

use std::time::Instant;

use armwire::ling::{JointState, Ling as LingProtocol};
use armwire::messages::Messages;
use armwire_bridge::config::ArmKind;

use crate::arm::ling::Ling;
use crate::arm::pose::{OnPose, Pose, XArmPose};
use crate::arm::shared::Shared;
use crate::arm::xarm::XArm;
use crate::error::Error;
use crate::ports::control::Adapter;

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

    /// Takes the adapter whose control port the reader has, for questions.
    fn lend(&mut self, adapter: Shared<Adapter>);

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

impl Readable for Ling {
    type Pose = JointState;

    const KIND: Option<ArmKind> = Some(ArmKind::Ling);

    fn name(&self) -> &str {
        self.name()
    }

    fn adapter(&self) -> Result<Option<Adapter>, Error> {
        self.find_adapter()
    }

    fn lend(&mut self, adapter: Shared<Adapter>) {
        self.lend_adapter(adapter);
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

impl Readable for XArm {
    type Pose = XArmPose;

    const KIND: Option<ArmKind> = None;

    fn name(&self) -> &str {
        self.name()
    }

    fn adapter(&self) -> Result<Option<Adapter>, Error> {
        Ok(None)
    }

    fn lend(&mut self, _: Shared<Adapter>) {}

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
