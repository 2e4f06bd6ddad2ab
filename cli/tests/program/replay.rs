//! `armwire replay` with virtual arms.

use std::fs;
use std::path::PathBuf;
use std::process::{Command, Output};
use std::time::Instant;

use armwire::ling::{
    GripperSpeed, JointState, Ling, MAX_FRAME, MotionStatus, Move, Opening, Position, Request, Response, Speed,
};
use armwire::messages::Messages;
use armwire::time::Duration;
use mcap::records::MessageHeader;
use rustix::process::{Pid, Signal, kill_process};

use crate::common::board::Board;
use crate::common::{
    Arm, NO_ANSWER, PROGRAM, TIMEOUT, angles, failure, finish, free_path, retry_while, retry_while_busy, run,
    run_against, start, success,
};
use crate::signals::Stepped;

/// The error of an arm that a busy system does not read in time.
const LATE: &str = "no reading of the joints for";

/// Fields in CDR, little-endian.
struct Cdr(Vec<u8>);

impl Cdr {
    fn new() -> Self {
        Self(vec![0, 1, 0, 0])
    }

    fn aligned(mut self, to: usize, bytes: &[u8]) -> Self {
        while !(self.0.len() - 4).is_multiple_of(to) {
            self.0.push(0);
        }
        self.0.extend(bytes);
        self
    }

    fn u32(self, value: u32) -> Self {
        self.aligned(4, &value.to_le_bytes())
    }

    fn text(self, text: &str) -> Self {
        let len = text.len() as u32 + 1;
        self.u32(len).aligned(1, text.as_bytes()).aligned(1, &[0])
    }

    fn time(self, millis: u32) -> Self {
        self.u32(1_000 + millis / 1_000).u32(millis % 1_000 * 1_000_000)
    }
}

/// A joint state behind its stamp.
fn joint_state(stamp: Cdr, names: &[&str], positions: &[f64]) -> Vec<u8> {
    let mut cdr = stamp.text("base").u32(names.len() as u32);
    cdr = names.iter().fold(cdr, |cdr, name| cdr.text(name));
    cdr = cdr.u32(positions.len() as u32);
    cdr = positions
        .iter()
        .fold(cdr, |cdr, value| cdr.aligned(8, &value.to_le_bytes()));
    cdr.u32(0).u32(0).0
}

/// A file in MCAP, deleted at the end.
pub(crate) struct Recording(PathBuf);

impl Recording {
    /// A file of messages of one type, each with its time in milliseconds.
    fn new(schema: &str, messages: &[(u32, Vec<u8>)]) -> Self {
        let path = free_path("replay.mcap");
        let mut writer = mcap::Writer::new(fs::File::create(&path).unwrap()).unwrap();
        let schema = writer.add_schema(schema, "ros2msg", b"").unwrap();
        let channel = writer.add_channel(schema, "/arm", "cdr", &Default::default()).unwrap();
        for (millis, message) in messages {
            let time = u64::from(*millis) * 1_000_000;
            let header = MessageHeader {
                channel_id: channel,
                sequence: 0,
                log_time: time,
                publish_time: time,
            };
            writer.write_to_known_channel(&header, message).unwrap();
        }
        writer.finish().unwrap();
        Self(path)
    }

    /// Joint states with these names, and the positions at each time in milliseconds.
    fn joint_states<P: AsRef<[f64]>>(names: &[&str], positions: &[(u32, P)]) -> Self {
        let messages = positions.iter().map(|(millis, positions)| {
            let stamp = Cdr::new().time(*millis);
            (*millis, joint_state(stamp, names, positions.as_ref()))
        });
        Self::new("sensor_msgs/msg/JointState", &messages.collect::<Vec<_>>())
    }

    /// Joint states of all joints at 0°, at these times in milliseconds; `None` without a time.
    fn at_times(times: &[Option<u32>]) -> Self {
        let messages = times.iter().map(|millis| {
            let stamp = millis.map_or(Cdr::new().u32(0).u32(0), |millis| Cdr::new().time(millis));
            (millis.unwrap_or(0), joint_state(stamp, &NAMES[..6], &[0.0; 6]))
        });
        Self::new("sensor_msgs/msg/JointState", &messages.collect::<Vec<_>>())
    }

