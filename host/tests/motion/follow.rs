//! A follower that follows a leader.

use armwire::ling::{JOINTS, JointState, MotionStatus, Opening, Request, Speed, Torque};
use armwire::time::{Duration, Instant};
use armwire_host::follow::{End, Follow, Output, Pause, Progress, Start};
use armwire_host::{Limits, Rate};
use armwire_sim::faults::Rates;
use armwire_sim::ling::{Config, Plant};

use crate::world::{Arm, NOISY, STEP, Stalls, by_hand, push};

const PERIOD: Duration = Duration::from_millis(10);
/// Steps of the world in the time that the follower may be behind.
const BEHIND: usize = 50;

/// A leader and its follower.
struct Pair {
    leader: Arm,
    follower: Arm,
    follow: Follow,
    now: Instant,
    is_plugged: bool,
    /// The stalls of both lines. `None` without any.
    stalls: Option<[Stalls; 2]>,
    /// The goals of the last move, and their time.
    goal: Option<(Instant, [u16; JOINTS])>,
    pauses: Vec<Pause>,
}

impl Pair {
    fn new(start: Start, rates: Rates) -> Self {
        Self::with_plant(start, rates, Plant::IDEAL)
    }

    /// A pair whose follower has this plant.
    fn with_plant(start: Start, rates: Rates, plant: Plant) -> Self {
        let follower = Config {
            plant,
            ..Config::follower()
        };
        // The hand is exact.
        let leader = Config {
            plant: Plant::IDEAL,
            ..Config::leader()
        };
        Self {
            leader: Arm::new(leader, rates, 3),
            follower: Arm::new(follower, rates, 4),
            follow: Follow::new(Limits::FOLLOW, start, Rate::MOVES).unwrap(),
            now: Instant::ZERO,
            is_plugged: true,
            stalls: None,
            goal: None,
            pauses: Vec::new(),
        }
    }

    /// Runs for one step.
    fn step(&mut self) -> Result<(), End> {
        let is_read = self.now.as_micros().is_multiple_of(PERIOD.as_micros());
        if is_read && self.is_plugged {
            self.leader.send(self.now, &Request::ReadJoints);
        }
        let (leader, follower) = (self.leader.readings(self.now), self.follower.readings(self.now));
        let dated = |readings: Vec<JointState>| readings.into_iter().map(|reading| (self.now, reading)).collect();
        let (leader, follower) = match &mut self.stalls {
            Some([of_leader, of_follower]) => (of_leader.pass(self.now, leader), of_follower.pass(self.now, follower)),
            None => (dated(leader), dated(follower)),
        };
        for (at, reading) in leader {
            self.follow.on_leader(at, &reading);
        }
        for (at, reading) in follower {
            self.follow.on_follower(at, &reading);
        }
        match self.follow.poll(self.now)? {
            Output::Move(target) => {
                self.follower.send(self.now, &Request::Move(target));
                let goal = target.joints.map(|(position, _)| position.ticks());
                self.check_step(goal);
                self.goal = Some((self.now, goal));
            }
            Output::Stop(pause) => {
                self.pauses.push(pause);
                self.now = self.follower.stop(self.now);
                self.goal = None;
            }
            Output::Wait(_) => {}
        }
        if is_read {
            self.follower.send(self.now, &Request::ReadJoints);
        }
        self.now += STEP;
        Ok(())
    }

    /// Runs for one step, in which no joint of the follower exceeds 90°/s. Returns its joints.
    fn step_without_jump(&mut self) -> [u16; JOINTS] {
        let (begin, before) = (self.now, self.follower());
        self.step().unwrap();
        let joints = self.follower();
        // 90°/s are a tick in a step.
        let steps = self.now.since(begin).as_micros() as f64 / STEP.as_micros() as f64;
        for (joint, before) in joints.into_iter().zip(before) {
            assert!(
                f64::from(joint.abs_diff(before)) <= steps * 1.024 + 1.0,
                "a jump at {begin:?}"
            );
        }
        joints
    }

    /// Checks that the goals are within 5° and 90°/s of the ones before.
    fn check_step(&self, goal: [u16; JOINTS]) {
        let Some((at, before)) = self.goal else { return };
        let most = (1_024.0 * self.now.since(at).as_micros() as f64 / 1e6).min(56.0) + 1.0;
        for (goal, before) in goal.into_iter().zip(before) {
            assert!(f64::from(goal.abs_diff(before)) <= most, "{goal} after {before}");
        }
    }

