//! An Alpha1, or its servos: their requests.

use std::fmt;

use armwire::alpha1::{
    Action, Address, Angle, FirmwareVersion, Interval, Led, MoveTime, Offset, OffsetTool, Outcome, Request, Response,
    ServoAngles, ServoId, ServoRequest, ServoResponse, ServoStates, Text, UsbType,
};

use crate::error::Error;
use crate::ports::interrupt::Interrupt;
use crate::ports::link::{LineErrors, Link};
use crate::ports::port::Connection;

/// An Alpha1 on a port, or its servos' bus, which [`Connection::alpha1`] opens.
///
/// Every call fails with an [`Error`]: [`Error::Refused`] if the robot or the servo reports a failure.
pub struct Alpha1 {
    link: Link<armwire::alpha1::Alpha1>,
    connection: Connection,
}

impl Connection {
    /// Opens the line of an Alpha1.
    ///
    /// # Errors
    ///
    /// The line cannot be opened.
    pub fn alpha1(&self) -> Result<Alpha1, Error> {
        Ok(Alpha1 {
            link: self.arm()?,
            connection: self.clone(),
        })
    }
}

impl Alpha1 {
    /// Reads the robot's hardware version, up to 254 bytes.
    pub fn read_hardware_version(&mut self) -> Result<Vec<u8>, Error> {
        self.link.read_with(&Request::ReadHardwareVersion, |response| {
            Text::try_from(response).ok().map(|version| version.as_bytes().to_vec())
        })
    }

    /// Reads the robot's firmware version.
    pub fn read_firmware_version(&mut self) -> Result<FirmwareVersion, Error> {
        self.link.read(&Request::ReadFirmwareVersion)
    }

    /// Reads the servo states: running or powered off.
    pub fn read_servo_states(&mut self) -> Result<ServoStates, Error> {
        self.link.read(&Request::ReadServoStates)
    }

    /// Moves all servos.
    pub fn act(&mut self, action: Action) -> Result<(), Error> {
        self.link.read_with(&Request::Act(action), done)
    }

    /// Plays the action of this name.
    pub fn play(&mut self, name: Text<'_>) -> Result<(), Error> {
        self.link.read_with(&Request::Play(name), done)
    }

    /// Stops the current action.
    pub fn stop(&mut self) -> Result<(), Error> {
        self.link.read_with(&Request::Stop, done)
    }

    /// Connects or disconnects the servo offset tool.
    pub fn set_offset_tool(&mut self, tool: OffsetTool) -> Result<(), Error> {
        self.link.read_with(&Request::SetOffsetTool(tool), done)
    }

    /// Sets the robot's USB device type. The port may close.
    pub fn set_usb_type(&mut self, usb: UsbType) -> Result<(), Error> {
        self.link.read_with(&Request::SetUsbType(usb), done)
    }

    /// Moves a servo, or all of them to the same angle.
    pub fn move_servo(&mut self, to: Address, angle: Angle, time: MoveTime, lock: Interval) -> Result<(), Error> {
        self.send_servo(ServoRequest::Move { to, angle, time, lock })
    }

    /// Switches the motor of a servo, or of all, off: **a load that it holds falls.**
    pub fn release_servo(&mut self, to: Address) -> Result<(), Error> {
        self.send_servo(ServoRequest::Release(to))
    }

    /// Switches the LED of a servo, or of all.
    pub fn set_servo_led(&mut self, to: Address, led: Led) -> Result<(), Error> {
        self.send_servo(ServoRequest::SetLed { to, led })
    }

    /// Reads the target and the actual angle of a servo. **The servo switches its motor off to answer: a load
    /// that it holds falls.**
    pub fn read_servo_angles(&mut self, servo: ServoId) -> Result<ServoAngles, Error> {
        self.link.read(&Request::Servo(ServoRequest::ReadAngles(servo)))
    }

    /// Changes a servo's id.
    pub fn change_servo_id(&mut self, from: ServoId, to: ServoId) -> Result<(), Error> {
        self.read_servo(ServoRequest::ChangeId { from, to }, |response| {
            matches!(response, ServoResponse::IdChanged { .. }).then_some(())
        })
    }

    /// Sets a servo's zero offset.
    pub fn set_servo_offset(&mut self, servo: ServoId, offset: Offset) -> Result<(), Error> {
        self.read_servo(ServoRequest::SetOffset(servo, offset), |response| {
            matches!(response, ServoResponse::OffsetSet { .. }).then_some(())
        })
    }

    /// Reads a servo's zero offset, in thirds of a degree.
    pub fn read_servo_offset(&mut self, servo: ServoId) -> Result<i16, Error> {
        self.read_servo(ServoRequest::ReadOffset(servo), |response| match response {
            ServoResponse::Offset { thirds, .. } => Some(thirds),
            _ => None,
        })
    }

    /// Reads the version of a servo's firmware.
    pub fn read_servo_version(&mut self, servo: ServoId) -> Result<[u8; 4], Error> {
        self.read_servo(ServoRequest::ReadVersion(servo), |response| match response {
            ServoResponse::Version { version, .. } => Some(version),
            _ => None,
        })
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

    /// Errors on the line so far.
    pub fn line_errors(&self) -> LineErrors {
        self.link.line_errors()
    }

    /// Adds to an error what others know: see [`Connection::explain`].
    #[must_use]
    pub fn explain(&self, error: Error) -> Error {
        self.connection.explain(error)
    }

    /// The robot's link, for any request.
    pub fn link(&mut self) -> &mut Link<armwire::alpha1::Alpha1> {
        &mut self.link
    }

    /// The robot's link alone.
    pub fn into_link(self) -> Link<armwire::alpha1::Alpha1> {
        self.link
    }

    fn read_servo<T>(
        &mut self,
        request: ServoRequest,
        take: impl FnOnce(ServoResponse) -> Option<T>,
    ) -> Result<T, Error> {
        self.link.read_with(&Request::Servo(request), |response| {
            response.try_into().ok().and_then(take)
        })
    }

    /// Sends a request that a single servo acknowledges. All servos together do not.
    fn send_servo(&mut self, request: ServoRequest) -> Result<(), Error> {
        self.link.send(&Request::Servo(request))
    }
}

impl fmt::Debug for Alpha1 {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Alpha1")
            .field("name", &self.name())
            .finish_non_exhaustive()
    }
}

/// A response without data. `Link::read_with` has checked its outcome.
fn done(response: Response<'_>) -> Option<()> {
    Outcome::try_from(response).ok().map(|_| ())
}
