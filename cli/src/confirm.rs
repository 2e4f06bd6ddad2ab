//! A question before something that may let an arm fall.

use std::io::{IsTerminal, Write, stderr, stdin};
use std::thread::{self, JoinHandle};

use clap::Args;

use crate::error::Error;

/// The option that skips the question.
#[derive(Args)]
pub(crate) struct Confirm {
    /// Skip the confirmation.
    #[arg(long)]
    yes: bool,
}

/// A question that is still to be asked.
#[must_use]
pub(crate) struct Question<'a> {
    danger: &'a str,
    is_confirmed: bool,
}

impl Confirm {
    /// The question whether to do something with this danger, a sentence. The option answers it.
    ///
    /// # Errors
    ///
    /// There is no terminal for a prompt.
    pub(crate) fn question<'a>(&self, danger: &'a str) -> Result<Question<'a>, Error> {
        let is_confirmed = self.yes;
        match is_confirmed || stdin().is_terminal() {
            true => Ok(Question { danger, is_confirmed }),
            false => Err(Error::Usage(format!(
                "{danger} Confirmation needs a terminal: use --yes"
            ))),
        }
    }
}

impl Question<'_> {
    /// Prompts for confirmation on the terminal.
    ///
    /// # Errors
    ///
    /// The answer is not yes.
    pub(crate) fn ask(self) -> Result<(), Error> {
        if self.is_confirmed {
            return Ok(());
        }
        let mut answer = String::new();
        let prompted =
            write!(stderr(), "{} Continue? [y/N] ", self.danger).and_then(|()| stdin().read_line(&mut answer));
        prompted.map_err(|error| Error::at("confirmation", error))?;
        match answer.trim() {
            "y" | "Y" | "yes" => Ok(()),
            _ => Err(Error::Declined),
        }
    }
}

/// Waits for a line with this word on the terminal, in a thread of its own. Its result is false at the terminal's end.
pub(crate) fn wait_for(word: &'static str) -> JoinHandle<bool> {
    thread::spawn(move || stdin().lines().map_while(Result::ok).any(|line| line.trim() == word))
}
