//! A Ling arm on a port, in wire units.

use std::num::NonZeroU32;
use std::sync::Mutex;
use std::time::Duration;

use armwire::ling::effect::{Effect, Outcome};
use armwire::ling::stop::{Grip, Stopped};
use armwire::ling::{
    self, ControlMode, ForceFeedback, GripperSpeed, JOINTS, JointState, Kind, ModeState, MotionStatus, Opening,
    Position, Speed, Stroke, TemperatureLimit, Torque,
};
use armwire::messages::Messages;
use armwire_host::{Error, Ling, ModeSwitching, ParkPoses, Parking, Switching, Wait};
use pyo3::prelude::*;
use pyo3::types::PyByteArray;

use crate::error::{unacceptable, value_error};
use crate::joints::{Joints, joints};
use crate::reader::LingReader;
use crate::session::{Session, check_signals, lock};

/// Bytes of an answer after its documented fields.
type Extra = Vec<u8>;

/// Mode, masks of the blocked and of the valid joints, and for each joint the residual torque, the requested, the output
/// and the measured current, in thousandths.
type Mode = (u8, u8, u8, [[i16; 4]; JOINTS]);

/// Requested, effective, inhibit mask, sync, torque, requested torque, transition, grip and requested mode.
type Feedback = (bool, bool, u8, bool, bool, bool, u8, u8, u8);

/// A wait for the joints at a target.
#[pyclass(frozen, module = "armwire._armwire")]
pub(crate) struct LingWait(Mutex<Wait>);

/// A request whose effect is read back.
#[pyclass(frozen, module = "armwire._armwire")]
pub(crate) struct LingSwitching(Mutex<Switching>);

#[pymethods]
impl LingSwitching {
    #[staticmethod]
    fn torque(on: bool) -> Self {
        let torque = if on { Torque::On } else { Torque::Off };
        Self(Mutex::new(Switching::new(Effect::Torque(torque))))
    }

    #[staticmethod]
    fn zero() -> Self {
        Self(Mutex::new(Switching::new(Effect::Zero)))
    }
}

/// A change of the control mode, which is read back.
#[pyclass(frozen, module = "armwire._armwire")]
pub(crate) struct LingModeSwitching(Mutex<ModeSwitching>);

#[pymethods]
impl LingModeSwitching {
    #[new]
    fn new(is_current: bool) -> Self {
        let mode = if is_current {
            ControlMode::Current
        } else {
            ControlMode::Position
        };
        Self(Mutex::new(ModeSwitching::new(mode)))
    }
}

/// A parking.
#[pyclass(frozen, module = "armwire._armwire")]
pub(crate) struct LingParking(Mutex<Parking>);

/// A Ling arm on a port.
#[pyclass(frozen, module = "armwire._armwire")]
pub(crate) struct LingPort(Session<Ling>);

#[pymethods]
impl LingPort {
    #[new]
    fn new(py: Python<'_>, port: &str, baud: Option<NonZeroU32>) -> PyResult<Self> {
        let session = Session::of_arm(py, port, baud, |connection| {
            let mut arm = connection.ling()?;
            arm.set_interrupt(check_signals);
            Ok(arm)
        })?;
        Ok(Self(session))
    }

    fn close(&self, py: Python<'_>) -> PyResult<()> {
        self.0.close(py)
    }

    /// Serial number, kind (`leader`, `follower` or `None`), hardware version, firmware version, and extra bytes.
    fn read_info(&self, py: Python<'_>) -> PyResult<(String, Option<&'static str>, u32, u32, Extra)> {
        let (info, extra) = self.0.with(py, |arm| Ok((arm.read_info()?, extra(arm))))?;
        let kind = info.serial.kind().map(|kind| match kind {
            Kind::Leader => "leader",
            Kind::Follower => "follower",
        });
        Ok((info.serial.to_string(), kind, info.hardware.0, info.firmware.0, extra))
    }

    fn read_joints(&self, py: Python<'_>) -> PyResult<(Joints, Extra)> {
        self.read(py, Ling::read_joints)
    }

