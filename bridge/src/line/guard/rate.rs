//! The line's rate, set by the arm's kind or by the host on USB, and the reservation of the line for USB.

use crate::config::ArmKind;
use crate::control::{Initiator, LineReservation, LineState};
use crate::earliest::Earliest;
use crate::line::byte_time::ByteTime;
use crate::line_coding::{LineCoding, UartConfig};
use armwire::time::{Duration, Instant};

/// The control port of a host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ControlPort {
    /// The control interface on USB.
    Usb,
    /// The control connection on CAN.
    Can,
}

impl ControlPort {
    /// The host on this port.
    pub(crate) const fn initiator(self) -> Initiator {
        match self {
            Self::Usb => Initiator::Usb,
            Self::Can => Initiator::Can,
        }
    }
}

/// Time after SET_LINE_CODING at which an open port gets its rate without a byte: many programs set two rates in a row,
/// and only the last one counts.
const SETTLE: Duration = Duration::from_millis(100);

/// Time without a byte in either direction after which a host without DTR loses its rate.
const IDLE: Duration = Duration::from_millis(10_000);

/// Duration of a reservation by [`ReserveLine`](crate::control::Request::ReserveLine).
const RESERVATION: Duration = Duration::from_millis(crate::control::RESERVATION_MS as u64);

/// A change of the line between bytes of the host on USB.
#[derive(Clone, Copy)]
struct Change {
    to: UartConfig,
    /// Number of bytes that go out before the change.
    behind: usize,
}

/// The UART's configuration, its pending changes, and the reservation of the line.
pub(crate) struct LineRate {
    line: UartConfig,
    byte_time: ByteTime,
    /// The arm's own line.
    arm: UartConfig,
    /// The arm has a fixed rate. Without one, the host on USB sets it.
    has_own_rate: bool,
    /// The next change. The bytes queued after it wait for it.
    step: Option<Change>,
    /// The target configuration, reached when no bytes wait.
    goal: UartConfig,
    /// The line coding that the host on USB last set, in effect or not.
    requested: LineCoding,
    /// With the port open: the time at which `requested` takes effect without a byte. Otherwise: the time of the next
    /// check whether the host was idle for [`IDLE`].
    deadline: Option<Instant>,
    /// Torque-off took the line from the host. The host's rate stays out of effect until it sets one.
    revoked: bool,
    /// Bytes of the host were refused since it set its rate.
    refused: bool,
    dtr: bool,
    /// The port that requested a reservation, and the end of it.
    reserved: Option<(ControlPort, Instant)>,
}

impl LineRate {
    /// A UART in its default configuration, [`UartConfig::default`], that must change to the arm's.
    pub(crate) fn new(kind: ArmKind) -> Self {
        let (line, arm) = (UartConfig::default(), kind.uart());
        Self {
            line,
            byte_time: ByteTime::of(line.coding),
            arm,
            has_own_rate: kind.has_own_rate(),
            step: None,
            goal: arm,
            requested: arm.coding,
            deadline: None,
            revoked: false,
            refused: false,
            dtr: false,
            reserved: None,
        }
    }

    /// Duration of a byte on the line.
    pub(crate) const fn byte_time(&self) -> ByteTime {
        self.byte_time
    }

    /// The line coding that the host on USB last set.
    pub(crate) const fn requested(&self) -> LineCoding {
        self.requested
    }

    // ---- Changes of the UART ----

    /// The change that is due before anything else goes out. `queued` bytes of the host on USB wait.
    pub(crate) fn change(&self, queued: usize) -> Option<UartConfig> {
        let (to, behind) = match &self.step {
            Some(step) => (&step.to, step.behind),
            None => (&self.goal, queued),
        };
        Some(*to).filter(|to| behind == 0 && *to != self.line)
    }

    /// Returns true if a change is pending.
    #[inline(never)]
    pub(crate) fn changes(&self) -> bool {
        self.step.is_some() || self.goal != self.line
    }

