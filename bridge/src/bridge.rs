//! The adapter's state, and what each event on the hosts' side does to it.

use core::fmt;

use crate::{Duration, Instant};
use heapless::Deque;

use crate::arm::Tap;
use crate::can::Frame;
use crate::can_port::{CanPort, Received};
use crate::config::{self, Config};
use crate::control::{Event, Failure, Identity, Initiator, Latencies, MAX_FRAME, Refusal, Stamp};
use crate::control_server::{ControlServer, Port};
use crate::counters::count;
use crate::earliest::Earliest;
use crate::exchange::Exchange;
use crate::line_rate::LineRate;
use crate::line_share::Unshared;
use crate::poll::Poll;
use crate::queue::Queue;
use crate::stream::Stream;
use crate::turn::{Turn, Waiting};
use crate::usb::HostPort;
use crate::{Counters, LineCoding, Refused};

/// Bytes in a full USB packet (full speed, bulk).
pub const PACKET: usize = 64;

/// Room for bytes from the arm that the host on USB has not read yet: 20 ms of a saturated 1 Mbaud line.
pub const TO_HOST_BUFFER: usize = 2048;

/// Room for bytes of the host on USB that have not gone out yet: enough to keep a 2 Mbaud line busy while USB brings
/// more.
pub const TO_ARM_BUFFER: usize = 512;

const _: () = assert!(
    TO_HOST_BUFFER >= 2 * PACKET && TO_ARM_BUFFER >= PACKET,
    "a queue is shorter than the packets it must hold"
);

/// How long bytes for the arm may wait, or the UART go unread, before the adapter counts as stuck.
const PATIENCE: Duration = Duration::from_millis(1_000);

/// How long a motion of a host on CAN may wait for its turn before the host can count as silent.
const MOTION_WAIT: Duration = Duration::from_millis(150);

/// Requests from CAN that wait for their turn.
const CAN_REQUESTS: usize = 2;

/// The adapter between hosts on USB and CAN and an arm's UART.
///
/// Nobody has to poll: after each call, ask what is due, and when [`tick`](Self::tick) wants to be called.
pub struct Bridge {
    // ---- The line to the arm, see line_share.rs ----
    /// Listens in on what the arm says.
    pub(crate) tap: Tap,
    /// How many bytes at the front of what the tap has not decided on were passed to the host on USB already.
    pub(crate) passed: usize,
    /// The last frame, if only the host on USB was told of it so far.
    pub(crate) unshared: Option<Unshared>,
    pub(crate) exchange: Exchange,
    pub(crate) turn: Turn,
    pub(crate) poll: Poll,
    pub(crate) rate: LineRate,
    /// Whether polls and CAN are being refused because the host on USB holds the line.
    pub(crate) is_held: bool,
    /// When the UART was last looked at.
    pub(crate) last_rx_poll: Instant,
    /// When the arm was last heard.
    pub(crate) last_rx: Instant,

    // ---- The hosts ----
    pub(crate) port: HostPort,
    /// Bytes from the host on USB.
    pub(crate) down: Queue<TO_ARM_BUFFER>,
    /// Listens in on what the host on USB says to the arm, as it goes out.
    pub(crate) asks: Tap,
    pub(crate) can: CanPort,
    /// The bus is to be another one than `can` is on, by request of a host there.
    pub(crate) can_change: Option<Port>,
    pub(crate) can_requests: Deque<Waiting, CAN_REQUESTS>,
    pub(crate) command: Option<Waiting>,
    /// Since when the torque is to be switched off.
    pub(crate) torque_off: Option<Instant>,
    /// Since when somebody wants to know what arm there is.
    pub(crate) identify: Option<Instant>,
    pub(crate) streams: Streams,
    pub(crate) control: ControlServer,

    pub(crate) config: Config,
    pub(crate) counters: Counters,
    pub(crate) latencies: Latencies,
}

/// Who may stream motion.
#[derive(Default)]
pub(crate) struct Streams {
    pub(crate) usb: Stream,
    pub(crate) can: Stream,
    pub(crate) command: Stream,
}

impl Streams {
    pub(crate) const INITIATORS: [Initiator; 3] = [Initiator::Usb, Initiator::Can, Initiator::Command];

    pub(crate) const fn of(&mut self, initiator: Initiator) -> Option<&mut Stream> {
        match initiator {
            Initiator::Usb => Some(&mut self.usb),
            Initiator::Can => Some(&mut self.can),
            Initiator::Command => Some(&mut self.command),
            Initiator::Poll | Initiator::Adapter => None,
        }
    }

    /// Whether anybody streams motion.
    pub(crate) const fn is_armed(&self) -> bool {
        self.usb.is_armed() || self.is_armed_on_can()
    }

    /// Whether a host on CAN does.
    const fn is_armed_on_can(&self) -> bool {
        self.can.is_armed() || self.command.is_armed()
    }
}

