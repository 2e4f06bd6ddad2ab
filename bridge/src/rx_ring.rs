//! The bookkeeping of the ring into which a DMA writes the arm's bytes.

use core::ops::Range;

use heapless::Deque;

use armwire::framing::Length;

use crate::RxThreshold;
use crate::time::Instant;

/// The events of the receiver that the bridge waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct RxWait {
    /// The next bytes.
    pub threshold: RxThreshold,
    /// The place of the length, if these bytes begin a frame.
    pub length: Option<Length>,
    /// An idle line. If false, one without new bytes before it changes nothing.
    pub idle: bool,
}

/// Maximum number of unread marks. The terminator may also occur inside a frame.
const MARKS: usize = 3;

/// The positions in a receive ring of `SIZE` bytes, a power of two, and the marks of its interrupt handler.
///
/// The owner has the bytes. A DMA writes them in a circle, an interrupt handler reports them with
/// [`arrived`](Self::arrived) and [`idle`](Self::idle), and a task reads them. *End* is the DMA's position at that
/// moment: the index in the ring of the next byte to write. At most `SIZE - 1` bytes may be unread, or have arrived since
/// [`set`](Self::set) before its first event.
///
/// ```
/// use armwire_bridge::{Bridge, Instant, RxRing};
///
/// let mut bridge = Bridge::default();
/// let mut ring = RxRing::<1024>::new();
/// ring.set(bridge.rx_wait());
/// let bytes = [0xAA, 0x05, 0x00, 0x01, 0x01, 0xF9, 0xFF];
///
/// // The interrupt handler records the time of the byte that may end a frame.
/// for (end, last) in (1..).zip(bytes) {
///     let is_event = ring.arrived(end, last, || Instant::from_micros(10 * end as u64));
///     assert_eq!(is_event, end == 7);
/// }
///
/// // The task passes the bytes before the mark to the bridge, with that time.
/// let mark = ring.take_mark(7).unwrap();
/// let [bytes_before, after_turn] = ring.take(mark.end, 64);
/// assert!(after_turn.is_empty());
/// assert_eq!(bridge.uart_received(&bytes[bytes_before], mark.at), 1);
/// ```
#[derive(Debug)]
pub struct RxRing<const SIZE: usize> {
    /// The position of the next byte to read.
    head: usize,
    wait: Wait,
    marks: Deque<RxMark, MARKS>,
}

/// An event at a position in an [`RxRing`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct RxMark {
    /// The position after the last byte before the event.
    pub end: usize,
    /// The arrival of that byte; for an idle line, the time of its detection.
    pub at: Instant,
    /// The line went idle.
    pub idle: bool,
}

/// The bytes that are an event.
#[derive(Clone, Copy, Debug)]
enum Wait {
    /// None: all events that a task will use are recorded.
    Nothing,
    /// Those of the bridge, with bytes counted from a position.
    Bridge { from: usize, wait: RxWait },
    /// Further candidates for the end of the same frame: at least `min` bytes from a position, up to a terminator.
    Candidate { from: usize, min: usize, terminator: u8 },
}

impl<const SIZE: usize> RxRing<SIZE> {
    const MASK: usize = {
        assert!(SIZE.is_power_of_two());
        SIZE - 1
    };

    /// An empty ring whose DMA is at position 0. It waits for no bytes.
    pub const fn new() -> Self {
        Self {
            head: 0,
            wait: Wait::Nothing,
            marks: Deque::new(),
        }
    }

    /// The DMA starts at position 0 again: unread bytes and marks are dropped. The line may have been idle after them:
    /// report an idle line.
    pub fn restart(&mut self) {
        *self = Self::new();
    }

    /// Drops all bytes before `end`, all marks and the threshold: the DMA has overwritten unread bytes.
    pub fn discard(&mut self, end: usize) {
        *self = Self::new();
        self.head = end & Self::MASK;
    }

    /// Waits for these events from the next unread byte on. Call it after the bridge has the bytes and marks before.
    pub fn set(&mut self, wait: RxWait) {
        // The line went idle before the bridge had its last bytes.
        while let Some(mark) = self.marks.front()
            && mark.idle
            && !wait.idle
            && self.unread(mark.end) == 0
        {
            self.marks.pop_front();
        }
        self.wait = Wait::Bridge { from: self.head, wait };
    }

    /// Returns true if bytes may be an event: the interrupt handler must see each of them.
    pub const fn is_waiting(&self) -> bool {
        !matches!(self.wait, Wait::Nothing)
    }

    /// The number of bytes behind `end` of which none is an event. The interrupt handler need not see them. `byte` reads
    /// the ring.
    ///
    /// Once the length of a frame has arrived, the threshold is its end.
    pub fn quiet(&mut self, end: usize, byte: impl Fn(usize) -> u8) -> usize {
        let (from, wait) = match &mut self.wait {
            Wait::Nothing => return SIZE,
            Wait::Candidate { .. } => return 0,
            Wait::Bridge { from, wait } => (from, wait),
        };
        let arrived = Self::distance(*from, end);
        if let Some(length) = wait.length.filter(|length| arrived > length.at) {
            wait.length = None;
            let value = byte(from.wrapping_add(length.at) & Self::MASK);
            if byte(*from) == length.header && value <= length.max {
                let frame = usize::from(value).saturating_add(length.overhead);
                let max = frame.min(wait.threshold.max);
                // With any last byte: a false frame may hide a valid one.
                wait.threshold = RxThreshold {
                    max,
                    min: max,
                    terminator: None,
                };
            }
        }
        let least = wait.threshold.least();
        least.saturating_sub(arrived.saturating_add(1))
    }

