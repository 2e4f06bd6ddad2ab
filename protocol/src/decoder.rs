//! Bytes in, frames and noise out.

use core::cell::Cell;
use core::fmt;
use core::marker::PhantomData;

use crate::copy::copy;
use crate::{Framing, Noise, OutOfRange, Reason, Scan};

/// A streaming decoder over an inline buffer of `N` bytes, at least [`Framing::MAX_FRAME`].
///
/// Bytes may arrive in any chunks: the frames and noise that come out are the same. When a candidate for a frame turns
/// out to be none, scanning resumes at its second byte, so a false header never costs a good frame. An intact frame is
/// missed only where another that is good by its own checksum began before it and reaches into it. A run of stray bytes
/// is reported whole, once its end is known.
///
/// On a [`RELIABLE`](Framing::RELIABLE) line a frame that is none, but whose length is known, is skipped whole, as noise.
/// What breaks the stream is given once by [`next`](Self::next), as noise too, kept in [`broken`](Self::broken), and
/// nothing that follows is read.
///
/// ```
/// use armwire::Decoder;
/// use armwire::ling::{self, Ling};
///
/// let mut decoder = Decoder::<Ling, { ling::MAX_FRAME }>::new();
/// let line = [0x11, 0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF];
/// assert!(decoder.push(&line).is_empty());
///
/// let noise = decoder.next(()).unwrap().unwrap_err();
/// assert_eq!((noise.offset, noise.len), (0, 1));
/// let frame = decoder.next(()).unwrap().unwrap();
/// assert_eq!((frame.command, frame.function, frame.data), (0x06, 0x00, &[0xFE][..]));
/// assert!(decoder.next(()).is_none());
/// ```
pub struct Decoder<F: Framing, const N: usize> {
    buf: [u8; N],
    /// The window not yet decided on: `buf[head..tail]`.
    head: usize,
    tail: usize,
    /// Bytes received since the decoder was made.
    received: u64,
    /// Stray bytes just before the window that were not reported yet.
    stray: usize,
    /// What was expected when the window was looked at, as long as it need not be looked at again: it takes `missing` more
    /// bytes to say something of it or, if none is missing, `verdict` is what there is to say.
    seen: Option<F::Expect>,
    missing: usize,
    verdict: Scan,
    /// Nothing came since the line went idle.
    idle: bool,
    /// Noise that began before the window, and goes on in it or ends where it begins.
    skipping: Option<Noise>,
    /// What broke the stream.
    broken: Option<Noise>,
    framing: PhantomData<F>,
}

impl<F: Framing, const N: usize> Decoder<F, N> {
    /// An empty decoder. Does not compile when `N` is less than [`Framing::MAX_FRAME`].
    pub const fn new() -> Self {
        const { assert!(N >= F::MAX_FRAME, "the buffer is shorter than the longest frame") }
        Self {
            buf: [0; N],
            head: 0,
            tail: 0,
            received: 0,
            stray: 0,
            seen: None,
            missing: 0,
            verdict: Scan::Need(0),
            idle: false,
            skipping: None,
            broken: None,
            framing: PhantomData,
        }
    }

