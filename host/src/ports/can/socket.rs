//! A CAN interface of Linux (SocketCAN).

use std::io::{self, ErrorKind};
use std::thread;
use std::time::{Duration, Instant};

use armwire_bridge::can::{Frame, Function, Id, Node};
use rustix::io::Errno;
use socketcan::{CanAnyFrame, CanDataFrame, CanFdSocket, EmbeddedFrame, Socket, SocketOptions, StandardId};

use super::bus::Bus;
use crate::error::Error;
use crate::ports::line::is_nothing_yet;
use crate::ports::system;
use crate::time::stopwatch::after;

/// Timeout of a write to the interface.
const WRITE_TIMEOUT: Duration = Duration::from_millis(500);
/// Time between tries of a write to a full queue: a few frames at 1 Mbit/s.
const QUEUE_PERIOD: Duration = Duration::from_millis(1);
/// The hint for a bus without an acknowledge.
const BUS_STUCK: &str =
    "the bus takes no frames: is there another node on it, at the same bit rate, and are both ends terminated?";
/// Minimum timeout of a socket: zero would mean no timeout.
const MIN_TIMEOUT: Duration = Duration::from_micros(1);

/// An interface, for the frames of one node.
pub(super) struct SocketBus {
    name: String,
    socket: CanFdSocket,
    /// The controller's last error.
    error_state: Option<String>,
}

impl SocketBus {
    pub(super) fn open(name: String, interface: &str, node: Node) -> Result<Self, Error> {
        let interfaces = system::can_interfaces();
        let socket = match interfaces.iter().any(|there| there == interface) {
            true => open(interface, node).map_err(|error| unusable(&name, &error))?,
            false if interfaces.is_empty() => {
                let reason = "no such CAN interface, nor any other: 'ip link' lists the interfaces there are";
                return Err(Error::at(&name, reason));
            }
            false => {
                let reason = format!("no such CAN interface; there are: {}", interfaces.join(", "));
                return Err(Error::at(&name, reason));
            }
        };
        let error_state = None;
        Ok(Self {
            name,
            socket,
            error_state,
        })
    }

    /// The next frame of any kind, within this time.
    fn read(&self, wait: Duration) -> io::Result<CanAnyFrame> {
        if wait < MIN_TIMEOUT {
            self.socket.set_nonblocking(true)?;
            let frame = self.socket.read_frame();
            self.socket.set_nonblocking(false)?;
            return frame;
        }
        self.socket.set_read_timeout(wait)?;
        self.socket.read_frame()
    }
}

/// Returns true if an interface has no room for another frame.
fn is_queue_full(error: &io::Error) -> bool {
    error.raw_os_error() == Some(Errno::NOBUFS.raw_os_error())
}

/// The error of an interface that cannot be used, under the name that the user gave it.
fn unusable(name: &str, error: &io::Error) -> Error {
    let reason = match error.kind() {
        _ if is_queue_full(error) => BUS_STUCK.to_owned(),
        ErrorKind::NetworkDown => {
            let interface = name.strip_prefix("can:").unwrap_or(name);
            let interface = interface.split('/').next().unwrap_or(interface);
            format!("the interface is down: 'sudo ip link set {interface} up type can bitrate 1000000' starts it")
        }
        ErrorKind::WouldBlock | ErrorKind::TimedOut => BUS_STUCK.to_owned(),
        _ => format!("the CAN interface fails: {error}"),
    };
    Error::at(name, reason)
}

/// An open socket that receives the answers of one node, and error frames.
fn open(interface: &str, node: Node) -> io::Result<CanFdSocket> {
    let socket = CanFdSocket::open(interface)?;
    let answers = [Function::ArmAnswer, Function::ControlAnswer].map(|function| function.id(node));
    let filters = answers.map(|id| (u32::from(id.get()), u32::from(Id::MAX.get())));
    socket.set_filters(&filters)?;
    socket.set_error_filter_accept_all()?;
    socket.set_write_timeout(WRITE_TIMEOUT)?;
    Ok(socket)
}

