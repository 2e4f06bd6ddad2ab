//! Load of the core, throughput of the adapter compared to the wires' limit, and speed of the virtual board.

use std::time::Instant;

use armwire::ling::JOINTS;
use armwire_bridge::Duration;
use armwire_bridge::config::{Config, Poll};
use armwire_bridge::control::Request;
use armwire_bridge::isotp::Link;
use armwire_host_tests::image::{
    BIT_RATE, CanProgram, Control, MEGABAUD, RawArm, byte_time, counters, facts, joint_answer, noise, polled,
    same_bytes,
};
use armwire_sim::ling::{Config as ArmConfig, LingArm};
use armwire_sim::serial::SerialDevice;
use armwire_virtual_board::can::NodeConfig;
use armwire_virtual_board::line::{Arm, Direction, LineByte};
use armwire_virtual_board::{Nanos, VirtualBoard};

use crate::board::Board;

/// Bits per second in the data phase of CAN FD, and the pause between two frames on the bus (ISO 11898-1).
const DATA_RATE: u32 = 5_000_000;
const INTERMISSION: Nanos = Nanos(3_000);
/// Durations before a measurement, and of the measurement.
const WARM_UP: Nanos = Nanos::from_millis(20);
const SPAN: Nanos = Nanos::from_millis(1_000);
/// Polling period of the hosts without received frames.
const POLL_PERIOD: Nanos = Nanos::from_millis(10);

/// A load of the adapter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scene {
    /// The serial port is open, and nothing is sent.
    Idle,
    /// The adapter polls the arm and sends telemetry, at 200 Hz.
    Polled,
    /// The adapter polls the arm as fast as the line allows. The arm has this turnaround.
    Fastest(Duration),
    /// The UART transfers bytes without a pause in both directions at this rate, and USB the same bytes. With a bus, the
    /// rate is 1 Mbaud, and the arm sends frames, which fill the bus by ISO-TP.
    Saturated(u32, Option<Link>),
}

impl Scene {
    pub(crate) const ALL: [Self; 10] = [
        Self::Idle,
        Self::Polled,
        Self::Fastest(Duration::from_micros(500)),
        Self::Fastest(Duration::from_micros(100)),
        Self::Fastest(Duration::ZERO),
        Self::Saturated(115_200, None),
        Self::SATURATED,
        Self::Saturated(2 * MEGABAUD, None),
        Self::Saturated(MEGABAUD, Some(Link::Classic)),
        Self::Saturated(MEGABAUD, Some(Link::Fd)),
    ];
    /// The scene whose load has a limit.
    pub(crate) const SATURATED: Self = Self::Saturated(MEGABAUD, None);

    pub(crate) fn name(self) -> String {
        match self {
            Self::Idle => "idle".to_owned(),
            Self::Polled => "poll and telemetry at 200 Hz".to_owned(),
            Self::Fastest(pause) => format!("fastest poll, {} µs turnaround", pause.as_micros()),
            Self::Saturated(baud, None) => format!("{} kbaud duplex", f64::from(baud) / 1e3),
            Self::Saturated(_, Some(Link::Classic)) => "1000 kbaud duplex, CAN full".to_owned(),
            Self::Saturated(_, Some(Link::Fd)) => "1000 kbaud duplex, CAN FD full".to_owned(),
        }
    }
}

/// Measurements of a scene.
pub(crate) struct Figures {
    /// `None` if the scene does not fill a wire.
    pub(crate) rate: Option<Rate>,
    /// The percentage of the time in which the core executed instructions.
    pub(crate) load: f64,
    /// Virtual time divided by real time.
    pub(crate) speed: f64,
}

/// Bytes or polls per second.
pub(crate) struct Rate {
    pub(crate) achieved: f64,
    /// The percentage of the wire limit.
    pub(crate) percent: f64,
}

impl Rate {
    fn new(achieved: f64, limit: f64) -> Self {
        let percent = 100.0 * achieved / limit;
        Self { achieved, percent }
    }
}

/// Runs a scene. `None` if the scene needs CAN FD and the chip has none.
pub(crate) fn measure(board: &Board, scene: Scene) -> Option<Figures> {
    match scene {
        Scene::Saturated(_, Some(Link::Fd)) if !facts(board.chip).can_fd => None,
        Scene::Saturated(baud, bus) => Some(saturate(board, scene, baud, bus)),
        Scene::Fastest(turnaround) => Some(poll(board, scene, turnaround)),
        Scene::Idle | Scene::Polled => Some(poll(board, scene, Duration::from_micros(100))),
    }
}

/// Runs a scene with a Ling arm.
fn poll(board: &Board, scene: Scene, turnaround: Duration) -> Figures {
    let config = ArmConfig::follower();
    let arm = LingArm::new(ArmConfig { turnaround, ..config });
    board.run(arm, MEGABAUD, |board| {
        configure(board, scene);
        let (mut figures, _) = run(board, Link::Classic, &mut Vec::new());
        assert_eq!(counters(board).unanswered_requests, 0);
        if matches!(scene, Scene::Fastest(_)) {
            figures.rate = Some(polls(&board.uart().bytes(), turnaround));
        }
        figures
    })
}