    /// Room to read or DMA into; [`commit`](Self::commit) what arrived.
    ///
    /// Never empty once [`next`](Self::next) has returned `None`.
    ///
    /// ```
    /// # use armwire::{Decoder, ling::{self, Ling}};
    /// # use std::io::Read;
    /// # let mut port = &[0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF][..];
    /// let mut decoder = Decoder::<Ling, { ling::MAX_FRAME }>::new();
    /// let n = port.read(decoder.space())?;
    /// decoder.commit(n)?;
    /// assert!(decoder.next(()).is_some_and(|frame| frame.is_ok()));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[cfg_attr(target_pointer_width = "32", inline(always))]
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
        let max = N.saturating_sub(self.tail);
        if n > max {
            return Err(OutOfRange {
                what: "committed",
                unit: "bytes",
                got: n,
                min: 0,
                max,
            });
        }
        self.accept(n);
        Ok(())
    }

    /// Copies in as much of `bytes` as there is room for and returns the rest.
    ///
    /// Take all that [`next`](Self::next) has to give, then push the rest, until there is none.
    #[must_use = "bytes for which there is no room are returned"]
    #[inline(never)]
    pub fn push<'b>(&mut self, mut bytes: &'b [u8]) -> &'b [u8] {
        self.take(&mut bytes, usize::MAX);
        bytes
    }

    /// The next frame or the next run of noise; `None` when more bytes are needed to tell.
    pub fn next(&mut self, expect: F::Expect) -> Option<Result<F::Frame<'_>, Noise>> {
        let verdict = self.decide(expect)?;
        self.settle(verdict, expect)
    }

    /// [`push`](Self::push) and [`next`](Self::next) in one: the next frame or the next run of noise in what is pending
    /// and then in `bytes`, from whose front it takes what it needs. `None` when it took all of them and needs more.
    ///
    /// This is the fastest way for bytes that are in memory: a frame that lies in `bytes` whole is not copied.
    ///
    /// ```
    /// # use armwire::{Decoder, ling::{self, Ling}};
    /// let mut decoder = Decoder::<Ling, { ling::MAX_FRAME }>::new();
    /// let mut line = &[0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF, 0xAA, 0x06][..];
    /// while let Some(next) = decoder.decode(&mut line, ()) {
    ///     assert_eq!(next.unwrap().command, 0x06);
    /// }
    /// assert_eq!((line.len(), decoder.pending()), (0, 2));
    /// ```
    // A computer calls nothing for a frame that it finds whole. A microcontroller would take more stack for that.
    #[cfg_attr(not(target_pointer_width = "32"), inline(always))]
    pub fn decode<'a, 'b: 'a>(
        &'a mut self,
        bytes: &mut &'b [u8],
        expect: F::Expect,
    ) -> Option<Result<F::Frame<'a>, Noise>> {
        if bytes.len() < self.missing && self.seen == Some(expect) {
            self.take(bytes, usize::MAX);
            return None;
        }
        // Without anything before it, what lies here need not be copied to be looked at.
        let nothing_held = self.head >= self.tail && self.stray == 0 && !self.is_skipping() && !self.is_broken();
        if nothing_held && !bytes.is_empty() {
            match F::scan(bytes, expect) {
                Scan::Frame(n) if let Some((frame, rest)) = bytes.split_at_checked(n) => {
                    self.received = self.received.wrapping_add(n as u64);
                    self.idle = false;
                    *bytes = rest;
                    return Some(view::<F>(frame, self.received));
                }
                Scan::Need(n) => {
                    self.take(bytes, usize::MAX);
                    (self.seen, self.missing) = (Some(expect), n);
                    return None;
                }
                _ => {}
            }
        }
        self.decode_held(bytes, expect)
    }

    /// [`decode`](Self::decode) where what lies in `bytes` must be copied behind what is there.
    #[cfg_attr(target_pointer_width = "32", inline(always))]
    #[cfg_attr(not(target_pointer_width = "32"), inline(never))]
    fn decode_held(&mut self, bytes: &mut &[u8], expect: F::Expect) -> Option<Result<F::Frame<'_>, Noise>> {
        loop {
            if let Some(verdict) = self.decide(expect) {
                return self.settle(verdict, expect);
            }
            // Nothing of what follows the frame that has begun is copied.
            let wanted = if self.missing > 0 && self.head == 0 {
                self.missing
            } else {
                usize::MAX
            };
            if bytes.is_empty() || self.take(bytes, wanted) == 0 {
                return None;
            }
        }
    }

    /// The verdict on what follows stray bytes and filling; `None` when that takes more bytes.
    ///
    /// Inlined like what is around it: a verdict and what comes of it are large to hand on.
    #[inline(always)]
    fn decide(&mut self, expect: F::Expect) -> Option<Scan> {
        if self.seen == Some(expect) {
            return if self.missing == 0 { Some(self.verdict) } else { None };
        }
        self.missing = 0;
        if let Some(noise) = self.skipping.filter(|_| F::RELIABLE) {
            return self.skip_on(noise);
        }
        loop {
            match self.scan(expect) {
                Scan::Skip(len, reason) if F::RELIABLE && len > self.pending() => {
                    let offset = self.offset();
                    self.skipping = Some(Noise { offset, len, reason });
                    self.advance(self.pending());
                    return None;
                }
                Scan::Skip(n, Reason::Stray) if !F::RELIABLE => {
                    self.stray = self.stray.saturating_add(self.advance(n));
                }
                Scan::Fill(n) if self.stray == 0 => {
                    self.advance(n);
                }
                // The stray bytes may go on here.
                Scan::Need(n) => {
                    if !self.idle {
                        (self.seen, self.missing) = (Some(expect), n);
                    }
                    return None;
                }
                verdict => return Some(verdict),
            }
        }
    }

    /// Leaves behind what is there of noise that goes on. The verdict when that is all of it.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn skip_on(&mut self, noise: Noise) -> Option<Scan> {
        let left = self.left_to_skip(noise);
        if left > 0 && self.pending() > 0 {
            self.advance(left);
        }
        (self.left_to_skip(noise) == 0).then_some(Scan::Skip(noise.len, noise.reason))
    }

    /// How many bytes of noise are still to come or in the window.
    fn left_to_skip(&self, noise: Noise) -> usize {
        noise
            .len
            .saturating_sub(self.offset().wrapping_sub(noise.offset) as usize)
    }

    fn is_skipping(&self) -> bool {
        F::RELIABLE && self.skipping.is_some()
    }

    /// What comes of the verdict: first the stray bytes before, then itself.
    #[inline(always)]
    fn settle(&mut self, verdict: Scan, expect: F::Expect) -> Option<Result<F::Frame<'_>, Noise>> {
        if !F::RELIABLE
            && let Some(noise) = self.take_stray()
        {
            // A checksum is worth calculating only once. Filling without stray bytes before it is passed.
            if !matches!(verdict, Scan::Fill(_)) {
                self.seen = Some(expect);
                self.verdict = verdict;
            }
            return Some(Err(noise));
        }
        match verdict {
            Scan::Need(_) | Scan::Fill(_) => None,
            Scan::Skip(n, reason) => {
                let passed = if F::RELIABLE { self.skipping.take() } else { None };
                Some(Err(passed.unwrap_or_else(|| self.skip(n, reason))))
            }
            Scan::Broken(n, reason) => {
                let noise = self.skip(n, reason);
                if F::RELIABLE {
                    self.broken = Some(noise);
                    self.discard_if_broken();
                }
                Some(Err(noise))
            }
            Scan::Frame(n) => {
                let start = self.head;
                self.advance(n);
                Some(view::<F>(self.buf.get(start..self.head)?, self.offset()))
            }
        }
    }

    /// How many more bytes must arrive before [`next`](Self::next) can have something to say: a receive threshold.
    ///
    /// Zero when it has something to say now, or has not yet dropped what it can. Never zero once it has returned
    /// `None`.
    ///
    /// ```
    /// use armwire::Decoder;
    /// use armwire::ling::{self, Ling};
    ///
    /// let mut decoder = Decoder::<Ling, { ling::MAX_FRAME }>::new();
    /// assert!(decoder.push(&[0xAA, 0x06, 0x00, 0x0F]).is_empty());
    /// assert_eq!(decoder.need(()), 17); // 15 data bytes, the checksum and the end mark
    /// ```
    pub fn need(&self, expect: F::Expect) -> usize {
        if let Some(noise) = self.skipping.filter(|_| F::RELIABLE) {
            return self.left_to_skip(noise).saturating_sub(self.pending());
        }
        match self.scan(expect) {
            Scan::Need(n) => n.max(1),
            Scan::Skip(n, _) if F::RELIABLE && n > self.pending() => n.saturating_sub(self.pending()),
            // Where a run of stray bytes ends is not known yet; filling is nothing to say.
            Scan::Skip(n, Reason::Stray) if !F::RELIABLE && n >= self.pending() => 1,
            Scan::Fill(n) if n >= self.pending() && self.stray == 0 => 1,
            _ => 0,
        }
    }

    /// The line went idle: a frame that is waiting for its end will never get it.
    ///
    /// Call it on an idle line that the UART reports, never on a gap between USB packets. Call it and
    /// [`next`](Self::next) in turn until both return `None`: each call gives up one false header, and what follows it
    /// is scanned again. Until more bytes come the line stays idle, so that what only its silence tells to be a frame
    /// is one too ([`Framing::scan_idle`]). On a [`RELIABLE`](Framing::RELIABLE) line it does nothing.
    ///
    /// ```
    /// use armwire::{Decoder, Reason};
    /// use armwire::ling::{self, Ling};
    ///
    /// let mut decoder = Decoder::<Ling, { ling::MAX_FRAME }>::new();
    /// assert!(decoder.push(&[0xAA, 0x06, 0x00, 0x0F, 0x02]).is_empty());
    /// assert!(decoder.next(()).is_none());
    /// assert_eq!(decoder.idle(()).unwrap().reason, Reason::Truncated { missing: 16 });
    /// ```
    pub fn idle(&mut self, expect: F::Expect) -> Option<Noise> {
        if F::RELIABLE {
            return None;
        }
        self.idle = true;
        self.seen = None;
        self.missing = 0;
        if self.pending() == 0 {
            return self.take_stray();
        }
        match self.scan(expect) {
            Scan::Skip(n, reason @ Reason::Truncated { .. }) => {
                self.take_stray().or_else(|| Some(self.skip(n, reason)))
            }
            Scan::Need(_) | Scan::Frame(_) | Scan::Skip(..) | Scan::Broken(..) | Scan::Fill(_) => None,
        }
    }

    /// Bytes received of which it is not yet known whether they are part of a frame or noise.
    ///
    /// ```
    /// # use armwire::{Decoder, ling::{self, Ling}};
    /// let mut decoder = Decoder::<Ling, { ling::MAX_FRAME }>::new();
    /// assert!(decoder.push(&[0xAA, 0x06]).is_empty());
    /// assert_eq!(decoder.pending(), 2);
    /// ```
    pub const fn pending(&self) -> usize {
        self.tail.wrapping_sub(self.head)
    }

    /// What broke the stream, on a [`RELIABLE`](Framing::RELIABLE) line: close the connection and make a new decoder.
    ///
    /// `None` while all is well, and always on other lines.
    pub const fn broken(&self) -> Option<Noise> {
        self.broken
    }

    fn discard_if_broken(&mut self) {
        if self.is_broken() {
            self.advance(self.pending());
        }
    }

    /// Moves up to `n` bytes from the front of `bytes` to the end of the window, as far as there is room, and returns how
    /// many.
    ///
    /// Inlined, it saves a microcontroller stack, and costs a computer time.
    #[cfg_attr(target_pointer_width = "32", inline(always))]
    fn take(&mut self, bytes: &mut &[u8], n: usize) -> usize {
        let space = self.space();
        let n = n.min(space.len()).min(bytes.len());
        let (now, later) = bytes.split_at(n);
        *bytes = later;
        copy(now, space);
        self.accept(n);
        n
    }

    /// Counts `n` bytes that came to the end of the window.
    fn accept(&mut self, n: usize) {
        self.tail = self.tail.wrapping_add(n);
        self.received = self.received.wrapping_add(n as u64);
        self.missing = self.missing.saturating_sub(n);
        if self.missing == 0 {
            self.seen = None;
        }
        if n > 0 {
            self.idle = false;
        }
        self.discard_if_broken();
    }

    /// Brings the window to the front of the buffer.
    #[inline(never)]
    fn move_to_front(&mut self) {
        // copy_within has a panic that is left when it is not inlined.
        let cells = Cell::from_mut(&mut self.buf[..]).as_slice_of_cells();
        let window = cells.get(self.head..self.tail).unwrap_or_default();
        for (to, from) in cells.iter().zip(window) {
            to.set(from.get());
        }
        self.head = 0;
        self.tail = window.len();
    }

    pub(crate) fn is_broken(&self) -> bool {
        F::RELIABLE && self.broken.is_some()
    }

    /// The verdict on the window. An empty one needs a byte.
    #[inline(always)]
    fn scan(&self, expect: F::Expect) -> Scan {
        let Some(window @ [_, ..]) = self.buf.get(self.head..self.tail) else {
            return Scan::Need(1);
        };
        match F::scan(window, expect) {
            Scan::Need(missing) if self.idle => F::scan_idle(window, expect, missing),
            verdict => verdict,
        }
    }

    fn skip(&mut self, n: usize, reason: Reason) -> Noise {
        let offset = self.offset();
        let len = self.advance(n);
        Noise { offset, len, reason }
    }

    fn take_stray(&mut self) -> Option<Noise> {
        let len = core::mem::take(&mut self.stray);
        (len > 0).then(|| Noise {
            offset: self.offset().wrapping_sub(len as u64),
            len,
            reason: Reason::Stray,
        })
    }

    /// Leaves the first `n` bytes of the window behind, at least one, and returns how many they were.
    fn advance(&mut self, n: usize) -> usize {
        let n = n.max(1).min(self.pending());
        self.head = self.head.wrapping_add(n);
        self.seen = None;
        n
    }

    /// Bytes received since the decoder was made.
    pub(crate) const fn received(&self) -> u64 {
        self.received
    }

    /// Bytes that were given out as frames or noise, or dropped, since the decoder was made: those before the window.
    pub(crate) const fn offset(&self) -> u64 {
        self.received.wrapping_sub(self.pending() as u64)
    }
}

