//! Virtual arms on lines with faults, and the time.

use std::f64::consts::TAU;

use armwire::decoder::{Decoder, Kind};
use armwire::ling::stop::{Output, Stopped};
use armwire::ling::{JOINTS, JointState, Ling, MAX_FRAME, Position, Request, Response, Stop};
use armwire::messages::Messages;
use armwire::time::{Duration, Instant};
use armwire_sim::faults::{Line, Rates};
use armwire_sim::ling::{Config, LingArm};
use armwire_sim::serial::SerialDevice;

/// The time between two looks at a line.
pub(crate) const STEP: Duration = Duration::from_millis(1);
/// The time of a byte at 1 Mbaud.
const BYTE: Duration = Duration::from_micros(10);

/// Two of a hundred readings are lost, by missing, damaged and additional bytes.
pub(crate) const NOISY: Rates = Rates {
    drop: 200,
    corrupt: 200,
    noise: 400,
    ..Rates::NONE
};

/// An arm on a line.
pub(crate) struct Arm {
    line: Line<LingArm>,
    decoder: Decoder<Ling, MAX_FRAME>,
}

impl Arm {
    pub(crate) fn new(config: Config, rates: Rates, seed: u64) -> Self {
        Self {
            line: Line::new(LingArm::new(config), rates, rates, seed),
            decoder: Decoder::new(),
        }
    }

    /// The arm itself.
    pub(crate) fn body(&mut self) -> &mut LingArm {
        self.line.device_mut()
    }

    /// The arm at this time.
    pub(crate) fn at(&mut self, now: Instant) -> &mut LingArm {
        let arm = self.line.device_mut();
        arm.advance(now);
        arm
    }

    /// Sends a request, which begins at `now`.
    pub(crate) fn send(&mut self, now: Instant, request: &Request) {
        let mut out = [0; MAX_FRAME];
        let n = Ling.encode_request(request, &mut out).unwrap();
        for (at, &byte) in out[..n].iter().enumerate() {
            self.line
                .receive(now + Duration::from_micros(BYTE.as_micros() * at as u64), byte);
        }
    }

    /// The readings that have arrived.
    pub(crate) fn readings(&mut self, now: Instant) -> Vec<JointState> {
        let mut readings = Vec::new();
        while let Some(byte) = self.line.transmit(now) {
            assert!(self.decoder.push(&[byte]).is_empty());
            while let Some(item) = self.decoder.next(&Ling, ()) {
                if item.kind == Kind::Frame
                    && let Ok(Response::Joints(state)) = Ling.parse_response(item.bytes, ())
                {
                    readings.push(state);
                }
            }
        }
        readings
    }

    /// Stops the arm, as a host does. Returns the time of the end.
    pub(crate) fn stop(&mut self, mut now: Instant) -> Instant {
        let mut stop = Stop::new(None);
        loop {
            match stop.poll(now) {
                Output::Request(request) => self.send(now, &request),
                Output::Wait(_) => {}
                Output::Done(stopped) => {
                    assert!(matches!(stopped, Ok(Stopped::AtRest { .. })), "{stopped:?}");
                    return now;
                }
            }
            now += STEP;
            for reading in self.readings(now) {
                stop.on_joints(now, &reading);
            }
        }
    }
}

/// The joints of a hand's motion, in ticks: 40° to both sides, at up to 75°/s.
pub(crate) fn by_hand(at: Duration) -> [f64; JOINTS] {
    let seconds = at.as_micros() as f64 / 1e6;
    std::array::from_fn(|joint| {
        let hertz = 0.1 + 0.04 * joint as f64;
        2_048.0 + 455.0 * (TAU * hertz * seconds).sin()
    })
}

/// Moves an arm without torque to these joints.
pub(crate) fn push(arm: &mut LingArm, joints: [f64; JOINTS]) {
    for (joint, ticks) in joints.into_iter().enumerate() {
        let position = Position::new(ticks.round() as u16).unwrap();
        assert!(arm.push_joint(joint, position), "it has torque");
    }
}

/// A line that holds its readings back at times.
#[derive(Default)]
pub(crate) struct Stalls {
    count: usize,
    /// The begin and the end of the next stall.
    next: Option<(Instant, Instant)>,
    held: Vec<(Instant, JointState)>,
}

impl Stalls {
    const BETWEEN_MS: [u64; 5] = [700, 1_900, 3_100, 1_100, 2_300];
    const LONG_MS: [u64; 6] = [50, 400, 1_500, 100, 800, 200];

    /// Stalls of which the first is this one.
    pub(crate) fn from(count: usize) -> Self {
        Self {
            count,
            ..Self::default()
        }
    }

    /// The readings that arrive, with their times, of those that were made until now.
    pub(crate) fn pass(&mut self, now: Instant, readings: Vec<JointState>) -> Vec<(Instant, JointState)> {
        self.held.extend(readings.into_iter().map(|reading| (now, reading)));
        let (begin, end) = *self.next.get_or_insert_with(|| {
            let begin = now + Duration::from_millis(Self::BETWEEN_MS[self.count % Self::BETWEEN_MS.len()]);
            let end = begin + Duration::from_millis(Self::LONG_MS[self.count % Self::LONG_MS.len()]);
            (begin, end)
        });
        if (begin..end).contains(&now) {
            return Vec::new();
        }
        if now >= end {
            self.count += 1;
            self.next = None;
        }
        std::mem::take(&mut self.held)
    }
}
