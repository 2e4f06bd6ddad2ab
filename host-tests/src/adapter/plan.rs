//! The actions of all participants in a run, with their times.

use armwire::ling::{GripperSpeed, JOINTS, Move, Opening, Position, Speed};
use armwire_bridge::config::{Can, Config, HostTimeout, Poll};
use armwire_bridge::control::{Initiator, Request};

use super::Circumstances;
use super::arm::{Behavior, Key, QUERIES, SELF_CHECK, TORQUE, Tag, frame};
use super::rig::{Rig, motion};
use crate::random::Random;

const MILLISECOND: u64 = 1_000;

/// Period of the unasked frames, in µs.
const UNASKED_PERIOD: u64 = 40 * MILLISECOND;

/// An action of a run.
#[derive(Clone, Debug)]
enum Step {
    /// The host on USB.
    UsbRequests(Key),
    UsbMoves,
    UsbHolds,
    UsbWrites(Vec<u8>),
    /// The first bytes of a request, without the rest.
    UsbStops(usize),
    /// The first bytes of a request, and the rest of it.
    UsbBegins(usize),
    UsbGoesOn,
    SetRate(u32),
    Reads(bool),
    Dtr(bool),
    Control(Request),
    /// Hosts on CAN.
    CanRequests(Key),
    CanMoves,
    CanHolds,
    CanFrame(&'static [u8]),
    Command,
    /// The arm.
    Unasked,
    /// Another host configures another arm, if a stream is armed.
    OtherArm,
    /// The adapter.
    Watchdog,
}

/// A host that may stop.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Host {
    Usb,
    Can,
    Commander,
}

impl Step {
    /// The host that performs the action.
    fn host(&self) -> Option<Host> {
        match self {
            Self::UsbRequests(_)
            | Self::UsbMoves
            | Self::UsbHolds
            | Self::UsbWrites(_)
            | Self::UsbStops(_)
            | Self::UsbBegins(_)
            | Self::UsbGoesOn => Some(Host::Usb),
            Self::CanRequests(_) | Self::CanMoves | Self::CanHolds => Some(Host::Can),
            Self::Command => Some(Host::Commander),
            _ => None,
        }
    }
}

/// A run before its start.
pub(super) struct Plan {
    rig: Rig,
    config: Config,
    steps: Vec<(u64, Step)>,
    end: u64,
    /// The host on USB writes complete requests only.
    is_whole: bool,
    requests: [u32; 2],
    /// The unsent rest of the request begun by the host on USB.
    begun: Vec<u8>,
}