/// What the UART must receive before anything can be due, an idle line and errors aside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct RxThreshold {
    /// So many bytes, at least 1, whatever they are.
    pub max: usize,
    /// Or at least so many, if the last of them is `terminator`.
    pub min: usize,
    /// The byte with which the next frame ends. `None` if that is not known, or it is known how many bytes are missing.
    pub terminator: Option<u8>,
}

impl RxThreshold {
    /// Whether it takes no more than these `bytes`, of which the last is `last`.
    pub fn is_met(&self, bytes: usize, last: u8) -> bool {
        bytes >= self.max || bytes >= self.min && self.terminator == Some(last)
    }
}

/// Bytes for the arm that [`Bridge::uart_transmit`] gave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Burst {
    /// How many, at least 1.
    pub len: usize,
    /// When the first is to start, [`POLL_LEAD_TIME`] away at most: wait for it, and send nothing in between. `None`: at once.
    pub start: Option<Instant>,
}

/// How long before its slot a poll is handed over, so that nothing else that runs makes it late.
pub const POLL_LEAD_TIME: Duration = Duration::from_micros(25);

/// What the CAN controller had to complain of since it was last asked.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct CanErrors {
    /// Errors on the bus.
    pub bus: u32,
    /// Times frames were lost because they were not taken in time.
    pub overruns: u32,
    /// Frames that it was handed and had not sent when it was set up anew.
    pub unsent: u32,
}

/// What only firmware can do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Action {
    /// Write this configuration to flash, then call [`Bridge::saved`].
    Save(Config),
    /// Forget the configuration in flash, then call [`Bridge::saved`].
    Reset,
    /// Start again, once the reply is with the host: wait 100 ms.
    Restart,
    /// Start the chip's own boot loader, in the same way.
    RestartIntoBootLoader,
    /// Set up the CAN controller anew.
    RestartCan(config::Can),
}

impl Bridge {
    /// An adapter that no host has found yet, at 1 Mbaud until [`line_change`](Self::line_change) says otherwise. It is
    /// configured as from the factory if it cannot be as `config` says.
    pub fn new(identity: Identity, config: Config) -> Self {
        let control = ControlServer::new(identity);
        let config = match control.check(&config) {
            Ok(()) => config,
            Err(_) => Config::default(),
        };
        Self {
            tap: Tap::new(),
            passed: 0,
            unshared: None,
            exchange: Exchange::new(),
            turn: Turn::new(),
            poll: Poll::new(config.poll),
            rate: LineRate::new(config.arm),
            is_held: false,
            last_rx_poll: Instant::ZERO,
            last_rx: Instant::ZERO,
            port: HostPort::new(),
            down: Queue::new(),
            asks: Tap::new(),
            can: CanPort::new(config.can),
            can_change: None,
            can_requests: Deque::new(),
            command: None,
            torque_off: None,
            identify: None,
            streams: Streams::default(),
            control,
            config,
            counters: Counters::default(),
            latencies: Latencies::default(),
        }
    }

    /// What has been seen, lost and refused so far.
    pub const fn counters(&self) -> Counters {
        self.counters
    }

    // ---- The serial port on USB ----

    /// The host enabled or disabled the adapter's configuration.
    pub fn usb_configured(&mut self, configured: bool) {
        self.port.configured(configured, &mut self.counters);
        self.rate.reset(self.down.len());
        self.forget_usb();
        self.follow_holder(self.last_rx_poll);
    }

    /// The USB bus was reset: a new host, or the same one anew.
    ///
    /// What the arm said to the last host is dropped and counted as unheard. What the last host said to the arm still
    /// goes out: it was accepted.
    pub fn usb_reset(&mut self) {
        count(&mut self.counters.usb_resets, 1);
        self.usb_configured(false);
    }

    /// The USB bus was suspended. The queue keeps what fits until the host reads again. The line becomes the arm's.
    pub fn usb_suspended(&mut self) {
        count(&mut self.counters.usb_suspends, 1);
        self.rate.release(self.down.len());
        self.follow_holder(self.last_rx_poll);
    }

    /// The host raised or lowered DTR: it opened or closed the port.
    ///
    /// A host that opens the port does not get bytes from before. The line of a port that is closed is the arm's. Returns
    /// whether it was opened or closed by this: a packet on its way is then for nobody.
    ///
    /// ```
    /// use armwire_bridge::{Bridge, Instant, PACKET};
    ///
    /// let mut bridge = Bridge::default();
    /// bridge.usb_configured(true);
    /// bridge.uart_received(b"old", Instant::ZERO);
    /// bridge.usb_dtr(true, Instant::from_micros(50));
    /// bridge.uart_received(b"new", Instant::from_micros(100));
    /// bridge.uart_idle(Instant::from_micros(200));
    ///
    /// let mut packet = [0; PACKET];
    /// assert_eq!(bridge.usb_transmit(&mut packet), Some(3));
    /// assert_eq!(&packet[..3], b"new");
    /// assert_eq!(bridge.counters().unheard_bytes, 3);
    /// ```
    pub fn usb_dtr(&mut self, high: bool, now: Instant) -> bool {
        if self.is_attached() {
            self.rate.dtr(high, self.down.len(), now);
            self.follow_holder(now);
        }
        self.port.dtr(high, &mut self.counters)
    }

