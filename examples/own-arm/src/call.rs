//! A call: one request, until it has ended.

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
    fn now(&self) -> Instant;
    /// Returns the number of bytes that were accepted.
    fn write(&mut self, bytes: &[u8]) -> usize;
    /// Waits for bytes until this time, or for ever. Returns their number, 0 if none came.
    fn read(&mut self, space: &mut [u8], until: Option<Instant>) -> usize;
}

/// The reason why a call has no angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CallError {
    /// The request was not sent.
    Refused(SubmitError),
    /// The sensor did not answer.
    Silent,
    /// The answer has an invalid value.
    Unacceptable(ParseError),
    /// The port returned more bytes than it was offered.
    Port,
}

/// Reads the angle of a joint.
pub fn read_angle(client: &mut SensorClient, port: &mut impl Port, joint: u8) -> Result<Angle, CallError> {
    client.cancel(); // a call that has failed
    client.submit(&Read { joint }).map_err(CallError::Refused)?;
    loop {
        match client.poll(port.now()) {
            Output::Receive => {
                // Bytes that came before the request, without waiting for more.
                let n = port.read(client.space(), Some(port.now()));
                client.received(port.now(), n).map_err(|_| CallError::Port)?;
            }
            Output::Transmit(bytes) => {
                let n = port.write(bytes);
                client.transmitted(port.now(), n).map_err(|_| CallError::Port)?;
            }
            Output::Timeout(until) => {
                let n = port.read(client.space(), until);
                client.received(port.now(), n).map_err(|_| CallError::Port)?;
            }
            Output::Event(Event::Answer(angle)) => return Ok(angle),
            Output::Event(Event::Unacceptable(error)) => return Err(CallError::Unacceptable(error)),
            Output::Event(Event::TimedOut { .. }) => return Err(CallError::Silent),
            // Noise, an echo, a late answer: the call goes on.
            Output::Event(_) => {}
        }
    }
}
