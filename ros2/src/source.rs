//! Where an arm's readings come from: the polls of its adapter, or its own stream. No wait is longer than a step.

use armwire::ling::{JointState, Ling, Response};
use armwire::messages::Messages;
use armwire::time::{Duration, Instant};
use armwire_bridge::control::Event;
use armwire_host::stamps::{Clock, HostTime};
use armwire_host::{Adapter, Error, Stream, StreamReading};

/// Maximum wait for a reading before setpoints and requests have their turn.
const STEP: Duration = Duration::from_millis(5);

/// The input within a step.
pub(crate) enum Input {
    /// A reading.
    Reading {
        /// Its system time, in nanoseconds since 1970.
        at: i64,
        /// Its age at its receipt, on the monotonic clock.
        age: Duration,
        state: JointState,
    },
    /// An event of the adapter that is no frame.
    Event(Event),
}

impl Input {
    /// A reading that was received at this time.
    pub(crate) fn reading(reading: StreamReading, received: HostTime) -> Self {
        let StreamReading { state, time } = reading;
        let age = received.monotonic_ns - time.monotonic_ns;
        Self::Reading {
            at: time.unix_ns,
            age: Duration::from_micros(u64::try_from(age / 1_000).unwrap_or(0)),
            state,
        }
    }
}

/// The source of an arm's readings.
pub(crate) enum Source {
    /// An adapter that polls the arm.
    Adapter(Adapter, Clock),
    /// The arm itself.
    Arm(Requests),
}

/// An arm whose readings are requested without waiting for their answers.
pub(crate) trait Port {
    /// Requests a reading of the joints.
    fn request_joints(&mut self) -> Result<(), Error>;

    /// The readings that have arrived, after a wait of at most this long for the first byte.
    fn receive(&mut self, wait: Duration) -> Result<Vec<StreamReading>, Error>;
}

/// Requests at a rate.
pub(crate) struct Requests {
    /// The time of the next one.
    due: Instant,
    period: Duration,
}

impl Source {
    /// The input, after a wait of at most a step.
    ///
    /// # Errors
    ///
    /// The line or the control port fails. A lost answer is no error.
    pub(crate) fn receive(&mut self, now: Instant, stream: &mut Stream) -> Result<Vec<Input>, Error> {
        match self {
            Self::Adapter(adapter, clock) => {
                let Some((stamp, event)) = adapter.next_event(STEP.into())? else {
                    return Ok(Vec::new());
                };
                let Event::Frame { bytes, .. } = event else {
                    return Ok(vec![Input::Event(event)]);
                };
                let Ok(Response::Joints(state)) = Ling.parse_response(&bytes, ()) else {
                    return Ok(Vec::new());
                };
                let received = HostTime::now();
                let time = clock.host_time(stamp, received);
                let reading = StreamReading { state, time };
                stream.on_joints(reading);
                Ok(vec![Input::reading(reading, received)])
            }
            Self::Arm(requests) => {
                let readings = requests.receive(now, stream)?;
                let received = HostTime::now();
                let reading = |reading| Input::reading(reading, received);
                Ok(readings.into_iter().map(reading).collect())
            }
        }
    }

    /// The adapter; `None` without one.
    pub(crate) fn adapter(&mut self) -> Option<&mut Adapter> {
        match self {
            Self::Adapter(adapter, _) => Some(adapter),
            Self::Arm(_) => None,
        }
    }
}

impl Requests {
    /// A request per period, from now on.
    pub(crate) fn new(now: Instant, period: Duration) -> Self {
        Self { due: now, period }
    }

    /// The readings, after a wait until the next request, and of at most a step.
    fn receive(&mut self, now: Instant, port: &mut impl Port) -> Result<Vec<StreamReading>, Error> {
        if now >= self.due {
            port.request_joints()?;
            self.due = (self.due + self.period).max(now);
        }
        port.receive(self.due.since(now).min(STEP))
    }
}

impl Port for Stream {
    fn request_joints(&mut self) -> Result<(), Error> {
        self.request_joints()
    }

    fn receive(&mut self, wait: Duration) -> Result<Vec<StreamReading>, Error> {
        self.receive(wait.into())
    }
}

#[cfg(test)]
mod tests {
    use armwire::decoder::{Decoder, Kind};
    use armwire::ling::{JOINTS, MAX_FRAME, Request, Stroke};
    use armwire_host::joints_file::{Joints, NAMES};
    use armwire_sim::faults::{Line, Rates};
    use armwire_sim::ling::{Config, LingArm};
    use armwire_sim::serial::SerialDevice;

