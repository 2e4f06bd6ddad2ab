//! Signals that ask this program to end, such as Ctrl-C or the hang-up of the terminal. They end an update before the
//! adapter is restarted, and not afterwards: the adapter would stay in its boot loader.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::error::Error;
use crate::output::print_error;

/// The permission of signals to end an update.
pub(super) struct Interruption(Arc<Mutex<Phase>>);

enum Phase {
    /// Nothing was restarted, and a signal ends the update.
    Revocable,
    /// A signal came.
    Revoked,
    /// The update of the adapter with this name goes on.
    Committed(String),
}

impl Interruption {
    /// Catches them for the rest of the process.
    pub(super) fn catch() -> Result<Self, Error> {
        let phase = Arc::new(Mutex::new(Phase::Revocable));
        let shared = Arc::clone(&phase);
        ctrlc::set_handler(move || on_signal(&mut lock(&shared))).map_err(Error::Signals)?;
        Ok(Self(phase))
    }

    /// From here on the update of the adapter `name` goes on, unless a signal came.
    pub(super) fn commit(&self, name: &str) -> Result<(), Error> {
        let mut phase = lock(&self.0);
        match *phase {
            Phase::Revoked => Err(Error::Declined),
            Phase::Revocable | Phase::Committed(_) => {
                *phase = Phase::Committed(name.to_owned());
                Ok(())
            }
        }
    }
}

fn on_signal(phase: &mut Phase) {
    match phase {
        Phase::Revocable | Phase::Revoked => {
            *phase = Phase::Revoked;
            print_error(&"interrupted: nothing is restarted");
        }
        Phase::Committed(name) => print_error(&format_args!(
            "{name}: the update goes on: without it the adapter stays in its boot loader"
        )),
    }
}

fn lock(phase: &Mutex<Phase>) -> MutexGuard<'_, Phase> {
    phase.lock().unwrap_or_else(PoisonError::into_inner)
}
