//! A virtual xArm on TCP ports, in real time: one thread, any clients, none of which can hold up the others.

use std::collections::VecDeque;
use std::fmt;
use std::io::{self, ErrorKind};
use std::mem;
use std::net::{SocketAddr, TcpListener};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use armwire::DeviceEvent;
use armwire::framing::Reason;
use armwire::messages::Messages;
use armwire::time;
use armwire::xarm::{HEADER, Key, MAX_FRAME, Request, Response, XArm};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;

use super::VirtualXArm;
use super::report::REPORT;
use client::{Client, is_nothing_yet, prepare};

mod client;
#[cfg(test)]
mod tests;

/// How long it takes at most to notice the stop flag.
const NOTICE: Duration = Duration::from_millis(100);
/// From one report to the next.
const REPORT_PERIOD: Duration = Duration::from_millis(200);
/// How many clients of one port there may be. A further one takes the place of the oldest that has requested nothing, or
/// is sent away. Nobody requests anything on the report port.
const MAX_CLIENTS: usize = 32;
/// A client without a request for this long is sent away, as is one that takes no reports. An idle program of
/// the vendor's SDK makes one every 30 s.
const IDLE: Duration = Duration::from_secs(300);
/// Pause after the system refused to accept a client, such as for want of file descriptors.
const ACCEPT_PAUSE: Duration = Duration::from_millis(500);
/// With this many bytes of reports waiting for a client, further ones are left out.
const MAX_REPORTS: usize = 8 * REPORT;
/// How many bytes are read from one client before it is the others' turn.
const READ: usize = 4 * 1024;

/// The ports of a virtual arm, bound and ready for [`serve`](Self::serve).
///
/// There is no authentication, as a real arm has none: whoever reaches the control port moves the arm. Bind it to a
/// loopback address unless that is meant.
#[derive(Debug)]
pub struct Server {
    control: TcpListener,
    report: Option<TcpListener>,
    addresses: (SocketAddr, Option<SocketAddr>),
}

/// A port that could not be bound.
#[derive(Debug)]
pub struct BindError {
    /// Which it was to be.
    pub address: SocketAddr,
    /// Why not.
    pub error: io::Error,
}

impl fmt::Display for BindError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "cannot listen on {}: {}", self.address, self.error)
    }
}

impl std::error::Error for BindError {}

/// What a client has connected to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Port {
    /// Requests and answers; a real arm's is 502.
    Control,
    /// Reports; a real arm's is 30002.
    Report,
}

/// What happens to a server's clients, as it happens.
#[derive(Debug)]
#[non_exhaustive]
pub enum Notice {
    /// A client connected.
    Connected(SocketAddr, Port),
    /// There are too many clients, so another was sent away.
    TooMany(SocketAddr),
    /// A client had requested nothing when another needed its place, so its connection is closed. So it is with the oldest
    /// one of the report port, where there are no requests.
    Displaced(SocketAddr),
    /// A client requested nothing, or took no reports, for 5 minutes, so its connection is closed.
    Idle(SocketAddr),
    /// The system refuses to accept clients. They wait, and are accepted as soon as it does.
    NotAccepting(io::Error),
    /// A client went away.
    Gone(SocketAddr),
    /// A client sent, after this many bytes, what cannot be a frame, so its connection is closed.
    Broken(SocketAddr, u64, Reason),
    /// A connection failed.
    Lost(SocketAddr, io::Error),
    /// A client had the arm rebooted, so all connections are closed, and new ones are welcome.
    Rebooted(SocketAddr),
    /// A client had the arm shut down, so all connections are closed, and serving ends.
    ShutDown(SocketAddr),
}

