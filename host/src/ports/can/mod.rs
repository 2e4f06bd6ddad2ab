//! CAN: the bus of this computer, and the adapters on it, each message one ISO-TP PDU.

mod bus;
mod slcan;
#[cfg(target_os = "linux")]
mod socket;

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, VecDeque};
use std::io::Read;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use armwire_bridge::can::{Frame, Function, Id, Node};
use armwire_bridge::control::{self, FromHost, MAX_FRAME, MAX_MESSAGE};
use armwire_bridge::isotp::{self, Endpoint, Event};
use armwire_bridge::slcan::BitRate;

use crate::error::Error;
use crate::error::text::Text;
use crate::ports::control::{Received, Transport};
use crate::ports::line::{Line, Names, Reception};
use crate::ports::serial::Serial;
use crate::time::stopwatch::{Stopwatch, after};
use bus::Bus;

/// The longest PDU: a message of the control port. Frames of an arm are shorter.
const MAX_PDU: usize = MAX_MESSAGE;
const _: () = assert!(MAX_FRAME <= MAX_PDU);

/// Opens an interface of Linux, `name` to the user, for one node.
#[cfg(target_os = "linux")]
pub(crate) fn open_interface(name: String, interface: &str, node: Node) -> Result<SharedBus, Error> {
    Ok(SharedBus::new(socket::SocketBus::open(name, interface, node)?))
}

/// Reports that CAN interfaces need Linux.
#[cfg(not(target_os = "linux"))]
pub(crate) fn open_interface(name: String, _: &str, _: Node) -> Result<SharedBus, Error> {
    let reason = format!("{name}: only Linux has such CAN interfaces, use slcan: here");
    Err(Error::Port(reason.into()))
}

/// Opens the CAN adapter on a serial port.
pub(crate) fn open_slcan(serial: Serial, bit_rate: BitRate) -> Result<SharedBus, Error> {
    Ok(SharedBus::new(slcan::SlcanBus::open(serial, bit_rate)?))
}

/// Maximum wait for a frame with the bus locked.
const LOCKED: Duration = Duration::from_millis(10);

/// A bus with several channels. Frames that a channel receives for another are queued.
#[derive(Clone)]
pub(crate) struct SharedBus(Arc<Shared>);

struct Shared {
    switch: Mutex<Switch>,
    /// The number of threads that wait for the switch.
    waiting: AtomicUsize,
}

struct Switch {
    bus: Box<dyn Bus>,
    /// The received frames of each channel, by its identifier.
    inboxes: BTreeMap<Id, VecDeque<Frame>>,
}

impl SharedBus {
    fn new(bus: impl Bus + 'static) -> Self {
        let bus = Box::new(bus);
        let inboxes = BTreeMap::new();
        let (switch, waiting) = (Mutex::new(Switch { bus, inboxes }), AtomicUsize::new(0));
        Self(Arc::new(Shared { switch, waiting }))
    }

    /// The bus, for one channel at a time.
    fn lock(&self) -> MutexGuard<'_, Switch> {
        let Shared { switch, waiting } = &*self.0;
        waiting.fetch_add(1, Ordering::Relaxed);
        let switch = switch.lock().unwrap_or_else(PoisonError::into_inner);
        waiting.fetch_sub(1, Ordering::Relaxed);
        switch
    }

    /// Leaves the bus to the threads that wait for it: a thread that unlocks a mutex may lock it again before them.
    fn give_way(&self) {
        while self.0.waiting.load(Ordering::Relaxed) > 0 {
            thread::yield_now();
        }
    }

    fn send(&self, frame: &Frame) -> Result<(), Error> {
        self.lock().bus.send(frame)
    }

    /// The next frame with this identifier, within this time.
    fn receive(&self, id: Id, wait: Duration) -> Result<Option<Frame>, Error> {
        let until = after(wait);
        loop {
            // A stop by another thread does not wait for this line's frame.
            self.give_way();
            let Switch { bus, inboxes } = &mut *self.lock();
            if let Some(frame) = inboxes.get_mut(&id).and_then(VecDeque::pop_front) {
                return Ok(Some(frame));
            }
            // Frames that arrived before the deadline are read after it, too.
            let left = until.saturating_duration_since(Instant::now());
            match bus.receive(left.min(LOCKED))? {
                Some(frame) => {
                    if let Some(inbox) = inboxes.get_mut(&frame.id()) {
                        inbox.push_back(frame);
                    }
                }
                None if left.is_zero() => return Ok(None),
                None => {}
            }
        }
    }

    /// The state of the CAN adapter in words, if it reports errors. It is read from the adapter.
    pub(crate) fn error_state(&self) -> Option<String> {
        let state = self.lock().bus.error_state()?;
        Some(format!("the CAN adapter reports {state}"))
    }

    /// A hint for an adapter that does not reply, after `first`.
    fn hint(&self, first: &str, node: Node) -> String {
        let (node, hint) = (node.get(), self.lock().bus.hint());
        format!("{first}is the adapter on this bus as node {node}, {hint}, and are both its ends terminated?")
    }
}

