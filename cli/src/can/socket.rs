//! A CAN interface of Linux (SocketCAN).

use std::fs;
use std::io::{self, ErrorKind};
use std::time::Duration;

use armwire_bridge::can::{Frame, Function, Id, Node};
use socketcan::{CanAnyFrame, CanDataFrame, CanFdSocket, EmbeddedFrame, Socket, SocketOptions, StandardId};

use super::Bus;
use crate::link::is_nothing_yet;
use crate::problem::Problem;

/// How long the interface may take no frame.
const WRITE_TIMEOUT: Duration = Duration::from_millis(500);
/// The least that can be waited for: none at all would mean forever.
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
        self.socket
            .set_read_timeout(wait.max(LEAST))
            .map_err(|error| self.problem(error))?;
        loop {
            let frame = match self.socket.read_frame() {
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
