//! The calls of an xArm, each with the answer it gets.

use core::fmt;

use embedded_io_async::{Read, Write};

use super::{
    Command, Header, Joint, MAX_FRAME, ParseError, ProtocolId, Raw, Reply, Request, Response, RotationRadius,
    SerialsText, State, TorqueSource, Transactions, VersionText, XArm,
};
use crate::Config;
use crate::driver::{self, Clock, Counters, Driver};

/// An xArm at the other end of a TCP connection.
///
/// Every call fails with [`ArmError`]. What the arm says of its own state comes with every answer: a warning or an
/// error of the arm does not make its answer wrong. See [`Driver`] on dropping a call.
///
/// It is a type of its own, where those of the other protocols are names for [`Driver`], because it counts the
/// transactions and gives the state with every answer.
///
/// ```
/// # use armwire::driver::Clock;
/// # use embedded_io_async::{Read, Write};
/// use armwire::Config;
/// use armwire::xarm::{Arm, ArmError, State};
///
/// async fn is_well<P: Read + Write>(connection: P, clock: impl Clock) -> Result<bool, ArmError<P::Error>> {
///     let mut arm = Arm::new(connection, clock, Config::TCP);
///     let version = arm.read_version().await?;
///     Ok(version.value.version().is_ok() && version.state == State::OK)
/// }
/// ```
///
/// All the calls:
///
/// ```
#[doc = include_str!("../../doc/xarm_tour.rs")]
/// ```
pub struct Arm<Port, C> {
    driver: Driver<XArm, Port, C, MAX_FRAME>,
    transactions: Transactions,
    protocol: ProtocolId,
}

/// What the arm answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Answer<T> {
    /// What was asked for.
    pub value: T,
    /// How the arm is.
    pub state: State,
}

/// Why a call to an xArm got no answer: `E` is the error of the port.
pub type CallError<E> = driver::CallError<E, ParseError>;

/// Why a call failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum ArmError<E> {
    /// There was no answer, or none that can be accepted.
    Call(CallError<E>),
    /// The arm answered, but that its state is invalid, or without what was asked for.
    Refused(State),
}

impl<E> From<CallError<E>> for ArmError<E> {
    fn from(error: CallError<E>) -> Self {
        Self::Call(error)
    }
}

impl<E: fmt::Display> fmt::Display for ArmError<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Call(error) => error.fmt(f),
            Self::Refused(state) => write!(f, "the arm refused, its state: {state}"),
        }
    }
}

impl<E: core::error::Error + 'static> core::error::Error for ArmError<E> {
    fn source(&self) -> Option<&(dyn core::error::Error + 'static)> {
        match self {
            Self::Call(error) => error.source(),
            Self::Refused(_) => None,
        }
    }
}

impl<Port: Read + Write, C: Clock> Arm<Port, C> {
    /// The arm at the other end of `port`, in protocol id 2. [`Config::TCP`] suits.
    pub const fn new(port: Port, clock: C, config: Config) -> Self {
        Self {
            driver: Driver::new(port, clock, config),
            transactions: Transactions::new(),
            protocol: ProtocolId::Private,
        }
    }

    /// Makes every later call in this protocol id.
    pub const fn set_protocol(&mut self, protocol: ProtocolId) {
        self.protocol = protocol;
    }

    /// What the arm is and what runs on it.
    pub async fn read_version(&mut self) -> Result<Answer<VersionText>, ArmError<Port::Error>> {
        let reply = |reply| match reply {
            Reply::Version(text) => Some(text),
            _ => None,
        };
        self.call(Command::ReadVersion, reply).await
    }

    /// The serial numbers of the arm and of its control box.
    pub async fn read_serials(&mut self) -> Result<Answer<SerialsText>, ArmError<Port::Error>> {
        let reply = |reply| match reply {
            Reply::Serials(text) => Some(text),
            _ => None,
        };
        self.call(Command::ReadSerials, reply).await
    }

    /// What the arm reports as the torque of its joints.
    pub async fn read_torque_source(&mut self) -> Result<Answer<TorqueSource>, ArmError<Port::Error>> {
        let reply = |reply| match reply {
            Reply::TorqueSource(source) => Some(source),
            _ => None,
        };
        self.call(Command::ReadTorqueSource, reply).await
    }

    /// The radius of rotation of a joint relative to the tool.
    pub async fn read_rotation_radius(
        &mut self,
        joint: Joint,
    ) -> Result<Answer<RotationRadius>, ArmError<Port::Error>> {
        let reply = |reply| match reply {
            Reply::RotationRadius(radius) => Some(radius),
            _ => None,
        };
        self.call(Command::ReadRotationRadius(joint), reply).await
    }

    /// Reloads the friction parameters.
    pub async fn reload_dynamics(&mut self) -> Result<Answer<()>, ArmError<Port::Error>> {
        self.call(Command::ReloadDynamics, done).await
    }

    /// Shuts the arm's operating system down.
    pub async fn shut_down(&mut self) -> Result<Answer<()>, ArmError<Port::Error>> {
        self.call(Command::Shutdown, done).await
    }

    /// Restarts the arm's operating system.
    pub async fn reboot(&mut self) -> Result<Answer<()>, ArmError<Port::Error>> {
        self.call(Command::Reboot, done).await
    }

    /// Asks any other register, and waits 10 s for the answer: see [`Command::Raw`] for registers that take longer.
    pub async fn raw(&mut self, request: Raw) -> Result<Answer<Raw>, ArmError<Port::Error>> {
        let reply = |reply| match reply {
            Reply::Raw(raw) => Some(raw),
            _ => None,
        };
        self.call(Command::Raw(request), reply).await
    }

    /// Says that the host is there. The arm does not answer.
    pub async fn heartbeat(&mut self) -> Result<(), ArmError<Port::Error>> {
        self.driver.call(Request::Heartbeat).await?;
        Ok(())
    }

    /// What was heard besides answers, since the connection was made.
    pub const fn counters(&self) -> Counters {
        self.driver.counters()
    }

    /// The port and the clock.
    pub fn into_parts(self) -> (Port, C) {
        self.driver.into_parts()
    }

    async fn call<T>(
        &mut self,
        command: Command,
        value: fn(Reply) -> Option<T>,
    ) -> Result<Answer<T>, ArmError<Port::Error>> {
        let header = Header {
            transaction: self.transactions.next_id(),
            protocol: self.protocol,
        };
        let (state, reply) = self
            .driver
            .read(Request::Call { header, command }, |response| match response {
                Response::Reply { state, reply, .. } => Some((state, reply)),
                _ => None,
            })
            .await?;
        match value(reply) {
            Some(value) if !state.contains(State::INVALID) => Ok(Answer { value, state }),
            _ => Err(ArmError::Refused(state)),
        }
    }
}

impl<Port, C> fmt::Debug for Arm<Port, C> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Arm")
            .field("driver", &self.driver)
            .field("transactions", &self.transactions)
            .field("protocol", &self.protocol)
            .finish()
    }
}

/// The answer of a register that has nothing to say but that it is done.
fn done(reply: Reply) -> Option<()> {
    matches!(reply, Reply::Empty(_) | Reply::SystemControl(_)).then_some(())
}
