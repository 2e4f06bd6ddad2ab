//! A line that holds its bytes back, and loses some: an answer belongs to its request, and a pose is as old as it is
//! said to be. In virtual time.

use std::collections::VecDeque;

use armwire::ling::{JointState, Ling, MAX_FRAME, MotionStatus, PerServo, Request, Response, Stroke};
use armwire::messages::Messages;
use armwire::time::{Duration, Instant};
use armwire::{Client, Config, Device, DeviceEvent, Event, Output};
use proptest::collection::vec;
use proptest::prelude::*;

/// Faults of the line and the arm.
#[derive(Clone, Debug)]
struct Faults {
    /// Times at which the line holds the arm's bytes back, and for how long, in ms.
    stalls: Vec<(u64, u64)>,
    /// Answers that are lost, of 100.
    lost: u64,
    /// The time of one way on the line, in µs.
    latency: u64,
    /// Answers that come this much later, of 100, and by how much, in µs.
    late: (u64, u64),
    /// The arm answers the joints only.
    has_fences: bool,
    /// The arm answers the joints behind what it was asked later.
    is_in_order: bool,
}

const NONE: Faults = Faults {
    stalls: Vec::new(),
    lost: 0,
    latency: 300,
    late: (0, 0),
    has_fences: true,
    is_in_order: true,
};

/// The time between two bytes of the arm that lie in two packets.
const SERVICE: Duration = Duration::from_micros(200);

/// A reading that was reported.
#[derive(Clone, Copy, Debug)]
struct Pose {
    /// The time at which the arm took it.
    sampled: Instant,
    /// The time that the client states.
    stated: Instant,
}

/// A host, its line, and an arm whose joints are the time.
struct World {
    faults: Faults,
    random: u64,
    now: Instant,
    client: Client<Ling, MAX_FRAME>,
    arm: Device<Ling, MAX_FRAME>,
    to_arm: VecDeque<(Instant, Vec<u8>)>,
    /// The arm answers one request after the other.
    arm_free: Instant,
    to_host: VecDeque<(Instant, Vec<u8>)>,
    /// An answer that goes out behind the next.
    delayed: Option<Vec<u8>>,
    poses: Vec<Pose>,
    requests: usize,
}

/// The first bytes that arrive by this time.
fn first_until(line: &mut VecDeque<(Instant, Vec<u8>)>, until: Instant) -> Option<(Instant, Vec<u8>)> {
    let is_due = line.front().is_some_and(|(at, _)| *at <= until);
    is_due.then(|| line.pop_front()).flatten()
}

/// The end of the request in flight.
#[derive(Clone, Copy, Debug)]
enum End {
    Answered(Pose),
    /// It has failed, or its answer has no pose.
    NoPose,
    /// It is in flight.
    Open,
}

impl World {
    fn new(config: Config, faults: &Faults, seed: u64) -> Self {
        Self {
            faults: faults.clone(),
            random: seed | 1,
            now: Instant::from_millis(1),
            client: Client::new(Ling, config),
            arm: Device::new(Ling),
            to_arm: VecDeque::new(),
            arm_free: Instant::ZERO,
            to_host: VecDeque::new(),
            delayed: None,
            poses: Vec::new(),
            requests: 0,
        }
    }

    fn is_one_of_100(&mut self, share: u64) -> bool {
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        self.random % 100 < share
    }

    /// The arm takes its bytes until this time.
    fn run_arm(&mut self, until: Instant) {
        while let Some((at, bytes)) = first_until(&mut self.to_arm, until) {
            let mut rest = &bytes[..];
            while !rest.is_empty() {
                rest = self.arm.receive(rest);
                while let Some(event) = self.arm.poll() {
                    if let DeviceEvent::Request { request, .. } = event {
                        self.answer(&request, at.max(self.arm_free));
                    }
                }
            }
        }
    }

