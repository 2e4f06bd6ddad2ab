//! The goals of the action: their states, their results, and who asked for them. No clock and no I/O.

use std::time::{Duration, Instant};

use ros2_client::action::{CancelGoalResponse, GetResultResponse, GoalId, GoalInfo, GoalStatusEnum};
use ros2_client::action_msgs::{CancelGoalResponseEnum, GoalStatus, GoalStatusArray};
use ros2_client::builtin_interfaces::Time;

use crate::messages::FollowResult;
use crate::motion::{Abort, End};

/// Time for which the result of a goal is kept, as in ROS 2 Jazzy.
const RESULT_TIMEOUT: Duration = Duration::from_secs(10);
/// Maximum number of goals. The oldest that has ended makes room.
const MAX_KNOWN: usize = 64;
/// Maximum number of requests that wait for the result of one goal.
const MAX_WAITING: usize = 16;

/// The goals, and the requests `I` for their results.
#[derive(Debug)]
pub(crate) struct Goals<I> {
    known: Vec<Goal<I>>,
}

#[derive(Debug)]
struct Goal<I> {
    info: GoalInfo,
    state: State<I>,
}

#[derive(Debug)]
enum State<I> {
    /// Accepted, and not started unless `started`.
    Active { started: bool, waiting: Vec<I> },
    Ended {
        at: Instant,
        result: GetResultResponse<FollowResult>,
    },
}

impl<I> State<I> {
    fn status(&self) -> GoalStatusEnum {
        match self {
            Self::Active { started: false, .. } => GoalStatusEnum::Accepted,
            Self::Active { started: true, .. } => GoalStatusEnum::Executing,
            Self::Ended { result, .. } => result.status,
        }
    }
}

impl<I> Goals<I> {
    /// No goals.
    pub(crate) fn new() -> Self {
        Self { known: Vec::new() }
    }

    /// Returns true for a goal that was accepted and is not forgotten. Its identifier must not be used again.
    pub(crate) fn is_known(&self, id: GoalId) -> bool {
        self.known.iter().any(|goal| goal.info.goal_id == id)
    }

    pub(crate) fn accept(&mut self, info: GoalInfo) {
        let is_ended = |goal: &Goal<I>| matches!(goal.state, State::Ended { .. });
        let oldest = self.known.iter().position(is_ended);
        if let Some(oldest) = oldest.filter(|_| self.known.len() >= MAX_KNOWN) {
            self.known.remove(oldest);
        }
        self.known.push(Goal {
            info,
            state: State::Active {
                started: false,
                waiting: Vec::new(),
            },
        });
    }

    pub(crate) fn start(&mut self, id: GoalId) {
        if let Some(State::Active { started, .. }) = self.state(id) {
            *started = true;
        }
    }

    /// Ends a goal. Returns its result and the requests that wait for it.
    pub(crate) fn end(&mut self, now: Instant, id: GoalId, end: &End) -> (GetResultResponse<FollowResult>, Vec<I>) {
        let result = result(end);
        let ended = State::Ended {
            at: now,
            result: result.clone(),
        };
        let before = self.state(id).map(|state| std::mem::replace(state, ended));
        match before {
            Some(State::Active { waiting, .. }) => (result, waiting),
            _ => (result, Vec::new()),
        }
    }

    /// Takes a request for a result. Returns the result, unless it is returned by [`Self::end`].
    pub(crate) fn ask(&mut self, id: GoalId, request: I) -> Option<(I, GetResultResponse<FollowResult>)> {
        match self.state(id) {
            Some(State::Ended { result, .. }) => Some((request, result.clone())),
            Some(State::Active { waiting, .. }) if waiting.len() < MAX_WAITING => {
                waiting.push(request);
                None
            }
            Some(State::Active { .. }) => Some((request, unknown("too many requests wait for this goal"))),
            None => Some((request, unknown("the goal is unknown"))),
        }
    }

