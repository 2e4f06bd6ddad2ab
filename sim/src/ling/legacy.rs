//! A virtual Ling arm of the older generation: it sends cyclic frames and accepts no requests.

use std::collections::VecDeque;

use armwire::ling::legacy::{Firmware, GripperState, JointState, Legacy, MAX_FRAME, Response, SERVOS};
use armwire::ling::{JOINTS, Position, TICKS_PER_TURN};
use armwire::time::{Duration, Instant};
use armwire::{Device, DeviceEvent};

use crate::serial::SerialDevice;

/// Firmware and period of a virtual arm of the older generation.
///
/// ```
/// use armwire::time::Duration;
/// use armwire::ling::legacy::Firmware;
/// use armwire_sim::ling::legacy::Config;
///
/// let config = Config { firmware: Firmware::V5, ..Config::default() };
/// assert_eq!(config.period, Duration::from_millis(25));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// Firmware, which determines the command bytes of the frames.
    pub firmware: Firmware,
    /// Time from one joint frame to the next, at least 1 µs. A gripper frame follows each immediately.
    pub period: Duration,
}

impl Default for Config {
    /// Returns firmware 6.0 at 40 Hz, the only rate in the vendor's examples.
    fn default() -> Self {
        Self {
            firmware: Firmware::V6_0,
            period: Duration::from_millis(25),
        }
    }
}

/// Counters of an arm of the older generation, since its creation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Counters {
    /// Bytes received. A host should send none.
    pub bytes: u64,
    /// Valid frames among them, all ignored.
    pub frames: u64,
    /// Joint frames whose transmission has begun.
    pub sent: u64,
}

/// A virtual arm of the older generation. It is switched on at time zero and sends its first frame one period later.
///
/// The joints stay at their set position. A reading is skipped when the line is busy at the end of a period.
///
/// ```
/// use armwire::time::Instant;
/// use armwire_sim::ling::legacy::{Config, LegacyArm};
/// use armwire_sim::serial::SerialDevice;
///
/// let mut arm = LegacyArm::new(Config::default());
/// assert_eq!(arm.transmit(Instant::from_micros(24_999)), None);
/// let sent: Vec<u8> = std::iter::from_fn(|| arm.transmit(Instant::from_micros(25_000))).collect();
/// assert_eq!(sent[..3], [0xAA, 0x14, 0x12]);
/// assert_eq!(sent[23..26], [0xAA, 0x12, 0x07]);
/// ```
#[derive(Debug)]
pub struct LegacyArm {
    config: Config,
    joints: JointState,
    gripper: GripperState,
    device: Device<Legacy, MAX_FRAME>,
    line: VecDeque<u8>,
    /// Time of the next joint frame.
    due: Instant,
    counters: Counters,
}

impl LegacyArm {
    /// Creates an arm at its zero position.
    pub fn new(config: Config) -> Self {
        let firmware = config.firmware;
        Self {
            config,
            joints: JointState {
                firmware,
                servos: [Position::CENTRE.ticks(); SERVOS],
            },
            gripper: GripperState {
                firmware,
                id: 1,
                servo: 2048,
                potentiometer: 2048,
                sync_button: 0,
                attitude_button: 0,
            },
            device: Device::new(Legacy),
            line: VecDeque::new(),
            due: Instant::ZERO + config.period,
            counters: Counters::default(),
        }
    }

    /// Sets the joint positions. If a joint has two servos, the second follows the first: directly in joint 1,
    /// mirrored in joints 2 and 3.
    pub fn set_joints(&mut self, joints: [Position; JOINTS]) {
        let mirrored = |ticks: u16| (TICKS_PER_TURN - ticks).min(Position::MAX.ticks());
        let [j1, j2, j3, j4, j5, j6] = joints.map(Position::ticks);
        self.joints.servos = [j1, j1, j2, mirrored(j2), j3, mirrored(j3), j4, j5, j6];
    }

    /// Returns the counters.
    pub fn counters(&self) -> Counters {
        self.counters
    }

    fn send(&mut self, response: &Response) {
        let mut out = [0; MAX_FRAME];
        // Every response fits.
        let n = self.device.respond(response, None, &mut out).unwrap_or(0);
        self.line.extend(&out[..n]);
    }
}

impl SerialDevice for LegacyArm {
    fn receive(&mut self, _now: Instant, byte: u8) {
        self.counters.bytes += 1;
        // All earlier frames have been taken out: there is room.
        let _ = self.device.receive(&[byte]);
        while let Some(event) = self.device.poll() {
            match event {
                DeviceEvent::Request { request, .. } => match request {},
                DeviceEvent::Unknown { .. } => self.counters.frames += 1,
                DeviceEvent::Noise { .. } | DeviceEvent::Broken { .. } => {}
            }
        }
    }

