//! The host's session with an arm: it listens, identifies, reads in turn, and moves the arm while an axis is held.
//!
//! A session does no I/O and reads no clock. The page passes bytes and the time in, and writes the transmitted frames.

use std::num::NonZeroU32;

use armwire::ling::effect::{self, Effect, EffectError};
use armwire::ling::legacy::Detector;
use armwire::ling::stop::{self, Grip, StopError, Stopped};
use armwire::ling::{
    Immovable, Info, JointState, Ling, LingClient, MAX_FRAME, MotionStatus, Move, PerServo, ReadBack, Request,
    Response, SelfCheck, Speed, Stop, Stroke, Torque,
};
use armwire::messages::Messages;
use armwire::time::{Duration, Instant};
use armwire::{Config, Event, OutOfRange, Output};

use crate::counters::{AnswerTimes, Counters};
use crate::describe;
use crate::jog::{self, Direction, Jog};
use crate::log::{Log, Record};

/// 1 Mbaud, and the latency of a browser. Reads are cyclic: a lost read is not repeated.
const CONFIG: Config = Config {
    baud: NonZeroU32::new(1_000_000),
    latency: Duration::from_millis(50),
    repeats: 0,
    stale_window: Duration::from_millis(100),
    ..Config::DEFAULT
};
/// Listening time before the first transmission: an arm of the older generation transmits unsolicited, and accepts no
/// bytes.
const LISTEN: Duration = Duration::from_millis(100);
/// Further listening time after each received byte.
const LISTEN_ON: Duration = Duration::from_millis(500);
/// Maximum age of the reading from which a motion starts: the 150 ms after which a motion pauses on a PC
/// (`SilenceLimit::PAUSE` of `armwire-host`, which is not for a browser), and three times the latency of a browser.
const FRESH: Duration = Duration::from_millis(300);
/// Maximum delay of the next target by a read in flight, from its transmission.
const MAX_TARGET_DELAY: Duration = Duration::from_millis(20);
/// Maximum delay of a stop or a change of the torque.
const MAX_STOP_DELAY: Duration = Duration::from_millis(10);
/// Time without an answer after which the page shows an arm as silent: the period of the slow reads. Nothing that moves
/// depends on it.
const SILENT: Duration = Duration::from_millis(1_000);

/// The periods of the reads. If several are due, the slowest is sent first.
const READS: [(Request, Duration); 5] = [
    (Request::ReadInfo, Duration::from_millis(1_000)),
    (Request::ReadStroke, Duration::from_millis(1_000)),
    (Request::SelfCheck, Duration::from_millis(5_000)),
    (Request::ReadTemperatures, Duration::from_millis(1_000)),
    (Request::ReadJoints, Duration::from_millis(20)),
];

/// State of a session. Its numbers are part of the interface to the page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum State {
    /// The session listens and has sent nothing.
    Listening = 0,
    /// The session sends requests without recent answers.
    Silent = 1,
    /// The arm answers.
    Answering = 2,
    /// An arm of the older generation transmits. The session sends nothing.
    OlderGeneration = 3,
}

/// Reason for a held axis without motion. Its numbers are part of the interface to the page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Block {
    /// Motion is not enabled on the page.
    Disabled = 1,
    /// No fresh reading of the joints.
    NoReading = 2,
    /// The torque is off.
    TorqueOff = 3,
    /// The reading has a position out of a target's range.
    OutOfRange = 4,
    /// No document explains the status.
    UnknownStatus = 5,
    /// It is another robot than an Alicia-D.
    Foreign = 6,
}

/// The arm's last readings.
#[derive(Clone, Copy, Debug, Default)]
pub struct Arm {
    /// Joints, gripper and status.
    pub joints: Option<(Instant, JointState)>,
    /// Temperatures in °C.
    pub temperatures: Option<PerServo<u8>>,
    /// Serial number and versions.
    pub info: Option<Info>,
    /// The gripper.
    pub stroke: Option<Stroke>,
    /// The servos.
    pub check: Option<SelfCheck>,
}

/// State of the last stop. Its numbers are part of the interface to the page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum StopState {
    /// No stop since the session or the last motion began.
    None = 0,
    /// The arm is being stopped.
    Stopping = 1,
    /// The arm is at rest.
    Stopped = 2,
    /// The arm is at rest. The gripper's goal was unknown: a grip may have loosened.
    GripMayLoosen = 3,
    /// The arm has no torque. Nothing was sent.
    WithoutTorque = 4,
    /// The arm may still move.
    Failed = 5,
}