    /// A wait for the joints at these positions, from now on. The tolerance is in ticks.
    fn wait(&self, py: Python<'_>, positions: [u16; JOINTS], within: u16, timeout_s: f64) -> PyResult<LingWait> {
        let joints = pose(positions)?;
        let limit = Duration::try_from_secs_f64(timeout_s).map_err(value_error)?;
        let wait = self
            .0
            .with(py, |arm| Ok(Wait::for_joints(arm, joints, within, limit)))?;
        Ok(LingWait(Mutex::new(wait)))
    }

    /// The joints at the target of a wait; `None` before. Refused if the torque went off after a move.
    fn read_wait(&self, py: Python<'_>, wait: &LingWait) -> PyResult<Option<(Joints, Extra)>> {
        self.0.with(py, |arm| {
            let state = lock(&wait.0).read(arm)?;
            Ok(state.map(|state| (joints(state), extra(arm))))
        })
    }

    /// The joints alone, in the format of [`ling_angles`].
    fn read_angles<'py>(&self, py: Python<'py>, unit_per_tick: f64) -> PyResult<Bound<'py, PyByteArray>> {
        let ((ticks, ..), _) = self.read_joints(py)?;
        ling_angles(py, ticks, unit_per_tick)
    }

    /// The temperature of each servo, in °C.
    fn read_temperatures(&self, py: Python<'_>) -> PyResult<Vec<u16>> {
        let celsius = self.0.with(py, Ling::read_temperatures)?;
        Ok(celsius.as_slice().iter().map(|&celsius| celsius.into()).collect())
    }

    /// Speed of each servo, in ticks per second.
    fn read_velocities(&self, py: Python<'_>) -> PyResult<Vec<u16>> {
        Ok(self.0.with(py, Ling::read_velocities)?.as_slice().to_vec())
    }

    /// In millimetres.
    fn read_stroke(&self, py: Python<'_>) -> PyResult<u8> {
        Ok(self.0.with(py, Ling::read_stroke)?.millimetres())
    }

    /// Self-check result. Bit 0 is servo 1; a 1 is normal.
    fn self_check(&self, py: Python<'_>) -> PyResult<u16> {
        Ok(self.0.with(py, Ling::self_check)?.0)
    }

    /// Positions in ticks, speeds in ticks per second, gripper in thousandths, its speed in ticks per second. True if the
    /// gripper's goal is its reading.
    fn move_to(
        &self,
        py: Python<'_>,
        positions: [u16; JOINTS],
        speeds: [u16; JOINTS],
        gripper: Option<u16>,
        gripper_speed: u16,
    ) -> PyResult<bool> {
        // Slower ones are a force-feedback leader's, after it has answered for its mode.
        let slowest = match speeds.into_iter().min() {
            Some(speed) if speed < Speed::SLOWEST.ticks_per_second() => self.0.with(py, |arm| Ok(arm.slowest()))?,
            _ => Speed::SLOWEST,
        };
        let mut joints = [(Position::CENTRE, Speed::MAX); JOINTS];
        for (joint, (position, speed)) in joints.iter_mut().zip(positions.into_iter().zip(speeds)) {
            *joint = (
                Position::new(position).map_err(value_error)?,
                Speed::from_slowest(slowest, speed).map_err(value_error)?,
            );
        }
        let gripper = opening(gripper)?;
        let speed = GripperSpeed(gripper_speed);
        let grip = self.0.with(py, |arm| arm.move_joints(joints, gripper, speed))?;
        Ok(grip == Grip::Reading)
    }

    /// True if a move was sent since the torque was last off.
    fn has_moved(&self, py: Python<'_>) -> PyResult<bool> {
        self.0.with(py, |arm| Ok(arm.has_moved()))
    }

    /// The last reading, its extra bytes, and true if the gripper's goal is its reading.
    fn stop(&self, py: Python<'_>, gripper: Option<u16>, hold_reading: bool) -> PyResult<(Joints, Extra, bool)> {
        let gripper = opening(gripper)?;
        self.0.with(py, |arm| {
            if hold_reading {
                arm.forget_goal();
            }
            let (state, is_reading) = match arm.stop_interruptibly(gripper)? {
                Stopped::AtRest { state, grip, .. } => (state, grip == Grip::Reading),
                Stopped::WithoutTorque(state) => (state, false),
            };
            Ok((joints(state), extra(arm), is_reading))
        })
    }

    /// The reading that decides, its extra bytes, and a text if it does not show the effect. `None` before.
    fn read_back(
        &self,
        py: Python<'_>,
        switching: &LingSwitching,
    ) -> PyResult<Option<(Joints, Extra, Option<String>)>> {
        self.0.with(py, |arm| {
            let outcome = lock(&switching.0).step(arm)?;
            Ok(outcome.map(|outcome| shown(arm, &outcome)))
        })
    }

    /// Starts a parking at these positions, or at those that are saved for the arm. The tolerance is in ticks.
    fn start_parking(
        &self,
        py: Python<'_>,
        positions: Option<[u16; JOINTS]>,
        within: u16,
        timeout_s: f64,
    ) -> PyResult<LingParking> {
        let stated = positions.map(pose).transpose()?;
        let limit = Duration::try_from_secs_f64(timeout_s).map_err(value_error)?;
        let parking = self.0.with(py, |arm| {
            arm.require_torque()?;
            let pose = match stated {
                Some(pose) => pose,
                None => arm.saved_park_pose(&ParkPoses::of_user()?)?,
            };
            Parking::new(arm, pose, within, limit)
        })?;
        Ok(LingParking(Mutex::new(parking)))
    }

    /// As [`read_back`](Self::read_back), of the torque-off at the end of a parking.
    fn read_parking(&self, py: Python<'_>, parking: &LingParking) -> PyResult<Option<(Joints, Extra, Option<String>)>> {
        self.0.with(py, |arm| {
            let outcome = lock(&parking.0).step(arm)?;
            Ok(outcome.map(|outcome| shown(arm, &outcome)))
        })
    }

    /// The positions that are saved for the arm, in ticks.
    fn read_park_pose(&self, py: Python<'_>) -> PyResult<[u16; JOINTS]> {
        let pose = self.0.with(py, |arm| arm.saved_park_pose(&ParkPoses::of_user()?))?;
        Ok(pose.map(Position::ticks))
    }

    /// Saves the positions of an arm that lies without torque. Returns them, in ticks.
    fn save_park_pose(&self, py: Python<'_>) -> PyResult<[u16; JOINTS]> {
        let pose = self.0.with(py, |arm| arm.save_park_pose(&ParkPoses::of_user()?))?;
        Ok(pose.map(Position::ticks))
    }

    /// In millimetres.
    fn set_stroke(&self, py: Python<'_>, millimetres: u8) -> PyResult<()> {
        let mut strokes = [Stroke::Mm50, Stroke::Mm75, Stroke::Mm100].into_iter();
        let stroke = strokes.find(|stroke| stroke.millimetres() == millimetres);
        let wrong = || {
            value_error(format_args!(
                "gripper stroke is {millimetres} mm, must be 50, 75 or 100"
            ))
        };
        let stroke = stroke.ok_or_else(wrong)?;
        self.0.with(py, |arm| arm.set_stroke(stroke))
    }

    /// In °C.
    fn set_temperature_limit(&self, py: Python<'_>, celsius: u8) -> PyResult<()> {
        let limit = TemperatureLimit::new(celsius).map_err(value_error)?;
        self.0.with(py, |arm| arm.set_temperature_limit(limit))
    }

    fn read_mode(&self, py: Python<'_>) -> PyResult<(Mode, Extra)> {
        self.0.with(py, |arm| Ok((mode(&arm.read_mode()?), extra(arm))))
    }

    /// The mode once it is applied, and its extra bytes. `None` before.
    fn read_mode_change(&self, py: Python<'_>, switching: &LingModeSwitching) -> PyResult<Option<(Mode, Extra)>> {
        self.0.with(py, |arm| {
            let applied = lock(&switching.0).step(arm)?;
            Ok(applied.map(|state| (mode(&state), extra(arm))))
        })
    }

    fn read_force_feedback(&self, py: Python<'_>) -> PyResult<(Feedback, Extra)> {
        self.0
            .with(py, |arm| Ok((feedback(&arm.read_force_feedback()?), extra(arm))))
    }

    fn set_force_feedback(&self, py: Python<'_>, on: bool) -> PyResult<(Feedback, Extra)> {
        self.0
            .with(py, |arm| Ok((feedback(&arm.set_force_feedback(on)?), extra(arm))))
    }

    /// Reads the joints in a thread, at this rate in hertz.
    fn reader(&self, py: Python<'_>, rate: u32) -> PyResult<LingReader> {
        self.0.reader(py, rate).map(LingReader::new)
    }

    /// Bytes outside frames, and frames with a wrong checksum, since the port was opened.
    fn line_errors(&self, py: Python<'_>) -> PyResult<(usize, usize)> {
        let errors = self.0.with(py, |arm| Ok(arm.line_errors()))?;
        Ok((errors.noise_bytes, errors.checksums))
    }
}

