//! How much of its time the core works, and how fast the virtual board is meanwhile.

use std::collections::BTreeMap;
use std::num::NonZeroU32;
use std::time::{Duration, Instant};

use armwire::Micros;
use armwire::ling::JOINTS;
use armwire_bridge::can::Node;
use armwire_sim::ling::LingArm;
use armwire_sim::serial::SerialDevice;
use armwire_virtual_board::line::Arm;
use armwire_virtual_board::{Config as BoardConfig, Nanos, VirtualBoard};

use super::{configure, fastest, unsolicited};
use crate::image::{
    CanProgram, MEGABAUD, Talker, counters, facts, joint_answer, noise, on_board_with, path, plug_in, polled,
};

/// Bits per second on the bus.
const BUS_RATE: u32 = 1_000_000;

/// What passes before the measurement begins.
const WARM_UP: Nanos = Nanos::from_millis(20);

/// How far the board runs between two looks of the hosts if nothing comes.
const GLANCE: Nanos = Nanos::from_millis(10);

/// What there is to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scene {
    /// The serial port is open, and nobody says anything.
    Idle,
    /// The adapter polls the arm so many times a second, and tells of it on the bus.
    Polled(u16),
    /// The adapter polls the arm as fast as the wire allows.
    Fastest,
    /// The UART carries bytes without a pause both ways at this rate, and USB what it carries.
    Saturated(u32),
    /// The same at a megabaud; what the arm says are frames, which go to the bus as well, as many as it carries.
    SaturatedWithCan,
}

/// All of them.
pub const SCENES: [Scene; 6] = [
    Scene::Idle,
    Scene::Polled(200),
    Scene::Fastest,
    Scene::Saturated(MEGABAUD),
    Scene::Saturated(2 * MEGABAUD),
    Scene::SaturatedWithCan,
];

impl Scene {
    /// Its name in records.
    pub fn name(self) -> String {
        match self {
            Self::Idle => "idle".to_owned(),
            Self::Polled(hertz) => format!("polled-{hertz}"),
            Self::Fastest => "polled-fastest".to_owned(),
            Self::Saturated(baud) => format!("saturated-{baud}"),
            Self::SaturatedWithCan => "saturated-with-can".to_owned(),
        }
    }
}

/// What a scene took, and its profile if there is one.
type Measured = (Run, BTreeMap<u64, u64>);

/// What a scene took.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Run {
    /// Virtual time.
    pub time: Nanos,
    /// The part of it in which the core executed instructions.
    pub busy: Nanos,
    /// Our time.
    pub took: Duration,
}

/// Plays a scene for `span`. An instruction takes `cost` percent of a cycle.
///
/// # Panics
///
/// If the firmware did what it must not, or lost bytes.
pub fn measure(cost: NonZeroU32, scene: Scene, span: Nanos) -> Run {
    play(cost, scene, span, false).0
}

/// Plays a scene for `span`, and returns how often the core came to each instruction, by its address.
///
/// # Panics
///
/// As [`measure`].
pub fn profile(scene: Scene, span: Nanos) -> BTreeMap<u64, u64> {
    play(NonZeroU32::new(100).expect("not zero"), scene, span, true).1
}

fn play(cost: NonZeroU32, scene: Scene, span: Nanos, profiled: bool) -> Measured {
    let ling = || LingArm::new(armwire_sim::ling::Config::follower());
    match scene {
        Scene::Idle => on(cost, ling(), MEGABAUD, |board| run(board, cost, span, profiled, |_| ())),
        Scene::Polled(hertz) => on(cost, ling(), MEGABAUD, |board| {
            board.can().attach(BUS_RATE);
            configure(board, polled(hertz));
            run(board, cost, span, profiled, |_| ())
        }),
        Scene::Fastest => on(cost, ling(), MEGABAUD, |board| {
            configure(board, fastest());
            run(board, cost, span, profiled, |_| ())
        }),
        Scene::Saturated(baud) => on(cost, Talker::default(), baud, |board| {
            let bytes = bytes_in(span, baud);
            saturate(board, cost, span, profiled, &noise(1, bytes), &noise(2, bytes))
        }),
        Scene::SaturatedWithCan => on(cost, Talker::default(), MEGABAUD, |board| {
            board.can().attach(BUS_RATE);
            configure(board, unsolicited());
            let bytes = bytes_in(span, MEGABAUD);
            saturate(board, cost, span, profiled, &noise(1, bytes), &joints(bytes))
        }),
    }
}

/// How many bytes the line carries one way in `span` and what is before and after it.
fn bytes_in(span: Nanos, baud: u32) -> usize {
    let all = span + WARM_UP + WARM_UP;
    (all.0 * u64::from(baud / 10) / 1_000_000_000) as usize
}

/// Frames with joints, so many bytes in all at least.
pub(super) fn joints(bytes: usize) -> Vec<u8> {
    let frame = joint_answer([2048; JOINTS]);
    frame.repeat(bytes.div_ceil(frame.len()))
}

fn on<A: Arm>(cost: NonZeroU32, arm: A, baud: u32, play: impl FnOnce(&mut VirtualBoard<A>) -> Measured) -> Measured {
    let mut config = BoardConfig::new(path(), arm);
    config.instruction_cost = cost;
    config.arm_baud = baud;
    on_board_with(config, |board| {
        plug_in(board, baud);
        play(board)
    })
}

/// Lets both sides say `down` and `up` without a pause; they must not end before the measurement does.
fn saturate(
    board: &mut VirtualBoard<Talker>,
    cost: NonZeroU32,
    span: Nanos,
    profiled: bool,
    down: &[u8],
    up: &[u8],
) -> Measured {
    board.with_arm(|arm| arm.say(up));
    board.usb().write(down).expect("it is open");
    let result = run(board, cost, span, profiled, |board| {
        board.usb().read();
    });
    let still = board.usb().unsent() > 0 && board.with_arm(|arm| arm.poll_timeout()) == Some(Micros(0));
    assert!(still, "the line was not busy to the end");
    let counters = counters(board);
    assert_eq!((counters.dropped_bytes, counters.refused_bytes), (0, 0));
    result
}

/// Runs for `span` after a while, and lets the hosts do what they do all the time.
fn run<A: Arm>(
    board: &mut VirtualBoard<A>,
    cost: NonZeroU32,
    span: Nanos,
    profiled: bool,
    mut use_it: impl FnMut(&mut VirtualBoard<A>),
) -> Measured {
    let mut can = CanProgram::new(Node::default());
    let mut pass = |board: &mut VirtualBoard<A>, span: Nanos| {
        let end = board.now() + span;
        while board.now() < end {
            use_it(board);
            can.poll(board);
            // What was on the wires is not needed.
            board.uart().forget_bytes();
            board.usb().forget_packets();
            board.can().forget_frames();
            let limit = GLANCE.min(end.since(board.now()));
            if let Err(error) = board.run_until_heard(limit) {
                panic!("{error}");
            }
        }
    };
    pass(board, WARM_UP);
    if profiled {
        board.profile().expect("it counts from here on");
    }
    let (began, time, instructions) = (Instant::now(), board.now(), board.instructions());
    pass(board, span);
    let cycles = (board.instructions() - instructions) * u64::from(cost.get()) / 100;
    let run = Run {
        time: board.now().since(time),
        busy: Nanos(cycles * 1_000_000_000 / facts(board.chip()).core_hz),
        took: began.elapsed(),
    };
    let profile = profiled.then(|| board.profile().expect("it has counted"));
    (run, profile.unwrap_or_default())
}
