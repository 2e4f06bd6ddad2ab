//! An Alpha1 or its servos on a port.

use std::num::NonZeroU32;
use std::time::Duration;

use armwire::alpha1::{
    Action, Address, Alpha1, Angle, FirmwareVersion, Interval, Led, MoveTime, Offset, OffsetTool, Outcome, Request,
    Response, SERVOS, ServoId, ServoRequest, ServoResponse, ServoStates, Text, UsbType,
};
use armwire_host::{Link, Port};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::error::value_error;
use crate::session::{Session, call, interruptible, recovery_warning, send, warn};

/// An Alpha1 or its servos on a port. Servo 0 addresses all of them.
#[pyclass(frozen, module = "armwire._armwire")]
pub(crate) struct Alpha1Port(Session<Link<Alpha1>>);

#[pymethods]
impl Alpha1Port {
    #[new]
    fn new(py: Python<'_>, port: &str, baud: Option<NonZeroU32>) -> PyResult<Self> {
        let port: Port = port.parse().map_err(value_error)?;
        let mut warning = None;
        let open = || {
            let connection = port.connect(baud)?;
            warning = recovery_warning(&connection);
            Ok(interruptible(connection.alpha1()?))
        };
        let session = Session::open(py, open)?;
        warn(py, warning)?;
        Ok(Self(session))
    }

    fn close(&self, py: Python<'_>) -> PyResult<()> {
        self.0.close(py)
    }

    fn read_hardware_version<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let version = self.call(py, Request::ReadHardwareVersion, |response| {
            Text::try_from(response).ok().map(|version| version.as_bytes().to_vec())
        })?;
        Ok(PyBytes::new(py, &version))
    }

    fn read_firmware_version<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let version = self.call(py, Request::ReadFirmwareVersion, |response| {
            FirmwareVersion::try_from(response).ok()
        })?;
        Ok(PyBytes::new(py, &version.text))
    }

    /// The numbers of the running servos.
    fn read_running_servos(&self, py: Python<'_>) -> PyResult<Vec<u16>> {
        let states = self.call(py, Request::ReadServoStates, |response| {
            ServoStates::try_from(response).ok()
        })?;
        Ok(states.running().map(u16::from).collect())
    }

    /// Moves the servos to angles in degrees; `None` may release a servo. Times are in seconds.
    fn act(&self, py: Python<'_>, angles: [Option<u8>; SERVOS], time_s: f64, interval_s: f64) -> PyResult<()> {
        let mut action = Action {
            angles: [None; SERVOS],
            time: move_time(time_s)?,
            interval: interval(interval_s)?,
        };
        for (angle, degrees) in action.angles.iter_mut().zip(angles) {
            *angle = degrees.map(Angle::new).transpose().map_err(value_error)?;
        }
        self.call(py, Request::Act(action), done)
    }

    fn play(&self, py: Python<'_>, name: &[u8]) -> PyResult<()> {
        let name = Text::new(name).map_err(value_error)?;
        self.call(py, Request::Play(name), done)
    }

    fn stop(&self, py: Python<'_>) -> PyResult<()> {
        self.call(py, Request::Stop, done)
    }

    fn set_offset_tool(&self, py: Python<'_>, connected: bool) -> PyResult<()> {
        let tool = if connected {
            OffsetTool::Connect
        } else {
            OffsetTool::Disconnect
        };
        self.call(py, Request::SetOffsetTool(tool), done)
    }

    /// Sets the USB device type: `disk`, `serial` or `hid`.
    fn set_usb_type(&self, py: Python<'_>, usb: &str) -> PyResult<()> {
        let usb = match usb {
            "disk" => UsbType::Disk,
            "serial" => UsbType::SerialPort,
            "hid" => UsbType::Hid,
            _ => {
                return Err(value_error(format_args!(
                    "USB type is '{usb}', must be disk, serial or hid"
                )));
            }
        };
        self.call(py, Request::SetUsbType(usb), done)
    }

    fn move_servo(&self, py: Python<'_>, servo: u8, degrees: u8, time_s: f64, lock_s: f64) -> PyResult<()> {
        let request = ServoRequest::Move {
            to: address(servo)?,
            angle: Angle::new(degrees).map_err(value_error)?,
            time: move_time(time_s)?,
            lock: interval(lock_s)?,
        };
        self.send_servo(py, request)
    }

    fn release_servo(&self, py: Python<'_>, servo: u8) -> PyResult<()> {
        self.send_servo(py, ServoRequest::Release(address(servo)?))
    }

    fn set_servo_led(&self, py: Python<'_>, servo: u8, led: u8) -> PyResult<()> {
        let request = ServoRequest::SetLed {
            to: address(servo)?,
            led: Led(led),
        };
        self.send_servo(py, request)
    }

    /// Target and actual angle, in degrees.
    fn read_servo_angles(&self, py: Python<'_>, servo: u8) -> PyResult<(u16, u16)> {
        self.call_servo(py, ServoRequest::ReadAngles(id(servo)?), |response| match response {
            ServoResponse::Angles { target, actual, .. } => Some((target, actual)),
            _ => None,
        })
    }

    fn change_servo_id(&self, py: Python<'_>, servo: u8, to: u8) -> PyResult<()> {
        let request = ServoRequest::ChangeId {
            from: id(servo)?,
            to: id(to)?,
        };
        self.call(py, Request::Servo(request), done)
    }

    /// In thirds of a degree.
    fn set_servo_offset(&self, py: Python<'_>, servo: u8, thirds: i16) -> PyResult<()> {
        let offset = Offset::new(thirds).map_err(value_error)?;
        self.call(py, Request::Servo(ServoRequest::SetOffset(id(servo)?, offset)), done)
    }

    /// In thirds of a degree.
    fn read_servo_offset(&self, py: Python<'_>, servo: u8) -> PyResult<i16> {
        self.call_servo(py, ServoRequest::ReadOffset(id(servo)?), |response| match response {
            ServoResponse::Offset { thirds, .. } => Some(thirds),
            _ => None,
        })
    }

    fn read_servo_version<'py>(&self, py: Python<'py>, servo: u8) -> PyResult<Bound<'py, PyBytes>> {
        let request = ServoRequest::ReadVersion(id(servo)?);
        let version = self.call_servo(py, request, |response| match response {
            ServoResponse::Version { version, .. } => Some(version),
            _ => None,
        })?;
        Ok(PyBytes::new(py, &version))
    }
}

