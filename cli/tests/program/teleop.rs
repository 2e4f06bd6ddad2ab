//! `armwire teleop` with virtual arms.

use std::cell::RefCell;
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Output};
use std::time::Instant;

use armwire::ling::Position;
use armwire::time;
use armwire_sim::ling::{Config, LingArm};
use armwire_sim::pty::Pty;
use armwire_sim::serial::SerialDevice;
use rustix::process::{Pid, Signal, kill_process};

#[cfg(target_os = "linux")]
use crate::common::retry_while_busy;
use crate::common::terminal::Terminal;
use crate::common::{
    Arm, NO_ANSWER, PROGRAM, TIMEOUT, angles, failure, finish, free_path, retry_while, run, start, success, usage,
};

/// A virtual arm on a pty, in real time.
struct Served {
    arm: LingArm,
    pty: Pty,
    start: Instant,
    is_plugged: bool,
}

impl Served {
    fn new(config: Config) -> Self {
        Self {
            arm: LingArm::new(config),
            pty: Pty::open(Some(&free_path("teleop"))).unwrap(),
            start: Instant::now(),
            is_plugged: true,
        }
    }

    fn port(&self) -> &str {
        self.pty.path().to_str().unwrap()
    }

    fn serve(&mut self) {
        let micros = self.start.elapsed().as_micros().try_into().unwrap();
        let now = time::Instant::from_micros(micros);
        let mut bytes = [0; 256];
        let n = self.pty.read(&mut bytes).unwrap();
        if self.is_plugged {
            bytes[..n].iter().for_each(|&byte| self.arm.receive(now, byte));
        }
        self.arm.advance(now);
        let answer: Vec<_> = std::iter::from_fn(|| self.arm.transmit(now)).collect();
        if !answer.is_empty() {
            self.pty.write(&answer).unwrap();
        }
    }

    /// Loses the port. Another device is at its path then.
    fn replug(&mut self) {
        let path = self.pty.path().to_owned();
        // The path is free after the drop.
        self.pty = Pty::open(None).unwrap();
        self.pty = Pty::open(Some(&path)).unwrap();
    }

    /// Moves all joints of an arm without torque to this position.
    fn push(&mut self, ticks: u16) {
        for joint in 0..6 {
            assert!(self.arm.push_joint(joint, Position::new(ticks).unwrap()));
        }
    }
}

/// A leader, its follower, and the program.
struct Pair {
    leader: Served,
    follower: Served,
    deadline: Instant,
}

impl Pair {
    fn new() -> Self {
        Self {
            leader: Served::new(Config::leader()),
            follower: Served::new(Config::follower()),
            deadline: Instant::now() + TIMEOUT,
        }
    }

    /// Serves both arms until `is_done`. Returns false at the deadline.
    fn serve_until(&mut self, mut is_done: impl FnMut(&mut Self) -> bool) -> bool {
        while Instant::now() < self.deadline {
            self.leader.serve();
            self.follower.serve();
            if is_done(self) {
                return true;
            }
            self.follower
                .pty
                .wait(Some(std::time::Duration::from_micros(500)))
                .unwrap();
        }
        false
    }

    /// Runs teleoperation with these options, `act` until it returns true, and ends it by Ctrl-C. Repeats that on a busy
    /// system.
    fn teleop(options: &[&str], mut act: impl FnMut(&mut Self) -> bool) -> (Self, Output) {
        let last = RefCell::new(Self::new());
        let output = retry_while(NO_ANSWER, || {
            let mut pair = Self::new();
            let ports = [pair.leader.port(), pair.follower.port()];
            let mut child = start(Command::new(PROGRAM).arg("teleop").args(ports).args(options));
            let has_ended = pair.serve_until(|pair| act(pair) || child.try_wait().unwrap().is_some());
            assert!(has_ended, "{:?}", {
                child.kill().unwrap();
                finish(child)
            });
            // It fails if the program has ended.
            let _ = kill_process(Pid::from_child(&child), Signal::INT);
            pair.serve_until(|_| child.try_wait().unwrap().is_some());
            last.replace(pair);
            finish(child)
        });
        (last.into_inner(), output)
    }
}

