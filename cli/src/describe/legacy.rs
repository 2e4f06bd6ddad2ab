//! The Ling arm of the older generation, which is only heard.

use armwire::Config;
use armwire::ling::legacy::{GripperState, JointState, Legacy, Request, Response};

use super::Arm;
use super::ling::degrees;

impl Arm for Legacy {
    const NAME: &'static str = "a Ling arm of the older generation";

    const CONFIG: Config = Config::DEFAULT;

    const HEADER: usize = 3;

    fn show_request(request: &Request) -> String {
        match *request {}
    }

    fn show_response(response: &Response) -> String {
        match response {
            Response::Joints(state) => joints(state),
            Response::Gripper(state) => gripper(state),
            other => format!("{other:?}"),
        }
    }

    fn refusal(_: &Response) -> Option<String> {
        None
    }
}

fn joints(state: &JointState) -> String {
    format!("joints {}", state.joints().map(degrees).join(" "))
}

/// Raw counts, for their scale depends on the gripper.
pub(crate) fn gripper(state: &GripperState) -> String {
    format!(
        "gripper {}, potentiometer {}, buttons {} {}",
        state.servo, state.potentiometer, state.sync_button, state.attitude_button
    )
}
