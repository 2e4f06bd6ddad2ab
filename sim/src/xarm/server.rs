//! A virtual xArm on TCP ports, in real time. One thread serves all clients, and no client can block another.

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
pub use port::Port;

mod client;
mod port;
#[cfg(test)]
mod tests;

/// Polling interval of the stop flag.
const POLL_PERIOD: Duration = Duration::from_millis(100);
/// Interval between reports.
const REPORT_PERIOD: Duration = Duration::from_millis(200);
/// Maximum clients of each port. A further client displaces the oldest one without a request, or is rejected. The
/// report port has no requests.
const MAX_CLIENTS: usize = 32;
/// Idle timeout: a client without a request, or one that reads no reports, is disconnected after this time. An idle
/// program of the vendor's SDK sends a request every 30 s.
const IDLE: Duration = Duration::from_secs(300);
/// Pause after a failed accept, for example without free file descriptors.
const ACCEPT_PAUSE: Duration = Duration::from_millis(500);
/// Backlog of unread report bytes, per client, above which further reports are dropped.
const MAX_REPORTS: usize = 8 * REPORT;
/// Time from the answer to a reboot or shutdown to the end of all connections. The vendor's C++ SDK takes the answer
/// only from a connection that is still open.
const CUT_DELAY: Duration = Duration::from_millis(500);
/// Maximum bytes of one read, for fairness between clients.
const READ: usize = 4 * 1024;

/// The ports of a virtual arm, bound and ready for [`serve`](Self::serve).
///
/// There is no authentication, as on a real arm: any client of the control port can move the arm. Bind it to a
/// loopback address unless other computers need access.
#[derive(Debug)]
pub struct Server {
    control: TcpListener,
    report: Option<TcpListener>,
    addresses: (SocketAddr, Option<SocketAddr>),
}

/// A port that could not be bound.
#[derive(Debug)]
pub struct BindError {
    /// The requested address.
    pub address: SocketAddr,
    /// The system's error.
    pub error: io::Error,
}

impl fmt::Display for BindError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "cannot listen on {}: {}", self.address, self.error)
    }
}

impl std::error::Error for BindError {}

/// An event of a server's clients.
#[derive(Debug)]
#[non_exhaustive]
pub enum Notice {
    /// A client connected.
    Connected(SocketAddr, Port),
    /// A client was rejected: the maximum number of clients is connected.
    TooMany(SocketAddr),
    /// A connection was closed for a new client: the oldest one without a request, or the oldest one of the report
    /// port.
    Displaced(SocketAddr),
    /// A connection was closed after 5 minutes without a request, or without a report read.
    Idle(SocketAddr),
    /// The system fails to accept clients. They wait in the backlog, and accepting is retried.
    NotAccepting(io::Error),
    /// A client disconnected.
    Gone(SocketAddr),
    /// A connection was closed: the client sent an invalid frame at this byte offset.
    Broken(SocketAddr, u64, Reason),
    /// A connection failed.
    Lost(SocketAddr, io::Error),
    /// A client rebooted the arm: all connections close half a second later, and new ones are accepted.
    Rebooted(SocketAddr),
    /// A client shut the arm down: all connections close half a second later, and serving ends.
    ShutDown(SocketAddr),
}

impl fmt::Display for Notice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Connected(peer, Port::Control) => write!(f, "{peer}: connected"),
            Self::Connected(peer, Port::Report) => write!(f, "{peer}: connected for reports"),
            Self::TooMany(peer) => write!(f, "{peer}: rejected, {MAX_CLIENTS} clients are connected"),
            Self::Displaced(peer) => write!(f, "{peer}: connection closed without a request, for a new client"),
            Self::Idle(peer) => write!(f, "{peer}: connection closed, idle for {} minutes", IDLE.as_secs() / 60),
            Self::NotAccepting(error) => write!(f, "cannot accept clients, they wait: {error}"),
            Self::Gone(peer) => write!(f, "{peer}: disconnected"),
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