    use super::*;
    use crate::joint_states::{Reading, Units};
    use crate::messages::{JointTrajectory, JointTrajectoryPoint, Time};
    use crate::motion::{Motion, Order, Origin, Output};

    /// The time of a byte at 1 Mbaud.
    const BYTE: Duration = Duration::from_micros(10);
    const PERIOD: Duration = Duration::from_millis(10);

    /// A virtual arm on a line that loses one in a thousand of its bytes, 2 % of the answers. A wait makes its time pass.
    struct Virtual {
        line: Line<LingArm>,
        decoder: Decoder<Ling, MAX_FRAME>,
        now: Instant,
        requests: usize,
        readings: usize,
    }

    impl Virtual {
        fn new() -> Self {
            let lossy = Rates {
                drop: 1_000,
                ..Rates::NONE
            };
            Self {
                line: Line::new(LingArm::new(Config::follower()), Rates::NONE, lossy, 5),
                decoder: Decoder::new(),
                now: Instant::ZERO,
                requests: 0,
                readings: 0,
            }
        }

        fn send(&mut self, request: &Request) {
            let mut out = [0; MAX_FRAME];
            let n = Ling.encode_request(request, &mut out).unwrap();
            for &byte in &out[..n] {
                self.line.receive(self.now, byte);
                self.now += BYTE;
            }
        }
    }

    impl Port for Virtual {
        fn request_joints(&mut self) -> Result<(), Error> {
            self.requests += 1;
            self.send(&Request::ReadJoints);
            Ok(())
        }

        fn receive(&mut self, wait: Duration) -> Result<Vec<StreamReading>, Error> {
            let until = self.now + wait;
            let mut readings = Vec::new();
            loop {
                let mut is_received = false;
                while let Some(byte) = self.line.transmit(self.now) {
                    is_received = true;
                    assert!(self.decoder.push(&[byte]).is_empty());
                    while let Some(item) = self.decoder.next(&Ling, ()) {
                        if item.kind == Kind::Frame
                            && let Ok(Response::Joints(state)) = Ling.parse_response(item.bytes, ())
                        {
                            let time = HostTime::now();
                            readings.push(StreamReading { state, time });
                        }
                    }
                }
                if is_received || self.now >= until {
                    self.readings += readings.len();
                    return Ok(readings);
                }
                self.now += BYTE;
            }
        }
    }

    /// A trajectory of a minute.
    fn order() -> Order {
        Order {
            origin: Origin::Topic,
            trajectory: JointTrajectory {
                joint_names: NAMES[..JOINTS].iter().map(|&name| name.to_owned()).collect(),
                points: vec![JointTrajectoryPoint {
                    positions: vec![1.0; JOINTS],
                    time_from_start: Time { sec: 60, nanosec: 0 },
                    ..Default::default()
                }],
                ..Default::default()
            },
            tolerances: None,
        }
    }

    #[test]
    fn lost_answers_do_not_hold_setpoints_up() {
        let mut port = Virtual::new();
        let mut requests = Requests::new(port.now, PERIOD);
        let at_rest = JointState {
            joints: [2_048; JOINTS],
            gripper: 0,
            status: armwire::ling::MotionStatus::Locked,
        };
        let joints = Joints::default().with_stroke(Stroke::Mm50).all;
        let units = Units::new(&joints, Stroke::Mm50);
        let reading = |state: &JointState| Reading::new(0, state, units).unwrap();
        let silence = Duration::from_millis(250);
        let mut motion = Motion::new(joints, JOINTS, units, silence, port.now, reading(&at_rest));
        motion.accept(port.now, 0, order()).unwrap();
        let (mut worst, mut sent, mut moves) = (Duration::ZERO, port.now, 0);
        while port.now < Instant::from_millis(59_000) {
            for received in requests.receive(port.now, &mut port).unwrap() {
                motion.on_reading(port.now, &reading(&received.state));
            }
            while let Some(output) = motion.poll(port.now) {
                if let Output::Move(next) = output {
                    worst = worst.max(port.now.since(sent));
                    (sent, moves) = (port.now, moves + 1);
                    port.send(&Request::Move(next));
                }
            }
        }
        assert!(worst.as_micros() < 3 * PERIOD.as_micros(), "{worst:?}");
        let lost = port.requests - port.readings;
        assert!(
            (port.requests / 100..port.requests / 25).contains(&lost),
            "{lost} of {}",
            port.requests
        );
        assert!(moves > 5_000, "{moves}");
        let joint = port.line.device_mut().joints()[0];
        assert!((2_048 + 600..2_048 + 652).contains(&joint), "{joint}");
    }
}