    fn answer(&mut self, request: &Request, sampled: Instant) {
        self.requests += 1;
        let tenths = sampled.as_micros() / 100;
        let response = match request {
            Request::ReadJoints => Response::Joints(JointState {
                joints: [(tenths >> 16) as u16, tenths as u16, 0, 0, 0, 0],
                gripper: 0,
                status: MotionStatus::Idle,
            }),
            _ if !self.faults.has_fences => return,
            Request::ReadStroke => Response::Stroke(Stroke::Mm50),
            Request::ReadTemperatures => Response::Temperatures(PerServo::Leader([30; 6])),
            Request::ReadVelocities => Response::Velocities(PerServo::Leader([0; 6])),
            other => panic!("{other}"),
        };
        let (share, micros) = self.faults.late;
        let late = if self.is_one_of_100(share) { micros } else { 0 };
        self.arm_free = sampled + SERVICE + Duration::from_micros(late);
        let mut out = [0; MAX_FRAME];
        let n = Ling.encode_response(&response, None, &mut out).unwrap();
        if self.is_one_of_100(self.faults.lost) {
            return;
        }
        let answer = out[..n].to_vec();
        if !self.faults.is_in_order && *request == Request::ReadJoints && self.delayed.is_none() && late > 0 {
            self.delayed = Some(answer);
            return;
        }
        let at = self.arm_free + Duration::from_micros(self.faults.latency);
        let mut at = self.to_host.back().map_or(at, |(before, _)| at.max(*before));
        for &(begin, millis) in &self.faults.stalls {
            let (begin, end) = (Instant::from_millis(begin), Instant::from_millis(begin + millis));
            if (begin..end).contains(&at) {
                at = end;
            }
        }
        self.to_host.push_back((at, answer));
        self.to_host.extend(self.delayed.take().map(|answer| (at, answer)));
    }

    /// Runs the client until its request has ended, or until this time.
    fn run(&mut self, limit: Instant) -> End {
        loop {
            match self.client.poll(self.now) {
                Output::Receive => self.receive(),
                Output::Transmit(bytes) => {
                    let bytes = bytes.to_vec();
                    self.now += Duration::from_micros(10 * bytes.len() as u64);
                    self.client.transmitted(self.now, bytes.len()).unwrap();
                    let at = self.now + Duration::from_micros(self.faults.latency);
                    self.to_arm.push_back((at, bytes));
                }
                Output::Event(event) => {
                    let (is_end, state) = match event {
                        Event::Answer(Response::Joints(state)) => (true, Some(state)),
                        Event::Late(Response::Joints(state)) => (false, Some(state)),
                        Event::Answer(_) | Event::TimedOut { .. } => (true, None),
                        // Another reading, or an arm out of order.
                        Event::Late(_) | Event::Unsolicited(_) => (false, None),
                        other => panic!("{other:?}"),
                    };
                    let pose = state.map(|state| {
                        let tenths = u64::from(state.joints[0]) << 16 | u64::from(state.joints[1]);
                        let stated = self.client.time_of_state().expect("it is an answer");
                        let sampled = Instant::from_micros(tenths * 100);
                        Pose { sampled, stated }
                    });
                    self.poses.extend(pose);
                    if is_end {
                        return pose.map_or(End::NoPose, End::Answered);
                    }
                }
                Output::Timeout(_) if self.now >= limit => return End::Open,
                Output::Timeout(until) => {
                    let until = until.map_or(limit, |until| until.min(limit));
                    self.run_arm(until);
                    let arrival = self.to_host.front().map_or(until, |(at, _)| until.min(*at));
                    self.now = self.now.max(arrival);
                    self.receive();
                }
            }
        }
    }

    /// The host reads its port.
    fn receive(&mut self) {
        self.run_arm(self.now);
        let mut is_empty = true;
        while let Some((_, bytes)) = first_until(&mut self.to_host, self.now) {
            is_empty = false;
            assert!(self.client.receive(self.now, &bytes).is_empty());
            if self.client.space().len() < MAX_FRAME {
                return;
            }
        }
        if is_empty {
            self.client.received(self.now, 0).unwrap();
        }
    }