/// Whole messages to and from an adapter.
pub(crate) struct CanLine {
    /// The name that the user gave it.
    name: String,
    node: Node,
    bus: SharedBus,
    rx: Id,
    endpoint: Endpoint<MAX_PDU, MAX_PDU>,
    /// PDUs received while waiting for another event.
    inbox: VecDeque<Vec<u8>>,
    /// The rest of a PDU that did not fit in the reader's buffer.
    rest: VecDeque<u8>,
    clock: Stopwatch,
}

impl CanLine {
    /// A line that sends requests to `node` as frames of function `tx`, and receives answers as those of `rx`.
    ///
    /// # Errors
    ///
    /// [`Error::InUse`] while the bus has such a line: each would take frames of the other.
    pub(crate) fn new(name: String, bus: &SharedBus, node: Node, tx: Function, rx: Function) -> Result<Self, Error> {
        let rx = rx.id(node);
        match bus.lock().inboxes.entry(rx) {
            Entry::Vacant(inbox) => inbox.insert(VecDeque::new()),
            Entry::Occupied(_) => {
                let (name, user) = (name.into(), "this program, which opened it before".into());
                return Err(Error::InUse { name, user });
            }
        };
        // Every adapter accepts classic frames. Adapters without CAN FD accept no others.
        let config = isotp::Config::new(isotp::Link::Classic, tx.id(node));
        Ok(Self {
            name,
            node,
            bus: bus.clone(),
            rx,
            endpoint: Endpoint::new(config),
            inbox: VecDeque::new(),
            rest: VecDeque::new(),
            clock: Stopwatch::start(),
        })
    }

    /// Sends a PDU, and returns after its last frame.
    fn send_pdu(&mut self, pdu: &[u8]) -> Result<(), Error> {
        self.endpoint.send(pdu).map_err(|error| Error::at(&self.name, error))?;
        let sent = self.send_frames();
        if sent.is_err() {
            // The rest must not go out with a later PDU.
            self.endpoint.abort();
        }
        sent
    }

    /// Sends the frames of a PDU to the last.
    fn send_frames(&mut self) -> Result<(), Error> {
        self.transmit()?;
        while self.endpoint.is_sending() {
            self.step(Duration::from_secs(1))?;
        }
        Ok(())
    }

    /// The next PDU. `None` if none ended within this time.
    fn receive_pdu(&mut self, wait: Duration) -> Result<Option<Vec<u8>>, Error> {
        let until = after(wait);
        loop {
            let left = until.saturating_duration_since(Instant::now());
            self.step(left)?;
            let pdu = self.inbox.pop_front();
            if pdu.is_some() || left.is_zero() {
                return Ok(pdu);
            }
        }
    }

    /// Waits for a frame or for the next work, at most for this time.
    fn step(&mut self, wait: Duration) -> Result<(), Error> {
        let due = [self.endpoint.timeout(), self.endpoint.transmit_at()]
            .into_iter()
            .flatten()
            .min();
        let due = due.map(|due| self.clock.until(due));
        let wait = if self.inbox.is_empty() { wait } else { Duration::ZERO };
        let frame = self.bus.receive(self.rx, due.unwrap_or(wait).min(wait))?;
        let now = self.clock.now();
        let received = frame.map(|frame| self.endpoint.receive(frame.data(), now));
        for event in received.into_iter().flatten().chain(self.endpoint.tick(now)) {
            match event {
                Event::Received | Event::Ignored(_) => {}
                Event::Failed(error) => {
                    let state = self.bus.error_state().map(|state| state + ": ").unwrap_or_default();
                    let hint = self.bus.hint("", self.node);
                    return Err(Error::at(&self.name, format_args!("{error}: {state}{hint}")));
                }
                Event::Refused(error) => {
                    let reason = format_args!("{error}: does another program talk to the adapter?");
                    return Err(Error::at(&self.name, reason));
                }
            }
        }
        if let Some(pdu) = self.endpoint.received() {
            self.inbox.push_back(pdu.to_vec());
            self.endpoint.release();
        }
        self.transmit()
    }

