//! Poses of an arm with a plant, independent of its readings.

use super::*;
use crate::ling::plant::tests::any_plant;

fn arm(plant: &str) -> Host<LingArm> {
    let plant = plant.parse().unwrap();
    host(Config {
        plant,
        ..Config::follower()
    })
}

/// Returns the true joints after a time.
fn after(host: &mut Host<LingArm>, millis: u64) -> [u16; JOINTS] {
    host.wait(Duration::from_millis(millis));
    let now = host.elapsed();
    host.device_mut().advance(now);
    host.device().joints()
}

/// Returns the true joints at rest after a move at 1000 ticks/s.
fn rest(host: &mut Host<LingArm>, goal: u16) -> [u16; JOINTS] {
    host.call(go(goal, 1000, 0)).unwrap();
    let joints = after(host, 6_000);
    assert!(!host.device().is_moving());
    joints
}

#[test]
fn loaded_joints_rest_below_their_goal_by_pose() {
    let mut host = arm("sag=26");
    assert_eq!(after(&mut host, 100), [2048, 2022, 2027, 2048, 2038, 2048]);
    // At 60° half of the sag is left; beyond 90° the load is on the other side.
    assert_eq!(rest(&mut host, 2731)[..2], [2731, 2718]);
    assert_eq!(rest(&mut host, 3413)[..2], [3413, 3426]);
    assert_eq!(host.device().velocities(), PerServo::Follower([0; 10]));
}

#[test]
fn friction_makes_rest_depend_on_direction() {
    let mut host = arm("sag=26,friction=3");
    rest(&mut host, 1848);
    assert_eq!(rest(&mut host, 2048)[..2], [2045, 2019]);
    rest(&mut host, 2248);
    assert_eq!(rest(&mut host, 2048)[..2], [2051, 2025]);
}

#[test]
fn backlash_is_taken_up_by_load() {
    let mut host = arm("sag=26,backlash=8");
    rest(&mut host, 1848);
    assert_eq!(rest(&mut host, 2048)[..2], [2044, 2018]);
    rest(&mut host, 2248);
    assert_eq!(rest(&mut host, 2048)[..2], [2052, 2018]);
}

#[test]
fn lag_is_distance_in_motion_and_decays() {
    for plant in ["lag=60ms", "lag=60ms,overshoot=1%"] {
        let mut host = arm(plant);
        host.call(go(3048, 1000, 0)).unwrap();
        let start = host.elapsed();
        host.device_mut().advance(start + Duration::from_millis(900));
        let joint = host.device().joints()[0];
        assert!((2887..=2889).contains(&joint), "{plant}: {joint} of 2948");
        let velocities = host.device().velocities();
        assert!(
            velocities.as_slice()[..9]
                .iter()
                .all(|velocity| (999..=1001).contains(velocity))
        );
        host.device_mut().advance(start + Duration::from_millis(1_900));
        assert_eq!(host.device().joints(), [3048; JOINTS], "{plant}");
    }
    let mut host = arm("lag=60ms");
    host.call(go(3048, 1000, 0)).unwrap();
    let end = host.elapsed() + seconds(1);
    host.device_mut().advance(end + Duration::from_millis(60));
    // 60 ticks, after one time constant.
    assert_eq!(host.device().joints(), [3048 - 22; JOINTS]);
}

#[test]
fn short_step_overshoots_by_its_percentage() {
    let mut host = arm("lag=60ms,overshoot=20%");
    host.call(go(2148, 5000, 0)).unwrap();
    let peak = (0..2_000).map(|_| after(&mut host, 1)[0]).max().unwrap();
    assert!((2167..=2169).contains(&peak), "{peak}");
    assert_eq!(after(&mut host, 3_000), [2148; JOINTS]);
    assert!(!host.device().is_moving());
}

#[test]
fn noise_is_in_readings_only_and_reproducible() {
    let read = |plant: &str| {
        let mut host = arm(plant);
        let readings: Vec<_> = (0..500).map(|_| joints(&mut host).joints).collect();
        assert_eq!(host.device().joints(), [2048; JOINTS]);
        readings
    };
    let readings = read("noise=2");
    let mut values: Vec<_> = readings.concat();
    values.sort_unstable();
    values.dedup();
    assert_eq!(values, [2046, 2047, 2048, 2049, 2050]);
    assert_eq!(readings, read("noise=2,seed=1"));
    assert_ne!(readings, read("noise=2,seed=2"));
}

#[test]
fn noise_leaves_no_reading_out_of_range() {
    let mut host = arm("noise=20");
    for goal in [0, 4095] {
        rest(&mut host, goal);
        let readings: Vec<_> = (0..50).flat_map(|_| joints(&mut host).joints).collect();
        assert!(readings.contains(&goal) && readings.iter().all(|ticks| ticks.abs_diff(goal) <= 20));
    }
}

