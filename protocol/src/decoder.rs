//! Bytes in chunks of any size in, items out: frames, noise and padding, without a missing byte.
//!
//! This layer is for firmware, monitors and implementations of other arms. It is less stable than the
//! [client](crate::Client): see [Stability](crate#stability).

use core::cell::Cell;

use crate::OutOfRange;
use crate::framing::{Framing, Reason, Scan};

/// The kind of an [`Item`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Kind {
    /// A frame with a valid envelope.
    Frame,
    /// Bytes outside of frames.
    Noise(Reason),
    /// Filler between frames, which is not an error.
    Padding,
    /// Bytes of a broken lossless stream.
    Broken(Reason),
}

/// The position of an item in a [`Decoder`]. It borrows nothing, and is valid until the next bytes are passed in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Span {
    /// The offset of the item's first byte, in bytes since the decoder was created.
    pub offset: u64,
    /// Its kind.
    pub kind: Kind,
    start: usize,
    end: usize,
}

impl Span {
    /// The item's length in bytes, at least 1.
    pub const fn len(&self) -> usize {
        self.end.saturating_sub(self.start)
    }

    /// Always `false`.
    pub const fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// A run of received bytes of one kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Item<'a> {
    /// The offset of its first byte, in bytes since the decoder was created.
    pub offset: u64,
    /// Its kind.
    pub kind: Kind,
    /// The bytes.
    pub bytes: &'a [u8],
}

/// A streaming decoder over an inline buffer of `N` bytes.
///
/// Every byte that goes in comes out once, in order, as part of one item. The size of the chunks does not affect the
/// frames, nor the bytes and reasons of adjacent noise once joined. After a rejected candidate, scanning resumes at its
/// second byte: a false header never costs a valid frame. A frame longer than `N` is noise with [`Reason::Length`] and
/// is skipped whole.
///
/// Its owner knows the kind of arm on the line and passes the framing and the expectation in. The decoder remembers how
/// many bytes the next item lacks with them: bytes before that are not scanned again.
///
/// ```
/// use armwire::decoder::{Decoder, Kind};
/// use armwire::framing::Reason;
/// use armwire::ling::{Frame, Ling};
///
/// let mut decoder = Decoder::<Ling, 70>::new();
/// let line = [0x11, 0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF];
/// assert!(decoder.push(&line).is_empty());
///
/// let noise = decoder.next(&Ling, ()).unwrap();
/// assert_eq!((noise.offset, noise.kind, noise.bytes), (0, Kind::Noise(Reason::Stray), &[0x11][..]));
/// let item = decoder.next(&Ling, ()).unwrap();
/// assert_eq!((item.offset, item.kind), (1, Kind::Frame));
/// let frame = Frame::parse(item.bytes).unwrap();
/// assert_eq!((frame.command, frame.function, frame.data), (0x06, 0x00, &[0xFE][..]));
/// assert!(decoder.next(&Ling, ()).is_none());
/// ```
#[derive(Debug)]
pub struct Decoder<F: Framing, const N: usize> {
    buf: [u8; N],
    /// The undecided window: `buf[head..tail]`.
    head: usize,
    tail: usize,
    /// The offset of `buf[0]`, in bytes since the decoder was created.
    front: u64,
    /// Remaining bytes of noise that extends beyond the window, and its reason.
    skip: usize,
    skip_reason: Reason,
    /// No byte has arrived since the line went idle.
    idle: bool,
    /// The offset of the first byte of a break, in bytes since the decoder was created, and its reason.
    broken: Option<(u64, Reason)>,
    /// The verdict on the window, if it was scanned and has no item yet.
    wait: Option<Wait<F>>,
}

/// The verdict that a window has no item before it has `len` bytes. It is valid for the same framing and expectation.
#[derive(Clone, Copy, Debug)]
struct Wait<F: Framing> {
    len: usize,
    framing: F,
    expect: F::Expect,
}

impl<F: Framing, const N: usize> Decoder<F, N> {
    /// An empty decoder.
    pub const fn new() -> Self {
        Self {
            buf: [0; N],
            head: 0,
            tail: 0,
            front: 0,
            skip: 0,
            skip_reason: Reason::Stray,
            idle: false,
            broken: None,
            wait: None,
        }
    }

