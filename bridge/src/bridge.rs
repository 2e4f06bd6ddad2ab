//! The two sides of the adapter, wired to each other.

use core::fmt;

use crate::action::Action;
use crate::can::Frame;
use crate::config::{self, Config, Saved};
use crate::control::{Failure, Identity, MAX_FRAME};
use crate::counters::{CanErrors, Counters, UartErrors, count};
use crate::earliest::Earliest;
use crate::hosts::Hosts;
use crate::line::deferred::Deferred;
use crate::line::{Line, PACKET, Transmit};
use crate::line_coding::{LineCoding, UartConfig, UnsupportedCoding};
use crate::rx_ring::RxWait;
use crate::start::Start;
use armwire::time::{Duration, Instant};

/// The adapter between hosts on USB and CAN and an arm's UART.
///
/// Any call may make work due. [`update`](Self::update) returns all of it, and [`timeout`](Self::timeout) the time of the
/// next [`tick`](Self::tick), whenever and as often as they are called.
pub struct Bridge {
    pub(crate) line: Deferred,
    pub(crate) hosts: Hosts,
}

/// An event of the UART.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum UartEvent {
    /// The line has been idle for one byte time after the [received](Bridge::uart_received) bytes: these become due.
    Idle,
    /// Receive errors. The bytes received with them are passed on unchanged.
    Errors(UartErrors),
    /// The UART uses this configuration from now on, as [`Transmit::Configure`] requested. The rest of an unfinished
    /// frame is no longer expected.
    Configured(UartConfig),
}

/// An event of the USB device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum UsbEvent {
    /// The bus was reset, by a new host or the same one. Queued bytes for the last host are dropped and counted as
    /// undelivered. Its accepted bytes still go out.
    Reset,
    /// The host enabled or disabled the adapter's configuration.
    Configured(bool),
    /// The bus was suspended. The queue keeps as many bytes as fit until the host reads again. The line returns to the
    /// arm's rate.
    Suspended,
    /// The host raised or lowered DTR: it opened or closed the port. Bytes from before are dropped when the port opens.
    /// A closed port returns the line to the arm's rate.
    Dtr(bool),
    /// A packet of this length from [`usb_transmit`](Bridge::usb_transmit) was not sent: the host is gone.
    Lost(usize),
}

/// An event of the CAN controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum CanEvent {
    /// Number of handed-over frames that the controller still holds. It sends them in the order of arrival.
    Waiting(u8),
    /// The controller reported errors.
    Errors(CanErrors),
    /// The controller went bus-off. ISO-TP transfers in progress are aborted.
    BusOff,
    /// The controller recovered from bus-off.
    BusOn,
}

/// The work that is due, and the adapter's state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Status {
    /// [`uart_transmit`](Bridge::uart_transmit) has bytes or a configuration.
    pub uart: bool,
    /// The UART must stop transmitting at once: torque-off waits, and the arm cannot read bytes at this rate.
    pub uart_cut: bool,
    /// [`usb_transmit`](Bridge::usb_transmit) has a packet.
    pub usb: bool,
    /// The serial port has room for a packet of the host.
    pub usb_room: bool,
    /// [`control_transmit`](Bridge::control_transmit) has work to do.
    pub control: bool,
    /// The control interface has room for a packet of the host.
    pub control_room: bool,
    /// [`can_transmit`](Bridge::can_transmit) has work to do.
    pub can: bool,
    /// The adapter must switch the torque off if it restarts now: a host streams motion and its timeout would switch
    /// the torque off, or torque-off is in progress. Keep this flag over a restart and pass it on as
    /// [`Start::was_armed`].
    pub is_armed: bool,
    /// The adapter is in [recovery](crate::start).
    pub is_in_recovery: bool,
    /// A host has configured the USB device.
    pub is_attached: bool,
    /// Bytes that passed in both directions, modulo 2³².
    pub passed_bytes: u32,
}

