//! The firmware image and a stop of the arm by the control port.

use armwire::ling::{
    GripperSpeed, JOINTS, JointState, Ling, MotionStatus, Move, Opening, Position, READ_JOINTS, Request, Response,
    SELF_CHECK, Speed,
};
use armwire::messages::Messages;
use armwire_bridge::can::{Frame, Function, Node};
use armwire_bridge::control::{self, Event, Refusal, STOP_MS};
use armwire_host_tests::image::requests::{encoded, frame, motion};
use armwire_host_tests::image::{
    BIT_RATE, CanProgram, Control, MEGABAUD, RawArm, chip, counters, facts, on_board, plug_in,
};
use armwire_sim::ling::{Config, LingArm};
use armwire_virtual_board::line::{Arm, Direction};
use armwire_virtual_board::{Nanos, VirtualBoard};

/// The postcard message of a stop, with the sequence number 7, and of the reply to it.
const STOP: [u8; 2] = [7, 15];
const DONE: [u8; 3] = [0, 7, 0];

/// The distance by which a joint sinks to its rest, in ticks.
const SAG: u16 = 12;

const fn millis(millis: u64) -> Nanos {
    Nanos::from_millis(millis)
}

/// Lets the host on CAN send this PDU to the arm.
fn send_on_can<A: Arm>(board: &mut VirtualBoard<A>, program: &mut CanProgram, pdu: &[u8]) {
    program.send(pdu);
    for _ in 0..20 {
        assert_eq!(program.poll(board), None);
        board.run_for(Nanos(100_000)).unwrap();
    }
}

/// Sends a stop on the control connection of CAN.
fn stop_on_can<A: Arm>(board: &mut VirtualBoard<A>) {
    let single = [&[STOP.len() as u8], &STOP[..]].concat();
    let single = Frame::new(Function::ControlRequest.id(Node::default()), &single).unwrap();
    board.can().send(&single).unwrap();
}

/// A move of all joints by 10 s at their speed. The gripper arrives within them.
fn far() -> Vec<u8> {
    frame(Request::Move(Move {
        joints: [(Position::new(3_048).unwrap(), Speed::new(100).unwrap()); JOINTS],
        gripper: (Opening::new(300).unwrap(), GripperSpeed(1_000)),
    }))
}

#[test]
fn stop_ends_all_motion_for_two_seconds() {
    let has_can = facts(chip()).can;
    for on_can in [false, true].into_iter().filter(|&on_can| has_can || !on_can) {
        on_board(LingArm::new(Config::follower()), |board| {
            plug_in(board, MEGABAUD);
            board.can().attach(BIT_RATE);
            let mut control = Control::open(board);
            control.subscribe(board);
            let mut program = CanProgram::default();
            let stream = |board: &mut VirtualBoard<LingArm>, program: &mut CanProgram| {
                board.usb().write(&far()).unwrap();
                if has_can {
                    send_on_can(board, program, &far());
                }
                board.run_for(millis(18)).unwrap();
            };
            (0..20).for_each(|_| stream(board, &mut program));
            assert!(board.with_arm(|arm| arm.is_moving()));

            let stopped = board.now();
            if on_can {
                stop_on_can(board);
                board.run_for(millis(5)).unwrap();
                let replies = board.can().read();
                let reply = [&[DONE.len() as u8], &DONE[..]].concat();
                let id = Function::ControlAnswer.id(Node::default());
                assert!(
                    replies
                        .iter()
                        .any(|frame| frame.id() == id && frame.data().starts_with(&reply))
                );
            } else {
                control.order(board, control::Request::Stop);
            }
            assert!(board.now().since(stopped) < millis(10));
            // A move in the transmitter may still go out before the reading.
            stream(board, &mut program);
            let pose = board.with_arm(|arm| arm.joints());
            while board.now() + millis(40) < stopped + millis(STOP_MS.into()) {
                stream(board, &mut program);
                let joints = board.with_arm(|arm| arm.joints());
                assert!(
                    joints.iter().zip(pose).all(|(at, pose)| at.abs_diff(pose) <= SAG),
                    "{joints:?}"
                );
            }
            // The gripper has its last goal.
            assert_eq!(board.with_arm(|arm| (arm.gripper(), arm.is_holding())), (300, true));
            let refused: Vec<_> = control
                .take_events(board)
                .into_iter()
                .filter_map(|(_, event)| match event {
                    Event::Refused { initiator, reason } => Some((initiator, reason)),
                    _ => None,
                })
                .collect();
            assert!(refused.iter().all(|(_, reason)| *reason == Refusal::Stopped));
            assert!(refused.len() > if has_can { 90 } else { 0 }, "{refused:?}");
            assert!(counters(board).refused_stopped > if has_can { 180 } else { 90 });

            (0..5).for_each(|_| stream(board, &mut program));
            assert!(board.with_arm(|arm| arm.is_moving()));
        });
    }
}