/// Polls per second. The limit is a line without pauses except for the arm's turnaround.
fn polls(line: &[LineByte], turnaround: Duration) -> Rate {
    let begins = |&nth: &usize| [nth - 1, nth].map(|nth| line[nth].direction) == [Direction::ToBoard, Direction::ToArm];
    let starts: Vec<usize> = (1..line.len()).filter(begins).collect();
    let [first, .., last] = starts[..] else {
        panic!("the arm is not polled");
    };
    let polls = (starts.len() - 1) as f64;
    let least = (last - first) as f64 * seconds(byte_time(MEGABAUD)) + polls * seconds(turnaround.into());
    Rate::new(polls / seconds(line[last].at.since(line[first].at)), polls / least)
}

/// Sends from the host on USB and from the arm without a pause. Every byte is compared with the byte that was sent.
fn saturate(board: &Board, scene: Scene, baud: u32, bus: Option<Link>) -> Figures {
    let line_rate = f64::from(baud) / 10.0;
    board.run(RawArm::default(), baud, |board| {
        configure(board, scene);
        let bytes = ((SPAN + WARM_UP + WARM_UP).0 / byte_time(baud).0) as usize;
        let frame = joint_answer([2048; JOINTS]);
        let up = bus.map_or(noise(2, bytes), |_| frame.repeat(bytes.div_ceil(frame.len())));
        let (down, mut received) = (noise(1, bytes), Vec::new());
        board.with_arm(|arm| arm.send(&up));
        board.usb().write(&down).expect("it is open");
        let (mut figures, [on_usb, on_can]) = run(board, bus.unwrap_or(Link::Classic), &mut received);
        let received_by_arm = board.with_arm(RawArm::take_received);
        let is_busy = received_by_arm.len() < down.len() && board.with_arm(|arm| arm.poll_timeout().is_some());
        assert!(is_busy, "the line was not busy to the end");
        same_bytes("the arm", &received_by_arm, &down[..received_by_arm.len()]);
        same_bytes("the host", &received, &up[..received.len()]);
        figures.rate = Some(match bus {
            None => {
                let line = board.uart().bytes();
                let to_arm = line.iter().filter(|byte| byte.direction == Direction::ToArm).count();
                Rate::new(on_usb.min(to_arm) as f64 / seconds(SPAN), line_rate)
            }
            Some(_) => {
                let frames = board.can().frames();
                let busy = frames
                    .iter()
                    .map(|frame| seconds(frame.end.since(frame.start) + INTERMISSION));
                let bus_rate = on_can as f64 / busy.sum::<f64>();
                Rate::new(on_can as f64 / seconds(SPAN), bus_rate.min(line_rate))
            }
        });
        figures
    })
}

fn configure<A: Arm>(board: &mut VirtualBoard<A>, scene: Scene) {
    let mut config = Config::default();
    match scene {
        Scene::Idle | Scene::Saturated(_, None) => return,
        Scene::Fastest(_) => config.poll = Poll::Fastest,
        Scene::Polled => config = polled(200),
        Scene::Saturated(_, Some(link)) => {
            config.can.unsolicited = true;
            config.can.data_bit_rate = (link == Link::Fd).then_some(DATA_RATE);
        }
    }
    match config.can.data_bit_rate {
        Some(_) => board.can().attach_as(NodeConfig::fd(BIT_RATE, DATA_RATE)),
        None if matches!(scene, Scene::Fastest(_)) => {}
        None => board.can().attach(BIT_RATE),
    }
    Control::open(board).order(board, Request::SetConfig(config));
}

/// Runs for [`WARM_UP`] and [`SPAN`]. The host on USB reads into `received`. Also returns the numbers of bytes that the
/// hosts on USB and CAN received in [`SPAN`].
fn run<A: Arm>(board: &mut VirtualBoard<A>, link: Link, received: &mut Vec<u8>) -> (Figures, [usize; 2]) {
    let mut can = CanProgram::new(link);
    let mut on_can = 0;
    let mut pass = |board: &mut VirtualBoard<A>, span| {
        let end = board.now() + span;
        while board.now() < end {
            let limit = POLL_PERIOD.min(end.since(board.now()));
            board
                .run_until_can_received(limit)
                .expect("the firmware does not crash");
            received.extend(board.usb().read());
            on_can += can.poll(board).map_or(0, |answer| answer.len());
        }
        [received.len(), on_can]
    };
    let before = pass(board, WARM_UP);
    board.uart().forget_bytes();
    board.can().forget_frames();
    let (began, busy) = (Instant::now(), board.busy());
    let after = pass(board, SPAN);
    let figures = Figures {
        rate: None,
        load: 100.0 * seconds(board.busy().since(busy)) / seconds(SPAN),
        speed: seconds(SPAN) / began.elapsed().as_secs_f64(),
    };
    (figures, [after[0] - before[0], after[1] - before[1]])
}

fn seconds(span: Nanos) -> f64 {
    span.0 as f64 / 1e9
}
