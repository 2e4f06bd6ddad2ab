//! An adapter's control port.

use std::time::{Duration, Instant};

use armwire_bridge::control::{Event, Histogram, Identity, Latencies, Request, Stamp, Subscription};
use armwire_host::settings::{self, Setting};
use armwire_host::{Adapter, Error, Options, Port};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use serde_json::{Value, json};

use crate::error::{not_stopped, value_error};
use crate::session::{Session, check_signals};

/// Maximum duration of one read between checks for signals.
const READ_TIMEOUT: Duration = Duration::from_millis(50);

/// Stamp in microseconds, initiator, frame bytes, and event in JSON.
type Received<'py> = (u64, Option<String>, Option<Bound<'py, PyBytes>>, Option<String>);

/// The control port of an adapter.
#[pyclass(frozen, module = "armwire._armwire")]
pub(crate) struct AdapterPort(Session<Adapter>);

#[pymethods]
impl AdapterPort {
    #[new]
    fn new(py: Python<'_>, port: &str) -> PyResult<Self> {
        let name = port;
        let port: Port = port.parse().map_err(value_error)?;
        Session::open(py, name, || port.open(Options::default())?.adapter()).map(Self)
    }

    fn close(&self, py: Python<'_>) -> PyResult<()> {
        self.0.close(py)
    }

    /// Board, serial number, firmware, commit, true with CAN FD, and true with CAN.
    fn identify(&self, py: Python<'_>) -> PyResult<(String, String, String, String, bool, bool)> {
        let Identity {
            board,
            serial,
            firmware,
            commit,
            can_fd,
            no_can,
            ..
        } = self.0.with(py, Adapter::identify)?;
        let [board, serial, firmware, commit] = [
            board.to_string(),
            serial.to_string(),
            firmware.to_string(),
            commit.to_string(),
        ];
        Ok((board, serial, firmware, commit, can_fd, !no_can))
    }

    fn is_in_recovery(&self, py: Python<'_>) -> PyResult<bool> {
        self.0.with(py, Adapter::is_in_recovery)
    }

    /// In JSON.
    fn read_config(&self, py: Python<'_>) -> PyResult<String> {
        let (config, identity) = self
            .0
            .with(py, |control| Ok((control.config()?, control.identify()?)))?;
        Ok(settings::object(&config, &identity).to_string())
    }

    /// Settings such as `poll=200`.
    #[allow(clippy::needless_pass_by_value, reason = "PyO3 passes it by value")]
    fn change_config(&self, py: Python<'_>, settings: Vec<String>) -> PyResult<()> {
        // Reject invalid settings before the first request to the adapter.
        let settings: Vec<Setting> = settings
            .iter()
            .map(|setting| setting.parse())
            .collect::<Result<_, _>>()
            .map_err(value_error)?;
        self.0.with(py, |control| control.change_config(&settings).map(drop))
    }

    fn save_config(&self, py: Python<'_>) -> PyResult<()> {
        self.0.with(py, Adapter::save_config)
    }

    fn reset_config(&self, py: Python<'_>) -> PyResult<()> {
        self.0.with(py, Adapter::reset_config)
    }

    /// In JSON.
    fn read_counters(&self, py: Python<'_>) -> PyResult<String> {
        let counters = self.0.with(py, Adapter::counters)?;
        Ok(json!(counters).to_string())
    }

    /// Bucket counts in JSON. The buckets end at 2, 4, 8, … µs.
    fn read_latencies(&self, py: Python<'_>) -> PyResult<String> {
        let Latencies { answer, turn, poll } = self.0.with(py, Adapter::latencies)?;
        let counts = |histogram: Histogram| histogram.counts.to_vec();
        Ok(json!({ "answer": counts(answer), "turn": counts(turn), "poll": counts(poll) }).to_string())
    }

    /// Stops the arm. The adapter that refuses, or does not know the request, does not.
    fn stop(&self, py: Python<'_>) -> PyResult<()> {
        let stopped = self.0.with(py, |control| match control.stop() {
            Err(error @ (Error::Refused { .. } | Error::Unsupported { .. })) => Ok(Err(error)),
            stopped => stopped.map(Ok),
        })?;
        stopped.map_err(not_stopped)
    }

    fn end_stream(&self, py: Python<'_>) -> PyResult<()> {
        self.call(py, Request::EndStream)
    }

    fn restart(&self, py: Python<'_>) -> PyResult<()> {
        self.call(py, Request::Restart)
    }

    /// Subscribes to the arm's frames and to the adapter's events, or unsubscribes.
    fn subscribe(&self, py: Python<'_>, frames: bool, events: bool) -> PyResult<()> {
        self.0
            .with(py, |control| control.subscribe(Subscription { frames, events }))
    }

    /// The next frame or event within this time: stamp in microseconds, initiator, and the frame bytes or the event in
    /// JSON.
    fn receive<'py>(&self, py: Python<'py>, timeout_s: f64) -> PyResult<Option<Received<'py>>> {
        let timeout = Duration::try_from_secs_f64(timeout_s).map_err(value_error)?;
        let received = self.0.with(py, |control| receive(control, timeout))?;
        Ok(received.map(|(Stamp(at), event)| match event {
            Event::Frame { initiator, bytes } => {
                let initiator = initiator.map(|initiator| initiator.to_string());
                (at, initiator, Some(PyBytes::new(py, &bytes)), None)
            }
            event => (at, None, None, Some(event_json(&event).to_string())),
        }))
    }
}

impl AdapterPort {
    fn call(&self, py: Python<'_>, request: Request) -> PyResult<()> {
        self.0.with(py, |control| control.call(request).map(drop))
    }
}

fn receive(control: &mut Adapter, timeout: Duration) -> Result<Option<(Stamp, Event)>, Error> {
    let until = Instant::now() + timeout;
    loop {
        let left = until.saturating_duration_since(Instant::now());
        let event = control.next_event(left.min(READ_TIMEOUT))?;
        if event.is_some() || left.is_zero() {
            return Ok(event);
        }
        check_signals().map_err(Error::Interrupted)?;
    }
}

/// An event of the adapter as JSON.
fn event_json(event: &Event) -> Value {
    match event {
        Event::Frame { .. } => Value::Null,
        Event::HostSilent {
            initiator,
            dropped,
            torque_off,
        } => json!({
            "event": "host_silent", "initiator": initiator.to_string(), "dropped": dropped, "torque_off": torque_off
        }),
        Event::Refused { initiator, reason } => {
            json!({ "event": "refused", "initiator": initiator.to_string(), "reason": reason.to_string() })
        }
        Event::BusOff { off } => json!({ "event": "bus_off", "off": off }),
        Event::Recovery { active } => json!({ "event": "recovery", "active": active }),
        other => json!({ "event": "other", "debug": format!("{other:?}") }),
    }
}
