//! `armwire-ros2`: a ROS 2 node for robot arms, over DDS, without a ROS installation.
//!
//! Each arm has a thread, which owns its port, topics, services and action.
//!
//! ```text
//! joints_file ► options ► main ──► node: participant, topics, QoS
//!                          │        │ Endpoints of one arm
//!                          ▼        ▼
//!  adapter or arm ◄───►  arm ◄──► clients ──► JointState on NAME/joint_states
//!                        │ │       │    ◄──── JointTrajectory on NAME/joint_trajectory
//!                        │ │       │    ◄───► FollowJointTrajectory on NAME/follow_joint_trajectory, by goals
//!                        │ │       │    ◄───► SetBool on NAME/torque, Trigger on NAME/set_zero, by services
//!                        │ │       └────────► DiagnosticArray on /diagnostics
//!                        │ └─► motion: trajectory, tolerances; without a clock and without I/O
//!                        └── armwire_host::stamps: the adapter's clock in system time
//! ```
//!
//! The path of a `JointState`: the adapter polls the arm and stamps the last byte of the answer (`control::Event::Frame`),
//! `Adapter::next_event` receives the event, `stamps::Clock` maps the stamp to system time, `joint_states::Reading`
//! converts ticks to radians, and `Clients::publish` passes it to DDS. Without an adapter the node reads the joints, and the
//! stamp is the host's time of the answer.

mod arm;
mod clients;
mod diagnostics;
mod goals;
mod joint_states;
mod joints_file;
mod messages;
mod motion;
mod node;
mod numbers;
mod options;
mod services;
mod tolerances;
mod trajectory;

use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use clap::Parser;

use node::Network;
use options::Options;

/// Set by Ctrl-C or by SIGTERM.
static STOP: AtomicBool = AtomicBool::new(false);

fn main() -> ExitCode {
    let options = match Options::parse().checked() {
        Ok(options) => options,
        Err(error) => {
            eprintln!("error: {error}");
            return ExitCode::FAILURE;
        }
    };
    match run(&options) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(options: &options::Checked) -> Result<(), String> {
    ctrlc::set_handler(|| STOP.store(true, Ordering::Relaxed)).map_err(|error| error.to_string())?;
    let network = Network::join(options)?;
    let mut arms = Vec::new();
    for arm in &options.arms {
        arms.push((arm, network.endpoints(&arm.name, options.rmw)?));
    }
    thread::scope(|scope| {
        for (arm, (node, endpoints)) in arms {
            scope.spawn(move || arm::serve(arm, &endpoints, &STOP));
            // Other nodes see the topics until the node is dropped.
            scope.spawn(move || node.keep_until(&STOP));
        }
    });
    Ok(())
}
