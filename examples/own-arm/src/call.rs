//! A call: one request, until it has ended.

use core::fmt;
use core::num::NonZeroU32;

use armwire::time::{Duration, Instant};
use armwire::{Client, Config, Event, Output, ParseError, SubmitError};

use crate::sensor::{Angle, Read, Sensor};

/// The client of a sensor.
pub type SensorClient = Client<Sensor, 32>;

/// The timing of the line: 115 200 baud, without USB. A lost answer costs two repeats.
pub const CONFIG: Config = Config {
    baud: NonZeroU32::new(115_200),
    latency: Duration::from_millis(1),
    ..Config::DEFAULT
};

/// A serial port and a clock.
pub trait Port {
    type Error;
    fn now(&self) -> Instant;
    /// Returns the number of bytes that were accepted.
    fn write(&mut self, bytes: &[u8]) -> Result<usize, Self::Error>;
    /// Waits for bytes until this time, or for ever. Returns their number, 0 if none came.
    fn read(&mut self, space: &mut [u8], until: Option<Instant>) -> Result<usize, Self::Error>;
}

/// The reason why a call has no angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CallError<E> {
    /// The request was not sent.
    Refused(SubmitError),
    /// The sensor did not answer.
    Silent,
    /// The answer has an invalid value.
    Unacceptable(ParseError),
    /// The port failed.
    Port(E),
    /// The port returned more bytes than it was offered.
    Overrun,
}

impl<E: fmt::Display> fmt::Display for CallError<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Refused(error) => write!(f, "the request was not sent: {error}"),
            Self::Silent => f.write_str("the sensor does not answer: is it powered, and on this port?"),
            Self::Unacceptable(error) => error.fmt(f),
            Self::Port(error) => error.fmt(f),
            Self::Overrun => f.write_str("the port returned more bytes than it was offered"),
        }
    }
}

/// Reads the angle of a joint.
pub fn read_angle<P: Port>(client: &mut SensorClient, port: &mut P, joint: u8) -> Result<Angle, CallError<P::Error>> {
    client.cancel(); // a call that has failed
    client.submit(&Read { joint }).map_err(CallError::Refused)?;
    loop {
        match client.poll(port.now()) {
            Output::Receive => {
                // Bytes that came before the request, without waiting for more.
                let n = port.read(client.space(), Some(port.now())).map_err(CallError::Port)?;
                client.received(port.now(), n).map_err(|_| CallError::Overrun)?;
            }
            Output::Transmit(bytes) => {
                let n = port.write(bytes).map_err(CallError::Port)?;
                client.transmitted(port.now(), n).map_err(|_| CallError::Overrun)?;
            }
            Output::Timeout(until) => {
                let n = port.read(client.space(), until).map_err(CallError::Port)?;
                client.received(port.now(), n).map_err(|_| CallError::Overrun)?;
            }
            Output::Event(Event::Answer(angle)) => return Ok(angle),
            Output::Event(Event::Unacceptable(error)) => return Err(CallError::Unacceptable(error)),
            Output::Event(Event::TimedOut { .. }) => return Err(CallError::Silent),
            // Noise, an echo, a late answer: the call goes on.
            Output::Event(_) => {}
        }
    }
}