/// The frame that a [`Framing`] found, after which `end` bytes have come. Bytes that it then cannot view are noise.
fn view<F: Framing>(bytes: &[u8], end: u64) -> Result<F::Frame<'_>, Noise> {
    F::view(bytes).ok_or(Noise {
        offset: end.wrapping_sub(bytes.len() as u64),
        len: bytes.len(),
        reason: Reason::Stray,
    })
}

impl<F: Framing, const N: usize> Default for Decoder<F, N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<F: Framing, const N: usize> fmt::Debug for Decoder<F, N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Decoder")
            .field("offset", &self.offset())
            .field("pending", &self.pending())
            .finish_non_exhaustive()
    }
}

#[cfg(all(test, feature = "ling"))]
mod tests {
    extern crate std;

    use std::vec::Vec;

    use super::*;
    use crate::ling::{self, Ling};

    const QUERY: [u8; 7] = [0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF];

    type Lings = Decoder<Ling, { ling::MAX_FRAME }>;

    fn drain(decoder: &mut Lings) -> (usize, Vec<Noise>) {
        let (mut frames, mut noise) = (0, Vec::new());
        while let Some(next) = decoder.next(()) {
            match next {
                Ok(_) => frames += 1,
                Err(n) => noise.push(n),
            }
        }
        (frames, noise)
    }

