//! Teleoperation of a follower behind the firmware image.

use std::collections::VecDeque;
use std::f64::consts::TAU;

use armwire::decoder::{Decoder, Kind};
use armwire::ling::{JOINTS, JointState, Ling, MAX_FRAME, MotionStatus, Request, Response};
use armwire::messages::Messages;
use armwire::time::Instant;
use armwire_bridge::Duration;
use armwire_bridge::config::{Config as AdapterConfig, HostTimeout};
use armwire_bridge::control;
use armwire_host::Limits;
use armwire_host::follow::{Follow, Output, Progress, Start};
use armwire_host_tests::image::requests::frame;
use armwire_host_tests::image::{Control, MEGABAUD, on_board, plug_in};
use armwire_sim::ling::{Config, LingArm};
use armwire_virtual_board::VirtualBoard;

const PERIOD: Duration = Duration::from_millis(10);
/// The periods in the time that the follower may be behind: 50 ms.
const BEHIND: usize = 5;

/// The leader's joints in ticks, moved by 40° to both sides at up to 75°/s.
fn leader_at(millis: u64) -> [u16; JOINTS] {
    std::array::from_fn(|joint| {
        let hertz = 0.1 + 0.04 * joint as f64;
        (2_048.0 + 455.0 * (TAU * hertz * millis as f64 / 1e3).sin()).round() as u16
    })
}

/// A program that lets the follower on the board follow.
struct Program {
    follow: Follow,
    decoder: Decoder<Ling, MAX_FRAME>,
    millis: u64,
    /// The joints of the last move.
    goal: Option<[u16; JOINTS]>,
}

impl Program {
    fn new() -> Self {
        Self {
            follow: Follow::new(Limits::FOLLOW, Start::Approach, PERIOD),
            decoder: Decoder::new(),
            millis: 0,
            goal: None,
        }
    }

    /// Runs for a period.
    fn run(&mut self, board: &mut VirtualBoard<LingArm>) {
        let now = Instant::from_millis(self.millis);
        let leader = JointState {
            joints: leader_at(self.millis),
            gripper: 0,
            status: MotionStatus::Idle,
        };
        self.follow.on_leader(now, &leader);
        match self.follow.poll(now).unwrap() {
            Output::Move(target) => {
                board.usb().write(&frame(Request::Move(target))).unwrap();
                self.goal = Some(target.joints.map(|(position, _)| position.ticks()));
            }
            Output::Wait(_) => assert_eq!(self.goal, None),
            Output::Stop(pause) => panic!("{pause}"),
        }
        board.usb().write(&frame(Request::ReadJoints)).unwrap();
        board.run_for(PERIOD).unwrap();
        self.millis += PERIOD.as_micros() / 1_000;
        for byte in board.usb().read() {
            assert!(self.decoder.push(&[byte]).is_empty());
            while let Some(item) = self.decoder.next(&Ling, ()) {
                assert_eq!(item.kind, Kind::Frame);
                if let Ok(Response::Joints(state)) = Ling.parse_response(item.bytes, ()) {
                    self.follow.on_follower(Instant::from_millis(self.millis), &state);
                }
            }
        }
    }
}

/// The arm now: without bytes on the line, nothing else advances it.
fn arm_now<R>(board: &mut VirtualBoard<LingArm>, see: impl FnOnce(&LingArm) -> R) -> R {
    let now = board.now().instant();
    board.with_arm(|arm| {
        arm.advance(now);
        see(arm)
    })
}

#[test]
fn follower_behind_the_image_is_at_most_50_ms_behind() {
    on_board(LingArm::new(Config::follower()), |board| {
        plug_in(board, MEGABAUD);
        let mut program = Program::new();
        let mut last: VecDeque<_> = VecDeque::new();
        for period in 0..1_000 {
            program.run(board);
            last.push_back(leader_at(program.millis));
            if last.len() > BEHIND + 1 {
                last.pop_front();
            }
            let joints = board.with_arm(|arm| arm.joints());
            if period < 50 {
                continue;
            }
            assert_eq!(program.follow.progress(), Progress::Following);
            for joint in 0..JOINTS {
                let passed = last.iter().map(|pose| pose[joint]);
                let (least, most) = (passed.clone().min().unwrap() - 1, passed.max().unwrap() + 1);
                assert!(
                    (least..=most).contains(&joints[joint]),
                    "joint {joint} in period {period}"
                );
            }
        }
    });
}

#[test]
fn killed_teleoperation_rests_or_loses_torque_as_configured() {
    for torque_off in [false, true] {
        on_board(LingArm::new(Config::follower()), |board| {
            plug_in(board, MEGABAUD);
            let mut control = Control::open(board);
            let config = AdapterConfig {
                host_timeout: HostTimeout {
                    after_ms: 300,
                    torque_off,
                },
                ..AdapterConfig::default()
            };
            control.order(board, control::Request::SetConfig(config));
            let mut program = Program::new();
            (0..200).for_each(|_| program.run(board));
            board.run_for(Duration::from_millis(250)).unwrap();
            assert!(arm_now(board, |arm| arm.is_holding() && !arm.is_moving()));
            assert_eq!(Some(arm_now(board, |arm| arm.joints())), program.goal);
            board.run_for(Duration::from_millis(2_000)).unwrap();
            assert_eq!(arm_now(board, |arm| arm.is_holding()), !torque_off);
            assert_eq!(Some(arm_now(board, |arm| arm.joints())), program.goal);
        });
    }
}
