//! The line's rate: the arm's own, unless the host on USB holds another, and the line that `hold-line` keeps for USB.

use crate::config::ArmKind;
use crate::control::{LineHolder, LineState};
use crate::earliest::Earliest;
use crate::line_coding::{LineCoding, UartConfig};
use armwire::time::{Duration, Instant};

/// The port that a host controls the adapter by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ControlPort {
    /// The control interface on USB.
    Usb,
    /// The control connection on CAN.
    Can,
}

/// How long after SET_LINE_CODING an open port gets its rate without a byte: many programs set two rates in a row, and only
/// the last is meant.
const SETTLE: Duration = Duration::from_millis(100);

/// How long a host that does not raise DTR keeps its rate without a byte either way.
const IDLE: Duration = Duration::from_millis(10_000);

/// How long [`HoldLine`](crate::control::Request::HoldLine) holds unless it is renewed.
const LEASE: Duration = Duration::from_millis(crate::control::HOLD_LEASE_MS as u64);

/// A change of the line between bytes of the host on USB.
#[derive(Clone, Copy)]
struct Change {
    to: UartConfig,
    /// How many bytes go out before.
    behind: usize,
}

/// How the UART works, how it is to work, and who holds the line.
pub(crate) struct LineRate {
    line: UartConfig,
    /// How long a byte takes on it, in nanoseconds.
    byte_nanos: u32,
    /// The arm's own line.
    arm: UartConfig,
    /// Whether the arm has a rate of its own. The rate of another is what the host on USB sets.
    has_own_rate: bool,
    /// The next change: it comes before the bytes that wait behind it.
    step: Option<Change>,
    /// The target line, reached once no bytes wait.
    goal: UartConfig,
    /// The line coding that the host on USB last set, in effect or not.
    requested: LineCoding,
    /// While the port is open, when `requested` takes effect without a byte. Else, when to see whether the host has said
    /// nothing for [`IDLE`].
    deadline: Option<Instant>,
    /// Torque-off took the line from the host. Its rate stays out of effect until it sets one.
    revoked: bool,
    /// Bytes of the host were refused since it set its rate.
    refused: bool,
    dtr: bool,
    /// The port that requested `hold-line`, and the end of its lease.
    hold: Option<(ControlPort, Instant)>,
}

impl LineRate {
    /// A UART as at [`UartConfig::default`], which is to become the arm's.
    pub(crate) fn new(kind: ArmKind) -> Self {
        let (line, arm) = (UartConfig::default(), kind.uart());
        Self {
            line,
            byte_nanos: line.coding.nanos_a_byte(),
            arm,
            has_own_rate: kind.has_own_rate(),
            step: None,
            goal: arm,
            requested: arm.coding,
            deadline: None,
            revoked: false,
            refused: false,
            dtr: false,
            hold: None,
        }
    }

    /// How long a byte takes on the line, in nanoseconds.
    pub(crate) const fn byte_nanos(&self) -> u32 {
        self.byte_nanos
    }

    /// The line coding that the host on USB last set.
    pub(crate) const fn requested(&self) -> LineCoding {
        self.requested
    }

    // ---- Changes of the UART ----

    /// The change that the UART makes before anything else goes out. `queued` bytes of the host on USB wait.
    pub(crate) fn change(&self, queued: usize) -> Option<UartConfig> {
        let (to, behind) = match &self.step {
            Some(step) => (&step.to, step.behind),
            None => (&self.goal, queued),
        };
        Some(*to).filter(|to| behind == 0 && *to != self.line)
    }

    /// Whether the UART has a change to make.
    #[inline(never)]
    pub(crate) fn changes(&self) -> bool {
        self.step.is_some() || self.goal != self.line
    }

    /// How many bytes of the host on USB may go out before the next change, at most `most`.
    pub(crate) fn before_change(&self, most: usize) -> usize {
        self.step.map_or(most, |step| step.behind.min(most))
    }

    /// So many bytes of the host on USB went out.
    pub(crate) fn sent(&mut self, bytes: usize) {
        if let Some(step) = &mut self.step {
            step.behind = step.behind.saturating_sub(bytes);
        }
    }

    /// The bytes of the host on USB that had not gone out are dropped.
    pub(crate) fn dropped(&mut self) {
        self.step = None;
    }

    /// The UART works like this now.
    pub(crate) fn changed(&mut self, line: UartConfig) {
        let _ = self.step.take_if(|step| step.to == line);
        self.line = line;
        self.byte_nanos = line.coding.nanos_a_byte();
    }

    /// The UART is to work like this behind the `queued` bytes of the host on USB.
    fn schedule(&mut self, to: UartConfig, queued: usize) {
        // Behind a change that has bytes behind it no packet is taken, so that the next change is behind all of them.
        if self.step.is_none_or(|step| step.behind == queued) {
            self.step = (to != self.line).then_some(Change { to, behind: queued });
        }
        self.goal = to;
    }

    // ---- The host on USB ----

    /// The host on USB sent SET_LINE_CODING behind `queued` bytes. The arm's own rate takes effect behind these; another one
    /// with the next byte, or, while the port is open, after 100 ms.
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

    /// Whether the next byte of the host on USB is for another rate than the one that the line will have.
    pub(crate) fn is_unmet(&self) -> bool {
        self.goal.coding != self.requested
    }

    /// Whether the host's rate stays out of effect until it sets one.
    pub(crate) const fn is_revoked(&self) -> bool {
        self.revoked
    }

