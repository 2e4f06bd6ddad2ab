//! The adapter's state, and what each event does to it.

use core::fmt;

use armwire::ling::{self, Ling};
use armwire::{Decoder, Micros};

use crate::can;
use crate::config::{self, Config};
use crate::control::Identity;
use crate::queue::Queue;
use crate::{Counters, Line, LineCoding, Refused, UartErrors};

/// Bytes in a full USB packet (full speed, bulk).
pub const PACKET: usize = 64;

/// How long bytes for the arm may wait, or the UART go unread, before the adapter counts as stuck.
const PATIENCE: Micros = Micros::from_millis(1_000);

/// The adapter between a USB serial port and an arm's UART.
///
/// `UP` is the room for bytes from the arm that the host has not read yet, `DOWN` for bytes from the host that have not
/// gone out yet, in bytes. `DOWN` is at least one [`PACKET`], `UP` at least two.
///
/// Nobody has to poll: after each call, what may have become possible is said there.
pub struct Bridge<const UP: usize, const DOWN: usize> {
    /// Listens in on what the arm says.
    tap: Decoder<Ling, { ling::MAX_FRAME }>,
    /// Bytes from the arm.
    up: Queue<UP>,
    /// How many of them, from the front, no longer wait for more to fill the packet.
    due: usize,
    transfer: Transfer,
    /// Bytes from the host.
    down: Queue<DOWN>,
    /// When bytes for the arm last moved, or began to wait.
    down_moved: Micros,
    port: Port,
    coding: LineCoding,
    /// The line coding the host asked for, and how many bytes for the arm go out before it takes effect.
    wanted: Option<(LineCoding, usize)>,
    /// The one after that, and how many bytes go out between the two.
    wanted_next: Option<(LineCoding, usize)>,
    /// When the UART was last looked at.
    looked: Micros,
    /// Nothing has arrived since the last frame ended or the line went idle, so there is nothing to time the next look
    /// by.
    quiet: bool,
    counters: Counters,
    identity: Identity,
    config: Config,
}

/// The USB transfer towards the host. A host waits for more until a packet is short.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Transfer {
    /// The last packet was short.
    Closed,
    /// The last packet was full and what follows it is still arriving.
    Open,
    /// The last packet was full and ended what there was to say.
    Unterminated,
}

/// Whether somebody listens at the host's end.
///
/// Some hosts never raise DTR, so a low DTR means a closed port only after it has been high.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Port {
    /// No host has configured the adapter.
    Detached,
    /// Configured by a host that has not raised DTR so far.
    Attached,
    /// DTR is high.
    Open,
    /// DTR went low again.
    Closed,
}

/// When to look at the UART next, unless it reports an idle line or an error before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Wake {
    /// As soon as the next byte arrives.
    Byte,
    /// At this time: nothing can be due before.
    At(Micros),
}

/// Bytes for the arm that [`Bridge::uart_transmit`] gave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Burst {
    /// How many, at least 1.
    pub len: usize,
    /// When the first is to start, [`LEAD`] away at most: wait for it, and send nothing in between. `None`: at once.
    pub start: Option<Micros>,
}

/// How long before its slot a poll is handed over, so that nothing else that runs makes it late.
pub const LEAD: Micros = Micros(25);

/// What the CAN controller had to complain of since it was last asked.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct CanErrors {
    /// Errors on the bus.
    pub bus: u32,
    /// Times frames were lost because they were not taken in time.
    pub overruns: u32,
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

impl<const UP: usize, const DOWN: usize> Bridge<UP, DOWN> {
    /// An adapter that no host has found yet, at 1 Mbaud until [`line_change`](Self::line_change) says otherwise. It is
    /// configured as from the factory if it cannot be as `config` says. Does not compile when a queue is too short.
    pub fn new(identity: Identity, config: Config) -> Self {
        let config = match config.check() {
            Ok(()) => config,
            Err(_) => Config::default(),
        };
        const {
            assert!(
                UP >= 2 * PACKET && DOWN >= PACKET,
                "a queue is shorter than the packets it must hold"
            )
        }
        Self {
            tap: Decoder::new(),
            up: Queue::new(),
            due: 0,
            transfer: Transfer::Closed,
            down: Queue::new(),
            down_moved: Micros(0),
            port: Port::Detached,
            coding: LineCoding::LING,
            wanted: None,
            wanted_next: None,
            looked: Micros(0),
            quiet: true,
            counters: Counters::default(),
            identity,
            config,
        }
    }

