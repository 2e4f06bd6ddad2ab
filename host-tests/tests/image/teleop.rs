//! Teleoperation of a follower by a leader, each behind a firmware image of its own.

use std::env;
use std::f64::consts::TAU;
use std::time::Instant as RealTime;

use armwire::decoder::{Decoder, Kind};
use armwire::ling::stop::{Output as StopOutput, Stopped};
use armwire::ling::{JOINTS, JointState, Ling, MAX_FRAME, Position, Request, Response, Stop};
use armwire::messages::Messages;
use armwire::time::Instant;
use armwire_bridge::Duration;
use armwire_bridge::config::{Config as AdapterConfig, HostTimeout};
use armwire_bridge::control;
use armwire_host::follow::{Follow, Output, Pause, Progress, Start};
use armwire_host::{Limits, Rate};
use armwire_host_tests::image::requests::frame;
use armwire_host_tests::image::{Control, MEGABAUD, on_board, plug_in};
use armwire_sim::faults::{Line, Rates};
use armwire_sim::ling::{Config, LingArm, Plant};
use armwire_virtual_board::VirtualBoard;

const PERIOD: Duration = Duration::from_millis(10);
const STEP: Duration = Duration::from_millis(1);
/// Steps in the time that the follower may be behind: 50 ms.
const BEHIND: usize = 50;

/// Two of a hundred readings are lost, by missing, damaged and additional bytes.
const NOISY: Rates = Rates {
    drop: 200,
    corrupt: 200,
    noise: 400,
    ..Rates::NONE
};

/// An arm behind the image, and its host.
struct Side<'a> {
    board: &'a mut VirtualBoard<Line<LingArm>>,
    decoder: Decoder<Ling, MAX_FRAME>,
}

impl<'a> Side<'a> {
    fn new(board: &'a mut VirtualBoard<Line<LingArm>>) -> Self {
        plug_in(board, MEGABAUD);
        Self {
            board,
            decoder: Decoder::new(),
        }
    }

    fn send(&mut self, request: Request) {
        self.board.usb().write(&frame(request)).unwrap();
    }

    fn run(&mut self) {
        self.board.run_for(STEP).unwrap();
        // Ten minutes of a record would not fit into memory.
        self.board.uart().forget_bytes();
        self.board.usb().forget_packets();
    }

    /// The readings that have arrived.
    fn readings(&mut self) -> Vec<JointState> {
        let mut readings = Vec::new();
        for byte in self.board.usb().read() {
            assert!(self.decoder.push(&[byte]).is_empty());
            while let Some(item) = self.decoder.next(&Ling, ()) {
                if item.kind == Kind::Frame
                    && let Ok(Response::Joints(state)) = Ling.parse_response(item.bytes, ())
                {
                    readings.push(state);
                }
            }
        }
        readings
    }

    /// The arm now: without bytes on the line, nothing else advances it.
    fn arm<R>(&mut self, see: impl FnOnce(&mut LingArm) -> R) -> R {
        let now = self.board.now().instant();
        self.board.with_arm(|line| {
            line.device_mut().advance(now);
            see(line.device_mut())
        })
    }
}

/// The hand that moves the leader, by 40° to both sides at up to 75°/s.
#[derive(Default)]
struct Hand {
    /// The time of its motion, in steps.
    steps: u64,
    /// True while it rests 20° from its path.
    is_away: bool,
}

impl Hand {
    fn pose(&self) -> [f64; JOINTS] {
        let seconds = (self.steps * STEP.as_micros()) as f64 / 1e6;
        let away = if self.is_away { 228.0 } else { 0.0 };
        std::array::from_fn(|joint| {
            let hertz = 0.1 + 0.04 * joint as f64;
            2_048.0 + away + 455.0 * (TAU * hertz * seconds).sin()
        })
    }
}

/// A program that lets the follower follow the leader, and both arms.
struct Pair<'a> {
    leader: Side<'a>,
    follower: Side<'a>,
    follow: Follow,
    hand: Hand,
    now: Instant,
    is_plugged: bool,
    /// The goals of the last move, and their time.
    goal: Option<(Instant, [u16; JOINTS])>,
    /// The follower's joints after the last step.
    joints: [u16; JOINTS],
    pauses: Vec<Pause>,
}