#[test]
fn hold_is_out_within_its_bound() {
    on_board(RawArm::default(), |board| {
        plug_in(board, MEGABAUD);
        board.can().attach(BIT_RATE);
        let mut program = CanProgram::default();
        // The middle of an upload, a self-check that the arm does not answer, a full queue behind it.
        board.usb().write(&[0x55; 100]).unwrap();
        send_on_can(board, &mut program, &SELF_CHECK);
        board.run_for(millis(10)).unwrap();
        let received = board.with_arm(RawArm::take_received);
        assert!(received.ends_with(&SELF_CHECK), "{received:02X?}");
        for _ in 0..3 {
            send_on_can(board, &mut program, &motion());
        }
        board
            .usb()
            .write(&[motion(), motion(), vec![0x55; 100]].concat())
            .unwrap();
        board.run_for(millis(2)).unwrap();

        let begin = board.now();
        Control::open(board).send(board, control::Request::Stop);
        let reads = |board: &mut VirtualBoard<RawArm>| {
            let received = board.with_arm(RawArm::take_received);
            assert!(
                received.is_empty() || received.ends_with(&READ_JOINTS),
                "{received:02X?}"
            );
            !received.is_empty()
        };
        while !reads(board) {
            board.run_for(Nanos(500_000)).unwrap();
        }
        board.run_for(millis(48)).unwrap();
        let joints = [2_000, 2_001, 2_002, 2_003, 2_004, 2_005];
        let state = JointState {
            joints,
            gripper: 310,
            status: MotionStatus::Locked,
        };
        let answer = encoded(|bytes| Ling.encode_response(&Response::Joints(state), None, bytes));
        board.with_arm(|arm| arm.send(&answer));
        board.run_for(millis(5)).unwrap();

        let hold = frame(Request::Move(Move {
            joints: joints.map(|ticks| (Position::new(ticks).unwrap(), Speed::new(2_000).unwrap())),
            gripper: (Opening::new(310).unwrap(), GripperSpeed(1_000)),
        }));
        let mut line = board.uart().bytes();
        line.retain(|byte| byte.direction == Direction::ToArm);
        let sent: Vec<u8> = line.iter().map(|byte| byte.sent).collect();
        let place = sent
            .windows(hold.len())
            .position(|bytes| bytes == hold)
            .expect("the hold");
        let took = line[place + hold.len() - 1].at.since(begin);
        assert!((millis(500)..millis(555)).contains(&took), "{took:?}");
        // The rest of the upload goes out beside repetitions of the hold, and no motion.
        let mut rest = sent[place..].to_vec();
        while let Some(at) = rest.windows(hold.len()).position(|bytes| bytes == hold) {
            rest.drain(at..at + hold.len());
        }
        assert_eq!(rest, [0x55; 100]);
        assert_eq!(counters(board).refused_stopped, 5);
        // The reply.
        assert!(board.usb().vendor().unread() > 0);
    });
}