    #[test]
    fn a_false_header_does_not_cost_the_frame_that_follows() {
        let mut decoder = Lings::new();
        assert!(decoder.push(&[0xAA, 0x06, 0x00, 0x03]).is_empty());
        assert!(decoder.push(&QUERY).is_empty());
        let (frames, noise) = drain(&mut decoder);
        assert_eq!(frames, 1);
        assert_eq!(noise.iter().map(|n| n.len).sum::<usize>(), 4);
        assert_eq!((noise[0].offset, noise[1].offset), (0, 1));
    }

    #[test]
    fn an_idle_line_frees_frames_behind_a_false_header() {
        let mut decoder = Lings::new();
        assert!(decoder.push(&[0xAA, 0x06, 0x00, 64]).is_empty());
        assert!(decoder.push(&QUERY).is_empty());
        assert_eq!(drain(&mut decoder).0, 0);
        assert_eq!(decoder.need(()), 64 + ling::OVERHEAD - 11);

        let noise = decoder.idle(()).unwrap();
        assert_eq!(noise.reason, Reason::Truncated { missing: 59 });
        assert_eq!(drain(&mut decoder).0, 1);
        assert_eq!(decoder.idle(()), None);
    }

    #[test]
    fn offsets_count_every_byte_once() {
        let mut decoder = Lings::new();
        let mut dropped = 0;
        for _ in 0..50 {
            for byte in [1, 2, 0xAA, 3].into_iter().chain(QUERY) {
                assert!(decoder.push(&[byte]).is_empty());
                let (_, noise) = drain(&mut decoder);
                dropped += noise.iter().map(|n| n.len).sum::<usize>();
            }
        }
        while let Some(noise) = decoder.idle(()) {
            dropped += noise.len + drain(&mut decoder).1.iter().map(|n| n.len).sum::<usize>();
        }
        assert_eq!(dropped, 200);
        assert_eq!((decoder.offset(), decoder.pending()), (50 * 11, 0));
    }

