//! The end of a stop, in words.

use armwire::ling::stop::Stopped;

/// The end of a stop, in words.
pub(crate) fn show(stopped: &Stopped) -> String {
    let (what, state) = match *stopped {
        Stopped::AtRest { state, .. } => ("stopped", state),
        Stopped::WithoutTorque(state) => ("the torque is off, so nothing was sent", state),
    };
    format!("{what}: {state}")
}