    /// Whether the next packet from the host may be taken. If not, leave it: USB holds the host back.
    ///
    /// Not while a line coding waits to take effect: what comes then is for the new one.
    pub fn usb_room(&self) -> bool {
        !self.rate.changes() && self.down.room() >= PACKET
    }

    /// The host sent a packet. Ask [`usb_room`](Self::usb_room) before.
    ///
    /// Then ask [`uart_due`](Self::uart_due).
    pub fn usb_received(&mut self, packet: &[u8], now: Instant) {
        count(&mut self.counters.packets_from_host, 1);
        if self.rate.is_unmet() && !packet.is_empty() && !self.take_rate(now) {
            self.refuse_usb(packet.len(), now);
            return;
        }
        if !self.is_held {
            self.streams.usb.hear(now);
        }
        self.turn.usb_queued(self.down.is_empty(), now);
        let refused = self.down.push(packet);
        count(&mut self.counters.refused_bytes, refused);
    }

    /// Whether a host has configured the adapter.
    pub fn is_attached(&self) -> bool {
        self.port.is_attached()
    }

    /// Whether [`usb_transmit`](Self::usb_transmit) has a packet.
    pub fn usb_due(&self) -> bool {
        self.port.is_due()
    }

    /// Moves the next packet for the host into `packet` and returns its length, 0 for one without data.
    ///
    /// `None` when nothing is due. Send what it returns before asking again.
    pub fn usb_transmit(&mut self, packet: &mut [u8; PACKET]) -> Option<usize> {
        self.port.transmit(packet, &mut self.counters)
    }

    /// A packet of `len` bytes from [`usb_transmit`](Self::usb_transmit) could not be sent: the host is gone.
    pub fn usb_lost(&mut self, len: usize) {
        count(&mut self.counters.unheard_bytes, len);
    }

    // ---- The control interface on USB ----

    /// Whether the next packet on the control interface may be taken. If not, leave it: USB holds the host back.
    pub fn control_room(&self) -> bool {
        self.control.usb_room()
    }

    /// The host sent a packet on the control interface. Ask [`control_room`](Self::control_room) before.
    ///
    /// ```
    /// use armwire_bridge::control::{FromAdapter, FromHost, MAX_COBS, Reader, Reply, Request, VERSION, encode_cobs};
    /// use armwire_bridge::{Bridge, Instant, PACKET};
    ///
    /// let mut bridge = Bridge::default();
    /// let mut message = [0; MAX_COBS];
    /// let len = encode_cobs(&FromHost { sequence: 7, request: Request::Identify }, &mut message).unwrap();
    /// bridge.control_received(&message[..len], Instant::ZERO);
    ///
    /// let mut packet = [0; PACKET];
    /// let len = bridge.control_transmit(&mut packet, Instant::ZERO).unwrap();
    /// let mut reader = Reader::<64>::new();
    /// reader.push(&packet[..len]);
    /// let Some(Ok(FromAdapter::Reply { sequence: 7, reply: Reply::Identity(identity) })) = reader.next() else {
    ///     panic!()
    /// };
    /// assert_eq!(identity, bridge.identity());
    /// ```
    pub fn control_received(&mut self, packet: &[u8], now: Instant) {
        self.control.usb_received(packet);
        self.serve(now);
    }

    /// Whether [`control_transmit`](Self::control_transmit) has a packet.
    pub fn control_due(&self) -> bool {
        self.control.usb_due() || self.unshared.is_some() && self.control.tells_usb()
    }

    /// Moves the next packet of the control interface into `packet` and returns its length, 0 for one without data. `None`
    /// when nothing is due.
    pub fn control_transmit(&mut self, packet: &mut [u8; PACKET], now: Instant) -> Option<usize> {
        self.share();
        let len = self.control.usb_transmit(packet, &mut self.can, &mut self.counters)?;
        self.serve(now);
        Some(len)
    }

    // ---- The CAN bus ----

    /// A frame came from the bus. Those with identifiers that are not this adapter's are passed over.
    pub fn can_received(&mut self, frame: &Frame, now: Instant) {
        match self.can.received(frame, now, &mut self.counters) {
            Some(Received::Arm) => self.take_can_request(now),
            Some(Received::Control) => self.serve(now),
            // The bus may be the one before a change of the configuration.
            Some(Received::Command(target)) if self.config.can.commands => self.take_command(&target, now),
            Some(Received::Refused(initiator, refusal)) => self.refuse(initiator, refusal, now),
            Some(Received::Command(_)) | None => {}
        }
    }

