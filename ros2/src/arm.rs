//! One arm's thread: readings go out, trajectories and services come in, motion goes to the arm.

use std::io::{Write, stderr};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use armwire::ling::{self, JOINTS, Ling, Request, Response, Stroke};
use armwire::messages::Messages;
use armwire_bridge::config::{ArmKind, MAX_POLL_HZ, Poll};
use armwire_bridge::control::{self, Event, Initiator, Subscription};
use armwire_host::stamps::{self, Clock, HostTime};
use armwire_host::{Adapter, Error, Link, Options, adapter};
use ros2_client::{ReadError, RmwRequestId};

use crate::diagnostics::Diagnostics;
use crate::joint_states::{Reading, to_move};
use crate::messages::{JointTrajectory, Outcome};
use crate::node::Endpoints;
use crate::options::Arm;
use crate::services::{Effect, Pending, refused};
use crate::trajectory::{self, Accepted, Joint, Plan, Refusal};

/// Minimum time between two moves to the arm.
const MOVE_PERIOD: Duration = Duration::from_millis(10);
/// Time between two diagnostics.
const DIAGNOSTICS_PERIOD: Duration = Duration::from_secs(1);
/// Time between two attempts to open a port.
const RETRY: Duration = Duration::from_secs(1);
/// Time between two checks for requests while the arm is absent.
const REQUEST_PERIOD: Duration = Duration::from_millis(20);
/// Minimum time without a reading after which an adapter's arm counts as silent. With slow polls it is three periods.
const SILENCE: Duration = Duration::from_millis(500);

/// The reason why an arm is not served until its port is reopened.
#[derive(Debug, thiserror::Error)]
enum Failure {
    #[error(transparent)]
    Port(#[from] Error),
    #[error("{0}")]
    Arm(String),
}

/// Serves an arm until `stop` is set. Reopens a port that fails.
pub(crate) fn serve(arm: &Arm, endpoints: &Endpoints, stop: &AtomicBool) {
    let mut host = Host {
        arm,
        endpoints,
        diagnostics: Diagnostics::new(arm.port.to_string()),
        published: None,
    };
    while !stop.load(Ordering::Relaxed) {
        let failure = match Session::open(&mut host).and_then(|session| session.run(stop)) {
            Ok(()) => return,
            Err(failure) => failure.to_string(),
        };
        if host.diagnostics.failure.as_ref() != Some(&failure) {
            log(&arm.name, &failure);
        }
        host.diagnostics.failure = Some(failure);
        host.diagnostics.is_moving = false;
        host.refuse_all_for(RETRY, stop);
        host.diagnostics.reconnects += 1;
    }
}

fn log(arm: &str, text: &str) {
    // A closed standard error must not stop an arm.
    let _ = writeln!(stderr(), "armwire-ros2: {arm}: {text}");
}

/// The side of the ROS network, independent of the port.
struct Host<'a> {
    arm: &'a Arm,
    endpoints: &'a Endpoints,
    diagnostics: Diagnostics,
    /// Time of the last published diagnostics.
    published: Option<Instant>,
}