    fn transmit(&mut self) -> Result<(), Error> {
        while let Some(frame) = self.endpoint.transmit(self.clock.now()) {
            self.bus.send(&frame)?;
            self.endpoint.transmitted(self.clock.now());
        }
        Ok(())
    }
}

impl Drop for CanLine {
    fn drop(&mut self) {
        self.bus.lock().inboxes.remove(&self.rx);
    }
}

/// Each message is one PDU.
impl Transport for CanLine {
    fn name(&self) -> &str {
        &self.name
    }

    fn send(&mut self, message: &FromHost) -> Result<(), Error> {
        let mut pdu = [0; MAX_MESSAGE];
        let n = control::encode(message, &mut pdu).expect("room for any message");
        self.send_pdu(&pdu[..n])
    }

    fn receive(&mut self, wait: Duration) -> Result<Option<Received>, Error> {
        Ok(self.receive_pdu(wait)?.map(|pdu| control::decode(&pdu)))
    }

    fn hint(&self) -> String {
        self.bus.hint("", self.node)
    }
}

impl Line for CanLine {
    fn name(&self) -> &str {
        &self.name
    }

    fn read(&mut self, buf: &mut [u8], wait: Duration) -> Result<usize, Error> {
        if self.rest.is_empty() {
            self.rest = self.receive_pdu(wait)?.unwrap_or_default().into();
        }
        self.rest.read(buf).map_err(|error| Error::at(&self.name, error))
    }

    fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
        let n = bytes.len();
        if n > MAX_FRAME {
            let reason = format_args!("{n} bytes in one message, and the adapter takes at most {MAX_FRAME}");
            return Err(Error::at(&self.name, reason));
        }
        self.send_pdu(bytes)?;
        Ok(n)
    }

    fn hint(&self, reception: Reception, _: Names) -> Text {
        match reception {
            Reception::Silence => self.bus.hint("is the arm powered, ", self.node).into(),
            Reception::Garbage => "is the adapter configured for this arm?".into(),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

    use super::*;
    use crate::describe::Protocol;

    /// A bus whose first frame cannot be sent.
    struct Faulty {
        tries: usize,
        sent: Arc<Mutex<Vec<Frame>>>,
        received: VecDeque<Frame>,
    }

    impl Bus for Faulty {
        fn send(&mut self, frame: &Frame) -> Result<(), Error> {
            self.tries += 1;
            if self.tries == 1 {
                return Err(Error::at("fake", "no"));
            }
            self.sent.lock().unwrap().push(*frame);
            Ok(())
        }

        fn receive(&mut self, _: Duration) -> Result<Option<Frame>, Error> {
            Ok(self.received.pop_front())
        }

        fn error_state(&mut self) -> Option<String> {
            unreachable!("nobody asks for it")
        }

        fn hint(&self) -> String {
            String::new()
        }
    }

    #[test]
    fn unsent_request_does_not_replace_the_next() {
        let sent = Arc::default();
        let bus = SharedBus::new(Faulty {
            tries: 0,
            sent: Arc::clone(&sent),
            received: VecDeque::new(),
        });
        let (tx, rx) = (Function::ArmRequest, Function::ArmAnswer);
        let mut line = CanLine::new("fake".to_owned(), &bus, Node::default(), tx, rx).unwrap();
        line.write(&[0; 10]).unwrap_err();
        line.write(&[3, 4, 5]).unwrap();
        let sent = sent.lock().unwrap();
        assert_eq!(sent.len(), 1);
        assert_eq!(sent[0].data()[..4], [3, 3, 4, 5]);
    }

    #[test]
    fn request_that_the_adapter_cannot_take_is_not_sent() {
        let sent = Arc::default();
        let bus = SharedBus::new(Faulty {
            tries: 1,
            sent: Arc::clone(&sent),
            received: VecDeque::new(),
        });
        let (tx, rx) = (Function::ArmRequest, Function::ArmAnswer);
        let mut line = CanLine::new("fake".to_owned(), &bus, Node::default(), tx, rx).unwrap();
        let error = line.write(&[0; MAX_FRAME + 1]).unwrap_err().to_string();
        assert_eq!(error, "fake: 71 bytes in one message, and the adapter takes at most 70");
        assert!(sent.lock().unwrap().is_empty());
    }

    #[test]
    fn hint_asks_no_adapter() {
        let bus = SharedBus::new(Faulty {
            tries: 0,
            sent: Arc::default(),
            received: VecDeque::new(),
        });
        let (tx, rx) = (Function::ArmRequest, Function::ArmAnswer);
        let line = CanLine::new("fake".to_owned(), &bus, Node::default(), tx, rx).unwrap();
        let names = Names {
            arm: "a Ling arm",
            other: ("an Alpha1", Protocol::Alpha1),
        };
        let hint = Line::hint(&line, Reception::Silence, names);
        assert!(
            hint.to_string()
                .starts_with("is the arm powered, is the adapter on this bus as node 0, "),
            "{hint}"
        );
    }

    #[test]
    fn frames_of_a_dropped_channel_are_not_kept() {
        let id = Function::ControlAnswer.id(Node::default());
        let frame = Frame::new(id, &[0; 8]).unwrap();
        let bus = SharedBus::new(Faulty {
            tries: 1,
            sent: Arc::default(),
            received: [frame; 3].into(),
        });
        let line = |tx, rx| CanLine::new("fake".to_owned(), &bus, Node::default(), tx, rx).unwrap();
        let mut arm = line(Function::ArmRequest, Function::ArmAnswer);
        drop(line(Function::ControlRequest, Function::ControlAnswer));
        assert_eq!(arm.read(&mut [0; 8], Duration::ZERO).unwrap(), 0);
        let mut control = line(Function::ControlRequest, Function::ControlAnswer);
        assert!(control.receive(Duration::ZERO).unwrap().is_none());
        assert_eq!(bus.lock().inboxes[&id].len(), 0);
    }

    #[test]
    fn second_line_to_a_port_is_refused() {
        let bus = SharedBus::new(Faulty {
            tries: 1,
            sent: Arc::default(),
            received: VecDeque::new(),
        });
        let line = |tx, rx| CanLine::new("fake".to_owned(), &bus, Node::default(), tx, rx);
        let arm = || line(Function::ArmRequest, Function::ArmAnswer);
        let first = arm().unwrap();
        assert!(matches!(arm(), Err(Error::InUse { .. })));
        assert!(line(Function::ControlRequest, Function::ControlAnswer).is_ok());
        drop(first);
        assert!(arm().is_ok());
    }

    #[test]
    fn message_is_waited_for_without_a_limit() {
        let id = Function::ArmAnswer.id(Node::default());
        let bus = SharedBus::new(Faulty {
            tries: 1,
            sent: Arc::default(),
            received: [Frame::new(id, &[2, 8, 9]).unwrap()].into(),
        });
        let (tx, rx) = (Function::ArmRequest, Function::ArmAnswer);
        let mut line = CanLine::new("fake".to_owned(), &bus, Node::default(), tx, rx).unwrap();
        assert_eq!(line.read(&mut [0; 8], Duration::MAX).unwrap(), 2);
    }

    /// A bus that receives what was sent, as an answer of the arm.
    struct Echo {
        sent: VecDeque<Frame>,
        is_read: Arc<AtomicBool>,
    }

    impl Bus for Echo {
        fn send(&mut self, frame: &Frame) -> Result<(), Error> {
            let id = Function::ArmAnswer.id(Node::default());
            self.sent.push_back(Frame::new(id, frame.data()).unwrap());
            Ok(())
        }

        fn receive(&mut self, _: Duration) -> Result<Option<Frame>, Error> {
            self.is_read.store(true, Ordering::Relaxed);
            Ok(self.sent.pop_front())
        }

        fn error_state(&mut self) -> Option<String> {
            unreachable!("nobody asks for it")
        }

        fn hint(&self) -> String {
            String::new()
        }
    }

    #[test]
    fn line_sends_while_another_waits() {
        let is_read = Arc::new(AtomicBool::new(false));
        let bus = SharedBus::new(Echo {
            sent: VecDeque::new(),
            is_read: Arc::clone(&is_read),
        });
        let line = |tx, rx| CanLine::new("fake".to_owned(), &bus, Node::default(), tx, rx).unwrap();
        let mut arm = line(Function::ArmRequest, Function::ArmAnswer);
        let mut control = line(Function::ControlRequest, Function::ControlAnswer);
        thread::scope(|scope| {
            let read = scope.spawn(|| arm.read(&mut [0; 8], Duration::MAX));
            while !is_read.load(Ordering::Relaxed) {
                thread::yield_now();
            }
            control.send_pdu(&[8, 9]).unwrap();
            assert_eq!(read.join().unwrap().unwrap(), 2);
        });
    }
}
