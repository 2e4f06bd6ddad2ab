//! An xArm on a host: its requests.

use std::fmt;
use std::time::Instant;

use armwire::xarm::{
    Answer, Joint, ProtocolId, Raw, Reply, Request, Response, RotationRadius, SerialsText, State, TorqueSource,
    VersionText,
};

use crate::arm::pose::{OnPose, XArmPose};
use crate::describe::Arm as _;
use crate::describe::xarm::{POSITIONS, positions_in};
use crate::error::Error;
use crate::error::outside::Outside;
use crate::ports::interrupt::Interrupt;
use crate::ports::link::{LineErrors, Link};
use crate::ports::tcp::{Tcp, TcpAddress};

/// An xArm on a host.
///
/// Every call fails with an [`Error`]: [`Error::Refused`] if the arm reports an invalid state. It has no request that
/// stops it.
pub struct XArm {
    link: Link<armwire::xarm::XArm>,
    host: TcpAddress,
    /// The serial numbers. Empty before they were read.
    serials: Vec<u8>,
    /// Gets each reading of the joints.
    pub(crate) on_pose: Option<OnPose<XArmPose>>,
}

impl XArm {
    /// Connects to the control port of an arm.
    ///
    /// # Errors
    ///
    /// The host cannot be connected to.
    pub fn connect(host: &TcpAddress) -> Result<Self, Error> {
        let line = Box::new(Tcp::connect(host, false)?);
        Ok(Self {
            link: Link::new(line, armwire::xarm::XArm::CONFIG),
            host: host.clone(),
            serials: Vec::new(),
            on_pose: None,
        })
    }

    /// Reads the serial numbers, by which the arm is known after its connection was lost.
    pub(crate) fn identify(&mut self) -> Result<(), Error> {
        if self.serials.is_empty() {
            self.serials = self.read_serials(|serials| serials.0.to_vec())?.value;
        }
        Ok(())
    }

    /// Closes the connection. Calls fail with this reason, as [`Error::Lost`].
    pub(crate) fn disconnect(&mut self, reason: Outside) {
        self.link.disconnect(reason);
    }

    /// Connects again, after a loss, and reads whether the arm is the one with the serial numbers that were read before.
    /// After an error the connection is closed.
    pub(crate) fn reopen(&mut self) -> Result<(), Error> {
        let opened = self.open_and_compare();
        if let Err(error) = &opened {
            self.link.disconnect(error.loss());
        }
        opened
    }

    /// Opens the port again as [`reopen`](Self::reopen), without the interrupt.
    pub(crate) fn reopen_uninterrupted(&mut self) -> Result<(), Error> {
        let check = self.link.take_check();
        let opened = self.reopen();
        self.link.set_check(check);
        opened
    }

    fn open_and_compare(&mut self) -> Result<(), Error> {
        self.disconnect("the connection is being opened again".into());
        if self.serials.is_empty() {
            let reason = "the arm's serial numbers were not read before the loss: it may be another arm";
            return Err(Error::lost(self.name(), reason));
        }
        let line = Box::new(Tcp::connect(&self.host, false)?);
        self.link.replace_line(line, armwire::xarm::XArm::CONFIG);
        let now = self.read_serials(|serials| serials.0.to_vec())?.value;
        match self.serials == now {
            true => Ok(()),
            false => Err(Error::lost(self.name(), "another arm is on this host than before")),
        }
    }

    /// Sets the protocol id of later requests.
    pub fn set_protocol(&mut self, protocol: ProtocolId) {
        self.link.messages_mut().protocol = protocol;
    }

