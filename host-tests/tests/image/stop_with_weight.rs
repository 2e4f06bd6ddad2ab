//! The firmware image and a stop of an arm with weight: what the arm does.

use armwire::ling::{Ling, MAX_FRAME, Move, Request};
use armwire::time::{Duration, Instant};
use armwire::{Device, DeviceEvent};
use armwire_bridge::control::{self, STOP_MS};
use armwire_host_tests::image::requests::frame;
use armwire_host_tests::image::{Control, MEGABAUD, on_board, plug_in};
use armwire_host_tests::weight::{DEGREE, Reach, extend, raised, to, travel_beyond_sag};
use armwire_sim::ling::{Config, LingArm};
use armwire_virtual_board::line::Direction;
use armwire_virtual_board::{Nanos, VirtualBoard};

/// The time in which a stopped arm comes to rest.
const SETTLED: Nanos = Nanos::from_millis(STOP_MS as u64 + 200);

fn arm(plant: &str) -> LingArm {
    LingArm::new(Config {
        plant: plant.parse().unwrap(),
        ..Config::follower()
    })
}

/// The moves on the line since this time, and the ends of their last bytes.
fn moves(board: &mut VirtualBoard<LingArm>, since: Nanos) -> Vec<(Nanos, Move)> {
    let mut device = Device::<Ling, MAX_FRAME>::new(Ling);
    let mut moves = Vec::new();
    for byte in board.uart().bytes() {
        if byte.direction == Direction::ToArm && byte.at > since {
            assert!(device.receive(&[byte.sent]).is_empty());
            while let Some(event) = device.poll() {
                if let DeviceEvent::Request {
                    request: Request::Move(target),
                    ..
                } = event
                {
                    moves.push((byte.at, target));
                }
            }
        }
    }
    moves
}

fn instant(at: Nanos) -> Instant {
    Instant::from_micros(at.0 / 1_000)
}

/// What the same arm reaches, which is held at `held`, and raised by its sag.
fn reference(plant: &str, sag: f64, moved: (Nanos, Move), held: Nanos) -> Reach {
    let mut arm = arm(plant);
    arm.advance(instant(moved.0));
    arm.move_by_other(&moved.1);
    arm.advance(instant(held));
    let joints = arm.joints();
    arm.move_by_other(&raised(joints, sag));
    let mut reached = joints.map(|at| (at, at));
    for millis in 1..=2_000 {
        arm.advance(instant(held) + Duration::from_millis(millis));
        extend(&mut reached, arm.joints());
    }
    reached
}

/// Stops an arm with this plant that moves at this speed, and once more where it stands.
fn check(plant: &str, sag: f64, speed: u16) {
    on_board(arm(plant), |board| {
        plug_in(board, MEGABAUD);
        let mut control = Control::open(board);
        let begin = board.now();
        let goal = to([2_900, 1_400, 2_700, 1_900, 1_500, 2_300], speed);
        board.usb().write(&frame(Request::Move(goal))).unwrap();
        board.run_for(Nanos::from_millis(400)).unwrap();
        assert!(board.with_arm(|arm| arm.is_moving()));
        let moved = moves(board, begin)[0];

        let stopped = board.now();
        control.order(board, control::Request::Stop);
        while moves(board, stopped).is_empty() {
            board.run_for(Nanos::from_millis(1)).unwrap();
        }
        let joints = board.with_arm(|arm| arm.joints());
        let mut reached = joints.map(|at| (at, at));
        while board.now() < stopped + SETTLED {
            board.run_for(Nanos::from_millis(1)).unwrap();
            extend(&mut reached, board.with_arm(|arm| arm.joints()));
        }
        let holds = moves(board, stopped);
        let pose = |(_, hold): &(Nanos, Move)| hold.joints.map(|(position, _)| position);
        let is_one = holds.iter().all(|hold| pose(hold) == pose(&holds[0]));
        assert!(holds.len() >= 5 && is_one, "{plant}: {holds:?}");

        let end = board.with_arm(|arm| arm.joints());
        let still = reference(plant, sag, moved, holds[0].0);
        let beyond = travel_beyond_sag(&reached, &still, [joints, end], sag);
        assert!(beyond <= DEGREE, "{plant}: {beyond} ticks beyond the sag");

        for _ in 0..2 {
            control.order(board, control::Request::Stop);
            board.run_for(SETTLED).unwrap();
            for (at, end) in board.with_arm(|arm| arm.joints()).into_iter().zip(end) {
                assert!(f64::from(at.abs_diff(end)) < DEGREE, "{plant}: {end} to {at}");
            }
        }
        assert!(board.with_arm(|arm| arm.is_holding()));
    });
}

#[test]
fn stop_of_an_arm_that_sags_is_one_setpoint_and_no_descent() {
    for (plant, sag, speed) in [
        ("typical", 10.0, 600),
        ("sag=26,lag=80ms,friction=3,noise=1,seed=2", 26.0, 1_500),
        ("sag=40,lag=200ms,friction=8", 40.0, 300),
        ("sag=40,lag=60ms,overshoot=20%", 40.0, 1_000),
        ("sag=20,lag=100ms,friction=4,restart", 20.0, 500),
    ] {
        check(plant, sag, speed);
    }
}
