//! The end of a stop, in words.

use armwire::ling::stop::Stopped;

/// The end of a stop, in words, with the joints that rest away from their setpoint.
pub(crate) fn show(stopped: &Stopped) -> String {
    match stopped {
        Stopped::AtRest { state, deviations, .. } if deviations.are_small() => format!("stopped: {state}"),
        Stopped::AtRest { state, deviations, .. } => format!("stopped: {state}; {deviations}"),
        Stopped::WithoutTorque(state) => format!("the torque is off, so nothing was sent: {state}"),
    }
}