impl Host<'_> {
    fn refuse(&mut self, refusal: &Refusal) {
        let reason = refusal.to_string();
        if self.diagnostics.refuse(Instant::now(), reason.clone()) {
            log(&self.arm.name, &format!("trajectory refused: {reason}"));
        }
    }

    /// The next trajectory, or the refusal of an undecodable message.
    fn trajectory(&self) -> Option<Result<JointTrajectory, Refusal>> {
        match self.endpoints.trajectories.take() {
            Ok(received) => received.map(|(trajectory, _)| Ok(trajectory)),
            Err(ReadError::Deserialization { .. }) => Some(Err(Refusal::Undecodable)),
            Err(_) => None,
        }
    }

    fn respond(&self, effect: Effect, id: RmwRequestId, outcome: Outcome) {
        let sent = match effect {
            Effect::Torque(_) => self.endpoints.torque.send_response(id, outcome),
            Effect::Zero => self.endpoints.set_zero.send_response(id, outcome),
        };
        if let Err(error) = sent {
            log(&self.arm.name, &format!("a service's response is lost: {error}"));
        }
    }

    /// The next service request, with its effect.
    fn service(&self) -> Option<(RmwRequestId, Effect)> {
        if let Ok(Some((id, request))) = self.endpoints.torque.receive_request() {
            return Some((id, Effect::Torque(request.data)));
        }
        let request = self.endpoints.set_zero.receive_request().ok().flatten();
        request.map(|(id, _)| (id, Effect::Zero))
    }

    fn publish_diagnostics(&mut self) {
        let now = Instant::now();
        if self
            .published
            .is_none_or(|published| now.duration_since(published) >= DIAGNOSTICS_PERIOD)
        {
            self.published = Some(now);
            // A reader that is too slow gets the next one.
            let _ = self
                .endpoints
                .diagnostics
                .publish(self.diagnostics.to_message(&self.arm.name, now));
        }
    }

    /// Refuses all requests for this time, while the arm is absent.
    fn refuse_all_for(&mut self, time: Duration, stop: &AtomicBool) {
        let until = Instant::now() + time;
        while Instant::now() < until && !stop.load(Ordering::Relaxed) {
            while self.trajectory().is_some() {
                self.refuse(&Refusal::NoArm);
            }
            while let Some((id, effect)) = self.service() {
                self.respond(effect, id, refused("the arm does not answer"));
            }
            self.publish_diagnostics();
            thread::sleep(REQUEST_PERIOD);
        }
    }
}

/// An arm with an open port.
struct Session<'a, 'b> {
    host: &'b mut Host<'a>,
    link: Link<Ling>,
    /// `None` without an adapter.
    adapter: Option<Adapter>,
    stroke: Stroke,
    joints: Vec<Joint>,
    clock: Clock,
    /// Time between two readings.
    period: Duration,
    latest: Reading,
    /// The motion, and the time of its acceptance.
    motion: Option<(Plan, Instant)>,
    moved: Option<Instant>,
    pending: Vec<Pending<RmwRequestId>>,
}

impl<'a, 'b> Session<'a, 'b> {
    /// Opens the arm's port, and subscribes to the adapter's frames and events.
    fn open(host: &'b mut Host<'a>) -> Result<Self, Failure> {
        let connection = host.arm.port.open(Options::default())?;
        let mut adapter = match &host.arm.control {
            Some(port) => Some(port.open(Options::default())?.adapter()?),
            None => match connection.adapter() {
                Ok(control) => Some(control),
                Err(Error::NoControl { .. }) => None,
                Err(error) => return Err(error.into()),
            },
        };
        let mut link = connection.ling()?.into_link();
        let stroke: Stroke = link.read(&Request::ReadStroke)?;
        let mut joints = host.arm.joints.clone();
        joints[JOINTS].max = f64::from(stroke.millimetres()) / 1_000.0;
        let mut period = Duration::from_secs(1) / host.arm.rate;
        if let Some(adapter) = &mut adapter {
            period = Duration::from_secs(1) / adapter_rate(adapter)?;
            let all = Subscription {
                frames: true,
                events: true,
            };
            adapter.subscribe(all)?;
        }
        let state = link.read(&Request::ReadJoints)?;
        let latest = Reading::new(stamps::now(), &state, stroke).map_err(|error| Failure::Arm(error.to_string()))?;
        host.diagnostics.failure = None;
        host.diagnostics.stamps = if adapter.is_some() { "adapter" } else { "host" };
        log(
            &host.arm.name,
            &format!("{}, stamps of the {}", host.arm.port, host.diagnostics.stamps),
        );
        Ok(Self {
            host,
            link,
            adapter,
            stroke,
            joints,
            clock: Clock::default(),
            period,
            latest,
            motion: None,
            moved: None,
            pending: Vec::new(),
        })
    }

