//! A question before something that may let an arm fall.

use std::io::{IsTerminal, Write, stderr, stdin};

use clap::Args;

use crate::error::Error;

/// The option that skips the question.
#[derive(Args)]
pub(crate) struct Confirm {
    /// Skip the confirmation.
    #[arg(long)]
    yes: bool,
}

impl Confirm {
    /// Prompts on a terminal for confirmation of `danger`, a sentence.
    ///
    /// # Errors
    ///
    /// The answer is not yes, or there is no terminal for a prompt.
    pub(crate) fn prompt(&self, danger: &str) -> Result<(), Error> {
        if self.yes {
            return Ok(());
        }
        if !stdin().is_terminal() {
            return Err(Error::Usage(format!(
                "{danger} Confirmation needs a terminal: use --yes"
            )));
        }
        let mut answer = String::new();
        let prompted = write!(stderr(), "{danger} Continue? [y/N] ").and_then(|()| stdin().read_line(&mut answer));
        prompted.map_err(|error| Error::at("confirmation", error))?;
        match answer.trim() {
            "y" | "Y" | "yes" => Ok(()),
            _ => Err(Error::Declined),
        }
    }
}