    /// What has been seen, lost and refused so far.
    pub const fn counters(&self) -> Counters {
        self.counters
    }

    // ---- The arm's side ----

    /// The UART was looked at, at the time `now`, and has received `bytes`, perhaps none.
    ///
    /// Then ask [`usb_transmit`](Self::usb_transmit) and [`wake`](Self::wake).
    pub fn uart_received(&mut self, bytes: &[u8], now: Micros) {
        self.looked = now;
        self.quiet &= bytes.is_empty();
        count(&mut self.counters.arm_to_host_bytes, bytes.len());

        let mut rest = bytes;
        while !rest.is_empty() {
            let later = self.tap.push(rest);
            let taken = rest.len().saturating_sub(later.len());
            self.enqueue(rest.get(..taken).unwrap_or(rest));
            if self.take_frames() {
                // What the decoder still holds may begin the next frame.
                let begun = self.tap.pending();
                self.quiet = begun == 0;
                self.release(self.up.len().saturating_sub(begun));
            }
            rest = later;
        }
    }

    /// The line has been idle for the time of a byte: what has arrived goes out.
    ///
    /// Call [`uart_received`](Self::uart_received) first with what arrived before. Then ask
    /// [`usb_transmit`](Self::usb_transmit) and [`wake`](Self::wake).
    ///
    /// ```
    /// use armwire::Micros;
    /// use armwire_bridge::{Bridge, PACKET, Wake};
    ///
    /// let mut bridge = Bridge::<256, 128>::default();
    /// bridge.usb_configured(true);
    /// bridge.uart_received(b"what is this", Micros(0));
    /// assert_eq!(bridge.usb_transmit(&mut [0; PACKET]), None);
    /// bridge.uart_idle(Micros(200));
    /// assert_eq!(bridge.usb_transmit(&mut [0; PACKET]), Some(12));
    /// assert_eq!(bridge.wake(), Wake::Byte);
    /// ```
    pub fn uart_idle(&mut self, now: Micros) {
        let _ = now;
        while let Some(noise) = self.tap.idle(()) {
            count(&mut self.counters.noise_bytes, noise.len);
            self.take_frames();
        }
        self.quiet = true;
        self.release(self.up.len());
    }

    /// The UART reported errors. The bytes they came with are passed on as they are.
    pub fn uart_errors(&mut self, errors: UartErrors) {
        let c = &mut self.counters;
        c.framing_errors = c.framing_errors.wrapping_add(errors.framing);
        c.parity_errors = c.parity_errors.wrapping_add(errors.parity);
        c.noise_errors = c.noise_errors.wrapping_add(errors.noise);
        c.overrun_errors = c.overrun_errors.wrapping_add(errors.overrun);
    }

    /// The receive ring was overwritten before it was read.
    pub fn uart_ring_overrun(&mut self) {
        count(&mut self.counters.ring_overruns, 1);
    }

    /// How many more bytes must arrive before anything can be due for the host: the end of the current frame or a full
    /// packet, at least 1.
    pub fn need(&self) -> usize {
        let pending = self.tap.pending();
        let header = if pending == 0 { 0 } else { self.tap.need(()) };
        let frame = header.max(ling::OVERHEAD.saturating_sub(pending));
        let packet = PACKET.checked_sub(self.up.len()).unwrap_or(PACKET);
        frame.min(packet).max(1)
    }

    /// When to look at the UART next.
    ///
    /// The wait is timed up to the last byte but one. From there the last byte itself is the signal, so that neither a
    /// sender's clock nor a pause in the middle of a frame makes the end of it late.
    pub fn wake(&self) -> Wake {
        match self.need() - 1 {
            certain @ 1.. if !self.quiet => Wake::At(self.looked + Micros(self.coding.micros(certain))),
            _ => Wake::Byte,
        }
    }

    /// Whether [`uart_transmit`](Self::uart_transmit) has bytes or [`line_change`](Self::line_change) has something.
    pub fn uart_due(&self, now: Micros) -> bool {
        let _ = now;
        !self.down.is_empty() || self.wanted.is_some()
    }

    /// Moves bytes for the arm to the front of `out`. `None` when there are none now, or when the line has to change
    /// first.
    ///
    /// Give it room for a whole frame, [`MAX_FRAME`](crate::control::MAX_FRAME) bytes.
    pub fn uart_transmit(&mut self, out: &mut [u8], now: Micros) -> Option<Burst> {
        let before = self.wanted.map_or(out.len(), |(_, before)| before.min(out.len()));
        let n = self.down.pop(out.get_mut(..before).unwrap_or_default());
        if let Some((_, before)) = &mut self.wanted {
            *before = before.saturating_sub(n);
        }
        self.down_moved = now;
        count(&mut self.counters.host_to_arm_bytes, n);
        (n > 0).then_some(Burst { len: n, start: None })
    }

