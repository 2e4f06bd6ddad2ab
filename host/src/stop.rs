//! Stopping a Ling arm from this computer.

use std::thread;

use armwire::ling::stop::{Output, StopError, Stopped};
use armwire::ling::{Ling, Opening, Response, Stop};

use crate::error::Error;
use crate::link::Link;
use crate::stopwatch::Stopwatch;
use crate::text::Text;

/// Stops a Ling arm and keeps its torque on, as [`Stop`] describes. Takes 2 s at most, and the timeout of one read.
///
/// `gripper` is the last goal of the gripper that the caller has sent. The link's
/// [interrupt](Link::set_interrupt) does not end the stop: an interrupted program calls it.
///
/// # Errors
///
/// [`Error::NotStopped`] if the arm may still move, and errors of the line. A read without a sound answer is repeated.
pub(crate) fn stop(link: &mut Link<Ling>, gripper: Option<Opening>) -> Result<Stopped, Error> {
    link.uninterrupted(|link| drive(link, Stop::new(gripper)))
}

/// As [`stop`], but the link's interrupt ends it, as [`Error::Interrupted`]: the caller has taken the one that the stop
/// is for.
///
/// # Errors
///
/// As [`stop`], and [`Error::Interrupted`].
pub(crate) fn stop_interruptibly(link: &mut Link<Ling>, gripper: Option<Opening>) -> Result<Stopped, Error> {
    drive(link, Stop::new(gripper))
}

/// Makes the requests of `stop` until its end.
fn drive(link: &mut Link<Ling>, mut stop: Stop) -> Result<Stopped, Error> {
    let clock = Stopwatch::start();
    let mut missing = None;
    loop {
        match stop.poll(clock.now()) {
            Output::Request(request) => match link.call(&request, |response| response) {
                Ok(Some(Response::Joints(state))) => stop.on_joints(clock.now(), &state),
                Ok(_) => {}
                Err(Error::NoAnswer { cause, hint, .. }) => {
                    missing = Some(Text::from(format!("{cause}: ")).append(&hint));
                }
                // The next reading may be sound: without a stop the arm moves on.
                Err(error @ (Error::ErrorFrame { .. } | Error::Unacceptable { .. })) => {
                    missing = Some(error.to_string().into());
                }
                Err(error) => return Err(error),
            },
            Output::Wait(until) => {
                link.check_interrupt()?;
                thread::sleep(clock.until(until));
            }
            Output::Done(Ok(stopped)) => return Ok(stopped),
            Output::Done(Err(error)) => {
                let name = link.name().to_owned();
                let cause = match (error, missing) {
                    (StopError::NoReading, Some(cause)) => cause,
                    (error, _) => error.to_string().into(),
                };
                let cause = cause.and("; switch the arm's supply off if it moves");
                return Err(Error::NotStopped { name, cause });
            }
        }
    }
}
