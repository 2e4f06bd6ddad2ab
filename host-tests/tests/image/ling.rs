//! A program that controls a Ling arm through the firmware image.

use armwire::ling::*;
use armwire_bridge::Duration;
use armwire_host_tests::image::{MEGABAUD, Program, on_board, plug_in};
use armwire_sim::ling::{Config, LingArm, Plant};
use armwire_virtual_board::VirtualBoard;

/// A program at the open port of an adapter, with `config`'s arm. Its readings are exact.
fn session(config: Config, test: impl FnOnce(&mut VirtualBoard<LingArm>, &mut Program)) {
    let plant = Plant::IDEAL;
    on_board(LingArm::new(Config { plant, ..config }), |board| {
        plug_in(board, MEGABAUD);
        test(board, &mut Program::default());
    });
}

#[test]
fn info_is_read() {
    for config in [Config::follower(), Config::leader()] {
        session(config.clone(), |board, program| {
            let info = Info {
                serial: config.serial,
                hardware: config.hardware,
                firmware: config.firmware,
            };
            assert_eq!(program.call(board, Request::ReadInfo), Some(Response::Info(info)));
        });
    }
}

#[test]
fn gripper_type_is_read_back() {
    session(Config::follower(), |board, program| {
        for stroke in [Stroke::Mm100, Stroke::Mm75, Stroke::Mm50] {
            assert_eq!(program.call(board, Request::SetStroke(stroke)), None);
            assert_eq!(board.with_arm(|arm| arm.stroke()), stroke);
            assert_eq!(program.call(board, Request::ReadStroke), Some(Response::Stroke(stroke)));
        }
    });
}

#[test]
fn joints_moved_by_hand_are_read() {
    session(Config::leader(), |board, program| {
        let pose = [100, 1_000, 2_048, 3_000, 4_000, 4_095];
        board.with_arm(|arm| {
            for (joint, ticks) in pose.into_iter().enumerate() {
                assert!(arm.push_joint(joint, Position::new(ticks).unwrap()));
            }
            assert!(arm.push_gripper(Opening::new(321).unwrap()));
        });
        let status = board.with_arm(|arm| arm.status());
        let state = JointState {
            joints: pose,
            gripper: 321,
            status,
        };
        assert_eq!(program.call(board, Request::ReadJoints), Some(Response::Joints(state)));
    });
}

#[test]
fn move_reaches_target_while_being_read() {
    session(Config::follower(), |board, program| {
        let target = Move {
            joints: [1_800, 1_900, 2_000, 2_100, 2_200, 2_300]
                .map(|ticks| (Position::new(ticks).unwrap(), Speed::new(1_000).unwrap())),
            gripper: (Opening::OPEN, GripperSpeed(5_500)),
        };
        assert_eq!(program.call(board, Request::SetTorque(Torque::On)), None);
        assert_eq!(program.call(board, Request::Move(target)), None);
        assert!(board.with_arm(|arm| arm.is_moving()));

        let mut fastest = 0;
        for _ in 0..200 {
            let Some(Response::Velocities(velocities)) = program.call(board, Request::ReadVelocities) else {
                panic!("no velocities");
            };
            fastest = fastest.max(velocities.as_slice().iter().copied().max().unwrap());
            let Some(Response::Joints(state)) = program.call(board, Request::ReadJoints) else {
                panic!("no joints");
            };
            if !board.with_arm(|arm| arm.is_moving()) {
                break;
            }
            assert_ne!(state.joints, [2_048; JOINTS], "the joints follow");
            board.run_for(Duration::from_millis(20)).unwrap();
        }
        assert!(fastest > 500, "{fastest} ticks per second");

        let state = JointState {
            joints: target.joints.map(|(position, _)| position.ticks()),
            gripper: target.gripper.0.per_mille(),
            status: board.with_arm(|arm| arm.status()),
        };
        assert_eq!(program.call(board, Request::ReadJoints), Some(Response::Joints(state)));
    });
}

#[test]
fn torque_is_switched() {
    session(Config::follower(), |board, program| {
        for (torque, holds) in [(Torque::Off, false), (Torque::On, true), (Torque::Off, false)] {
            assert_eq!(program.call(board, Request::SetTorque(torque)), None);
            assert_eq!(board.with_arm(|arm| arm.is_holding()), holds, "{torque:?}");
        }
    });
}

#[test]
fn zero_position_is_set_at_current_pose() {
    session(Config::follower(), |board, program| {
        assert_eq!(program.call(board, Request::SetTorque(Torque::Off)), None);
        assert!(board.with_arm(|arm| arm.push_joint(2, Position::new(2_500).unwrap())));
        assert_eq!(program.call(board, Request::SetZero), None);
        let Some(Response::Joints(state)) = program.call(board, Request::ReadJoints) else {
            panic!("no joints");
        };
        assert_eq!(state.joints, [Position::CENTRE.ticks(); JOINTS]);
    });
}

#[test]
fn temperatures_are_read_and_their_limit_applies() {
    session(
        Config {
            ambient: 45,
            ..Config::follower()
        },
        |board, program| {
            let temperatures = board.with_arm(|arm| arm.temperatures());
            assert_eq!(temperatures.kind(), Kind::Follower);
            let answer = program.call(board, Request::ReadTemperatures);
            assert_eq!(answer, Some(Response::Temperatures(temperatures)));

            let limit = TemperatureLimit::new(40).unwrap();
            assert_eq!(program.call(board, Request::SetTemperatureLimit(limit)), None);
            let Some(Response::Joints(state)) = program.call(board, Request::ReadJoints) else {
                panic!("no joints");
            };
            let hot = [MotionStatus::Overheating, MotionStatus::OverheatProtection];
            assert!(hot.contains(&state.status), "{}", state.status);
        },
    );
}

#[test]
fn self_check_finds_faulty_servo_of_both_arms() {
    for (config, servo) in [(Config::follower(), 10), (Config::leader(), 6)] {
        session(config.clone(), |board, program| {
            let Some(Response::SelfCheck(check)) = program.call(board, Request::SelfCheck) else {
                panic!("no self-check");
            };
            assert!(check.all_normal(config.kind));
            board.with_arm(|arm| arm.set_faulty(servo, true));
            let Some(Response::SelfCheck(check)) = program.call(board, Request::SelfCheck) else {
                panic!("no self-check");
            };
            assert!(check.faulty(config.kind).eq([servo]));
        });
    }
}

#[test]
fn arm_with_line_echo_is_readable() {
    session(
        Config {
            echo: true,
            ..Config::follower()
        },
        |board, program| {
            let joints = board.with_arm(|arm| arm.joints());
            program.is_line_noisy = true;
            let answer = program.call(board, Request::ReadJoints);
            let Some(Response::Joints(state)) = answer else {
                panic!("{answer:?}");
            };
            assert_eq!(state.joints, joints);
        },
    );
}
