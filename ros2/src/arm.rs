//! One arm's thread: readings go out, trajectories and services come in, motion goes to the arm.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use armwire::ling::arrival::Tolerances;
use armwire::ling::effect::Effect;
use armwire::ling::{JOINTS, JointState, Position};
use armwire::time;
use armwire_bridge::config::{ArmKind, MAX_POLL_HZ, Poll};
use armwire_bridge::control::{self, Event, StopInForce, Subscription};
use armwire_host::joints_file::Joint;
use armwire_host::stamps::{self, Clock};
use armwire_host::stopwatch::Stopwatch;
use armwire_host::{AXES, Adapter, Error, Options, ParkPoses, SilenceLimit, Stream, adapter};
use ros2_client::RmwRequestId;

use crate::clients::{Asked, Clients};
use crate::joint_states::{Reading, Units};
use crate::motion::{Abort, Motion, Output};
use crate::node::Endpoints;
use crate::options::Arm;
use crate::services::{Pending, refused};
use crate::silence::Silence;
use crate::source::{Input, Requests, Source};
use crate::trajectory::Refusal;

/// The maximum time of a parking.
const PARK_LIMIT: Duration = Duration::from_secs(60);
/// Time between two attempts to open a port.
const RETRY: Duration = Duration::from_secs(1);

/// The reason why an arm is not served until its port is reopened.
#[derive(Debug, thiserror::Error)]
enum Failure {
    #[error(transparent)]
    Port(#[from] Error),
    #[error("{0}")]
    Arm(String),
}

/// Serves an arm until `stop` is set, and parks it then if it is to be, until `stop_parking` is set. Reopens a port that
/// fails.
pub(crate) fn serve(arm: &Arm, endpoints: &Endpoints, stop: &AtomicBool, stop_parking: &'static AtomicBool) {
    let mut clients = Clients::new(arm, endpoints);
    while !stop.load(Ordering::Relaxed) {
        let failure = match Session::open(&mut clients).and_then(|session| session.run(stop, stop_parking)) {
            Ok(()) => return,
            Err(failure) => failure.to_string(),
        };
        if clients.diagnostics.failure.as_ref() != Some(&failure) {
            clients.log(&failure);
        }
        clients.diagnostics.failure = Some(failure);
        clients.diagnostics.is_moving = false;
        clients.refuse_all_for(RETRY, stop);
        clients.diagnostics.reconnects += 1;
    }
}

/// An arm with an open port.
struct Session<'a, 'b> {
    clients: &'b mut Clients<'a>,
    stream: Stream,
    source: Source,
    clock: Stopwatch,
    units: Units,
    joints: [Joint; AXES],
    /// The pose in which it is parked at the end.
    park: Option<[Position; JOINTS]>,
    /// Time between two readings.
    period: Duration,
    latest: Reading,
    motion: Motion,
    /// The adapter awaits the end of a stream of moves.
    is_streaming: bool,
    /// The adapter has refused motion, and is not known to let it pass again.
    is_stopped: bool,
    pending: Vec<Pending<RmwRequestId>>,
}

impl<'a, 'b> Session<'a, 'b> {
    /// Opens the arm's port, and subscribes to the adapter's frames and events.
    fn open(clients: &'b mut Clients<'a>) -> Result<Self, Failure> {
        let connection = clients.arm.port.open(Options::default())?;
        let mut adapter = match &clients.arm.control {
            Some(port) => Some(port.open(Options::default())?.adapter()?),
            None => match connection.adapter() {
                Ok(control) => Some(control),
                Err(Error::NoControl { .. }) => None,
                Err(error) => return Err(error.into()),
            },
        };
        let mut ling = connection.ling()?;
        match &clients.known {
            Some(known) => ling.require_known(known)?,
            None => drop(ling.read_info().map_err(|error| ling.explain(error))?),
        }
        let stroke = ling.read_stroke().map_err(|error| ling.explain(error))?;
        let park = match clients.arm.park {
            true => Some(ling.saved_park_pose(&ParkPoses::of_user()?)?),
            false => None,
        };
        let joints = clients.arm.joints.clone().with_stroke(stroke).all;
        let units = Units::new(&joints, stroke);
        let mut period = Duration::from_secs(1) / clients.arm.rate;
        if let Some(adapter) = &mut adapter {
            period = Duration::from_secs(1) / adapter_rate(adapter)?;
            let all = Subscription {
                frames: true,
                events: true,
            };
            adapter.subscribe(all)?;
        }
        let state = ling.read_joints()?;
        let latest = Reading::new(stamps::now(), &state, units).map_err(|error| Failure::Arm(error.to_string()))?;
        clients.known = Some(ling.known());
        clients.diagnostics.failure = None;
        clients.diagnostics.stamps = if adapter.is_some() { "adapter" } else { "host" };
        clients.log(&format!(
            "{}, stamps of the {}",
            clients.arm.port, clients.diagnostics.stamps
        ));
        let clock = Stopwatch::start();
        let (now, micros) = (clock.now(), time::Duration::from_micros(period.as_micros() as u64));
        let silence = SilenceLimit::FAIL.at(micros);
        Ok(Self {
            clients,
            stream: ling.into_stream(),
            source: match adapter {
                Some(adapter) => Source::Adapter(adapter, Clock::default()),
                None => Source::Arm(Requests::new(now, micros)),
            },
            clock,
            units,
            motion: Motion::new(joints.clone(), JOINTS, units, silence, now, latest.clone()),
            joints,
            park,
            period,
            latest,
            is_streaming: false,
            is_stopped: false,
            pending: Vec::new(),
        })
    }