    /// The answer to a request to cancel goals, by `rcl_action_process_cancel_request`: an identifier of zero means all
    /// goals, and a time that of the goals accepted until then.
    pub(crate) fn cancel(&self, asked: &GoalInfo) -> CancelGoalResponse {
        let (zero, never) = (GoalId::ZERO, Time::ZERO);
        let is_asked = |info: &GoalInfo| match (asked.goal_id, asked.stamp) {
            (id, stamp) if id == zero && stamp == never => true,
            (id, stamp) => (id != zero && id == info.goal_id) || (stamp != never && info.stamp <= stamp),
        };
        let asked_for: Vec<_> = self.known.iter().filter(|goal| is_asked(&goal.info)).collect();
        let active = asked_for
            .iter()
            .filter(|goal| matches!(goal.state, State::Active { .. }));
        let goals_canceling: Vec<GoalInfo> = active.map(|goal| goal.info.clone()).collect();
        let is_one = asked.goal_id != zero && asked.stamp == never;
        let return_code = match (is_one, asked_for.is_empty()) {
            (true, true) => CancelGoalResponseEnum::UnknownGoal,
            (true, false) if goals_canceling.is_empty() => CancelGoalResponseEnum::GoalTerminated,
            _ => CancelGoalResponseEnum::None,
        };
        CancelGoalResponse {
            return_code,
            goals_canceling,
        }
    }

    pub(crate) fn statuses(&self) -> GoalStatusArray {
        let status = |goal: &Goal<I>| GoalStatus {
            goal_info: goal.info.clone(),
            status: goal.state.status(),
        };
        GoalStatusArray {
            status_list: self.known.iter().map(status).collect(),
        }
    }

    /// Forgets goals that ended long ago. Returns true if there were any.
    pub(crate) fn forget(&mut self, now: Instant) -> bool {
        let before = self.known.len();
        self.known.retain(|goal| match goal.state {
            State::Ended { at, .. } => now.duration_since(at) < RESULT_TIMEOUT,
            State::Active { .. } => true,
        });
        self.known.len() != before
    }

    fn state(&mut self, id: GoalId) -> Option<&mut State<I>> {
        let goal = self.known.iter_mut().find(|goal| goal.info.goal_id == id)?;
        Some(&mut goal.state)
    }
}

fn unknown(why: &str) -> GetResultResponse<FollowResult> {
    GetResultResponse {
        status: GoalStatusEnum::Unknown,
        result: FollowResult {
            error_code: FollowResult::INVALID_GOAL,
            error_string: why.to_owned(),
        },
    }
}