#[cfg(target_os = "linux")]
#[test]
fn one_port_twice_is_in_use_by_this_process() {
    let leader = Arm::start("ling", "teleop-once", &["--leader"]);
    let line = failure(&retry_while_busy(|| run(&["teleop", &leader.port, &leader.port])));
    assert!(line.ends_with("in use by this process: close that one first"), "{line}");
}

#[test]
fn follower_follows_until_ctrl_c_and_rests() {
    let recording = free_path("teleop.mcap");
    let (mut pair, output) = Pair::teleop(&["--mcap", recording.to_str().unwrap()], |pair| {
        let at = pair.follower.arm.joints()[0];
        if at >= 2_300 {
            return true;
        }
        // The hand is always ahead by 2°.
        pair.leader.push(at + 23);
        false
    });
    assert!(output.status.success() && output.stderr.is_empty(), "{output:?}");
    let out = String::from_utf8(output.stdout).unwrap();
    let lines: Vec<_> = out.lines().collect();
    assert!(
        lines[0].ends_with("; Ctrl-C ends it") && lines[1] == "following",
        "{out}"
    );
    assert!(lines[lines.len() - 2].starts_with("stopped: joints: "), "{out}");
    assert!(lines[lines.len() - 1].contains(" s: moves "), "{out}");
    let follower = &mut pair.follower.arm;
    follower.advance(time::Instant::from_micros(u64::MAX / 2));
    assert!(
        follower.is_holding() && (2_300..2_330).contains(&follower.joints()[0]),
        "{:?}",
        follower.joints()
    );
    // Both arms were recorded, and the follower's goals are what a replay makes of them.
    let decoded = success(&["decode", recording.to_str().unwrap()]);
    assert!(
        decoded.contains("to the arm: move") && decoded.contains("status: idle"),
        "{decoded}"
    );
    let arm = Arm::start("ling", "teleop-replay", &[]);
    let replayed = retry_while("no reading of the joints for", || {
        run(&["replay", recording.to_str().unwrap(), &arm.port])
    });
    let out = String::from_utf8(replayed.stdout).unwrap();
    assert!(
        replayed.status.success() && out.contains("of /follower/frames ("),
        "{out}"
    );
    fs::remove_file(recording).unwrap();
}

#[test]
fn lost_leader_stops_the_follower_until_it_is_near() {
    let (mut pair, output) = Pair::teleop(&[], |pair| {
        // The follower is asked 100 times per second, also while it waits.
        let requests = pair.follower.arm.counters().requests;
        let is_lost = (200..400).contains(&requests);
        if is_lost && pair.leader.is_plugged {
            pair.leader.push(2_400);
        }
        pair.leader.is_plugged = !is_lost;
        requests >= 600
    });
    assert!(output.status.success(), "{output:?}");
    let out = String::from_utf8(output.stdout).unwrap();
    assert!(out.contains("no pose of the leader for 0."), "{out}");
    assert!(
        out.contains("\nwaiting until both arms are within 5° of each other"),
        "{out}"
    );
    pair.follower.arm.advance(time::Instant::from_micros(u64::MAX / 2));
    let joints = pair.follower.arm.joints();
    assert!(joints.iter().all(|&at| (2_034..2_052).contains(&at)), "{joints:?}");
}

#[test]
fn arms_of_the_wrong_kind_are_refused() {
    let [leader, follower] = [&["--leader"][..], &[]].map(|args| Arm::start("ling", "teleop-kinds", args));
    let line = failure(&retry_while(NO_ANSWER, || {
        run(&["teleop", &follower.port, &leader.port])
    }));
    let reason = "this is a follower (ADFS251205123456), where a leader is expected: LEADER FOLLOWER";
    assert_eq!(line, format!("{}: {reason}", follower.port));
}