    /// The rate that the host on USB has set takes effect behind the `queued` bytes.
    pub(crate) fn take(&mut self, queued: usize, now: Instant) {
        let to = UartConfig {
            coding: self.requested,
            half_duplex: self.arm.half_duplex,
        };
        self.schedule(to, queued);
        self.deadline = (!self.dtr).then(|| now + IDLE);
    }

    /// Bytes of the host on USB are refused. Returns whether they are the first since it set its rate.
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
            // Its driver may take the rate for set that an earlier program set.
            self.deadline = Some(now + SETTLE);
        }
    }

    /// The line becomes the arm's behind the `queued` bytes. The host's next byte brings its rate back into effect.
    pub(crate) fn release(&mut self, queued: usize) {
        self.deadline = None;
        if self.is_other(&self.goal) {
            self.schedule(self.arm, queued);
        }
    }

    /// The host is gone, and so is the rate that it set.
    pub(crate) fn reset(&mut self, queued: usize) {
        self.release(queued);
        self.requested = self.arm.coding;
        (self.revoked, self.refused, self.dtr) = (false, false, false);
    }

    /// Another arm is there. Its line follows behind the `queued` bytes, and the host's rate is that.
    pub(crate) fn set_arm(&mut self, kind: ArmKind, queued: usize) {
        let arm = kind.uart();
        (self.arm, self.has_own_rate) = (arm, kind.has_own_rate());
        (self.requested, self.revoked, self.refused) = (arm.coding, false, false);
        self.deadline = None;
        if self.goal != arm {
            self.schedule(arm, queued);
        }
    }

    /// The line becomes the arm's at once, for torque-off. Returns whether it was to be another.
    pub(crate) fn revoke(&mut self) -> bool {
        if self.is_arms() && !self.changes() {
            return false;
        }
        (self.step, self.goal) = (None, self.arm);
        self.revoked = self.requested != self.arm.coding;
        self.deadline = None;
        true
    }

    // ---- Who holds the line ----

    /// Whether the arm understands what goes out now.
    pub(crate) fn is_arms(&self) -> bool {
        !self.is_other(&self.line)
    }

    /// Whether the host on USB has the line for itself, so that polls and CAN are refused.
    pub(crate) fn is_held(&self, queued: usize) -> bool {
        self.hold.is_some() || self.has_other_rate(queued)
    }

    /// Whether `hold-line` keeps the line for USB.
    pub(crate) const fn is_on_hold(&self) -> bool {
        self.hold.is_some()
    }

    /// Whether the line has another rate than the arm's, or will have it, until the last byte for that is out.
    fn has_other_rate(&self, queued: usize) -> bool {
        let is_coming = |step: &Change| self.is_other(&step.to);
        self.is_other(&self.goal)
            || self.step.as_ref().is_some_and(is_coming)
            || self.is_other(&self.line) && self.change(queued).is_none()
    }

    // Not inlined: it is asked in many places.
    #[inline(never)]
    fn is_other(&self, line: &UartConfig) -> bool {
        line.coding != self.arm.coding
    }

    /// `port` keeps the line for USB for the time of a lease. Returns whether it may: another port may have it.
    pub(crate) fn hold(&mut self, port: ControlPort, now: Instant) -> bool {
        let is_free = self.hold.is_none_or(|(holder, _)| holder == port);
        if is_free {
            self.hold = Some((port, now + LEASE));
        }
        is_free
    }

    /// `port` keeps the line no more.
    pub(crate) fn unhold(&mut self, port: ControlPort) {
        let _ = self.hold.take_if(|(holder, _)| *holder == port);
    }

    /// The state for [`Reply::Line`](crate::control::Reply::Line).
    #[inline(never)]
    pub(crate) fn state(&self, queued: usize) -> LineState {
        let holder = match self.hold {
            Some(_) => LineHolder::HoldLine,
            None if self.has_other_rate(queued) => LineHolder::OtherRate,
            None => LineHolder::Nobody,
        };
        let is_wanted = self.dtr || self.revoked;
        let waiting = if is_wanted { self.requested } else { self.goal.coding };
        LineState {
            coding: self.line.coding,
            arm: self.arm.coding,
            holder,
            waiting: Some(waiting).filter(|waiting| *waiting != self.line.coding),
        }
    }

    // ---- Time ----

    /// When to call [`tick`](Self::tick). While the host's rate `may` not take effect, it waits.
    pub(crate) fn timeout(&self, may: bool) -> Option<Instant> {
        let deadline = self.deadline.filter(|_| may || !self.dtr);
        Earliest::of(deadline).or(self.hold.map(|(_, until)| until)).get()
    }

    /// It is `now`: what [`timeout`](Self::timeout) has waited for comes. The last byte either way moved at `moved`, and
    /// `queued` bytes of the host on USB wait.
    pub(crate) fn tick(&mut self, may: bool, moved: Instant, queued: usize, now: Instant) {
        let _ = self.hold.take_if(|(_, until)| *until <= now);
        if self.deadline.is_none_or(|at| at > now) || self.dtr && !may {
            return;
        }
        if self.dtr {
            self.take(queued, now);
            return;
        }
        // Under `hold-line` the host may be as quiet as it likes.
        let since = if self.hold.is_some() { now } else { moved };
        match since + IDLE > now {
            true => self.deadline = Some(since + IDLE),
            false => self.release(queued),
        }
    }
}