    /// Serves the arm until `stop` is set or its port fails. The arm then holds the last setpoint, or is parked after
    /// `stop`.
    fn run(mut self, stop: &AtomicBool, stop_parking: &'static AtomicBool) -> Result<(), Failure> {
        let result = self.serve(stop);
        self.clients.known = Some(self.stream.known());
        self.motion.abort(&match &result {
            Ok(()) => Abort::NodeEnded,
            Err(failure) => Abort::ArmLost(failure.to_string()),
        });
        while let Some(output) = self.motion.poll(self.clock.now()) {
            if let Output::Ended(origin, end) = output {
                self.clients.ended(origin, &end);
            }
        }
        self.clients.serve();
        for pending in std::mem::take(&mut self.pending) {
            self.clients.respond(
                pending.effect(),
                pending.id,
                refused("sent, but not read back: the arm was lost"),
            );
        }
        if let (Ok(()), Some(pose)) = (&result, self.park) {
            self.park(pose, stop_parking);
        }
        result
    }

    /// Parks the arm, and logs the end. It is not read by the adapter any more.
    fn park(self, pose: [Position; JOINTS], stop_parking: &'static AtomicBool) {
        let Self {
            clients,
            stream,
            source,
            ..
        } = self;
        drop(source);
        let mut arm = stream.into_arm();
        arm.set_interrupt(|| match stop_parking.load(Ordering::Relaxed) {
            true => Err("a second signal".into()),
            false => Ok(()),
        });
        clients.log("parking");
        let text = match arm.park(pose, Tolerances::JOINT, PARK_LIMIT) {
            Ok(outcome) => format!("parked: {outcome}"),
            Err(error) => error.to_string(),
        };
        clients.log(&text);
    }

    fn serve(&mut self, stop: &AtomicBool) -> Result<(), Failure> {
        let mut silence = Silence::new(self.clock.now());
        let period = time::Duration::from_micros(self.period.as_micros() as u64);
        let limit = SilenceLimit::REOPEN.at(period);
        while !stop.load(Ordering::Relaxed) {
            let mut is_received = false;
            for input in self.source.receive(self.clock.now(), &mut self.stream)? {
                match input {
                    Input::Reading { at, age, state } => {
                        self.publish(at, self.clock.now() - age, &state);
                        is_received = true;
                    }
                    Input::Event(event) => self.take_event(&event),
                }
            }
            if silence.after_step(self.clock.now(), is_received) >= limit {
                let millis = limit.as_micros() / 1_000;
                return Err(Failure::Arm(format!("no joints were received for {millis} ms")));
            }
            self.take_trajectories();
            self.take_requests()?;
            self.step()?;
            self.clients.serve();
        }
        self.end_stream()
    }

    fn take_event(&mut self, event: &Event) {
        let is_stop = matches!(
            event,
            Event::Refused {
                reason: control::Refusal::Stopped,
                ..
            }
        );
        // Later the setpoint would be far ahead of the arm.
        if is_stop {
            self.is_stopped = true;
            let stop = self.stop_in_force();
            self.motion.abort(&Abort::Stopped(stop));
        }
        let event = adapter::describe_event(event);
        self.clients.log(&format!("adapter event: {event}"));
        self.clients.diagnostics.adapter_event = Some(event);
    }

