//! Parking: slowly to a pose in which an arm lies, and there, at rest, torque-off.

use std::thread;
use std::time::Duration;

use armwire::ling::arrival::Tolerances;
use armwire::ling::effect::{Effect, Outcome};
use armwire::ling::{GripperSpeed, JOINTS, JointState, Move, Opening, Position, Rest, Speed, Torque};

use super::Ling;
use super::wait::{POLL_PERIOD, Switching, Wait, until};
use crate::arm::park_poses::ParkPoses;
use crate::error::Error;
use crate::motion::goal::APPROACH_SPEED;
use crate::time::stopwatch::Stopwatch;

/// The time in which an arm whose pose is saved must come to rest.
const SAVE_LIMIT: Duration = Duration::from_secs(5);

/// The parking of an arm, one reading at a time: [`Ling::park`] in steps.
#[derive(Debug)]
pub struct Parking {
    phase: Phase,
    /// The number of stops before it: another one ends it.
    stops: usize,
}

#[derive(Debug)]
enum Phase {
    /// To the pose, by this move.
    Way(Move, Wait),
    /// At rest there.
    TorqueOff(Switching),
}

impl Parking {
    /// Starts the parking of this arm, as [`Ling::park`].
    ///
    /// # Errors
    ///
    /// As of [`Ling::move_to`].
    pub fn new(arm: &mut Ling, pose: [Position; JOINTS], within: u16, limit: Duration) -> Result<Self, Error> {
        let state = arm.require_torque()?;
        Self::from(arm, &state, pose, within, limit)
    }

    /// Starts the parking of an arm with this reading.
    fn from(
        arm: &mut Ling,
        state: &JointState,
        pose: [Position; JOINTS],
        within: u16,
        limit: Duration,
    ) -> Result<Self, Error> {
        let target = Move {
            joints: together(state, pose),
            gripper: (arm.gripper_or_reading(state), GripperSpeed::DEFAULT),
        };
        arm.move_to(&target)?;
        let tolerances = Tolerances {
            gripper: None,
            ..Tolerances::within(within)
        };
        Ok(Self {
            phase: Phase::Way(target, Wait::new(arm, &target, tolerances, limit)),
            stops: arm.stops,
        })
    }

    /// Reads once; sends torque-off in the step that finds the arm at rest in its pose. `None` before the end: call it
    /// again, after 20 ms.
    ///
    /// # Errors
    ///
    /// As of [`Ling::park`].
    pub fn step(&mut self, arm: &mut Ling) -> Result<Option<Outcome>, Error> {
        if let Phase::Way(target, wait) = &mut self.phase {
            arm.link.check_interrupt()?;
            // Nobody who has taken the arm over expects that it drops.
            if arm.stops != self.stops || arm.target.as_ref() != Some(target) {
                let reason = "not parked: another call stopped, moved or released the arm";
                return Err(Error::refused(arm.name(), reason));
            }
            match wait.read(arm) {
                Ok(None) => return Ok(None),
                Ok(Some(_)) => arm.check_refusal()?,
                Err(error) => return Err(arm.not_parked(error)),
            }
            self.phase = Phase::TorqueOff(Switching::new(Effect::Torque(Torque::Off)));
        }
        match &mut self.phase {
            Phase::TorqueOff(switching) => switching.step(arm),
            Phase::Way(..) => Ok(None),
        }
    }
}

impl Ling {
    /// Parks the arm: moves its joints at 20°/s at most to a pose in which it lies without torque, and switches the torque
    /// off once they are at rest there, within this distance in ticks. The joints arrive together. The gripper keeps its
    /// goal. The [interrupt](Self::set_interrupt) stops the arm, and its torque stays on.
    ///
    /// # Errors
    ///
    /// [`Error::NotParked`] if the arm does not arrive within `limit`: it holds its pose then, with its torque on.
    /// [`Error::Stopped`] after an interrupt. Otherwise as of [`move_and_wait`](Self::move_and_wait), and of
    /// [`set_torque`](Self::set_torque).
    pub fn park(&mut self, pose: [Position; JOINTS], within: u16, limit: Duration) -> Result<Outcome, Error> {
        let state = self.require_torque()?;
        let gripper = self.gripper_or_reading(&state);
        self.stop_if_interrupted(gripper, |arm| {
            let mut parking = Parking::from(arm, &state, pose, within, limit)?;
            until(|| parking.step(arm))
        })
    }

