//! A host and a device on one line, in virtual time: a whole conversation in no time at all.

use std::fmt;

use armwire::{Client, Config, Event, Input, Micros, Protocol};

use crate::serial::SerialDevice;

/// The device did not answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Silence {
    /// How often it was asked.
    pub sends: u8,
}

impl fmt::Display for Silence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.sends {
            1 => f.write_str("no answer, asked once"),
            sends => write!(f, "no answer, asked {sends} times"),
        }
    }
}

impl std::error::Error for Silence {}

/// A [`Client`] with buffers of `N` bytes, connected to a device by a full-duplex line.
///
/// A byte takes ten bit times each way, rounded up to a microsecond, and the clock jumps from event to event.
///
/// ```
/// use armwire::ling::{Ling, MAX_FRAME, Request, Response, Stroke};
/// use armwire::{Config, Micros};
/// use armwire_sim::ling::LingArm;
/// use armwire_sim::wire::Wire;
///
/// let arm = LingArm::new(armwire_sim::ling::Config::follower());
/// let mut wire = Wire::<Ling, _, MAX_FRAME>::new(Config::default(), arm);
/// assert_eq!(wire.call(Request::ReadStroke), Ok(Some(Response::Stroke(Stroke::Mm50))));
/// assert_eq!(wire.elapsed(), Micros(7 * 10 + 200 + 7 * 10));
/// ```
#[derive(Debug)]
pub struct Wire<P: Protocol, D, const N: usize> {
    client: Client<P, N>,
    device: D,
    now: Micros,
    byte_time: Micros,
    /// The byte on its way to the device, and when it is there.
    to_device: Option<(Micros, u8)>,
    /// The byte on its way to the host, and when it is there.
    to_host: Option<(Micros, u8)>,
    events: Vec<Event<P>>,
}

impl<P: Protocol, D: SerialDevice, const N: usize> Wire<P, D, N> {
    /// A quiet line at time zero, at the configured baud rate.
    pub fn new(config: Config, device: D) -> Self {
        Self {
            client: Client::new(config),
            device,
            now: Micros(0),
            byte_time: Micros(10_000_000_u64.div_ceil(config.baud.get().into())),
            to_device: None,
            to_host: None,
            events: Vec::new(),
        }
    }

    /// Makes one call and returns the answer, if the request gets one, when its last stop bit is over. A request that
    /// gets none is done when the device has all of it.
    ///
    /// # Errors
    ///
    /// [`Silence`] when the client gives up.
    ///
    /// # Panics
    ///
    /// If the client cannot accept the device's answer.
    pub fn call(&mut self, request: P::Request) -> Result<Option<P::Response>, Silence> {
        // Every call runs to its end.
        self.client.submit(request).expect("no request is in flight");
        let mut outcome = None;
        loop {
            for event in self.step(Micros(u64::MAX)) {
                match event {
                    Event::Answer(response) => outcome = Some(Ok(Some(response))),
                    Event::Sent => outcome = Some(Ok(None)),
                    Event::Unacceptable(error) => panic!("the answer to {request:?} cannot be accepted: {error}"),
                    Event::TimedOut { sends } => outcome = Some(Err(Silence { sends })),
                    other => self.events.push(other),
                }
            }
            if self.to_device.is_none()
                && let Some(outcome) = outcome
            {
                return outcome;
            }
        }
    }

    /// Lets time pass without a call.
    pub fn wait(&mut self, span: Micros) {
        let end = self.now + span;
        loop {
            // One step more at the end itself, to let the device know the time.
            let last = self.now == end;
            let events = self.step(end);
            self.events.extend(events);
            if last {
                return;
            }
        }
    }

    /// Virtual time since the start.
    pub fn elapsed(&self) -> Micros {
        self.now
    }

    /// What the client had to say besides the outcome of calls, since this was last asked: noise, late answers, echoes.
    pub fn take_events(&mut self) -> Vec<Event<P>> {
        std::mem::take(&mut self.events)
    }