    /// Reads the kind of the arm and the versions of its software, and returns the result of `take`.
    pub fn read_version<T>(&mut self, take: impl FnOnce(VersionText<'_>) -> T) -> Result<Answer<T>, Error> {
        self.read(&Request::ReadVersion, |reply| {
            VersionText::try_from(reply).ok().map(take)
        })
    }

    /// Reads the serial numbers of the arm and of its control box, and returns the result of `take`.
    pub fn read_serials<T>(&mut self, take: impl FnOnce(SerialsText<'_>) -> T) -> Result<Answer<T>, Error> {
        self.read(&Request::ReadSerials, |reply| {
            SerialsText::try_from(reply).ok().map(take)
        })
    }

    /// Reads the quantity that the arm reports as the torque of its joints.
    pub fn read_torque_source(&mut self) -> Result<Answer<TorqueSource>, Error> {
        self.link.read(&Request::ReadTorqueSource)
    }

    /// Reads the radius of rotation of a joint relative to the tool.
    pub fn read_rotation_radius(&mut self, joint: Joint) -> Result<Answer<RotationRadius>, Error> {
        self.link.read(&Request::ReadRotationRadius(joint))
    }

    /// Reloads the friction parameters.
    pub fn reload_dynamics(&mut self) -> Result<Answer<()>, Error> {
        self.link.read(&Request::ReloadDynamics)
    }

    /// Shuts the arm's operating system down.
    pub fn shut_down(&mut self) -> Result<Answer<()>, Error> {
        self.link.read(&Request::Shutdown)
    }

    /// Restarts the arm's operating system.
    pub fn reboot(&mut self) -> Result<Answer<()>, Error> {
        self.link.read(&Request::Reboot)
    }

    /// Reads the joint positions once, as one of many readings. Returns false without an answer until this time.
    pub(crate) fn read_joints_until(&mut self, until: Instant) -> Result<bool, Error> {
        let request = Raw::new(POSITIONS, &[]).expect("the document does not have this register");
        // The register is not documented as a read. Answers are numbered: no request waits for an earlier one.
        let pose = self.link.call_until(&Request::Raw(request), until, |response| {
            let Answer { value, state } = Answer::<Raw<'_>>::try_from(response).ok()?;
            let joints = positions_in(value.params())?;
            (!state.contains(State::INVALID)).then_some(XArmPose { joints, state })
        })?;
        match (pose.flatten(), &mut self.on_pose) {
            (None, _) => Ok(false),
            (Some(_), None) => Ok(true),
            (Some(pose), Some(on_pose)) => {
                on_pose(pose, self.link.time_of_state());
                Ok(true)
            }
        }
    }

    /// Calls any other register, waits 10 s for the answer, and returns its parameters.
    pub fn raw(&mut self, request: Raw<'_>) -> Result<Answer<Vec<u8>>, Error> {
        self.read(&Request::Raw(request), |reply| {
            Raw::try_from(reply).ok().map(|raw| raw.params().to_vec())
        })
    }

    /// Sends a heartbeat. The arm does not answer.
    pub fn heartbeat(&mut self) -> Result<(), Error> {
        self.link.send(&Request::Heartbeat)
    }

    /// Makes calls run this check at least every 100 ms while they wait, for Ctrl-C. Its error ends the call, as
    /// [`Error::Interrupted`].
    pub fn set_interrupt(&mut self, check: impl FnMut() -> Interrupt + Send + 'static) {
        self.link.set_interrupt(check);
    }

    /// The port's name, as typed by the user.
    pub fn name(&self) -> &str {
        self.link.name()
    }

    /// Errors on the connection so far.
    pub fn line_errors(&self) -> LineErrors {
        self.link.line_errors()
    }

    /// The arm's link, for any request.
    pub fn link(&mut self) -> &mut Link<armwire::xarm::XArm> {
        &mut self.link
    }

    /// The arm's link alone.
    pub fn into_link(self) -> Link<armwire::xarm::XArm> {
        self.link
    }

    fn read<T>(
        &mut self,
        request: &Request<'_>,
        take: impl FnOnce(Reply<'_>) -> Option<T>,
    ) -> Result<Answer<T>, Error> {
        self.link.read_with(request, |response| match response {
            Response::Reply { state, reply } => take(reply).map(|value| Answer { value, state }),
            _ => None,
        })
    }
}

impl fmt::Debug for XArm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("XArm")
            .field("name", &self.name())
            .finish_non_exhaustive()
    }
}
