//! Typed calls to a Ling arm.

use core::fmt;

use embedded_io_async::{Read, Write};

use super::arrival::{Arrival, Arrived, Tolerances};
use super::mode_change::{self, ModeChange};
use super::stop::{Output, Stopped};
use super::{
    ControlMode, ForceFeedback, Info, JointState, Ling, MAX_FRAME, ModeState, Move, PerServo, Request, Response,
    SelfCheck, Stop, Stroke, TemperatureLimit, Torque,
};
use crate::Config;
use crate::driver::{CallError, Clock, Counters, Driver};
use crate::time::Duration;

/// Time between two readings of an arm in motion.
const PERIOD: Duration = Duration::from_millis(20);

/// A Ling arm at the other end of a port.
///
/// Every call fails with [`CallError`]. Reads are repeated after a timeout. See [`Driver`](crate::driver::Driver) for
/// dropping a call.
///
/// ```
/// # use armwire::driver::Clock;
/// # use embedded_io_async::{Read, Write};
/// use armwire::Config;
/// use armwire::driver::CallError;
/// use armwire::ling::Arm;
///
/// async fn is_sound<P: Read + Write>(port: P, clock: impl Clock) -> Result<bool, CallError<P::Error>> {
///     let mut arm = Arm::new(port, clock, Config::default());
///     let celsius = arm.read_temperatures().await?;
///     let check = arm.self_check().await?;
///     Ok(check.all_normal(celsius.kind()) && celsius.as_slice().iter().all(|&celsius| celsius < 60))
/// }
/// ```
///
/// All calls:
///
/// ```
#[doc = include_str!("../../doc/ling_tour.rs")]
/// ```
pub struct Arm<Port, C> {
    driver: Driver<Ling, Port, C, MAX_FRAME>,
}

impl<Port: Read + Write, C: Clock> Arm<Port, C> {
    /// The arm at the other end of `port`.
    pub const fn new(port: Port, clock: C, config: Config) -> Self {
        Self {
            driver: Driver::new(Ling, port, clock, config),
        }
    }

    /// Reads the arm's kind, serial number and versions.
    pub async fn read_info(&mut self) -> Result<Info, CallError<Port::Error>> {
        self.driver.read(&Request::ReadInfo, value).await
    }

    /// Reads the joint positions, the gripper and the motion status.
    pub async fn read_joints(&mut self) -> Result<JointState, CallError<Port::Error>> {
        self.driver.read(&Request::ReadJoints, value).await
    }

    /// Reads the temperature of every servo, in °C.
    pub async fn read_temperatures(&mut self) -> Result<PerServo<u8>, CallError<Port::Error>> {
        self.driver.read(&Request::ReadTemperatures, value).await
    }

    /// Reads the velocity of every servo, in ticks per second.
    pub async fn read_velocities(&mut self) -> Result<PerServo<u16>, CallError<Port::Error>> {
        self.driver.read(&Request::ReadVelocities, value).await
    }

    /// Reads the configured gripper type.
    pub async fn read_stroke(&mut self) -> Result<Stroke, CallError<Port::Error>> {
        self.driver.read(&Request::ReadStroke, value).await
    }

    /// Runs a self-check of every servo.
    pub async fn self_check(&mut self) -> Result<SelfCheck, CallError<Port::Error>> {
        self.driver.read(&Request::SelfCheck, value).await
    }

    /// Moves the joints and the gripper. The arm does not confirm it: read the joints to follow the motion.
    pub async fn move_to(&mut self, target: Move) -> Result<(), CallError<Port::Error>> {
        self.driver.send(&Request::Move(target)).await
    }

    /// Switches the torque. The arm does not confirm it: a [`ReadBack`](super::ReadBack) does.
    pub async fn set_torque(&mut self, torque: Torque) -> Result<(), CallError<Port::Error>> {
        self.driver.send(&Request::SetTorque(torque)).await
    }

    /// Moves the joints and the gripper, and waits for their [`Arrival`], at most for this time. A lost or unsound answer
    /// does not end it.
    ///
    /// Returns how it ended: [`Arrived::NotYet`] if the arm still moves.
    ///
    /// # Errors
    ///
    /// [`CallError::TimedOut`] without any answer in this time, and errors of the port.
    pub async fn move_and_wait(
        &mut self,
        target: Move,
        tolerances: Tolerances,
        limit: Duration,
    ) -> Result<Arrived, CallError<Port::Error>> {
        self.move_to(target).await?;
        let mut arrival = Arrival::new(target, tolerances);
        let end = self.driver.now() + limit;
        loop {
            let read = self.read_joints().await;
            let now = self.driver.now();
            match read {
                Ok(state) => match arrival.on_joints(now, &state) {
                    Arrived::Resend => self.move_to(target).await?,
                    arrived @ Arrived::NotYet(_) if now >= end => return Ok(arrived),
                    Arrived::NotYet(_) => {}
                    arrived => return Ok(arrived),
                },
                Err(error) if may_pass(&error) && now < end => {}
                Err(error) => return Err(error),
            }
            self.driver.wait_until(now + PERIOD).await;
        }
    }

