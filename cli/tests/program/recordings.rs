//! `armwire monitor --mcap` with virtual arms, and `armwire decode` of the recordings.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output};
use std::thread;
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};

use crate::common::board::Board;
use crate::common::{Arm, NO_ANSWER, PROGRAM, TIMEOUT, failure, finish, free_path, retry_while, run, start, success};
use crate::sim_xarm;

/// A recording that is deleted at the end.
struct Recording(PathBuf);

impl Recording {
    fn new() -> Self {
        Self(free_path("recording.mcap"))
    }

    fn path(&self) -> &str {
        self.0.to_str().unwrap()
    }

    /// Runs a monitor that records, with these arguments. Repeats it while the arm is silent, as on a busy system.
    fn record(&self, args: &[&str]) -> Output {
        let output = retry_while(NO_ANSWER, || {
            let _ = fs::remove_file(&self.0);
            run(&[&["monitor", "--mcap", self.path()], args].concat())
        });
        assert!(output.status.success(), "{output:?}");
        output
    }

    /// Starts a monitor that records, with these arguments.
    fn start(&self, args: &[&str]) -> Child {
        start(
            Command::new(PROGRAM)
                .args(["monitor", "--mcap", self.path()])
                .args(args),
        )
    }

    /// The entries of the recording, and the last line of the output.
    fn decoded(&self) -> (Vec<(String, String)>, String) {
        let out = success(&["decode", self.path()]);
        let mut lines: Vec<_> = out.lines().map(str::to_owned).collect();
        let sum = lines.pop().unwrap();
        let entries = lines.chunks(2).map(|two| (two[0].clone(), two[1].clone())).collect();
        (entries, sum)
    }

    /// Waits until the file has content.
    fn wait(&self, monitor: &mut Child) {
        let deadline = Instant::now() + TIMEOUT;
        while fs::metadata(&self.0).map_or(0, |file| file.len()) == 0 {
            assert!(monitor.try_wait().unwrap().is_none() && Instant::now() < deadline);
            thread::sleep(Duration::from_millis(20));
        }
    }
}

impl Drop for Recording {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.0);
    }
}

/// The times of entries, in ns.
fn times(entries: &[(String, String)]) -> Vec<u64> {
    let time = |(line, _): &(String, String)| line.split_whitespace().next().unwrap().replace('.', "").parse();
    entries.iter().map(|entry| time(entry).unwrap()).collect()
}

#[test]
fn monitor_records_both_directions() {
    let arm = Arm::start("ling", "recorded", &["--plant", "ideal"]);
    let recording = Recording::new();
    let output = recording.record(&[&arm.port, "--rate", "200", "--count", "3", "--json"]);
    assert_eq!(output.stdout.iter().filter(|&&byte| byte == b'\n').count(), 3);
    let (entries, sum) = recording.decoded();
    let texts: Vec<_> = entries.iter().map(|(_, text)| text.trim()).collect();
    assert_eq!(
        texts[..2],
        ["to the arm: read gripper stroke", "from the arm: stroke: 50 mm"]
    );
    let joints = "from the arm: joints: +0.00° +0.00° +0.00° +0.00° +0.00° +0.00°, gripper: 0.0 % open, status: locked";
    assert_eq!(texts[2..4], ["to the arm: read joints", joints]);
    assert_eq!(texts.iter().filter(|text| **text == joints).count(), 3);
    let frames = format!("frames: {}, noise bytes: 0, joint states: ", entries.len());
    assert!(sum.starts_with(&frames), "{sum}");
    assert!(times(&entries).is_sorted(), "{entries:?}");
}