    /// Whether to ask for [`can_transmit`](Self::can_transmit): it has a frame, or what it has can only be queued, behind
    /// what goes to the same subscriber, or turns out to be for nobody. Then nothing is due after it.
    pub fn can_due(&self, now: Instant) -> bool {
        self.unshared.is_some() || self.can.is_due(now) || self.control.can_due()
    }

    /// The next frame for the bus, the most urgent first. `None` when there is none now.
    ///
    /// Hand it to the controller at once, and ask only when the controller has room: what waits here can still be overtaken
    /// by what is more urgent. When it has left, say [so](Self::can_sent).
    pub fn can_transmit(&mut self, now: Instant) -> Option<Frame> {
        self.share();
        if self.control.can_due() {
            self.tell_frames();
        }
        let was_replying = self.can.control.is_sending();
        let frame = self.can.transmit(now, &mut self.counters);
        self.serve_behind_reply(was_replying, now);
        frame
    }

    /// The CAN controller still has `waiting` of the frames that it was handed. It sends them in the order in which it got
    /// them.
    ///
    /// Then ask [`can_due`](Self::can_due), and [`timeout`](Self::timeout) if this returns that there may be something new
    /// to wait for.
    ///
    /// ```
    /// use armwire_bridge::{Bridge, Instant};
    /// use armwire_bridge::can::{Frame, Function};
    ///
    /// let mut bridge = Bridge::default();
    /// let node = bridge.can_config().node;
    /// let mut hear = |bridge: &mut Bridge, data: &[u8], now| {
    ///     let frame = Frame::new(Function::ControlRequest.id(node), data).unwrap();
    ///     bridge.can_received(&frame, now);
    /// };
    /// // The counters, in a first frame and more behind it, with 1 ms between them.
    /// hear(&mut bridge, &[2, 0, 6], Instant::ZERO);
    /// assert_eq!(bridge.can_transmit(Instant::ZERO).unwrap().data()[0], 0x10);
    /// hear(&mut bridge, &[0x30, 0, 1], Instant::from_micros(200));
    /// assert!(bridge.can_transmit(Instant::from_micros(200)).is_some());
    /// // Others have the bus. When the frame has left, the next may be handed over a millisecond later.
    /// assert!(!bridge.can_due(Instant::from_micros(5_000)));
    /// assert!(bridge.can_sent(0, Instant::from_micros(5_000)));
    /// assert!(bridge.timeout() == Some(Instant::from_micros(6_000)) && bridge.can_due(Instant::from_micros(6_000)));
    /// ```
    pub fn can_sent(&mut self, waiting: u8, now: Instant) -> bool {
        self.can.sent(waiting, now)
    }

    /// The CAN controller reported errors.
    ///
    /// ```
    /// use armwire_bridge::{Bridge, CanErrors};
    ///
    /// let mut bridge = Bridge::default();
    /// bridge.can_errors(CanErrors { bus: 3, overruns: 1, unsent: 2 });
    /// let c = bridge.counters();
    /// assert_eq!((c.can_bus_errors, c.can_receive_overruns, c.dropped_can_frames), (3, 1, 2));
    /// ```
    pub fn can_errors(&mut self, errors: CanErrors) {
        let c = &mut self.counters;
        c.can_bus_errors = c.can_bus_errors.wrapping_add(errors.bus);
        c.can_receive_overruns = c.can_receive_overruns.wrapping_add(errors.overruns);
        c.dropped_can_frames = c.dropped_can_frames.wrapping_add(errors.unsent);
    }

    /// The CAN controller left the bus (`off`), or is back on it. What was under way by ISO-TP is given up.
    pub fn can_bus_off(&mut self, off: bool, now: Instant) {
        self.share();
        if off {
            count(&mut self.counters.can_bus_offs, 1);
            self.can.left(&mut self.counters);
            self.serve(now);
        }
        self.tell(Event::BusOff { off }, now);
    }

    /// What the CAN controller is to be. It changes with an [`Action::RestartCan`].
    pub fn can_config(&self) -> config::Can {
        self.can.config()
    }

    /// Takes requests for the arm from the bus as far as there is room for them.
    pub(crate) fn take_can_request(&mut self, now: Instant) {
        while !self.can_requests.is_full()
            && let Some(pdu) = self.can.arm.received()
        {
            let came = self.can.arm_came;
            let request = match self.config.arm.is_request(pdu) {
                true => Waiting::new(self.config.arm, pdu, came),
                false => None,
            };
            self.can.arm.release();
            match request {
                Some(_) if self.is_held => self.refuse(Initiator::Can, Refusal::LineHeld, now),
                Some(request) => {
                    if request.asked.moves {
                        self.streams.can.motion(self.config.host_timeout.after(), came);
                    }
                    let _ = self.can_requests.push_back(request);
                }
                None => self.refuse(Initiator::Can, Refusal::NotAFrame, now),
            }
        }
    }

