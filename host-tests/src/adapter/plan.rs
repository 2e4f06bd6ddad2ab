//! The actions of all participants in a run, with their times.

use armwire::ling::{GripperSpeed, JOINTS, Move, Opening, Position, Speed};
use armwire_bridge::config::{Can, Config, HostTimeout, Poll};
use armwire_bridge::control::{Initiator, Request};

use super::Conditions;
use super::arm::{Behavior, Key, QUERIES, SELF_CHECK, TORQUE, Tag, frame};
use super::rig::{Rig, motion};
use crate::random::Random;

const MILLISECOND: u64 = 1_000;

/// The speed of a command, and one that is out of range.
const SPEED: u8 = 10;
const NO_SPEED: u8 = 0;

/// Period of the unsolicited frames, in µs.
const UNSOLICITED_PERIOD: u64 = 40 * MILLISECOND;

/// An action of a run.
#[derive(Clone, Debug)]
enum Step {
    /// The host on USB.
    UsbRequests(Key),
    UsbWrites(Vec<u8>),
    /// The first bytes of a request, and the rest of it.
    UsbBegins(usize),
    UsbGoesOn,
    SetRate(u32),
    Reads(bool),
    Dtr(bool),
    Control(Request),
    /// Hosts on CAN.
    CanRequests(Key),
    CanSends(Vec<u8>),
    CanFrame(&'static [u8]),
    /// A cyclic command with this speed, in range or not.
    Command(u8),
    /// The arm.
    Unsolicited,
    /// Another host configures another arm, if a stream is armed.
    OtherArm,
    /// Another host configures the bus of an adapter without CAN.
    Bus,
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
            Self::UsbRequests(_) | Self::UsbWrites(_) | Self::UsbBegins(_) | Self::UsbGoesOn => Some(Host::Usb),
            Self::CanRequests(_) | Self::CanSends(_) => Some(Host::Can),
            Self::Command(_) => Some(Host::Commander),
            _ => None,
        }
    }

    /// Returns true if it needs the bus.
    fn is_on_can(&self) -> bool {
        matches!(
            self,
            Self::CanRequests(_) | Self::CanSends(_) | Self::CanFrame(_) | Self::Command(_)
        )
    }
}

/// A run before its start.
pub(super) struct Plan {
    rig: Rig,
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
        // A host that streams motion to the end, although much of it is refused.
        let live = match r.between(0, 99) {
            0..15 => Some(Host::Can),
            15..27 => Some(Host::Commander),
            _ => None,
        };
        let config = config(r, live);
        let saves = r.percent(20);
        let slowest = r.one_of(&[300, 300, 2_000, 45_000, 100_000, 100_000]);
        let behavior = Behavior {
            // Bytes that arrive during a flash write are received later.
            slowest: if saves { slowest.min(70_000) } else { slowest },
            lost: r.one_of(&[0, 0, 0, 2, 20, 100]),
            self_check: match live {
                Some(Host::Can) => r.one_of(&[None, Some(450_000)]),
                _ => r.percent(20).then_some(slowest.min(70_000)),
            },
        };
        let after = u64::from(config.host_timeout.after_ms).max(50) * MILLISECOND;
        let end = r.between(600, 2_000) * MILLISECOND;
        let mut steps = Vec::new();
        let mut is_whole = true;

