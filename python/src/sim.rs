//! Virtual arms, each served by its own thread.

use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};

use armwire::ling::{Opening, Position};
use armwire::time::{Duration, Instant};
use armwire_sim::alpha1::{Alpha1Robot, BusConfig, RobotConfig, ServoBus};
use armwire_sim::faults::{Injected, Line, Rates};
use armwire_sim::ling::legacy::{self, LegacyArm};
use armwire_sim::ling::{self, LingArm, Plant};
use armwire_sim::pty::Pty;
use armwire_sim::serial::SerialDevice;
use armwire_sim::serve::{BAUD, serve_since};
use armwire_sim::so101::{self, Order, So101};
use armwire_sim::xarm::{Config as XArmConfig, Model, Server, VirtualXArm as XArm};
use pyo3::exceptions::PyOSError;
use pyo3::prelude::*;

use crate::alpha1::id;
use crate::error::value_error;
use crate::joints::Joints;

/// A thread that serves a virtual arm until it is stopped.
struct Service {
    stop: Arc<AtomicBool>,
    thread: Mutex<Option<JoinHandle<()>>>,
}

impl Service {
    fn start(serve: impl FnOnce(&AtomicBool) + Send + 'static) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let thread = Mutex::new(Some(thread::spawn(move || serve(&stopped))));
        Self { stop, thread }
    }

    /// Ends the thread and closes the port.
    fn stop(&self, py: Python<'_>) {
        self.stop.store(true, Ordering::Relaxed);
        let thread = self.thread.lock().unwrap_or_else(PoisonError::into_inner).take();
        py.detach(|| thread.map(JoinHandle::join));
    }
}

/// Stops the thread when Python drops the object, without waiting for its end.
impl Drop for Service {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}

/// A device behind a line with faults, shared by its thread and by tests.
struct Shared<D> {
    line: Arc<Mutex<Line<D>>>,
    /// The device's time zero.
    start: std::time::Instant,
}

impl<D> Shared<D> {
    fn lock(&self) -> MutexGuard<'_, Line<D>> {
        self.line.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The device's time.
    fn now(&self) -> Instant {
        Instant::from_micros(self.start.elapsed().as_micros().try_into().unwrap_or(u64::MAX))
    }
}

impl<D: SerialDevice> SerialDevice for Shared<D> {
    fn receive(&mut self, now: Instant, byte: u8) {
        self.lock().receive(now, byte);
    }

    fn transmit(&mut self, now: Instant) -> Option<u8> {
        self.lock().transmit(now)
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.lock().poll_timeout()
    }

    fn set_baud(&mut self, baud: u32) {
        self.lock().set_baud(baud);
    }

    fn is_gone(&self) -> bool {
        self.lock().is_gone()
    }
}

/// A virtual arm on a port, of any kind.
#[pyclass(subclass, frozen, module = "armwire._armwire")]
pub(crate) struct VirtualArm {
    service: Service,
    port: String,
}

#[pymethods]
impl VirtualArm {
    #[getter]
    fn port(&self) -> &str {
        &self.port
    }

    fn close(&self, py: Python<'_>) {
        self.service.stop(py);
    }
}

impl<D: SerialDevice + Send + 'static> Shared<D> {
    /// Starts a device on a pseudo-terminal.
    fn on_pty(device: D, seed: u64) -> PyResult<(VirtualArm, Self)> {
        let pty = Pty::open(None).map_err(PyOSError::new_err)?;
        pty.set_baud(BAUD).map_err(PyOSError::new_err)?;
        let port = pty.path().display().to_string();
        let line = Arc::new(Mutex::new(Line::new(device, Rates::NONE, Rates::NONE, seed)));
        let start = std::time::Instant::now();
        let mut served = Self {
            line: Arc::clone(&line),
            start,
        };
        // A pty fails only when it is closed, and its thread then ends.
        let service = Service::start(move |stop| drop(serve_since(start, &mut served, &pty, stop)));
        Ok((VirtualArm { service, port }, Self { line, start }))
    }

    /// Sets fault rates in parts per million of bytes, in both directions.
    fn set_faults(&self, faults: Faults) {
        let (drop, corrupt, duplicate, delay, noise) = faults;
        let rates = Rates {
            drop,
            corrupt,
            duplicate,
            delay,
            noise,
            ..Rates::NONE
        };
        self.lock().set_rates(rates, rates);
    }

    /// Counts of injected faults, in both directions.
    fn injected(&self) -> [u64; 5] {
        let line = self.lock();
        let counts = |injected: Injected| {
            [
                injected.dropped,
                injected.corrupted,
                injected.duplicated,
                injected.delayed,
                injected.noise,
            ]
        };
        let (to, from) = (counts(line.injected_to_device()), counts(line.injected_from_device()));
        std::array::from_fn(|fault| to[fault] + from[fault])
    }
}