impl LingPort {
    fn read(
        &self,
        py: Python<'_>,
        read: impl FnOnce(&mut Ling) -> Result<JointState, Error> + Send,
    ) -> PyResult<(Joints, Extra)> {
        self.0.with(py, |arm| {
            let state = read(arm)?;
            Ok((joints(state), extra(arm)))
        })
    }
}

/// The reading that decides, its extra bytes, and a text if it does not show the effect.
fn shown(arm: &Ling, outcome: &Outcome) -> (Joints, Extra, Option<String>) {
    let text = (!outcome.is_shown).then(|| format!("{}: {outcome}", arm.name()));
    (joints(outcome.state), extra(arm), text)
}

fn mode(state: &ModeState) -> Mode {
    let joints = state.joints.map(|joint| {
        [
            joint.residual_torque,
            joint.requested_current,
            joint.output_current,
            joint.measured_current,
        ]
    });
    (state.mode as u8, state.blocked.0, state.valid.0, joints)
}

fn feedback(state: &ForceFeedback) -> Feedback {
    (
        state.is_requested,
        state.is_effective,
        state.inhibit.0,
        state.is_sync_active,
        state.is_torque_enabled,
        state.is_torque_requested,
        state.transition,
        state.grip,
        state.requested_mode,
    )
}