impl From<Result<Stopped, StopError>> for StopState {
    fn from(result: Result<Stopped, StopError>) -> Self {
        match result {
            Ok(Stopped::AtRest { grip: Grip::Goal, .. }) => Self::Stopped,
            Ok(Stopped::AtRest {
                grip: Grip::Reading, ..
            }) => Self::GripMayLoosen,
            Ok(Stopped::WithoutTorque(_)) => Self::WithoutTorque,
            Err(_) => Self::Failed,
        }
    }
}

/// State of the last change of the torque. Its numbers are part of the interface to the page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum TorqueState {
    /// No change since the session or the last motion or stop began.
    None = 0,
    /// The torque is being switched.
    Switching = 1,
    /// A reading shows the torque.
    Confirmed = 2,
    /// The status does not show the torque.
    NotShown = 3,
    /// The status shows that the torque was not switched.
    Contradicted = 4,
    /// No reading came.
    NoReading = 5,
}

impl From<Option<&ReadBack>> for TorqueState {
    fn from(torque: Option<&ReadBack>) -> Self {
        match torque.map(ReadBack::result) {
            None => Self::None,
            Some(None) => Self::Switching,
            Some(Some(Ok(outcome))) if outcome.is_shown => Self::Confirmed,
            Some(Some(Ok(_))) => Self::NotShown,
            Some(Some(Err(EffectError::Contradicted { .. }))) => Self::Contradicted,
            Some(Some(Err(_))) => Self::NoReading,
        }
    }
}

/// A stop in progress.
#[derive(Debug)]
struct Stopping {
    stop: Stop,
    /// Time of its next request. `None` while that is in flight.
    due: Option<Instant>,
}

/// The session.
#[derive(Debug)]
pub struct Session {
    client: LingClient,
    detector: Detector,
    log: Log,
    jog: Jog,
    arm: Arm,
    counters: Counters,
    times: AnswerTimes,
    state: State,
    motion_enabled: bool,
    listen_until: Instant,
    /// Torque on or off, as requested by the user, and its read-back. It is sent before all other requests.
    torque: Option<ReadBack>,
    stopping: Option<Stopping>,
    stop_state: StopState,
    /// The last target. `None` after the torque was off: the arm then holds nothing.
    target: Option<Move>,
    /// Due time of each of [`READS`]; `None` once a constant value is known.
    reads: [Option<Instant>; READS.len()],
    /// Due time of the next target.
    next_target: Instant,
    /// The request in flight, with its transmission time.
    in_flight: Option<(Request, Instant)>,
    last_answer: Option<Instant>,
    timeout: Option<Instant>,
}

impl Session {
    /// Creates a session that listens from `now` on.
    pub fn new(now: Instant) -> Self {
        Self {
            client: LingClient::new(Ling, CONFIG),
            detector: Detector::new(),
            log: Log::default(),
            jog: Jog::default(),
            arm: Arm::default(),
            counters: Counters::default(),
            times: AnswerTimes::default(),
            state: State::Listening,
            motion_enabled: false,
            listen_until: now + LISTEN,
            torque: None,
            stopping: None,
            stop_state: StopState::None,
            target: None,
            reads: [Some(now); READS.len()],
            next_target: now,
            in_flight: None,
            last_answer: None,
            timeout: Some(now + LISTEN),
        }
    }

    /// Processes bytes from the arm.
    pub fn receive(&mut self, now: Instant, mut bytes: &[u8]) {
        self.counters.bytes_in += bytes.len() as u64;
        self.log.received(now, bytes);
        if self.detector.push(bytes).is_some() {
            self.state = State::OlderGeneration;
            self.client.cancel();
        }
        if self.state == State::Listening {
            self.listen_until = now + LISTEN_ON;
        }
        while !bytes.is_empty() {
            bytes = self.client.receive(now, bytes);
            while self.take_event(now) {}
        }
    }

