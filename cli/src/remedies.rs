//! The texts of errors, with what this command has against them.

use armwire_host::{Error, Protocol, Remedy};

/// The text of an error.
pub(crate) fn text(error: &Error) -> String {
    match error {
        Error::Baud { name } => format!("--baud applies to serial ports only, not to {name}"),
        error => error.with(words),
    }
}

/// The words for a remedy.
pub(crate) fn words(remedy: Remedy) -> String {
    match remedy {
        Remedy::OpenAs(Protocol::Alpha1) => " (--arm alpha1)",
        Remedy::OpenAs(Protocol::Xarm) => " (--arm xarm)",
        Remedy::TryAs(Protocol::Alpha1) => " ('alpha1' instead of 'ling')",
        Remedy::TryAs(Protocol::Ling) => " ('ling' instead of 'alpha1')",
        Remedy::Listen => " 'armwire monitor' shows its joints.",
        Remedy::EndHold => " ('armwire hold')",
        _ => "",
    }
    .to_owned()
}
