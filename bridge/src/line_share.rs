//! The line to the arm, and how those who have something to say share it.
//!
//! One at a time: the line is free, or somebody's whose request the arm is about to answer, or the host's on USB that
//! is in the middle of something. Frames that answer a request go to whoever has asked. Everything else that the arm
//! says goes to the host on USB, byte by byte while nobody else waits for an answer.

use armwire::alpha1::Expect;

use crate::arm::{Asked, Piece};
use crate::bridge::{Bridge, Burst, POLL_LEAD_TIME, RxThreshold, Streams};
use crate::control::{Failure, FrameBytes, Initiator, MAX_FRAME, Refusal};
use crate::counters::count;
use crate::exchange::Heard;
use crate::turn::behind;
use crate::{Duration, Instant, Line, UartErrors};

/// How long the host on USB may pause inside a frame before others get their turn.
const STALL: Duration = Duration::from_millis(10);

/// How old what is known of the line may be while bytes come, in nanoseconds.
const AGE: u32 = 1_000_000;

/// How long the line must be quiet, both ways, after bytes that are no frame.
const QUIET: Duration = Duration::from_millis(5);

/// How long others wait at most for one who sends bytes that are no frame.
const RAW_TURN: Duration = Duration::from_millis(100);

/// What the adapter itself may add to the time of an answer: two bytes in the transmitter, a look at the receiver.
const MARGIN: Duration = Duration::from_millis(1);

/// A frame of the arm that is not [shared](Bridge::share) yet. It lies in the tap until more comes.
pub(crate) struct Unshared {
    /// Where in the tap.
    start: u8,
    len: u8,
    initiator: Option<Initiator>,
    at: Instant,
}

impl Bridge {
    // ---- What the arm says ----

    /// The UART was looked at, at the time `now`, and has received `bytes`, perhaps none. The last of them came then:
    /// that is the stamp of the frame it ends.
    ///
    /// Returns whether there was a frame: then ask everything that can be due, and [`share`](Self::share) it when there is
    /// time. Without one only [`usb_due`](Self::usb_due) can have come true. Then ask what to [look for](Self::rx_threshold).
    pub fn uart_received(&mut self, bytes: &[u8], now: Instant) -> bool {
        self.last_rx_poll = now;
        if bytes.is_empty() {
            return false;
        }
        self.last_rx = now;
        count(&mut self.counters.arm_to_host_bytes, bytes.len());
        let mut any = false;
        let mut rest = bytes;
        while !rest.is_empty() {
            self.share();
            rest = self.tap.push(rest);
            self.pass();
            if self.take_pieces(false, now) {
                // What the tap still holds may begin the next frame.
                self.port.release(self.passed);
                any = true;
            }
        }
        any
    }

    /// As [`uart_received`](Self::uart_received), of bytes whose last one no interrupt handler saw come: the stamps of the frames
    /// that they end are late, and counted.
    ///
    /// ```
    /// use armwire_bridge::{Bridge, Instant};
    ///
    /// let mut bridge = Bridge::default();
    /// assert!(bridge.uart_received_unseen(&[0xAA, 0x04, 0x0E, 0x01, 0x02, 0x2C, 0xFF], Instant::from_micros(250)));
    /// assert_eq!(bridge.counters().late_stamps, 1);
    /// ```
    pub fn uart_received_unseen(&mut self, bytes: &[u8], now: Instant) -> bool {
        let before = self.counters.frames;
        let any = self.uart_received(bytes, now);
        let ended = self.counters.frames.wrapping_sub(before);
        self.counters.late_stamps = self.counters.late_stamps.wrapping_add(ended);
        any
    }