    /// Reads the joints at this rate, in Hz, as readers do.
    fn read_at(&mut self, rate: u64, readings: u64) {
        let begin = self.now;
        for number in 1..=readings {
            self.client.cancel();
            self.client.submit_reading(&Request::ReadJoints).unwrap();
            let slot = begin + Duration::from_micros(number * 1_000_000 / rate);
            while !self.client.is_idle() && self.now < slot {
                self.run(slot);
            }
            // Late answers come without a request.
            self.client.cancel();
            self.run(slot);
        }
    }

    /// Makes a request, and gives it up after this time.
    fn request(&mut self, request: &Request, is_reading: bool, time: Duration) {
        self.client.cancel();
        match is_reading {
            true => self.client.submit_reading(request).unwrap(),
            false => self.client.submit(request).unwrap(),
        }
        let limit = self.now + time;
        self.run(limit);
        self.client.cancel();
        self.run(limit);
    }

    /// Makes a call. Returns the pose, or `None` without an answer.
    fn call(&mut self) -> Option<Pose> {
        self.client.cancel();
        self.client.submit(&Request::ReadJoints).unwrap();
        let limit = self.now + Duration::from_millis(60_000);
        match self.run(limit) {
            End::Answered(pose) => Some(pose),
            End::NoPose => None,
            End::Open => panic!("the call does not end"),
        }
    }
}

impl Pose {
    /// By how much it is older than stated.
    fn too_young(&self) -> Duration {
        self.stated.since(self.sampled)
    }

    /// By how much it is younger than stated.
    fn too_old(&self) -> Duration {
        self.sampled.since(self.stated)
    }
}

/// The joints, and the requests that are fences.
const FENCED: [Request; 4] = [
    Request::ReadJoints,
    Request::ReadStroke,
    Request::ReadTemperatures,
    Request::ReadVelocities,
];

/// The fate of an answer.
#[derive(Clone, Copy, Debug)]
enum Fate {
    Answered,
    Lost,
    /// It is this late, in ms.
    Late(u64),
}

fn asked_fate() -> impl Strategy<Value = Fate> {
    prop_oneof![
        Just(Fate::Answered),
        Just(Fate::Lost),
        (0..500_u64).prop_map(Fate::Late)
    ]
}

/// A request of [`FENCED`], whether it is a reading, its answer, and the time after which it is given up, in ms.
type Asked = (usize, bool, Fate, u64);

/// Which calls of 20 are answered on a good line after these requests.
fn answered_after(config: Config, latency: u64, asked: &[Asked]) -> [bool; 20] {
    let good = Faults { latency, ..NONE };
    let mut world = World::new(config, &good, 1);
    world.read_at(50, 10);
    for &(request, is_reading, fate, millis) in asked {
        (world.faults.lost, world.faults.late) = match fate {
            Fate::Answered => (0, (0, 0)),
            Fate::Lost => (100, (0, 0)),
            Fate::Late(late) => (0, (100, 1_000 * late)),
        };
        world.request(&FENCED[request], is_reading, MS(millis));
    }
    world.faults = good;
    let quiet = world.arm_free.max(world.now) + MS(100);
    world.run(quiet);
    [(); 20].map(|()| world.call().is_some())
}

const MS: fn(u64) -> Duration = Duration::from_millis;

fn faults() -> impl Strategy<Value = Faults> {
    let stalls = vec((100..4_000_u64, 50..=1_500_u64), 0..4);
    let late = prop_oneof![Just((0, 0)), (1..=20_u64, 0..60_000_u64)];
    let latency = prop_oneof![Just(300), Just(3_000), Just(16_000), Just(30_000)];
    (stalls, 0..=8_u64, latency, late).prop_map(|(stalls, lost, latency, late)| Faults {
        stalls,
        lost,
        latency,
        late,
        ..NONE
    })
}

