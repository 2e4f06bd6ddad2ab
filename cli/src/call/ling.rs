//! The requests of a Ling arm.

use std::f32::consts::PI;

use armwire::ling::{
    ControlMode, GripperSpeed, JOINTS, Move, Opening, Position, Request, Response, Speed, Stroke, TemperatureLimit,
    Torque,
};
use armwire_host::Ling;
use clap::{ArgAction, Args, Subcommand};

use super::values::{joint_speed, one_of, parse, scaled, slow_joint_speed, whole};
use crate::error::Error;
use crate::output::print_error;

/// The strokes of the grippers that exist, in millimetres.
pub(crate) const STROKES: [(&str, Stroke); 3] = [("50", Stroke::Mm50), ("75", Stroke::Mm75), ("100", Stroke::Mm100)];
pub(crate) const TORQUES: [(&str, Torque); 2] = [("on", Torque::On), ("off", Torque::Off)];
const MODES: [(&str, ControlMode); 2] = [("position", ControlMode::Position), ("current", ControlMode::Current)];
const SWITCH: [(&str, bool); 2] = [("on", true), ("off", false)];

/// One request.
#[derive(Subcommand)]
pub(crate) enum Command {
    /// Read serial number and versions.
    ReadInfo,
    /// Make the present pose the zero position, without asking. The arm switches its torque off: hold it.
    SetZero,
    /// Set the stroke of the arm's gripper.
    SetStroke {
        /// Stroke in millimetres.
        #[arg(value_parser = one_of(STROKES))]
        stroke: Stroke,
    },
    /// Read the gripper's stroke that is set in the arm.
    ReadStroke,
    /// Switch the torque, without asking. With torque off the arm falls: hold it.
    SetTorque {
        /// With torque on the arm holds its position.
        #[arg(value_parser = one_of(TORQUES))]
        torque: Torque,
    },
    /// Read joint positions, gripper and status.
    ReadJoints,
    /// Read the servos' temperatures.
    ReadTemperatures,
    /// Set the temperature limit of the overheat protection.
    SetTemperatureLimit {
        /// Limit in °C, 0 to 253, or 255; factory setting 85.
        #[arg(value_name = "CELSIUS", allow_negative_numbers = true, value_parser = limit)]
        limit: TemperatureLimit,
    },
    /// Read the servos' velocities.
    ReadVelocities,
    /// Move the joints and the gripper.
    #[command(
        override_usage = "armwire call ling <PORT> move [OPTIONS] --joints <DEGREES>\n       --speed <DEGREES/S>"
    )]
    Move(Target),
    /// Check every servo.
    SelfCheck,
    /// Set the control mode of a force-feedback leader, and wait until it is applied. Its torque may go off: hold it.
    SetMode {
        /// In position mode again, the torque stays off.
        #[arg(value_parser = one_of(MODES))]
        mode: ControlMode,
    },
    /// Read the control mode and the currents of a force-feedback leader.
    ReadMode,
    /// Request the force feedback of a force-feedback leader, or its end. With it the motors push the joints.
    SetForceFeedback {
        /// The answer says whether it is effective.
        #[arg(action = ArgAction::Set, value_parser = one_of(SWITCH))]
        switch: bool,
    },
    /// Read the state of the force feedback.
    ReadForceFeedback,
}

/// Target positions and speeds.
#[derive(Args)]
pub(crate) struct Target {
    /// Target angles of joints 1 to 6 in degrees, such as 0,10,-20,0,0,45.
    #[arg(long, value_name = "DEGREES", allow_hyphen_values = true, value_parser = positions)]
    joints: [Position; JOINTS],
    /// Speed in degrees per second, at least 4.4: one number for all joints, or six.
    #[arg(long, value_name = "DEGREES/S", allow_hyphen_values = true, value_parser = speeds)]
    #[arg(required_unless_present = "slow_speed")]
    speed: Option<[Speed; JOINTS]>,
    /// Speed of a force-feedback leader, at least 0.09, instead of --speed. The arm is asked for its control mode before,
    /// and is not moved if it does not answer.
    #[arg(long, value_name = "DEGREES/S", allow_hyphen_values = true, value_parser = slow_speeds)]
    #[arg(conflicts_with = "speed")]
    slow_speed: Option<[Speed; JOINTS]>,
    /// Opening of the gripper, in percent of its stroke. Without it the goal is the gripper's reading, and a grip may
    /// loosen.
    #[arg(long, value_name = "PERCENT", allow_hyphen_values = true, value_parser = opening)]
    gripper: Option<Opening>,
    /// Speed of the gripper, in ticks per second.
    #[arg(long, value_name = "TICKS/S", default_value_t = 1000, value_parser = whole::<u16>(1..=u16::MAX.into()))]
    gripper_speed: u16,
}

impl Command {
    /// The request. A move without a goal of the gripper needs a reading.
    pub(super) fn request(&self, arm: &mut Ling) -> Result<Request, Error> {
        Ok(match self {
            Self::ReadInfo => Request::ReadInfo,
            Self::SetZero => Request::SetZero,
            Self::SetStroke { stroke } => Request::SetStroke(*stroke),
            Self::ReadStroke => Request::ReadStroke,
            Self::SetTorque { torque } => Request::SetTorque(*torque),
            Self::ReadJoints => Request::ReadJoints,
            Self::ReadTemperatures => Request::ReadTemperatures,
            Self::SetTemperatureLimit { limit } => Request::SetTemperatureLimit(*limit),
            Self::ReadVelocities => Request::ReadVelocities,
            Self::Move(target) => Request::Move(target.to_move(arm)?),
            Self::SelfCheck => Request::SelfCheck,
            Self::SetMode { mode } => Request::SetMode(*mode),
            Self::ReadMode => Request::ReadMode,
            Self::SetForceFeedback { switch } => Request::SetForceFeedback(*switch),
            Self::ReadForceFeedback => Request::ReadForceFeedback,
        })
    }
}