    /// Bytes before `end` arrived, `last` being the last of them. If they reach the threshold, their mark gets the time
    /// `now`, and the result is true.
    pub fn arrived(&mut self, end: usize, last: u8, now: impl FnOnce() -> Instant) -> bool {
        let (from, min, terminator) = match self.wait {
            Wait::Bridge { from, wait } if wait.threshold.is_met(Self::distance(from, end), last) => {
                (from, wait.threshold.min, wait.threshold.terminator)
            }
            Wait::Candidate { from, min, terminator } if Self::distance(from, end) >= min && last == terminator => {
                (from, min, Some(terminator))
            }
            _ => return false,
        };
        // Any other event, for example the idle line after the byte, reports it again, and so does a second look.
        if self
            .marks
            .back()
            .is_none_or(|mark| self.unread(mark.end) < self.unread(end))
        {
            self.mark(end, now(), false);
        }
        self.wait = match terminator {
            Some(terminator) if !self.marks.is_full() => Wait::Candidate { from, min, terminator },
            _ => Wait::Nothing,
        };
        true
    }

    /// The line went idle after the bytes before `end`. Returns true if that is an event. Without room, its mark replaces
    /// the last one, which was shortly before.
    pub fn idle(&mut self, end: usize, now: Instant) -> bool {
        let is_event = match self.wait {
            Wait::Bridge { wait, .. } => wait.idle || self.unread(end) > 0,
            // The task has an event. Its next wait decides about this one.
            Wait::Candidate { .. } | Wait::Nothing => false,
        };
        if is_event || !matches!(self.wait, Wait::Bridge { .. }) {
            if self.marks.is_full() {
                self.marks.pop_back();
            }
            self.mark(end, now, true);
        }
        is_event
    }

    fn mark(&mut self, end: usize, at: Instant, idle: bool) {
        // Without room the bytes are read without their time.
        let _ = self.marks.push_back(RxMark { end, at, idle });
    }

    /// Returns true if a mark is unread.
    pub fn has_mark(&self) -> bool {
        !self.marks.is_empty()
    }

    /// Returns true if the bytes before `end` may contain an event that the interrupt handler has not seen.
    pub const fn is_overdue(&self, end: usize) -> bool {
        match self.wait {
            Wait::Bridge { from, wait } => Self::distance(from, end) >= wait.threshold.least(),
            Wait::Candidate { .. } | Wait::Nothing => false,
        }
    }

    /// Takes the first mark, unless it is after `end`.
    pub fn take_mark(&mut self, end: usize) -> Option<RxMark> {
        let first = self.marks.front()?;
        match self.unread(first.end) <= self.unread(end) {
            true => self.marks.pop_front(),
            false => None,
        }
    }

    /// Looks for events among unread bytes that [`arrived`](Self::arrived) has not seen, because the ring did not wait for
    /// them. `look` reports those before the position that it gets: the first idle line, or `end`. Returns true if there
    /// is an event.
    pub fn look_again(&mut self, end: usize, look: impl FnOnce(&mut Self, usize) -> bool) -> bool {
        if self.marks.front().is_some_and(|mark| !mark.idle) {
            return true;
        }
        let recorded = core::mem::take(&mut self.marks);
        let mut is_event = look(self, recorded.front().map_or(end, |mark| mark.end));
        for RxMark { end, at, idle } in recorded {
            match idle {
                true => is_event |= self.idle(end, at),
                false => self.mark(end, at, false),
            }
        }
        is_event
    }

    /// The number of unread bytes before `end`.
    pub const fn unread(&self, end: usize) -> usize {
        Self::distance(self.head, end)
    }

    /// Takes the next unread bytes before `end`, at most `max`. They are at these indices of the ring, in order. Read
    /// them before the DMA has gone round. Marks before the last of them are dropped.
    pub fn take(&mut self, end: usize, max: usize) -> [Range<usize>; 2] {
        let start = self.head;
        let len = self.unread(end).min(max);
        let stop = start.wrapping_add(len);
        self.head = stop & Self::MASK;
        // The interrupt handler may have marked some of them after the task looked for marks.
        while let Some(mark) = self.marks.front()
            && Self::distance(start, mark.end) < len
        {
            self.marks.pop_front();
        }
        if let Wait::Bridge { wait, .. } = &mut self.wait {
            // The bridge may wait for an idle line after these bytes.
            wait.idle |= start != stop;
        }
        match stop.checked_sub(SIZE) {
            Some(rest) => [start..SIZE, 0..rest],
            None => [start..stop, 0..0],
        }
    }

    const fn distance(from: usize, to: usize) -> usize {
        to.wrapping_sub(from) & Self::MASK
    }
}

impl<const SIZE: usize> Default for RxRing<SIZE> {
    fn default() -> Self {
        Self::new()
    }
}