impl fmt::Display for Notice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Connected(peer, Port::Control) => write!(f, "{peer}: connected"),
            Self::Connected(peer, Port::Report) => write!(f, "{peer}: connected for reports"),
            Self::TooMany(peer) => write!(f, "{peer}: sent away, there are {MAX_CLIENTS} clients already"),
            Self::Displaced(peer) => write!(f, "{peer}: connection closed, silent, and another needs its place"),
            Self::Idle(peer) => write!(f, "{peer}: connection closed, idle for {} minutes", IDLE.as_secs() / 60),
            Self::NotAccepting(error) => write!(f, "cannot accept clients, they have to wait: {error}"),
            Self::Gone(peer) => write!(f, "{peer}: gone"),
            Self::Broken(peer, offset, reason) => {
                write!(
                    f,
                    "{peer}: connection closed, not an xArm frame after {offset} bytes: {reason}"
                )
            }
            Self::Lost(peer, error) => write!(f, "{peer}: connection lost: {error}"),
            Self::Rebooted(peer) => write!(f, "{peer}: reboots the arm, all connections closed"),
            Self::ShutDown(peer) => write!(f, "{peer}: shuts the arm down, all connections closed"),
        }
    }
}

/// What was served.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Served {
    /// Clients that connected, to either port.
    pub clients: u64,
    /// Requests, heartbeats included.
    pub requests: u64,
    /// Frames that were no request: standard Modbus, parameters that a register does not have, and what was skipped.
    pub unknown: u64,
    /// Connections that were closed because what came could not be a frame.
    pub broken: u64,
    /// Reports sent, one for each client.
    pub reports: u64,
    /// Reports left out because a client did not read.
    pub lost: u64,
}

impl Server {
    /// Binds the control port and, if there are to be reports, the report port. Port 0 is any that is free.
    ///
    /// # Errors
    ///
    /// [`BindError`] when a port is taken or not allowed.
    pub fn bind(control: SocketAddr, report: Option<SocketAddr>) -> Result<Self, BindError> {
        let bind = |address| -> Result<(TcpListener, SocketAddr), BindError> {
            let bound = TcpListener::bind(address).and_then(|listener| {
                listener.set_nonblocking(true)?;
                let address = listener.local_addr()?;
                Ok((listener, address))
            });
            bound.map_err(|error| BindError { address, error })
        };
        let (control, control_address) = bind(control)?;
        let (report, report_address) = report.map(bind).transpose()?.unzip();
        Ok(Self {
            control,
            report,
            addresses: (control_address, report_address),
        })
    }

    /// Where the control port is.
    pub fn control_address(&self) -> SocketAddr {
        self.addresses.0
    }

    /// Where the report port is, if there is one.
    pub fn report_address(&self) -> Option<SocketAddr> {
        self.addresses.1
    }

    /// Serves an arm, whose time zero is now, until `stop` is set, which it notices within 100 ms, or a client shuts
    /// the arm down. Says what happens as it happens.
    ///
    /// A request that a client sends while it does not read its answers waits; a report that it does not read in time
    /// is left out. What cannot be a frame ends that client's connection and no other.
    ///
    /// Each port has places for 32 clients. If all are taken, a further client takes that of the oldest one without any
    /// request so far, or is sent away; on the report port it takes that of the oldest one. A client without a request for 5 minutes is sent away too, as is one that takes
    /// no reports for so long. Clients that the system does not accept, such as for want of file descriptors, wait.
    ///
    /// # Errors
    ///
    /// When the system refuses to wait: never for what a client does.
    pub fn serve(self, arm: &mut VirtualXArm, stop: &AtomicBool, notice: &mut dyn FnMut(Notice)) -> io::Result<Served> {
        let mut service = Service {
            arm,
            notice,
            start: Instant::now(),
            clients: Vec::new(),
            accept_again: None,
            served: Served::default(),
        };
        let mut next_report = service.start;
        while !stop.load(Ordering::Relaxed) {
            let now = Instant::now();
            service.dismiss_idle(now);
            if next_report <= now {
                next_report = (next_report + REPORT_PERIOD).max(now);
                service.report();
            }
            let until_report = next_report.saturating_duration_since(Instant::now());
            if service.converse() == Some(Cut::Shutdown) {
                break;
            }
            // Those that are there have been heard, so that none with a request loses its place to a further one.
            let now = Instant::now();
            service.accept(&self.control, Port::Control, now);
            if let Some(report) = &self.report {
                service.accept(report, Port::Report, now);
            }
            service.wait(&[Some(&self.control), self.report.as_ref()], until_report)?;
        }
        // Who still lingers gets what was to be said.
        while service.leaving() {
            service.converse();
            service.wait(&[], NOTICE)?;
        }
        Ok(service.served)
    }
}

