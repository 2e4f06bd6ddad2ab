//! The calls of a Ling arm, each with the answer it gets.

use embedded_io_async::{Read, Write};

use super::{
    Info, JointState, Ling, MAX_FRAME, Move, PerServo, Request, Response, SelfCheck, Stroke, TemperatureLimit, Torque,
};
use crate::Config;
use crate::driver::{CallError, Clock, Driver};

/// A Ling arm at the other end of a port.
///
/// Every call fails with [`CallError`]; those that read repeat themselves after silence. See
/// [`Driver`](crate::driver::Driver) on dropping a call.
///
/// ```
/// # use armwire::driver::Clock;
/// # use embedded_io_async::{Read, Write};
/// use armwire::Config;
/// use armwire::driver::CallError;
/// use armwire::ling::Arm;
///
/// async fn is_sound<P: Read + Write>(port: P, clock: impl Clock) -> Result<bool, CallError<P::Error>> {
///     let mut arm = Arm::open(port, clock, Config::default());
///     let celsius = arm.read_temperatures().await?;
///     let check = arm.self_check().await?;
///     Ok(check.all_normal(celsius.kind()) && celsius.as_slice().iter().all(|&celsius| celsius < 60))
/// }
/// ```
///
/// All the calls:
///
/// ```
#[doc = include_str!("../../doc/ling_tour.rs")]
/// ```
pub type Arm<Port, C> = Driver<Ling, Port, C, MAX_FRAME>;

impl<Port: Read + Write, C: Clock> Arm<Port, C> {
    /// The arm at the other end of `port`.
    pub const fn open(port: Port, clock: C, config: Config) -> Self {
        Self::new(Ling, port, clock, config)
    }

    /// Who the arm is.
    pub async fn read_info(&mut self) -> Result<Info, CallError<Port::Error>> {
        self.read(&Request::ReadInfo, |response| match response {
            Response::Info(info) => Some(info),
            _ => None,
        })
        .await
    }

    /// Where the arm is.
    pub async fn read_joints(&mut self) -> Result<JointState, CallError<Port::Error>> {
        self.read(&Request::ReadJoints, |response| match response {
            Response::Joints(state) => Some(state),
            _ => None,
        })
        .await
    }

    /// The temperature of every servo, in °C.
    pub async fn read_temperatures(&mut self) -> Result<PerServo<u8>, CallError<Port::Error>> {
        self.read(&Request::ReadTemperatures, |response| match response {
            Response::Temperatures(celsius) => Some(celsius),
            _ => None,
        })
        .await
    }

    /// The velocity of every servo, in ticks per second.
    pub async fn read_velocities(&mut self) -> Result<PerServo<u16>, CallError<Port::Error>> {
        self.read(&Request::ReadVelocities, |response| match response {
            Response::Velocities(ticks) => Some(ticks),
            _ => None,
        })
        .await
    }

    /// Which gripper the arm thinks it has.
    pub async fn read_stroke(&mut self) -> Result<Stroke, CallError<Port::Error>> {
        self.read(&Request::ReadStroke, |response| match response {
            Response::Stroke(stroke) => Some(stroke),
            _ => None,
        })
        .await
    }

    /// Checks every servo.
    pub async fn self_check(&mut self) -> Result<SelfCheck, CallError<Port::Error>> {
        self.read(&Request::SelfCheck, |response| match response {
            Response::SelfCheck(check) => Some(check),
            _ => None,
        })
        .await
    }

    /// Moves the joints and the gripper. The arm confirms nothing: read the joints to see it move.
    pub async fn move_to(&mut self, target: Move) -> Result<(), CallError<Port::Error>> {
        self.tell(&Request::Move(target)).await
    }

    /// Switches the torque. The arm confirms nothing.
    pub async fn set_torque(&mut self, torque: Torque) -> Result<(), CallError<Port::Error>> {
        self.tell(&Request::SetTorque(torque)).await
    }

    /// Makes the present pose the zero position, and switches the torque off. The arm confirms nothing.
    pub async fn set_zero(&mut self) -> Result<(), CallError<Port::Error>> {
        self.tell(&Request::SetZero).await
    }

    /// Tells the arm which gripper it has. The arm confirms nothing: [`read_stroke`](Self::read_stroke) does.
    pub async fn set_stroke(&mut self, stroke: Stroke) -> Result<(), CallError<Port::Error>> {
        self.tell(&Request::SetStroke(stroke)).await
    }

    /// Sets the temperature at which the arm protects itself. The arm confirms nothing.
    pub async fn set_temperature_limit(&mut self, limit: TemperatureLimit) -> Result<(), CallError<Port::Error>> {
        self.tell(&Request::SetTemperatureLimit(limit)).await
    }
}
