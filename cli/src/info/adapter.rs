//! The adapter between this computer and the arm.

use armwire_bridge::control::{Reply, Request};

use super::show;
use crate::control::ControlLink;
use crate::problem::Problem;

pub(super) fn run(control: &mut ControlLink) -> Result<(), Problem> {
    if let Reply::Identity(identity) = control.call(Request::Identify)? {
        let commit = match identity.commit.as_str() {
            "" => String::new(),
            commit => format!(" ({commit})"),
        };
        show(
            "adapter",
            format_args!(
                "{}, serial number {}, firmware {}{commit}",
                identity.board, identity.serial, identity.firmware
            ),
        )?;
    }
    if let Reply::Config(config) = control.call(Request::GetConfig)? {
        show(
            "configured",
            format_args!("for {}, CAN node {}", config.arm, config.can.node.get()),
        )?;
    }
    Ok(())
}