    /// Lets the newest command wait for its turn.
    fn take_command(&mut self, target: &armwire::ling::Move, now: Instant) {
        let mut bytes = [0; MAX_FRAME];
        let Some(len) = self.config.arm.moving(target, &mut bytes) else {
            return;
        };
        if self.is_held {
            self.refuse(Initiator::Command, Refusal::LineHeld, now);
            return;
        }
        let waiting = self.command.take();
        self.command = Waiting::new(self.config.arm, bytes.get(..len).unwrap_or_default(), now);
        self.streams.command.motion(self.config.host_timeout.after(), now);
        if waiting.is_some() {
            self.refuse(Initiator::Command, Refusal::QueueFull, now);
        }
    }

    // Not inlined: it is seldom needed, and not worth the room in all those who do.
    #[inline(never)]
    pub(crate) fn refuse(&mut self, initiator: Initiator, reason: Refusal, now: Instant) {
        let c = &mut self.counters;
        let counter = match (initiator, reason) {
            (_, Refusal::QueueFull) => &mut c.refused_can_requests,
            (_, Refusal::NotAFrame) => &mut c.refused_can_frames,
            (_, Refusal::Incomplete) => &mut c.commands_incomplete,
            (_, Refusal::Stale) => &mut c.commands_stale,
            (_, Refusal::OutOfRange) => &mut c.commands_out_of_range,
            (_, Refusal::LineHeld) => &mut c.refused_line_held,
            (_, Refusal::OtherRate) => &mut c.refused_other_rate,
        };
        count(counter, 1);
        self.tell(Event::Refused { initiator, reason }, now);
    }

    // ---- The line coding ----

    /// The host asks for a line coding, as it came with SET_LINE_CODING.
    ///
    /// The arm's own takes effect behind the bytes that came before. Another one takes effect with the host's next byte,
    /// or after 100 ms if the port is open, unless a host on CAN streams motion.
    ///
    /// # Errors
    ///
    /// [`Refused`] when the UART cannot do it. It is counted, and the line coding stays as it was.
    ///
    /// ```
    /// use armwire_bridge::{Bridge, Instant, Refused};
    ///
    /// let mut bridge = Bridge::default();
    /// let refused = bridge.request_line_coding([0x00, 0xC2, 0x01, 0x00, 1, 0, 8], Instant::ZERO);
    /// assert_eq!(refused, Err(Refused::StopBits(1)));
    /// assert_eq!(bridge.line_coding().baud, 1_000_000);
    ///
    /// bridge.request_line_coding([0x00, 0xC2, 0x01, 0x00, 0, 0, 8], Instant::ZERO).unwrap();
    /// assert_eq!(bridge.line_change(), None);
    /// bridge.usb_received(b"at 115200 baud", Instant::ZERO);
    /// let line = bridge.line_change().unwrap();
    /// // Here firmware waits for the last bit to leave, and changes the UART.
    /// bridge.line_changed(line);
    /// assert_eq!(bridge.line_coding().baud, 115_200);
    /// ```
    pub fn request_line_coding(&mut self, bytes: [u8; 7], now: Instant) -> Result<(), Refused> {
        let coding = LineCoding::from_cdc(bytes).inspect_err(|_| count(&mut self.counters.refused_line_codings, 1))?;
        self.turn.usb_queued(self.down.is_empty(), now);
        self.rate.request(coding, self.down.len(), now);
        self.follow_holder(now);
        Ok(())
    }

    /// The line coding that the host last asked for successfully, whether it has taken effect or not.
    pub fn line_coding(&self) -> LineCoding {
        self.rate.requested()
    }

    /// Whether the bytes that the UART is sending are to be cut: torque-off waits, and the arm does not understand the rate
    /// at which they go out.
    ///
    /// ```
    /// assert!(!armwire_bridge::Bridge::default().uart_cut());
    /// ```
    pub fn uart_cut(&self) -> bool {
        self.torque_off.is_some() && !self.rate.is_arms()
    }

    /// Whether the host on USB may have another rate than the arm's.
    fn may_change_rate(&self) -> bool {
        !self.streams.is_armed_on_can() && self.torque_off.is_none()
    }

    /// The rate that the host on USB has set takes effect with its next byte. Returns whether it does.
    // Not inlined: it is seldom needed.
    #[inline(never)]
    fn take_rate(&mut self, now: Instant) -> bool {
        let takes = self.may_change_rate() && !self.rate.is_revoked();
        if takes {
            self.rate.take(self.down.len(), now);
            self.follow_holder(now);
        }
        takes
    }

    /// Bytes of the host on USB are dropped, because the line does not have their rate.
    #[inline(never)]
    fn refuse_usb(&mut self, bytes: usize, now: Instant) {
        count(&mut self.counters.refused_rate_bytes, bytes);
        if self.rate.refuse() {
            self.refuse(Initiator::Usb, Refusal::OtherRate, now);
        }
    }

