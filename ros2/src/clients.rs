//! The clients of one arm on the ROS network: what they ask for, and what they are told. Independent of the arm's port.

use std::io::{Write, stderr};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use armwire::ling::Torque;
use armwire::ling::effect::Effect;
use armwire_host::joints_file::Joint;
use armwire_host::{Known, stamps};
use ros2_client::action::{CancelGoalRequest, GoalId, GoalInfo, SendGoalRequest, SendGoalResponse};
use ros2_client::{Gid, ReadError, RmwRequestId};
use rustdds::RepresentationIdentifier;
use rustdds::serialization::{self, deserialize_from_cdr_with_rep_id, to_writer_with_rep_id};

use crate::diagnostics::Diagnostics;
use crate::goals::Goals;
use crate::joint_states::Reading;
use crate::messages::{
    Decoded, FollowFeedback, FollowGoal, Header, JointTrajectoryPoint, MultiDofPoint, Outcome, Time,
};
use crate::motion::{End, Order, Origin, Progress};
use crate::node::Endpoints;
use crate::numbers::Numbers;
use crate::options::Arm;
use crate::services::refused;
use crate::tolerances::Tolerances;
use crate::trajectory::Refusal;

/// Time between two diagnostics.
const DIAGNOSTICS_PERIOD: Duration = Duration::from_secs(1);
/// Time between two checks for requests while the arm is absent.
const REQUEST_PERIOD: Duration = Duration::from_millis(20);

/// The clients of one arm.
pub(crate) struct Clients<'a> {
    pub(crate) arm: &'a Arm,
    pub(crate) diagnostics: Diagnostics,
    /// The arm before its port was lost. `None` before it was first opened.
    pub(crate) known: Option<Known>,
    endpoints: &'a Endpoints,
    goals: Goals<RmwRequestId>,
    /// The published states of the goals are out of date.
    is_changed: bool,
    numbers: Numbers<Gid>,
    /// Time of the last published diagnostics.
    published: Option<Instant>,
}

/// A request of a client.
pub(crate) enum Asked {
    /// To play a trajectory. The answer goes to [`Clients::answer`].
    Play(Order, Reply),
    /// To end all motion.
    Hold,
    /// To end these goals.
    Cancel(Vec<GoalId>),
}

/// The recipient of the answer to an order: a topic has none.
pub(crate) struct Reply(Option<(RmwRequestId, GoalId)>);

/// The next item of a reader.
enum Received<T> {
    Message(T),
    Undecodable,
    Nothing,
}

impl<T> Received<T> {
    fn of(taken: Result<Option<T>, ReadError>) -> Self {
        match taken {
            Ok(Some(message)) => Self::Message(message),
            Err(ReadError::Deserialization { .. }) => Self::Undecodable,
            // The others are the end of the reader.
            Ok(None) | Err(_) => Self::Nothing,
        }
    }
}

impl<'a> Clients<'a> {
    pub(crate) fn new(arm: &'a Arm, endpoints: &'a Endpoints) -> Self {
        Self {
            arm,
            diagnostics: Diagnostics::new(arm.port.to_string()),
            known: None,
            endpoints,
            goals: Goals::new(),
            is_changed: true,
            numbers: Numbers::new(),
            published: None,
        }
    }

    pub(crate) fn log(&self, text: &str) {
        // A closed standard error must not stop an arm.
        let _ = writeln!(stderr(), "armwire-ros2: {}: {text}", self.arm.name);
    }

    /// The next request of a client, for an arm with these joints. An impossible one is refused.
    ///
    /// Goals come before requests to cancel them: a goal that is cancelled at once does not begin.
    pub(crate) fn next(&mut self, joints: &[Joint]) -> Option<Asked> {
        self.next_of_topic()
            .or_else(|| self.next_goal(joints))
            .or_else(|| self.next_cancel())
    }

    fn next_of_topic(&mut self) -> Option<Asked> {
        loop {
            match Received::of(self.endpoints.trajectories.take()) {
                Received::Message((Decoded(message), info)) => {
                    let missing = self
                        .numbers
                        .missing_before(info.publisher_gid(), info.sequence_number());
                    self.diagnostics.lose(missing);
                    match message {
                        Ok(trajectory) if trajectory.joint_names.is_empty() && trajectory.points.is_empty() => {
                            return Some(Asked::Hold);
                        }
                        Ok(trajectory) => {
                            let order = Order {
                                origin: Origin::Topic,
                                trajectory,
                                tolerances: None,
                            };
                            return Some(Asked::Play(order, Reply(None)));
                        }
                        Err(_) => self.refuse(&Refusal::Undecodable),
                    }
                }
                Received::Undecodable => self.refuse(&Refusal::Undecodable),
                Received::Nothing => return None,
            }
        }
    }

