//! Bytes in any chunks in, items out: frames, noise and padding, none of the bytes missing.

use core::cell::Cell;

use crate::OutOfRange;
use crate::framing::{Framing, Reason, Scan};

/// The kind of an [`Item`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Kind {
    /// A frame whose envelope is good.
    Frame,
    /// Bytes in no frame.
    Noise(Reason),
    /// Bytes between frames that are no error.
    Padding,
    /// Bytes from the place on where a lossless stream broke.
    Broken(Reason),
}

/// The place of an item in a [`Decoder`]. It borrows nothing, and is valid until the next bytes are put in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Span {
    /// The item's first byte, in bytes since the decoder was made.
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
    /// Its first byte, in bytes since the decoder was made.
    pub offset: u64,
    /// Its kind.
    pub kind: Kind,
    /// The bytes.
    pub bytes: &'a [u8],
}

/// A streaming decoder over an inline buffer of `N` bytes.
///
/// Every byte that is put in comes out once, in order, as part of one item. Bytes may arrive in any chunks: the frames, and
/// the bytes and reasons of adjacent noise once joined, are the same. When a candidate for a frame turns out to be none,
/// scanning resumes at its second byte, so a false header never costs a good frame; a frame longer than `N` is noise with
/// [`Reason::Length`] and is skipped whole.
///
/// The decoder holds no framing: its owner knows the kind of arm on the line and passes the framing in.
///
/// ```
/// use armwire::decoder::{Decoder, Kind};
/// use armwire::framing::Reason;
/// use armwire::ling::{Frame, Ling};
///
/// let mut decoder = Decoder::<70>::new();
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
pub struct Decoder<const N: usize> {
    buf: [u8; N],
    /// The window, not yet decided on: `buf[head..tail]`.
    head: usize,
    tail: usize,
    /// Bytes put in since the decoder was made.
    received: u64,
    /// Bytes still to come of noise that reaches past the window, and its reason.
    skip: usize,
    skip_reason: Reason,
    /// No byte has arrived since the line went idle.
    idle: bool,
    /// The first byte of a break, in bytes since the decoder was made, and its reason.
    broken: Option<(u64, Reason)>,
}

impl<const N: usize> Decoder<N> {
    /// An empty decoder.
    pub const fn new() -> Self {
        Self {
            buf: [0; N],
            head: 0,
            tail: 0,
            received: 0,
            skip: 0,
            skip_reason: Reason::Stray,
            idle: false,
            broken: None,
        }
    }