impl Bridge {
    /// An adapter without a USB host, at 1 Mbaud until [`uart_transmit`](Self::uart_transmit) requests another rate.
    ///
    /// `config` is that in flash. An invalid one is replaced by the factory defaults, and counted in
    /// [`config_failures`](Counters::config_failures). On a board [without CAN](Identity::no_can) its settings of the
    /// bus are left out.
    ///
    /// ```
    /// use armwire_bridge::config::Config;
    /// use armwire_bridge::control::Identity;
    /// use armwire_bridge::time::Instant;
    /// use armwire_bridge::{Bridge, Start};
    ///
    /// let start = Start { hard_faults: 1, was_armed: true, ..Start::default() };
    /// let mut bridge = Bridge::new(Identity::default(), Config::default(), start);
    /// assert_eq!(bridge.counters().hard_faults, 1);
    ///
    /// // Zeros end a partial frame in the arm. Torque-off follows them.
    /// let mut sent = vec![];
    /// let mut transmit = || bridge.uart_transmit(&mut [0; 70], Instant::ZERO, |bytes, _| sent.extend_from_slice(bytes));
    /// while transmit().is_some() {}
    /// assert_eq!(sent[..261], [0; 261]);
    /// assert_eq!(sent[261..], [0xAA, 0x05, 0x00, 0x01, 0x00, 0x6F, 0xFF]);
    /// ```
    pub fn new(identity: Identity, config: Config, start: Start) -> Self {
        let mut hosts = Hosts::new(identity, config, start.recovery);
        let counters = hosts.counters_mut();
        counters.panics = start.panics;
        counters.watchdog_resets = start.watchdog_resets;
        counters.hard_faults = start.hard_faults;
        counters.recovery_starts = start.recovery_starts;
        count(&mut counters.config_failures, start.config_lost.into());
        let mut line = Line::new(hosts.config());
        hosts.watch(&mut line);
        if start.was_armed {
            line.restarted_while_armed();
        }
        Self {
            line: Deferred::new(line),
            hosts,
        }
    }

    // ---- The UART ----

    /// Sets the lead time of polls at a set rate over their slots, [`POLL_LEAD_TIME`](crate::POLL_LEAD_TIME) from the
    /// beginning: at least the time from [`timeout`](Self::timeout) to the return of
    /// [`uart_transmit`](Self::uart_transmit), or polls are late. Nothing else is sent meanwhile.
    pub fn set_poll_lead_time(&mut self, lead: Duration) {
        self.line.settled().set_poll_lead_time(lead);
    }

    /// Handles a read of the UART: `bytes` were received, possibly none, and the last of them arrived at `at`, which is
    /// the stamp of the frame that it ends. Returns the number of frames that ended.
    ///
    /// Without an ended frame, only [`usb_transmit`](Self::usb_transmit) can have become due. The last frame is accounted
    /// for by the next call other than `usb_transmit` and [`uart_transmit_ahead`](Self::uart_transmit_ahead), which do not
    /// wait for that.
    pub fn uart_received(&mut self, bytes: &[u8], at: Instant) -> usize {
        let mut frames: usize = 0;
        let mut rest = bytes;
        loop {
            // There is room for the frames of a packet.
            let (packet, later) = rest.split_at(rest.len().min(PACKET));
            make_delivery_room(self.line.settled(), &mut self.hosts, at);
            frames = frames.saturating_add(self.line.received(packet, at));
            if later.is_empty() {
                return frames;
            }
            rest = later;
        }
    }

    /// Handles any other event of the UART. Returns the number of frames that it ended.
    ///
    /// ```
    /// use armwire_bridge::time::Instant;
    /// use armwire_bridge::{Bridge, PACKET, UartEvent, UsbEvent};
    ///
    /// let mut bridge = Bridge::default();
    /// bridge.usb_event(UsbEvent::Configured(true), Instant::ZERO);
    /// bridge.uart_received(b"stray bytes?", Instant::from_micros(100));
    /// assert_eq!(bridge.usb_transmit(&mut [0; PACKET]), None);
    /// bridge.uart_event(UartEvent::Idle, Instant::from_micros(110));
    /// assert_eq!(bridge.usb_transmit(&mut [0; PACKET]), Some(12));
    /// ```
    pub fn uart_event(&mut self, event: UartEvent, now: Instant) -> usize {
        match event {
            UartEvent::Idle => self.line.settled().idle(now),
            UartEvent::Errors(errors) => {
                self.line.settled().errors(&errors);
                0
            }
            UartEvent::Configured(uart) => self.line.settled().uart_configured(uart, now),
        }
    }

    /// Returns true if a frame waits for delivery to CAN or to subscribers. [`can_transmit`](Self::can_transmit) and
    /// [`update`](Self::update) deliver it.
    ///
    /// ```
    /// assert!(!armwire_bridge::Bridge::default().has_delivery()); // no subscriber
    /// ```
    pub fn has_delivery(&mut self) -> bool {
        self.line.settled().has_delivery()
    }

