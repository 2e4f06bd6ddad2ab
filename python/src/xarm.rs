//! An xArm on a host.

use armwire::xarm::{
    Joint, ProtocolId, Raw, Reply, Request, Response, RotationRadius, SerialsText, TorqueSource, VersionText, XArm,
};
use armwire_host::{Host, Link};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::error::value_error;
use crate::session::{Session, call, interruptible, send};

/// The arm's state and a value.
type Answer<T> = (u8, T);
/// Axes, type, arm, control box and firmware.
type Version = (u8, u8, String, String, String);
/// Serial numbers of the arm and of its control box.
type Serials = (Option<String>, Option<String>);

/// An xArm on a host. Each answer has the arm's state, as a byte.
#[pyclass(frozen, module = "armwire._armwire")]
pub(crate) struct XArmPort(Session<Link<XArm>>);

#[pymethods]
impl XArmPort {
    #[new]
    fn new(py: Python<'_>, host: &str, supervised: bool) -> PyResult<Self> {
        let host: Host = host.parse().map_err(value_error)?;
        let open = || {
            let mut link = interruptible(Link::connect(&host)?);
            if supervised {
                link.messages_mut().protocol = ProtocolId::Supervised;
            }
            Ok(link)
        };
        Session::open(py, open).map(Self)
    }

    fn close(&self, py: Python<'_>) -> PyResult<()> {
        self.0.close(py)
    }

    /// The version text with unprintable characters escaped, and its axes, type, arm, control box and firmware; `None`
    /// for another format.
    fn read_version(&self, py: Python<'_>) -> PyResult<Answer<(String, Option<Version>)>> {
        self.call(py, Request::ReadVersion, |reply| {
            let text = VersionText::try_from(reply).ok()?;
            Some((text.to_string(), version(text)))
        })
    }

    fn read_serials(&self, py: Python<'_>) -> PyResult<Answer<Serials>> {
        self.call(py, Request::ReadSerials, |reply| reply.try_into().ok().map(serials))
    }

    fn reload_dynamics(&self, py: Python<'_>) -> PyResult<u8> {
        self.call(py, Request::ReloadDynamics, |reply| <()>::try_from(reply).ok())
            .map(|(state, ())| state)
    }

    /// Reported quantity: `torque` or `current`.
    fn read_torque_source(&self, py: Python<'_>) -> PyResult<Answer<&'static str>> {
        self.call(py, Request::ReadTorqueSource, |reply| match reply {
            Reply::TorqueSource(TorqueSource::Torque) => Some("torque"),
            Reply::TorqueSource(TorqueSource::Current) => Some("current"),
            _ => None,
        })
    }

    /// Rotation radius in millimetres, as sent by the arm.
    fn read_rotation_radius(&self, py: Python<'_>, joint: u8) -> PyResult<Answer<f32>> {
        let joint = Joint::new(joint).map_err(value_error)?;
        self.call(py, Request::ReadRotationRadius(joint), |reply| {
            let radius = RotationRadius::try_from(reply).ok()?;
            Some(radius.millimetres)
        })
    }

    fn shut_down(&self, py: Python<'_>) -> PyResult<u8> {
        self.call(py, Request::Shutdown, |reply| <()>::try_from(reply).ok())
            .map(|(state, ())| state)
    }

    fn reboot(&self, py: Python<'_>) -> PyResult<u8> {
        self.call(py, Request::Reboot, |reply| <()>::try_from(reply).ok())
            .map(|(state, ())| state)
    }

    fn heartbeat(&self, py: Python<'_>) -> PyResult<()> {
        self.0.with(py, |link| send(link, &Request::Heartbeat))
    }

    /// Calls any other register with these parameters.
    fn raw<'py>(&self, py: Python<'py>, register: u8, params: &[u8]) -> PyResult<Answer<Bound<'py, PyBytes>>> {
        let raw = Raw::new(register, params).map_err(value_error)?;
        let (state, params) = self.call(py, Request::Raw(raw), |reply| {
            Raw::try_from(reply).ok().map(|raw| raw.params().to_vec())
        })?;
        Ok((state, PyBytes::new(py, &params)))
    }
}

impl XArmPort {
    fn call<T: Send>(
        &self,
        py: Python<'_>,
        request: Request<'_>,
        take: impl FnOnce(Reply<'_>) -> Option<T> + Send,
    ) -> PyResult<Answer<T>> {
        let take = |response: Response<'_>| match response {
            Response::Reply { state, reply } => Some((state.0, take(reply)?)),
            _ => None,
        };
        self.0.with(py, |link| call(link, &request, take))
    }
}

fn version(text: VersionText<'_>) -> Option<Version> {
    let version = text.version().ok()?;
    let [arm, control_box, firmware] = [version.arm, version.control_box, version.firmware].map(str::to_owned);
    Some((version.axes, version.kind, arm, control_box, firmware))
}

fn serials(text: SerialsText<'_>) -> Serials {
    (text.arm().map(str::to_owned), text.control_box().map(str::to_owned))
}