/// Rates of dropped, corrupted, duplicated and delayed bytes and of noise, in parts per million.
type Faults = (u32, u32, u32, u32, u32);

/// A virtual Ling arm.
#[pyclass(extends = VirtualArm, frozen, module = "armwire._armwire")]
pub(crate) struct VirtualLing(Shared<LingArm>);

#[pymethods]
impl VirtualLing {
    #[new]
    fn new(
        leader: bool,
        turnaround_us: u64,
        seed: u64,
        plant: Option<&str>,
        force_feedback: Option<&str>,
    ) -> PyResult<PyClassInitializer<Self>> {
        let base = if leader || force_feedback.is_some() {
            ling::Config::leader()
        } else {
            ling::Config::follower()
        };
        let config = ling::Config {
            turnaround: Duration::from_micros(turnaround_us),
            plant: plant.map_or(Ok(Plant::DEFAULT), str::parse).map_err(value_error)?,
            force_feedback: force_feedback.map(str::parse).transpose().map_err(value_error)?,
            ..base
        };
        Shared::on_pty(LingArm::new(config), seed)
            .map(|(arm, device)| PyClassInitializer::from(arm).add_subclass(Self(device)))
    }

    /// True state of the arm, independent of its line: joint ticks, gripper in thousandths, motion status.
    fn joints(&self) -> Joints {
        let line = self.0.lock();
        let arm = line.device();
        (arm.joints(), arm.gripper(), arm.status().into(), 0)
    }

    /// Moves joint 0 to 5 by hand to a position in ticks. Returns true if it moved.
    fn push_joint(&self, joint: usize, ticks: u16) -> PyResult<bool> {
        let position = Position::new(ticks).map_err(value_error)?;
        Ok(self.0.lock().device_mut().push_joint(joint, position))
    }

    /// Moves the gripper by hand to an opening in thousandths. Returns true if it moved.
    fn push_gripper(&self, per_mille: u16) -> PyResult<bool> {
        let opening = Opening::new(per_mille).map_err(value_error)?;
        Ok(self.0.lock().device_mut().push_gripper(opening))
    }

    /// Removes the obstacle of the plant.
    fn remove_obstacle(&self) {
        self.0.lock().device_mut().remove_obstacle();
    }

    fn set_faulty(&self, servo: u8, faulty: bool) {
        self.0.lock().device_mut().set_faulty(servo, faulty);
    }

    fn set_faults(&self, faults: Faults) {
        self.0.set_faults(faults);
    }

    fn injected(&self) -> [u64; 5] {
        self.0.injected()
    }

    /// Number of received requests, executed or not.
    fn requests(&self) -> u64 {
        self.0.lock().device().counters().requests
    }
}

/// A virtual Ling arm of the older generation.
#[pyclass(extends = VirtualArm, frozen, module = "armwire._armwire")]
pub(crate) struct VirtualOlderLing;

#[pymethods]
impl VirtualOlderLing {
    #[new]
    fn new() -> PyResult<PyClassInitializer<Self>> {
        Shared::on_pty(LegacyArm::new(legacy::Config::default()), 1)
            .map(|(arm, _)| PyClassInitializer::from(arm).add_subclass(Self))
    }
}

/// A virtual Alpha1.
#[pyclass(extends = VirtualArm, frozen, module = "armwire._armwire")]
pub(crate) struct VirtualAlpha1(Shared<Alpha1Robot>);

