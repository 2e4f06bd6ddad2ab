//! `armwire-ros2`: a ROS 2 node for robot arms, over DDS, without a ROS installation.
//!
//! Each arm has a thread, which owns its port, topics, services and action.
//!
//! ```text
//! joints file ► options ► main ──► node: participant, topics, QoS
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
mod messages;
mod motion;
mod node;
mod numbers;
mod options;
mod services;
mod silence;
mod source;
mod tolerances;
mod trajectory;

use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use clap::Parser;

use node::Network;
use options::Options;

/// Time between two checks of the network.
const WATCH_PERIOD: Duration = Duration::from_millis(100);
/// Number of failed checks in a row after which the network has ended.
const MAX_FAILED: u32 = 3;

/// Set by Ctrl-C or by SIGTERM.
static STOP: AtomicBool = AtomicBool::new(false);
/// Set by a second one, which ends the parking.
static STOP_PARKING: AtomicBool = AtomicBool::new(false);

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
    let on_signal = || {
        if STOP.swap(true, Ordering::Relaxed) {
            STOP_PARKING.store(true, Ordering::Relaxed);
        }
    };
    ctrlc::set_handler(on_signal).map_err(|error| error.to_string())?;
    let network = Network::join(options)?;
    let mut arms = Vec::new();
    for arm in &options.arms {
        arms.push((arm, network.endpoints(&arm.name, options.rmw)?));
    }
    thread::scope(|scope| {
        for (arm, (_, endpoints)) in &arms {
            scope.spawn(|| arm::serve(arm, endpoints, &STOP, &STOP_PARKING));
        }
        let result = watch(&network, &STOP);
        // The arms hold.
        STOP.store(true, Ordering::Relaxed);
        result
    })
}

/// Waits for `stop`, or for the end of the network: an arm must not move on when nobody can stop it.
fn watch(network: &Network, stop: &AtomicBool) -> Result<(), String> {
    let mut failed = 0;
    while !stop.load(Ordering::Relaxed) {
        thread::sleep(WATCH_PERIOD);
        // A busy network fails now and then.
        failed = if network.is_alive() { 0 } else { failed + 1 };
        if failed == MAX_FAILED {
            let cause = "was the process stopped and continued, or the computer suspended?";
            return Err(format!(
                "the connection to the ROS network has ended: {cause} Start the node again"
            ));
        }
    }
    Ok(())
}