    fn next_goal(&mut self, joints: &[Joint]) -> Option<Asked> {
        loop {
            match Received::of(self.endpoints.follow.receive_goal()) {
                Received::Message((request, SendGoalRequest { goal_id, goal })) => {
                    let reply = Reply(Some((request, goal_id)));
                    match self.order(goal_id, goal, joints) {
                        Ok(order) => return Some(Asked::Play(order, reply)),
                        Err(refusal) => self.answer(&reply, Err(refusal)),
                    }
                }
                Received::Undecodable => self.refuse(&Refusal::Undecodable),
                Received::Nothing => return None,
            }
        }
    }

    fn order(&self, id: GoalId, goal: Decoded<FollowGoal>, joints: &[Joint]) -> Result<Order, Refusal> {
        let Decoded(Ok(goal)) = goal else {
            return Err(Refusal::Undecodable);
        };
        if self.goals.is_known(id) {
            return Err(Refusal::RepeatedGoal);
        }
        let multi_dof = &goal.multi_dof_trajectory;
        let is_single = multi_dof.joint_names.is_empty() && multi_dof.points.is_empty();
        if !is_single || !goal.component_path_tolerance.is_empty() || !goal.component_goal_tolerance.is_empty() {
            return Err(Refusal::MultiDof);
        }
        Ok(Order {
            origin: Origin::Goal(id),
            tolerances: Some(Tolerances::of(&goal, joints, self.arm.joints.goal_time)?),
            trajectory: goal.trajectory,
        })
    }

    fn next_cancel(&mut self) -> Option<Asked> {
        loop {
            match Received::of(self.endpoints.follow.receive_cancel_request()) {
                Received::Message((id, request)) => {
                    let Ok(asked) = info(&request) else {
                        self.diagnostics.undecodable += 1;
                        continue;
                    };
                    let response = self.goals.cancel(&asked);
                    let goals: Vec<_> = response.goals_canceling.iter().map(|info| info.goal_id).collect();
                    self.sent(self.endpoints.follow.send_cancel_response(id, response));
                    if !goals.is_empty() {
                        return Some(Asked::Cancel(goals));
                    }
                }
                Received::Undecodable => self.diagnostics.undecodable += 1,
                Received::Nothing => return None,
            }
        }
    }

    /// Tells a client if its trajectory is accepted.
    pub(crate) fn answer(&mut self, reply: &Reply, accepted: Result<(), Refusal>) {
        match &accepted {
            Ok(()) => self.diagnostics.accept(),
            Err(refusal) => self.refuse(refusal),
        }
        let Some((request, goal_id)) = reply.0 else { return };
        let stamp = ros2_client::builtin_interfaces::Time::from_nanos(stamps::now());
        if accepted.is_ok() {
            self.goals.accept(GoalInfo { goal_id, stamp });
            self.is_changed = true;
        }
        let response = SendGoalResponse {
            accepted: accepted.is_ok(),
            stamp,
        };
        self.sent(self.endpoints.follow.send_goal_response(request, response));
    }

    /// Takes the start of an accepted trajectory.
    pub(crate) fn started(&mut self, origin: Origin) {
        if let Origin::Goal(id) = origin {
            self.goals.start(id);
            self.is_changed = true;
        }
    }

    /// Takes the end of an accepted trajectory.
    pub(crate) fn ended(&mut self, origin: Origin, end: &End) {
        let now = Instant::now();
        if let Some(text) = self.diagnostics.end(now, end) {
            self.log(&text);
        }
        let Origin::Goal(id) = origin else { return };
        let (result, waiting) = self.goals.end(now, id, end);
        self.is_changed = true;
        for request in waiting {
            self.sent(self.endpoints.follow.send_result(request, result.clone()));
        }
    }

    pub(crate) fn feedback(&self, goal: GoalId, joints: &[Joint], progress: &Progress) {
        let point = |positions: Vec<f64>| JointTrajectoryPoint {
            positions,
            time_from_start: Time::of_duration(progress.elapsed),
            ..Default::default()
        };
        let error = progress.desired.iter().zip(&progress.actual);
        let feedback = FollowFeedback {
            header: Header {
                stamp: Time::from_nanos(progress.at),
                frame_id: String::new(),
            },
            joint_names: joints.iter().map(|joint| joint.name.clone()).collect(),
            desired: point(progress.desired.clone()),
            actual: point(progress.actual.clone()),
            error: point(error.map(|(desired, actual)| desired - actual).collect()),
            multi_dof_joint_names: Vec::new(),
            multi_dof_desired: MultiDofPoint::default(),
            multi_dof_actual: MultiDofPoint::default(),
            multi_dof_error: MultiDofPoint::default(),
        };
        // A client that is too slow gets the next one.
        let _ = self.endpoints.follow.send_feedback(goal, feedback);
    }