    fn run_until(&mut self, millis: u64) -> Result<(), End> {
        while self.now < Instant::from_millis(millis) {
            self.step()?;
        }
        Ok(())
    }

    /// Moves the leader's joints to so many ticks.
    fn push(&mut self, ticks: f64) {
        let now = self.now;
        push(self.leader.at(now), [ticks; JOINTS]);
    }

    fn follower(&mut self) -> [u16; JOINTS] {
        let now = self.now;
        self.follower.at(now).joints()
    }

    fn assert_rests(&mut self) {
        let joints = self.follower();
        self.now += Duration::from_millis(10_000);
        assert_eq!(self.follower(), joints);
        assert!(self.follower.body().is_holding() && !self.follower.body().is_moving());
    }
}

#[test]
fn follower_is_at_most_50_ms_behind() {
    let mut pair = Pair::new(Start::Approach, NOISY);
    let mut path: Vec<[f64; JOINTS]> = Vec::new();
    let (mut judged, mut behind, mut shown_behind) = (0_u64, 0_u64, 0_u64);
    let mut followed_before = Instant::ZERO;
    // Ten minutes. The leader is unplugged from the fourth to the fifth.
    while pair.now < Instant::from_millis(600_000) {
        let now = pair.now;
        pair.is_plugged = !(180_000..240_000).contains(&(now.as_micros() / 1_000));
        let pose = by_hand(now.since(Instant::ZERO));
        push(pair.leader.at(now), pose);
        path.push(pose);
        let joints = pair.step_without_jump();
        if pair.follow.progress() != Progress::Following {
            followed_before = pair.now + Duration::from_millis(1_000);
            // A stop takes time in which the hand is not recorded.
            path.clear();
        } else if followed_before < pair.now {
            judged += 1;
            let last = &path[path.len() - BEHIND..];
            let is_behind = (0..JOINTS).any(|joint| {
                let ticks = f64::from(joints[joint]);
                !last.iter().any(|pose| pose[joint] <= ticks + 1.0)
                    || !last.iter().any(|pose| pose[joint] >= ticks - 1.0)
            });
            behind += u64::from(is_behind);
            shown_behind += u64::from(pair.follow.lag() > Some(Duration::from_millis(50)));
        }
    }
    assert!(judged > 450_000, "{judged}");
    assert!(behind * 100 <= judged, "{behind} of {judged}");
    assert!(shown_behind * 100 <= judged, "{shown_behind} of {judged}");
    assert!(matches!(pair.pauses[..], [Pause::LeaderLate(_)]), "{:?}", pair.pauses);
    pair.now = pair.follower.stop(pair.now);
    pair.assert_rests();
}

#[test]
fn stalled_lines_cause_no_jump() {
    let mut pair = Pair::new(Start::Approach, NOISY);
    pair.stalls = Some([Stalls::from(0), Stalls::from(3)]);
    let mut followed = 0;
    // Some 200 stalls. Each move is within the limits of the one before, or comes after a stop.
    while pair.now < Instant::from_millis(300_000) {
        let now = pair.now;
        push(pair.leader.at(now), by_hand(now.since(Instant::ZERO)));
        pair.step_without_jump();
        followed += usize::from(pair.follow.progress() == Progress::Following);
    }
    assert!(
        pair.pauses.len() >= 5 && followed > 5_000,
        "{}, {followed}",
        pair.pauses.len()
    );
    pair.now = pair.follower.stop(pair.now);
    pair.assert_rests();
}

#[test]
fn distant_follower_approaches_slowly() {
    let mut pair = Pair::new(Start::Approach, Rates::NONE);
    pair.push(3_048.0);
    let mut before = pair.follower();
    pair.run_until(100).unwrap();
    while pair.follow.progress() != Progress::Following {
        pair.step().unwrap();
        let joints = pair.follower();
        let steps = joints.iter().zip(before).map(|(now, before)| now.abs_diff(before));
        assert!(steps.max() <= Some(25));
        before = joints;
    }
    // 88° less 5° at 20°/s.
    assert!(
        (3_900..5_000).contains(&(pair.now.as_micros() / 1_000)),
        "{:?}",
        pair.now
    );
}