#[test]
fn recording_of_a_noisy_line_has_the_noise() {
    let arm = Arm::start("ling", "recorded-noise", &["--faults", "20000", "--seed", "1"]);
    let recording = Recording::new();
    let args = ["monitor", "--mcap", recording.path(), &arm.port, "--count", "5"];
    let output = run(&args);
    assert!(output.status.success(), "{output:?}");
    let (entries, sum) = recording.decoded();
    let is_noise = |text: &str| text.contains("no frame of a Ling arm: ") || text.contains("not one whole frame");
    assert!(
        entries
            .iter()
            .any(|(line, text)| line.contains("  from arm  ") && is_noise(text))
    );
    let answers = entries
        .iter()
        .filter(|(_, text)| text.contains("from the arm: joints: "));
    assert!(answers.count() >= 5, "{sum}");
}

#[test]
fn every_arm_can_be_recorded() {
    let xarm = sim_xarm::SimXArm::start(&["--no-report"]);
    let host = xarm.addresses()[0];
    let alpha1 = Arm::start("alpha1", "recorded-alpha1", &[]);
    let legacy = Arm::start("ling", "recorded-legacy", &["--legacy"]);
    for (args, text) in [
        (&["--arm", "xarm", host][..], "from the arm: register 42: "),
        (&["--arm", "alpha1", &alpha1.port], "from the arm: servos"),
        (&[&legacy.port], "from the arm: joints: +0.00°"),
    ] {
        let recording = Recording::new();
        recording.record(&[args, &["--count", "2"]].concat());
        let (entries, _) = recording.decoded();
        let found = entries.iter().filter(|(_, meaning)| meaning.contains(text)).count();
        assert!(found >= 2, "{entries:?}");
    }
}

#[test]
fn recording_of_an_adapter_has_its_stamps() {
    let board = Board::start("recorded");
    success(&["config", &board.control, "set", "poll=100"]);
    let recording = Recording::new();
    let output = recording.record(&[&board.control, "--from-adapter", "--json", "--count", "5"]);
    let rows = String::from_utf8(output.stdout).unwrap();
    let stamps: Vec<u64> = rows
        .lines()
        .map(|row| {
            serde_json::from_str::<serde_json::Value>(row).unwrap()["adapter_time_us"]
                .as_u64()
                .unwrap()
        })
        .collect();
    let (entries, sum) = recording.decoded();
    let frames = format!("frames: {}, noise bytes: 0, joint states: ", entries.len());
    assert!(sum.starts_with(&frames), "{sum}");
    assert!(
        entries.iter().all(|(line, _)| line.contains("  from arm  ")),
        "{entries:?}"
    );
    // A message with a shorter delay than before corrects the offset of the clocks, only towards earlier times. System time
    // and monotonic time are read one after the other, within 20 µs.
    let times = times(&entries);
    let joints = entries
        .iter()
        .zip(&times)
        .filter(|((_, text), _)| text.contains("joints: "));
    let times: Vec<_> = joints.map(|(_, time)| *time).collect();
    assert_eq!(times.len(), stamps.len());
    for (time, stamp) in times.windows(2).zip(stamps.windows(2)) {
        assert!(
            time[1] <= time[0] + (stamp[1] - stamp[0]) * 1_000 + 20_000,
            "{times:?} {stamps:?}"
        );
    }
}

#[test]
fn interrupted_recording_is_complete() {
    let arm = Arm::start("ling", "interrupted", &[]);
    let recording = Recording::new();
    let mut monitor = recording.start(&[&arm.port]);
    recording.wait(&mut monitor);
    kill_process(Pid::from_child(&monitor), Signal::INT).unwrap();
    assert!(finish(monitor).status.success());
    let (entries, sum) = recording.decoded();
    let frames = format!("frames: {}, noise bytes: 0, joint states: ", entries.len());
    assert!(sum.starts_with(&frames), "{sum}");
}

#[test]
fn recording_is_complete_without_reader_of_output() {
    let arm = Arm::start("ling", "unread", &[]);
    let recording = Recording::new();
    let mut monitor = recording.start(&[&arm.port]);
    let mut line = String::new();
    BufReader::new(monitor.stdout.take().unwrap())
        .read_line(&mut line)
        .unwrap();
    assert!(finish(monitor).status.success());
    let (entries, sum) = recording.decoded();
    assert!(!entries.is_empty());
    let frames = format!("frames: {}, noise bytes: 0, joint states: ", entries.len());
    assert!(sum.starts_with(&frames), "{sum}");
}