    /// Frames of a Ling arm from the host (0) or from the arm (1), each with its time in milliseconds.
    pub(crate) fn frames(frames: &[(u32, u8, Vec<u8>)]) -> Self {
        let messages: Vec<_> = frames
            .iter()
            .map(|(millis, direction, frame)| {
                let cdr = Cdr::new().time(*millis).text("ling").aligned(1, &[*direction]);
                (*millis, cdr.u32(frame.len() as u32).aligned(1, frame).0)
            })
            .collect();
        Self::new("armwire_msgs/msg/Frame", &messages)
    }

    /// Half a second with readings at 90 % of the goals, whose gripper is at 50 % and whose goals are at 30 %.
    pub(crate) fn of_a_grip() -> Self {
        let frames = (0..=50).flat_map(|n| {
            let goal = 2_048 + 2 * n;
            let joints = [Position::new(goal).unwrap(); 6];
            let request = Request::Move(Move {
                joints: joints.map(|position| (position, Speed::MAX)),
                gripper: (Opening::new(300).unwrap(), GripperSpeed(1_000)),
            });
            let response = Response::Joints(JointState {
                joints: [goal - 10; 6],
                gripper: 500,
                status: MotionStatus::Locked,
            });
            let mut out = [[0; MAX_FRAME]; 2];
            let sent = Ling.encode_request(&request, &mut out[0]).unwrap();
            let received = Ling.encode_response(&response, None, &mut out[1]).unwrap();
            let millis = u32::from(n) * 10;
            [
                (millis, 0, out[0][..sent].to_vec()),
                (millis + 1, 1, out[1][..received].to_vec()),
            ]
        });
        Self::frames(&frames.collect::<Vec<_>>())
    }

    pub(crate) fn path(&self) -> &str {
        self.0.to_str().unwrap()
    }

    /// Replays it. Repeats that on a busy system.
    fn replay(&self, args: &[&str]) -> Output {
        retry_while(NO_ANSWER, || {
            retry_while(LATE, || run(&[&["replay", self.path()], args].concat()))
        })
    }
}

impl Drop for Recording {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.0);
    }
}

const NAMES: [&str; 7] = ["joint1", "joint2", "joint3", "joint4", "joint5", "joint6", "gripper"];

#[test]
fn joint_states_of_others_are_replayed() {
    let arm = Arm::start("ling", "replay-states", &[]);
    let positions: Vec<_> = (0..=10)
        .map(|n| {
            (
                n * 50,
                [2.0, 2.0, 2.0, 2.0, 2.0, 2.0, 1.0].map(|rate| 0.005 * rate * f64::from(n)),
            )
        })
        .collect();
    let recording = Recording::joint_states(&NAMES, &positions[..5]);
    let output = recording.replay(&[&arm.port]);
    assert!(output.status.success(), "{output:?}");
    let out = String::from_utf8(output.stdout).unwrap();
    assert!(
        out.starts_with("0.2 s of /arm (5 joint states)\ntracking error of joints 1 to 6, in "),
        "{out}"
    );
    // 0.04 rad are 2.29°, and 20 mm are 40 % of 50 mm.
    assert_joints_near(&arm, 2.29, 1.3);
    let joints = success(&["call", "ling", &arm.port, "read-joints"]);
    assert!(joints.ends_with("gripper: 40.0 % open, status: locked\n"), "{joints}");
}

/// A file of joints of this repository.
fn shipped(name: &str) -> String {
    format!("{}/tests/{name}", env!("CARGO_MANIFEST_DIR"))
}

/// The names in the vendor's model.
const MODEL: [&str; 7] = ["Joint1", "Joint2", "Joint3", "Joint4", "Joint5", "Joint6", "Gripper"];