#[test]
fn limits_without_a_motion_are_refused() {
    let limits = Limits {
        speeds: [Speed::new(49).unwrap(); JOINTS],
        ..Limits::FOLLOW
    };
    let refused = Follow::new(limits, Start::Approach, Rate::MOVES).unwrap_err();
    let text = "joint speed (an arm may take less than 50 ticks/s for 0) is 49 ticks/s, must be 50..=5000";
    assert_eq!(refused.to_string(), text);
}

#[test]
fn steps_slower_than_the_speed_are_refused_with_the_rate_that_does() {
    let follow = |hertz| Follow::new(Limits::FOLLOW, Start::Approach, Rate::new(hertz).unwrap());
    let text = "steps of 4.9° at 10 Hz are 49°/s, slower than the limit of 90°/s: 19 Hz would do";
    assert_eq!(follow(10).unwrap_err().to_string(), text);
    assert!(follow(18).is_err() && follow(19).is_ok());
}

#[test]
fn distant_follower_is_refused_if_so_asked() {
    let mut pair = Pair::new(Start::Refuse, Rates::NONE);
    pair.push(2_148.0);
    let end = pair.run_until(1_000).unwrap_err();
    assert!(
        matches!(end, End::Far(1, degrees) if (8.0..9.0).contains(&degrees)),
        "{end:?}"
    );
    assert_eq!((pair.goal, pair.follower()), (None, [2_048; JOINTS]));
}

#[test]
fn returning_leader_is_followed_once_it_is_near() {
    let mut pair = Pair::new(Start::Approach, Rates::NONE);
    pair.run_until(1_000).unwrap();
    pair.is_plugged = false;
    pair.run_until(3_000).unwrap();
    assert!(matches!(pair.pauses[..], [Pause::LeaderLate(_)]), "{:?}", pair.pauses);
    pair.push(2_348.0);
    pair.is_plugged = true;
    pair.run_until(10_000).unwrap();
    assert!(matches!(
        pair.follow.progress(),
        Progress::Waiting(Pause::LeaderLate(_), _)
    ));
    assert_eq!(pair.follower(), [2_048; JOINTS]);
    pair.push(2_100.0);
    pair.run_until(11_000).unwrap();
    assert_eq!(pair.follow.progress(), Progress::Following);
    assert_eq!(pair.follower(), [2_100; JOINTS]);
}

#[test]
fn hiccup_of_the_computer_does_not_end_it() {
    let mut pair = Pair::new(Start::Approach, Rates::NONE);
    pair.run_until(1_000).unwrap();
    for (pose, millis) in [(2_060, 50), (2_080, 160), (2_060, 400), (2_080, 800)] {
        // The hand goes on while the program is stopped.
        pair.push(pose.into());
        pair.now += Duration::from_millis(millis);
        let until = pair.now.as_micros() / 1_000 + 1_000;
        pair.run_until(until).unwrap();
        assert_eq!(pair.follow.progress(), Progress::Following);
        assert_eq!(pair.follower(), [pose; JOINTS]);
    }
    assert_eq!(pair.pauses.len(), 3, "{:?}", pair.pauses);
}

#[test]
fn follower_without_torque_ends_it() {
    let mut pair = Pair::new(Start::Approach, Rates::NONE);
    pair.run_until(1_000).unwrap();
    let now = pair.now;
    pair.follower.send(now, &Request::SetTorque(Torque::Off));
    let end = pair.run_until(2_000).unwrap_err();
    assert!(matches!(end, End::Immovable(_)), "{end:?}");
    let now = pair.now;
    pair.follower.send(now, &Request::SetTorque(Torque::On));
    assert_eq!(pair.run_until(3_000), Err(end));
}

#[test]
fn leader_that_turns_past_its_end_is_not_followed() {
    let mut pair = Pair::new(Start::Approach, Rates::NONE);
    pair.push(4_090.0);
    pair.run_until(20_000).unwrap();
    pair.push(5.0);
    pair.run_until(22_000).unwrap();
    assert!(
        matches!(pair.pauses[..], [Pause::LeaderAhead(1, _)]),
        "{:?}",
        pair.pauses
    );
    assert_eq!(pair.follower(), [4_090; JOINTS]);
}

