//! An xArm on a host.

use armwire::xarm::{self, Joint, ProtocolId, Raw, SerialsText, TorqueSource, VersionText};
use armwire_host::{TcpAddress, XArm};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::error::value_error;
use crate::reader::XArmReader;
use crate::session::{Session, check_signals};

/// The arm's state and a value.
type Answer<T> = (u8, T);
/// Axes, type, arm, control box and firmware.
type Version = (u8, u8, String, String, String);
/// Serial numbers of the arm and of its control box.
type Serials = (Option<String>, Option<String>);

/// An xArm on a host. Each answer has the arm's state, as a byte.
#[pyclass(frozen, module = "armwire._armwire")]
pub(crate) struct XArmPort(Session<XArm>);

#[pymethods]
impl XArmPort {
    #[new]
    fn new(py: Python<'_>, host: &str, supervised: bool) -> PyResult<Self> {
        let name = host;
        let host: TcpAddress = host.parse().map_err(value_error)?;
        let open = || {
            let mut arm = XArm::connect(&host)?;
            arm.set_interrupt(check_signals);
            if supervised {
                arm.set_protocol(ProtocolId::Supervised);
            }
            Ok(arm)
        };
        Session::open(py, name, open).map(Self)
    }

    fn close(&self, py: Python<'_>) -> PyResult<()> {
        self.0.close(py)
    }

    /// Reads the joints in a thread, at this rate in hertz.
    fn reader(&self, py: Python<'_>, rate: u32) -> PyResult<XArmReader> {
        self.0.reader(py, rate).map(XArmReader::new)
    }

    /// The version text with unprintable characters escaped, and its axes, type, arm, control box and firmware; `None`
    /// for another format.
    fn read_version(&self, py: Python<'_>) -> PyResult<Answer<(String, Option<Version>)>> {
        let read = |arm: &mut XArm| arm.read_version(|text| (text.to_string(), version(text)));
        Ok(answer(self.0.with(py, read)?))
    }

    fn read_serials(&self, py: Python<'_>) -> PyResult<Answer<Serials>> {
        Ok(answer(self.0.with(py, |arm| arm.read_serials(serials))?))
    }

    fn reload_dynamics(&self, py: Python<'_>) -> PyResult<u8> {
        Ok(self.0.with(py, XArm::reload_dynamics)?.state.0)
    }

    /// Reported quantity: `torque` or `current`.
    fn read_torque_source(&self, py: Python<'_>) -> PyResult<Answer<&'static str>> {
        let (state, source) = answer(self.0.with(py, XArm::read_torque_source)?);
        let quantity = match source {
            TorqueSource::Torque => "torque",
            TorqueSource::Current => "current",
        };
        Ok((state, quantity))
    }

    /// Rotation radius in millimetres, as sent by the arm.
    fn read_rotation_radius(&self, py: Python<'_>, joint: u8) -> PyResult<Answer<f32>> {
        let joint = Joint::new(joint).map_err(value_error)?;
        let (state, radius) = answer(self.0.with(py, |arm| arm.read_rotation_radius(joint))?);
        Ok((state, radius.millimetres))
    }

    fn shut_down(&self, py: Python<'_>) -> PyResult<u8> {
        Ok(self.0.with(py, XArm::shut_down)?.state.0)
    }

    fn reboot(&self, py: Python<'_>) -> PyResult<u8> {
        Ok(self.0.with(py, XArm::reboot)?.state.0)
    }

    fn heartbeat(&self, py: Python<'_>) -> PyResult<()> {
        self.0.with(py, XArm::heartbeat)
    }

    /// Calls any other register with these parameters.
    fn raw<'py>(&self, py: Python<'py>, register: u8, params: &[u8]) -> PyResult<Answer<Bound<'py, PyBytes>>> {
        let raw = Raw::new(register, params).map_err(value_error)?;
        let (state, params) = answer(self.0.with(py, |arm| arm.raw(raw))?);
        Ok((state, PyBytes::new(py, &params)))
    }
}

/// The state and the value of an answer.
fn answer<T>(xarm::Answer { value, state }: xarm::Answer<T>) -> Answer<T> {
    (state.0, value)
}

fn version(text: VersionText<'_>) -> Option<Version> {
    let version = text.version().ok()?;
    let [arm, control_box, firmware] = [version.arm, version.control_box, version.firmware].map(str::to_owned);
    Some((version.axes, version.kind, arm, control_box, firmware))
}

fn serials(text: SerialsText<'_>) -> Serials {
    (text.arm().map(str::to_owned), text.control_box().map(str::to_owned))
}