#[test]
fn follower_without_torque_is_refused() {
    let [leader, follower] = [&["--leader"][..], &[]].map(|args| Arm::start("ling", "teleop-torque", args));
    success(&["torque", &follower.port, "off", "--yes"]);
    let line = failure(&retry_while(NO_ANSWER, || {
        run(&["teleop", &leader.port, &follower.port])
    }));
    assert!(line.contains("the torque is off, so nothing was sent"), "{line}");
}

#[test]
fn distant_arms_are_refused_if_so_asked() {
    let [leader, follower] = [&["--leader"][..], &[]].map(|args| Arm::start("ling", "teleop-far", args));
    success(&[
        "move",
        &follower.port,
        "--joints",
        "0,0,0,0,0,20",
        "--speed",
        "200",
        "--gripper",
        "0",
        "--wait",
    ]);
    let output = retry_while(NO_ANSWER, || {
        run(&["teleop", &leader.port, &follower.port, "--no-approach"])
    });
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(
        stderr.contains("joint 6 of the follower is 20° away from the leader's"),
        "{stderr}"
    );
}

#[test]
fn rate_slower_than_the_speed_is_refused_without_the_arms() {
    let stderr = usage(&["teleop", "/dev/absent", "/dev/absent", "--rate", "10"]);
    let line = "armwire: steps of 4.9° at 10 Hz are 49°/s, slower than the limit of 90°/s: 19 Hz would do \
                (--rate, --max-step, --max-speed)";
    assert_eq!(stderr.trim_end(), line);
}

#[test]
fn terminal_shows_rate_lag_and_losses() {
    let [leader, follower] = [&["--leader"][..], &[]].map(|args| Arm::start("ling", "teleop-terminal", args));
    let mut terminal = Terminal::new(100, 10);
    let mut child = terminal.start_whole(&["teleop", &leader.port, &follower.port]);
    let is_shown =
        terminal.wait_for("following  ", &mut child) && terminal.wait_for(" ms  lost readings: ", &mut child);
    let _ = kill_process(Pid::from_child(&child), Signal::INT);
    terminal.finish(child);
    assert!(is_shown, "{}", terminal.seen);
}

#[test]
fn unplugged_leader_is_named() {
    let [leader, follower] = [&["--leader"][..], &[]].map(|args| Arm::start("ling", "teleop-unplugged", args));
    let mut child = start(Command::new(PROGRAM).args(["teleop", &leader.port, &follower.port]));
    let mut out = BufReader::new(child.stdout.take().unwrap()).lines();
    let mut wait_for = |text: &str| out.any(|line| line.unwrap().contains(text));
    assert!(wait_for("following"));
    let port = leader.port.clone();
    drop(leader);
    assert!(wait_for("no pose of the leader for "));
    assert!(wait_for("waiting until both arms are within 5°"));
    let leader = Arm::start_at("ling", Path::new(&port), &["--leader"]);
    assert!(wait_for("following"), "it comes back");
    kill_process(Pid::from_child(&child), Signal::INT).unwrap();
    assert!(wait_for(" s: moves "));
    let output = finish(child);
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(stderr.contains(&leader.port), "{stderr}");
}

/// Teleoperation whose follower has just become silent. Returns the lines of the program that follow, and all arms.
fn with_silent_follower() -> (Child, impl FnMut(&str) -> String, [Arm; 2]) {
    let leader = Arm::start("ling", "teleop-silent", &["--leader"]);
    let follower = Arm::start("ling", "teleop-silent", &[]);
    let mut child = start(Command::new(PROGRAM).args(["teleop", &leader.port, &follower.port]));
    let mut out = BufReader::new(child.stdout.take().unwrap()).lines();
    let mut line_with = move |text: &str| {
        out.find_map(|line| line.ok().filter(|line| line.contains(text)))
            .unwrap()
    };
    line_with("following");
    follower.signal(Signal::STOP);
    let line = line_with("no pose of the follower for 0.");
    assert!(line.contains(&format!("; {}: not stopped: ", follower.port)), "{line}");
    assert!(line.ends_with("; it is asked again until it stops"), "{line}");
    (child, line_with, [leader, follower])
}

