//! Late and missing answers: an answer belongs to the call that returns it.

use std::collections::VecDeque;

use armwire::ling::*;
use armwire::{Config, Device, DeviceEvent};
use armwire_bridge::{Duration, Instant};
use armwire_sim::serial::SerialDevice;
use armwire_sim::wire::Wire;
use proptest::collection::vec;
use proptest::prelude::*;

/// An arm with given delays, or without an answer. Every answer identifies its request.
struct Dawdler {
    device: Device<Ling, MAX_FRAME>,
    /// Delays of the next answers, in turn; `None` for no answer.
    delays: VecDeque<Option<Duration>>,
    received: u16,
    replies: VecDeque<(Instant, u8)>,
}

impl SerialDevice for Dawdler {
    fn receive(&mut self, now: Instant, byte: u8) {
        assert!(self.device.receive(&[byte]).is_empty());
        if let Some(DeviceEvent::Request { request, .. }) = self.device.poll() {
            let response = match request {
                Request::ReadJoints => {
                    self.received += 1;
                    Response::Joints(JointState {
                        joints: [self.received; JOINTS],
                        gripper: 0,
                        status: MotionStatus::Idle,
                    })
                }
                Request::ReadStroke => Response::Stroke(Stroke::Mm50),
                Request::ReadTemperatures => Response::Temperatures(PerServo::Leader([30; JOINTS])),
                Request::ReadVelocities => Response::Velocities(PerServo::Leader([0; JOINTS])),
                other => panic!("{other}"),
            };
            let mut out = [0; MAX_FRAME];
            let n = self.device.respond(&response, None, &mut out).unwrap();
            if let Some(delay) = self.delays.pop_front().unwrap_or(Some(Duration::from_micros(200))) {
                // On the line an answer cannot overtake the one before it.
                let after = self.replies.back().map_or(Instant::ZERO, |&(due, _)| due);
                let due = after.max(now + delay);
                self.replies.extend(out[..n].iter().map(|&byte| (due, byte)));
            }
        }
    }

    fn transmit(&mut self, now: Instant) -> Option<u8> {
        let (_, byte) = self.replies.pop_front_if(|(due, _)| *due <= now)?;
        Some(byte)
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.replies.front().map(|&(due, _)| due)
    }
}

proptest! {
    #[test]
    fn answer_belongs_to_the_call_returning_it(
        delays in vec(prop_oneof![
            3 => Just(Some(Duration::from_micros(200))),
            3 => (0..1_500_000_u64).prop_map(|delay| Some(Duration::from_micros(delay))),
            1 => Just(None),
        ], 0..60),
        calls in 1..30_usize,
    ) {
        let device = Dawdler { device: Device::new(Ling), delays: delays.into(), received: 0, replies: VecDeque::new() };
        let mut wire = Wire::<Ling, _, MAX_FRAME>::new(Config::DEFAULT, device);
        for _ in 0..calls {
            let before = wire.device().received;
            match wire.call(Request::ReadJoints) {
                Ok(Some(Response::Joints(state))) => {
                    prop_assert!(state.joints[0] > before, "an answer to request {} of {before}", state.joints[0]);
                }
                // It is not sent while the answer to an earlier one may come.
                Err(silence) => prop_assert!([0, Config::DEFAULT.repeats + 1].contains(&silence.sends)),
                other => prop_assert!(false, "{other:?}"),
            }
        }
    }
}
