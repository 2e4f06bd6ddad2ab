//! The Ling arm of the older generation, which takes no requests.

use armwire::Config;
use armwire::ling::Ling;
use armwire::ling::legacy::{GripperState, Legacy, Response};

use super::arm::{Arm, Protocol};
use super::fact::Fact;
use super::ling::joints;

impl Arm for Legacy {
    const PROTOCOL: Protocol = Protocol::LingLegacy;

    const NAME: &'static str = "a Ling arm of the older generation";

    const OTHER: (&'static str, Protocol) = Ling::OTHER;

    const CONFIG: Config = Config::DEFAULT;

    const HEADER: usize = 3;

    fn facts(response: &Response) -> Vec<Fact> {
        match response {
            Response::Joints(state) => vec![joints(state.joints())],
            Response::Gripper(state) => gripper(Some(state)),
            other => vec![Fact::words("message", other)],
        }
    }
}

/// Raw counts: their scale depends on the gripper. Null before the first one is received.
pub fn gripper(state: Option<&GripperState>) -> Vec<Fact> {
    let raw = |name: &str, value: fn(&GripperState) -> u16| {
        let (key, value) = (format!("{}_raw", name.replace(' ', "_")), state.map(value));
        let text = value.map_or("-".to_owned(), |value| value.to_string());
        Fact::new(name, &key, value, text)
    };
    vec![
        raw("gripper", |state| state.servo),
        raw("potentiometer", |state| state.potentiometer),
        raw("sync button", |state| state.sync_button.into()),
        raw("attitude button", |state| state.attitude_button.into()),
    ]
}