    /// The device.
    pub fn device(&self) -> &D {
        &self.device
    }

    /// The device.
    pub fn device_mut(&mut self) -> &mut D {
        &mut self.device
    }

    /// Goes to the next instant at which something happens, or to `end`, and returns what the client says to it.
    fn step(&mut self, end: Micros) -> Vec<Event<P>> {
        if self.to_device.is_none()
            && let Some(&byte) = self.client.poll_transmit(self.now).and_then(<[u8]>::first)
        {
            self.client
                .transmitted(self.now, 1)
                .expect("there is a byte to transmit");
            self.to_device = Some((self.now + self.byte_time, byte));
        }
        // While its line is taken the device need not be asked: it says the same later.
        if self.to_host.is_none() {
            let byte = self.device.transmit(self.now);
            self.to_host = byte.map(|byte| (self.now + self.byte_time, byte));
        }
        let device_due = match self.to_host {
            Some((due, _)) => Some(due),
            None => self.device.poll_timeout(),
        };
        let host_due = self.to_device.map(|(due, _)| due);
        // What is due already waits for the line to be free.
        let client_due = self.client.poll_timeout().filter(|due| *due > self.now);
        let due = [host_due, device_due, client_due];
        self.now = due.into_iter().flatten().fold(end, Micros::min).max(self.now);

        if let Some((_, byte)) = self.to_device.take_if(|(due, _)| *due <= self.now) {
            self.device.receive(self.now, byte);
        }
        let byte = self.to_host.take_if(|(due, _)| *due <= self.now).map(|(_, byte)| byte);
        let mut input = Input::Bytes(byte.as_slice());
        std::iter::from_fn(|| self.client.handle(self.now, &mut input)).collect()
    }
}

#[cfg(test)]
mod tests {
    use std::num::NonZeroU32;

    use armwire::ling::{Ling, MAX_FRAME, Request, Response};

    use super::*;
    use crate::faults::{Line, Rates};
    use crate::ling::{self, LingArm};

    fn wire<D: SerialDevice>(baud: u32, device: D) -> Wire<Ling, D, MAX_FRAME> {
        let config = Config {
            baud: NonZeroU32::new(baud).unwrap(),
            ..Config::default()
        };
        Wire::new(config, device)
    }

    #[test]
    fn a_call_takes_the_line_time_of_its_bytes_and_the_turnaround() {
        for (baud, byte_time) in [(1_000_000, 10), (115_200, 87), (2_000_000, 5)] {
            let mut wire = wire(baud, LingArm::new(ling::Config::follower()));
            wire.call(Request::ReadJoints).unwrap();
            assert_eq!(wire.elapsed(), Micros((7 + 21) * byte_time + 200));
        }
    }

    #[test]
    fn a_device_that_hears_nothing_is_reported_as_silent() {
        let deaf = Rates {
            drop: 1_000_000,
            ..Rates::NONE
        };
        let mut wire = wire(
            1_000_000,
            Line::new(LingArm::new(ling::Config::follower()), deaf, Rates::NONE, 1),
        );
        assert_eq!(wire.call(Request::ReadJoints), Err(Silence { sends: 3 }));
        assert_eq!(wire.call(Request::SetZero), Ok(None));
    }

    #[test]
    fn damaged_answers_are_asked_for_again_and_show_as_events() {
        let rates = Rates {
            corrupt: 5_000,
            ..Rates::NONE
        };
        let mut wire = wire(
            1_000_000,
            Line::new(LingArm::new(ling::Config::follower()), Rates::NONE, rates, 1),
        );
        for _ in 0..100 {
            assert!(matches!(wire.call(Request::ReadJoints), Ok(Some(Response::Joints(_)))));
        }
        assert!(wire.device().injected_from_device().corrupted > 5);
        let events = wire.take_events();
        assert!(events.iter().any(|event| matches!(event, Event::Noise(_))));
        assert_eq!(wire.take_events(), []);
    }
}