    /// Torque-off goes out at the arm's rate: what the host on USB says at another is cut.
    fn take_line_back(&mut self) {
        if self.rate.revoke() {
            count(&mut self.counters.refused_rate_bytes, self.down.len());
            self.down.clear();
            self.asks.clear();
            (self.turn.raw, self.turn.is_cut) = (false, true);
            self.follow_holder(self.last_rx_poll);
        }
    }

    /// Refuses what polls and CAN have to say when the host on USB begins to hold the line, and lets polls go on when that
    /// ends.
    // Not inlined: it is seldom needed.
    #[inline(never)]
    pub(crate) fn follow_holder(&mut self, now: Instant) {
        let held = self.rate.is_held(self.down.len());
        if core::mem::replace(&mut self.is_held, held) == held {
            return;
        }
        let missed = self.poll.pause(held, now);
        count(&mut self.counters.missed_polls, missed);
        if !held {
            return;
        }
        if self.config.poll != config::Poll::Off {
            self.refuse(Initiator::Poll, Refusal::LineHeld, now);
        }
        if self.command.take().is_some() {
            self.refuse(Initiator::Command, Refusal::LineHeld, now);
        }
        while self.can_requests.pop_front().is_some() {
            self.refuse(Initiator::Can, Refusal::LineHeld, now);
        }
        self.take_can_request(now);
        if self.identify.take().is_some() {
            self.identify_arm(now);
        }
    }

    // ---- Who holds the line ----

    /// A host on the control port wants the line for USB alone.
    #[inline(never)]
    pub(crate) fn hold_line(&mut self, port: Port, now: Instant) -> Result<(), Failure> {
        if self.torque_off.is_some() || self.streams.is_armed() {
            return Err(Failure::StreamArmed);
        }
        match self.rate.hold(port, now) {
            true => {
                self.follow_holder(now);
                Ok(())
            }
            false => Err(Failure::Busy),
        }
    }

    /// The host on the control port wants it no more.
    #[inline(never)]
    pub(crate) fn release_line(&mut self, port: Port, now: Instant) {
        self.rate.unhold(port);
        self.follow_holder(now);
    }

    /// The host on the control interface of USB has gone.
    fn forget_usb(&mut self) {
        self.rate.unhold(Port::Usb);
        self.control.forget_usb();
    }

    // ---- Time, and what only firmware can do ----

    /// When to call [`tick`](Self::tick), unless something happens before, perhaps at a time that has passed. `None` when
    /// nothing waits for the time.
    pub fn timeout(&self) -> Option<Instant> {
        Earliest::of(self.poll.timeout(POLL_LEAD_TIME))
            .or(self.exchange.timeout())
            .or(self.hold_timeout())
            .or(self.command_timeout())
            .or(self.silence_timeout(Initiator::Usb))
            .or(self.silence_timeout(Initiator::Can))
            .or(self.silence_timeout(Initiator::Command))
            .or(self.rate_timeout())
            .or(self.can.timeout())
            .get()
    }

    /// It is `now`: what is late is given up, and what is due becomes so.
    ///
    /// Then ask everything that can be due.
    pub fn tick(&mut self, now: Instant) {
        self.tick_line(now);
        if self.rate_timeout().is_some_and(|at| at <= now) {
            self.tick_rate(now);
        }
        for initiator in Streams::INITIATORS {
            if self.silence_timeout(initiator).is_none_or(|at| at > now) {
                continue;
            }
            match initiator {
                // USB does not tell whether it wants to say something.
                Initiator::Usb if self.usb_is_held_back() => self.streams.usb.hear(now),
                _ => self.silent(initiator, now),
            }
        }
        // Torque-off may have begun to wait for the line.
        self.tick_hold(now);
        let was_replying = self.can.control.is_sending();
        if let Some(refusal) = self.can.tick(now, &mut self.counters) {
            self.refuse(Initiator::Command, refusal, now);
        }
        self.serve_behind_reply(was_replying, now);
    }

    /// When the line's rate changes or its holder loses it, unless something happens before.
    // Not inlined: it is asked for in a task that is large already.
    #[inline(never)]
    fn rate_timeout(&self) -> Option<Instant> {
        self.rate.timeout(self.may_change_rate())
    }

    /// The line's rate changes, or its holder loses it.
    #[inline(never)]
    fn tick_rate(&mut self, now: Instant) {
        self.rate
            .tick(self.may_change_rate(), self.moved(), self.down.len(), now);
        self.follow_holder(now);
    }

    /// When a byte of the host on USB or of the arm last moved.
    fn moved(&self) -> Instant {
        self.turn.usb_moved.max(self.last_rx)
    }

    /// Whether the host on USB cannot be heard because there is no room for what it says to the arm.
    pub(crate) fn usb_is_held_back(&self) -> bool {
        !self.usb_room() && !self.is_held
    }

    /// Serves hosts if a reply on CAN that was under way is out or given up: there may be room for the next one.
    fn serve_behind_reply(&mut self, was_replying: bool, now: Instant) {
        if was_replying && !self.can.control.is_sending() {
            self.serve(now);
        }
    }

