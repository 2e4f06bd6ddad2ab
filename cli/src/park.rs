//! `armwire park`: a Ling arm lies down before its torque goes off.

use std::time::Duration;

use armwire::ling::{JOINTS, Position};
use armwire_host::{self as host, ParkPoses};
use clap::Args;

use crate::args::ArmPort;
use crate::call::ling::positions;
use crate::call::values::seconds;
use crate::error::Error;
use crate::motion::within;
use crate::output::print_line;
use crate::stop::stoppable;

/// The arguments of `armwire park`.
#[derive(Args)]
pub(crate) struct Park {
    #[command(flatten)]
    arm: ArmPort,
    /// Angles of joints 1 to 6 in degrees, such as 0,-80,75,0,10,0. Default: the pose that --save has saved for this arm.
    #[arg(long, value_name = "DEGREES", allow_hyphen_values = true, value_parser = positions)]
    pose: Option<[Position; JOINTS]>,
    /// Save the pose of the arm, which lies without torque, under its serial number. Nothing moves.
    #[arg(long, conflicts_with_all = ["pose", "within", "timeout"])]
    save: bool,
    /// Tolerance of a joint, from which it falls when the torque goes off.
    #[arg(long, value_name = "DEGREES", default_value = "5.7", value_parser = within)]
    within: u16,
    /// Maximum time of the motion.
    #[arg(long, value_name = "SECONDS", default_value = "60", value_parser = seconds)]
    timeout: Duration,
}

impl Park {
    pub(crate) fn run(&self) -> Result<(), Error> {
        let mut arm = stoppable::open(&self.arm)?;
        let done = match self.save {
            true => save(&mut arm),
            false => self.park(&mut arm),
        };
        done.map_err(|error| error.explained(|error| arm.explain(error)))
    }

    fn park(&self, arm: &mut host::Ling) -> Result<(), Error> {
        // Without torque nothing else is asked of the arm.
        arm.require_torque()?;
        let pose = match self.pose {
            Some(pose) => pose,
            None => arm.saved_park_pose(&ParkPoses::of_user()?)?,
        };
        let outcome = arm.park(pose, self.within, self.timeout)?;
        print_line(format_args!("parked: {}; {outcome}", outcome.state))
    }
}

/// Saves the pose of an arm that lies.
fn save(arm: &mut host::Ling) -> Result<(), Error> {
    let poses = ParkPoses::of_user()?;
    let pose = arm.save_park_pose(&poses)?;
    let serial = arm.read_info()?.serial;
    let angles = pose.map(|position| format!("{:.2}", position.radians().to_degrees()));
    let path = poses.path(&serial)?;
    print_line(format_args!(
        "saved for {serial}: {} ({})",
        angles.join(","),
        path.display()
    ))
}