    /// The stop for which the adapter refuses motion. It is asked after it has refused some, and until it lets motion pass:
    /// it reports only the first refusal of a host on USB.
    fn stop_in_force(&mut self) -> Option<StopInForce> {
        let adapter = self.source.adapter().filter(|_| self.is_stopped)?;
        let stop = adapter.stop_in_force().ok().flatten();
        self.is_stopped = stop.is_some();
        stop
    }

    /// Publishes a reading with this stamp, which was made at `made`.
    fn publish(&mut self, at: i64, made: time::Instant, state: &JointState) {
        let diagnostics = &mut self.clients.diagnostics;
        let Ok(reading) = Reading::new(at, state, self.units) else {
            diagnostics.unusable += 1;
            return;
        };
        diagnostics.readings += 1;
        diagnostics.late += u64::from(reading.is_late_after(&self.latest, stamps::now(), self.period));
        diagnostics.status = Some(reading.state.status);
        self.clients.publish(&reading, &self.joints);
        self.latest = reading;
        self.motion.on_reading(made, &self.latest);
        for pending in &mut self.pending {
            pending.on_joints(made, state);
        }
    }

    fn take_trajectories(&mut self) {
        while let Some(asked) = self.clients.next(&self.joints) {
            match asked {
                Asked::Play(order, reply) => {
                    // The readings may not show a torque-off yet.
                    let mut pending = self.pending.iter();
                    let drops_arm = pending.any(|pending| pending.effect().drops_arm());
                    let accepted = match self.stop_in_force() {
                        _ if drops_arm => Err(Refusal::TorqueOff),
                        Some(stop) => Err(Refusal::Stopped(stop)),
                        None => self.motion.accept(self.clock.now(), stamps::now(), order),
                    };
                    self.clients.answer(&reply, accepted);
                }
                Asked::Hold => self.motion.cancel_all(),
                Asked::Cancel(goals) => goals.into_iter().for_each(|goal| self.motion.cancel(goal)),
            }
        }
    }

    fn take_requests(&mut self) -> Result<(), Failure> {
        while let Some((id, effect)) = self.clients.next_service() {
            if effect == Effect::Zero && !self.clients.arm.allow_set_zero {
                self.clients
                    .respond(effect, id, refused("refused: the node runs without --allow-set-zero"));
                continue;
            }
            if effect.drops_arm() {
                self.motion.abort(&Abort::TorqueLost);
            }
            for earlier in std::mem::take(&mut self.pending) {
                let outcome = refused("sent, but not read back: another request followed");
                self.clients.respond(earlier.effect(), earlier.id, outcome);
            }
            let sent = self.stream.send(effect);
            self.pending.push(Pending::sent(id, effect, self.clock.now()));
            sent?;
        }
        for nth in (0..self.pending.len()).rev() {
            if let Some(outcome) = self.pending[nth].poll(self.clock.now()) {
                let pending = self.pending.swap_remove(nth);
                self.clients.respond(pending.effect(), pending.id, outcome);
            }
        }
        Ok(())
    }

    /// Does what the motion demands.
    fn step(&mut self) -> Result<(), Failure> {
        while let Some(output) = self.motion.poll(self.clock.now()) {
            match output {
                Output::Move(target) => {
                    self.is_streaming = true;
                    match self.stream.move_to(&target) {
                        Err(Error::TorqueOff { .. }) => self.motion.abort(&Abort::TorqueLost),
                        Err(Error::Immovable { reason, .. }) => self.motion.abort(&reason.into()),
                        Err(Error::TorqueSwitched { .. }) => self.motion.abort(&Abort::TorqueSwitched),
                        sent => sent?,
                    }
                }
                Output::Started(origin) => self.clients.started(origin),
                Output::Feedback(goal, progress) => self.clients.feedback(goal, &self.joints, &progress),
                Output::Ended(origin, end) => self.clients.ended(origin, &end),
            }
        }
        self.clients.diagnostics.is_moving = self.motion.is_sending();
        match self.motion.is_sending() {
            true => Ok(()),
            false => self.end_stream(),
        }
    }

    /// Ends the stream at the adapter, which would otherwise report a silent host.
    fn end_stream(&mut self) -> Result<(), Failure> {
        if let Some(adapter) = self.source.adapter().filter(|_| self.is_streaming) {
            adapter.send(control::Request::EndStream)?;
        }
        self.is_streaming = false;
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