/// The time after which the client counts an answer as lost, of an arm that has answered no fence, in ms.
const STALL: u64 = 2_000;

/// The longest time for which stalls hold an answer back, in ms.
fn longest_stall(stalls: &[(u64, u64)]) -> u64 {
    let mut stalls = stalls.to_vec();
    stalls.sort_unstable();
    let (mut begin, mut end, mut longest) = (0, 0, 0);
    for (at, millis) in stalls {
        begin = if at <= end { begin } else { at };
        end = end.max(at + millis);
        longest = longest.max(end - begin);
    }
    longest
}

/// A world whose arm has answered a fence before a stall that is longer than [`STALL`].
fn world(config: Config, faults: &Faults, seed: u64) -> World {
    let mut world = World::new(config, faults, seed);
    if longest_stall(&faults.stalls) >= STALL {
        (world.faults.lost, world.faults.late) = (0, (0, 0));
        world.read_at(50, 5);
        (world.faults.lost, world.faults.late) = (faults.lost, faults.late);
    }
    world
}

fn config() -> impl Strategy<Value = Config> {
    prop_oneof![Just(Config::DEFAULT), Just(Config::TCP)]
}

proptest! {
    #[test]
    fn pose_is_as_old_as_stated(
        faults in faults(),
        config in config(),
        rate in prop_oneof![Just(50_u64), Just(200), Just(500)],
        seed in any::<u64>(),
    ) {
        let mut world = world(config, &faults, seed);
        world.read_at(rate, 5 * rate);
        let sampled: Vec<_> = world.poses.iter().map(|pose| pose.sampled).collect();
        prop_assert!(sampled.is_sorted());
        prop_assert!(world.poses.is_sorted_by(|earlier, later| earlier.stated < later.stated));
        for pose in &world.poses {
            prop_assert!(pose.too_young() <= MS(10), "{pose:?}");
            // A late arm samples later than its request, and so does the next reading.
            let is_prompt = faults.lost == 0 && faults.late.0 == 0;
            let limit = MS(15) + Duration::from_micros(faults.latency);
            prop_assert!(!is_prompt || pose.too_old() <= limit, "{pose:?}");
        }
    }

    #[test]
    fn calls_are_answered_once_the_line_is_good_again(
        config in config(),
        latency in 300..4_000_u64,
        asked in vec((0..FENCED.len(), any::<bool>(), asked_fate(), 0..200_u64), 0..80),
    ) {
        let answered = answered_after(config, latency, &asked);
        let last = answered.iter().rev().take_while(|is| **is).count();
        prop_assert!(last >= 10, "{answered:?}");
    }

    #[test]
    fn call_returns_what_the_arm_did_after_its_begin(
        faults in faults(),
        config in config(),
        pauses in vec(0..100_u64, 40),
        seed in any::<u64>(),
    ) {
        let mut world = world(config, &faults, seed);
        for (number, pause) in pauses.into_iter().enumerate() {
            if number % 2 == 0 {
                world.read_at(200, 1 + pause / 5);
            }
            let begin = world.now;
            if let Some(pose) = world.call() {
                prop_assert!(begin <= pose.sampled, "begun at {begin:?}: {pose:?}");
            }
        }
    }
}

#[test]
fn lost_answers_cost_their_own_readings_only() {
    for (lost, latency, rate) in [
        (1, 300, 200),
        (8, 300, 200),
        (8, 300, 500),
        (8, 1_500, 200),
        (8, 3_000, 50),
    ] {
        let faults = Faults { lost, latency, ..NONE };
        let mut world = World::new(Config::DEFAULT, &faults, 7);
        world.read_at(rate, 50 * rate);
        let expected = 50 * rate * (100 - lost) / 100;
        let poses = world.poses.len() as u64;
        assert!(
            poses >= expected * 97 / 100,
            "{faults:?}, {rate} Hz: {poses} of {expected}"
        );
        let mut old: Vec<_> = world.poses.iter().map(Pose::too_old).collect();
        old.sort();
        assert!(
            old[old.len() * 99 / 100] <= MS(10),
            "{faults:?}, {rate} Hz: {:?}",
            old.last()
        );
    }
}

