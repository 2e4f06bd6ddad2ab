//! Stopping an arm: `armwire stop`, and Ctrl-C during a motion.

pub(crate) mod command;
pub(crate) mod stoppable;
mod text;

use armwire_host::{Error as Host, Ling};

use crate::error::Error;
pub(crate) use text::show;

/// Stops an arm after this error, if this program moved it. The error says how it was stopped, or why it may still move.
pub(crate) fn after(arm: &mut Ling, error: Error) -> Error {
    if !arm.has_moved() {
        return error;
    }
    let end = match error {
        Error::Host(Host::Lost { ref name, .. }) if name.as_str() == arm.name() => {
            "nothing can be sent: the arm goes to its last goal, and rests there".to_owned()
        }
        Error::Host(Host::Interrupted(reason)) => {
            return match arm.stop(None) {
                Ok(stopped) => {
                    let name = arm.name().into();
                    Host::Stopped { name, stopped, reason }.into()
                }
                Err(unstopped) => unstopped.into(),
            };
        }
        _ => match arm.stop(None) {
            Ok(stopped) => show(&stopped),
            Err(unstopped) => unstopped.to_string(),
        },
    };
    let cause = Box::new(error);
    Error::Ended { cause, end }
}