#[test]
fn silent_follower_is_not_moved() {
    let mut pair = Pair::new(Start::Approach, Rates::NONE);
    pair.run_until(1_000).unwrap();
    let leader = JointState {
        joints: [2_048; JOINTS],
        gripper: 0,
        status: MotionStatus::Idle,
    };
    let output = loop {
        pair.now += PERIOD;
        pair.follow.on_leader(pair.now, &leader);
        match pair.follow.poll(pair.now).unwrap() {
            Output::Stop(pause) => break pause,
            _ => assert!(pair.now < Instant::from_millis(1_200)),
        }
    };
    assert!(matches!(output, Pause::FollowerLate(_)), "{output:?}");
}

#[test]
fn returning_follower_follows_from_where_it_is() {
    // Joints 1, 4 and 6 carry no weight: a stop leaves them where they are.
    let mut pair = Pair::with_plant(Start::Approach, Rates::NONE, Plant::TYPICAL);
    pair.run_until(1_000).unwrap();
    pair.push(2_300.0);
    pair.run_until(1_100).unwrap();
    // It is silent for 3 s, in which the hand goes on by 5°.
    let silent_until = pair.now + Duration::from_millis(3_000);
    let mut pauses = 0;
    while pair.now < silent_until {
        let leader = JointState {
            joints: [2_356; JOINTS],
            gripper: 0,
            status: MotionStatus::Idle,
        };
        pair.follow.on_leader(pair.now, &leader);
        match pair.follow.poll(pair.now).unwrap() {
            Output::Move(target) => pair.follower.send(pair.now, &Request::Move(target)),
            Output::Stop(pause) => {
                assert!(matches!(pause, Pause::FollowerLate(_)), "{pause:?}");
                pauses += 1;
            }
            Output::Wait(_) => {}
        }
        pair.now += STEP;
    }
    assert_eq!(pauses, 1);
    pair.follower.readings(pair.now);
    let before = pair.follower();
    let [first, ..] = before;
    assert!((2_050..2_300).contains(&first), "{before:?}");
    // It does not follow a leader that is far away.
    pair.goal = None;
    pair.push(2_356.0);
    pair.run_until(6_000).unwrap();
    assert_eq!(pair.follower(), before);
    pair.push(f64::from(first) + 20.0);
    pair.run_until(8_000).unwrap();
    assert_eq!(pair.follow.progress(), Progress::Following);
    let joints = pair.follower();
    for joint in [0, 3, 5] {
        assert!(joints[joint].abs_diff(first + 20) <= 3, "{joints:?}");
    }
}

#[test]
fn gripper_gets_the_leaders_opening() {
    let mut pair = Pair::new(Start::Approach, Rates::NONE);
    assert!(pair.leader.body().push_gripper(Opening::new(400).unwrap()));
    pair.run_until(1_000).unwrap();
    assert_eq!(pair.follower.body().gripper(), 400);
}

#[test]
fn killed_teleoperation_leaves_the_follower_at_its_last_goal() {
    for millis in (300..9_000).step_by(611) {
        let mut pair = Pair::new(Start::Approach, Rates::NONE);
        while pair.now < Instant::from_millis(millis) {
            let now = pair.now;
            push(pair.leader.at(now), by_hand(now.since(Instant::ZERO)));
            pair.step().unwrap();
        }
        pair.now += Duration::from_millis(10_000);
        let (_, goal) = pair.goal.unwrap();
        assert_eq!(
            (pair.follower(), pair.follower.body().is_holding()),
            (goal, true),
            "{millis}"
        );
    }
}

#[test]
fn unanswered_start_sends_nothing() {
    let mut pair = Pair::new(Start::Approach, Rates::NONE);
    pair.is_plugged = false;
    assert_eq!(pair.run_until(5_000), Err(End::Unread));
    assert_eq!(pair.goal, None);
}

#[test]
fn pose_out_of_range_counts_as_missing() {
    for is_leader in [true, false] {
        let mut follow = Follow::new(Limits::FOLLOW, Start::Approach, Rate::MOVES).unwrap();
        let good = JointState {
            joints: [2_048; JOINTS],
            gripper: 0,
            status: MotionStatus::Locked,
        };
        let bad = JointState {
            joints: [4_096; JOINTS],
            ..good
        };
        let [leader, follower] = if is_leader { [bad, good] } else { [good, bad] };
        let mut now = Instant::ZERO;
        let end = loop {
            follow.on_leader(now, &leader);
            follow.on_follower(now, &follower);
            match follow.poll(now) {
                Ok(Output::Wait(until)) => now = until,
                Ok(output) => panic!("{output:?}"),
                Err(end) => break end,
            }
        };
        assert_eq!(end, End::Unread);
    }
}