    /// The pose that is saved for this arm, by its serial number.
    ///
    /// # Errors
    ///
    /// The serial number cannot be read. [`Error::NoParkPose`] if none is saved for it; [`Error::At`] for a file that
    /// cannot be used.
    pub fn saved_park_pose(&mut self, poses: &ParkPoses) -> Result<[Position; JOINTS], Error> {
        let serial = self.read_info()?.serial;
        match poses.read(&serial)? {
            Some(pose) => Ok(pose),
            None => Err(Error::NoParkPose {
                name: self.name().into(),
                serial,
            }),
        }
    }

    /// Saves the pose of an arm that lies without torque, under its serial number. A pose that was saved before is
    /// replaced. Returns the pose.
    ///
    /// # Errors
    ///
    /// [`Error::Refused`] if the torque is not off, or the arm is not at rest within 5 s; [`Error::At`] if the file cannot
    /// be written.
    pub fn save_park_pose(&mut self, poses: &ParkPoses) -> Result<[Position; JOINTS], Error> {
        let serial = self.read_info()?.serial;
        let (mut rest, clock) = (Rest::new(), Stopwatch::start());
        loop {
            let state = self.read_joints()?;
            if !state.status.is_torque_off() {
                let reason = format!(
                    "not saved: the torque is not off (status {}), and only without it is shown that the arm lies",
                    state.status
                );
                return Err(Error::refused(self.name(), reason));
            }
            let at_rest = rest.on_joints(clock.now(), &state.joints);
            if at_rest.is_ok_and(|time| time >= Rest::TIME) {
                let pose = state
                    .positions()
                    .map_err(|error| Error::unacceptable(self.name(), error))?;
                return poses.write(&serial, &pose).map(|()| pose);
            }
            if clock.0.elapsed() >= SAVE_LIMIT {
                return Err(Error::refused(self.name(), "not saved: the arm is not at rest"));
            }
            self.link.check_interrupt()?;
            thread::sleep(POLL_PERIOD);
        }
    }

    /// The gripper's last goal, else its reading. As in a stop, a reading beyond the open end stands for that end.
    fn gripper_or_reading(&self, state: &JointState) -> Opening {
        self.gripper.unwrap_or(state.opening().unwrap_or(Opening::OPEN))
    }

    /// The error of a parking that ended on the way, after this one. An arm that did not arrive presses against something,
    /// or moves on: it is held where it is.
    fn not_parked(&mut self, error: Error) -> Error {
        if !matches!(error, Error::NotReached { .. }) {
            return error;
        }
        self.forget_goal();
        Error::NotParked {
            stopped: self.stop(None).map_err(|error| error.to_string().into()),
            cause: Box::new(error),
        }
    }
}

/// The positions, with speeds at which the joints arrive together, if none is too slow for a move.
fn together(state: &JointState, pose: [Position; JOINTS]) -> [(Position, Speed); JOINTS] {
    let distance = |joint: usize| u32::from(pose[joint].ticks().abs_diff(state.joints[joint]));
    let farthest = (0..JOINTS).map(distance).max().unwrap_or(0).max(1);
    std::array::from_fn(|joint| {
        let share = u32::from(APPROACH_SPEED.ticks_per_second()) * distance(joint) / farthest;
        let speed = Speed::for_move(share as u16).unwrap_or(Speed::SLOWEST);
        (pose[joint], speed)
    })
}

#[cfg(test)]
mod tests {
    use std::mem;
    use std::sync::{Arc, Mutex};

    use armwire::ling::{Ling as Protocol, MAX_FRAME, MotionStatus, Request, Response};
    use armwire::messages::Messages;
    use armwire::{Device, DeviceEvent};

    use super::*;
    use crate::error::text::Text;
    use crate::ports::line::{Line, Names, Reception};

    /// The pose of the park.
    const POSE: [Position; JOINTS] = {
        let Ok(pose) = Position::new(2_068) else { panic!() };
        [pose; JOINTS]
    };

    /// An arm whose joints go to their goals by 5 ticks a reading, and no farther than `end`.
    struct Slow {
        device: Device<Protocol, MAX_FRAME>,
        joints: u16,
        goal: u16,
        end: u16,
        status: MotionStatus,
        answer: Vec<u8>,
        seen: Arc<Mutex<Seen>>,
    }

