//! A CAN interface of Linux (SocketCAN).

use std::fs;
use std::io::{self, ErrorKind};
use std::time::{Duration, Instant};

use armwire_bridge::can::{Frame, Function, Id, Node};
use socketcan::{CanAnyFrame, CanDataFrame, CanFdSocket, EmbeddedFrame, Socket, SocketOptions, StandardId};

use super::Bus;
use crate::link::is_nothing_yet;
use crate::problem::Problem;

/// How long the interface may take no frame.
const WRITE_TIMEOUT: Duration = Duration::from_millis(500);
/// The least that a socket can be told to wait: none at all would mean forever.
const LEAST: Duration = Duration::from_micros(1);
/// What Linux calls an interface for CAN (`ARPHRD_CAN`).
const CAN_TYPE: &str = "280";

/// The interfaces that there are.
pub(super) fn interfaces() -> Vec<String> {
    let Ok(entries) = fs::read_dir("/sys/class/net") else {
        return Vec::new();
    };
    let is_can = |name: &String| {
        let kind = fs::read_to_string(format!("/sys/class/net/{name}/type"));
        kind.is_ok_and(|kind| kind.trim() == CAN_TYPE)
    };
    let names = entries
        .flatten()
        .map(|entry| entry.file_name().to_string_lossy().into_owned());
    let mut names: Vec<_> = names.filter(is_can).collect();
    names.sort();
    names
}

/// An interface, for the frames of one node.
pub(super) struct SocketBus {
    name: String,
    socket: CanFdSocket,
    /// What the controller complained of last.
    trouble: Option<String>,
}

impl SocketBus {
    pub(super) fn open(name: String, interface: &str, node: Node) -> Result<Self, Problem> {
        if !interfaces().iter().any(|there| there == interface) {
            let error = ErrorKind::NotFound.into();
            return Err(Problem::CanInterface { name, error });
        }
        match open(interface, node) {
            Ok(socket) => Ok(Self {
                name,
                socket,
                trouble: None,
            }),
            Err(error) => Err(Problem::CanInterface { name, error }),
        }
    }

    /// The next frame of whatever kind, waiting so long for it.
    fn read(&self, wait: Duration) -> io::Result<CanAnyFrame> {
        if wait < LEAST {
            self.socket.set_nonblocking(true)?;
            let frame = self.socket.read_frame();
            self.socket.set_nonblocking(false)?;
            return frame;
        }
        self.socket.set_read_timeout(wait)?;
        self.socket.read_frame()
    }

    fn problem(&self, error: io::Error) -> Problem {
        let name = self.name.clone();
        Problem::CanInterface { name, error }
    }
}

/// An open socket that hears the answers of one node, and of errors.
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
    fn name(&self) -> &str {
        &self.name
    }

    fn send(&mut self, frame: &Frame) -> Result<(), Problem> {
        let id = StandardId::new(frame.id().get()).expect("11 bits");
        let frame = CanDataFrame::new(id, frame.data()).expect("a classic frame");
        self.socket.write_frame(&frame).map_err(|error| self.problem(error))
    }

    fn receive(&mut self, wait: Duration) -> Result<Option<Frame>, Problem> {
        let until = Instant::now() + wait;
        loop {
            // What has come already is heard even when the time is up.
            let frame = match self.read(until.saturating_duration_since(Instant::now())) {
                Ok(frame) => frame,
                Err(error) if is_nothing_yet(&error) => return Ok(None),
                Err(error) => return Err(self.problem(error)),
            };
            let frame = match frame {
                CanAnyFrame::Normal(frame) => id(&frame).and_then(|id| Frame::new(id, frame.data()).ok()),
                CanAnyFrame::Fd(frame) => id(&frame).and_then(|id| Frame::new_fd(id, frame.data()).ok()),
                CanAnyFrame::Remote(_) => None,
                CanAnyFrame::Error(frame) => {
                    self.trouble = Some(frame.into_error().to_string());
                    None
                }
            };
            if frame.is_some() {
                return Ok(frame);
            }
        }
    }

    fn trouble(&mut self) -> Option<String> {
        self.trouble.take()
    }

    fn doubt(&self) -> String {
        "does the interface have the bit rate of the bus ('ip -details link' tells)".to_owned()
    }
}

/// The identifier, if it has 11 bits.
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

    /// A socket that stands for one of an interface, and its other end.
    fn bus() -> (SocketBus, CanFdSocket) {
        let (ours, theirs) = UnixDatagram::pair().unwrap();
        let [socket, interface] = [ours, theirs].map(|end| CanFdSocket::from(OwnedFd::from(end)));
        let name = "can:fake".to_owned();
        let trouble = None;
        (SocketBus { name, socket, trouble }, interface)
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
            "it heard the last error frame before it returned"
        );
    }

    #[test]
    fn what_came_behind_an_error_frame_is_heard_without_a_wait() {
        let (mut bus, interface) = bus();
        let data = CanDataFrame::new(StandardId::new(0x123).unwrap(), &[1, 2]).unwrap();
        interface.write_frame(&bus_off()).unwrap();
        interface.write_frame(&data).unwrap();
        let frame = bus.receive(Duration::ZERO).unwrap().unwrap();
        assert!(bus.trouble().is_some());
        assert_eq!((frame.id().get(), frame.data()), (0x123, &[1, 2][..]));
        assert_eq!(bus.receive(Duration::ZERO).unwrap(), None);
    }
}