/// Runs a test with two boards, whose lines have these faults.
fn on_pair<R>(rates: Rates, test: impl FnOnce(&mut Pair<'_>) -> R) -> R {
    // The lag of the images and of the lines is measured: the arms add none.
    let arm = |config, seed| {
        let plant = Plant::IDEAL;
        Line::new(LingArm::new(Config { plant, ..config }), rates, rates, seed)
    };
    on_board(arm(Config::leader(), 3), |leader| {
        on_board(arm(Config::follower(), 4), |follower| {
            let mut follower = Side::new(follower);
            let joints = follower.arm(|arm| arm.joints());
            test(&mut Pair {
                leader: Side::new(leader),
                follower,
                follow: Follow::new(Limits::FOLLOW, Start::Approach, Rate::MOVES).unwrap(),
                hand: Hand::default(),
                now: Instant::ZERO,
                is_plugged: true,
                goal: None,
                joints,
                pauses: Vec::new(),
            })
        })
    })
}

impl Pair<'_> {
    /// Runs the program and the arms for a step.
    fn step(&mut self) {
        let is_read = self.now.as_micros().is_multiple_of(PERIOD.as_micros());
        if is_read && self.is_plugged {
            self.leader.send(Request::ReadJoints);
        }
        for reading in self.leader.readings() {
            self.follow.on_leader(self.now, &reading);
        }
        for reading in self.follower.readings() {
            self.follow.on_follower(self.now, &reading);
        }
        match self.follow.poll(self.now).unwrap() {
            Output::Move(target) => {
                self.follower.send(Request::Move(target));
                let goal = target.joints.map(|(position, _)| position.ticks());
                self.check_goal(goal);
                self.goal = Some((self.now, goal));
            }
            Output::Stop(pause) => {
                self.pauses.push(pause);
                self.stop();
            }
            Output::Wait(_) => {}
        }
        if is_read {
            self.follower.send(Request::ReadJoints);
        }
        self.run();
    }

    /// Runs the arms for a step, without the program.
    fn run(&mut self) {
        let pose = self.hand.pose();
        self.leader.arm(|arm| {
            for (joint, ticks) in pose.into_iter().enumerate() {
                assert!(arm.push_joint(joint, Position::new(ticks.round() as u16).unwrap()));
            }
        });
        self.leader.run();
        self.follower.run();
        self.now += STEP;
        self.hand.steps += u64::from(!self.hand.is_away);
        let joints = self.follower.arm(|arm| arm.joints());
        // 90°/s are a tick in a step.
        let step = joints.iter().zip(self.joints).map(|(now, before)| now.abs_diff(before));
        assert!(
            step.max() <= Some(2),
            "{joints:?} after {:?} at {:?}",
            self.joints,
            self.now
        );
        self.joints = joints;
    }

    /// Checks that the goals are within 5° and 90°/s of the ones before.
    fn check_goal(&self, goal: [u16; JOINTS]) {
        let Some((at, before)) = self.goal else { return };
        let most = (1_024.0 * self.now.since(at).as_micros() as f64 / 1e6).min(56.0) + 1.0;
        for (goal, before) in goal.into_iter().zip(before) {
            assert!(f64::from(goal.abs_diff(before)) <= most, "{goal} after {before}");
        }
    }

    /// Stops the follower, as a host does.
    fn stop(&mut self) {
        let mut stop = Stop::new(None);
        loop {
            match stop.poll(self.now) {
                StopOutput::Request(request) => self.follower.send(request),
                StopOutput::Wait(_) => {}
                StopOutput::Done(stopped) => {
                    assert!(matches!(stopped, Ok(Stopped::AtRest { .. })), "{stopped:?}");
                    self.goal = None;
                    return;
                }
            }
            self.run();
            for reading in self.follower.readings() {
                stop.on_joints(self.now, &reading);
            }
        }
    }

    /// Plugs the leader in, or unplugs it.
    fn set_plugged(&mut self, is_plugged: bool) {
        if is_plugged && !self.is_plugged {
            plug_in(self.leader.board, MEGABAUD);
        } else if !is_plugged && self.is_plugged {
            self.leader.board.usb().detach();
        }
        self.is_plugged = is_plugged;
    }

    fn run_for(&mut self, millis: u64) {
        let end = self.now + Duration::from_millis(millis);
        while self.now < end {
            self.run();
        }
    }
}