    /// The line has been idle for the time of a byte: what has arrived goes out.
    ///
    /// Call [`uart_received`](Self::uart_received) first with what arrived before. Returns the same as that.
    ///
    /// ```
    /// use armwire_bridge::{Bridge, Instant, PACKET};
    ///
    /// let mut bridge = Bridge::default();
    /// bridge.usb_configured(true);
    /// bridge.uart_received(b"what is this", Instant::from_micros(100));
    /// assert_eq!(bridge.usb_transmit(&mut [0; PACKET]), None);
    /// bridge.uart_idle(Instant::from_micros(110));
    /// assert_eq!(bridge.usb_transmit(&mut [0; PACKET]), Some(12));
    /// ```
    pub fn uart_idle(&mut self, now: Instant) -> bool {
        let any = self.take_pieces(true, now);
        self.port.release(self.passed);
        any
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

    /// What to look for on the UART: the end of the next frame, or a full packet.
    ///
    /// An interrupt handler that sees each byte as it comes needs to wake nobody before.
    ///
    /// ```
    /// use armwire_bridge::{Bridge, Instant, RxThreshold};
    ///
    /// let mut bridge = Bridge::default();
    /// let need = bridge.rx_threshold();
    /// assert_eq!(need, RxThreshold { max: 64, min: 6, terminator: Some(0xFF) });
    /// assert!(need.is_met(7, 0xFF) && !need.is_met(7, 0xFE));
    /// bridge.uart_received(&[0xAA, 0x06, 0x00, 0x0F], Instant::ZERO);
    /// assert_eq!(bridge.rx_threshold(), RxThreshold { max: 17, min: 17, terminator: None });
    /// ```
    pub fn rx_threshold(&self) -> RxThreshold {
        let (kind, expect) = (self.config.arm, self.exchange.expect());
        let heard = AGE.checked_div(self.rate.byte_nanos()).unwrap_or(0) as usize;
        let room = self.port.need();
        match self.tap.ending(kind, expect) {
            Some((mark, least)) => RxThreshold {
                max: heard.max(least).min(room),
                min: least,
                terminator: Some(mark),
            },
            None => {
                let most = self.tap.need(kind, expect).min(heard.max(1)).min(room);
                RxThreshold {
                    max: most,
                    min: most,
                    terminator: None,
                }
            }
        }
    }

    /// Passes what the tap has not decided on to the host on USB, unless it may be for another.
    fn pass(&mut self) {
        if self.tap.pending() > self.passed && !self.exchange.is_not_usbs() {
            let window = self.tap.window();
            self.port
                .push(window.get(self.passed..).unwrap_or_default(), &mut self.counters);
            self.passed = window.len();
        }
    }

    /// Takes what the tap has decided on, and returns whether there was a frame.
    fn take_pieces(&mut self, idle: bool, now: Instant) -> bool {
        let mut any = false;
        while self.tap.pending() > 0 {
            self.share();
            let start = self.tap.head();
            let expect = self.exchange.expect();
            let Some(piece) = self.tap.next(self.config.arm, expect, idle) else {
                break;
            };
            let (Piece::Frame(bytes) | Piece::Noise(bytes) | Piece::Fill(bytes)) = piece;
            let unpassed = bytes.get(self.passed..).unwrap_or_default();
            let fresh = self.passed == 0 || !self.exchange.is_not_usbs();
            self.passed = self.passed.saturating_sub(bytes.len());
            match piece {
                Piece::Frame(_) => {}
                Piece::Noise(_) => {
                    count(&mut self.counters.noise_bytes, bytes.len());
                    self.port.push(unpassed, &mut self.counters);
                    continue;
                }
                Piece::Fill(_) => {
                    self.port.push(unpassed, &mut self.counters);
                    continue;
                }
            }
            any = true;
            count(&mut self.counters.frames, 1);
            let key = self.config.arm.key_of_answer(bytes);
            let began = now - on_wire(self.rate.byte_nanos(), bytes.len().saturating_sub(1));
            let initiator = match self.exchange.hear(key, fresh, began, now) {
                Heard::Answer(initiator, after) => {
                    if let Some(after) = after {
                        self.latencies.answer.add(after);
                    }
                    Some(initiator)
                }
                Heard::Late => {
                    count(&mut self.counters.late_answers, 1);
                    None
                }
                Heard::Unasked => {
                    count(&mut self.counters.unasked_frames, 1);
                    None
                }
            };
            if matches!(initiator, None | Some(Initiator::Usb)) {
                self.port.push(unpassed, &mut self.counters);
            }
            self.unshared = Some(Unshared {
                start: start as u8,
                len: bytes.len() as u8,
                initiator,
                at: now,
            });
            if let Some(initiator) = initiator.filter(|_| self.exchange.holder().is_none()) {
                let answer = match initiator {
                    Initiator::Adapter => FrameBytes::from_slice(bytes).ok(),
                    _ => None,
                };
                self.ended(initiator, answer, now);
            }
        }
        any
    }

    /// Passes the last frame to a host on CAN and to whoever else is to be told of it, unless that was done.
    ///
    /// Whatever tells them something does so first. Call it when there is time: until then, the host on USB and the next
    /// request need not wait for it. Then ask [`can_due`](Self::can_due), [`control_due`](Self::control_due) and
    /// [`timeout`](Self::timeout).
    ///
    /// ```
    /// use armwire_bridge::{Bridge, Instant};
    /// use armwire_bridge::config::{Can, Config};
    /// use armwire_bridge::control::Identity;
    ///
    /// let can = Can { unsolicited: true, ..Can::default() };
    /// let mut bridge = Bridge::new(Identity::default(), Config { can, ..Config::default() });
    /// assert!(bridge.uart_received(&[0xAA, 0x04, 0x0E, 0x01, 0x02, 0x2C, 0xFF], Instant::from_micros(100)));
    /// bridge.share();
    /// assert!(bridge.can_due(Instant::from_micros(100)));
    /// ```
    pub fn share(&mut self) {
        let Some(Unshared {
            start,
            len,
            initiator,
            at,
        }) = self.unshared.take()
        else {
            return;
        };
        let bytes = self.tap.given(start.into(), len.into());
        // Of the bus there is, which is not yet another.
        let telemetry = self.can.config().telemetry_hz > 0;
        if telemetry && let Some(state) = self.config.arm.joints(bytes) {
            self.can.state(state, at);
        }
        let on_can = match initiator {
            Some(initiator) => initiator == Initiator::Can,
            None => self.config.can.unsolicited,
        };
        if on_can && !self.can.answer(bytes) {
            count(&mut self.counters.dropped_can_answers, 1);
        }
        self.control
            .frame(at, initiator, bytes, &mut self.can, &mut self.counters);
    }

    /// The exchange of `initiator` is over, with this answer if there is one and somebody wants it.
    fn ended(&mut self, initiator: Initiator, answer: Option<FrameBytes>, now: Instant) {
        self.close(initiator, answer, now);
        if initiator == Initiator::Adapter {
            self.serve(now);
        }
    }

    /// Notes that the exchange of `initiator` is over. What that lets the control port answer is not answered yet.
    fn close(&mut self, initiator: Initiator, answer: Option<FrameBytes>, now: Instant) {
        self.turn.went(now);
        match initiator {
            Initiator::Poll => {
                let missed = self.poll.ended(now);
                count(&mut self.counters.missed_polls, missed);
            }
            Initiator::Adapter => self.control.arm_identified(Ok(answer)),
            Initiator::Usb | Initiator::Can | Initiator::Command => {}
        }
        self.pass();
    }

    // ---- What is said to the arm ----

    /// Whether [`uart_transmit`](Self::uart_transmit) has bytes or [`line_change`](Self::line_change) has something.
    pub fn uart_due(&self, now: Instant) -> bool {
        self.line_change().is_some() || self.next(now).is_some()
    }

    /// Moves bytes for the arm to the front of `out`. `None` when there are none now, or when the line has to change
    /// first.
    ///
    /// Give it room for a whole frame, [`MAX_FRAME`](crate::control::MAX_FRAME) bytes. Ask when the UART can take them
    /// at once, and hand them over at once, or when [`Burst::start`] says.
    ///
    /// ```
    /// use armwire_bridge::config::{Config, Poll};
    /// use armwire_bridge::control::Identity;
    /// use armwire_bridge::{Bridge, Burst, POLL_LEAD_TIME, Instant};
    ///
    /// // A poll goes out at its slot, which is on a fixed grid from the first tick on.
    /// let config = Config { poll: Poll::Hertz(100), ..Config::default() };
    /// let mut bridge = Bridge::new(Identity::default(), config);
    /// bridge.tick(Instant::from_micros(500));
    /// assert_eq!(bridge.timeout(), Some(Instant::from_micros(10_500) - POLL_LEAD_TIME));
    /// let now = Instant::from_micros(10_480);
    /// bridge.tick(now);
    /// let burst = bridge.uart_transmit(&mut [0; 70], now);
    /// assert_eq!(burst, Some(Burst { len: 7, start: Some(Instant::from_micros(10_500)) }));
    /// ```
    pub fn uart_transmit(&mut self, out: &mut [u8], now: Instant) -> Option<Burst> {
        self.tick_line(now);
        self.tick_hold(now);
        if self.line_change().is_some() {
            return None;
        }
        let (len, start) = match self.next(now)? {
            Initiator::Usb => (self.say_usb(out, now), None),
            _ if out.len() < MAX_FRAME => return None,
            Initiator::Poll => self.say_poll(out, now)?,
            initiator => (self.say_waiting(initiator, out, now)?, None),
        };
        count(&mut self.counters.host_to_arm_bytes, len);
        (len > 0).then_some(Burst { len, start })
    }

    /// What the line is to be, once every byte before that has been handed to the UART and the answer to another's
    /// request is in.
    pub fn line_change(&self) -> Option<Line> {
        let line = self.rate.change(self.down.len())?;
        // Torque-off waits for nobody's answer.
        (self.torque_off.is_some() || !self.exchange.is_not_usbs()).then_some(line)
    }

    /// The UART works like this from here on. A frame that had begun will not end.
    pub fn line_changed(&mut self, line: Line) {
        self.uart_idle(self.last_rx_poll);
        self.cut_usb();
        self.rate.changed(line);
        self.follow_holder(self.last_rx_poll);
        count(&mut self.counters.line_codings, 1);
    }

    /// Whose turn it is now, if anybody's.
    fn next(&self, now: Instant) -> Option<Initiator> {
        if self.torque_off.is_some() && !self.usb_speaks() {
            // It waits for nobody's answer.
            return Some(Initiator::Adapter);
        }
        if self.exchange.is_not_usbs() {
            return None;
        }
        let ready = |initiator| self.is_ready(initiator, now);
        // More of what was begun, or more requests while nobody else has one.
        if self.usb_speaks() || self.others_are_silent(now) {
            return ready(Initiator::Usb).then_some(Initiator::Usb);
        }
        if self.exchange.holder().is_some() {
            let usb = ready(Initiator::Usb) && !self.others_wait(now);
            return usb.then_some(Initiator::Usb);
        }
        // Nearly always only the poll is left.
        if self.down.is_empty() && self.all_but_the_poll_are_silent() {
            return ready(Initiator::Poll).then_some(Initiator::Poll);
        }
        // A poll must be on time, but whoever has waited for one does not wait for the next.
        let urgent = self.poll.is_urgent();
        let passed_over = |initiator: Initiator| {
            initiator != Initiator::Poll
                && ready(initiator)
                && self.turn.last == Initiator::Poll
                && self.since(initiator, now) <= Some(self.turn.polled)
        };
        if urgent && ready(Initiator::Poll) && !Initiator::ALL.into_iter().any(passed_over) {
            return Some(Initiator::Poll);
        }
        let mut initiator = self.turn.rotated;
        for _ in Initiator::ALL {
            initiator = behind(initiator);
            // If a poll that must be on time is still here, it is not its turn.
            if ready(initiator) && !(initiator == Initiator::Poll && urgent) {
                return Some(initiator);
            }
        }
        None
    }

    /// Whether nobody but the host on USB has anything to say, which is so nearly always.
    fn others_are_silent(&self, now: Instant) -> bool {
        self.all_but_the_poll_are_silent() && self.poll.due_since(POLL_LEAD_TIME, now).is_none()
    }

    /// The same, the poll aside.
    fn all_but_the_poll_are_silent(&self) -> bool {
        self.can_requests.is_empty() && self.command.is_none() && self.torque_off.is_none() && self.identify.is_none()
    }

    /// Whether anybody but the host on USB could speak, or could but for an answer that may be late.
    fn others_wait(&self, now: Instant) -> bool {
        let [_, others @ ..] = Initiator::ALL;
        !self.others_are_silent(now)
            && others
                .into_iter()
                .any(|initiator| self.is_ready(initiator, now) || self.is_held_back(initiator, now))
    }

    /// Whether `initiator` could speak if it were its turn: it has something to say, and an answer to that could be told from
    /// one that is late.
    fn is_ready(&self, initiator: Initiator, now: Instant) -> bool {
        match initiator {
            Initiator::Usb => {
                !self.down.is_empty() && self.rate.change(self.down.len()).is_none() && self.usb_may_go(now)
            }
            Initiator::Command => self.command.is_some(),
            Initiator::Adapter if self.torque_off.is_some() => true,
            _ => self.asks(initiator, now).is_some_and(|request| self.may_go(request)),
        }
    }

    /// The request with which `initiator` waits, of those that get an answer.
    fn asks(&self, initiator: Initiator, now: Instant) -> Option<&[u8]> {
        match initiator {
            Initiator::Usb | Initiator::Command => None,
            Initiator::Can => {
                let request = self.can_requests.front().filter(|_| self.can_change.is_none())?;
                Some(&request.bytes)
            }
            Initiator::Poll => self
                .config
                .arm
                .poll()
                .filter(|_| self.poll.due_since(POLL_LEAD_TIME, now).is_some()),
            Initiator::Adapter => self.config.arm.identify().filter(|_| self.identify.is_some()),
        }
    }

    /// Whether `initiator` waits only because its answer could not be told from one that is late.
    fn is_held_back(&self, initiator: Initiator, now: Instant) -> bool {
        !self.exchange.owes_nothing() && self.asks(initiator, now).is_some_and(|request| !self.may_go(request))
    }

    /// Whether the host on USB may go on: with others on the line, it does not ask again what may be answered late either.
    /// Alone it may, for it hears every answer.
    fn usb_may_go(&self, now: Instant) -> bool {
        // Nearly always no answer is late. What was begun is not held back.
        if self.exchange.owes_nothing() || self.usb_speaks() {
            return true;
        }
        let alone = !self.turn.is_shared(now) && self.others_are_silent(now);
        alone || self.usb_asks_anew()
    }

    /// Whether what the host on USB asks next is answered unlike all that may be late.
    // Not inlined: it is seldom needed.
    #[inline(never)]
    fn usb_asks_anew(&self) -> bool {
        let mut next = [0; MAX_FRAME];
        let len = self.down.peek(&mut next);
        let asked = self.config.arm.asked_first(next.get(..len).unwrap_or_default());
        asked.is_none_or(|asked| asked.reply.is_none() || !self.exchange.is_owed(asked.key))
    }

    /// Since when `initiator` has had something to say.
    // Inlined for each of them it takes more room than all else that asks.
    #[inline(never)]
    fn since(&self, initiator: Initiator, now: Instant) -> Option<Instant> {
        match initiator {
            Initiator::Usb => Some(self.turn.usb_moved),
            Initiator::Can => self.can_requests.front().map(|request| request.since),
            Initiator::Command => self.command.as_ref().map(|request| request.since),
            Initiator::Poll => self.poll.due_since(POLL_LEAD_TIME, now),
            Initiator::Adapter => self.torque_off.or(self.identify),
        }
    }

    /// Whether an answer to this request could be told from one that is late.
    fn may_go(&self, request: &[u8]) -> bool {
        // Nearly always no answer is late, and what is asked need not be known.
        if self.exchange.owes_nothing() {
            return true;
        }
        let asked = self.config.arm.asked(request);
        asked.reply.is_none() || !self.exchange.is_owed(asked.key)
    }

    /// Moves bytes of the host on USB to the front of `out`, up to the end of a request if others wait.
    fn say_usb(&mut self, out: &mut [u8], now: Instant) -> usize {
        if self.usb_is_held_back() {
            self.streams.usb.hear(now);
        }
        // A request at a time while it matters which.
        let others = self.others_wait(now) || !self.exchange.owes_nothing();
        if !self.usb_speaks() {
            self.turn.usb_began = now;
        }
        self.turn.taken(Initiator::Usb, true);
        let before = self.rate.before_change(out.len());
        let out = out.get_mut(..before).unwrap_or_default();
        let mut said = 0;
        while said < out.len() {
            let room = out.get_mut(said..).unwrap_or_default();
            let want = match others {
                true => self.asks.need(self.config.arm, Expect::Requests).min(room.len()),
                false => room.len(),
            };
            let room = room.get_mut(..want).unwrap_or_default();
            let taken = self.down.pop(room);
            if taken == 0 {
                break;
            }
            self.turn.usb_went(self.asks.pending() == 0, now);
            said = said.saturating_add(taken);
            let end = now + on_wire(self.rate.byte_nanos(), said);
            let whole = self.hear_usb(room.get(..taken).unwrap_or_default(), end, now);
            if others && whole && self.asks.pending() == 0 {
                break;
            }
        }
        self.rate.sent(said);
        said
    }

    /// Listens in on bytes of the host on USB, the last of which is out at `end`. Whether a request ended.
    fn hear_usb(&mut self, bytes: &[u8], end: Instant, now: Instant) -> bool {
        let mut whole = false;
        let mut rest = bytes;
        // At another rate the arm may take them for the beginning of anything.
        self.turn.is_cut |= !self.rate.is_arms();
        while !rest.is_empty() {
            rest = self.asks.push(rest);
            while let Some(piece) = self.asks.next(self.config.arm, Expect::Requests, false) {
                if let Piece::Frame(frame) = piece {
                    let asked = self.config.arm.asked(frame);
                    let behind = rest.len().saturating_add(self.asks.pending());
                    let sent = end - on_wire(self.rate.byte_nanos(), behind);
                    (whole, self.turn.raw, self.turn.is_cut) = (true, false, !self.rate.is_arms());
                    count(&mut self.counters.requests_usb, 1);
                    self.latencies.turn.add(self.turn.usb_waited());
                    self.begin(Initiator::Usb, asked, sent);
                    // No arm understands another rate, and under `hold-line` nobody's torque goes off.
                    let counts = self.rate.is_arms() && !self.rate.is_on_hold();
                    if asked.moves && counts {
                        self.streams.usb.motion(self.config.host_timeout.after(), now);
                    } else if asked.holds && counts {
                        self.streams.usb.end();
                    }
                } else {
                    self.turn.raw = true;
                }
            }
        }
        whole
    }

    /// Moves the poll to the front of `out`. It is to start at its slot.
    fn say_poll(&mut self, out: &mut [u8], now: Instant) -> Option<(usize, Option<Instant>)> {
        if self.turn.is_cut {
            return Some((self.end_cut(out, now)?, None));
        }
        let request = self.config.arm.poll()?;
        let len = copy(request, out)?;
        let slot = self.poll.slot();
        let start = slot.filter(|slot| *slot > now);
        if let Some(slot) = slot {
            self.latencies.poll.add(now.since(slot));
            count(&mut self.counters.late_polls, usize::from(now > slot));
        }
        self.poll.began();
        self.turn.polled = now;
        let asked = self.config.arm.asked(request);
        self.say(Initiator::Poll, asked, len, start.unwrap_or(now));
        Some((len, start))
    }

    /// Moves the request of another to the front of `out`.
    fn say_waiting(&mut self, initiator: Initiator, out: &mut [u8], now: Instant) -> Option<usize> {
        if self.turn.is_cut {
            return self.end_cut(out, now);
        }
        let (len, since, asked) = match initiator {
            Initiator::Can => {
                let request = self.can_requests.pop_front()?;
                if request.asked.holds {
                    self.streams.can.end();
                }
                self.take_can_request(now);
                (copy(&request.bytes, out)?, request.since, request.asked)
            }
            Initiator::Command => {
                let request = self.command.take()?;
                (copy(&request.bytes, out)?, request.since, request.asked)
            }
            _ => {
                let (request, since) = match self.torque_off.take() {
                    Some(since) => (self.config.arm.torque_off()?, since),
                    None => (self.config.arm.identify()?, self.identify.take()?),
                };
                (copy(request, out)?, since, self.config.arm.asked(request))
            }
        };
        self.latencies.turn.add(now.since(since));
        self.say(initiator, asked, len, now);
        Some(len)
    }

    /// Moves zeros to the front of `out`: they end whatever the host on USB had begun, and no frame ends with one. An arm
    /// that waits for the rest of a frame would take another's request for that.
    fn end_cut(&mut self, out: &mut [u8], now: Instant) -> Option<usize> {
        let out = out.get_mut(..MAX_FRAME)?;
        out.fill(0);
        self.turn.is_cut = false;
        count(&mut self.counters.requests_adapter, 1);
        self.turn.taken(Initiator::Adapter, false);
        self.turn.went(now);
        Some(out.len())
    }

    /// A request of `len` bytes goes out at `start`.
    fn say(&mut self, initiator: Initiator, asked: Asked, len: usize, start: Instant) {
        let counter = match initiator {
            Initiator::Usb => &mut self.counters.requests_usb,
            Initiator::Can => &mut self.counters.requests_can,
            Initiator::Poll => &mut self.counters.requests_poll,
            Initiator::Command => &mut self.counters.requests_command,
            Initiator::Adapter => &mut self.counters.requests_adapter,
        };
        count(counter, 1);
        self.turn
            .taken(initiator, initiator != Initiator::Poll || !self.poll.is_urgent());
        self.turn.others_had = Some(start);
        self.turn.went(start);
        self.begin(initiator, asked, start + on_wire(self.rate.byte_nanos(), len));
    }

    /// A request is out at `sent`.
    fn begin(&mut self, initiator: Initiator, asked: Asked, sent: Instant) {
        if let Some(reply) = asked.reply {
            let on_wire = on_wire(self.rate.byte_nanos(), reply.len.into());
            let patience = Duration::from_micros(reply.turnaround.into()) + on_wire + MARGIN;
            self.exchange.begin(initiator, asked, sent, patience);
        }
    }

    /// Whether the host on USB is in the middle of something that is not to be mixed with what others say.
    fn usb_speaks(&self) -> bool {
        self.turn.raw || self.asks.pending() > 0
    }

    /// Until when the host on USB has the line to itself while others wait and it is silent.
    pub(crate) fn hold_timeout(&self) -> Option<Instant> {
        if !self.usb_speaks() || self.exchange.holder().is_some() && self.torque_off.is_none() {
            return None;
        }
        let now = Instant::ZERO;
        let [_, others @ ..] = Initiator::ALL;
        let ready = others.into_iter().filter(|initiator| self.is_ready(*initiator, now));
        let since = ready.filter_map(|initiator| self.since(initiator, now)).min()?;
        let quiet = match self.asks.pending() {
            0 => self.turn.usb_moved.max(self.last_rx) + QUIET,
            _ => self.turn.usb_moved + STALL,
        };
        Some(quiet.min(since.max(self.turn.usb_began) + RAW_TURN))
    }

    /// When the command that waits for its turn is too old to move the arm.
    pub(crate) fn command_timeout(&self) -> Option<Instant> {
        let timeout = Duration::from_millis(self.config.can.command_timeout_ms.into());
        self.command.as_ref().map(|command| command.since + timeout)
    }

    /// The command that waits for its turn moves nothing any more.
    // Not inlined: it is seldom needed.
    #[inline(never)]
    pub(crate) fn drop_command(&mut self, now: Instant) {
        if self.command.take().is_some() {
            self.refuse(Initiator::Command, Refusal::Stale, now);
        }
    }

    /// What the host on USB has begun to say is not waited for any more.
    pub(crate) fn cut_usb(&mut self) {
        self.turn.is_cut |= self.asks.pending() > 0;
        self.asks.clear();
    }

    /// It is `now`: late answers are given up, polls become due, and old commands are dropped.
    pub(crate) fn tick_line(&mut self, now: Instant) {
        let holder = self.exchange.holder();
        let missing = self.exchange.tick(now);
        count(&mut self.counters.unanswered_requests, missing);
        if let (Some(initiator), None) = (holder, self.exchange.holder()) {
            self.ended(initiator, None, now);
        }
        let missed = self.poll.tick(POLL_LEAD_TIME, now);
        count(&mut self.counters.missed_polls, missed);
        if self.command_timeout().is_some_and(|at| at <= now) {
            self.drop_command(now);
        }
    }

    /// It is `now`: a host on USB that has paused loses the turn.
    pub(crate) fn tick_hold(&mut self, now: Instant) {
        if self.hold_timeout().is_some_and(|at| at <= now) {
            self.cut_usb();
            self.turn.raw = false;
        }
    }

    /// Asks the arm what it is, when it is its turn.
    pub(crate) fn identify_arm(&mut self, now: Instant) {
        match self.config.arm.identify() {
            Some(_) if self.is_held => {
                self.refuse(Initiator::Adapter, Refusal::LineHeld, now);
                self.control.arm_identified(Err(Failure::LineHeld));
            }
            Some(_) => self.identify = Some(now),
            None => self.control.arm_identified(Ok(None)),
        }
    }

    /// Another kind of arm is there: what was said to and by the one before is over.
    pub(crate) fn change_arm(&mut self, now: Instant) {
        let holder = self.exchange.holder();
        let missing = self.exchange.abandon();
        count(&mut self.counters.unanswered_requests, missing);
        if let Some(initiator) = holder {
            self.close(initiator, None, now);
        }
        self.tap.clear();
        self.asks.clear();
        (self.passed, self.turn.raw) = (0, false);
        self.torque_off = None;
        self.can.stop_commands();
        if self.command.take().is_some() {
            self.refuse(Initiator::Command, Refusal::NotAFrame, now);
        }
        for initiator in Streams::INITIATORS {
            self.end_stream(initiator, 0, false, now);
        }
        if self.identify.take().is_some() {
            self.identify_arm(now);
        }
        while self.can_requests.pop_front().is_some() {
            self.refuse(Initiator::Can, Refusal::NotAFrame, now);
        }
        self.take_can_request(now);
    }
}

/// How long a frame takes on a line on which a byte takes so many nanoseconds. To divide by the baud rate each time would
/// cost more than all else that is done with it.
fn on_wire(byte_nanos: u32, len: usize) -> Duration {
    Duration::from_micros(u64::from((len as u32).saturating_mul(byte_nanos) / 1_000))
}

/// Copies a whole request.
fn copy(request: &[u8], out: &mut [u8]) -> Option<usize> {
    out.get_mut(..request.len())?.copy_from_slice(request);
    Some(request.len())
}