    #[test]
    fn stray_bytes_before_a_frame_that_never_ends_are_reported_in_order() {
        let mut decoder = Lings::new();
        assert!(decoder.push(&[0x11]).is_empty());
        assert_eq!(decoder.need(()), 1);
        assert!(decoder.next(()).is_none());
        assert!(decoder.push(&[0xAA]).is_empty());
        let noise: Vec<_> = core::iter::from_fn(|| decoder.idle(()))
            .map(|noise| noise.offset)
            .collect();
        assert_eq!(noise, [0, 1]);
    }

    #[test]
    fn there_is_always_room_once_next_is_done() {
        let mut decoder = Lings::new();
        for i in 0..10_000_u32 {
            let n = decoder.space().len();
            assert!(n > 0);
            decoder.space().fill(if i % 3 == 0 { 0xAA } else { i as u8 });
            decoder.commit(n).unwrap();
            drain(&mut decoder);
        }
    }

    #[test]
    fn a_line_on_which_nothing_comes_stays_idle() {
        let mut decoder = Lings::new();
        assert!(decoder.push(&[0xAA, 0xAA]).is_empty());
        let truncated = Reason::Truncated { missing: 3 };
        assert!(decoder.next(()).is_none());
        assert!(decoder.idle(()).is_some());
        decoder.commit(0).unwrap();
        assert!(decoder.push(&[]).is_empty());
        assert!(matches!(decoder.next(()), Some(Err(noise)) if noise.reason == truncated));

        assert!(decoder.push(&[0xAA]).is_empty());
        assert!(decoder.next(()).is_none(), "it is idle no more");
    }