/// Counters of a server.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Served {
    /// Clients that connected, to either port.
    pub clients: u64,
    /// Requests, heartbeats included.
    pub requests: u64,
    /// Frames that are not requests: standard Modbus, parameters unknown to a register, and skipped frames.
    pub unknown: u64,
    /// Connections closed after an invalid frame.
    pub broken: u64,
    /// Reports sent, counted per client.
    pub reports: u64,
    /// Reports dropped because a client did not read.
    pub lost: u64,
}

impl Server {
    /// Binds the control port and, if given, the report port. Port 0 selects any free port.
    ///
    /// # Errors
    ///
    /// [`BindError`] if a port is in use or not permitted.
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

    /// The address of the control port.
    pub fn control_address(&self) -> SocketAddr {
        self.addresses.0
    }

    /// The address of the report port, if any.
    pub fn report_address(&self) -> Option<SocketAddr> {
        self.addresses.1
    }

    /// Serves an arm until `stop` is set, within 100 ms, or a client shuts the arm down. The arm's time zero is now.
    /// `notice` receives each event.
    ///
    /// The requests of a client wait while it does not read its responses. Reports that it does not read in time are
    /// dropped. An invalid frame closes only its own connection.
    ///
    /// Each port accepts up to 32 clients. On the control port, a further client displaces the oldest one without a
    /// request, or is rejected; on the report port it displaces the oldest one. A client is disconnected after 5
    /// minutes without a request, or without a report read. Clients wait while the system cannot accept them, for
    /// example without free file descriptors.
    ///
    /// # Errors
    ///
    /// The system's `poll` failed. Clients cannot cause this.
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
            if service.serve_clients(now) == Some(Cut::Shutdown) {
                break;
            }
            // Connected clients were read first: a client with a pending request is not displaced.
            let now = Instant::now();
            service.accept(&self.control, Port::Control, now);
            if let Some(report) = &self.report {
                service.accept(report, Port::Report, now);
            }
            service.wait(&[Some(&self.control), self.report.as_ref()], until_report)?;
        }
        // Remaining clients get their pending responses.
        while service.closing() {
            service.serve_clients(Instant::now());
            service.wait(&[], POLL_PERIOD)?;
        }
        Ok(service.served)
    }
}

/// An arm and its clients.
struct Service<'a> {
    arm: &'a mut VirtualXArm,
    notice: &'a mut dyn FnMut(Notice),
    start: Instant,
    clients: Vec<Client>,
    /// The time of the next accept, after a failed one.
    accept_again: Option<Instant>,
    served: Served,
}

