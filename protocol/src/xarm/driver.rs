//! Typed calls to an xArm.

use core::fmt;

use embedded_io_async::{Read, Write};

use super::{
    Answer, Joint, MAX_FRAME, ProtocolId, Raw, Reply, Request, Response, RotationRadius, SerialsText, State,
    TorqueSource, VersionText, XArm,
};
use crate::Config;
use crate::driver::{CallError, Clock, Counters, Driver};

/// An xArm at the other end of a TCP connection.
///
/// Every call fails with [`CallError`], also if the arm refuses it. Every answer contains the arm's state: a warning or
/// an error of the arm does not invalidate the answer. See [`Driver`] for dropping a call.
///
/// ```
/// # use armwire::driver::Clock;
/// # use embedded_io_async::{Read, Write};
/// use armwire::Config;
/// use armwire::driver::CallError;
/// use armwire::xarm::{Arm, State};
///
/// async fn is_well<P: Read + Write>(connection: P, clock: impl Clock) -> Result<bool, CallError<P::Error>> {
///     let mut arm = Arm::new(connection, clock, Config::TCP);
///     let version = arm.read_version(|text| text.version().is_ok()).await?;
///     Ok(version.value && version.state == State::OK)
/// }
/// ```
///
/// All calls:
///
/// ```
#[doc = include_str!("../../doc/xarm_tour.rs")]
/// ```
pub struct Arm<Port, C> {
    driver: Driver<XArm, Port, C, MAX_FRAME>,
}

impl<Port: Read + Write, C: Clock> Arm<Port, C> {
    /// The arm at the other end of `port`, with protocol id 2. [`Config::TCP`] is a suitable configuration.
    pub const fn new(port: Port, clock: C, config: Config) -> Self {
        Self {
            driver: Driver::new(XArm::PRIVATE, port, clock, config),
        }
    }

    /// Sets the protocol id of all later calls.
    pub const fn set_protocol(&mut self, protocol: ProtocolId) {
        self.driver.messages_mut().protocol = protocol;
    }

    /// Reads the kind of the arm and the versions of its software, and returns the result of `take`.
    pub async fn read_version<T>(
        &mut self,
        take: impl FnOnce(VersionText<'_>) -> T,
    ) -> Result<Answer<T>, CallError<Port::Error>> {
        self.call(Request::ReadVersion, |reply| reply.try_into().ok().map(take))
            .await
    }

    /// Reads the serial numbers of the arm and of its control box, and returns the result of `take`.
    pub async fn read_serials<T>(
        &mut self,
        take: impl FnOnce(SerialsText<'_>) -> T,
    ) -> Result<Answer<T>, CallError<Port::Error>> {
        self.call(Request::ReadSerials, |reply| reply.try_into().ok().map(take))
            .await
    }

    /// Reads the quantity that the arm reports as the torque of its joints.
    pub async fn read_torque_source(&mut self) -> Result<Answer<TorqueSource>, CallError<Port::Error>> {
        self.call(Request::ReadTorqueSource, |reply| reply.try_into().ok())
            .await
    }

    /// Reads the radius of rotation of a joint relative to the tool.
    pub async fn read_rotation_radius(
        &mut self,
        joint: Joint,
    ) -> Result<Answer<RotationRadius>, CallError<Port::Error>> {
        self.call(Request::ReadRotationRadius(joint), |reply| reply.try_into().ok())
            .await
    }

    /// Reloads the friction parameters.
    pub async fn reload_dynamics(&mut self) -> Result<Answer<()>, CallError<Port::Error>> {
        self.call(Request::ReloadDynamics, |reply| reply.try_into().ok()).await
    }

    /// Shuts the arm's operating system down.
    pub async fn shut_down(&mut self) -> Result<Answer<()>, CallError<Port::Error>> {
        self.call(Request::Shutdown, |reply| reply.try_into().ok()).await
    }

    /// Restarts the arm's operating system.
    pub async fn reboot(&mut self) -> Result<Answer<()>, CallError<Port::Error>> {
        self.call(Request::Reboot, |reply| reply.try_into().ok()).await
    }

    /// Calls any other register, waits 10 s for the answer, and returns the result of `take`. See [`Request::Raw`] for
    /// registers that take longer.
    pub async fn raw<T>(
        &mut self,
        request: Raw<'_>,
        take: impl FnOnce(Raw<'_>) -> T,
    ) -> Result<Answer<T>, CallError<Port::Error>> {
        self.call(Request::Raw(request), |reply| reply.try_into().ok().map(take))
            .await
    }

    /// Sends a heartbeat. The arm does not answer.
    pub async fn heartbeat(&mut self) -> Result<(), CallError<Port::Error>> {
        self.driver.send(&Request::Heartbeat).await
    }

    async fn call<T>(
        &mut self,
        request: Request<'_>,
        take: impl FnOnce(Reply<'_>) -> Option<T>,
    ) -> Result<Answer<T>, CallError<Port::Error>> {
        let take = |response: Response<'_>| match response {
            Response::Reply { state, reply } => Some((state, take(reply))),
            _ => None,
        };
        let (state, value) = self.driver.read(&request, take).await?;
        match value {
            Some(value) if !state.contains(State::INVALID) => Ok(Answer { value, state }),
            _ => Err(CallError::Refused(state)),
        }
    }
    /// The counts of received frames and bytes other than answers, since the arm was created.
    pub const fn counters(&self) -> Counters {
        self.driver.counters()
    }

    /// The frame that ended the last call: an answer, which may have more bytes than its response contains, or an error
    /// frame. Empty if the call ended without one.
    pub fn frame(&self) -> &[u8] {
        self.driver.frame()
    }

    /// The port and the clock.
    pub fn into_parts(self) -> (Port, C) {
        self.driver.into_parts()
    }
}

impl<Port, C> fmt::Debug for Arm<Port, C> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Arm").field("driver", &self.driver).finish()
    }
}