impl Alpha1Port {
    fn call<T: Send>(
        &self,
        py: Python<'_>,
        request: Request<'_>,
        take: impl FnOnce(Response<'_>) -> Option<T> + Send,
    ) -> PyResult<T> {
        self.0.with(py, |link| call(link, &request, take))
    }

    fn call_servo<T: Send>(
        &self,
        py: Python<'_>,
        request: ServoRequest,
        take: impl FnOnce(ServoResponse) -> Option<T> + Send,
    ) -> PyResult<T> {
        self.call(py, Request::Servo(request), |response| {
            response.try_into().ok().and_then(take)
        })
    }

    /// Sends a request that a single servo acknowledges. Servo 0 has no acknowledgement.
    fn send_servo(&self, py: Python<'_>, request: ServoRequest) -> PyResult<()> {
        self.0.with(py, |link| send(link, &Request::Servo(request)))
    }
}

/// A response without data. `call` has checked its outcome.
fn done(response: Response<'_>) -> Option<()> {
    Outcome::try_from(response).ok().map(|_| ())
}

pub(crate) fn id(servo: u8) -> PyResult<ServoId> {
    ServoId::new(servo).map_err(value_error)
}

fn address(servo: u8) -> PyResult<Address> {
    match servo {
        0 => Ok(Address::All),
        servo => id(servo).map(Address::One),
    }
}

fn move_time(seconds: f64) -> PyResult<MoveTime> {
    MoveTime::from_duration(duration(seconds)?).map_err(value_error)
}

fn interval(seconds: f64) -> PyResult<Interval> {
    Interval::from_duration(duration(seconds)?).map_err(value_error)
}

fn duration(seconds: f64) -> PyResult<Duration> {
    let wrong = |_| value_error(format_args!("duration {seconds} s is out of range"));
    Duration::try_from_secs_f64(seconds).map_err(wrong)
}