    /// The observations of an arm.
    #[derive(Debug, Default, PartialEq)]
    struct Seen {
        /// The readings at the end of its way.
        standing: usize,
        /// The position of the joints at torque-off.
        dropped_at: Option<u16>,
    }

    impl Line for Slow {
        fn name(&self) -> &str {
            "fake"
        }

        fn read(&mut self, buf: &mut [u8], _: Duration) -> Result<usize, Error> {
            let answer = mem::take(&mut self.answer);
            buf[..answer.len()].copy_from_slice(&answer);
            Ok(answer.len())
        }

        fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
            assert!(self.device.receive(bytes).is_empty());
            while let Some(event) = self.device.poll() {
                let DeviceEvent::Request { request, .. } = event else {
                    continue;
                };
                let mut seen = self.seen.lock().unwrap();
                match request {
                    Request::Move(target) => self.goal = target.joints[0].0.ticks(),
                    Request::SetTorque(Torque::Off) => {
                        seen.dropped_at = Some(self.joints);
                        self.status = MotionStatus::Idle;
                    }
                    Request::ReadJoints => {
                        let to = self.goal.min(self.end);
                        seen.standing += usize::from(self.joints == to && self.goal == POSE[0].ticks());
                        self.joints = to.min(self.joints + 5);
                        let response = Response::Joints(JointState {
                            joints: [self.joints; JOINTS],
                            gripper: 500,
                            status: self.status,
                        });
                        let mut out = [0; MAX_FRAME];
                        let n = Protocol.encode_response(&response, None, &mut out).unwrap();
                        self.answer = out[..n].to_vec();
                    }
                    _ => {}
                }
            }
            Ok(bytes.len())
        }

        fn hint(&self, _: Reception, _: Names) -> Text {
            Text::default()
        }
    }

    /// An arm that goes no farther than `end`.
    fn slow(end: u16) -> (Ling, Arc<Mutex<Seen>>) {
        let seen = Arc::new(Mutex::new(Seen::default()));
        let line = Slow {
            device: Device::new(Protocol),
            joints: 2_048,
            goal: 2_048,
            end,
            status: MotionStatus::Locked,
            answer: Vec::new(),
            seen: Arc::clone(&seen),
        };
        (super::super::tests::ling(Box::new(line)), seen)
    }

    #[test]
    fn torque_goes_off_only_at_rest_in_the_pose() {
        let (mut arm, seen) = slow(u16::MAX);
        let outcome = arm.park(POSE, 3, Duration::from_secs(5)).unwrap();
        assert!(outcome.is_shown, "{outcome}");
        let seen = seen.lock().unwrap();
        assert_eq!(seen.dropped_at, Some(2_068));
        // A rest of 0.2 s has at least three readings, 0.15 s apart.
        assert!(seen.standing >= 3, "{seen:?}");

        let (mut arm, seen) = slow(2_060);
        let error = arm.park(POSE, 3, Duration::from_secs(5)).unwrap_err();
        assert!(matches!(error, Error::NotParked { stopped: Ok(_), .. }), "{error}");
        assert_eq!(seen.lock().unwrap().dropped_at, None);
    }

    #[test]
    fn stop_of_another_call_ends_a_parking() {
        let (mut arm, seen) = slow(u16::MAX);
        let mut parking = Parking::new(&mut arm, POSE, 3, Duration::from_secs(5)).unwrap();
        assert!(parking.step(&mut arm).unwrap().is_none());
        arm.stop(None).unwrap();
        let error = parking.step(&mut arm).unwrap_err();
        assert!(
            error
                .to_string()
                .contains("another call stopped, moved or released the arm"),
            "{error}"
        );
        assert_eq!(seen.lock().unwrap().dropped_at, None);
    }

    #[test]
    fn joints_of_a_parking_arrive_together() {
        let state = JointState {
            joints: [2_048; JOINTS],
            gripper: 0,
            status: MotionStatus::Locked,
        };
        let ticks = [2_048, 2_148, 2_248, 1_048, 3_048, 2_058];
        let joints = together(&state, ticks.map(|ticks| Position::new(ticks).unwrap()));
        let speeds = joints.map(|(_, speed)| speed.ticks_per_second());
        // One under 50 ticks/s would not move.
        assert_eq!(speeds, [50, 50, 50, 228, 228, 50]);
    }
}