    /// Number of bytes of the host on USB that may go out before the next change, at most `most`.
    pub(crate) fn before_change(&self, most: usize) -> usize {
        self.step.map_or(most, |step| step.behind.min(most))
    }

    /// This many bytes of the host on USB went out.
    pub(crate) fn sent(&mut self, bytes: usize) {
        if let Some(step) = &mut self.step {
            step.behind = step.behind.saturating_sub(bytes);
        }
    }

    /// The unsent bytes of the host on USB were dropped.
    pub(crate) fn dropped(&mut self) {
        self.step = None;
    }

    /// The UART has this configuration now.
    pub(crate) fn changed(&mut self, line: UartConfig) {
        let _ = self.step.take_if(|step| step.to == line);
        self.line = line;
        self.byte_time = ByteTime::of(line.coding);
    }

    /// Schedules a change after the `queued` bytes of the host on USB.
    fn schedule(&mut self, to: UartConfig, queued: usize) {
        // No packet is accepted while bytes wait for a change: the next change therefore comes after all of them.
        if self.step.is_none_or(|step| step.behind == queued) {
            self.step = (to != self.line).then_some(Change { to, behind: queued });
        }
        self.goal = to;
    }

    // ---- The host on USB ----

    /// The host on USB sent SET_LINE_CODING after `queued` bytes. The arm's own rate takes effect after these; another
    /// one with the next byte or, while the port is open, after 100 ms.
    pub(crate) fn request(&mut self, coding: LineCoding, queued: usize, now: Instant) {
        (self.requested, self.revoked, self.refused) = (coding, false, false);
        if !self.has_own_rate {
            self.arm.coding = coding;
        }
        match coding == self.arm.coding {
            true => self.release(queued),
            false if self.dtr => self.deadline = Some(now + SETTLE),
            false => {}
        }
    }

    /// Returns true if the host's rate differs from the one that the line will have.
    pub(crate) fn is_unmet(&self) -> bool {
        self.goal.coding != self.requested
    }

    /// Returns true if the host's rate stays out of effect until it sets one.
    pub(crate) const fn is_revoked(&self) -> bool {
        self.revoked
    }

    /// Schedules the host's rate after the `queued` bytes.
    pub(crate) fn take(&mut self, queued: usize, now: Instant) {
        let to = UartConfig {
            coding: self.requested,
            half_duplex: self.arm.half_duplex,
        };
        self.schedule(to, queued);
        self.deadline = (!self.dtr).then(|| now + IDLE);
    }

    /// Bytes of the host on USB are refused. Returns true for the first since it set its rate.
    pub(crate) fn refuse(&mut self) -> bool {
        !core::mem::replace(&mut self.refused, true)
    }

    /// The host raised or lowered DTR.
    pub(crate) fn dtr(&mut self, high: bool, queued: usize, now: Instant) {
        let fell = self.dtr && !high;
        let rose = high && !self.dtr;
        self.dtr = high;
        if fell {
            (self.revoked, self.refused) = (false, false);
            self.release(queued);
        } else if rose && !self.revoked {
            // The host's driver may rely on the rate that an earlier program set.
            self.deadline = Some(now + SETTLE);
        }
    }

    /// The line returns to the arm's rate after the `queued` bytes. The host's next byte puts its own rate back into
    /// effect.
    pub(crate) fn release(&mut self, queued: usize) {
        self.deadline = None;
        if self.is_other(&self.goal) {
            self.schedule(self.arm, queued);
        }
    }

    /// The host is gone. The rate that it set is discarded.
    pub(crate) fn reset(&mut self, queued: usize) {
        self.release(queued);
        self.requested = self.arm.coding;
        (self.revoked, self.refused, self.dtr) = (false, false, false);
    }

    /// Changes the kind of arm. Its line coding follows after the `queued` bytes and replaces the host's.
    pub(crate) fn set_arm(&mut self, kind: ArmKind, queued: usize) {
        let arm = kind.uart();
        (self.arm, self.has_own_rate) = (arm, kind.has_own_rate());
        (self.requested, self.revoked, self.refused) = (arm.coding, false, false);
        self.deadline = None;
        if self.goal != arm {
            self.schedule(arm, queued);
        }
    }