    /// When `initiator` counts as silent, unless it says something before. While its motion waits for another's turn it has more
    /// time: a host on CAN cannot be heard when there is no room for more.
    fn silence_timeout(&self, initiator: Initiator) -> Option<Instant> {
        let stream = match initiator {
            Initiator::Can => &self.streams.can,
            Initiator::Command => &self.streams.command,
            _ => &self.streams.usb,
        };
        let timeout = stream.timeout(self.config.host_timeout.after())?;
        let mut waiting = self.can_requests.iter().filter(|request| request.asked.moves);
        match waiting.next() {
            Some(oldest) if initiator == Initiator::Can => Some(timeout.max(oldest.since + MOTION_WAIT)),
            _ => Some(timeout),
        }
    }

    /// A host that streamed motion says nothing any more: what it has sent and is not out is old.
    fn silent(&mut self, initiator: Initiator, now: Instant) {
        let dropped = match initiator {
            Initiator::Usb => {
                let dropped = self.down.len();
                self.down.clear();
                self.cut_usb();
                self.rate.dropped();
                dropped
            }
            Initiator::Can => {
                let queued: usize = self.can_requests.iter().map(|request| request.bytes.len()).sum();
                let last = self.can.arm.received().map_or(0, <[u8]>::len);
                self.can_requests.clear();
                self.can.arm.release();
                queued.saturating_add(last)
            }
            _ => {
                self.can.stop_commands();
                self.command.take().map_or(0, |request| request.bytes.len())
            }
        };
        let torque_off = self.silence_switches_off();
        if torque_off {
            self.torque_off.get_or_insert(now);
            self.take_line_back();
        }
        self.end_stream(initiator, dropped, torque_off, now);
    }

    /// Whether the torque is to go off if the adapter starts again now: a host streams motion, and its silence would switch
    /// the torque off, or that is just being done.
    ///
    /// Keep it over a restart, and tell the next adapter [so](Self::restarted_while_armed).
    pub fn is_armed(&self) -> bool {
        self.torque_off.is_some() || self.silence_switches_off() && self.streams.is_armed()
    }

    /// The adapter before this one stopped while it [was armed](Self::is_armed): the torque goes off before all else, also
    /// if the configuration that said so was not saved.
    ///
    /// ```
    /// use armwire_bridge::{Bridge, Instant};
    ///
    /// let mut bridge = Bridge::default();
    /// bridge.restarted_while_armed();
    /// let mut buf = [0; 256];
    /// // Zeros end a frame that the arm may have heard half of.
    /// assert_eq!(bridge.uart_transmit(&mut buf, Instant::ZERO).unwrap().len, 70);
    /// assert_eq!(bridge.uart_transmit(&mut buf, Instant::ZERO).unwrap().len, 7);
    /// assert_eq!(buf[..7], [0xAA, 0x05, 0x00, 0x01, 0x00, 0x6F, 0xFF]);
    /// ```
    pub fn restarted_while_armed(&mut self) {
        if self.config.arm.torque_off().is_some() {
            self.torque_off = Some(Instant::ZERO);
            self.turn.is_cut = true;
        }
    }

    /// Whether the torque goes off when a host that streams motion falls silent.
    fn silence_switches_off(&self) -> bool {
        let host_timeout = self.config.host_timeout;
        host_timeout.torque_off && host_timeout.after() > Duration::ZERO && self.config.arm.torque_off().is_some()
    }

    /// The adapter is about to stop: no stream stays behind with its torque on.
    pub(crate) fn disarm(&mut self, now: Instant) {
        for initiator in Streams::INITIATORS {
            if self.silence_switches_off() && self.streams.of(initiator).is_some_and(|stream| stream.is_armed()) {
                self.silent(initiator, now);
            }
        }
    }

    /// Reports that `initiator` streams motion no more, if it did.
    // Not inlined, as above.
    #[inline(never)]
    pub(crate) fn end_stream(&mut self, initiator: Initiator, dropped: usize, torque_off: bool, now: Instant) {
        if !self.streams.of(initiator).is_some_and(Stream::end) {
            return;
        }
        count(&mut self.counters.host_silences, 1);
        count(&mut self.counters.silenced_bytes, dropped);
        let dropped = dropped as u16;
        self.tell(
            Event::HostSilent {
                initiator,
                dropped,
                torque_off,
            },
            now,
        );
    }

    /// The next thing that only firmware can do, once.
    pub fn action(&mut self) -> Option<Action> {
        self.share();
        // The reply goes out as the bus was, and so does the answer that the arm owes a host there.
        let replied =
            |port: &mut Port| *port == Port::Usb || !self.can.control.is_sending() && !self.control.owes_can();
        if self.exchange.holder() != Some(Initiator::Can) && self.can_change.take_if(replied).is_some() {
            count(&mut self.counters.refused_can_requests, self.can_requests.len());
            self.can_requests.clear();
            self.can.close(&mut self.counters);
            self.can = CanPort::new(self.config.can);
            self.rate.unhold(Port::Can);
            self.follow_holder(self.last_rx_poll);
            self.control.forget_can();
            return Some(Action::RestartCan(self.config.can));
        }
        let may_restart = self.torque_off.is_none(); // the arm hears that before
        self.control.action(may_restart)
    }