    /// Serves the arm until `stop` is set or its port fails. The arm then holds the last setpoint.
    fn run(mut self, stop: &AtomicBool) -> Result<(), Failure> {
        let result = self.serve(stop);
        for Pending { id, effect, .. } in std::mem::take(&mut self.pending) {
            self.host
                .respond(effect, id, refused("sent, but not read back: the arm was lost"));
        }
        result
    }

    fn serve(&mut self, stop: &AtomicBool) -> Result<(), Failure> {
        let mut due = Instant::now();
        let mut received = due;
        let silence = SILENCE.max(3 * self.period);
        while !stop.load(Ordering::Relaxed) {
            if self.adapter.is_some() {
                match self.receive()? {
                    true => received = Instant::now(),
                    false if received.elapsed() >= silence => {
                        return Err(Failure::Arm(format!(
                            "the adapter received no joints for {} ms",
                            silence.as_millis()
                        )));
                    }
                    false => {}
                }
            } else {
                thread::sleep(due.saturating_duration_since(Instant::now()));
                let state = self.link.read(&Request::ReadJoints)?;
                self.publish(stamps::now(), &state);
                due = (due + self.period).max(Instant::now());
            }
            self.take_trajectories();
            self.take_requests()?;
            self.step()?;
            self.host.publish_diagnostics();
        }
        self.end_stream()
    }

    /// Receives one event of the adapter within a period. Returns true for a reading.
    fn receive(&mut self) -> Result<bool, Failure> {
        let Some(adapter) = &mut self.adapter else {
            return Ok(false);
        };
        let Some((stamp, event)) = adapter.next_event(self.period)? else {
            return Ok(false);
        };
        let at = self.clock.host_time(stamp, HostTime::now()).unix_ns;
        match event {
            Event::Frame { bytes, .. } => {
                let response = Messages::parse_response(&Ling, &bytes, ());
                let Ok(Response::Joints(state)) = response else {
                    return Ok(false);
                };
                self.publish(at, &state);
                Ok(true)
            }
            event => {
                let is_stop = matches!(
                    event,
                    Event::Refused {
                        initiator: Initiator::Usb,
                        reason: control::Refusal::Stopped
                    }
                );
                // Later the setpoint would be far ahead of the arm.
                if is_stop && self.motion.take().is_some() {
                    self.host.refuse(&Refusal::Stopped);
                }
                let event = adapter::describe_event(&event);
                log(&self.host.arm.name, &format!("adapter event: {event}"));
                self.host.diagnostics.adapter_event = Some(event);
                Ok(false)
            }
        }
    }

    fn publish(&mut self, at: i64, state: &ling::JointState) {
        let diagnostics = &mut self.host.diagnostics;
        let Ok(reading) = Reading::new(at, state, self.stroke) else {
            diagnostics.unusable += 1;
            return;
        };
        diagnostics.readings += 1;
        diagnostics.late += u64::from(reading.is_late_after(&self.latest, self.period));
        diagnostics.status = Some(reading.status);
        if self
            .host
            .endpoints
            .states
            .publish(reading.to_message(&self.joints))
            .is_err()
        {
            diagnostics.dropped += 1;
        }
        self.latest = reading;
        if self.latest.status.is_holding() == Some(false) && self.motion.take().is_some() {
            // A later torque-on must not resume it.
            self.host.refuse(&Refusal::TorqueLost);
        }
        let now = Instant::now();
        for nth in (0..self.pending.len()).rev() {
            if let Some(outcome) = self.pending[nth].outcome(&self.latest, now) {
                let Pending { id, effect, .. } = self.pending.swap_remove(nth);
                self.host.respond(effect, id, outcome);
            }
        }
    }