#[test]
fn slow_line_keeps_the_rate() {
    for (latency, rate) in [(8_000, 200), (15_000, 200), (8_000, 400), (30_000, 50)] {
        let faults = Faults { latency, ..NONE };
        let mut world = World::new(Config::DEFAULT, &faults, 7);
        world.read_at(rate, 10 * rate);
        let poses = world.poses.len() as u64;
        assert!(poses >= 10 * rate * 97 / 100, "{latency} µs, {rate} Hz: {poses}");
    }
}

#[test]
fn line_without_faults_has_one_fence() {
    let mut world = World::new(Config::DEFAULT, &NONE, 7);
    world.read_at(200, 1_000);
    assert_eq!((world.poses.len(), world.requests), (1_000, 1_001));
}

#[test]
fn call_after_a_lost_answer_waits_for_no_window() {
    let mut world = World::new(Config::DEFAULT, &NONE, 7);
    world.read_at(200, 10);
    world.faults.lost = 100;
    world.read_at(200, 1);
    world.faults.lost = 0;
    let begin = world.now;
    world.call().expect("an answer");
    assert!(world.now.since(begin) < MS(5), "{:?}", world.now.since(begin));
}

#[test]
fn calls_fail_in_a_stall_and_not_after_it() {
    let faults = Faults {
        stalls: vec![(500, 1_500)],
        ..NONE
    };
    let mut world = World::new(Config::DEFAULT, &faults, 7);
    world.read_at(200, 80);
    while world.now < Instant::from_millis(3_000) {
        let begin = world.now;
        let answered = world.call();
        assert!(
            answered.is_some() || begin < Instant::from_millis(2_000),
            "begun at {begin:?}"
        );
        world.now += MS(7);
    }
}

#[test]
fn answer_later_than_a_stall_is_taken_for_the_next_until_a_fence_is_answered() {
    for (millis, is_new) in [(STALL - 10, true), (STALL + 500, false)] {
        let faults = Faults {
            stalls: vec![(0, millis)],
            ..NONE
        };
        let mut world = World::new(Config::DEFAULT, &faults, 7);
        assert!(world.call().is_none());
        world.run(Instant::from_millis(millis - 20));
        let begin = world.now;
        let pose = world.call().expect("an answer");
        assert_eq!(
            begin <= pose.sampled,
            is_new,
            "{millis} ms: begun at {begin:?}, {pose:?}"
        );
    }
}

#[test]
fn each_fence_has_a_place_after_a_silence() {
    use Fate::{Answered, Late, Lost};
    // Two answers of a fence's key are missing to calls, and other fences go out in the silence.
    let asked = [
        (2, false, Lost, 61),
        (0, true, Late(158), 58),
        (1, false, Answered, 25),
        (2, false, Late(189), 137),
        (0, false, Answered, 0),
        (0, true, Answered, 49),
        (0, true, Answered, 89),
        (0, true, Answered, 60),
        (0, false, Answered, 52),
        (0, true, Answered, 37),
        (0, false, Answered, 155),
        (0, false, Answered, 96),
        (0, false, Answered, 16),
        (0, false, Answered, 172),
        (0, false, Answered, 40),
        (0, false, Answered, 30),
        (0, true, Answered, 11),
        (0, false, Answered, 89),
    ];
    assert_eq!(answered_after(Config::DEFAULT, 300, &asked), [true; 20]);
}