    /// Writes the next frame for the arm at the front of `out` and returns its length; 0 if there is nothing to send
    /// now.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] when `out` is shorter than the frame. Nothing is sent then.
    pub fn transmit(&mut self, now: Instant, out: &mut [u8]) -> Result<usize, OutOfRange<usize>> {
        if self.state == State::OlderGeneration {
            self.timeout = None;
            return Ok(0);
        }
        if self.state == State::Listening {
            if now < self.listen_until {
                self.timeout = Some(self.listen_until);
                return Ok(0);
            }
            self.state = State::Silent;
        }
        self.interrupt(now);
        while self.take_event(now) {}
        if self.client.is_idle() {
            self.submit_next(now);
        }
        if matches!(self.client.poll(now), Output::Receive) {
            // The page passes bytes in as soon as it has them.
            self.client.received(now, 0)?;
        }
        match self.client.poll(now) {
            Output::Transmit(frame) => {
                let (len, max) = (frame.len(), out.len());
                let to = out
                    .get_mut(..len)
                    .ok_or(OutOfRange::new("frame", "bytes", len, 0, max))?;
                to.copy_from_slice(frame);
                self.client.transmitted(now, len)?;
                self.log.sent(now, to);
                self.counters.bytes_out += len as u64;
                self.counters.requests += 1;
                if let Some((_, sent)) = &mut self.in_flight {
                    *sent = now;
                }
                return Ok(len);
            }
            Output::Timeout(until) => {
                let own = if self.client.is_idle() {
                    self.next_due()
                } else {
                    self.interruption()
                };
                self.timeout = [until, own].into_iter().flatten().min();
            }
            // All events were taken, and `submit` causes none.
            Output::Event(_) | Output::Receive => {}
        }
        self.update_state(now);
        Ok(0)
    }

    /// Returns the time of the next call of [`transmit`](Self::transmit), unless bytes or user actions come earlier.
    pub fn timeout(&self) -> Option<Instant> {
        self.timeout
    }

    /// Enables or disables motion of held axes.
    pub fn enable_motion(&mut self, now: Instant, enabled: bool) {
        self.motion_enabled = enabled;
        if !enabled {
            self.release(now);
        }
    }

    /// Holds an axis, 0 to 5 for the joints and 6 for the gripper, or releases it.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] for another axis.
    pub fn hold(&mut self, now: Instant, axis: usize, direction: Direction) -> Result<(), OutOfRange<usize>> {
        if self.jog.hold(now, axis, direction)? {
            self.next_target = now;
            match self.jog.is_held() {
                true => {
                    self.end_stop(StopState::None);
                    self.forget_torque();
                }
                false => self.stop_jog(now),
            }
        }
        Ok(())
    }

    /// Releases all axes and ends their motion.
    pub fn release(&mut self, now: Instant) {
        if self.jog.release(now) {
            self.stop_jog(now);
        }
    }

    /// Stops the arm, whatever moves it. It keeps its torque.
    pub fn stop(&mut self, now: Instant) {
        self.forget_torque();
        self.jog.release(now);
        match self.jog.is_moving() {
            true => self.stop_jog(now),
            false => self.begin_stop(now, self.stop_here()),
        }
    }

    /// Returns the state of the last stop.
    pub fn stop_state(&self) -> StopState {
        self.stop_state
    }

    /// Sets the speed of held joints.
    pub fn set_speed(&mut self, speed: Speed) {
        self.jog.set_speed(speed);
    }

    /// Switches the torque and reads it back. With torque off the arm can fall. Another robot than an Alicia-D gets no
    /// torque-on.
    pub fn set_torque(&mut self, now: Instant, torque: Torque) {
        let is_foreign = |(_, reading): (Instant, JointState)| matches!(reading.status, MotionStatus::Foreign(_));
        if torque == Torque::On && self.arm.joints.is_some_and(is_foreign) {
            return;
        }
        self.jog.release(now);
        self.jog.reset();
        self.end_stop(StopState::None);
        if torque == Torque::Off {
            self.target = None;
        }
        self.torque = Some(ReadBack::new(Effect::Torque(torque)));
    }

    /// Returns the state of the last change of the torque.
    pub fn torque_state(&self) -> TorqueState {
        self.torque.as_ref().into()
    }

    /// Returns the state.
    pub fn state(&self) -> State {
        self.state
    }

