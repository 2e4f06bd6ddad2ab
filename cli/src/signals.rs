//! Ctrl-C, and requests to terminate.

use std::error;
use std::process;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use crate::error::Error;

/// Exit status of a program that Ctrl-C ended: 128, and the signal's number.
const EXIT_STATUS: i32 = 130;
/// Signals within this time count as one: `timeout` and a closed terminal send two.
const REPEAT_TIME: Duration = Duration::from_millis(200);

static CAUGHT: AtomicBool = AtomicBool::new(false);

/// A flag that Ctrl-C, or a request to terminate, sets.
pub(crate) fn catch() -> Result<&'static AtomicBool, Error> {
    ctrlc::set_handler(|| CAUGHT.store(true, Ordering::Relaxed)).map_err(Error::Signals)?;
    Ok(&CAUGHT)
}

/// Catches the first Ctrl-C, or request to terminate, for [`check`]. A later one ends the program at once.
pub(crate) fn catch_first() -> Result<(), Error> {
    let mut first = None;
    let handler = move || {
        CAUGHT.store(true, Ordering::Relaxed);
        if first.get_or_insert_with(Instant::now).elapsed() > REPEAT_TIME {
            process::exit(EXIT_STATUS);
        }
    };
    ctrlc::set_handler(handler).map_err(Error::Signals)
}

/// The error of an interrupted program.
pub(crate) fn check() -> Result<(), Box<dyn error::Error + Send + Sync>> {
    match CAUGHT.load(Ordering::Relaxed) {
        false => Ok(()),
        true => Err("interrupted".into()),
    }
}
