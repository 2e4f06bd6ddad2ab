//! A Ling arm on a port, and the adapter in front of it, for the other programs of this project.

use std::fmt;
use std::time::Duration;

use armwire::ling::{Ling, Request, Response};
use armwire_bridge::control::{self, Event, Reply, Stamp};

use crate::control::ControlLink;
use crate::error::Error;
use crate::legacy;
use crate::link::Link;
use crate::port::Port;

/// The address of a Ling arm: its port, and its adapter's control port where that cannot be found from the arm's.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LingAddress {
    port: Port,
    control: Option<Port>,
}

impl LingAddress {
    /// Reads the ports as they are typed for `armwire`: a serial port, `tcp:HOST:PORT`, `slcan:PORT@BITRATE/NODE` or
    /// `can:IFACE/NODE`; and `control:PORT` for the control port.
    ///
    /// # Errors
    ///
    /// The port that is none, and why.
    pub fn new(port: &str, control: Option<&str>) -> Result<Self, String> {
        Ok(Self {
            port: port.parse()?,
            control: control.map(Port::of_control).transpose()?,
        })
    }

    /// Opens the arm's port, and the control port of an adapter that is there. An arm of the older generation is refused.
    ///
    /// # Errors
    ///
    /// The port that cannot be opened, and why.
    pub fn open(&self) -> Result<LingPort, PortError> {
        let connection = self.port.connect(None)?;
        let control = match &self.control {
            Some(port) => Some(port.connect(None)?.control()?),
            None => match connection.control() {
                Ok(control) => Some(control),
                Err(Error::NoControl { .. }) => None,
                Err(error) => return Err(error.into()),
            },
        };
        let link = legacy::open(&connection)?;
        Ok(LingPort { link, control })
    }
}

/// The arm's port.
impl fmt::Display for LingAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.port.fmt(f)
    }
}

/// An open port with a Ling arm.
pub struct LingPort {
    link: Link<Ling>,
    control: Option<ControlLink>,
}

impl LingPort {
    /// Makes one call to the arm. `None` for requests without an answer.
    ///
    /// # Errors
    ///
    /// No answer, one that cannot be accepted, or a port that is gone.
    pub fn call(&mut self, request: &Request) -> Result<Option<Response>, PortError> {
        Ok(self.link.call(request, |response| response)?)
    }

    /// Returns true if there is an adapter with a control port.
    pub fn has_adapter(&self) -> bool {
        self.control.is_some()
    }

    /// Makes one request to the adapter. `None` where there is none.
    ///
    /// # Errors
    ///
    /// No answer, one that says that it was not done, or a port that is gone.
    pub fn control(&mut self, request: control::Request) -> Result<Option<Reply>, PortError> {
        let reply = self.control.as_mut().map(|control| control.call(request));
        Ok(reply.transpose()?)
    }

    /// The next event of the adapter, [subscribed](control::Request::Subscribe) to before, waiting so long for it. `None` at
    /// once where there is no adapter.
    ///
    /// # Errors
    ///
    /// A message that cannot be read, or a port that is gone.
    pub fn next_event(&mut self, wait: Duration) -> Result<Option<(Stamp, Event)>, PortError> {
        match &mut self.control {
            Some(control) => Ok(control.next_event(wait)?),
            None => Ok(None),
        }
    }
}

/// An error at a port, in one line that says what to do.
#[derive(Debug, thiserror::Error)]
#[error(transparent)]
pub struct PortError(#[from] Error);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_port_may_be_a_bare_path() {
        let bare = LingAddress::new("/tmp/arm", Some("/tmp/control")).unwrap();
        assert_eq!(
            bare,
            LingAddress::new("/tmp/arm", Some("control:/tmp/control")).unwrap()
        );
        assert_eq!(bare.to_string(), "/tmp/arm");
    }

    #[test]
    fn port_that_is_none_is_refused() {
        let error = LingAddress::new("can:can0/16", None).unwrap_err();
        assert_eq!(error, "node id is 16, must be 0..=15");
    }
}