#[test]
fn joint_states_of_the_vendors_model_are_replayed() {
    // The finger closes from 0 to -0.025 m in the model, and to 0.025 m on the topic of its driver.
    for (file, finger) in [("alicia-d-moveit.toml", -0.01), ("alicia-d-driver.toml", 0.01)] {
        let poses: Vec<_> = (0..=10)
            .map(|n| {
                let angle = 0.01 * f64::from(n);
                (n * 50, [angle, angle, angle, angle, angle, angle, finger])
            })
            .collect();
        let recording = Recording::joint_states(&MODEL, &poses);
        let arm = Arm::start("ling", "replay-model", &["--plant", "ideal"]);
        let output = recording.replay(&[&arm.port, "--joints", &shipped(file)]);
        assert!(output.status.success(), "{output:?}");
        assert_joints_near(&arm, 5.73, 0.05);
        // 10 mm of each of the two fingers are missing of 50 mm.
        let joints = success(&["call", "ling", &arm.port, "read-joints"]);
        assert!(joints.ends_with("gripper: 60.0 % open, status: locked\n"), "{joints}");
    }
}

#[test]
fn file_of_joints_turns_and_shifts_a_recording() {
    let path = free_path("joints.toml");
    let file = "[one]\n[two.joints]\njoint2 = { name = \"elbow\", factor = -57.29577951308232, offset = 90 }\n";
    fs::write(&path, file).unwrap();
    let names = ["elbow", "joint1", "joint3", "joint4", "joint5", "joint6"];
    let poses = [
        (0, [90.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
        (400, [80.0, 0.1, 0.0, 0.0, 0.0, 0.0]),
    ];
    let arm = Arm::start("ling", "replay-turned", &["--plant", "ideal"]);
    let joints = ["--joints", path.to_str().unwrap(), "--joints-of", "two"];
    let output = Recording::joint_states(&names, &poses).replay(&[&[&*arm.port], &joints[..]].concat());
    assert!(output.status.success(), "{output:?}");
    let angles = angles(&arm.port);
    // 10° less of the elbow are 10° more of joint 2.
    assert!(
        (angles[0] - 5.73).abs() < 0.05 && (angles[1] - 10.0).abs() < 0.05,
        "{angles:?}"
    );
    fs::remove_file(path).unwrap();
}

#[test]
fn recordings_that_the_joints_do_not_fit_are_refused() {
    let path = free_path("limits.toml");
    fs::write(&path, "[arm.joints]\njoint2 = { name = \"b\", min = -1, max = 0.5 }\n").unwrap();
    let limits = path.to_str().unwrap();
    let model = shipped("alicia-d-moveit.toml");
    let still = |names: &[&str], at: f64| Recording::joint_states(names, &[(0, vec![at; names.len()])]);
    for (recording, joints, reason) in [
        (
            still(&NAMES, 0.0),
            &*model,
            "the joint 'joint1' is none of Joint1, Joint2, Joint3, Joint4, Joint5, Joint6, Gripper (--joints)",
        ),
        (still(&MODEL[1..], 0.0), &*model, "Joint1 is missing"),
        (
            still(&["joint1", "b", "joint3", "joint4", "joint5", "joint6"], 0.6),
            limits,
            "b is at 0.5998 at 0.00 s, and its limits are -1.0000 to 0.5000 (--joints)",
        ),
        (Recording::of_a_grip(), limits, ""),
    ] {
        let output = run(&["replay", recording.path(), "/dev/absent", "--joints", joints]);
        let line = failure(&output);
        match reason {
            // Frames have no names, and this motion is within the limits.
            "" => assert!(line.starts_with("/dev/absent: "), "{line}"),
            reason => assert_eq!(line, format!("{}: {reason}", recording.path())),
        }
    }
    fs::write(&path, "[arm.joints]\njoint2 = { max = 0.05 }\n").unwrap();
    let recording = Recording::of_a_grip();
    let line = failure(&run(&["replay", recording.path(), "/dev/absent", "--joints", limits]));
    assert!(
        line.contains("joint2 is at 0.0522 at 0.17 s, and its limits are"),
        "{line}"
    );
    fs::remove_file(path).unwrap();
}

#[test]
fn wrong_file_of_joints_is_named_with_its_place() {
    let path = free_path("wrong.toml");
    let file = path.to_str().unwrap();
    for (text, reason) in [
        (
            "[a.joints]\njoint1 = { factor = 0 }",
            "\"a\": joint1: factor 0.0 is not within 1e-9 to 1e9, or the negative of it",
        ),
        ("[a.joints]\njoint1 = { factr = 1 }", "line 2: unknown field `factr`"),
        (
            "[a.joints]\njoint1 = { name = \"joint2\" }",
            "\"a\": two joints have the name \"joint2\"",
        ),
        ("[a]\n[b]", "it has several arms, and one must be named: a, b"),
    ] {
        fs::write(&path, text).unwrap();
        let line = failure(&run(&["replay", "motion.mcap", "/dev/absent", "--joints", file]));
        assert!(line.starts_with(&format!("{file}: {reason}")), "{line}");
    }
    fs::remove_file(path).unwrap();
}

#[test]
fn recorded_goals_are_replayed_with_their_grip() {
    let recording = Recording::of_a_grip();
    for (option, angle, gripper, warning) in [
        (&[][..], "+8.79°", "30.0 %", ""),
        (&["--readings"], "+7.91°", "50.0 %", "they carry no grip force"),
    ] {
        let arm = Arm::start("ling", "replay-goals", &["--plant", "ideal"]);
        let output = recording.replay(&[&[&*arm.port], option].concat());
        assert!(output.status.success(), "{output:?}");
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert!(
            stderr.contains(warning) && stderr.is_empty() == warning.is_empty(),
            "{stderr}"
        );
        let joints = success(&["call", "ling", &arm.port, "read-joints"]);
        assert!(joints.contains(angle) && joints.contains(gripper), "{joints}");
    }
}

#[test]
fn unsuitable_recordings_are_refused_without_the_arm() {
    let still = |names: &[&str]| Recording::joint_states(names, &[(0, &[0.0; 7][..names.len()])]);
    let jump = Recording::joint_states(&NAMES[..6], &[(0, &[0.0; 6]), (100, &[1.0; 6])]);
    let past_the_end = Recording::joint_states(&NAMES[..6], &[(0, &[3.2; 6])]);
    for (recording, reason) in [
        (
            jump,
            "joint 1 jumps by 57.3° within 100 ms at 0.00 s: the limit is 180°/s (--max-speed, --speed)",
        ),
        (
            past_the_end,
            "joint1: joint angle is 3.2 rad, must be -3.1415927..=3.1400588",
        ),
        (still(&NAMES[..5]), "joint6 is missing"),
        (still(&["joint1", "joint2", "joint1"]), "joint1 is there twice"),
        (
            still(&["joint1", "shoulder"]),
            "the unit of 'shoulder' is not known: replayed are joint1 to joint6 in rad, and gripper in m \
             (--joints FILE names others)",
        ),
        (
            Recording::at_times(&[Some(0), Some(10), None, Some(30)]),
            "message 3 of 4 has no time, and others have one",
        ),
        (Recording::at_times(&[None; 3]), "none of the 3 messages has a time"),
        (
            Recording::new("std_msgs/msg/String", &[]),
            "there is no pose of a Ling arm: neither frames of one ('armwire record' records them), nor \
             sensor_msgs/msg/JointState with joint1 to joint6",
        ),
    ] {
        let line = failure(&run(&["replay", recording.path(), "/dev/absent"]));
        assert_eq!(line, format!("{}: {reason}", recording.path()));
    }
}

/// A motion of the joints by 149°/s, to 149°.
fn fast() -> Recording {
    let positions: Vec<_> = (0..=50).map(|n| (n * 20, [0.052 * f64::from(n); 6])).collect();
    Recording::joint_states(&NAMES[..6], &positions)
}

#[test]
fn unsorted_recording_is_replayed_in_order() {
    // 201 poses of 2 s, to 57°.
    let poses: Vec<_> = (0..201)
        .map(|n| n * 73 % 201)
        .map(|n| (n * 10, [0.005 * f64::from(n); 6]))
        .collect();
    let recording = Recording::joint_states(&NAMES[..6], &poses);
    let arm = Arm::start("ling", "replay-unsorted", &[]);
    let output = recording.replay(&[&arm.port]);
    assert!(output.status.success(), "{output:?}");
    let stderr = String::from_utf8(output.stderr).unwrap();
    let warning = "195 of 201 poses are recorded behind a later one, by up to 1.99 s: they are sorted by their times";
    assert!(
        stderr.contains(&format!("{}: {warning}\n", recording.path())),
        "{stderr}"
    );
    let out = String::from_utf8(output.stdout).unwrap();
    assert!(out.starts_with("2.0 s of /arm (201 joint states)\n"), "{out}");
    assert_joints_near(&arm, 57.3, 5.73);
}

#[test]
fn poses_of_one_time_are_left_out_with_a_warning() {
    let arm = Arm::start("ling", "replay-same", &[]);
    let output = Recording::at_times(&[Some(0), Some(10), Some(10), Some(20)]).replay(&[&arm.port]);
    assert!(output.status.success(), "{output:?}");
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(
        stderr.contains(": 1 of 4 poses have the time of another, and are left out\n"),
        "{stderr}"
    );
}

#[test]
fn rate_too_slow_for_the_motion_is_refused_without_the_arm() {
    let recording = fast();
    let line = failure(&run(&["replay", recording.path(), "/dev/absent", "--rate", "10"]));
    let reason = "joint 1 moves by 9.0° within 60 ms at 0.00 s, and steps of 4.9° at 10 Hz are slower: 30 Hz would do \
                  (--rate, --speed)";
    assert_eq!(line, format!("{}: {reason}", recording.path()));
}

#[test]
fn replay_ends_at_the_last_pose() {
    let arm = Arm::start("ling", "replay-end", &[]);
    // At 75°/s. Faster, it is too far away from its goal on a busy computer.
    let output = fast().replay(&[&arm.port, "--rate", "40", "--speed", "0.5"]);
    assert!(output.status.success(), "{output:?}");
    let out = String::from_utf8(output.stdout).unwrap();
    assert!(out.lines().last().unwrap().starts_with("  at rest  0."), "{out}");
    assert_joints_near(&arm, 148.97, 5.73);
}

/// Asserts that the joints are within this distance of this angle, in degrees.
fn assert_joints_near(arm: &Arm, degrees: f64, within: f64) {
    let angles = angles(&arm.port);
    assert!(
        angles.iter().all(|angle| (angle - degrees).abs() < within),
        "{angles:?}"
    );
}

#[test]
fn arm_that_stays_away_from_the_last_pose_is_named() {
    let arm = Arm::start("ling", "replay-away", &["--plant", "obstacle=3:141deg"]);
    let output = fast().replay(&[&arm.port, "--speed", "0.5"]);
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(
        stderr.contains("joint 3 is at rest 8.0° away from the last pose: is something in its way?; "),
        "{stderr}"
    );
}

#[test]
fn file_that_is_cut_within_its_magic_is_no_recording() {
    let path = free_path("cut.mcap");
    for len in [0, 5] {
        fs::write(&path, &mcap::MAGIC[..len]).unwrap();
        let line = failure(&run(&["replay", path.to_str().unwrap(), "/dev/absent"]));
        assert_eq!(line, format!("{}: this is no MCAP file", path.display()));
    }
    fs::remove_file(path).unwrap();
}

#[test]
fn part_to_replay_has_its_end_after_its_start() {
    let output = run(&["replay", "motion.mcap", "/dev/absent", "--from", "2", "--to", "2"]);
    assert!(String::from_utf8_lossy(&output.stderr).contains("--to must be after --from"));
}

#[test]
fn lerobot_data_set_is_named() {
    let path = free_path("episode.parquet");
    fs::write(&path, b"PAR1\0\0\0\0").unwrap();
    for path in [&*path, &std::env::temp_dir()] {
        let line = failure(&run(&["replay", path.to_str().unwrap(), "/dev/absent"]));
        assert!(
            line.ends_with(": the repository has tools/lerobot_to_mcap.py for a LeRobot data set"),
            "{line}"
        );
    }
    fs::remove_file(path).unwrap();
}

#[test]
fn arm_without_torque_is_not_replayed_to() {
    let arm = Arm::start("ling", "replay-torque", &[]);
    success(&["torque", &arm.port, "off", "--yes"]);
    let output = Recording::of_a_grip().replay(&[&arm.port]);
    let line = failure(&output);
    assert!(line.contains("the torque is off, so nothing was sent"), "{line}");
}

#[test]
fn leader_is_not_replayed_to() {
    let arm = Arm::start("ling", "replay-leader", &["--leader"]);
    let line = failure(&Recording::of_a_grip().replay(&[&arm.port]));
    assert!(line.ends_with("this is a leader, which nothing moves"), "{line}");
}

/// A motion of 20 s, by 170°.
fn far() -> Recording {
    let positions: Vec<_> = (0..=200).map(|n| (n * 100, [0.015 * f64::from(n); 6])).collect();
    Recording::joint_states(&NAMES[..6], &positions)
}

#[test]
fn signal_in_a_replay_stops_the_arm() {
    let recording = far();
    let mut stepped = Stepped::new();
    let output = retry_while_busy(|| {
        retry_while(LATE, || {
            stepped = Stepped::new();
            let mut is_sent = false;
            run_against(&["replay", recording.path(), "PORT"], |program, pty, bytes| {
                stepped.answer(pty, bytes);
                if !is_sent && stepped.arm.joints()[0] > 2_060 {
                    is_sent = true;
                    kill_process(Pid::from_child(program), Signal::INT).unwrap();
                }
            })
        })
    });
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(
        stderr.lines().last().unwrap().starts_with("armwire: stopped: joints: "),
        "{stderr}"
    );
    let arm = &mut stepped.arm;
    arm.advance(stepped.now + Duration::from_millis(1_000));
    assert!(arm.is_holding() && !arm.is_moving());
    assert!((2_060..3_900).contains(&arm.joints()[0]), "{:?}", arm.joints());
}

/// A reading that the adapter polls, as JSON.
fn polled(board: &Board) -> serde_json::Value {
    let args = [
        "monitor",
        &board.port,
        "--control",
        &board.control,
        "--from-adapter",
        "--json",
        "--count",
        "1",
    ];
    // An event may be on the error output.
    serde_json::from_slice(&run(&args).stdout).unwrap_or_default()
}

#[test]
fn killed_replay_loses_the_torque_if_so_configured() {
    let board = Board::start("replay-killed");
    let settings = ["poll=50", "host-timeout.after-ms=300", "host-timeout.torque-off=on"];
    success(&[&["config", &board.control, "set"], &settings[..]].concat());
    let recording = far();
    let begin = || start(Command::new(PROGRAM).args(["replay", recording.path(), &board.port]));
    let deadline = Instant::now() + TIMEOUT;
    let mut child = begin();
    while polled(&board)["joint_1_deg"].as_f64() < Some(5.0) {
        if child.try_wait().unwrap().is_some() {
            let output = finish(std::mem::replace(&mut child, begin()));
            let stderr = String::from_utf8(output.stderr).unwrap();
            let is_busy = stderr.contains(LATE) || stderr.contains(NO_ANSWER);
            assert!(is_busy && Instant::now() < deadline, "{stderr}");
        }
    }
    child.kill().unwrap();
    finish(child);
    while polled(&board)["status"] != "idle" {
        assert!(Instant::now() < deadline, "{}", polled(&board));
    }
}

#[test]
fn replay_that_the_adapter_refuses_names_the_stop() {
    let board = Board::start("replay-refused");
    success(&["config", &board.control, "set", "poll=50"]);
    let recording = far();
    let args = ["replay", recording.path(), &board.port, "--control", &board.control];
    success(&["stop", &board.control]);
    // The test's own readings of the control port may come first.
    let is_busy = |line: &str| [LATE, NO_ANSWER, "in use by"].iter().any(|error| line.contains(error));
    // A warning about the gripper precedes the error of a replay that began.
    let last_line = |output: Output| {
        assert_eq!(output.status.code(), Some(1), "{output:?}");
        String::from_utf8(output.stderr)
            .unwrap()
            .lines()
            .last()
            .unwrap()
            .to_owned()
    };
    let begun = last_line(retry_while(NO_ANSWER, || run(&args)));
    let refused = |line: &str| line.contains(": motion is refused for ") && line.contains("stopped by a host on USB");
    assert!(refused(&begun) && !begun.contains("stopped: "), "{begun}");
    // Later in the motion.
    let deadline = Instant::now() + TIMEOUT;
    loop {
        let mut child = start(Command::new(PROGRAM).args(args));
        while child.try_wait().unwrap().is_none() && polled(&board)["joint_1_deg"].as_f64() < Some(5.0) {}
        success(&["stop", &board.control]);
        let line = last_line(finish(child));
        if is_busy(&line) || refused(&line) && !line.contains("stopped: ") {
            assert!(Instant::now() < deadline, "{line}");
            continue;
        }
        assert!(refused(&line), "{line}");
        break;
    }
}