    /// The events that the receiver waits for after the bytes up to now, for [`RxRing::set`](crate::RxRing::set): the end
    /// of the next frame, or a full packet.
    ///
    /// An interrupt handler that sees each byte needs to wake no task before that.
    ///
    /// ```
    /// use armwire_bridge::{Bridge, Instant, RxThreshold, UsbEvent};
    ///
    /// let mut bridge = Bridge::default();
    /// bridge.usb_event(UsbEvent::Configured(true), Instant::ZERO);
    /// let threshold = bridge.rx_wait().threshold;
    /// assert_eq!(threshold, RxThreshold { max: 64, min: 6, terminator: Some(0xFF) });
    /// assert!(threshold.is_met(7, 0xFF) && !threshold.is_met(7, 0xFE));
    /// let frame = [0xAA, 0x05, 0x00, 0x01, 0x01, 0xF9, 0xFF];
    /// bridge.uart_received(&frame[..4], Instant::from_micros(40));
    /// assert_eq!(bridge.rx_wait().threshold, RxThreshold { max: 3, min: 3, terminator: None });
    ///
    /// // After a whole frame an idle line changes nothing. Any other bytes wait for it.
    /// bridge.uart_received(&frame[4..], Instant::from_micros(70));
    /// assert!(!bridge.rx_wait().idle);
    /// bridge.uart_received(b"stray bytes", Instant::from_micros(180));
    /// assert!(bridge.rx_wait().idle);
    /// ```
    pub fn rx_wait(&mut self) -> RxWait {
        let line = self.line.settled();
        RxWait {
            threshold: line.rx_threshold(),
            length: line.rx_length(),
            idle: line.waits_for_idle(),
        }
    }

    /// Gives a UART that is ready its next work: copies the next bytes for the arm to the front of `out`, and passes them
    /// to `send`, which starts to transmit them at once or at [`start`](Transmit::Burst::start); or returns the
    /// configuration that the UART must change to. `None` if nothing is due now.
    ///
    /// The bytes are accounted for after `send`. A DMA that reads them from `out` must have ended before the next call.
    ///
    /// ```
    /// use armwire_bridge::config::{Config, Poll};
    /// use armwire_bridge::control::Identity;
    /// use armwire_bridge::time::Instant;
    /// use armwire_bridge::{Bridge, POLL_LEAD_TIME, Start, Transmit};
    ///
    /// // A poll goes out at its slot, which is on a fixed grid from the first tick on.
    /// let config = Config { poll: Poll::Hertz(100), ..Config::default() };
    /// let mut bridge = Bridge::new(Identity::default(), config, Start::default());
    /// bridge.tick(Instant::from_micros(500));
    /// let slot = Instant::from_micros(10_500);
    /// assert_eq!(bridge.timeout(), Some(slot - POLL_LEAD_TIME));
    /// let burst = bridge.uart_transmit(&mut [0; 70], slot - POLL_LEAD_TIME, |poll, start| {
    ///     assert_eq!((poll.len(), start), (7, Some(slot)));
    /// });
    /// assert_eq!(burst, Some(Transmit::Burst { len: 7, start: Some(slot) }));
    /// ```
    #[must_use = "the UART may have to change its configuration"]
    pub fn uart_transmit(
        &mut self,
        out: &mut [u8; MAX_FRAME],
        now: Instant,
        send: impl FnOnce(&[u8], Option<Instant>),
    ) -> Option<Transmit> {
        self.line.settled().transmit(out, now, send)
    }

