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
use crate::error::outside::Outside;
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

    /// Reads what the arm is known by after its port was lost, if it was not read before.
    ///
    /// # Errors
    ///
    /// As of a call.
    fn identify(&mut self) -> Result<(), Error>;

    /// Closes the port. Calls fail with this reason, as [`Error::Lost`].
    fn disconnect(&mut self, reason: Outside);

    /// Opens the port again without the interrupt, and compares the arm with what [`identify`](Self::identify) has read. Only
    /// reads are sent.
    ///
    /// # Errors
    ///
    /// The port cannot be opened, or the arm does not answer. [`Error::Lost`] if it is another one, or not known.
    fn reopen(&mut self) -> Result<(), Error>;

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

    fn identify(&mut self) -> Result<(), Error> {
        self.identify()
    }

    fn disconnect(&mut self, reason: Outside) {
        self.disconnect(reason);
    }

    fn reopen(&mut self) -> Result<(), Error> {
        self.reopen_uninterrupted()
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

    fn identify(&mut self) -> Result<(), Error> {
        self.identify()
    }

    fn disconnect(&mut self, reason: Outside) {
        self.disconnect(reason);
    }

    fn reopen(&mut self) -> Result<(), Error> {
        self.reopen_uninterrupted()
    }

    fn on_pose(&mut self) -> &mut Option<OnPose<XArmPose>> {
        &mut self.on_pose
    }
}