#[test]
fn obstacle_stops_joint_and_lets_it_go() {
    for plant in ["", "sag=26,", "lag=60ms,overshoot=20%,", "sag=26,backlash=8,lag=20ms,"] {
        let mut host = arm(&format!("{plant}obstacle=2:30deg"));
        assert_eq!(rest(&mut host, 3048)[1], 2389, "{plant}");
        assert!(host.device().joints()[5].abs_diff(3048) <= 4, "the other joints go on");
        let [_, back, ..] = rest(&mut host, 2148);
        assert!((2148 - 30..=2148).contains(&back), "{plant}: {back}");

        rest(&mut host, 3048);
        host.device_mut().remove_obstacle();
        // It has pushed, and does not jump: 6000 ticks/s is its maximum.
        let [_, joint, ..] = after(&mut host, 2);
        assert!((2389..=2401).contains(&joint), "{plant}: {joint}");
        let [_, joint, ..] = after(&mut host, 3_000);
        assert!(joint.abs_diff(3048) <= 5, "{plant}: {joint}");
    }
}

#[test]
fn obstacle_below_stops_sinking_joint_and_hand() {
    let mut host = arm("sag=26,obstacle=2:-30deg");
    assert_eq!(rest(&mut host, 1000)[1], 1707);
    host.call(Request::SetTorque(Torque::Off)).unwrap();
    assert_eq!(after(&mut host, 4_000)[1], 1707);
    assert!(host.device_mut().push_joint(1, Position::new(1000).unwrap()));
    assert_eq!(host.device().joints()[1], 1707);
    // It stays where it is when the zero position is set: at 30° above that of the arm's power-on.
    host.device_mut().push_joint(1, Position::new(2389).unwrap());
    host.call(Request::SetZero).unwrap();
    assert_eq!(after(&mut host, 4_000)[1], 2048 - (2389 - 1707));
}

#[test]
fn restarted_slow_goals_drive_loaded_joint_down() {
    let repeated = |plant: &str, speed| {
        let mut host = arm(plant);
        for _ in 0..20 {
            host.call(go(2048, speed, 0)).unwrap();
            after(&mut host, 100);
        }
        host.device().joints()[1]
    };
    assert_eq!(repeated("sag=26,lag=40ms", 50), 2022);
    let sunk = repeated("sag=26,lag=40ms,restart", 50);
    assert!(sunk < 2048 - 4 * 26, "{sunk}");
    let held = repeated("sag=26,lag=40ms,restart", 2000);
    assert!(held > 2048 - 40, "{held}");
}

#[test]
fn arm_without_torque_sinks_until_it_hangs() {
    let sunk = |plant| {
        let mut host = arm(plant);
        host.call(Request::SetTorque(Torque::Off)).unwrap();
        let joints = after(&mut host, 6_000);
        assert!(!host.device().is_moving());
        (host, joints)
    };
    let (mut host, joints) = sunk("sag=26");
    assert_eq!(joints, [2048, 1024, 1024, 2048, 1024, 2048]);
    host.call(Request::SetTorque(Torque::On)).unwrap();
    assert_eq!(after(&mut host, 1_000), joints, "a hanging joint has no load");
    assert_eq!(rest(&mut host, 2048)[1], 2022, "with torque it returns");

    // Friction carries 13 ticks of load: joint 2 at -60°, joint 3 at -51°, joint 5 at once.
    assert_eq!(sunk("sag=26,friction=13").1, [2048, 1366, 1465, 2048, 2048, 2048]);
    assert_eq!(sunk("sag=26,friction=26").1, [2048; JOINTS]);
}

#[test]
fn torque_holds_falling_joint_with_its_sag() {
    let mut host = arm("sag=26");
    host.call(Request::SetTorque(Torque::Off)).unwrap();
    let falling = after(&mut host, 500)[1];
    host.call(Request::SetTorque(Torque::On)).unwrap();
    let held = after(&mut host, 2_000)[1];
    assert!(
        falling < 1950 && (22..=27).contains(&(falling - held)),
        "{falling}, {held}"
    );
}

#[test]
fn other_program_moves_one_joint_at_its_time() {
    let mut host = arm("other=2:30deg@500ms");
    host.call(go(1948, 1000, 0)).unwrap();
    assert_eq!(after(&mut host, 400), [1948; JOINTS]);
    assert_eq!(after(&mut host, 1_000), [1948, 2389, 1948, 1948, 1948, 1948]);
    assert_eq!(rest(&mut host, 2048), [2048; JOINTS], "once");

    let Request::Move(target) = go(2148, 1000, 0) else {
        unreachable!()
    };
    assert!(host.device_mut().move_by_other(&target));
    assert_eq!(after(&mut host, 200), [2148; JOINTS]);
    assert_eq!(host.device().counters().requests, 2, "it is not on this line");

    let mut host = arm("other=2:30deg@500ms");
    host.call(Request::SetTorque(Torque::Off)).unwrap();
    assert_eq!(after(&mut host, 1_000), [2048; JOINTS], "without torque it is ignored");
    assert!(!host.device_mut().move_by_other(&target));
}