/// The positions with these ticks.
fn pose(ticks: [u16; JOINTS]) -> PyResult<[Position; JOINTS]> {
    let mut pose = [Position::CENTRE; JOINTS];
    for (position, ticks) in pose.iter_mut().zip(ticks) {
        *position = Position::new(ticks).map_err(value_error)?;
    }
    Ok(pose)
}

/// The extra bytes of the last answer.
fn extra(arm: &Ling) -> Extra {
    ling::Ling.extra(arm.frame()).to_vec()
}

/// The gripper's goal in thousandths.
fn opening(gripper: Option<u16>) -> PyResult<Option<Opening>> {
    gripper.map(Opening::new).transpose().map_err(value_error)
}

/// Joint angles, 0 at the zero position: six 64-bit numbers in native byte order, for a NumPy array without a copy.
#[pyfunction]
pub(crate) fn ling_angles(
    py: Python<'_>,
    ticks: [u16; JOINTS],
    unit_per_tick: f64,
) -> PyResult<Bound<'_, PyByteArray>> {
    let mut bytes = [0; JOINTS * size_of::<f64>()];
    for (joint, (angle, ticks)) in (1..).zip(bytes.as_chunks_mut().0.iter_mut().zip(ticks)) {
        let position = Position::new(ticks).map_err(|error| unacceptable(format_args!("joint {joint}: {error}")))?;
        let ticks = f64::from(position.ticks()) - f64::from(Position::CENTRE.ticks());
        *angle = (ticks * unit_per_tick).to_ne_bytes();
    }
    Ok(PyByteArray::new(py, &bytes))
}

/// The joints in a frame, and its extra bytes; `None` for any other frame.
#[pyfunction]
pub(crate) fn ling_joints(frame: &[u8]) -> Option<(Joints, Extra)> {
    let state = ling::Ling.parse_response(frame, ()).ok()?.try_into().ok()?;
    Some((joints(state), ling::Ling.extra(frame).to_vec()))
}

/// The torque that this motion status shows; `None` if it shows none.
#[pyfunction]
pub(crate) fn ling_is_holding(status: u8) -> Option<bool> {
    MotionStatus::from(status).is_holding()
}

/// The reason why nothing moves an arm with this motion status, or another robot whose answer has so many data bytes; 0
/// for an Alicia-D. `None` if motion is permitted.
#[pyfunction]
pub(crate) fn ling_motion_refusal(status: u8, foreign_data_bytes: u8) -> Option<String> {
    let status = match foreign_data_bytes {
        0 => status.into(),
        data_bytes => MotionStatus::of_answer(status, data_bytes),
    };
    status.check_motion().err().map(|reason| reason.to_string())
}