    /// Free space for a read or DMA; [`commit`](Self::commit) the bytes that arrived.
    ///
    /// Never empty once [`advance`](Self::advance) has returned `None`.
    ///
    /// ```
    /// # use armwire::decoder::{Decoder, Kind};
    /// # use armwire::ling::Ling;
    /// # use std::io::Read;
    /// # let mut port = &[0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF][..];
    /// let mut decoder = Decoder::<Ling, 70>::new();
    /// let n = port.read(decoder.space())?;
    /// decoder.commit(n)?;
    /// assert!(decoder.next(&Ling, ()).is_some_and(|item| item.kind == Kind::Frame));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn space(&mut self) -> &mut [u8] {
        if self.head >= self.tail {
            self.drop_window();
        } else if self.head > 0 {
            self.move_to_front();
        }
        self.buf.get_mut(self.tail..).unwrap_or_default()
    }

    /// Accepts the first `n` bytes of [`space`](Self::space).
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] if `n` exceeds the free space. Nothing is accepted then.
    pub fn commit(&mut self, n: usize) -> Result<(), OutOfRange<usize>> {
        let max = N.wrapping_sub(self.tail);
        if n > max {
            return Err(OutOfRange::new("committed", "bytes", n, 0, max));
        }
        self.accept(n);
        Ok(())
    }

    /// Accepts bytes that fit.
    const fn accept(&mut self, n: usize) {
        self.tail = self.tail.wrapping_add(n);
        self.idle &= n == 0;
    }

    /// Copies in as many of `bytes` as fit and returns the rest.
    ///
    /// The rest fits once all items were taken.
    #[must_use = "the bytes that did not fit are returned"]
    pub fn push<'b>(&mut self, bytes: &'b [u8]) -> &'b [u8] {
        // A byte behind the window needs no call of `memcpy`, and the window stays in its place.
        if let ([byte], Some(to)) = (bytes, self.buf.get_mut(self.tail)) {
            *to = *byte;
            self.accept(1);
            return &[];
        }
        let space = self.space();
        let n = space.len().min(bytes.len());
        let (now, later) = bytes.split_at(n);
        if let Some(space) = space.get_mut(..n) {
            space.copy_from_slice(now);
        }
        self.accept(n);
        later
    }

    /// The line went idle: an incomplete frame will not be completed, and is the next item.
    ///
    /// Call this for an idle line reported by the UART, never for a gap between USB packets. The line counts as idle
    /// until more bytes arrive. On a [`LOSSLESS`](Framing::LOSSLESS) line it has no effect.
    ///
    /// ```
    /// use armwire::decoder::{Decoder, Kind};
    /// use armwire::framing::Reason;
    /// use armwire::ling::Ling;
    ///
    /// let mut decoder = Decoder::<Ling, 70>::new();
    /// assert!(decoder.push(&[0xAA, 0x06, 0x00, 0x0F, 0x02]).is_empty());
    /// assert!(decoder.next(&Ling, ()).is_none());
    /// decoder.idle();
    /// let noise = decoder.next(&Ling, ()).unwrap();
    /// assert_eq!(noise.kind, Kind::Noise(Reason::Truncated { missing: 16 }));
    /// ```
    pub const fn idle(&mut self) {
        self.idle = true;
    }

    /// Removes the next item from the window and returns its position; `None` if a verdict needs more bytes.
    ///
    /// Loops use this method: an item returned from inside a loop would borrow the decoder for the whole loop.
    pub fn advance(&mut self, framing: &F, expect: F::Expect) -> Option<Span> {
        let is_idle = self.idle && !F::LOSSLESS;
        if !is_idle && self.missing(framing, expect) > 0 {
            return None;
        }
        self.scan(framing, expect, is_idle)
    }

    /// The number of bytes before which a scan cannot find an item. Zero if it is unknown.
    fn missing(&self, framing: &F, expect: F::Expect) -> usize {
        match &self.wait {
            Some(wait) if wait.framing == *framing && wait.expect == expect => wait.len.saturating_sub(self.pending()),
            _ => 0,
        }
    }

    /// Scans the window, and removes the item at its front.
    // Not inlined: most bytes need no scan.
    #[inline(never)]
    fn scan(&mut self, framing: &F, expect: F::Expect, is_idle: bool) -> Option<Span> {
        if is_idle {
            // The rest of an overlong frame will not arrive.
            self.skip = 0;
        }
        let window = self.window();
        if window.is_empty() {
            return None;
        }
        if let Some((_, reason)) = self.broken {
            return Some(self.take(window.len(), Kind::Broken(reason)));
        }
        if self.skip > 0 {
            return Some(self.take_noise(self.skip, self.skip_reason));
        }
        let verdict = match is_idle {
            true => framing.scan_idle(window, expect),
            false => framing.scan(window, expect),
        };
        match verdict {
            Scan::Need(missing) => {
                let len = window.len().saturating_add(missing);
                if len > N {
                    return Some(self.take_noise(len, too_long::<N>(len)));
                }
                let (framing, expect) = (*framing, expect);
                self.wait = Some(Wait { len, framing, expect });
                None
            }
            Scan::Frame(n) => Some(self.take(n, Kind::Frame)),
            Scan::Padding(n) => Some(self.take(n, Kind::Padding)),
            Scan::Noise(n, reason) => Some(self.take_noise(n, reason)),
            Scan::Broken(reason) => {
                let rest = window.len();
                self.broken = Some((self.offset(), reason));
                Some(self.take(rest, Kind::Broken(reason)))
            }
        }
    }

    /// Removes noise that may extend beyond the window.
    // Not inlined: it slows down the path of a frame.
    #[inline(never)]
    fn take_noise(&mut self, n: usize, reason: Reason) -> Span {
        let span = self.take(n, Kind::Noise(reason));
        self.skip = n.saturating_sub(span.len());
        self.skip_reason = reason;
        span
    }

    /// Removes the first `n` bytes of the window, at least one and at most all.
    fn take(&mut self, n: usize, kind: Kind) -> Span {
        let (offset, start) = (self.offset(), self.head);
        let end = start.wrapping_add(n.max(1)).min(self.tail);
        self.head = end;
        self.wait = None;
        Span {
            offset,
            kind,
            start,
            end,
        }
    }

    /// The next item that is not padding. A broken stream yields only its first one.
    pub(crate) fn advance_to_event(&mut self, framing: &F, expect: F::Expect) -> Option<Span> {
        loop {
            let was_broken = self.broken.is_some();
            let span = self.advance(framing, expect)?;
            match span.kind {
                Kind::Padding => {}
                Kind::Broken(_) if was_broken => {}
                Kind::Frame | Kind::Noise(_) | Kind::Broken(_) => return Some(span),
            }
        }
    }

    /// Breaks a lossless stream from this side.
    pub(crate) fn break_off(&mut self, reason: Reason) {
        if self.broken.is_none() {
            self.broken = Some((self.offset(), reason));
            self.wait = None;
        }
    }

    /// The item at a span.
    pub fn item(&self, span: Span) -> Item<'_> {
        Item {
            offset: span.offset,
            kind: span.kind,
            bytes: self.buf.get(span.start..span.end).unwrap_or_default(),
        }
    }

    /// All bytes that the verdict on an item of noise needed: the whole of a damaged frame, of which the item is only
    /// the first byte. The other bytes follow in items of their own, because a frame may begin among them. `framing`
    /// and `expect` are those of [`advance`](Self::advance).
    ///
    /// ```
    /// use armwire::decoder::{Decoder, Kind};
    /// use armwire::framing::Reason;
    /// use armwire::ling::Ling;
    ///
    /// let damaged = [0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9B, 0xFF];
    /// let mut decoder = Decoder::<Ling, 70>::new();
    /// assert!(decoder.push(&damaged).is_empty());
    /// let noise = decoder.advance(&Ling, ()).unwrap();
    /// assert_eq!(noise.kind, Kind::Noise(Reason::Checksum { expected: 0x9A, got: 0x9B }));
    /// assert_eq!(decoder.item(noise).bytes, [0xAA]);
    /// assert_eq!(decoder.candidate(noise, &Ling, ()), damaged);
    /// ```
    pub fn candidate(&self, span: Span, framing: &F, expect: F::Expect) -> &[u8] {
        let bytes = self.buf.get(span.start..self.tail).unwrap_or_default();
        let is_undecided = |len: &usize| {
            let front = bytes.get(..*len).unwrap_or_default();
            matches!(framing.scan(front, expect), Scan::Need(_))
        };
        let undecided = (1..bytes.len()).take_while(is_undecided).count();
        bytes.get(..undecided.saturating_add(1)).unwrap_or_default()
    }

    /// The last `len` bytes that [`advance`](Self::advance) removed from the window.
    pub(crate) fn taken(&self, len: usize) -> &[u8] {
        let start = self.head.saturating_sub(len);
        self.buf.get(start..self.head).unwrap_or_default()
    }

    /// [`advance`](Self::advance) and [`item`](Self::item) in one.
    pub fn next(&mut self, framing: &F, expect: F::Expect) -> Option<Item<'_>> {
        let span = self.advance(framing, expect)?;
        Some(self.item(span))
    }

    /// The receive threshold: the number of bytes without which no further frame can be complete, at least 1 once
    /// [`advance`](Self::advance) has returned `None`. Zero while an item is ready.
    ///
    /// ```
    /// use armwire::decoder::Decoder;
    /// use armwire::ling::Ling;
    ///
    /// let mut decoder = Decoder::<Ling, 70>::new();
    /// assert_eq!(decoder.need(&Ling, ()), 6);
    /// assert!(decoder.push(&[0xAA, 0x06, 0x00, 0x0F]).is_empty());
    /// assert_eq!(decoder.need(&Ling, ()), 17); // 15 data bytes, the checksum and the terminator
    /// ```
    pub fn need(&self, framing: &F, expect: F::Expect) -> usize {
        let shortest = framing.shortest(expect).max(1);
        let window = self.window();
        if window.is_empty() {
            return shortest.saturating_add(self.skip);
        }
        if self.skip > 0 || self.broken.is_some() {
            return 0;
        }
        let missing = match self.missing(framing, expect) {
            0 => match framing.scan(window, expect) {
                Scan::Need(missing) if window.len().saturating_add(missing) <= N => missing,
                _ => return 0,
            },
            missing => missing,
        };
        missing.max(shortest.saturating_sub(window.len())).max(1)
    }

    /// Discards the undecided bytes, at the start of another conversation.
    ///
    /// ```
    /// use armwire::decoder::Decoder;
    /// use armwire::ling::Ling;
    ///
    /// let mut decoder = Decoder::<Ling, 70>::new();
    /// assert!(decoder.push(&[0xAA, 0x06, 0x00]).is_empty());
    /// decoder.clear();
    /// assert_eq!((decoder.pending(), decoder.offset()), (0, 3));
    /// assert!(decoder.push(&[0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF]).is_empty());
    /// assert_eq!(decoder.next(&Ling, ()).unwrap().offset, 3);
    /// ```
    pub const fn clear(&mut self) {
        self.drop_window();
        (self.skip, self.idle, self.broken) = (0, false, None);
    }

    /// Empties the buffer.
    const fn drop_window(&mut self) {
        self.front = self.received();
        (self.head, self.tail, self.wait) = (0, 0, None);
    }

    /// The undecided bytes.
    pub fn window(&self) -> &[u8] {
        self.buf.get(self.head..self.tail).unwrap_or_default()
    }

    /// The number of undecided bytes.
    pub const fn pending(&self) -> usize {
        self.tail.saturating_sub(self.head)
    }

    /// The offset of the window's first byte, in bytes since the decoder was created.
    pub const fn offset(&self) -> u64 {
        self.front.wrapping_add(self.head as u64)
    }

    /// The number of bytes of the last item that are still to arrive: it is a frame that is longer than allowed, and is
    /// skipped in several items.
    pub const fn skipping(&self) -> usize {
        self.skip
    }

    /// Bytes passed in since the decoder was created.
    pub const fn received(&self) -> u64 {
        self.front.wrapping_add(self.tail as u64)
    }

    /// The offset of a break, in bytes since the decoder was created, and its reason. `None` for an intact stream, and
    /// always on a line that is not lossless.
    pub const fn broken(&self) -> Option<(u64, Reason)> {
        self.broken
    }

    /// Moves the window to the front of the buffer.
    // Not inlined: most calls of `space` do not need it.
    #[inline(never)]
    fn move_to_front(&mut self) {
        // `copy_within` contains a panic that remains if it is not inlined.
        let cells = Cell::from_mut(&mut self.buf[..]).as_slice_of_cells();
        let window = cells.get(self.head..self.tail).unwrap_or_default();
        for (to, from) in cells.iter().zip(window) {
            to.set(from.get());
        }
        self.front = self.front.wrapping_add(self.head as u64);
        self.head = 0;
        self.tail = window.len();
    }
}

impl<F: Framing, const N: usize> Default for Decoder<F, N> {
    fn default() -> Self {
        Self::new()
    }
}

/// The reason for which a frame of `total` bytes is noise to a decoder of `N` bytes.
fn too_long<const N: usize>(total: usize) -> Reason {
    let clamp = |n| u16::try_from(n).unwrap_or(u16::MAX);
    Reason::Length {
        min: 0,
        max: clamp(N),
        got: clamp(total),
    }
}