/// Ten seconds of virtual time, or more by `ARMWIRE_SECONDS`. The leader is unplugged for a tenth of them.
#[test]
fn follower_behind_the_image_is_at_most_50_ms_behind() {
    /// The time until the hand is back after the leader, in milliseconds.
    const AWAY: u64 = 500;
    /// The time until the follower rests without a leader, in milliseconds.
    const STOPPED: u64 = 900;
    let seconds: u64 = env::var("ARMWIRE_SECONDS").map_or(10, |seconds| seconds.parse().expect("a number"));
    let began = RealTime::now();
    on_pair(NOISY, |pair| {
        let (unplugged, plugged) = (seconds * 300, seconds * 400);
        let mut path: Vec<[f64; JOINTS]> = Vec::new();
        let (mut judged, mut behind) = (0_u64, 0_u64);
        let mut followed_before = Instant::ZERO;
        while pair.now < Instant::from_millis(seconds * 1_000) {
            let millis = pair.now.as_micros() / 1_000;
            pair.set_plugged(!(unplugged..plugged).contains(&millis));
            pair.hand.is_away = (unplugged..plugged + AWAY).contains(&millis);
            path.push(pair.hand.pose());
            pair.step();
            if pair.hand.is_away && millis > unplugged + STOPPED {
                assert!(matches!(pair.follow.progress(), Progress::Waiting(..)), "{millis}");
            }
            if pair.hand.is_away || pair.follow.progress() != Progress::Following {
                followed_before = pair.now + Duration::from_millis(500);
                // There is nothing to follow, and a stop takes time in which the path is not recorded.
                path.clear();
            } else if followed_before < pair.now {
                judged += 1;
                let last = &path[path.len() - BEHIND..];
                let is_behind = (0..JOINTS).any(|joint| {
                    let ticks = f64::from(pair.joints[joint]);
                    !last.iter().any(|pose| pose[joint] <= ticks + 1.0)
                        || !last.iter().any(|pose| pose[joint] >= ticks - 1.0)
                });
                behind += u64::from(is_behind);
            }
        }
        println!(
            "behind in {behind} of {judged} ms; {seconds} s of virtual time, {:.0} s of real time",
            began.elapsed().as_secs_f64()
        );
        assert!(judged > seconds * 700, "{judged}");
        assert!(behind * 100 <= judged, "{behind} of {judged}");
        assert!(matches!(pair.pauses[..], [Pause::LeaderLate(_)]), "{:?}", pair.pauses);
        pair.stop();
        let joints = pair.joints;
        pair.run_for(1_000);
        assert_eq!((pair.joints, pair.follower.arm(|arm| arm.is_holding())), (joints, true));
    });
}

#[test]
fn killed_teleoperation_rests_or_loses_torque_as_configured() {
    // The program is killed after so many milliseconds, perhaps within a move.
    for (millis, of_next_move, torque_off) in [
        (1_203, 0, false),
        (1_203, 0, true),
        (2_000, 20, false),
        (2_000, 20, true),
    ] {
        on_pair(Rates::NONE, |pair| {
            let mut control = Control::open(pair.follower.board);
            let config = AdapterConfig {
                host_timeout: HostTimeout {
                    after_ms: 300,
                    torque_off,
                },
                ..AdapterConfig::default()
            };
            control.order(pair.follower.board, control::Request::SetConfig(config));
            while pair.now < Instant::from_millis(millis) {
                pair.step();
            }
            let (_, goal) = pair.goal.unwrap();
            if let Some(Output::Move(target)) = (of_next_move > 0).then(|| pair.follow.poll(pair.now).unwrap()) {
                let next = frame(Request::Move(target));
                pair.follower.board.usb().write(&next[..of_next_move]).unwrap();
            }
            pair.run_for(250);
            assert!(pair.follower.arm(|arm| arm.is_holding() && !arm.is_moving()));
            assert_eq!(pair.joints, goal, "after {millis} ms");
            pair.run_for(1_000);
            assert_eq!(
                (pair.joints, pair.follower.arm(|arm| arm.is_holding())),
                (goal, !torque_off)
            );
        });
    }
}