    // ---- The host's side ----

    /// The host enabled or disabled the adapter's configuration.
    pub fn usb_configured(&mut self, configured: bool) {
        self.forget();
        self.port = if configured { Port::Attached } else { Port::Detached };
    }

    /// The USB bus was reset: a new host, or the same one anew.
    ///
    /// What the arm said to the last host is dropped and counted as unheard. What the last host said to the arm still
    /// goes out: it was accepted.
    pub fn usb_reset(&mut self) {
        count(&mut self.counters.usb_resets, 1);
        self.usb_configured(false);
    }

    /// The USB bus was suspended. The queue keeps what fits until the host reads again.
    pub fn usb_suspended(&mut self) {
        count(&mut self.counters.usb_suspends, 1);
    }

    /// The host raised or lowered DTR: it opened or closed the port.
    ///
    /// Whoever opens the port does not get what was said before. Returns whether it was opened or closed by this: a
    /// packet on its way is then for nobody.
    ///
    /// ```
    /// use armwire::Micros;
    /// use armwire_bridge::{Bridge, PACKET};
    ///
    /// let mut bridge = Bridge::<256, 128>::default();
    /// bridge.usb_configured(true);
    /// bridge.uart_received(b"old", Micros(0));
    /// bridge.usb_dtr(true);
    /// bridge.uart_received(b"new", Micros(100));
    /// bridge.uart_idle(Micros(200));
    ///
    /// let mut packet = [0; PACKET];
    /// assert_eq!(bridge.usb_transmit(&mut packet), Some(3));
    /// assert_eq!(&packet[..3], b"new");
    /// assert_eq!(bridge.counters().unheard_bytes, 3);
    /// ```
    pub fn usb_dtr(&mut self, high: bool) -> bool {
        let port = match (self.port, high) {
            (Port::Detached, _) => Port::Detached,
            (Port::Attached, false) => Port::Attached,
            (_, true) => Port::Open,
            (_, false) => Port::Closed,
        };
        let changed = port != self.port;
        if changed {
            self.forget();
            self.port = port;
        }
        changed
    }

    /// Whether the next packet from the host may be taken. If not, leave it: USB holds the host back.
    ///
    /// Not while a line coding waits to take effect: what comes then is for the new one.
    pub fn usb_room(&self) -> bool {
        self.wanted.is_none() && self.down.room() >= PACKET
    }

    /// The host sent a packet. Ask [`usb_room`](Self::usb_room) before.
    ///
    /// Then ask [`uart_transmit`](Self::uart_transmit).
    pub fn usb_received(&mut self, packet: &[u8], now: Micros) {
        count(&mut self.counters.packets_from_host, 1);
        if self.down.is_empty() {
            self.down_moved = now;
        }
        let refused = self.down.push(packet);
        count(&mut self.counters.refused_bytes, refused);
    }

    /// Whether a host has configured the adapter.
    pub fn is_attached(&self) -> bool {
        self.port != Port::Detached
    }

    /// Whether [`usb_transmit`](Self::usb_transmit) has a packet.
    pub fn usb_due(&self) -> bool {
        self.up.len() >= PACKET || self.due > 0 || self.transfer == Transfer::Unterminated
    }

    /// Moves the next packet for the host into `packet` and returns its length, 0 for one without data.
    ///
    /// `None` when nothing is due. Send what it returns before asking again.
    pub fn usb_transmit(&mut self, packet: &mut [u8; PACKET]) -> Option<usize> {
        let len = match self.due {
            _ if self.up.len() >= PACKET => PACKET,
            0 if self.transfer == Transfer::Unterminated => 0,
            0 => return None,
            due => due,
        };
        let len = self.up.pop(packet.get_mut(..len).unwrap_or_default());
        self.transfer = match len {
            PACKET if self.due == PACKET => Transfer::Unterminated,
            PACKET => Transfer::Open,
            _ => Transfer::Closed,
        };
        self.due = self.due.saturating_sub(len);
        count(&mut self.counters.packets_to_host, 1);
        count(&mut self.counters.empty_packets_to_host, usize::from(len == 0));
        Some(len)
    }