    #[test]
    fn a_frame_that_is_all_there_is_decoded_where_it_lies() {
        let line = [&[0x11, 0x22][..], &QUERY, &QUERY, &QUERY[..5]].concat();
        let mut decoder = Lings::new();
        // Behind stray bytes it is copied.
        for (mut rest, copied) in [(&line[..9], true), (&line[9..], false)] {
            let ends = rest.as_ptr_range();
            let mut frames = 0;
            while let Some(next) = decoder.decode(&mut rest, ()) {
                let Ok(frame) = next else { continue };
                assert_eq!(!ends.contains(&frame.data.as_ptr()), copied);
                frames += 1;
            }
            assert_eq!((frames, rest.len()), (1, 0));
        }
        assert_eq!((decoder.offset(), decoder.pending(), decoder.need(())), (16, 5, 2));
        let mut end = &[&QUERY[5..], &[0x33]].concat()[..];
        assert!(decoder.decode(&mut end, ()).is_some_and(|next| next.is_ok()));
        assert_eq!(
            (end, decoder.pending()),
            (&[0x33][..], 0),
            "it takes no more than it needs"
        );
    }

    #[test]
    fn committing_more_than_the_room_is_an_error_and_takes_nothing() {
        let mut decoder = Lings::new();
        let error = decoder.commit(ling::MAX_FRAME + 1).unwrap_err();
        assert_eq!((error.got, error.max), (ling::MAX_FRAME + 1, ling::MAX_FRAME));
        assert_eq!((decoder.pending(), decoder.next(())), (0, None));
        decoder.commit(ling::MAX_FRAME).unwrap();
        assert!(decoder.commit(1).is_err());
        assert_eq!(decoder.pending(), ling::MAX_FRAME);
    }
}

