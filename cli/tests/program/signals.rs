//! Signals while an arm moves: it is stopped.

use armwire::time::{Duration, Instant};
use armwire_sim::ling::{Config, LingArm};
use armwire_sim::pty::Pty;
use armwire_sim::serial::SerialDevice;
use rustix::process::{Pid, Signal, kill_process};

use crate::common::{NO_ANSWER, failure, retry_while, retry_while_busy, run_against};

/// A virtual arm whose time passes by 20 ms with each burst from a program.
pub(crate) struct Stepped {
    pub(crate) arm: LingArm,
    pub(crate) now: Instant,
}

impl Stepped {
    pub(crate) fn new() -> Self {
        let (arm, now) = (LingArm::new(Config::follower()), Instant::ZERO);
        Self { arm, now }
    }

    /// Takes bytes of the program, and answers them on the pty.
    pub(crate) fn answer(&mut self, pty: &Pty, bytes: &[u8]) {
        for &byte in bytes {
            self.arm.receive(self.now, byte);
        }
        self.now += Duration::from_millis(20);
        let answer: Vec<_> = std::iter::from_fn(|| self.arm.transmit(self.now)).collect();
        pty.write(&answer).unwrap();
    }
}

/// The arguments of a move of all joints by 170°, in about 30 s.
const FAR: [&str; 6] = ["--joints", "170,170,170,170,170,170", "--speed", "6", "--wait", "PORT"];

#[test]
fn signal_in_awaited_move_stops_the_arm() {
    for signal in [Signal::INT, Signal::TERM, Signal::HUP] {
        let mut stepped = Stepped::new();
        let output = retry_while_busy(|| {
            stepped = Stepped::new();
            let mut is_sent = false;
            run_against(
                &[&["move", "--gripper", "30"], &FAR[..]].concat(),
                |program, pty, bytes| {
                    stepped.answer(pty, bytes);
                    if !is_sent && stepped.arm.joints()[0] > 2_060 {
                        is_sent = true;
                        kill_process(Pid::from_child(program), signal).unwrap();
                    }
                },
            )
        });
        let line = failure(&output);
        assert!(
            line.starts_with("stopped: joints: ") && output.stdout.is_empty(),
            "{line}"
        );
        let arm = &mut stepped.arm;
        arm.advance(stepped.now + Duration::from_millis(1_000));
        assert!(arm.is_holding() && !arm.is_moving());
        assert!((2_060..3_900).contains(&arm.joints()[0]), "{:?}", arm.joints());
        assert_eq!(arm.gripper(), 300);
    }
}

#[test]
fn second_signal_ends_the_program_at_once() {
    let output = retry_while(NO_ANSWER, || {
        let mut stepped = Stepped::new();
        run_against(
            &[&["move", "--gripper", "30"], &FAR[..]].concat(),
            |program, pty, bytes| {
                // The arm is silent after the first signal. The signals at one time count as one.
                if stepped.arm.is_moving() {
                    let _ = kill_process(Pid::from_child(program), Signal::INT);
                } else {
                    stepped.answer(pty, bytes);
                }
            },
        )
    });
    assert_eq!(output.status.code(), Some(130), "{output:?}");
    assert!(output.stdout.is_empty() && output.stderr.is_empty(), "{output:?}");
}

#[test]
fn signal_before_the_move_sends_none() {
    const READ_JOINTS: [u8; 7] = [0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF];
    let args = [
        "call",
        "ling",
        "PORT",
        "move",
        "--joints",
        "0,0,0,0,0,0",
        "--speed",
        "20",
    ];
    let mut sent = Vec::<u8>::new();
    let output = run_against(&args, |program, _, bytes| {
        sent.extend(bytes);
        let _ = kill_process(Pid::from_child(program), Signal::INT);
    });
    assert!(output.stdout.is_empty(), "{output:?}");
    assert!(
        !sent.is_empty() && sent.chunks(7).all(|bytes| bytes == READ_JOINTS),
        "{sent:02X?}"
    );
    assert!(failure(&output) == "interrupted", "{output:?}");
}