impl Service<'_> {
    fn now(&self) -> time::Instant {
        time::Instant::from_micros(self.start.elapsed().as_micros().try_into().unwrap_or(u64::MAX))
    }

    /// Accepts one client: a stream of new connections must not block the connected clients.
    fn accept(&mut self, listener: &TcpListener, port: Port, now: Instant) {
        if self.accept_again.is_some_and(|again| now < again) {
            return;
        }
        let (stream, peer) = match listener.accept() {
            Ok(accepted) => accepted,
            // No client waits, or it disconnected before the accept.
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
        if !self.has_place(port, now) {
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

    /// Returns true if a port has a place for a new client. On a full port, displaces the oldest client without a
    /// request.
    fn has_place(&mut self, port: Port, now: Instant) -> bool {
        let there = self.clients.iter_mut();
        let mut there: Vec<_> = there
            .filter(|client| client.port() == port && client.closes_at.is_none())
            .collect();
        if there.len() < MAX_CLIENTS {
            return true;
        }
        // Clients are in the order of connection.
        let has_requested = |client: &&mut &mut Client| port == Port::Control && client.last_active.is_some();
        let Some(silent) = there.iter_mut().find(|client| !has_requested(client)) else {
            return false;
        };
        silent.dismiss(now);
        (self.notice)(Notice::Displaced(silent.peer));
        true
    }

    /// Disconnects clients that exceeded the idle timeout.
    fn dismiss_idle(&mut self, now: Instant) {
        for client in &mut self.clients {
            if client.closes_at.is_none() && client.idle(now) >= IDLE {
                client.dismiss(now);
                (self.notice)(Notice::Idle(client.peer));
            }
        }
    }

    /// Queues a report for every client of the report port.
    fn report(&mut self) {
        let report = self.arm.report(self.now());
        let there = |client: &&mut Client| client.device.is_none() && client.closes_at.is_none();
        for client in self.clients.iter_mut().filter(there) {
            if client.out.len() < MAX_REPORTS {
                client.out.extend(&report);
                self.served.reports += 1;
            } else {
                self.served.lost += 1;
            }
        }
    }

    /// Reads from and responds to every client once. Stops at a reboot or shutdown.
    fn serve_clients(&mut self, now: Instant) -> Option<Cut> {
        let mut clients = mem::take(&mut self.clients);
        let mut cut = None;
        clients.retain_mut(|client| {
            if cut.is_some() {
                return true;
            }
            let outcome = self.read_requests(client, now);
            cut = outcome.as_ref().ok().and_then(|&cut| Some((client.peer, cut?)));
            self.keep(client, outcome.map(drop), now)
        });
        if let Some((peer, cut)) = cut {
            (self.notice)(match cut {
                Cut::Reboot => Notice::Rebooted(peer),
                Cut::Shutdown => Notice::ShutDown(peer),
            });
            clients
                .iter_mut()
                .for_each(|client| client.dismiss_after(CUT_DELAY, now));
        }
        clients.retain_mut(|client| {
            let flushed = client.flush(now);
            self.keep(client, flushed, now)
        });
        self.clients = clients;
        cut.map(|(_, cut)| cut)
    }

    /// Reads a client's requests and queues the responses, up to a reboot or shutdown. A closing client has no more
    /// requests.
    fn read_requests(&mut self, client: &mut Client, now: Instant) -> io::Result<Option<Cut>> {
        let mut bytes = [0; READ];
        let is_closing = client.closes_at.is_some();
        let mut rest = client.read(&mut bytes)?;
        if is_closing {
            return Ok(None);
        }
        if client.ended {
            (self.notice)(Notice::Gone(client.peer));
            client.dismiss(now);
        }
        let at = self.now();
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
                    client.last_active = Some(now);
                    if let Some(answer) = self.arm.answer(at, &request) {
                        queue_response(out, &answer, key);
                    }
                    if let Some(cut) = Cut::by(&request) {
                        return Ok(Some(cut));
                    }
                }
                DeviceEvent::Unknown { error, key, .. } => {
                    self.served.unknown += 1;
                    if let Some(refusal) = self.arm.refuse(at, &error) {
                        queue_response(out, &refusal, key);
                    }
                }
                // A frame of invalid length, or a malformed heartbeat: no key exists for a response.
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
                    client.dismiss(now);
                    return Ok(None);
                }
            }
        }
    }

    /// Returns true if a client stays. Reports a lost connection.
    fn keep(&mut self, client: &Client, outcome: io::Result<()>, now: Instant) -> bool {
        match outcome {
            Ok(()) => !client.is_done(now),
            Err(error) => {
                if client.closes_at.is_none() {
                    (self.notice)(Notice::Lost(client.peer, error));
                }
                false
            }
        }
    }

    fn closing(&self) -> bool {
        self.clients.iter().any(|client| client.closes_at.is_some())
    }

    /// Waits until a client connects, sends bytes or can receive bytes, at most this long.
    fn wait(&self, listeners: &[Option<&TcpListener>], timeout: Duration) -> io::Result<()> {
        let timeout = Timespec::try_from(timeout.min(POLL_PERIOD)).map_err(|_| ErrorKind::InvalidInput)?;
        // Clients that wait to be accepted would end the poll at once.
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

/// A request that ends all connections.
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
fn queue_response(out: &mut VecDeque<u8>, response: &Response<'_>, to: Option<Key>) {
    let mut frame = [0; MAX_FRAME];
    // The buffer has room for any frame.
    let n = XArm::PRIVATE.encode_response(response, to, &mut frame).unwrap_or(0);
    out.extend(&frame[..n]);
}