    /// Stops the arm and keeps its torque on, as this [`Stop`] describes. A lost or unsound answer does not end it.
    ///
    /// # Errors
    ///
    /// [`CallError::NotStopped`] if the arm may still move, and errors of the port.
    pub async fn stop(&mut self, stop: &mut Stop) -> Result<Stopped, CallError<Port::Error>> {
        loop {
            match stop.poll(self.driver.now()) {
                Output::Request(Request::ReadJoints) => match self.read_joints().await {
                    Ok(state) => stop.on_joints(self.driver.now(), &state),
                    Err(error) if may_pass(&error) => {}
                    Err(error) => return Err(error),
                },
                Output::Request(request) => self.driver.send(&request).await?,
                Output::Wait(until) => self.driver.wait_until(until).await,
                Output::Done(result) => return result.map_err(CallError::NotStopped),
            }
        }
    }

    /// Makes the present pose the zero position, and switches the torque off. The arm does not confirm it: a
    /// [`ReadBack`](super::ReadBack) does.
    pub async fn set_zero(&mut self) -> Result<(), CallError<Port::Error>> {
        self.driver.send(&Request::SetZero).await
    }

    /// Sets the gripper type. The arm does not confirm it: verify with [`read_stroke`](Self::read_stroke).
    pub async fn set_stroke(&mut self, stroke: Stroke) -> Result<(), CallError<Port::Error>> {
        self.driver.send(&Request::SetStroke(stroke)).await
    }

    /// Sets the temperature limit of the arm's overheat protection. The arm does not confirm it.
    pub async fn set_temperature_limit(&mut self, limit: TemperatureLimit) -> Result<(), CallError<Port::Error>> {
        self.driver.send(&Request::SetTemperatureLimit(limit)).await
    }

    /// Reads the control mode and the currents of a force-feedback leader.
    ///
    /// # Errors
    ///
    /// [`CallError::TimedOut`] of an arm that is none.
    pub async fn read_mode(&mut self) -> Result<ModeState, CallError<Port::Error>> {
        self.driver.read(&Request::ReadMode, value).await
    }

    /// Sets the control mode of a force-feedback leader, and waits until it is applied, as in [`ModeChange`]. The torque
    /// may be off then.
    ///
    /// # Errors
    ///
    /// [`CallError::ModeNotApplied`]; [`CallError::TimedOut`] of an arm that is no such leader, which gets nothing but
    /// the question for its mode; and errors of the port.
    pub async fn set_mode(&mut self, mode: ControlMode) -> Result<ModeState, CallError<Port::Error>> {
        self.read_mode().await?;
        let mut change = ModeChange::new(mode);
        loop {
            match change.poll(self.driver.now()) {
                mode_change::Output::Request(Request::ReadMode) => match self.read_mode().await {
                    Ok(state) => change.on_mode(self.driver.now(), &state),
                    Err(error) if may_pass(&error) => {}
                    Err(error) => return Err(error),
                },
                mode_change::Output::Request(request) => match self.driver.read(&request, value).await {
                    Ok(reply) => change.on_reply(&reply),
                    Err(error) if may_pass(&error) => {}
                    Err(error) => return Err(error),
                },
                mode_change::Output::Wait(until) => self.driver.wait_until(until).await,
                mode_change::Output::Done(result) => return result.map_err(CallError::ModeNotApplied),
            }
        }
    }

    /// Reads the state of the force feedback of a force-feedback leader.
    ///
    /// # Errors
    ///
    /// [`CallError::TimedOut`] of an arm that is none.
    pub async fn read_force_feedback(&mut self) -> Result<ForceFeedback, CallError<Port::Error>> {
        self.driver.read(&Request::ReadForceFeedback, value).await
    }

    /// Requests the force feedback of a force-feedback leader, or its end. The answer says whether it is effective: with
    /// it the motors push the joints.
    ///
    /// # Errors
    ///
    /// [`CallError::TimedOut`] of an arm that is none, which gets nothing but the question for its mode.
    pub async fn set_force_feedback(&mut self, is_on: bool) -> Result<ForceFeedback, CallError<Port::Error>> {
        self.read_mode().await?;
        self.driver.read(&Request::SetForceFeedback(is_on), value).await
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

/// Returns true if the next reading may succeed: an answer was lost or unsound.
fn may_pass<E>(error: &CallError<E>) -> bool {
    matches!(
        error,
        CallError::TimedOut { .. } | CallError::ErrorFrame(_) | CallError::Unacceptable(_)
    )
}

/// The value of an answer.
fn value<T: TryFrom<Response>>(response: Response) -> Option<T> {
    response.try_into().ok()
}