#[test]
fn recording_of_a_killed_monitor_is_read() {
    let arm = Arm::start("ling", "killed", &[]);
    let recording = Recording::new();
    let mut monitor = recording.start(&[&arm.port]);
    recording.wait(&mut monitor);
    monitor.kill().unwrap();
    finish(monitor);
    let output = run(&["decode", recording.path()]);
    assert_eq!(output.status.code(), Some(0));
    let out = String::from_utf8(output.stdout).unwrap();
    let sum = out.lines().last().unwrap();
    assert!(!sum.starts_with("frames: 0"), "{sum}");
    assert!(sum.ends_with(", not understood: 1 (the file has no end: 1)"), "{sum}");
    assert_eq!(run(&["decode", "--strict", recording.path()]).status.code(), Some(3));
}

#[test]
fn recording_continues_after_a_lost_port() {
    let arm = Arm::start("ling", "lost", &[]);
    let port = arm.port.clone();
    let recording = Recording::new();
    let mut monitor = recording.start(&[&port, "--count", "40", "--rate", "20"]);
    recording.wait(&mut monitor);
    drop(arm);
    let _arm = Arm::start_at("ling", Path::new(&port), &[]);
    let output = finish(monitor);
    assert!(output.status.success(), "{output:?}");
    let (entries, _) = recording.decoded();
    let answers = entries
        .iter()
        .filter(|(_, text)| text.contains("from the arm: joints: "));
    assert!(answers.count() >= 40);
}

#[test]
fn recording_is_not_replaced() {
    let arm = Arm::start("ling", "kept-recording", &[]);
    let recording = Recording::new();
    fs::write(&recording.0, "kept").unwrap();
    for path in [recording.path(), "/no-such-folder/x"] {
        let line = failure(&run(&["monitor", &arm.port, "--mcap", path]));
        assert!(line.starts_with(&format!("{path}: ")), "{line}");
    }
    assert_eq!(fs::read(&recording.0).unwrap(), b"kept");
}

#[test]
fn missing_port_leaves_no_file() {
    let recording = Recording::new();
    failure(&run(&["monitor", "/dev/no-such-port", "--mcap", recording.path()]));
    assert!(!recording.0.exists());
}

#[cfg(target_os = "linux")]
#[test]
fn full_disk_ends_the_recording() {
    let arm = Arm::start("ling", "full-disk", &[]);
    let output = run(&["monitor", &arm.port, "--mcap", "/dev/full", "--rate", "100"]);
    let text = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(
        text.ends_with("armwire: /dev/full: No space left on device (os error 28)\n"),
        "{text}"
    );
}

#[test]
fn record_is_the_recorder_of_monitor() {
    let arm = Arm::start("ling", "record", &[]);
    let recording = Recording::new();
    let output = retry_while(NO_ANSWER, || {
        let _ = fs::remove_file(&recording.0);
        run(&["record", &arm.port, recording.path(), "--count", "5"])
    });
    assert!(output.status.success(), "{output:?}");
    let sum = String::from_utf8(output.stdout).unwrap();
    assert!(sum.contains(": readings 5, "), "{sum}");
    assert_eq!(sum.lines().count(), 1, "{sum}");
    let (entries, _) = recording.decoded();
    let readings = entries
        .iter()
        .filter(|(_, text)| text.contains("from the arm: joints: "));
    assert!(readings.count() >= 5);
    let again = run(&["record", &arm.port, recording.path()]);
    assert!(failure(&again).ends_with("the file exists: delete it, or name another"));
    let into_arm = run(&["record", &arm.port, &arm.port]);
    assert!(failure(&into_arm).ends_with("this is a port, not a file to write"));
    let swapped = failure(&run(&["replay", &arm.port, recording.path()]));
    assert!(swapped.contains("this is a port, not a recording"), "{swapped}");
}