        streams(r, &config, after, end, &mut steps);
        match live {
            Some(Host::Can) => delayed(r, after, end, &mut steps),
            Some(Host::Commander) => without_speed(r, &config, after, end, &mut steps),
            _ => {}
        }
        requests(r, end, &mut steps);
        if r.percent(32) {
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
                let request = r.one_of(&[Step::UsbRequests as fn(Key) -> Step, Step::CanRequests]);
                steps.push((at, request(SELF_CHECK)));
            }
        }
        if r.percent(15) {
            is_whole = false;
            for _ in 0..r.between(1, 3) {
                steps.push((r.between(0, end), Step::UsbBegins(r.between(1, 10) as usize)));
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
            let [reserve, release] = [Request::ReserveLine, Request::ReleaseLine].map(Step::Control);
            steps.extend(interval(r, end, 500, reserve, release));
        }
        if saves {
            for _ in 0..r.between(1, 3) {
                steps.push((r.between(0, end), Step::Control(Request::SaveConfig)));
            }
        }
        let rest = end + after + 800 * MILLISECOND;
        if r.percent(20) {
            let first = r.between(0, UNSOLICITED_PERIOD);
            steps.extend(every(first, UNSOLICITED_PERIOD, rest).map(|at| (at, Step::Unsolicited)));
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
        if r.percent(15) {
            for _ in 0..r.between(1, 3) {
                steps.push((r.between(0, end), Step::Control(Request::Stop)));
            }
        }
        if r.percent(8) {
            steps.extend(interval(r, end, 300, Step::Reads(false), Step::Reads(true)));
        }
        if r.percent(8) {
            steps.extend(interval(r, end, 300, Step::Dtr(true), Step::Dtr(false)));
        }
        for host in [Host::Usb, Host::Can, Host::Commander] {
            if r.percent(40) && live != Some(host) {
                let stops = r.between(0, end);
                let back = if r.percent(30) {
                    stops + r.between(50, 1_500) * MILLISECOND
                } else {
                    end
                };
                steps.retain(|(at, step)| step.host() != Some(host) || !(stops..back).contains(at));
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
        let has_can = !r.percent(12);
        if !has_can {
            steps.retain(|(_, step)| !step.is_on_can());
            steps.push((r.between(0, end), Step::Bus));
        }
        steps.sort_by_key(|(at, _)| *at);
        let save_duration = r.between(160, 20_000);
        Self {
            rig: Rig::new(config, has_can, behavior, save_duration, random, is_traced),
            steps,
            end: rest,
            is_whole,
            requests: [0; 2],
            begun: Vec::new(),
        }
    }

    pub(super) fn run(mut self) -> Conditions {
        for (at, step) in std::mem::take(&mut self.steps) {
            self.rig.run_until(at);
            if !self.rig.is_over {
                self.apply(step);
            }
        }
        if !self.rig.is_over {
            self.end();
        }
        self.rig.conditions()
    }

    /// Stops new activity and runs until all activity has ended.
    fn end(&mut self) {
        self.rig.is_usb_reading = true;
        self.rig.run_until(self.end);
        let without_polls = Config {
            poll: Poll::Off,
            ..self.rig.config
        };
        self.rig.control(Request::SetConfig(without_polls));
        self.rig.oracle.on_polls_off();
        self.rig.settle();
        if !self.rig.is_over {
            self.rig.check_totals(self.is_whole);
        }
    }

    fn apply(&mut self, step: Step) {
        let rig = &mut self.rig;
        match step {
            Step::UsbRequests(key) => {
                let tag = Tag::next(Initiator::Usb, &mut self.requests[0]);
                rig.usb_writes(&tag.frame(key));
            }
            Step::UsbWrites(bytes) => rig.usb_writes(&bytes),
            Step::UsbBegins(len) => {
                let tag = Tag::next(Initiator::Usb, &mut self.requests[0]);
                let mut request = tag.frame(QUERIES[0]);
                self.begun = request.split_off(len);
                rig.usb_writes(&request);
            }
            Step::UsbGoesOn => rig.usb_writes(&std::mem::take(&mut self.begun)),
            Step::SetRate(baud) => rig.set_rate(baud),
            Step::Reads(reads) => rig.is_usb_reading = reads,
            Step::Dtr(high) => rig.set_dtr(high),
            Step::Control(request) => rig.control(request),
            Step::OtherArm => rig.configure_other_arm(),
            Step::Bus => rig.configure_bus(),
            Step::CanRequests(key) => {
                let tag = Tag::next(Initiator::Can, &mut self.requests[1]);
                rig.can_sends(tag.frame(key));
            }
            Step::CanSends(pdu) => rig.can_sends(pdu),
            Step::CanFrame(data) => rig.can_frame(data),
            Step::Command(speed) => rig.command(512, speed),
            Step::Unsolicited => rig.arm_sends_unsolicited(),
            Step::Watchdog => rig.watchdog_resets(),
        }
    }
}

fn config(r: &mut Random, live: Option<Host>) -> Config {
    Config {
        poll: match r.between(0, 9) {
            0..=4 => Poll::Off,
            _ => Poll::Hertz(r.between(5, 100) as u16),
        },
        can: Can {
            commands: r.percent(50) || live == Some(Host::Commander),
            command_timeout_ms: r.between(20, 200) as u16,
            ..Can::default()
        },
        host_timeout: HostTimeout {
            after_ms: match live {
                Some(_) => r.one_of(&[100, 200, 300, 500]),
                None => r.one_of(&[0, 100, 200, 300, 500]),
            },
            torque_off: r.percent(80),
        },
        ..Config::default()
    }
}

/// Motion streams. Each lasts to the end, or is ended by its host.
fn streams(r: &mut Random, config: &Config, after: u64, end: u64, steps: &mut Vec<(u64, Step)>) {
    let hold = frame(TORQUE, &[1]);
    let streams = [
        (60, Step::UsbWrites(move_to(2_048)), Some(Step::UsbWrites(hold.clone()))),
        (40, Step::CanSends(move_to(1_024)), Some(Step::CanSends(hold))),
        (if config.can.commands { 60 } else { 0 }, Step::Command(SPEED), None),
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

/// A motion stream on CAN, at up to 1 kHz, beside self-checks of the host on USB.
fn delayed(r: &mut Random, after: u64, end: u64, steps: &mut Vec<(u64, Step)>) {
    steps.retain(|(_, step)| !matches!(step, Step::CanSends(_)));
    let period = r.one_of(&[1, 5, 20, 20, 50, 50, 90]) * MILLISECOND;
    let begin = r.between(0, end / 4);
    steps.extend(every(begin, period.min(after * 9 / 10), end).map(|at| (at, Step::CanSends(move_to(1_024)))));
    let first = begin + r.between(period, 300 * MILLISECOND);
    let checks = every(first, r.between(400, 1_000) * MILLISECOND, end);
    steps.extend(checks.map(|at| (at, Step::UsbRequests(SELF_CHECK))));
}

/// A stream of commands, of which many have no speed.
fn without_speed(r: &mut Random, config: &Config, after: u64, end: u64, steps: &mut Vec<(u64, Step)>) {
    steps.retain(|(_, step)| !matches!(step, Step::Command(_)));
    let timeout = u64::from(config.can.command_timeout_ms) * MILLISECOND;
    let period = r.between(10 * MILLISECOND, after.min(timeout) * 9 / 10);
    let begin = r.between(0, end / 4);
    let slow = begin + r.between(0, end / 2);
    let slow = slow..slow + r.between(after, 3 * after);
    steps.extend(every(begin, period, end).map(|at| {
        let speed = if slow.contains(&at) { NO_SPEED } else { SPEED };
        (at, Step::Command(speed))
    }));
}

/// Periodic requests of the hosts.
fn requests(r: &mut Random, end: u64, steps: &mut Vec<(u64, Step)>) {
    for request in [Step::UsbRequests as fn(Key) -> Step, Step::CanRequests] {
        if !r.percent(60) {
            continue;
        }
        let kinds = r.between(1, QUERIES.len() as u64) as usize;
        let period = r.between(4, 120) * MILLISECOND;
        let (one, other) = (r.between(0, end), r.between(0, end));
        let at: Vec<u64> = every(one.min(other), period, one.max(other)).collect();
        steps.extend(
            at.into_iter()
                .map(|at| (at + r.between(0, period / 2), request(r.one_of(&QUERIES[..kinds])))),
        );
    }
}

/// The first step before `end`, and the second at most this number of milliseconds later.
fn interval(r: &mut Random, end: u64, longest: u64, first: Step, second: Step) -> [(u64, Step); 2] {
    let begin = r.between(0, end);
    let ends = begin + r.between(1, longest) * MILLISECOND;
    [(begin, first), (ends, second)]
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
