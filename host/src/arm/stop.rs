//! Stopping a Ling arm from this computer.

use std::thread;
use std::time::Duration;

use armwire::ling::stop::{Output, StopError, Stopped};
use armwire::ling::{Ling, Request, Response, Stop};
use armwire::time;

use crate::error::Error;
use crate::error::text::Text;
use crate::ports::link::Link;
use crate::time::stopwatch::Stopwatch;

/// Time between two tries of the last request.
const RETRY_PERIOD: Duration = Duration::from_millis(20);

/// Stops a Ling arm and keeps its torque on, as [`Stop`] describes. Takes 2 s at most, and the timeout of one read.
///
/// The link's [interrupt](Link::set_interrupt) does not end the stop: an interrupted program calls it.
///
/// # Errors
///
/// [`Error::NotStopped`] if the arm may still move; [`Error::Lost`] and [`Error::Legacy`]. After any other error a
/// request is repeated.
pub(crate) fn stop(link: &mut Link<Ling>, stop: &mut Stop) -> Result<Stopped, Error> {
    link.uninterrupted(|link| drive(link, stop))
}

/// As [`stop`], but the link's interrupt ends it, as [`Error::Interrupted`]: the caller has taken the one that the stop
/// is for.
///
/// # Errors
///
/// As [`stop`], and [`Error::Interrupted`].
pub(crate) fn stop_interruptibly(link: &mut Link<Ling>, stop: &mut Stop) -> Result<Stopped, Error> {
    drive(link, stop)
}

/// Makes the requests of `stop` until its end.
fn drive(link: &mut Link<Ling>, stop: &mut Stop) -> Result<Stopped, Error> {
    let clock = Stopwatch::start();
    let mut missing = None;
    loop {
        match stop.poll(clock.now()) {
            Output::Request(request @ Request::SetTorque(_)) => end_stream(link, &request, &clock)?,
            Output::Request(request) => match link.call(&request, |response| response) {
                Ok(Some(Response::Joints(state))) => stop.on_joints(clock.now(), &state),
                Ok(_) => {}
                Err(error) => missing = Some(passing(error)?),
            },
            Output::Wait(until) => {
                link.check_interrupt()?;
                thread::sleep(clock.until(until));
            }
            Output::Done(Ok(stopped)) => return Ok(stopped),
            Output::Done(Err(error)) => {
                let cause = match (error, missing) {
                    (StopError::NoReading, Some(cause)) => cause,
                    (error @ StopError::Unconfirmed { .. }, Some(cause)) => {
                        Text::from(format!("{error}: ")).append(&cause)
                    }
                    (error, _) => error.to_string().into(),
                };
                return Err(not_stopped(link, cause));
            }
        }
    }
}

/// Makes the last request of a stop, and again after an error that may pass. Without it, an adapter takes this host for
/// one that went silent.
fn end_stream(link: &mut Link<Ling>, request: &Request, clock: &Stopwatch) -> Result<(), Error> {
    while let Err(error) = link.send(request) {
        let cause = passing(error)?;
        if clock.now() >= time::Instant::ZERO + Stop::LIMIT {
            return Err(not_stopped(link, cause));
        }
        link.check_interrupt()?;
        thread::sleep(RETRY_PERIOD);
    }
    Ok(())
}

/// The cause in an error that may pass: the next request may succeed, and meanwhile the arm moves on.
///
/// # Errors
///
/// The error, if no later request can succeed.
pub(crate) fn passing(error: Error) -> Result<Text, Error> {
    match error {
        Error::Interrupted(_) | Error::Lost { .. } | Error::Legacy { .. } => Err(error),
        Error::NoAnswer { cause, hint, .. } => Ok(Text::from(format!("{cause}: ")).append(&hint)),
        Error::At { reason, .. } => Ok(reason),
        error => Ok(error.to_string().into()),
    }
}

fn not_stopped(link: &Link<Ling>, cause: Text) -> Error {
    Error::NotStopped {
        name: link.name().into(),
        cause: cause.and("; switch the arm's supply off if it moves"),
    }
}

#[cfg(test)]
mod tests {
    use armwire::ling::{MAX_FRAME, Torque};
    use armwire::messages::Messages;

    use super::*;
    use crate::arm::fake::{self, FakeLine};
    use crate::describe::Arm;

    /// Stops an arm at rest on a line that fails before the first byte of some writes: `fails` returns true for the bytes
    /// and the number of such a write, from 1.
    fn stop_with(fails: fn(&[u8], usize) -> bool) -> Result<Stopped, Error> {
        let mut writes = 0;
        let line = FakeLine::boxed(move |bytes| {
            writes += 1;
            match fails(bytes, writes) {
                true => Err(Error::at("fake", "no")),
                false => Ok(fake::holding(bytes)),
            }
        });
        stop(&mut Link::new(line, Ling::CONFIG), &mut Stop::new(None))
    }

    /// Returns true for the end of a host's stream.
    fn is_torque_on(bytes: &[u8]) -> bool {
        let mut out = [0; MAX_FRAME];
        let n = Ling.encode_request(&Request::SetTorque(Torque::On), &mut out).unwrap();
        bytes == &out[..n]
    }

    #[test]
    fn passing_errors_of_a_line_do_not_end_a_stop() {
        let stopped = stop_with(|_, number| number % 3 == 1);
        assert!(matches!(stopped, Ok(Stopped::AtRest { .. })), "{stopped:?}");
    }

    #[test]
    fn line_that_stays_broken_stops_nothing() {
        let error = stop_with(|_, _| true).unwrap_err();
        assert!(matches!(error, Error::NotStopped { .. }), "{error:?}");
        assert!(error.to_string().starts_with("fake: not stopped: no;"), "{error}");
    }

    #[test]
    fn unsent_end_of_the_stream_is_an_error() {
        let error = stop_with(|bytes, _| is_torque_on(bytes)).unwrap_err();
        assert!(matches!(error, Error::NotStopped { .. }), "{error:?}");
    }
}