#[test]
fn arm_that_was_off_is_read_again() {
    for millis in [50, 200, 1_000, 5_000] {
        let mut world = World::new(Config::DEFAULT, &NONE, 7);
        world.read_at(200, 100);
        world.faults.lost = 100;
        world.read_at(200, millis / 5);
        world.faults.lost = 0;
        let (back, poses) = (world.now, world.poses.len());
        world.read_at(200, 1_000);
        let first = world.poses[poses].sampled.since(back);
        assert!(first < MS(150), "{millis} ms: {first:?}");
        assert!(world.poses.iter().all(|pose| pose.too_young() <= MS(10)));
    }
}

#[test]
fn arm_without_fences_is_recognised_and_read() {
    let faults = Faults {
        has_fences: false,
        lost: 1,
        ..NONE
    };
    let mut world = World::new(Config::DEFAULT, &faults, 7);
    world.read_at(200, 2_000);
    assert!(!world.client.has_fences());
    assert!(world.poses.len() > 1_800, "{}", world.poses.len());
    let oldest = world.poses.iter().map(Pose::too_old).max();
    assert!(oldest <= Some(MS(10)), "{oldest:?}");
    for _ in 0..20 {
        world.call();
    }
    assert!(world.call().is_some());
}

#[test]
fn arm_that_answers_fences_no_longer_is_recognised_and_read() {
    let mut world = World::new(Config::DEFAULT, &NONE, 7);
    world.read_at(200, 100);
    // Another arm, at the same adapter.
    (world.faults.has_fences, world.faults.lost) = (false, 1);
    world.read_at(200, 4_000);
    assert!(!world.client.has_fences());
    world.faults.lost = 0;
    for _ in 0..20 {
        world.call();
    }
    assert!(world.call().is_some());
}

#[test]
fn line_of_any_delay_is_not_flooded() {
    for millis in [100, 350, 750, 1_500] {
        let faults = Faults {
            latency: millis * 500,
            ..NONE
        };
        let mut world = World::new(Config::DEFAULT, &faults, 7);
        world.read_at(100, 2_000);
        let answered = world.requests;
        assert!(answered < 5_000, "{millis} ms: {answered} requests");
        assert!(world.poses.iter().all(|pose| pose.too_young() <= MS(10)));
    }
}

#[test]
fn call_gets_through_without_a_window() {
    let config = Config {
        latency: Duration::ZERO,
        stale_window: Duration::ZERO,
        ..Config::DEFAULT
    };
    let mut world = World::new(config, &NONE, 7);
    world.read_at(200, 2);
    world.faults.lost = 100;
    world.read_at(200, 1);
    world.faults.lost = 0;
    world.call().expect("an answer");
}

#[test]
fn pause_of_the_program_delays_no_fence() {
    let faults = Faults {
        stalls: vec![(100, 50)],
        ..NONE
    };
    let mut world = World::new(Config::DEFAULT, &faults, 7);
    world.read_at(200, 22);
    world.now += MS(60_000);
    world.faults.lost = 100;
    world.read_at(200, 1);
    world.faults.lost = 0;
    let begin = world.now;
    world.call().expect("an answer");
    assert!(world.now.since(begin) < MS(50), "{:?}", world.now.since(begin));
}

#[test]
fn arm_that_answers_out_of_order_is_recognised_and_read() {
    let faults = Faults {
        is_in_order: false,
        late: (30, 3_000),
        ..NONE
    };
    let mut world = World::new(Config::DEFAULT, &faults, 7);
    world.read_at(200, 2_000);
    assert!(world.client.out_of_order() > 0 && !world.client.has_fences());
    assert!(world.poses.len() > 1_000, "{}", world.poses.len());
}

#[test]
fn line_that_loses_most_answers_gives_some() {
    for lost in [40, 60, 80] {
        let faults = Faults { lost, ..NONE };
        let mut world = World::new(Config::DEFAULT, &faults, 5);
        let begin = world.now;
        let mut answered = 0;
        while world.now.since(begin) < MS(60_000) {
            answered += u64::from(world.call().is_some());
        }
        assert!(answered > 100 - lost, "{lost} %: {answered}");
    }
}