    /// As [`uart_transmit`](Self::uart_transmit), but only for a poll that follows the last frame of the arm at once, and
    /// before that frame is accounted for. `send` starts to transmit it and returns the time. Returns true if it did, and
    /// false if only the accounting can tell what is next. `out` gets a copy of the poll, for the accounting.
    #[must_use = "the UART is not ready for another burst if a poll was sent"]
    pub fn uart_transmit_ahead(
        &mut self,
        out: &mut [u8; MAX_FRAME],
        send: impl FnOnce(&'static [u8]) -> Instant,
    ) -> bool {
        let Some(poll) = self.line.next_poll() else {
            return false;
        };
        let now = send(poll);
        // The same poll is chosen now.
        let sent = self
            .line
            .settled()
            .transmit(out, now, |bytes, _| debug_assert_eq!(bytes, poll));
        debug_assert_eq!(
            sent,
            Some(Transmit::Burst {
                len: poll.len(),
                start: None
            })
        );
        true
    }

    // ---- USB ----

    /// Handles an event of the USB device. Returns true if a packet in flight has lost its receiver.
    ///
    /// ```
    /// use armwire_bridge::time::Instant;
    /// use armwire_bridge::{Bridge, PACKET, UartEvent, UsbEvent};
    ///
    /// let mut bridge = Bridge::default();
    /// bridge.usb_event(UsbEvent::Configured(true), Instant::ZERO);
    /// bridge.uart_received(b"old", Instant::ZERO);
    /// assert!(bridge.usb_event(UsbEvent::Dtr(true), Instant::from_micros(50)));
    /// bridge.uart_received(b"new", Instant::from_micros(100));
    /// bridge.uart_event(UartEvent::Idle, Instant::from_micros(200));
    ///
    /// let mut packet = [0; PACKET];
    /// assert_eq!(bridge.usb_transmit(&mut packet), Some(3));
    /// assert_eq!(&packet[..3], b"new");
    /// assert_eq!(bridge.counters().undelivered_bytes, 3);
    /// ```
    pub fn usb_event(&mut self, event: UsbEvent, now: Instant) -> bool {
        match event {
            UsbEvent::Reset => self.line.settled().usb_reset(now),
            UsbEvent::Configured(configured) => self.line.settled().usb_configured(configured, now),
            UsbEvent::Suspended => {
                self.line.settled().usb_suspended(now);
                return false;
            }
            UsbEvent::Dtr(high) => return self.line.settled().dtr(high, now),
            UsbEvent::Lost(len) => {
                self.line.settled().packet_lost(len);
                return false;
            }
        }
        self.hosts.usb_gone(self.line.settled());
        true
    }

    /// Handles a packet of the host on the serial port. Returns true if the next one fits. Leave it in the endpoint
    /// while [`Status::usb_room`] is false: USB flow control then pauses the host.
    pub fn usb_received(&mut self, packet: &[u8], now: Instant) -> bool {
        let line = self.line.settled();
        if line.may_be_taken() {
            // The requests of all others are then refused at once.
            make_delivery_room(line, &mut self.hosts, now);
        }
        line.packet_received(packet, now)
    }

    /// Moves the next packet for the serial port's host into `packet` and returns its length, 0 for a zero-length
    /// packet. `None` if none is due. [`UsbEvent::Lost`] counts a packet that could not be sent.
    #[must_use = "the packet has left the queue"]
    pub fn usb_transmit(&mut self, packet: &mut [u8; PACKET]) -> Option<usize> {
        self.usb_transmit_with(|next| match packet.get_mut(..next.len()) {
            Some(packet) => {
                packet.copy_from_slice(next);
                true
            }
            None => false,
        })
    }

    /// Passes the next packet for the serial port's host to `send`, an empty one as a zero-length packet. It is removed
    /// if `send` returns true, and otherwise stays the next. Returns the length of a packet that was sent.
    ///
    /// ```
    /// use armwire_bridge::{Bridge, Instant, UartEvent, UsbEvent};
    ///
    /// let mut bridge = Bridge::default();
    /// bridge.usb_event(UsbEvent::Configured(true), Instant::ZERO);
    /// bridge.uart_received(b"stray", Instant::ZERO);
    /// bridge.uart_event(UartEvent::Idle, Instant::from_micros(10));
    /// // The endpoint is not ready.
    /// assert_eq!(bridge.usb_transmit_with(|_| false), None);
    /// assert_eq!(bridge.usb_transmit_with(|packet| packet == b"stray"), Some(5));
    /// assert_eq!(bridge.usb_transmit_with(|_| true), None);
    /// ```
    pub fn usb_transmit_with(&mut self, send: impl FnOnce(&[u8]) -> bool) -> Option<usize> {
        self.line.send_packet(send)
    }

    /// Handles SET_LINE_CODING.
    ///
    /// The arm's own line coding takes effect after the bytes already queued. Any other takes effect with the host's
    /// next byte, or after 100 ms if the port is open, unless a host on CAN streams motion.
    ///
    /// # Errors
    ///
    /// [`UnsupportedCoding`], which is counted. The line coding stays unchanged.
    ///
    /// ```
    /// use armwire_bridge::time::Instant;
    /// use armwire_bridge::{Bridge, UnsupportedCoding, Transmit, UartEvent};
    ///
    /// let mut bridge = Bridge::default();
    /// let refused = bridge.set_line_coding([0x00, 0xC2, 0x01, 0x00, 1, 0, 8], Instant::ZERO);
    /// assert_eq!(refused, Err(UnsupportedCoding::StopBits(1)));
    /// assert_eq!(bridge.line_coding().baud, 1_000_000);
    ///
    /// bridge.set_line_coding([0x00, 0xC2, 0x01, 0x00, 0, 0, 8], Instant::ZERO).unwrap();
    /// let mut transmit = |bridge: &mut Bridge| bridge.uart_transmit(&mut [0; 70], Instant::ZERO, |_, _| {});
    /// assert_eq!(transmit(&mut bridge), None);
    /// bridge.usb_received(b"at 115200 baud", Instant::ZERO);
    /// let Some(Transmit::Configure(uart)) = transmit(&mut bridge) else { panic!() };
    /// // Here firmware waits for the last bit to leave, and changes the UART.
    /// bridge.uart_event(UartEvent::Configured(uart), Instant::ZERO);
    /// assert_eq!((uart.coding.baud, bridge.line_coding().baud), (115_200, 115_200));
    /// ```
    pub fn set_line_coding(&mut self, bytes: [u8; 7], now: Instant) -> Result<(), UnsupportedCoding> {
        self.line.settled().set_line_coding(bytes, now)
    }

    /// The last line coding that was accepted, in effect or not.
    pub const fn line_coding(&self) -> LineCoding {
        self.line.line_coding()
    }

    /// Handles a packet of the host on the control interface. Returns true if the next one fits. Leave it in the
    /// endpoint while [`Status::control_room`] is false: USB flow control then pauses the host.
    ///
    /// ```
    /// use armwire_bridge::control::{FromAdapter, FromHost, MAX_COBS, Reader, Reply, Request, encode_cobs};
    /// use armwire_bridge::time::Instant;
    /// use armwire_bridge::{Bridge, PACKET};
    ///
    /// let mut bridge = Bridge::default();
    /// let mut message = [0; MAX_COBS];
    /// let len = encode_cobs(&FromHost { sequence: 7, request: Request::GetConfig }, &mut message).unwrap();
    /// bridge.control_received(&message[..len], Instant::ZERO);
    ///
    /// let mut packet = [0; PACKET];
    /// let len = bridge.control_transmit(&mut packet, Instant::ZERO).unwrap();
    /// let mut reader = Reader::<64>::new();
    /// reader.push(&packet[..len]);
    /// let Some(Ok(FromAdapter::Reply { sequence: 7, reply: Reply::Config(config) })) = reader.next() else { panic!() };
    /// assert_eq!(config, bridge.config());
    /// ```
    pub fn control_received(&mut self, packet: &[u8], now: Instant) -> bool {
        self.hosts.packet_received(packet, self.line.settled(), now)
    }

    /// Moves the next packet of the control interface into `packet` and returns its length, 0 for a zero-length packet.
    /// `None` if none is due, or after one step towards it. More steps follow while [`Status::control`] is true; other
    /// tasks may run in between.
    #[must_use = "the packet has left the queue"]
    pub fn control_transmit(&mut self, packet: &mut [u8; PACKET], now: Instant) -> Option<usize> {
        self.hosts.packet(packet, self.line.settled(), now)
    }

    // ---- The CAN bus ----

    /// Handles a frame from the bus. Frames with the identifiers of other nodes are ignored.
    pub fn can_received(&mut self, frame: &Frame, now: Instant) {
        self.hosts.can_received(frame, self.line.settled(), now);
    }

    /// The next frame for the bus, the most urgent first. `None` if none is due.
    ///
    /// It is for a controller with room: until then a more urgent frame may overtake it here. [`CanEvent::Waiting`] reports
    /// its transmission.
    #[must_use = "the frame has left the queue"]
    pub fn can_transmit(&mut self, now: Instant) -> Option<Frame> {
        self.hosts.can_transmit(self.line.settled(), now)
    }

    /// Handles an event of the CAN controller. Returns true if more work may be due than before.
    ///
    /// ```
    /// use armwire_bridge::time::Instant;
    /// use armwire_bridge::{Bridge, CanErrors, CanEvent};
    ///
    /// let mut bridge = Bridge::default();
    /// bridge.can_event(CanEvent::Errors(CanErrors { bus: 3, overruns: 1, unsent: 2 }), Instant::ZERO);
    /// let c = bridge.counters();
    /// assert_eq!((c.can_bus_errors, c.can_receive_overruns, c.dropped_can_frames), (3, 1, 2));
    /// ```
    pub fn can_event(&mut self, event: CanEvent, now: Instant) -> bool {
        match event {
            CanEvent::Waiting(waiting) => return self.hosts.can_sent(waiting, now),
            CanEvent::Errors(errors) => self.hosts.can_errors(errors),
            CanEvent::BusOff => self.hosts.can_bus_off(true, self.line.settled(), now),
            CanEvent::BusOn => self.hosts.can_bus_off(false, self.line.settled(), now),
        }
        true
    }

    // ---- Time, and actions of firmware ----

    /// Moves pending work to the output buffers and returns the work due at `now` and the adapter's state.
    pub fn update(&mut self, now: Instant) -> Status {
        let line = self.line.settled();
        self.hosts.update(line, now);
        Status {
            uart: line.is_transmit_due(now),
            uart_cut: line.is_cut_due(),
            usb: line.is_packet_due(),
            usb_room: line.has_packet_room(),
            control: self.hosts.is_packet_due(),
            control_room: self.hosts.has_packet_room(),
            can: self.hosts.is_can_due(now),
            is_armed: line.is_armed(),
            is_in_recovery: self.hosts.recovery().is_some(),
            is_attached: line.is_attached(),
            passed_bytes: line.passed_bytes(),
        }
    }

    /// The time of the next [`tick`](Self::tick) unless another event comes first. It may lie in the past. `None` if no
    /// timeout is running.
    pub fn timeout(&mut self) -> Option<Instant> {
        Earliest::of(self.line.settled().timeout())
            .or(self.hosts.timeout())
            .get()
    }

    /// Advances the time to `now`: expires timeouts and makes due work available.
    pub fn tick(&mut self, now: Instant) {
        self.hosts.tick(self.line.settled(), now);
    }

    /// The next action for firmware, returned once.
    #[must_use = "a host waits for the action"]
    pub fn action(&mut self, now: Instant) -> Option<Action> {
        self.hosts.action(self.line.settled(), now)
    }

    /// The result of [`Action::Load`].
    pub fn loaded(&mut self, result: Result<Saved, Failure>, now: Instant) {
        self.hosts.loaded(result, self.line.settled(), now);
    }

    /// The result of [`Action::Save`], [`Action::Reset`], [`Action::Replace`] or [`Action::Erase`].
    pub fn saved(&mut self, result: Result<(), Failure>, now: Instant) {
        self.hosts.saved(result, self.line.settled(), now);
    }

    // ---- State ----

    /// Returns true if bytes for the arm have not moved, or the UART has not been read, for a second. Only a restart
    /// recovers from either. Unread bytes for a host are not considered.
    ///
    /// ```
    /// use armwire_bridge::Bridge;
    /// use armwire_bridge::time::Instant;
    ///
    /// let mut bridge = Bridge::default();
    /// bridge.uart_received(&[], Instant::ZERO);
    /// assert!(!bridge.is_stuck(Instant::from_millis(900)));
    /// assert!(bridge.is_stuck(Instant::from_millis(1_100)));
    /// ```
    pub fn is_stuck(&mut self, now: Instant) -> bool {
        self.line.settled().is_stuck(now)
    }

    /// The configuration in force.
    pub const fn config(&self) -> Config {
        *self.hosts.config()
    }

    /// The configuration of the CAN controller. `None` on a board without one, and in [recovery](crate::start): the
    /// controller stays off, and neither sends nor acknowledges, until [`Action::RestartCan`].
    pub fn can_config(&self) -> Option<config::Can> {
        self.hosts.is_can_on().then_some(self.config().can)
    }

    /// All counts since the start.
    pub fn counters(&mut self) -> Counters {
        self.hosts.all_counters(self.line.settled())
    }
}

/// Delivers frames and events if too few would fit.
fn make_delivery_room(line: &mut Line, hosts: &mut Hosts, now: Instant) {
    // Usually all so far were delivered.
    if !line.has_delivery_room() {
        hosts.update(line, now);
    }
}

/// An adapter without an identity, with the factory defaults.
impl Default for Bridge {
    fn default() -> Self {
        Self::new(Identity::default(), Config::default(), Start::default())
    }
}

impl fmt::Debug for Bridge {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Bridge")
            .field("config", &self.config())
            .field("line", &self.line.state())
            .finish_non_exhaustive()
    }
}