    /// What became of [`Action::Save`] or [`Action::Reset`].
    pub fn saved(&mut self, result: Result<(), Failure>, now: Instant) {
        let counter = match result {
            Ok(()) => &mut self.counters.config_saves,
            Err(_) => &mut self.counters.config_failures,
        };
        count(counter, 1);
        // While the flash was written nobody was heard.
        for initiator in Streams::INITIATORS {
            if let Some(stream) = self.streams.of(initiator) {
                stream.hear(now);
            }
        }
        self.control.saved(result);
        self.serve(now);
    }

    /// The configuration in force.
    pub const fn config(&self) -> Config {
        self.config
    }

    /// What the adapter is.
    pub fn identity(&self) -> Identity {
        self.control.identity.clone()
    }

    /// Is from now on as `config` says.
    pub(crate) fn adopt(&mut self, config: Config, by: Port, now: Instant) {
        self.share();
        let was = core::mem::replace(&mut self.config, config);
        if config.can.bus() != was.can.bus() {
            self.can_change = Some(by);
        } else if config.can != was.can && self.can_change.is_none() {
            self.can.adopt(config.can, &mut self.counters);
        }
        if config.arm != was.arm {
            self.change_arm(now);
            self.turn.usb_queued(self.down.is_empty(), now);
            self.rate.set_arm(config.arm, self.down.len());
            self.follow_holder(now);
        } else if !config.can.commands || config.can.bus() != was.can.bus() {
            self.drop_command(now);
            self.end_stream(Initiator::Command, 0, false, now);
        }
        if config.poll != was.poll || config.arm != was.arm {
            self.poll = Poll::new(config.poll);
            self.poll.pause(self.is_held, now);
            self.poll.tick(POLL_LEAD_TIME, now);
        }
    }

    /// Tells whoever wants to be told of what is no frame.
    pub(crate) fn tell(&mut self, event: Event, now: Instant) {
        self.share();
        if !self.can.note(&event, Stamp(now.as_micros())) {
            count(&mut self.counters.dropped_events, 1);
        }
        if self.control.is_heard() {
            self.tell_frames();
            self.control.tell(event, now, &mut self.can, &mut self.counters);
        }
    }

    // ---- Health ----

    /// How often the firmware had to start again since power-on, for [`Counters`].
    ///
    /// ```
    /// let mut bridge = armwire_bridge::Bridge::default();
    /// bridge.started_after(1, 0, 2);
    /// assert_eq!((bridge.counters().panics, bridge.counters().hard_faults), (1, 2));
    /// ```
    pub fn started_after(&mut self, panics: u32, watchdog_resets: u32, hard_faults: u32) {
        self.counters.panics = panics;
        self.counters.watchdog_resets = watchdog_resets;
        self.counters.hard_faults = hard_faults;
    }

    /// What is saved could not be read at the start, so that the adapter is as from the factory.
    ///
    /// ```
    /// let mut bridge = armwire_bridge::Bridge::default();
    /// bridge.started_without_config();
    /// assert_eq!(bridge.counters().config_failures, 1);
    /// ```
    pub fn started_without_config(&mut self) {
        count(&mut self.counters.config_failures, 1);
    }

    /// Whether bytes for the arm stopped moving, or nobody has looked at the UART, for a second: something is wrong that
    /// only a restart cures. A host that does not read is no such thing.
    ///
    /// ```
    /// use armwire_bridge::Instant;
    ///
    /// let mut bridge = armwire_bridge::Bridge::default();
    /// bridge.uart_received(&[], Instant::ZERO);
    /// assert!(!bridge.is_stuck(Instant::from_millis(900)));
    /// assert!(bridge.is_stuck(Instant::from_millis(1_100)));
    /// ```
    pub fn is_stuck(&self, now: Instant) -> bool {
        let unsent = !self.down.is_empty() || self.rate.changes();
        // While the arm owes somebody an answer, bytes may wait for that. It ends by itself.
        let stands = self.exchange.holder().is_none();
        now.since(self.last_rx_poll) > PATIENCE || unsent && stands && now.since(self.turn.moved()) > PATIENCE
    }
}

/// An adapter that does not say what it is, configured as from the factory.
impl Default for Bridge {
    fn default() -> Self {
        Self::new(Identity::default(), Config::default())
    }
}

impl fmt::Debug for Bridge {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Bridge")
            .field("config", &self.config)
            .field("line", &self.rate.line())
            .field("up", &self.port.len())
            .field("down", &self.down.len())
            .field("counters", &self.counters)
            .finish_non_exhaustive()
    }
}