#[test]
fn silent_follower_is_waited_for() {
    let (child, mut line_with, [leader, follower]) = with_silent_follower();
    follower.signal(Signal::CONT);
    line_with("stopped: joints: ");
    line_with("following");
    kill_process(Pid::from_child(&child), Signal::INT).unwrap();
    line_with("stopped: joints: ");
    line_with(" s: moves ");
    let output = finish(child);
    assert!(output.status.success() && output.stderr.is_empty(), "{output:?}");
    let angles = angles(&follower.port);
    // A stop costs one sag, of 0.9°, and a busy computer pauses several times.
    assert!(angles.iter().all(|angle| (-6.0..0.3).contains(angle)), "{angles:?}");
    drop(leader);
}

#[test]
fn ctrl_c_beside_a_silent_follower_says_one_thing() {
    let (child, _, [_leader, follower]) = with_silent_follower();
    kill_process(Pid::from_child(&child), Signal::INT).unwrap();
    let line = failure(&finish(child));
    assert!(line.starts_with(&format!("{}: not stopped: ", follower.port)), "{line}");
    assert_eq!(line.matches("stopped").count(), 1, "{line}");
}

#[test]
fn follower_whose_port_was_lost_follows_when_told_to() {
    let mut terminal = Terminal::new(100, 10);
    let mut pair = Pair::new();
    let child = terminal.start_whole(&["teleop", pair.leader.port(), pair.follower.port()]);
    let mut wait_for = |pair: &mut Pair, text: &str| {
        terminal.seen.clear();
        let is_seen = pair.serve_until(|_| {
            terminal.read();
            terminal.seen.contains(text)
        });
        assert!(is_seen, "{text:?} is not in {:?}", terminal.seen);
    };
    wait_for(&mut pair, "following");
    pair.follower.replug();
    wait_for(&mut pair, "is back. To let it follow again, type follow");
    let requests = pair.follower.arm.counters().requests;
    pair.leader.push(2_100);
    terminal.pty.write(b"\ny\n").unwrap();
    let deadline = Instant::now() + std::time::Duration::from_millis(300);
    pair.serve_until(|_| Instant::now() > deadline);
    assert_eq!(pair.follower.arm.counters().requests, requests);
    terminal.pty.write(b"follow\n").unwrap();
    assert!(pair.serve_until(|pair| pair.follower.arm.joints()[0] > 2_090));
    let _ = kill_process(Pid::from_child(&child), Signal::INT);
    assert!(pair.serve_until(|_| {
        terminal.read();
        terminal.seen.contains(" s: moves ")
    }));
    terminal.finish(child);
}

#[test]
fn follower_whose_port_is_lost_ends_a_script() {
    let [leader, follower] = [&["--leader"][..], &[]].map(|args| Arm::start("ling", "teleop-script", args));
    let mut child = start(Command::new(PROGRAM).args(["teleop", &leader.port, &follower.port]));
    let mut out = BufReader::new(child.stdout.take().unwrap()).lines();
    assert!(out.any(|line| line.unwrap().contains("following")));
    drop(follower);
    let error = failure(&finish(child));
    assert!(error.contains("the port is gone"), "{error}");
}

#[test]
fn leader_whose_port_is_lost_ends_a_script() {
    let [leader, follower] = [&["--leader"][..], &[]].map(|args| Arm::start("ling", "teleop-exit", args));
    let ports = [&leader.port, &follower.port];
    let mut child = start(Command::new(PROGRAM).arg("teleop").args(ports).arg("--exit-on-loss"));
    let mut out = BufReader::new(child.stdout.take().unwrap()).lines();
    assert!(out.any(|line| line.unwrap().contains("following")));
    drop(leader);
    let error = failure(&finish(child));
    assert!(
        error.contains("the port is gone") && error.contains("stopped: "),
        "{error}"
    );
}