    /// Returns the line to the arm's rate at once, for torque-off. Returns true if another rate was in effect or
    /// pending.
    pub(crate) fn revoke(&mut self) -> bool {
        if self.is_arms() && !self.changes() {
            return false;
        }
        (self.step, self.goal) = (None, self.arm);
        self.revoked = self.requested != self.arm.coding;
        self.deadline = None;
        true
    }

    // ---- The reservation of the line ----

    /// Returns true if the line has the arm's rate.
    pub(crate) fn is_arms(&self) -> bool {
        !self.is_other(&self.line)
    }

    /// Returns true if the line is reserved for the host on USB: polls and CAN are refused.
    pub(crate) fn is_reserved(&self, queued: usize) -> bool {
        self.reserved.is_some() || self.has_other_rate(queued)
    }

    /// Returns true if a control port has requested the reservation.
    pub(crate) const fn is_reserved_by_request(&self) -> bool {
        self.reserved.is_some()
    }

    /// Returns true if the line has or will have a rate other than the arm's, until the last byte at that rate is out.
    fn has_other_rate(&self, queued: usize) -> bool {
        let is_coming = |step: &Change| self.is_other(&step.to);
        self.is_other(&self.goal)
            || self.step.as_ref().is_some_and(is_coming)
            || self.is_other(&self.line) && self.change(queued).is_none()
    }

    // Not inlined: it has many callers.
    #[inline(never)]
    fn is_other(&self, line: &UartConfig) -> bool {
        line.coding != self.arm.coding
    }

    /// Begins or renews the reservation of `port`. Returns false if the other port has reserved the line.
    pub(crate) fn reserve(&mut self, port: ControlPort, now: Instant) -> bool {
        let is_free = self.reserved.is_none_or(|(by, _)| by == port);
        if is_free {
            self.reserved = Some((port, now + RESERVATION));
        }
        is_free
    }

    /// Ends the reservation of `port`.
    pub(crate) fn end_reservation(&mut self, port: ControlPort) {
        let _ = self.reserved.take_if(|(by, _)| *by == port);
    }

    /// The state for [`Reply::Line`](crate::control::Reply::Line).
    #[inline(never)]
    pub(crate) fn state(&self, queued: usize) -> LineState {
        let reservation = match self.reserved {
            Some(_) => LineReservation::Requested,
            None if self.has_other_rate(queued) => LineReservation::OtherRate,
            None => LineReservation::None,
        };
        let is_wanted = self.dtr || self.revoked;
        let waiting = if is_wanted { self.requested } else { self.goal.coding };
        LineState {
            coding: self.line.coding,
            arm: self.arm.coding,
            reservation,
            waiting: Some(waiting).filter(|waiting| *waiting != self.line.coding),
        }
    }

    // ---- Time ----

    /// The time of the next [`tick`](Self::tick). Without `may`, the host's rate is deferred.
    pub(crate) fn timeout(&self, may: bool) -> Option<Instant> {
        let deadline = self.deadline.filter(|_| may || !self.dtr);
        Earliest::of(deadline).or(self.reserved.map(|(_, until)| until)).get()
    }

    /// Advances the time to `now` and executes the due [`timeout`](Self::timeout). The last byte in either direction
    /// moved at `moved`, and `queued` bytes of the host on USB wait.
    pub(crate) fn tick(&mut self, may: bool, moved: Instant, queued: usize, now: Instant) {
        let _ = self.reserved.take_if(|(_, until)| *until <= now);
        if self.deadline.is_none_or(|at| at > now) || self.dtr && !may {
            return;
        }
        if self.dtr {
            self.take(queued, now);
            return;
        }
        // With a requested reservation the host may be idle for any time.
        let since = if self.reserved.is_some() { now } else { moved };
        match since + IDLE > now {
            true => self.deadline = Some(since + IDLE),
            false => self.release(queued),
        }
    }
}