#[cfg(all(test, feature = "xarm"))]
mod reliable_tests {
    use super::*;
    use crate::xarm::{self, Direction, HEARTBEAT, XArm};

    type Arms = Decoder<XArm, { xarm::MAX_FRAME }>;

    const REPLIES: Direction = Direction::Responses;

    /// A frame, the bytes that break the stream, and a frame.
    const STREAM: [u8; 20] = [0, 0, 0, 1, 0, 2, 0, 0, 0, 1, 0, 4, 0, 0, 0, 1, 0, 2, 0, 0];

    fn broken() -> Arms {
        let mut decoder = Arms::new();
        assert!(decoder.push(&STREAM).is_empty());
        assert!(decoder.next(REPLIES).is_some_and(|next| next.is_ok()));
        assert_eq!(decoder.broken(), None);
        assert!(decoder.next(REPLIES).is_some_and(|next| next.is_err()));
        decoder
    }

    #[test]
    fn the_first_noise_on_a_reliable_line_is_given_once_and_kept() {
        let mut decoder = Arms::new();
        assert!(decoder.push(&STREAM).is_empty());
        assert!(decoder.next(REPLIES).unwrap().is_ok());
        let noise = decoder.next(REPLIES).unwrap().unwrap_err();
        let reason = Reason::Byte {
            offset: 3,
            expected: &[0, 1, 2, 3],
            got: 4,
        };
        assert_eq!((noise.offset, noise.len, noise.reason), (8, 4, reason));
        assert_eq!(decoder.broken(), Some(noise));
        assert!(decoder.next(REPLIES).is_none());
        assert_eq!(decoder.broken(), Some(noise));
    }

    #[test]
    fn nothing_is_read_once_a_reliable_line_is_broken_and_there_is_room_for_it_all() {
        let mut decoder = broken();
        for _ in 0..100 {
            assert!(decoder.push(&HEARTBEAT).is_empty());
            assert!(decoder.next(REPLIES).is_none());
            let mut line = &HEARTBEAT[..];
            assert!(decoder.decode(&mut line, REPLIES).is_none() && line.is_empty());
            let room = decoder.space();
            assert_eq!(room.len(), xarm::MAX_FRAME);
            room.fill(0);
            decoder.commit(8).unwrap();
            assert!(decoder.next(REPLIES).is_none());
            assert_eq!(decoder.pending(), 0);
        }
    }

    /// Knows no frames.
    enum Deaf {}

    impl Framing for Deaf {
        const MAX_FRAME: usize = 1;
        const RELIABLE: bool = true;
        type Expect = ();
        type Frame<'a> = ();

        fn scan(window: &[u8], (): ()) -> Scan {
            Scan::Broken(window.len(), Reason::Stray)
        }

        fn view(_bytes: &[u8]) -> Option<()> {
            None
        }
    }

    #[test]
    fn stray_bytes_break_a_reliable_line_at_once() {
        let mut decoder = Decoder::<Deaf, 4>::new();
        assert!(decoder.push(&[1, 2]).is_empty());
        assert_eq!(decoder.need(()), 0);
        let noise = decoder.next(()).unwrap().unwrap_err();
        assert_eq!((noise.offset, noise.len, noise.reason), (0, 2, Reason::Stray));
        assert_eq!(decoder.broken(), Some(noise));
    }

