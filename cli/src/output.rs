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

/// Prints one line. Text from outside in it is escaped.
pub(crate) fn print_line(line: impl Display) -> Result<(), Error> {
    print(&format!("{}\n", escaped(&line.to_string())))
}

/// Prints one value as JSON.
pub(crate) fn print_json(value: &Value) -> Result<(), Error> {
    print(&(escaped_json(&format!("{value:#}")) + "\n"))
}

/// Prints an error or a notice on standard error, apart from the data. Without a reader it is lost.
pub(crate) fn print_error(what: &impl Display) {
    let _ = writeln!(stderr(), "armwire: {}", escaped(&what.to_string()));
}