    /// Publishes a reading.
    pub(crate) fn publish(&mut self, reading: &Reading, joints: &[Joint]) {
        if self.endpoints.states.publish(reading.to_message(joints)).is_err() {
            self.diagnostics.dropped += 1;
        }
    }

    /// Answers requests for results, and publishes the states of goals and the diagnostics when they are due.
    pub(crate) fn serve(&mut self) {
        let now = Instant::now();
        loop {
            match Received::of(self.endpoints.follow.receive_result_request()) {
                Received::Message((id, request)) => {
                    if let Some((id, result)) = self.goals.ask(request.goal_id, id) {
                        self.sent(self.endpoints.follow.send_result(id, result));
                    }
                }
                Received::Undecodable => self.diagnostics.undecodable += 1,
                Received::Nothing => break,
            }
        }
        self.is_changed |= self.goals.forget(now);
        if self.is_changed {
            // Later, if a reader is too slow.
            self.is_changed = self.endpoints.follow.send_goal_statuses(self.goals.statuses()).is_err();
        }
        if self
            .published
            .is_none_or(|published| now.duration_since(published) >= DIAGNOSTICS_PERIOD)
        {
            self.published = Some(now);
            let message = self.diagnostics.to_message(&self.arm.name, now);
            // A reader that is too slow gets the next one.
            let _ = self.endpoints.diagnostics.publish(message);
        }
    }

    /// The next service request, with its effect.
    pub(crate) fn next_service(&mut self) -> Option<(RmwRequestId, Effect)> {
        loop {
            match Received::of(self.endpoints.torque.receive_request()) {
                Received::Message((id, Decoded(Ok(request)))) => return Some((id, torque(request.data))),
                Received::Message((id, Decoded(Err(_)))) => self.refuse_undecodable(id, Effect::Torque(Torque::Off)),
                Received::Undecodable => self.diagnostics.undecodable += 1,
                Received::Nothing => break,
            }
        }
        loop {
            match Received::of(self.endpoints.set_zero.receive_request()) {
                Received::Message((id, Decoded(Ok(_)))) => return Some((id, Effect::Zero)),
                Received::Message((id, Decoded(Err(_)))) => self.refuse_undecodable(id, Effect::Zero),
                Received::Undecodable => self.diagnostics.undecodable += 1,
                Received::Nothing => return None,
            }
        }
    }

    fn refuse_undecodable(&mut self, id: RmwRequestId, service: Effect) {
        self.diagnostics.undecodable += 1;
        self.respond(service, id, refused("the request cannot be decoded"));
    }

    pub(crate) fn respond(&self, service: Effect, id: RmwRequestId, outcome: Outcome) {
        self.sent(match service {
            Effect::Torque(_) => self.endpoints.torque.send_response(id, outcome),
            Effect::Zero => self.endpoints.set_zero.send_response(id, outcome),
        });
    }

    /// Refuses all requests for this time, while the arm is absent.
    pub(crate) fn refuse_all_for(&mut self, time: Duration, stop: &AtomicBool) {
        let until = Instant::now() + time;
        while Instant::now() < until && !stop.load(Ordering::Relaxed) {
            while let Some(asked) = self.next(&self.arm.joints.all) {
                if let Asked::Play(_, reply) = asked {
                    self.answer(&reply, Err(Refusal::NoArm));
                }
            }
            while let Some((id, effect)) = self.next_service() {
                self.respond(effect, id, refused("the arm does not answer"));
            }
            self.serve();
            thread::sleep(REQUEST_PERIOD);
        }
    }

    fn refuse(&mut self, refusal: &Refusal) {
        if let Some(text) = self.diagnostics.refuse(Instant::now(), refusal) {
            self.log(&text);
        }
    }

    fn sent<E: std::fmt::Display>(&self, sent: Result<(), E>) {
        if let Err(error) = sent {
            self.log(&format!("a response is lost: {error}"));
        }
    }
}

fn torque(on: bool) -> Effect {
    Effect::Torque(if on { Torque::On } else { Torque::Off })
}

/// The goals that a request cancels. `ros2-client` keeps this field to itself, so that it is read from the request's bytes.
fn info(request: &CancelGoalRequest) -> serialization::Result<GoalInfo> {
    let mut bytes = Vec::new();
    to_writer_with_rep_id(&mut bytes, request, RepresentationIdentifier::CDR_LE)?;
    Ok(deserialize_from_cdr_with_rep_id(&bytes, RepresentationIdentifier::CDR_LE)?.0)
}
