//! When an adapter is asked whether it refuses motion.

use std::time::{Duration, Instant};

use armwire_bridge::control::StopInForce;

use crate::arm::shared::Shared;
use crate::error::Error;
use crate::error::usb_fault::UsbFault;
use crate::ports::control::Adapter;
use crate::ports::port::Connection;

/// The longest time between two moves of a stream.
const STREAM_GAP: Duration = Duration::from_millis(250);
/// Time between two questions within a stream of moves, or within a wait: less than an adapter refuses motion.
const PERIOD: Duration = Duration::from_secs(1);

/// The questions to the adapter on the arm's port.
#[derive(Debug, Default)]
pub(super) struct Refusals {
    /// True if nobody on this port tells.
    is_silent: bool,
    /// The adapter whose control port a reader of this arm has.
    lent: Option<Shared<Adapter>>,
    asked: Option<Instant>,
    moved: Option<Instant>,
}

impl Refusals {
    /// Takes the adapter whose control port a reader has, until the reader ends.
    pub(super) fn lend(&mut self, adapter: Shared<Adapter>) {
        (self.lent, self.is_silent) = (Some(adapter), false);
    }

    /// Asks before a move, unless it goes on with a stream that was asked about within the last second. Returns what
    /// [`ask`](Self::ask) does.
    pub(super) fn before_move(&mut self, connection: &Connection) -> Option<StopInForce> {
        let is_stream = is_within(self.moved.replace(Instant::now()), STREAM_GAP);
        match is_within(self.asked, if is_stream { PERIOD } else { STREAM_GAP }) {
            true => None,
            false => self.ask(connection),
        }
    }

    /// Asks in a wait for a motion, once a second. Returns what [`ask`](Self::ask) does.
    pub(super) fn in_wait(&mut self, connection: &Connection) -> Option<StopInForce> {
        match is_within(self.asked, PERIOD) {
            true => None,
            false => self.ask(connection),
        }
    }

    /// Asks the adapter, and returns the stop for which it refuses motion. One that cannot be asked is not known to.
    pub(super) fn ask(&mut self, connection: &Connection) -> Option<StopInForce> {
        if self.is_silent {
            return None;
        }
        self.asked = Some(Instant::now());
        match self.stop_in_force(connection) {
            Ok(None) => None,
            Ok(stop) => {
                // The next move asks again.
                self.asked = None;
                stop
            }
            // Later it may be free.
            Err(
                Error::InUse { .. }
                | Error::Usb {
                    fault: UsbFault::Busy, ..
                },
            ) => None,
            Err(_) => {
                self.is_silent = true;
                None
            }
        }
    }

    fn stop_in_force(&mut self, connection: &Connection) -> Result<Option<StopInForce>, Error> {
        if let Some(adapter) = &self.lent {
            match adapter.call(Adapter::stop_in_force) {
                Err(Error::Closed { .. }) => self.lent = None,
                told => return told,
            }
        }
        connection.adapter()?.stop_in_force()
    }
}

/// Returns true if less than this time has passed since then.
fn is_within(at: Option<Instant>, time: Duration) -> bool {
    at.is_some_and(|at| at.elapsed() < time)
}

#[cfg(test)]
mod tests {
    use armwire::ling::{GripperSpeed, JOINTS, Move, Opening, Position, Speed};
    use armwire_bridge::control::{FromAdapter, FromHost, Initiator, Reply, Request};

    use super::super::tests::holding;
    use super::*;
    use crate::ports::control::{Received, Transport};

    /// An adapter that was told to stop the arm.
    #[derive(Default)]
    struct Stopped(Option<FromAdapter>);

    impl Transport for Stopped {
        fn name(&self) -> &str {
            "control"
        }

        fn send(&mut self, message: &FromHost) -> Result<(), Error> {
            let reply = match message.request {
                Request::GetStop => Reply::Stop(Some(StopInForce {
                    by: Initiator::Can,
                    left_ms: 1_200,
                })),
                _ => Reply::Done,
            };
            let sequence = message.sequence;
            self.0 = Some(FromAdapter::Reply { sequence, reply });
            Ok(())
        }

        fn receive(&mut self, _: Duration) -> Result<Option<Received>, Error> {
            Ok(self.0.take().map(Ok))
        }

        fn hint(&self) -> String {
            String::new()
        }
    }

    #[test]
    fn adapter_of_a_reader_is_asked_until_the_reader_ends() {
        let mut arm = holding();
        arm.check_refusal().expect("its port has no adapter");
        let adapter = Shared::new("control", Adapter::new(Box::new(Stopped::default())));
        arm.lend_adapter(adapter.clone());
        let text = "fake: motion is refused for 1.2 s more: stopped by a host on CAN";
        assert_eq!(arm.check_refusal().unwrap_err().to_string(), text);
        let hold = Move {
            joints: [(Position::CENTRE, Speed::SLOWEST); JOINTS],
            gripper: (Opening::OPEN, GripperSpeed(1_000)),
        };
        assert_eq!(arm.move_to(&hold).unwrap_err().to_string(), text);
        assert!(!arm.has_moved(), "it was sent");
        drop(adapter.take());
        arm.move_to(&hold).expect("nobody refuses it");
        assert!(arm.has_moved());
    }
}