    /// Room to read or DMA into; [`commit`](Self::commit) what arrived.
    ///
    /// Never empty once [`advance`](Self::advance) has returned `None`.
    ///
    /// ```
    /// # use armwire::decoder::{Decoder, Kind};
    /// # use armwire::ling::Ling;
    /// # use std::io::Read;
    /// # let mut port = &[0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF][..];
    /// let mut decoder = Decoder::<70>::new();
    /// let n = port.read(decoder.space())?;
    /// decoder.commit(n)?;
    /// assert!(decoder.next(&Ling, ()).is_some_and(|item| item.kind == Kind::Frame));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn space(&mut self) -> &mut [u8] {
        if self.head >= self.tail {
            (self.head, self.tail) = (0, 0);
        } else if self.head > 0 {
            self.move_to_front();
        }
        self.buf.get_mut(self.tail..).unwrap_or_default()
    }

    /// Accepts the first `n` bytes of [`space`](Self::space).
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] when that is more than there is room for. Nothing is accepted then.
    pub fn commit(&mut self, n: usize) -> Result<(), OutOfRange<usize>> {
        let max = N.wrapping_sub(self.tail);
        if n > max {
            return Err(OutOfRange::new("committed", "bytes", n, 0, max));
        }
        self.accept(n);
        Ok(())
    }

    /// Accepts bytes for which there is room.
    const fn accept(&mut self, n: usize) {
        self.tail = self.tail.wrapping_add(n);
        self.received = self.received.wrapping_add(n as u64);
        self.idle &= n == 0;
    }

    /// Copies in as much of `bytes` as there is room for and returns the rest.
    ///
    /// Take all items out, then push the rest, until there is none.
    #[must_use = "bytes for which there is no room are returned"]
    pub fn push<'b>(&mut self, bytes: &'b [u8]) -> &'b [u8] {
        let space = self.space();
        let n = space.len().min(bytes.len());
        let (now, later) = bytes.split_at(n);
        if let Some(space) = space.get_mut(..n) {
            space.copy_from_slice(now);
        }
        self.accept(n);
        later
    }

    /// The line went idle: a frame that waits for its end will never get it. Then take the items out.
    ///
    /// Call it for an idle line that the UART reports, never for a gap between USB packets. It holds until more bytes come. On
    /// a [`LOSSLESS`](Framing::LOSSLESS) line it changes nothing.
    ///
    /// ```
    /// use armwire::decoder::{Decoder, Kind};
    /// use armwire::framing::Reason;
    /// use armwire::ling::Ling;
    ///
    /// let mut decoder = Decoder::<70>::new();
    /// assert!(decoder.push(&[0xAA, 0x06, 0x00, 0x0F, 0x02]).is_empty());
    /// assert!(decoder.next(&Ling, ()).is_none());
    /// decoder.idle();
    /// let noise = decoder.next(&Ling, ()).unwrap();
    /// assert_eq!(noise.kind, Kind::Noise(Reason::Truncated { missing: 16 }));
    /// ```
    pub const fn idle(&mut self) {
        self.idle = true;
    }

    /// Takes the next item out of the window and returns its place; `None` when a verdict needs more bytes.
    ///
    /// Loops are made of this, because an item that is returned from inside a loop would borrow the decoder for all of it.
    pub fn advance<F: Framing>(&mut self, framing: &F, expect: F::Expect) -> Option<Span> {
        if self.idle && !F::LOSSLESS {
            // The rest of a frame that was too long does not come any more.
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
        let verdict = match self.idle {
            true => framing.scan_idle(window, expect),
            false => framing.scan(window, expect),
        };
        match verdict {
            Scan::Need(missing) => {
                let total = window.len().saturating_add(missing);
                (total > N).then(|| self.take_noise(total, too_long::<N>(total)))
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

    /// Takes noise out that may reach past the window.
    // Not inlined: copies of it slow the path of a frame.
    #[inline(never)]
    fn take_noise(&mut self, n: usize, reason: Reason) -> Span {
        let span = self.take(n, Kind::Noise(reason));
        self.skip = n.saturating_sub(span.len());
        self.skip_reason = reason;
        span
    }

    /// Takes the first `n` bytes out of the window, at least one and no more than it has.
    fn take(&mut self, n: usize, kind: Kind) -> Span {
        let (offset, start) = (self.offset(), self.head);
        let end = start.wrapping_add(n.max(1)).min(self.tail);
        self.head = end;
        Span {
            offset,
            kind,
            start,
            end,
        }
    }

    /// The next item that is not padding. Of a broken stream it is only the first one.
    pub(crate) fn advance_to_event<F: Framing>(&mut self, framing: &F, expect: F::Expect) -> Option<Span> {
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

    /// The item at a span.
    pub fn item(&self, span: Span) -> Item<'_> {
        Item {
            offset: span.offset,
            kind: span.kind,
            bytes: self.buf.get(span.start..span.end).unwrap_or_default(),
        }
    }

    /// [`advance`](Self::advance) and [`item`](Self::item) in one.
    pub fn next<F: Framing>(&mut self, framing: &F, expect: F::Expect) -> Option<Item<'_>> {
        let span = self.advance(framing, expect)?;
        Some(self.item(span))
    }

    /// The receive threshold: the number of bytes before which there is no other frame, at least 1 once
    /// [`advance`](Self::advance) has returned `None`. Zero while there is an item to take.
    ///
    /// ```
    /// use armwire::decoder::Decoder;
    /// use armwire::ling::Ling;
    ///
    /// let mut decoder = Decoder::<70>::new();
    /// assert_eq!(decoder.need(&Ling, ()), 6);
    /// assert!(decoder.push(&[0xAA, 0x06, 0x00, 0x0F]).is_empty());
    /// assert_eq!(decoder.need(&Ling, ()), 17); // 15 data bytes, the checksum and the terminator
    /// ```
    pub fn need<F: Framing>(&self, framing: &F, expect: F::Expect) -> usize {
        let shortest = framing.shortest(expect).max(1);
        let window = self.window();
        if window.is_empty() {
            return shortest.saturating_add(self.skip);
        }
        if self.skip > 0 || self.broken.is_some() {
            return 0;
        }
        match framing.scan(window, expect) {
            Scan::Need(n) if window.len().saturating_add(n) <= N => n.max(shortest.saturating_sub(window.len())).max(1),
            _ => 0,
        }
    }

    /// Drops the bytes not yet decided on: those behind them are of another conversation.
    ///
    /// ```
    /// use armwire::decoder::Decoder;
    /// use armwire::ling::Ling;
    ///
    /// let mut decoder = Decoder::<70>::new();
    /// assert!(decoder.push(&[0xAA, 0x06, 0x00]).is_empty());
    /// decoder.clear();
    /// assert_eq!((decoder.pending(), decoder.offset()), (0, 3));
    /// assert!(decoder.push(&[0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF]).is_empty());
    /// assert_eq!(decoder.next(&Ling, ()).unwrap().offset, 3);
    /// ```
    pub const fn clear(&mut self) {
        (self.head, self.tail, self.skip) = (0, 0, 0);
        (self.idle, self.broken) = (false, None);
    }

    /// The bytes not yet decided on.
    pub fn window(&self) -> &[u8] {
        self.buf.get(self.head..self.tail).unwrap_or_default()
    }

    /// The number of bytes not yet decided on.
    pub const fn pending(&self) -> usize {
        self.tail.saturating_sub(self.head)
    }

    /// The window's first byte, in bytes since the decoder was made.
    pub const fn offset(&self) -> u64 {
        self.received.wrapping_sub(self.pending() as u64)
    }

    /// Bytes put in since the decoder was made.
    pub const fn received(&self) -> u64 {
        self.received
    }

    /// The place of a break, in bytes since the decoder was made, and its reason. `None` for an intact stream, and always on a
    /// line that is not lossless.
    pub const fn broken(&self) -> Option<(u64, Reason)> {
        self.broken
    }

    /// Brings the window to the front of the buffer.
    // Not inlined: most calls of `space` do not need it.
    #[inline(never)]
    fn move_to_front(&mut self) {
        // `copy_within` has a panic that is left when it is not inlined.
        let cells = Cell::from_mut(&mut self.buf[..]).as_slice_of_cells();
        let window = cells.get(self.head..self.tail).unwrap_or_default();
        for (to, from) in cells.iter().zip(window) {
            to.set(from.get());
        }
        self.head = 0;
        self.tail = window.len();
    }
}

impl<const N: usize> Default for Decoder<N> {
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