/// The answer to a request to a force-feedback leader: the applied mode, and not the mode that was accepted. `None` for
/// other requests.
pub(super) fn answer_of_leader(request: &Request, arm: &mut Ling) -> Result<Option<Response>, Error> {
    Ok(Some(match request {
        Request::SetMode(mode) => Response::Mode(arm.set_mode(*mode)?),
        Request::ReadMode => Response::Mode(arm.read_mode()?),
        Request::SetForceFeedback(switch) => Response::ForceFeedback(arm.set_force_feedback(*switch)?),
        Request::ReadForceFeedback => Response::ForceFeedback(arm.read_force_feedback()?),
        _ => return Ok(None),
    }))
}

impl Target {
    /// The move. Without a goal of the gripper, that is its reading, with a warning.
    pub(crate) fn to_move(&self, arm: &mut Ling) -> Result<Move, Error> {
        if self.slow_speed.is_some() {
            arm.read_mode()?;
        }
        // One of them is required.
        let speed = self.slow_speed.or(self.speed).unwrap_or([Speed::SLOWEST; JOINTS]);
        let gripper = match self.gripper {
            Some(goal) => goal,
            None => gripper_reading(arm)?,
        };
        Ok(Move {
            joints: std::array::from_fn(|joint| (self.joints[joint], speed[joint])),
            gripper: (gripper, GripperSpeed(self.gripper_speed)),
        })
    }
}

/// The gripper's reading as its goal.
fn gripper_reading(arm: &mut Ling) -> Result<Opening, Error> {
    let reading = arm.read_joints()?.opening();
    let goal = reading.map_err(|error| Error::at(arm.name(), format_args!("{error}: --gripper sets the goal")))?;
    print_error(&format_args!(
        "{}: the gripper's goal is its reading, {goal}: a grip may loosen (--gripper sets the goal)",
        arm.name()
    ));
    Ok(goal)
}

/// A value for each joint, with commas between.
fn each<T>(text: &str, one: impl Fn(&str) -> Result<T, String>) -> Result<[T; JOINTS], String> {
    let values: Vec<T> = text.split(',').map(one).collect::<Result<_, _>>()?;
    let got = values.len();
    values
        .try_into()
        .map_err(|_| format!("there are {JOINTS} joints, not {got}"))
}

pub(crate) fn positions(text: &str) -> Result<[Position; JOINTS], String> {
    each(text, |text| scaled(text, "degrees", PI / 180.0, Position::from_radians))
}

fn speeds(text: &str) -> Result<[Speed; JOINTS], String> {
    one_or_each(text, joint_speed)
}

fn slow_speeds(text: &str) -> Result<[Speed; JOINTS], String> {
    one_or_each(text, slow_joint_speed)
}

fn one_or_each(text: &str, one: fn(&str) -> Result<Speed, String>) -> Result<[Speed; JOINTS], String> {
    match text.contains(',') {
        true => each(text, one),
        false => one(text).map(|speed| [speed; JOINTS]),
    }
}

pub(crate) fn opening(text: &str) -> Result<Opening, String> {
    scaled(text, "%", 0.01, Opening::from_fraction)
}

fn limit(text: &str) -> Result<TemperatureLimit, String> {
    const RANGE: &str = "a limit from 0 to 253, or 255";
    TemperatureLimit::new(parse(text, RANGE)?)
        .map_err(|_| format!("{text} is not a limit: the arm takes it as a read; allowed: 0 to 253, and 255"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn degrees_and_percent_become_counts() {
        let ticks = positions("0,90,-90,-180,0.1,179.9").unwrap().map(Position::ticks);
        assert_eq!(ticks, [2048, 3072, 1024, 0, 2049, 4095]);
        assert_eq!(speeds("20").unwrap().map(Speed::ticks_per_second), [228; 6]);
        assert_eq!(speeds("9,9,9,9,9,5").unwrap()[5].ticks_per_second(), 57);
        assert_eq!(opening("50").unwrap().per_mille(), 500);
    }

    #[test]
    fn range_errors_are_in_the_typed_unit() {
        assert_eq!(
            positions("0,0,0,0,0,200").unwrap_err(),
            "joint angle is 200 degrees, must be -180..=179.91"
        );
        assert!(
            speeds("-1")
                .unwrap_err()
                .starts_with("joint speed is -1 degrees/s, must be 4.4")
        );
        for slow in ["0", "4", "9,9,9,9,9,4"] {
            let error = speeds(slow).unwrap_err();
            let text = "joint speed (an arm may take less than 50 ticks/s for 0) is ";
            assert!(
                error.starts_with(text) && error.contains("degrees/s, must be 4.4"),
                "{error}"
            );
        }
        assert_eq!(slow_speeds("0.1").unwrap()[0].ticks_per_second(), 1);
        assert_eq!(
            slow_speeds("0").unwrap_err(),
            "joint speed is 0 degrees/s, must be 0.09..=439.45"
        );
        assert!(opening("101").unwrap_err().ends_with("is 101 %, must be 0..=100"));
        assert_eq!(
            limit("254").unwrap_err(),
            "254 is not a limit: the arm takes it as a read; allowed: 0 to 253, and 255"
        );
        assert_eq!(positions("0,0").unwrap_err(), "there are 6 joints, not 2");
        assert_eq!(positions("0,x").unwrap_err(), "'x' is not a number");
        assert!(positions("nan,0,0,0,0,0").is_err());
    }
}