/// An arm and who talks to it.
struct Service<'a> {
    arm: &'a mut VirtualXArm,
    notice: &'a mut dyn FnMut(Notice),
    start: Instant,
    clients: Vec<Client>,
    /// When to accept again, after the system refused to.
    accept_again: Option<Instant>,
    served: Served,
}

impl Service<'_> {
    fn now(&self) -> time::Instant {
        time::Instant::from_micros(self.start.elapsed().as_micros().try_into().unwrap_or(u64::MAX))
    }

    /// Accepts one client, so that those who come without end do not hold up those who are there.
    fn accept(&mut self, listener: &TcpListener, port: Port, now: Instant) {
        if self.accept_again.is_some_and(|again| now < again) {
            return;
        }
        let (stream, peer) = match listener.accept() {
            Ok(accepted) => accepted,
            // Nobody is there, or it went before we came.
            Err(error) if is_nothing_yet(&error) || error.kind() == ErrorKind::ConnectionAborted => {
                self.accept_again = None;
                return;
            }
            Err(error) => {
                if self.accept_again.replace(now + ACCEPT_PAUSE).is_none() {
                    (self.notice)(Notice::NotAccepting(error));
                }
                return;
            }
        };
        self.accept_again = None;
        if !self.has_place(port) {
            (self.notice)(Notice::TooMany(peer));
            return;
        }
        match prepare(&stream) {
            Ok(()) => {
                self.served.clients += 1;
                (self.notice)(Notice::Connected(peer, port));
                self.clients.push(Client::new(stream, peer, port, now));
            }
            Err(error) => (self.notice)(Notice::Lost(peer, error)),
        }
    }

    /// Whether there is a place for a further client of a port, if need be that of the oldest one without any request.
    fn has_place(&mut self, port: Port) -> bool {
        let there = self.clients.iter_mut();
        let mut there: Vec<_> = there
            .filter(|client| client.port() == port && client.leaves.is_none())
            .collect();
        if there.len() < MAX_CLIENTS {
            return true;
        }
        // The oldest is first.
        let has_requested = |client: &&mut &mut Client| port == Port::Control && client.last_active.is_some();
        let Some(silent) = there.iter_mut().find(|client| !has_requested(client)) else {
            return false;
        };
        silent.dismiss();
        (self.notice)(Notice::Displaced(silent.peer));
        true
    }

    /// Sends away the clients that were idle for too long.
    fn dismiss_idle(&mut self, now: Instant) {
        for client in &mut self.clients {
            if client.leaves.is_none() && client.idle(now) >= IDLE {
                client.dismiss();
                (self.notice)(Notice::Idle(client.peer));
            }
        }
    }

    /// Queues a report for everyone who is there for reports.
    fn report(&mut self) {
        let report = self.arm.report(self.now());
        let there = |client: &&mut Client| client.device.is_none() && client.leaves.is_none();
        for client in self.clients.iter_mut().filter(there) {
            if client.out.len() < MAX_REPORTS {
                client.out.extend(&report);
                self.served.reports += 1;
            } else {
                self.served.lost += 1;
            }
        }
    }

    /// Hears and answers everyone once, or until one cuts the power.
    fn converse(&mut self) -> Option<Cut> {
        let mut clients = mem::take(&mut self.clients);
        let mut cut = None;
        clients.retain_mut(|client| {
            if cut.is_some() {
                return true;
            }
            let heard = self.hear(client);
            cut = heard.as_ref().ok().and_then(|&cut| Some((client.peer, cut?)));
            self.keep(client, heard.map(drop))
        });
        if let Some((peer, cut)) = cut {
            (self.notice)(match cut {
                Cut::Reboot => Notice::Rebooted(peer),
                Cut::Shutdown => Notice::ShutDown(peer),
            });
            clients.iter_mut().for_each(Client::dismiss);
        }
        clients.retain_mut(|client| {
            let flushed = client.flush();
            self.keep(client, flushed)
        });
        self.clients = clients;
        cut.map(|(_, cut)| cut)
    }

    /// Takes what a client says and queues the answers, up to one that cuts the power.
    fn hear(&mut self, client: &mut Client) -> io::Result<Option<Cut>> {
        let mut bytes = [0; READ];
        let mut rest = client.read(&mut bytes)?;
        if client.ended && client.leaves.is_none() {
            (self.notice)(Notice::Gone(client.peer));
            client.dismiss();
        }
        let now = self.now();
        loop {
            let Client {
                device,
                out,
                peer,
                skipped,
                ..
            } = client;
            let Some(device) = device else { return Ok(None) };
            let Some(event) = device.poll() else {
                if rest.is_empty() {
                    return Ok(None);
                }
                rest = device.receive(rest);
                continue;
            };
            match event {
                DeviceEvent::Request { request, key } => {
                    self.served.requests += 1;
                    client.last_active = Some(Instant::now());
                    if let Some(answer) = self.arm.answer(now, &request) {
                        tell(out, &answer, key);
                    }
                    if let Some(cut) = Cut::by(&request) {
                        return Ok(Some(cut));
                    }
                }
                DeviceEvent::Unknown { error, key, .. } => {
                    self.served.unknown += 1;
                    if let Some(refusal) = self.arm.refuse(now, &error) {
                        tell(out, &refusal, key);
                    }
                }
                // A frame that is too long or too short, or a heartbeat that is none: nobody can say to what request.
                DeviceEvent::Noise { offset, bytes, reason } => {
                    if offset >= *skipped {
                        self.served.unknown += 1;
                        let len = match reason {
                            Reason::Length { got, .. } => HEADER + usize::from(got),
                            _ => bytes.len(),
                        };
                        *skipped = offset + len as u64;
                    }
                }
                DeviceEvent::Broken { offset, reason } => {
                    self.served.broken += 1;
                    (self.notice)(Notice::Broken(*peer, offset, reason));
                    client.dismiss();
                    return Ok(None);
                }
            }
        }
    }

    /// Whether a client stays, and why not if that is news.
    fn keep(&mut self, client: &Client, outcome: io::Result<()>) -> bool {
        match outcome {
            Ok(()) => !client.is_done(),
            Err(error) => {
                if client.leaves.is_none() {
                    (self.notice)(Notice::Lost(client.peer, error));
                }
                false
            }
        }
    }

    fn leaving(&self) -> bool {
        self.clients.iter().any(|client| client.leaves.is_some())
    }

    /// Waits until somebody connects, says something or can be told something, at most this long.
    fn wait(&self, listeners: &[Option<&TcpListener>], timeout: Duration) -> io::Result<()> {
        let timeout = Timespec::try_from(timeout.min(NOTICE)).map_err(|_| ErrorKind::InvalidInput)?;
        // Those that have to wait would end the wait at once.
        let accepts = self.accept_again.is_none();
        let listeners = listeners
            .iter()
            .flatten()
            .filter(|_| accepts)
            .map(|&listener| PollFd::new(listener, PollFlags::IN));
        let clients = self
            .clients
            .iter()
            .map(|client| PollFd::new(&client.stream, client.interest()));
        let mut fds = listeners.chain(clients).collect::<Vec<_>>();
        match poll(&mut fds, Some(&timeout)) {
            // A signal may have set the stop flag.
            Ok(_) | Err(Errno::INTR) => Ok(()),
            Err(error) => Err(error.into()),
        }
    }
}

/// What ends all connections.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Cut {
    Reboot,
    Shutdown,
}

impl Cut {
    fn by(request: &Request<'_>) -> Option<Self> {
        match request {
            Request::Reboot => Some(Self::Reboot),
            Request::Shutdown => Some(Self::Shutdown),
            _ => None,
        }
    }
}

/// Queues a response to the request with this key.
fn tell(out: &mut VecDeque<u8>, response: &Response<'_>, to: Option<Key>) {
    let mut frame = [0; MAX_FRAME];
    // The buffer has room for any frame.
    let n = XArm::PRIVATE.encode_response(response, to, &mut frame).unwrap_or(0);
    out.extend(&frame[..n]);
}