/// The result of a goal that ended so. The action has no code for the loss of an arm: as in ROS 2's controller, all but the
/// tolerances is `INVALID_GOAL`.
fn result(end: &End) -> GetResultResponse<FollowResult> {
    let (status, error_code, error_string) = match end {
        End::Finished => (GoalStatusEnum::Succeeded, FollowResult::SUCCESSFUL, String::new()),
        End::Cancelled => (
            GoalStatusEnum::Canceled,
            FollowResult::SUCCESSFUL,
            "cancelled".to_owned(),
        ),
        End::Replaced => (
            GoalStatusEnum::Aborted,
            FollowResult::INVALID_GOAL,
            "another trajectory began".to_owned(),
        ),
        End::Aborted(abort) => {
            let code = match abort {
                Abort::Path { .. } => FollowResult::PATH_TOLERANCE_VIOLATED,
                Abort::Goal { .. } => FollowResult::GOAL_TOLERANCE_VIOLATED,
                _ => FollowResult::INVALID_GOAL,
            };
            (GoalStatusEnum::Aborted, code, abort.to_string())
        }
    };
    GetResultResponse {
        status,
        result: FollowResult {
            error_code,
            error_string,
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trajectory::Refusal;

    fn info(id: GoalId, seconds: i32) -> GoalInfo {
        GoalInfo {
            goal_id: id,
            stamp: Time::new(seconds, 0),
        }
    }

    /// Goals accepted at 1, 2 and 3 s, of which the first has ended.
    fn goals() -> (Goals<u32>, [GoalId; 3], Instant) {
        let ids = [(); 3].map(|()| GoalId::new_random());
        let (mut goals, now) = (Goals::new(), Instant::now());
        for (id, seconds) in ids.into_iter().zip(1..) {
            goals.accept(info(id, seconds));
        }
        goals.end(now, ids[0], &End::Finished);
        (goals, ids, now)
    }

    #[test]
    fn cancel_by_identifier_and_time_follows_rcl() {
        let (goals, [ended, second, third], _) = goals();
        for (asked, code, cancelled) in [
            (info(GoalId::ZERO, 0), CancelGoalResponseEnum::None, vec![second, third]),
            (info(GoalId::ZERO, 2), CancelGoalResponseEnum::None, vec![second]),
            (info(GoalId::ZERO, 1), CancelGoalResponseEnum::None, vec![]),
            (info(third, 0), CancelGoalResponseEnum::None, vec![third]),
            (info(third, 2), CancelGoalResponseEnum::None, vec![second, third]),
            (info(ended, 0), CancelGoalResponseEnum::GoalTerminated, vec![]),
            (
                info(GoalId::new_random(), 0),
                CancelGoalResponseEnum::UnknownGoal,
                vec![],
            ),
        ] {
            let response = goals.cancel(&asked);
            let ids: Vec<_> = response.goals_canceling.iter().map(|info| info.goal_id).collect();
            assert_eq!((response.return_code, ids), (code, cancelled), "{asked:?}");
        }
    }

    #[test]
    fn result_is_returned_before_and_after_its_request() {
        let (mut goals, [_, id, _], now) = goals();
        assert!(goals.ask(id, 7).is_none());
        let (result, waiting) = goals.end(now, id, &End::Cancelled);
        assert_eq!((result.status, waiting), (GoalStatusEnum::Canceled, vec![7]));
        let (request, result) = goals.ask(id, 8).unwrap();
        assert_eq!((request, result.status), (8, GoalStatusEnum::Canceled));
    }

    #[test]
    fn result_of_an_unknown_goal_is_unknown() {
        let (mut goals, ids, now) = goals();
        assert_eq!(
            goals.ask(GoalId::new_random(), 1).unwrap().1.status,
            GoalStatusEnum::Unknown
        );
        assert!(!goals.forget(now + Duration::from_secs(9)));
        assert!(goals.forget(now + Duration::from_secs(10)));
        assert_eq!(goals.ask(ids[0], 1).unwrap().1.status, GoalStatusEnum::Unknown);
        assert!(!goals.is_known(ids[0]) && goals.is_known(ids[1]));
    }

    #[test]
    fn waiting_requests_of_a_goal_are_bounded() {
        let (mut goals, [_, id, _], _) = goals();
        let answered = (0..20)
            .filter_map(|request| goals.ask(id, request))
            .map(|(request, _)| request);
        assert_eq!(answered.collect::<Vec<_>>(), [16, 17, 18, 19]);
    }

    #[test]
    fn oldest_ended_goals_make_room() {
        let (mut goals, [_, active, _], now) = goals();
        for seconds in 4..200 {
            let id = GoalId::new_random();
            goals.accept(info(id, seconds));
            goals.end(now, id, &End::Replaced);
        }
        let kept = goals.statuses().status_list;
        assert_eq!(kept.len(), MAX_KNOWN);
        assert!(goals.is_known(active));
        assert_eq!(kept.last().unwrap().goal_info.stamp, Time::new(199, 0));
    }

    #[test]
    fn states_follow_the_goal() {
        let (mut goals, [_, second, _], _) = goals();
        goals.start(second);
        let status = |status: &GoalStatus| status.status;
        let statuses: Vec<_> = goals.statuses().status_list.iter().map(status).collect();
        assert_eq!(
            statuses,
            [
                GoalStatusEnum::Succeeded,
                GoalStatusEnum::Executing,
                GoalStatusEnum::Accepted
            ]
        );
    }

    #[test]
    fn result_has_the_code_of_its_end() {
        let tolerance = || ("a".to_owned(), 0.2, 0.1);
        let (joint, distance, allowed) = tolerance();
        let path = Abort::Path {
            joint,
            distance,
            allowed,
        };
        let (joint, distance, allowed) = tolerance();
        let goal = Abort::Goal {
            joint,
            distance,
            allowed,
        };
        for (end, status, code, text) in [
            (End::Finished, GoalStatusEnum::Succeeded, 0, ""),
            (End::Cancelled, GoalStatusEnum::Canceled, 0, "cancelled"),
            (End::Replaced, GoalStatusEnum::Aborted, -1, "another trajectory began"),
            (
                End::Aborted(Abort::Start(Refusal::NoPoint)),
                GoalStatusEnum::Aborted,
                -1,
                "at its start: the trajectory has no points",
            ),
            (
                End::Aborted(path),
                GoalStatusEnum::Aborted,
                -4,
                "\"a\" is 0.2000 from its setpoint, allowed 0.1000",
            ),
            (
                End::Aborted(goal),
                GoalStatusEnum::Aborted,
                -5,
                "\"a\" is 0.2000 from its goal after the goal time, allowed 0.1000",
            ),
        ] {
            let GetResultResponse { status: got, result } = result(&end);
            assert_eq!((got, result.error_code, &*result.error_string), (status, code, text));
        }
    }
}