#[pymethods]
impl VirtualAlpha1 {
    #[new]
    fn new() -> PyResult<PyClassInitializer<Self>> {
        Shared::on_pty(Alpha1Robot::new(RobotConfig::default()), 1)
            .map(|(arm, device)| PyClassInitializer::from(arm).add_subclass(Self(device)))
    }

    fn set_faults(&self, faults: Faults) {
        self.0.set_faults(faults);
    }

    /// The current action.
    fn playing(&self) -> Option<&'static str> {
        self.0.lock().device().playing()
    }
}

/// The servos of a virtual Alpha1 on their own bus.
#[pyclass(extends = VirtualArm, frozen, module = "armwire._armwire")]
pub(crate) struct VirtualAlpha1Servos(Shared<ServoBus>);

#[pymethods]
impl VirtualAlpha1Servos {
    #[new]
    fn new(ids: Vec<u8>) -> PyResult<PyClassInitializer<Self>> {
        let config = BusConfig {
            ids: ids.into_iter().map(id).collect::<PyResult<_>>()?,
            ..BusConfig::default()
        };
        Shared::on_pty(ServoBus::new(config), 1)
            .map(|(arm, device)| PyClassInitializer::from(arm).add_subclass(Self(device)))
    }

    fn set_faults(&self, faults: Faults) {
        self.0.set_faults(faults);
    }
}

/// A virtual SO-101.
#[pyclass(extends = VirtualArm, frozen, module = "armwire._armwire")]
pub(crate) struct VirtualSo101(Shared<So101>);

#[pymethods]
impl VirtualSo101 {
    #[new]
    fn new(ids: Vec<u8>, models: Vec<u16>, volts: f64, seed: u64) -> PyResult<PyClassInitializer<Self>> {
        let config = so101::Config::new(&ids, &models, volts).map_err(value_error)?;
        Shared::on_pty(So101::new(config), seed)
            .map(|(arm, device)| PyClassInitializer::from(arm).add_subclass(Self(device)))
    }

    /// Carries out an order, as a line of text.
    fn order(&self, line: &str) -> PyResult<()> {
        let order: Order = line.parse().map_err(value_error)?;
        let now = self.0.now();
        let done = self.0.lock().device_mut().order(now, order);
        done.map(drop).map_err(value_error)
    }

    /// True state of each servo, independent of the line: id, reported position, position of the encoder, torque.
    fn state(&self) -> Vec<(u8, i32, f64, bool)> {
        let now = self.0.now();
        let mut line = self.0.lock();
        let servos = line.device_mut().servos(now).iter();
        servos
            .map(|servo| (servo.id(), servo.position(), servo.encoder(), servo.has_torque()))
            .collect()
    }

    fn set_faults(&self, faults: Faults) {
        self.0.set_faults(faults);
    }

    fn injected(&self) -> [u64; 5] {
        self.0.injected()
    }
}

/// A virtual xArm on a TCP port of this machine.
#[pyclass(extends = VirtualArm, frozen, module = "armwire._armwire")]
pub(crate) struct VirtualXArm;

#[pymethods]
impl VirtualXArm {
    #[new]
    fn new(axes: u8) -> PyResult<PyClassInitializer<Self>> {
        let model = match axes {
            5 => Model::XArm5,
            6 => Model::XArm6,
            7 => Model::XArm7,
            _ => return Err(value_error(format_args!("number of axes is {axes}, must be 5, 6 or 7"))),
        };
        let any = SocketAddr::from(([127, 0, 0, 1], 0));
        let server = Server::bind(any, None).map_err(|error| PyOSError::new_err(error.to_string()))?;
        let port = server.control_address().to_string();
        let mut arm = XArm::new(XArmConfig::new(model));
        // `serve` fails only if the system cannot poll, and the thread then ends.
        let service = Service::start(move |stop| drop(server.serve(&mut arm, stop, &mut |_| ())));
        Ok(PyClassInitializer::from(VirtualArm { service, port }).add_subclass(Self))
    }
}