    #[test]
    fn a_pause_on_a_reliable_line_means_nothing() {
        let (start, end) = HEARTBEAT.split_at(5);
        let mut decoder = Arms::new();
        assert!(decoder.push(start).is_empty());
        assert!(decoder.next(REPLIES).is_none());
        assert_eq!((decoder.idle(REPLIES), decoder.pending()), (None, 5));
        assert!(decoder.push(end).is_empty());
        assert!(decoder.next(REPLIES).is_some_and(|next| next.is_ok()));
        assert_eq!(broken().idle(REPLIES), None);
    }
}

#[cfg(test)]
mod fill_tests {
    extern crate std;

    use std::vec::Vec;

    use super::*;

    /// A frame is 7E and one byte; zeros fill the room between frames.
    enum Reports {}

    impl Framing for Reports {
        const MAX_FRAME: usize = 2;
        const RELIABLE: bool = false;
        type Expect = ();
        type Frame<'a> = u8;

        fn scan(window: &[u8], (): ()) -> Scan {
            let run = |of: fn(&u8) -> bool| window.iter().take_while(|byte| of(byte)).count();
            match window {
                [0x7E] => Scan::Need(1),
                [0x7E, ..] => Scan::Frame(2),
                [0, ..] => Scan::Fill(run(|&byte| byte == 0)),
                _ => Scan::Skip(run(|&byte| byte != 0 && byte != 0x7E), Reason::Stray),
            }
        }

        fn view(bytes: &[u8]) -> Option<u8> {
            bytes.last().copied()
        }
    }

    /// All that comes out: frames, and where noise is and how long.
    fn decode(stream: &[u8], chunk: usize) -> (Vec<u8>, Vec<(u64, usize)>) {
        let mut decoder = Decoder::<Reports, 4>::new();
        let (mut frames, mut noise) = (Vec::new(), Vec::new());
        let mut take = |decoder: &mut Decoder<Reports, 4>| {
            while let Some(next) = decoder.next(()) {
                match next {
                    Ok(frame) => frames.push(frame),
                    Err(dropped) => noise.push((dropped.offset, dropped.len)),
                }
            }
            assert!(decoder.need(()) > 0, "something is due once next is done");
        };
        for mut rest in stream.chunks(chunk) {
            while !rest.is_empty() {
                rest = decoder.push(rest);
                take(&mut decoder);
            }
        }
        noise.extend(decoder.idle(()).map(|dropped| (dropped.offset, dropped.len)));
        assert_eq!(decoder.pending(), 0);
        (frames, noise)
    }

    #[test]
    fn filling_is_dropped_without_a_word_and_costs_no_frame() {
        let stream = [0, 0, 0, 0x7E, 1, 0, 0, 0, 0, 0, 0, 0, 0x7E, 0, 0x7E, 2, 0];
        for chunk in 1..=stream.len() {
            assert_eq!(decode(&stream, chunk), (Vec::from([1, 0, 2]), Vec::new()), "by {chunk}");
        }
    }

    #[test]
    fn stray_bytes_before_filling_are_told_and_end_there() {
        let stream = [5, 6, 0, 0, 7, 0x7E, 1, 0, 8];
        for chunk in 1..=stream.len() {
            let noise = Vec::from([(0, 2), (4, 1), (8, 1)]);
            assert_eq!(decode(&stream, chunk), (Vec::from([1]), noise), "by {chunk}");
        }
    }

    #[test]
    fn filling_is_nothing_to_say() {
        let mut decoder = Decoder::<Reports, 4>::new();
        assert!(decoder.push(&[0, 0]).is_empty());
        assert_eq!(decoder.need(()), 1);
        assert_eq!(decoder.idle(()), None);
        assert!(decoder.next(()).is_none());
        assert_eq!(decoder.pending(), 0);
        // But where it ends a run of stray bytes, that run is.
        assert!(decoder.push(&[5]).is_empty());
        assert!(decoder.next(()).is_none());
        assert!(decoder.push(&[0]).is_empty());
        assert_eq!(decoder.need(()), 0);
        assert!(decoder.next(()).is_some_and(|next| next.is_err()));
    }
}
