//! Typed calls to an Alpha1 and its servos.

use core::fmt;

use embedded_io_async::{Read, Write};

use super::{
    Action, Address, Alpha1, Angle, FirmwareVersion, Interval, Led, MAX_FRAME, MoveTime, Offset, OffsetTool, Outcome,
    Request, Response, ServoAngles, ServoId, ServoRequest, ServoResponse, ServoStates, Text, UsbType,
};
use crate::Config;
use crate::driver::{CallError, Clock, Counters, Driver};

/// An Alpha1, or a bus of its servos, at the other end of a port.
///
/// Every call fails with [`CallError`], also if the robot or the servo reports a failure. Reads are repeated after a
/// timeout, except for [`read_servo_angles`](Self::read_servo_angles). Requests to all servos have no answer: their call
/// returns after the write. See [`Driver`](crate::driver::Driver) for dropping a call.
///
/// The servo bus has 115 200 baud: set it in the [`Config`](crate::Config).
///
/// ```
/// # use armwire::driver::Clock;
/// # use embedded_io_async::{Read, Write};
/// use core::num::NonZeroU32;
///
/// use armwire::Config;
/// use armwire::alpha1::{Arm, Text};
/// use armwire::driver::CallError;
///
/// async fn play<P: Read + Write>(port: P, clock: impl Clock, name: Text<'_>) -> Result<(), CallError<P::Error>> {
///     let baud = NonZeroU32::new(115_200);
///     let mut arm = Arm::new(port, clock, Config { baud, ..Config::DEFAULT });
///     arm.stop().await?;
///     arm.play(name).await
/// }
/// ```
///
/// All calls to a robot:
///
/// ```
#[doc = include_str!("../../doc/alpha1_robot.rs")]
/// ```
///
/// All calls to a servo:
///
/// ```
#[doc = include_str!("../../doc/alpha1_servo.rs")]
/// ```
pub struct Arm<Port, C> {
    driver: Driver<Alpha1, Port, C, MAX_FRAME>,
}

impl<Port: Read + Write, C: Clock> Arm<Port, C> {
    /// The robot, or the bus of servos, at the other end of `port`.
    pub const fn new(port: Port, clock: C, config: Config) -> Self {
        Self {
            driver: Driver::new(Alpha1, port, clock, config),
        }
    }

    /// Reads the robot's hardware version, up to 254 bytes, and returns the result of `take`.
    pub async fn read_hardware_version<T>(
        &mut self,
        take: impl FnOnce(Text<'_>) -> T,
    ) -> Result<T, CallError<Port::Error>> {
        self.read(&Request::ReadHardwareVersion, |response| {
            response.try_into().ok().map(take)
        })
        .await
    }

    /// Reads the robot's firmware version.
    pub async fn read_firmware_version(&mut self) -> Result<FirmwareVersion, CallError<Port::Error>> {
        self.read(&Request::ReadFirmwareVersion, |response| response.try_into().ok())
            .await
    }

    /// Reads the servo states: running or powered off.
    pub async fn read_servo_states(&mut self) -> Result<ServoStates, CallError<Port::Error>> {
        self.read(&Request::ReadServoStates, |response| response.try_into().ok())
            .await
    }

    /// Moves all servos.
    pub async fn act(&mut self, action: Action) -> Result<(), CallError<Port::Error>> {
        self.read(&Request::Act(action), done).await
    }

    /// Plays the action of this name.
    pub async fn play(&mut self, name: Text<'_>) -> Result<(), CallError<Port::Error>> {
        self.read(&Request::Play(name), done).await
    }

    /// Stops the current action.
    pub async fn stop(&mut self) -> Result<(), CallError<Port::Error>> {
        self.read(&Request::Stop, done).await
    }

    /// Connects or disconnects the servo offset tool.
    pub async fn set_offset_tool(&mut self, tool: OffsetTool) -> Result<(), CallError<Port::Error>> {
        self.read(&Request::SetOffsetTool(tool), done).await
    }

    /// Sets the robot's USB device type. The port may close.
    pub async fn set_usb_type(&mut self, usb: UsbType) -> Result<(), CallError<Port::Error>> {
        self.read(&Request::SetUsbType(usb), done).await
    }

    /// Moves a servo, or all of them to the same angle.
    pub async fn move_servo(
        &mut self,
        to: Address,
        angle: Angle,
        time: MoveTime,
        lock: Interval,
    ) -> Result<(), CallError<Port::Error>> {
        self.driver
            .send(&Request::Servo(ServoRequest::Move { to, angle, time, lock }))
            .await
    }

    /// Switches the motor of a servo, or of all, off: **a load that it holds falls.**
    pub async fn release_servo(&mut self, to: Address) -> Result<(), CallError<Port::Error>> {
        self.driver.send(&Request::Servo(ServoRequest::Release(to))).await
    }

    /// Switches the LED of a servo, or of all.
    pub async fn set_servo_led(&mut self, to: Address, led: Led) -> Result<(), CallError<Port::Error>> {
        self.driver
            .send(&Request::Servo(ServoRequest::SetLed { to, led }))
            .await
    }

    /// Reads the target and the actual angle of a servo. **The servo switches its motor off to answer: a
    /// load that it holds falls.**
    pub async fn read_servo_angles(&mut self, servo: ServoId) -> Result<ServoAngles, CallError<Port::Error>> {
        self.read(&Request::Servo(ServoRequest::ReadAngles(servo)), |response| {
            response.try_into().ok()
        })
        .await
    }

    /// Changes a servo's id.
    pub async fn change_servo_id(&mut self, from: ServoId, to: ServoId) -> Result<(), CallError<Port::Error>> {
        self.read(&Request::Servo(ServoRequest::ChangeId { from, to }), done)
            .await
    }

    /// Sets a servo's zero offset.
    pub async fn set_servo_offset(&mut self, servo: ServoId, offset: Offset) -> Result<(), CallError<Port::Error>> {
        self.read(&Request::Servo(ServoRequest::SetOffset(servo, offset)), done)
            .await
    }

    /// Reads a servo's zero offset, in thirds of a degree.
    pub async fn read_servo_offset(&mut self, servo: ServoId) -> Result<i16, CallError<Port::Error>> {
        self.read(
            &Request::Servo(ServoRequest::ReadOffset(servo)),
            |response| match response {
                Response::Servo(ServoResponse::Offset { thirds, .. }) => Some(thirds),
                _ => None,
            },
        )
        .await
    }

    /// Reads the version of a servo's firmware.
    pub async fn read_servo_version(&mut self, servo: ServoId) -> Result<[u8; 4], CallError<Port::Error>> {
        self.read(
            &Request::Servo(ServoRequest::ReadVersion(servo)),
            |response| match response {
                Response::Servo(ServoResponse::Version { version, .. }) => Some(version),
                _ => None,
            },
        )
        .await
    }

    /// Sends a request and returns its answer, unless it reports a failure.
    async fn read<T>(
        &mut self,
        request: &Request<'_>,
        take: impl FnOnce(Response<'_>) -> Option<T>,
    ) -> Result<T, CallError<Port::Error>> {
        let answer = self.driver.read(request, |response| match response.outcome() {
            Some(Outcome::Failure) => Some(Err(CallError::Failed)),
            _ => take(response).map(Ok),
        });
        answer.await?
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

/// A response without further data.
fn done(response: Response<'_>) -> Option<()> {
    Outcome::try_from(response).ok().map(|_| ())
}