#[test]
fn leader_in_a_hand_has_noise_only() {
    let plant = "sag=200,lag=500ms,friction=9,noise=1,obstacle=2:30deg".parse().unwrap();
    let mut host = host(Config {
        plant,
        ..Config::leader()
    });
    assert!(host.device_mut().push_joint(1, Position::MAX));
    assert_eq!(after(&mut host, 1_000)[1], 4095);
    let read: Vec<_> = (0..50).map(|_| joints(&mut host).joints[0]).collect();
    assert!(read.contains(&2047) && read.contains(&2049));
}

#[test]
fn arm_with_weight_handles_endless_clock() {
    let mut arm = LingArm::new(Config {
        plant: Plant::TYPICAL,
        ..Config::follower()
    });
    arm.advance(Instant::from_micros(1_700_000_000_000_000));
    assert_eq!(arm.joints(), [2048, 2041, 2043, 2048, 2047, 2048]);
    arm.advance(Instant::from_micros(u64::MAX));
    assert!(arm.is_holding());
}

/// Where a joint without mechanics is, by its last command.
#[derive(Clone, Copy)]
struct Command {
    /// In millionths of a tick, as the target.
    from: i64,
    target: i64,
    ticks_per_second: i64,
    at: Instant,
}

impl Command {
    fn rest(micro: i64, at: Instant) -> Self {
        Self {
            from: micro,
            target: micro,
            ticks_per_second: 0,
            at,
        }
    }

    fn position(&self, now: Instant) -> i64 {
        let reach = self.ticks_per_second * now.since(self.at).as_micros() as i64;
        self.from + (self.target - self.from).clamp(-reach, reach)
    }
}

#[derive(Clone, Copy, Debug)]
enum Step {
    Go(u16, u16),
    Torque(bool),
    Zero,
    Push(u16),
}

fn any_step() -> impl Strategy<Value = Step> {
    prop_oneof![
        4 => (0..4096_u16, 0..=5000_u16).prop_map(|(ticks, speed)| Step::Go(ticks, speed)),
        2 => any::<bool>().prop_map(Step::Torque),
        1 => Just(Step::Zero),
        1 => (0..4096_u16).prop_map(Step::Push),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn ideal_joint_is_exactly_on_its_trajectory(
        script in proptest::collection::vec((any_step(), 0..2_000_000_u64), 1..30),
    ) {
        let mut arm = LingArm::new(Config { plant: Plant::IDEAL, ..Config::follower() });
        let (mut now, mut torque) = (Instant::ZERO, true);
        let mut command = Command::rest(2_048_000_000, now);
        for (step, pause) in script {
            let request = match step {
                Step::Go(ticks, speed) => Some(go(ticks, speed, 0)),
                Step::Torque(on) => Some(Request::SetTorque(if on { Torque::On } else { Torque::Off })),
                Step::Zero => Some(Request::SetZero),
                Step::Push(_) => None,
            };
            send(&mut arm, &mut now, &request.map_or(vec![], |request| bytes(&request)));
            let here = Command::rest(command.position(now), now);
            match step {
                Step::Go(ticks, speed) if torque => {
                    let (target, ticks_per_second) = (i64::from(ticks) * 1_000_000, speed.into());
                    command = Command { target, ticks_per_second, ..here };
                }
                Step::Go(..) => {}
                Step::Torque(on) => {
                    command = if on { command } else { here };
                    torque = on;
                }
                Step::Zero => (command, torque) = (Command::rest(2_048_000_000, now), false),
                Step::Push(ticks) => {
                    let moved = arm.push_joint(3, Position::new(ticks).unwrap());
                    prop_assert_eq!(moved, !torque);
                    if moved {
                        command = Command::rest(i64::from(ticks) * 1_000_000, now);
                    }
                }
            }
            now += Duration::from_micros(pause);
            arm.advance(now);
            let nearest = (command.position(now) + 500_000) / 1_000_000;
            prop_assert_eq!(i64::from(arm.joints()[3]), nearest);
        }
    }

    #[test]
    fn plant_is_independent_of_polling(
        plant in any_plant(),
        script in proptest::collection::vec((any_request(), 0..2_000_000_u64), 1..12),
        polls in proptest::collection::vec(0..20_000_000_u64, 0..200),
    ) {
        let config = Config { plant, ..Config::follower() };
        check_polling(&config, script, polls)?;
    }

    #[test]
    fn any_plant_comes_to_rest(plant in any_plant(), goal in 0..4096_u16, speed in 500..5000_u16) {
        let mut arm = LingArm::new(Config { plant, ..Config::follower() });
        let mut now = Instant::ZERO;
        send(&mut arm, &mut now, &bytes(&go(goal, speed, 0)));
        arm.advance(now + seconds(5_000_000));
        prop_assert!(!arm.is_moving());
        prop_assert!(arm.joints().iter().all(|&ticks| ticks <= 4095));
    }
}