impl Plan {
    pub(super) fn new(mut random: Random, is_traced: bool) -> Self {
        let r = &mut random;
        let config = config(r);
        let saves = r.percent(20);
        let slowest = r.one_of(&[300, 300, 2_000, 45_000, 100_000, 100_000]);
        let behavior = Behavior {
            // Bytes that arrive during a flash write are received later.
            slowest: if saves { slowest.min(70_000) } else { slowest },
            lost: r.one_of(&[0, 0, 0, 2, 20, 100]),
            checks_itself: r.percent(20),
        };
        let after = u64::from(config.host_timeout.after_ms).max(50) * MILLISECOND;
        let end = r.between(600, 2_000) * MILLISECOND;
        let mut steps = Vec::new();
        let mut is_whole = true;

        streams(r, &config, after, end, &mut steps);
        questions(r, end, &mut steps);
        if r.percent(25) {
            for _ in 0..r.between(1, 3) {
                let at = r.between(0, end);
                let key = r.one_of(&QUERIES);
                let same = r.percent(50);
                for _ in 0..r.between(9, 24) {
                    let key = if same { key } else { r.one_of(&QUERIES) };
                    steps.push((at, Step::UsbRequests(key)));
                }
            }
        }
        if r.percent(30) {
            for _ in 0..r.between(1, 2) {
                let at = r.between(0, end);
                steps.push((
                    at,
                    r.one_of(&[Step::UsbRequests as fn(Key) -> Step, Step::CanRequests])(SELF_CHECK),
                ));
            }
        }
        if r.percent(15) {
            is_whole = false;
            for _ in 0..r.between(1, 3) {
                steps.push((r.between(0, end), Step::UsbStops(r.between(1, 10) as usize)));
            }
        }
        if r.percent(20) {
            let begin = r.between(0, end);
            let baud = r.one_of(&[2_400, 9_600, 115_200, 2_000_000]);
            steps.push((begin, Step::SetRate(baud)));
            if r.percent(50) {
                let bytes = vec![0x55; r.between(1, 300) as usize];
                steps.push((begin + MILLISECOND, Step::UsbWrites(bytes)));
                is_whole = false;
            }
            // The host restores the arm's rate, closes the port, or does neither.
            let ends = begin + r.between(5, 500) * MILLISECOND;
            match r.between(0, 3) {
                0 | 1 => steps.push((ends, Step::SetRate(1_000_000))),
                2 => steps.extend([(begin, Step::Dtr(true)), (ends, Step::Dtr(false))]),
                _ => {}
            }
        }
        if r.percent(18) {
            let begin = r.between(0, end);
            steps.push((begin, Step::Control(Request::HoldLine)));
            steps.push((
                begin + r.between(1, 500) * MILLISECOND,
                Step::Control(Request::ReleaseLine),
            ));
        }
        if saves {
            for _ in 0..r.between(1, 3) {
                steps.push((r.between(0, end), Step::Control(Request::SaveConfig)));
            }
        }
        let rest = end + after + 800 * MILLISECOND;
        if r.percent(20) {
            let first = r.between(0, UNASKED_PERIOD);
            steps.extend(every(first, UNASKED_PERIOD, rest).map(|at| (at, Step::Unasked)));
        }
        if r.percent(20) {
            // Flow control, an empty frame, and an invalid ISO-TP frame.
            let data = r.one_of(&[&[0x30, 0, 0][..], &[], &[0x50, 1, 2]]);
            let period = r.between(20, 400) * MILLISECOND;
            steps.extend(every(r.between(0, period), period, rest).map(|at| (at, Step::CanFrame(data))));
        }
        for request in [Request::IdentifyArm, Request::GetCounters, Request::EndStream] {
            if r.percent(15) {
                steps.push((r.between(0, end), Step::Control(request)));
            }
        }
        if r.percent(8) {
            let begin = r.between(0, end);
            steps.push((begin, Step::Reads(false)));
            steps.push((begin + r.between(1, 300) * MILLISECOND, Step::Reads(true)));
        }
        if r.percent(8) {
            let begin = r.between(0, end);
            steps.push((begin, Step::Dtr(true)));
            steps.push((begin + r.between(1, 300) * MILLISECOND, Step::Dtr(false)));
        }
        for host in [Host::Usb, Host::Can, Host::Commander] {
            if r.percent(40) {
                let dies = r.between(0, end);
                let back = if r.percent(30) {
                    dies + r.between(50, 1_500) * MILLISECOND
                } else {
                    end
                };
                steps.retain(|(at, step)| step.host() != Some(host) || !(dies..back).contains(at));
            }
        }
        if r.percent(15) {
            let each = end / 5;
            for nth in 0..r.between(1, 5) {
                let begin = nth * each + r.between(0, each - 10 * MILLISECOND);
                // A longer pause costs the host its turn.
                let goes_on = begin + r.between(100, 9_000);
                steps.retain(|(at, step)| step.host() != Some(Host::Usb) || !(begin..=goes_on).contains(at));
                steps.push((begin, Step::UsbBegins(r.between(1, 10) as usize)));
                steps.push((goes_on, Step::UsbGoesOn));
            }
            // A flash write may have extended the pause.
            is_whole &= !saves;
        }
        for _ in 0..r.between(0, 3) {
            steps.push((r.between(0, end), Step::OtherArm));
        }
        if r.percent(6) {
            let restart = r.one_of(&[Request::Restart, Request::RestartIntoBootLoader]);
            let step = if r.percent(60) {
                Step::Control(restart)
            } else {
                Step::Watchdog
            };
            steps.push((r.between(0, end), step));
        }
        steps.sort_by_key(|(at, _)| *at);
        let save_takes = r.between(160, 20_000);
        Self {
            rig: Rig::new(config, behavior, save_takes, random, is_traced),
            config,
            steps,
            end: rest,
            is_whole,
            requests: [0; 2],
            begun: Vec::new(),
        }
    }

    pub(super) fn run(mut self) -> Circumstances {
        for (at, step) in std::mem::take(&mut self.steps) {
            self.rig.run_until(at);
            if !self.rig.is_over {
                self.apply(step);
            }
        }
        if !self.rig.is_over {
            self.end();
        }
        self.rig.circumstances()
    }

    /// Stops new activity and runs until all activity has ended.
    fn end(&mut self) {
        self.rig.usb_reads = true;
        self.rig.run_until(self.end);
        let without_polls = Config {
            poll: Poll::Off,
            ..self.config
        };
        self.rig.control(Request::SetConfig(without_polls));
        self.rig.oracle.polls_end();
        self.rig.settle();
        if !self.rig.is_over {
            self.rig.check_totals(self.is_whole);
        }
    }