    /// Returns the reason for a held axis without motion, if there is one.
    pub fn block(&self, now: Instant) -> Option<Block> {
        if !self.motion_enabled {
            return Some(Block::Disabled);
        }
        let Some(reading) = self.fresh(now) else {
            return Some(Block::NoReading);
        };
        match reading.status.check_motion() {
            Err(Immovable::TorqueOff(_)) => return Some(Block::TorqueOff),
            Err(Immovable::UnknownStatus(_)) => return Some(Block::UnknownStatus),
            Err(_) => return Some(Block::Foreign),
            Ok(()) => {}
        }
        let in_range = reading.positions().is_ok() && reading.opening().is_ok();
        (!in_range).then_some(Block::OutOfRange)
    }

    /// Returns the arm's last readings.
    pub fn arm(&self) -> &Arm {
        &self.arm
    }

    /// Returns the counters.
    pub fn counters(&self) -> Counters {
        Counters {
            bad_checksums: self.log.bad_checksums(),
            noise_bytes: self.log.noise_bytes(),
            ..self.counters
        }
    }

    /// Returns the response times.
    pub fn answer_times(&self) -> AnswerTimes {
        self.times
    }

    /// Takes the oldest queued record of the line.
    pub fn take_record(&mut self) -> Option<Record> {
        self.log.take()
    }

    /// Ends the motion of released axes, if there is one, at its setpoint.
    fn stop_jog(&mut self, now: Instant) {
        if !self.jog.is_moving() {
            return;
        }
        let reading = self.arm.joints.map(|(_, reading)| reading);
        let target = reading.and_then(|reading| self.jog.stop(now, &reading));
        self.jog.reset();
        self.begin_stop(now, target.map_or_else(|| self.stop_here(), Stop::at));
    }

    /// A stop that waits for a reading.
    fn stop_here(&self) -> Stop {
        self.target.as_ref().map_or_else(|| Stop::new(None), Stop::after)
    }

    fn begin_stop(&mut self, now: Instant, stop: Stop) {
        self.stopping = Some(Stopping { stop, due: Some(now) });
        self.stop_state = StopState::Stopping;
    }

    fn end_stop(&mut self, state: StopState) {
        self.stopping = None;
        self.stop_state = state;
    }

    /// Forgets the result of a change of the torque. One in progress goes on.
    fn forget_torque(&mut self) {
        if self.torque_state() != TorqueState::Switching {
            self.torque = None;
        }
    }

    /// Returns the last reading, if it is fresh.
    fn fresh(&self, now: Instant) -> Option<&JointState> {
        let (at, reading) = self.arm.joints.as_ref()?;
        (now.since(*at) <= FRESH).then_some(reading)
    }

    /// Cancels the request in flight when a motion or a stop must not wait longer for its answer.
    fn interrupt(&mut self, now: Instant) {
        if self.interruption().is_some_and(|at| at <= now) && self.client.expects_answer() {
            self.client.cancel();
            self.in_flight = None;
        }
    }

    /// Returns the time at which the read in flight is abandoned for another request.
    fn interruption(&self) -> Option<Instant> {
        let (_, sent) = self.in_flight?;
        if self.torque.as_ref().is_some_and(|torque| !torque.is_sent()) {
            return Some(sent + MAX_STOP_DELAY);
        }
        if let Some(stopping) = &self.stopping {
            return stopping.due.map(|due| due.max(sent + MAX_STOP_DELAY));
        }
        self.jog
            .is_held()
            .then(|| self.next_target.max(sent + MAX_TARGET_DELAY))
    }

    /// Submits the most urgent request that is due.
    fn submit_next(&mut self, now: Instant) {
        let Some(request) = self.next_request(now) else {
            return;
        };
        // The client is idle, and its buffer fits every request.
        if self.client.submit(&request).is_ok() {
            self.in_flight = Some((request, now));
        }
    }

