//! A client of a virtual xArm's server: its connection, and what it is still to get.

use std::collections::VecDeque;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use armwire::Device;
use armwire::xarm::{MAX_FRAME, XArm};
use rustix::event::PollFlags;
use rustix::net::sockopt::{set_socket_keepalive, set_tcp_keepidle};

use super::Port;

/// With this many bytes of answers waiting for a client, its requests wait too.
const MAX_ANSWERS: usize = 16 * 1024;
/// How long a client is silent before the system asks whether it is still there.
const VANISHED: Duration = Duration::from_secs(60);
/// How long a client that is to go has to take what it is still to get.
const LINGER: Duration = Duration::from_secs(1);

/// A connection.
pub(super) struct Client {
    pub(super) stream: TcpStream,
    pub(super) peer: SocketAddr,
    /// What hears its requests; `None` if it is there for reports.
    pub(super) device: Option<Device<XArm, MAX_FRAME>>,
    /// Where the last frame ends that was skipped.
    pub(super) skipped: u64,
    /// What it is still to get.
    pub(super) out: VecDeque<u8>,
    /// When it last made a request, or took all of its reports.
    pub(super) last_active: Option<Instant>,
    since: Instant,
    /// Nothing more comes from it.
    pub(super) ended: bool,
    /// It is to go: when it has got everything and has gone itself, or at this time. To close a connection on which
    /// bytes wait to be read would lose what is still on the way to the other end.
    pub(super) leaves: Option<Instant>,
}

impl Client {
    pub(super) fn new(stream: TcpStream, peer: SocketAddr, port: Port, now: Instant) -> Self {
        Self {
            stream,
            peer,
            device: (port == Port::Control).then(|| Device::new(XArm::PRIVATE)),
            skipped: 0,
            out: VecDeque::new(),
            last_active: None,
            since: now,
            ended: false,
            leaves: None,
        }
    }

    pub(super) fn port(&self) -> Port {
        match self.device {
            Some(_) => Port::Control,
            None => Port::Report,
        }
    }

    /// How long it has been idle.
    pub(super) fn idle(&self, now: Instant) -> Duration {
        now.saturating_duration_since(self.last_active.unwrap_or(self.since))
    }

    fn is_attended(&self) -> bool {
        self.leaves.is_some() || self.out.len() < MAX_ANSWERS
    }

    /// What it says now, if it is heard.
    pub(super) fn read<'b>(&mut self, bytes: &'b mut [u8]) -> io::Result<&'b [u8]> {
        if self.ended || !self.is_attended() {
            return Ok(&[]);
        }
        let n = match self.stream.read(bytes) {
            Ok(0) => {
                self.ended = true;
                0
            }
            Err(error) if is_nothing_yet(&error) => 0,
            other => other?,
        };
        // What comes from one that is to go is read, but not heard.
        Ok(if self.leaves.is_none() { &bytes[..n] } else { &[] })
    }

    /// Lets it go once it has got everything.
    pub(super) fn dismiss(&mut self) {
        self.leaves.get_or_insert(Instant::now() + LINGER);
    }

    /// Sends what it takes now.
    pub(super) fn flush(&mut self) -> io::Result<()> {
        while !self.out.is_empty() {
            match self.stream.write(self.out.as_slices().0) {
                Ok(n) => drop(self.out.drain(..n)),
                Err(error) if is_nothing_yet(&error) => return Ok(()),
                Err(error) => return Err(error),
            }
        }
        if self.device.is_none() {
            self.last_active = Some(Instant::now());
        }
        if self.leaves.is_some() && !self.ended {
            self.stream.shutdown(Shutdown::Write)?;
        }
        Ok(())
    }

    pub(super) fn is_done(&self) -> bool {
        let Some(leaves) = self.leaves else { return false };
        (self.ended && self.out.is_empty()) || leaves <= Instant::now()
    }

    /// What to wait for.
    pub(super) fn interest(&self) -> PollFlags {
        let mut interest = PollFlags::empty();
        interest.set(PollFlags::IN, !self.ended && self.is_attended());
        interest.set(PollFlags::OUT, !self.out.is_empty());
        interest
    }
}

/// Makes a connection one that never waits, and that fails when the other end has vanished.
pub(super) fn prepare(stream: &TcpStream) -> io::Result<()> {
    stream.set_nonblocking(true)?;
    stream.set_nodelay(true)?;
    set_socket_keepalive(stream, true)?;
    set_tcp_keepidle(stream, VANISHED)?;
    Ok(())
}

pub(super) fn is_nothing_yet(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted)
}
