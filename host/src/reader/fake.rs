//! An adapter that sends scripted events, for tests.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use armwire::ling::{JointState, Ling as Protocol, MAX_FRAME, MotionStatus, Response};
use armwire::messages::Messages;
use armwire_bridge::config::Config;
use armwire_bridge::control::{Event, FrameBytes, FromAdapter, FromHost, Reply, Request, Stamp};

use crate::error::Error;
use crate::ports::control::{Adapter, Received, Transport};

/// An adapter with this configuration. To each subscription it sends one group of these messages, then nothing. It
/// is lost after the last.
struct Scripted {
    config: Arc<Mutex<Config>>,
    reply: Option<FromAdapter>,
    events: VecDeque<FromAdapter>,
    later: VecDeque<Vec<FromAdapter>>,
}

impl Transport for Scripted {
    fn name(&self) -> &str {
        "fake"
    }

    fn send(&mut self, message: &FromHost) -> Result<(), Error> {
        let reply = match message.request {
            Request::GetConfig => Reply::Config(*self.config.lock().unwrap()),
            Request::SetConfig(config) => {
                *self.config.lock().unwrap() = config;
                Reply::Done
            }
            Request::Subscribe(to) if to.frames => {
                self.events = self.later.pop_front().unwrap_or_default().into();
                Reply::Done
            }
            _ => Reply::Done,
        };
        let sequence = message.sequence;
        self.reply = Some(FromAdapter::Reply { sequence, reply });
        Ok(())
    }

    fn receive(&mut self, _: Duration) -> Result<Option<Received>, Error> {
        match self.reply.take().or_else(|| self.events.pop_front()) {
            Some(message) => Ok(Some(Ok(message))),
            None if self.later.is_empty() => Err(Error::lost("fake", "gone")),
            None => Ok(None),
        }
    }

    fn hint(&self) -> String {
        String::new()
    }
}

pub(super) fn state(ticks: u16) -> JointState {
    JointState {
        joints: [ticks; 6],
        gripper: 0,
        status: MotionStatus::Locked,
    }
}

/// A frame at this time in µs.
pub(super) fn frame(micros: u64, response: &Response) -> FromAdapter {
    let mut out = [0; MAX_FRAME];
    let n = Protocol.encode_response(response, None, &mut out).unwrap();
    let bytes = FrameBytes::from_slice(&out[..n]).unwrap();
    let event = Event::Frame { initiator: None, bytes };
    let at = Stamp(micros);
    FromAdapter::Event { at, event }
}

pub(super) fn adapter(config: &Arc<Mutex<Config>>, events: impl IntoIterator<Item = Vec<FromAdapter>>) -> Adapter {
    Adapter::new(Box::new(Scripted {
        config: Arc::clone(config),
        reply: None,
        events: VecDeque::new(),
        later: events.into_iter().collect(),
    }))
}