    fn next_request(&mut self, now: Instant) -> Option<Request> {
        // The joints are read anyway.
        if let Some(torque) = &mut self.torque
            && let effect::Output::Request(request @ Request::SetTorque(_)) = torque.poll(now)
        {
            return Some(request);
        }
        if let Some(stopping) = &mut self.stopping {
            stopping.due = None;
            match stopping.stop.poll(now) {
                stop::Output::Request(request) => {
                    self.target = stopping.stop.held().copied().or(self.target);
                    return Some(request);
                }
                stop::Output::Wait(until) => stopping.due = Some(until),
                stop::Output::Done(result) => self.end_stop(result.into()),
            }
        }
        if self.jog.is_held() && self.next_target <= now {
            self.next_target = now + jog::PERIOD;
            let reading = self.fresh(now).copied().filter(|_| self.block(now).is_none());
            match reading.and_then(|reading| self.jog.target(now, &reading).ok()) {
                Some(target) => {
                    self.target = Some(target);
                    return Some(Request::Move(target));
                }
                None => self.jog.reset(),
            }
        }
        let due = |at: &Option<Instant>| at.is_some_and(|at| at <= now);
        let read = self.reads.iter().position(due)?;
        let (request, period) = READS[read];
        self.reads[read] = Some(now + period);
        Some(request)
    }

    /// Returns the due time of the next request without an event.
    fn next_due(&self) -> Option<Instant> {
        let target = self.jog.is_held().then_some(self.next_target);
        let stop = self.stopping.as_ref().and_then(|stopping| stopping.due);
        self.reads.into_iter().chain([target, stop]).flatten().min()
    }

    /// Takes one event of the client, if there is one.
    fn take_event(&mut self, now: Instant) -> bool {
        let Output::Event(event) = self.client.poll(now) else {
            return false;
        };
        let counters = &mut self.counters;
        match event {
            Event::Answer(response) => {
                counters.answers += 1;
                self.answered(now);
                self.store(now, &response);
                // A late reading is too old for a stop and for a read-back.
                if let Response::Joints(state) = response {
                    if let Some(stopping) = &mut self.stopping {
                        stopping.stop.on_joints(now, &state);
                        stopping.due = Some(now);
                    }
                    if let Some(torque) = &mut self.torque {
                        torque.on_joints(now, &state);
                    }
                }
            }
            Event::Unacceptable(_) | Event::ErrorFrame { .. } => {
                counters.unknown += 1;
                self.answered(now);
            }
            Event::Sent => self.in_flight = None,
            Event::TimedOut { .. } => {
                counters.unanswered += 1;
                if let Some((request, _)) = self.in_flight.take() {
                    self.log.unanswered(now, &name(&request));
                }
            }
            Event::Late(response) => {
                counters.late += 1;
                self.store(now, &response);
            }
            Event::Unsolicited(_) => counters.unsolicited += 1,
            Event::Echo => counters.echoes += 1,
            Event::Unknown { .. } => counters.unknown += 1,
            // The log counts it.
            Event::Noise { .. } | Event::Broken { .. } => {}
        }
        true
    }

    fn answered(&mut self, now: Instant) {
        self.last_answer = Some(now);
        if let Some((_, sent)) = self.in_flight.take() {
            self.times.add(now.since(sent));
        }
    }

    /// Stores the values of a response, in time or late.
    fn store(&mut self, now: Instant, response: &Response) {
        let arm = &mut self.arm;
        match *response {
            Response::Info(info) => {
                arm.info = Some(info);
                self.end_read(Request::ReadInfo);
            }
            Response::Stroke(stroke) => {
                arm.stroke = Some(stroke);
                self.end_read(Request::ReadStroke);
            }
            Response::Joints(state) => {
                arm.joints = Some((now, state));
                if state.status.is_torque_off() {
                    self.target = None;
                }
            }
            Response::Temperatures(celsius) => arm.temperatures = Some(celsius),
            Response::SelfCheck(check) => arm.check = Some(check),
            // Velocities are not requested.
            _ => {}
        }
    }

    /// Removes a read with a constant answer from the cycle.
    fn end_read(&mut self, constant: Request) {
        for (due, (request, _)) in self.reads.iter_mut().zip(READS) {
            if request == constant {
                *due = None;
            }
        }
    }

    fn update_state(&mut self, now: Instant) {
        let answers = self.last_answer.is_some_and(|at| now.since(at) <= SILENT);
        self.state = if answers { State::Answering } else { State::Silent };
    }
}

/// Describes a request.
fn name(request: &Request) -> String {
    let mut frame = [0; MAX_FRAME];
    // The buffer fits every request.
    let len = Ling.encode_request(request, &mut frame).unwrap_or_default();
    describe::request(&frame[..len])
}

#[cfg(test)]
mod tests;
