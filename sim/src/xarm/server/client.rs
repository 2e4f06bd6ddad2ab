//! A client of a virtual xArm's server: its connection and its transmit queue.

use std::collections::VecDeque;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use armwire::Device;
use armwire::xarm::{MAX_FRAME, XArm};
use rustix::event::PollFlags;
use socket2::{SockRef, TcpKeepalive};

use super::Port;

/// Backlog of unread response bytes above which a client's requests wait.
const MAX_ANSWERS: usize = 16 * 1024;
/// Idle time before the system sends TCP keep-alive probes.
const KEEP_ALIVE_AFTER: Duration = Duration::from_secs(60);
/// Time for a closing client to read its pending bytes.
const LINGER: Duration = Duration::from_secs(1);

/// A connection.
pub(super) struct Client {
    pub(super) stream: TcpStream,
    pub(super) peer: SocketAddr,
    /// The decoder of its requests; `None` on the report port.
    pub(super) device: Option<Device<XArm, MAX_FRAME>>,
    /// End of the last skipped frame, as a byte offset.
    pub(super) skipped: u64,
    /// Bytes to transmit.
    pub(super) out: VecDeque<u8>,
    /// Time of its last request, or of the last time that it had read all its reports.
    pub(super) last_active: Option<Instant>,
    since: Instant,
    /// The client closed its sending side.
    pub(super) ended: bool,
    /// Deadline of a closing connection. It closes earlier once all bytes are sent and the client has closed its side.
    /// Closing it with unread bytes would reset it and lose the bytes in flight to the client.
    pub(super) closes_at: Option<Instant>,
    /// Time before which a closing connection stays open.
    open_until: Instant,
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
            closes_at: None,
            open_until: now,
        }
    }

    pub(super) fn port(&self) -> Port {
        match self.device {
            Some(_) => Port::Control,
            None => Port::Report,
        }
    }

    /// The time since its last activity.
    pub(super) fn idle(&self, now: Instant) -> Duration {
        now.saturating_duration_since(self.last_active.unwrap_or(self.since))
    }

    fn is_attended(&self) -> bool {
        self.closes_at.is_some() || self.out.len() < MAX_ANSWERS
    }

    /// Reads bytes from the client. Returns none while its requests wait.
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
        // Bytes from a closing client are read and discarded.
        Ok(if self.closes_at.is_none() { &bytes[..n] } else { &[] })
    }

    /// Closes the connection once its pending bytes are sent.
    pub(super) fn dismiss(&mut self, now: Instant) {
        self.dismiss_after(Duration::ZERO, now);
    }

    /// Closes the connection after a delay, once its pending bytes are sent. Its requests are ignored at once.
    pub(super) fn dismiss_after(&mut self, delay: Duration, now: Instant) {
        if self.closes_at.is_none() {
            self.open_until = now + delay;
            self.closes_at = Some(self.open_until + LINGER);
        }
    }

    /// Sends as many bytes as the connection accepts.
    pub(super) fn flush(&mut self, now: Instant) -> io::Result<()> {
        while !self.out.is_empty() {
            match self.stream.write(self.out.as_slices().0) {
                Ok(n) => drop(self.out.drain(..n)),
                Err(error) if is_nothing_yet(&error) => return Ok(()),
                Err(error) => return Err(error),
            }
        }
        if self.device.is_none() {
            self.last_active = Some(now);
        }
        if self.closes_at.is_some() && self.open_until <= now && !self.ended {
            self.stream.shutdown(Shutdown::Write)?;
        }
        Ok(())
    }

    pub(super) fn is_done(&self, now: Instant) -> bool {
        let Some(closes_at) = self.closes_at else { return false };
        (self.ended && self.out.is_empty()) || closes_at <= now
    }

    /// The events to poll for.
    pub(super) fn interest(&self) -> PollFlags {
        let mut interest = PollFlags::empty();
        interest.set(PollFlags::IN, !self.ended && self.is_attended());
        interest.set(PollFlags::OUT, !self.out.is_empty());
        interest
    }
}

/// Makes a connection non-blocking, and enables keep-alive to detect a vanished client.
pub(super) fn prepare(stream: &TcpStream) -> io::Result<()> {
    stream.set_nonblocking(true)?;
    stream.set_nodelay(true)?;
    SockRef::from(stream).set_tcp_keepalive(&TcpKeepalive::new().with_time(KEEP_ALIVE_AFTER))
}

pub(super) fn is_nothing_yet(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted)
}