    /// A packet of `len` bytes from [`usb_transmit`](Self::usb_transmit) could not be sent: the host is gone.
    pub fn usb_lost(&mut self, len: usize) {
        count(&mut self.counters.unheard_bytes, len);
    }

    // ---- The line coding ----

    /// The host asks for a line coding, as it came with SET_LINE_CODING.
    ///
    /// # Errors
    ///
    /// [`Refused`] when the UART cannot do it. It is counted, and the line coding stays as it was.
    ///
    /// ```
    /// use armwire::Micros;
    /// use armwire_bridge::{Bridge, Refused};
    ///
    /// let mut bridge = Bridge::<256, 128>::default();
    /// let refused = bridge.request_line_coding([0x00, 0xC2, 0x01, 0x00, 1, 0, 8], Micros(0));
    /// assert_eq!(refused, Err(Refused::StopBits(1)));
    /// assert_eq!(bridge.line_coding().baud, 1_000_000);
    ///
    /// bridge.request_line_coding([0x00, 0xC2, 0x01, 0x00, 0, 0, 8], Micros(0)).unwrap();
    /// let line = bridge.line_change().unwrap();
    /// // Here firmware waits for the last bit to leave, and changes the UART.
    /// bridge.line_changed(line);
    /// assert_eq!(bridge.line_coding().baud, 115_200);
    /// ```
    pub fn request_line_coding(&mut self, bytes: [u8; 7], now: Micros) -> Result<(), Refused> {
        let coding = LineCoding::from_cdc(bytes).inspect_err(|_| count(&mut self.counters.refused_line_codings, 1))?;
        if self.down.is_empty() {
            self.down_moved = now;
        }
        // No packet is taken while one waits, but one may have been on its way: so there can be two, and no more.
        match (self.wanted, self.wanted_next) {
            (None, _) => self.wanted = (coding != self.coding).then_some((coding, self.down.len())),
            (Some((_, before)), None) if before == self.down.len() => {
                self.wanted = (coding != self.coding).then_some((coding, before));
            }
            (Some((_, before)), None) => self.wanted_next = Some((coding, self.down.len().saturating_sub(before))),
            (Some(_), Some((_, between))) => self.wanted_next = Some((coding, between)),
        }
        Ok(())
    }

    /// What the line is to be, once every byte before that has been handed to the UART.
    pub fn line_change(&self) -> Option<Line> {
        let (coding, _) = self.wanted.filter(|&(_, before)| before == 0)?;
        Some(Line {
            coding,
            half_duplex: false,
        })
    }

    /// The UART works like this from here on. A frame that had begun will not end.
    pub fn line_changed(&mut self, line: Line) {
        self.uart_idle(self.looked);
        self.coding = line.coding;
        if self.wanted.is_none_or(|(wanted, _)| wanted == line.coding) {
            self.wanted = self.wanted_next.take();
        }
        count(&mut self.counters.line_codings, 1);
    }

    /// The line coding the host may count on: the one it last asked for successfully.
    pub fn line_coding(&self) -> LineCoding {
        self.wanted_next
            .or(self.wanted)
            .map_or(self.coding, |(wanted, _)| wanted)
    }

    // ---- The control interface on USB ----

    /// Whether the next packet on the control interface may be taken.
    pub fn control_room(&self) -> bool {
        true
    }

    /// The host sent a packet on the control interface. Ask [`control_room`](Self::control_room) before.
    pub fn control_received(&mut self, packet: &[u8], now: Micros) {
        let _ = (packet, now, &self.identity);
    }

    /// Whether [`control_transmit`](Self::control_transmit) has a packet.
    pub fn control_due(&self) -> bool {
        false
    }

    /// Moves the next packet of the control interface into `packet` and returns its length. `None` when nothing is due.
    pub fn control_transmit(&mut self, packet: &mut [u8; PACKET]) -> Option<usize> {
        let _ = packet;
        None
    }

    // ---- The CAN bus ----

    /// A frame came from the bus.
    pub fn can_received(&mut self, frame: &can::Frame, now: Micros) {
        let _ = (frame, now);
    }

    /// Whether [`can_transmit`](Self::can_transmit) has a frame.
    pub fn can_due(&self, now: Micros) -> bool {
        let _ = now;
        false
    }

    /// The next frame for the bus, in the order of urgency. `None` when there is none now. Do not hold more than the
    /// controller can: what waits here can still be overtaken.
    pub fn can_transmit(&mut self, now: Micros) -> Option<can::Frame> {
        let _ = now;
        None
    }