    /// Checks each received trajectory, and plays the last valid one.
    fn take_trajectories(&mut self) {
        while let Some(received) = self.host.trajectory() {
            let trajectory = match received {
                Ok(trajectory) => trajectory,
                Err(refusal) => {
                    self.host.refuse(&refusal);
                    continue;
                }
            };
            // The readings may not show a torque-off yet.
            let is_ending = self
                .pending
                .iter()
                .any(|pending| pending.effect != Effect::Torque(true));
            if is_ending || self.latest.status.is_holding() == Some(false) {
                self.host.refuse(&Refusal::TorqueOff);
                continue;
            }
            // A motion continues from its setpoint: a reading lags behind.
            let current = match &self.motion {
                Some((plan, accepted)) => plan.at(accepted.elapsed()).positions,
                None => self.latest.positions.clone(),
            };
            match trajectory::check(&self.joints, JOINTS, &trajectory, stamps::now(), &current) {
                Ok(accepted) => {
                    self.host.diagnostics.accepted += 1;
                    self.motion = match accepted {
                        Accepted::Plan(plan) => Some((plan, Instant::now())),
                        Accepted::Hold => None,
                    };
                }
                Err(refusal) => self.host.refuse(&refusal),
            }
        }
    }

    fn take_requests(&mut self) -> Result<(), Failure> {
        while let Some((id, effect)) = self.host.service() {
            if effect == Effect::Zero && !self.host.arm.allow_set_zero {
                self.host
                    .respond(effect, id, refused("refused: the node runs without --allow-set-zero"));
                continue;
            }
            if effect != Effect::Torque(true) {
                self.motion = None;
            }
            for earlier in std::mem::take(&mut self.pending) {
                let outcome = refused("sent, but not read back: another request followed");
                self.host.respond(earlier.effect, earlier.id, outcome);
            }
            self.link.call(&effect.request(), drop)?;
            let pending = Pending::new(id, effect, Instant::now(), stamps::now());
            self.pending.push(pending);
        }
        Ok(())
    }

    /// Sends the motion's current setpoint if it is due. Ends the motion after its last point.
    fn step(&mut self) -> Result<(), Failure> {
        let now = Instant::now();
        let was_moving = std::mem::replace(&mut self.host.diagnostics.is_moving, self.motion.is_some());
        let Some((plan, accepted)) = &self.motion else {
            return if was_moving { self.end_stream() } else { Ok(()) };
        };
        if self.moved.is_some_and(|moved| now.duration_since(moved) < MOVE_PERIOD) {
            return Ok(());
        }
        let elapsed = now.duration_since(*accepted);
        let request = to_move(&plan.at(elapsed), self.stroke).map_err(|error| Failure::Arm(error.to_string()))?;
        let is_over = elapsed >= plan.end();
        self.link.call(&Request::Move(request), drop)?;
        self.moved = Some(now);
        if is_over {
            self.motion = None;
        }
        Ok(())
    }

    /// Ends the stream at the adapter, which would otherwise report a silent host.
    fn end_stream(&mut self) -> Result<(), Failure> {
        if let Some(adapter) = &mut self.adapter {
            adapter.call(control::Request::EndStream)?;
        }
        Ok(())
    }
}

/// The rate at which the adapter polls a Ling arm.
fn adapter_rate(adapter: &mut Adapter) -> Result<u32, Failure> {
    let config = adapter.config()?;
    match (config.arm, config.poll) {
        (ArmKind::Ling, Poll::Off) => {
            let reason = "the adapter does not poll the arm: enable it by 'armwire config PORT set poll=200 --save'";
            Err(Failure::Arm(reason.to_owned()))
        }
        (ArmKind::Ling, Poll::Hertz(rate)) => Ok(rate.max(1).into()),
        (ArmKind::Ling, Poll::Fastest) => Ok(MAX_POLL_HZ.into()),
        (arm, _) => Err(Failure::Arm(format!(
            "the adapter is configured for '{arm}', not for ling"
        ))),
    }
}
