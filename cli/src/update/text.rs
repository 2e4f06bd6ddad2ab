//! The lines that an update prints, and the words in them.

use std::fmt::Display;

use crate::output::print_line;

/// Prints a line. The update goes on if the reader of the output is gone.
pub(super) fn progress(line: impl Display) {
    let _ = print_line(line);
}

/// An argument as one would type it in a shell.
pub(super) fn as_word(argument: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "-_./:=@%+,".contains(c) || cfg!(windows) && c == '\\';
    match (!argument.is_empty() && argument.chars().all(is_plain), cfg!(windows)) {
        (true, _) => argument.to_owned(),
        (false, true) => format!("\"{argument}\""),
        (false, false) => format!("'{}'", argument.replace('\'', r"'\''")),
    }
}