    /// The CAN controller reported errors.
    pub fn can_errors(&mut self, errors: CanErrors) {
        let _ = errors;
    }

    /// The CAN controller left the bus (`off`), or is back on it.
    pub fn can_bus_off(&mut self, off: bool, now: Micros) {
        let _ = (off, now);
    }

    /// What the CAN controller is to be. It changes with an [`Action::RestartCan`].
    pub fn can_config(&self) -> config::Can {
        self.config.can
    }

    // ---- Time, and what only firmware can do ----

    /// When [`tick`](Self::tick) has something to do, perhaps at a time that has passed. `None` when it will not unless
    /// something happens before.
    pub fn timeout(&self) -> Option<Micros> {
        None
    }

    /// It is `now`.
    pub fn tick(&mut self, now: Micros) {
        let _ = now;
    }

    /// The next thing that only firmware can do, once.
    pub fn action(&mut self) -> Option<Action> {
        None
    }

    /// What became of [`Action::Save`] or [`Action::Reset`].
    pub fn saved(&mut self, result: Result<(), ()>) {
        let _ = result;
    }

    /// The configuration in force.
    pub fn config(&self) -> Config {
        self.config
    }

    // ---- Health ----

    /// How often the firmware had to start again since power-on, for [`Counters`].
    ///
    /// ```
    /// let mut bridge = armwire_bridge::Bridge::<256, 128>::default();
    /// bridge.started_after(1, 0);
    /// assert_eq!(bridge.counters().panics, 1);
    /// ```
    pub fn started_after(&mut self, panics: u32, watchdog_resets: u32) {
        self.counters.panics = panics;
        self.counters.watchdog_resets = watchdog_resets;
    }

    /// Whether bytes for the arm stopped moving, or nobody has looked at the UART, for a second: something is wrong that
    /// only a restart cures. A host that does not read is no such thing.
    ///
    /// ```
    /// use armwire::Micros;
    ///
    /// let mut bridge = armwire_bridge::Bridge::<256, 128>::default();
    /// bridge.uart_received(&[], Micros(0));
    /// assert!(!bridge.is_stuck(Micros::from_millis(900)));
    /// assert!(bridge.is_stuck(Micros::from_millis(1_100)));
    /// ```
    pub fn is_stuck(&self, now: Micros) -> bool {
        let unsent = !self.down.is_empty() || self.wanted.is_some();
        now.since(self.looked) > PATIENCE || unsent && now.since(self.down_moved) > PATIENCE
    }

    /// Queues bytes for the host, as far as there is one and room.
    fn enqueue(&mut self, bytes: &[u8]) {
        match self.port {
            Port::Detached | Port::Closed => count(&mut self.counters.unheard_bytes, bytes.len()),
            Port::Attached | Port::Open => {
                let dropped = self.up.push(bytes);
                count(&mut self.counters.dropped_bytes, dropped);
            }
        }
    }

    /// Counts the frames and noise the tap has, and returns whether there was a frame.
    fn take_frames(&mut self) -> bool {
        let mut any = false;
        while let Some(next) = self.tap.next(()) {
            match next {
                Ok(_) => {
                    any = true;
                    count(&mut self.counters.frames, 1);
                }
                Err(noise) => count(&mut self.counters.noise_bytes, noise.len),
            }
        }
        any
    }

    /// The first `n` bytes for the host wait no longer.
    fn release(&mut self, n: usize) {
        self.due = self.due.max(n);
        if self.due == 0 && self.transfer == Transfer::Open {
            self.transfer = Transfer::Unterminated;
        }
    }

    /// Drops what was queued for the host that was.
    fn forget(&mut self) {
        count(&mut self.counters.unheard_bytes, self.up.len());
        self.up.clear();
        self.due = 0;
        self.transfer = Transfer::Closed;
    }
}

/// An adapter that does not say what it is, configured as from the factory.
impl<const UP: usize, const DOWN: usize> Default for Bridge<UP, DOWN> {
    fn default() -> Self {
        Self::new(Identity::default(), Config::default())
    }
}

impl<const UP: usize, const DOWN: usize> fmt::Debug for Bridge<UP, DOWN> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Bridge")
            .field("port", &self.port)
            .field("up", &self.up.len())
            .field("down", &self.down.len())
            .field("coding", &self.coding)
            .field("counters", &self.counters)
            .finish_non_exhaustive()
    }
}

fn count(counter: &mut u32, n: usize) {
    *counter = counter.wrapping_add(n as u32);
}
