//! An Alpha1 or its servos on a port.

use std::num::NonZeroU32;
use std::time::Duration;

use armwire::alpha1::{
    Action, Address, Angle, Interval, Led, MoveTime, Offset, OffsetTool, SERVOS, ServoId, Text, UsbType,
};
use armwire_host::Alpha1;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::error::value_error;
use crate::session::{Session, check_signals};

/// An Alpha1 or its servos on a port. Servo 0 addresses all of them.
#[pyclass(frozen, module = "armwire._armwire")]
pub(crate) struct Alpha1Port(Session<Alpha1>);

#[pymethods]
impl Alpha1Port {
    #[new]
    fn new(py: Python<'_>, port: &str, baud: Option<NonZeroU32>) -> PyResult<Self> {
        let session = Session::of_arm(py, port, baud, |connection| {
            let mut robot = connection.alpha1()?;
            robot.set_interrupt(check_signals);
            Ok(robot)
        })?;
        Ok(Self(session))
    }

    fn close(&self, py: Python<'_>) -> PyResult<()> {
        self.0.close(py)
    }

    fn read_hardware_version<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let version = self.0.with(py, Alpha1::read_hardware_version)?;
        Ok(PyBytes::new(py, &version))
    }

    fn read_firmware_version<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let version = self.0.with(py, Alpha1::read_firmware_version)?;
        Ok(PyBytes::new(py, &version.text))
    }

    /// The numbers of the running servos.
    fn read_running_servos(&self, py: Python<'_>) -> PyResult<Vec<u16>> {
        let states = self.0.with(py, Alpha1::read_servo_states)?;
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
        self.0.with(py, |robot| robot.act(action))
    }

    fn play(&self, py: Python<'_>, name: &[u8]) -> PyResult<()> {
        let name = Text::new(name).map_err(value_error)?;
        self.0.with(py, |robot| robot.play(name))
    }

    fn stop(&self, py: Python<'_>) -> PyResult<()> {
        self.0.with(py, Alpha1::stop)
    }

    fn set_offset_tool(&self, py: Python<'_>, connected: bool) -> PyResult<()> {
        let tool = if connected {
            OffsetTool::Connect
        } else {
            OffsetTool::Disconnect
        };
        self.0.with(py, |robot| robot.set_offset_tool(tool))
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
        self.0.with(py, |robot| robot.set_usb_type(usb))
    }

    fn move_servo(&self, py: Python<'_>, servo: u8, degrees: u8, time_s: f64, lock_s: f64) -> PyResult<()> {
        let (to, angle) = (address(servo)?, Angle::new(degrees).map_err(value_error)?);
        let (time, lock) = (move_time(time_s)?, interval(lock_s)?);
        self.0.with(py, |robot| robot.move_servo(to, angle, time, lock))
    }

    fn release_servo(&self, py: Python<'_>, servo: u8) -> PyResult<()> {
        let to = address(servo)?;
        self.0.with(py, |robot| robot.release_servo(to))
    }

    fn set_servo_led(&self, py: Python<'_>, servo: u8, led: u8) -> PyResult<()> {
        let to = address(servo)?;
        self.0.with(py, |robot| robot.set_servo_led(to, Led(led)))
    }

    /// Target and actual angle, in degrees.
    fn read_servo_angles(&self, py: Python<'_>, servo: u8) -> PyResult<(u16, u16)> {
        let servo = id(servo)?;
        let angles = self.0.with(py, |robot| robot.read_servo_angles(servo))?;
        Ok((angles.target, angles.actual))
    }

    fn change_servo_id(&self, py: Python<'_>, servo: u8, to: u8) -> PyResult<()> {
        let (from, to) = (id(servo)?, id(to)?);
        self.0.with(py, |robot| robot.change_servo_id(from, to))
    }

    /// In thirds of a degree.
    fn set_servo_offset(&self, py: Python<'_>, servo: u8, thirds: i16) -> PyResult<()> {
        let offset = Offset::new(thirds).map_err(value_error)?;
        let servo = id(servo)?;
        self.0.with(py, |robot| robot.set_servo_offset(servo, offset))
    }

    /// In thirds of a degree.
    fn read_servo_offset(&self, py: Python<'_>, servo: u8) -> PyResult<i16> {
        let servo = id(servo)?;
        self.0.with(py, |robot| robot.read_servo_offset(servo))
    }

    fn read_servo_version<'py>(&self, py: Python<'py>, servo: u8) -> PyResult<Bound<'py, PyBytes>> {
        let servo = id(servo)?;
        let version = self.0.with(py, |robot| robot.read_servo_version(servo))?;
        Ok(PyBytes::new(py, &version))
    }
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