    fn transmit(&mut self, now: Instant) -> Option<u8> {
        if self.due <= now {
            if self.line.is_empty() {
                self.counters.sent += 1;
                self.send(&Response::Joints(self.joints));
                self.send(&Response::Gripper(self.gripper));
            }
            let period = self.config.period.as_micros().max(1);
            self.due = Instant::from_micros((now.as_micros() / period + 1) * period);
        }
        self.line.pop_front()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        Some(if self.line.is_empty() { self.due } else { Instant::ZERO })
    }
}

#[cfg(test)]
mod tests {
    use std::num::NonZeroU32;

    use armwire::ling::legacy::{Detector, OlderGeneration};
    use armwire::messages::Messages;

    use super::*;
    use crate::faults::{Line, Rates};
    use crate::wire::{LineEvent, Wire};

    fn host<D: SerialDevice>(baud: u32, arm: D) -> Wire<Legacy, D, MAX_FRAME> {
        let config = armwire::Config {
            baud: NonZeroU32::new(baud),
            ..armwire::Config::default()
        };
        Wire::new(config, arm)
    }

    fn positions() -> [Position; JOINTS] {
        [0, 1, 2048, 4095, 1000, 3000].map(|ticks| Position::new(ticks).unwrap())
    }

    #[test]
    fn legacy_arm_reports_joints_at_its_rate() {
        for firmware in [Firmware::V5, Firmware::V6_0] {
            let config = Config {
                firmware,
                ..Config::default()
            };
            let mut arm = LegacyArm::new(config);
            arm.set_joints(positions());
            let mut host = host(921_600, arm);
            host.wait(Duration::from_millis(1_010));

            let (mut joints, mut grippers) = (0, 0);
            for event in host.take_events() {
                let LineEvent::Unsolicited(frame) = event else {
                    panic!("{event:?}")
                };
                match Legacy.parse_response(&frame, ()) {
                    Ok(Response::Joints(state)) => {
                        assert_eq!((state.firmware, state.positions()), (firmware, Ok(positions())));
                        joints += 1;
                    }
                    Ok(Response::Gripper(state)) => {
                        assert_eq!((state.firmware, state.id), (firmware, 1));
                        grippers += 1;
                    }
                    other => panic!("{other:?}"),
                }
            }
            assert_eq!((joints, grippers), (40, 40));
            assert_eq!(host.device().counters().bytes, 0, "nothing was sent to it");
        }
    }

    #[test]
    fn received_bytes_are_counted_and_ignored() {
        let mut arm = LegacyArm::new(Config::default());
        for byte in [0x11, 0xAA, 0x13, 0x01, 0x00, 0x00, 0xFF] {
            arm.receive(Instant::ZERO, byte);
        }
        assert_eq!((arm.counters().bytes, arm.counters().frames), (7, 1));
        assert_eq!(arm.poll_timeout(), Some(Instant::from_millis(25)));
    }

    #[test]
    fn slow_line_skips_readings_and_keeps_frames_whole() {
        let mut host = host(9_600, LegacyArm::new(Config::default()));
        host.wait(Duration::from_millis(10_000));
        let events = host.take_events();
        assert!(events.iter().all(|event| matches!(event, LineEvent::Unsolicited(_))));
        assert!((200..270).contains(&host.device().counters().sent));
    }

    #[test]
    fn recognition_takes_one_period_even_with_noise() {
        let mut arm = LegacyArm::new(Config::default());
        let mut detector = Detector::new();
        let mut recognised = None;
        for micros in (0..1_000_000).step_by(10).map(Instant::from_micros) {
            if let Some(byte) = arm.transmit(micros)
                && detector.push(&[byte]).is_some()
            {
                recognised.get_or_insert(micros);
            }
        }
        assert!(recognised.unwrap() <= Instant::from_millis(26), "{recognised:?}");

        let faults = Rates {
            max_delay: Duration::from_micros(100),
            ..Rates::each(3_000)
        };
        let mut line = Line::new(LegacyArm::new(Config::default()), Rates::NONE, faults, 1);
        let mut detector = Detector::new();
        let recognised = (0..1_000_000).step_by(10).find_map(|micros| {
            let byte = line.transmit(Instant::from_micros(micros))?;
            detector.push(&[byte])
        });
        assert_eq!(recognised, Some(OlderGeneration));
        assert!(line.injected_from_device().dropped + line.injected_from_device().corrupted > 0);
    }
}
