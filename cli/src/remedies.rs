//! The texts of errors, with what this command has against them.

use armwire_host::{Error, Protocol, Remedy};

use crate::stop::show;

/// The text of an error.
pub(crate) fn text(error: &Error) -> String {
    match error {
        Error::Stopped { stopped, .. } => show(stopped),
        Error::TorqueOff { name, effect, .. } => format!(
            "{name}: the torque is off, so {effect}: 'armwire torque PORT on' switches it on ('armwire call ling PORT \
             move' sends it all the same)"
        ),
        Error::Baud { name } => format!("--baud applies to serial ports only, not to {name}"),
        error => error.with(words),
    }
}

/// The words for a remedy.
pub(crate) fn words(remedy: Remedy) -> String {
    match remedy {
        Remedy::OpenAs(Protocol::Alpha1) => " (--arm alpha1)",
        Remedy::OpenAs(Protocol::Xarm) => " (--arm xarm)",
        Remedy::TryAs(Protocol::Alpha1) => " (--arm alpha1, or 'armwire call alpha1')",
        Remedy::TryAs(Protocol::Ling) => " (--arm ling, or 'armwire call ling')",
        Remedy::TryBaud => " (--baud)",
        Remedy::Listen => " 'armwire monitor' shows its joints.",
        Remedy::EndReservation => " ('armwire reserve')",
        Remedy::NameControl => " by --control",
        Remedy::SaveParkPose => ": 'armwire park PORT --save' saves it",
        Remedy::Stop => "; 'armwire stop PORT' stops the arm",
        _ => "",
    }
    .to_owned()
}

#[cfg(test)]
mod tests {
    use armwire::ling::MotionStatus;
    use armwire_host::TorqueOffEffect;

    use super::*;

    #[test]
    fn torque_off_states_its_effect() {
        let error = |effect| Error::TorqueOff {
            name: "port".into(),
            status: MotionStatus::Idle,
            effect,
        };
        for (effect, words) in [
            (TorqueOffEffect::NothingSent, "nothing was sent"),
            (TorqueOffEffect::MotionEnded, "the arm is not moved"),
        ] {
            let start = format!("port: the torque is off, so {words}: ");
            assert!(text(&error(effect)).starts_with(&start));
        }
    }
}