    fn apply(&mut self, step: Step) {
        let rig = &mut self.rig;
        match step {
            Step::UsbRequests(key) => {
                let tag = next_tag(Initiator::Usb, &mut self.requests[0]);
                rig.usb_writes(&tag.frame(key));
            }
            Step::UsbMoves => rig.usb_writes(&move_to(2_048)),
            Step::UsbHolds => rig.usb_writes(&frame(TORQUE, &[1])),
            Step::UsbWrites(bytes) => rig.usb_writes(&bytes),
            Step::UsbStops(len) => {
                let tag = next_tag(Initiator::Usb, &mut self.requests[0]);
                rig.usb_writes(&tag.frame(QUERIES[0])[..len]);
            }
            Step::UsbBegins(len) => {
                let tag = next_tag(Initiator::Usb, &mut self.requests[0]);
                let mut request = tag.frame(QUERIES[0]);
                self.begun = request.split_off(len);
                rig.usb_writes(&request);
            }
            Step::UsbGoesOn => rig.usb_writes(&std::mem::take(&mut self.begun)),
            Step::SetRate(baud) => rig.set_rate(baud),
            Step::Reads(reads) => rig.usb_reads = reads,
            Step::Dtr(high) => rig.set_dtr(high),
            Step::Control(request) => rig.control(request),
            Step::OtherArm => rig.refuses_other_arm(),
            Step::CanRequests(key) => {
                let tag = next_tag(Initiator::Can, &mut self.requests[1]);
                rig.can_sends(tag.frame(key));
            }
            Step::CanMoves => rig.can_sends(move_to(1_024)),
            Step::CanHolds => rig.can_sends(frame(TORQUE, &[1])),
            Step::CanFrame(data) => rig.can_frame(data),
            Step::Command => rig.command(512),
            Step::Unasked => rig.arm_sends_unasked(),
            Step::Watchdog => rig.watchdog_bites(),
        }
    }
}

fn next_tag(initiator: Initiator, requests: &mut u32) -> Tag {
    *requests += 1;
    Tag {
        initiator,
        number: *requests,
    }
}

fn config(r: &mut Random) -> Config {
    Config {
        poll: match r.between(0, 9) {
            0..=4 => Poll::Off,
            _ => Poll::Hertz(r.between(5, 100) as u16),
        },
        can: Can {
            commands: r.percent(50),
            command_timeout_ms: r.between(20, 200) as u16,
            ..Can::default()
        },
        host_timeout: HostTimeout {
            after_ms: r.one_of(&[0, 100, 200, 300, 500]),
            torque_off: r.percent(80),
        },
        ..Config::default()
    }
}

/// Motion streams. Each lasts to the end, or is ended by its host.
fn streams(r: &mut Random, config: &Config, after: u64, end: u64, steps: &mut Vec<(u64, Step)>) {
    let streams = [
        (60, Step::UsbMoves, Some(Step::UsbHolds)),
        (40, Step::CanMoves, Some(Step::CanHolds)),
        (if config.can.commands { 60 } else { 0 }, Step::Command, None),
    ];
    for (percent, motion, hold) in streams {
        if !r.percent(percent) {
            continue;
        }
        let period = r.between(15 * MILLISECOND, after * 9 / 10);
        let begin = r.between(0, end / 2);
        steps.extend(every(begin, period, end).map(|at| (at, motion.clone())));
        if let Some(hold) = hold.filter(|_| r.percent(20)) {
            let at = r.between(begin, end);
            steps.retain(|(when, step)| *when < at || step.host() != motion.host());
            steps.push((at, hold));
        }
    }
}

/// Periodic requests of the hosts.
fn questions(r: &mut Random, end: u64, steps: &mut Vec<(u64, Step)>) {
    for asks in [Step::UsbRequests as fn(Key) -> Step, Step::CanRequests] {
        if !r.percent(60) {
            continue;
        }
        let kinds = r.between(1, QUERIES.len() as u64) as usize;
        let period = r.between(4, 120) * MILLISECOND;
        let (one, other) = (r.between(0, end), r.between(0, end));
        let at: Vec<u64> = every(one.min(other), period, one.max(other)).collect();
        steps.extend(
            at.into_iter()
                .map(|at| (at + r.between(0, period / 2), asks(r.one_of(&QUERIES[..kinds])))),
        );
    }
}

fn every(first: u64, period: u64, end: u64) -> impl Iterator<Item = u64> {
    (0..)
        .map(move |nth| first + nth * period)
        .take_while(move |at| *at < end)
}

fn move_to(ticks: u16) -> Vec<u8> {
    let place = Position::new(ticks).expect("it is in range");
    motion(&Move {
        joints: [(place, Speed::MAX); JOINTS],
        gripper: (Opening::CLOSED, GripperSpeed(1_000)),
    })
}
