//! The results of the checks, for people and for programs.

use std::fmt::Display;

use armwire_bridge::Counters;
use serde_json::{Map, Value, json};

use super::usb::UsbError;

/// The result of a check that passed.
#[derive(Clone, Debug, Default)]
pub struct Passed {
    /// The result as text.
    pub text: String,
    /// The figures of the result by name. A name ends with the unit.
    pub figures: Map<String, Value>,
}

impl Passed {
    /// A result as text, with its figures.
    pub(super) fn new<const N: usize>(text: String, figures: [(&str, Value); N]) -> Self {
        let figures = figures.map(|(name, value)| (name.to_owned(), value));
        Self {
            text,
            figures: figures.into_iter().collect(),
        }
    }
}

/// The reason for a check that did not pass.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Trouble {
    /// The adapter or the wiring is faulty.
    #[error("{0}")]
    Failed(String),
    /// The check is not possible here.
    #[error("{0}")]
    NotTried(String),
}

impl Trouble {
    /// A failure with this reason.
    pub(super) fn failed(reason: impl Display) -> Self {
        Self::Failed(reason.to_string())
    }
}

/// A failure with this reason unless the condition holds.
pub(super) fn ensure(condition: bool, reason: impl Display) -> Result<(), Trouble> {
    match condition {
        true => Ok(()),
        false => Err(Trouble::failed(reason)),
    }
}

impl From<UsbError> for Trouble {
    fn from(error: UsbError) -> Self {
        match error {
            UsbError::Unsupported(reason) => Self::NotTried(reason),
            error => Self::Failed(error.to_string()),
        }
    }
}

/// A check and its result.
#[derive(Clone, Debug)]
pub struct Check {
    /// The name.
    pub name: &'static str,
    /// The result.
    pub result: Result<Passed, Trouble>,
}

impl Check {
    /// Returns true if the adapter or the wiring is faulty.
    pub const fn has_failed(&self) -> bool {
        matches!(self.result, Err(Trouble::Failed(_)))
    }

    /// The result in a word for people and in one for programs, and its text.
    fn outcome(&self) -> (&'static str, &'static str, &str) {
        match &self.result {
            Ok(passed) => ("ok", "passed", &passed.text),
            Err(Trouble::Failed(text)) => ("FAILED", "failed", text),
            Err(Trouble::NotTried(text)) => ("not tried", "not tried", text),
        }
    }

    /// The check as one line.
    pub fn line(&self) -> String {
        let (word, _, text) = self.outcome();
        format!("{:<16}{word:<11}{text}", self.name)
    }

    /// The check as an object: name, result, text and figures.
    pub fn json(&self) -> Value {
        let (_, result, text) = self.outcome();
        let mut check = json!({ "check": self.name, "result": result, "text": text });
        if let (Ok(passed), Some(object)) = (&self.result, check.as_object_mut()) {
            object.extend(passed.figures.clone());
        }
        check
    }
}

/// A run for its reader elsewhere: versions, the system, each check with its figures, and the adapter's counters. It names
/// neither the port nor a serial number.
pub fn report(checks: &[Check], counters: Option<&Counters>) -> Value {
    let checks = checks.iter().map(Check::json).map(|mut check| {
        if let Some(object) = check.as_object_mut()
            && object.remove("serial").is_some()
        {
            object.remove("text");
        }
        check
    });
    json!({
        "armwire": env!("CARGO_PKG_VERSION"),
        "system": format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
        "checks": checks.collect::<Vec<_>>(),
        "counters": counters,
    })
}

/// The result of a check.
pub(super) type Checked = Result<Passed, Trouble>;

#[cfg(test)]
mod tests {
    use super::*;

    fn check(result: Result<Passed, Trouble>) -> Check {
        Check { name: "echo", result }
    }

    #[test]
    fn untried_check_is_never_ok() {
        let check = check(Err(UsbError::Unsupported("no suspend here".to_owned()).into()));
        assert!(!check.has_failed());
        assert_eq!(check.line(), "echo            not tried  no suspend here");
        assert_eq!(check.json()["result"], "not tried");
    }

    #[test]
    fn failed_transfer_fails_the_check() {
        let check = check(Err(UsbError::TimedOut.into()));
        assert!(check.has_failed());
        assert_eq!(check.json()["result"], "failed");
    }

    #[test]
    fn report_has_no_serial_number() {
        let figures = [("board", json!("pico")), ("serial", json!("E66"))];
        let passed = Passed::new("pico, serial number E66".to_owned(), figures);
        let report = report(&[check(Ok(passed))], None);
        assert_eq!(
            report["checks"],
            json!([{ "check": "echo", "result": "passed", "board": "pico" }])
        );
        assert!(!report.to_string().contains("E66"));
    }

    #[test]
    fn figures_stand_beside_the_text() {
        let passed = Passed::new("4 rates".to_owned(), [("bytes", json!(400))]);
        let object = check(Ok(passed)).json();
        assert_eq!(
            object,
            json!({ "check": "echo", "result": "passed", "text": "4 rates", "bytes": 400 })
        );
    }
}
