//! The output of commands: results on standard output, errors on standard error.

use std::fmt::Display;
use std::io::{Write, stderr, stdout};

use serde_json::Value;

use crate::error::Error;
use crate::printable::{escaped, escaped_json};

/// Prints text as it is, at once.
pub(crate) fn print(text: &str) -> Result<(), Error> {
    let mut out = stdout().lock();
    let written = out.write_all(text.as_bytes()).and_then(|()| out.flush());
    written.map_err(Error::Output)
}

/// Prints one line, in which text from outside may be.
pub(crate) fn say(line: impl Display) -> Result<(), Error> {
    print(&format!("{}\n", escaped(&line.to_string())))
}

/// Prints one value as JSON.
pub(crate) fn print_json(value: &Value) -> Result<(), Error> {
    print(&(escaped_json(&format!("{value:#}")) + "\n"))
}

/// Tells what is wrong where it does not get into the data. That nobody reads it is no other error.
pub(crate) fn complain(what: &impl Display) {
    let _ = writeln!(stderr(), "armwire: {}", escaped(&what.to_string()));
}