impl Bus for SocketBus {
    fn send(&mut self, frame: &Frame) -> Result<(), Error> {
        let id = StandardId::new(frame.id().get()).expect("11 bits");
        let frame = CanDataFrame::new(id, frame.data()).expect("a classic frame");
        let until = Instant::now() + WRITE_TIMEOUT;
        loop {
            match self.socket.write_frame(&frame) {
                Ok(()) => return Ok(()),
                // The interface's queue is full. The socket does not wait for it.
                Err(error) if is_queue_full(&error) && Instant::now() < until => thread::sleep(QUEUE_PERIOD),
                Err(error) => return Err(unusable(&self.name, &error)),
            }
        }
    }

    fn receive(&mut self, wait: Duration) -> Result<Option<Frame>, Error> {
        let until = after(wait);
        loop {
            // Frames that arrived before the deadline are read after it, too.
            let frame = match self.read(until.saturating_duration_since(Instant::now())) {
                Ok(frame) => frame,
                Err(error) if is_nothing_yet(&error) => return Ok(None),
                Err(error) => return Err(unusable(&self.name, &error)),
            };
            let frame = match frame {
                CanAnyFrame::Normal(frame) => id(&frame).and_then(|id| Frame::new(id, frame.data()).ok()),
                CanAnyFrame::Fd(frame) => id(&frame).and_then(|id| Frame::new_fd(id, frame.data()).ok()),
                CanAnyFrame::Remote(_) => None,
                CanAnyFrame::Error(frame) => {
                    self.error_state = Some(frame.into_error().to_string());
                    None
                }
            };
            if frame.is_some() {
                return Ok(frame);
            }
        }
    }

    fn error_state(&mut self) -> Option<String> {
        self.error_state.take()
    }

    fn hint(&self) -> String {
        "does the interface have the bit rate of the bus ('ip -details link' shows it)".to_owned()
    }
}

/// The identifier if it has 11 bits.
fn id(frame: &impl EmbeddedFrame) -> Option<Id> {
    match frame.id() {
        socketcan::Id::Standard(id) => Id::new(id.as_raw()).ok(),
        socketcan::Id::Extended(_) => None,
    }
}

#[cfg(test)]
mod tests {
    use std::os::fd::OwnedFd;
    use std::os::unix::net::UnixDatagram;
    use std::thread;

    use socketcan::CanErrorFrame;

    use super::*;

    /// A pair of sockets, one in place of an interface.
    fn bus() -> (SocketBus, CanFdSocket) {
        let (ours, theirs) = UnixDatagram::pair().unwrap();
        let [socket, interface] = [ours, theirs].map(|end| CanFdSocket::from(OwnedFd::from(end)));
        let name = "can:fake".to_owned();
        let error_state = None;
        (
            SocketBus {
                name,
                socket,
                error_state,
            },
            interface,
        )
    }

    /// The controller is off the bus.
    fn bus_off() -> CanErrorFrame {
        CanErrorFrame::new_error(0x40, &[]).unwrap()
    }

    #[test]
    fn error_frames_do_not_prolong_the_wait() {
        let (mut bus, interface) = bus();
        let controller = thread::spawn(move || {
            (0..1000).any(|_| {
                thread::sleep(Duration::from_millis(20));
                interface.write_frame(&bus_off()).is_err()
            })
        });
        assert_eq!(bus.receive(Duration::from_millis(100)).unwrap(), None);
        drop(bus);
        assert!(
            controller.join().unwrap(),
            "it received the last error frame before it returned"
        );
    }

    #[test]
    fn data_behind_an_error_frame_arrives_at_once() {
        let (mut bus, interface) = bus();
        let data = CanDataFrame::new(StandardId::new(0x123).unwrap(), &[1, 2]).unwrap();
        interface.write_frame(&bus_off()).unwrap();
        interface.write_frame(&data).unwrap();
        let frame = bus.receive(Duration::ZERO).unwrap().unwrap();
        assert!(bus.error_state().is_some());
        assert_eq!((frame.id().get(), frame.data()), (0x123, &[1, 2][..]));
        assert_eq!(bus.receive(Duration::ZERO).unwrap(), None);
    }
}
