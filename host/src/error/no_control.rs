//! The reason why a port has no control port to use.

use crate::error::outside::Outside;
use crate::error::text::{Remedy, Text};

/// The reason why a port has no control port to use.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum NoControl {
    /// No adapter has the port.
    NoAdapter,
    /// The system does not show which USB device has the port. Only Linux does, and not for a pty.
    NotShown {
        /// The control ports of all adapters on USB, as `usb:SERIAL/control`. Any of them may have the port, or none.
        candidates: Vec<Outside>,
    },
}

impl NoControl {
    pub(crate) fn text(&self) -> Text {
        let (reason, example) = match self {
            Self::NoAdapter => (
                "no control port of an armwire adapter found: a virtual board's must be named",
                "control:PATH".to_owned(),
            ),
            Self::NotShown { candidates } => {
                let names: Vec<_> = candidates.iter().map(Outside::as_str).collect();
                let example = match names.as_slice() {
                    [] => "control:PATH of a virtual board".to_owned(),
                    names => names.join(" or "),
                };
                let reason = "the system does not show which adapter has this port: its control port must be named";
                (reason, example)
            }
        };
        Text::from(reason)
            .remedy(Remedy::NameControl)
            .and(&format!(", such as {example}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_ports_to_name_are_listed() {
        let text = |candidates: &[&str]| {
            let candidates = candidates.iter().map(|&name| name.into()).collect();
            NoControl::NotShown { candidates }.text().with(|_| " here".to_owned())
        };
        let reason =
            "the system does not show which adapter has this port: its control port must be named here, such as ";
        assert_eq!(text(&[]), format!("{reason}control:PATH of a virtual board"));
        assert_eq!(
            text(&["usb:35FFD8/control", "usb:35FFD9/control"]),
            format!("{reason}usb:35FFD8/control or usb:35FFD9/control")
        );
    }
}
