//! Bytes in, frames and noise out.

use core::cell::Cell;
use core::fmt;
use core::marker::PhantomData;

use crate::{Framing, Noise, Reason, Scan};

/// A streaming decoder over an inline buffer of `N` bytes, at least [`Framing::MAX_FRAME`].
///
/// Bytes may arrive in any chunks: the frames and noise that come out are the same. When a candidate for a frame turns
/// out to be none, scanning resumes at its second byte, so a false header never costs a good frame. An intact frame is
/// missed only where another that is good by its own checksum began before it and reaches into it. A run of stray bytes
/// is reported whole, once its end is known.
///
/// On a [`RELIABLE`](Framing::RELIABLE) line the first noise is the last: it is given once by [`next`](Self::next),
/// kept in [`broken`](Self::broken), and nothing that follows is read.
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
    /// Bytes before the window since the decoder was made.
    offset: u64,
    /// Stray bytes just before the window that were not reported yet.
    stray: usize,
    /// Nothing came since the line went idle.
    idle: bool,
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
            offset: 0,
            stray: 0,
            idle: false,
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
    /// decoder.commit(n);
    /// assert!(decoder.next(()).is_some_and(|frame| frame.is_ok()));
    /// # Ok::<(), std::io::Error>(())
    /// ```
    pub fn space(&mut self) -> &mut [u8] {
        if 0 < self.head && self.head <= self.tail && self.tail <= N {
            // copy_within has a panic that is left when it is not inlined.
            let cells = Cell::from_mut(&mut self.buf[..]).as_slice_of_cells();
            for (to, from) in cells.iter().zip(cells.iter().take(self.tail).skip(self.head)) {
                to.set(from.get());
            }
            self.tail -= self.head;
            self.head = 0;
        }
        self.buf.get_mut(self.tail..).unwrap_or_default()
    }

    /// Accepts the first `n` bytes of [`space`](Self::space), or all of it if `n` is more.
    pub fn commit(&mut self, n: usize) {
        self.tail = self.tail.saturating_add(n).min(N);
        self.idle &= n == 0;
        self.discard_if_broken();
    }

    /// Copies in as much of `bytes` as there is room for and returns the rest.
    ///
    /// Take all that [`next`](Self::next) has to give, then push the rest, until there is none.
    pub fn push<'b>(&mut self, bytes: &'b [u8]) -> &'b [u8] {
        let space = self.space();
        let n = bytes.len().min(space.len());
        let (now, later) = bytes.split_at(n);
        if let Some(space) = space.get_mut(..n) {
            space.copy_from_slice(now);
        }
        self.commit(n);
        later
    }

    /// The next frame or the next run of noise; `None` when more bytes are needed to tell.
    pub fn next(&mut self, expect: F::Expect) -> Option<Result<F::Frame<'_>, Noise>> {
        let verdict = loop {
            match self.scan(expect)? {
                Scan::Skip(n, Reason::Stray) if !F::RELIABLE => {
                    self.stray = self.stray.saturating_add(self.advance(n));
                }
                Scan::Fill(n) if self.stray == 0 => {
                    self.advance(n);
                }
                // The stray bytes may go on here.
                Scan::Need(_) => return None,
                verdict => break verdict,
            }
        };
        if let Some(noise) = self.take_stray() {
            return Some(Err(noise));
        }
        match verdict {
            Scan::Need(_) | Scan::Fill(_) => None,
            Scan::Skip(n, reason) => {
                let noise = self.skip(n, reason);
                if F::RELIABLE {
                    self.broken = Some(noise);
                    self.discard_if_broken();
                }
                Some(Err(noise))
            }
            Scan::Frame(n) => {
                let start = self.head;
                let len = self.advance(n);
                let frame = self.buf.get(start..self.head).and_then(F::view);
                Some(frame.ok_or(Noise {
                    offset: self.offset.wrapping_sub(len as u64),
                    len,
                    reason: Reason::Stray,
                }))
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
    /// decoder.push(&[0xAA, 0x06, 0x00, 0x0F]);
    /// assert_eq!(decoder.need(()), 17); // 15 data bytes, the checksum and the end mark
    /// ```
    pub fn need(&self, expect: F::Expect) -> usize {
        match self.scan(expect) {
            None => 1,
            Some(Scan::Need(n)) => n.max(1),
            // Where a run of stray bytes ends is not known yet; filling is nothing to say.
            Some(Scan::Skip(n, Reason::Stray)) if !F::RELIABLE && n >= self.pending() => 1,
            Some(Scan::Fill(n)) if n >= self.pending() && self.stray == 0 => 1,
            Some(_) => 0,
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
    /// decoder.push(&[0xAA, 0x06, 0x00, 0x0F, 0x02]);
    /// assert!(decoder.next(()).is_none());
    /// assert_eq!(decoder.idle(()).unwrap().reason, Reason::Truncated { missing: 16 });
    /// ```
    pub fn idle(&mut self, expect: F::Expect) -> Option<Noise> {
        if F::RELIABLE {
            return None;
        }
        self.idle = true;
        match self.scan(expect) {
            None => self.take_stray(),
            Some(Scan::Skip(n, reason @ Reason::Truncated { .. })) => {
                self.take_stray().or_else(|| Some(self.skip(n, reason)))
            }
            Some(Scan::Need(_) | Scan::Frame(_) | Scan::Skip(..) | Scan::Fill(_)) => None,
        }
    }

    /// Bytes received of which it is not yet known whether they are part of a frame or noise.
    ///
    /// ```
    /// # use armwire::{Decoder, ling::{self, Ling}};
    /// let mut decoder = Decoder::<Ling, { ling::MAX_FRAME }>::new();
    /// decoder.push(&[0xAA, 0x06]);
    /// assert_eq!(decoder.pending(), 2);
    /// ```
    pub const fn pending(&self) -> usize {
        self.tail.saturating_sub(self.head)
    }

    /// What broke the stream, on a [`RELIABLE`](Framing::RELIABLE) line: close the connection and make a new decoder.
    ///
    /// `None` while all is well, and always on other lines.
    pub const fn broken(&self) -> Option<Noise> {
        self.broken
    }

    /// Bytes that were given out as frames or noise, or dropped, since the decoder was made.
    pub(crate) const fn offset(&self) -> u64 {
        self.offset
    }

    fn discard_if_broken(&mut self) {
        if self.broken.is_some() {
            self.advance(self.pending());
        }
    }

    fn scan(&self, expect: F::Expect) -> Option<Scan> {
        let window = self.buf.get(self.head..self.tail)?;
        let scan = || match F::scan(window, expect) {
            Scan::Need(missing) if self.idle => F::scan_idle(window, expect, missing),
            verdict => verdict,
        };
        (!window.is_empty()).then(scan)
    }

    fn skip(&mut self, n: usize, reason: Reason) -> Noise {
        let offset = self.offset;
        let len = self.advance(n);
        Noise { offset, len, reason }
    }

    fn take_stray(&mut self) -> Option<Noise> {
        let len = core::mem::take(&mut self.stray);
        (len > 0).then(|| Noise {
            offset: self.offset.wrapping_sub(len as u64),
            len,
            reason: Reason::Stray,
        })
    }

    /// Leaves the first `n` bytes of the window behind, at least one, and returns how many they were.
    fn advance(&mut self, n: usize) -> usize {
        let n = n.max(1).min(self.pending());
        self.head = self.head.saturating_add(n);
        self.offset = self.offset.wrapping_add(n as u64);
        n
    }
}

impl<F: Framing, const N: usize> Default for Decoder<F, N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<F: Framing, const N: usize> fmt::Debug for Decoder<F, N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Decoder")
            .field("offset", &self.offset)
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
        decoder.push(&[0xAA, 0x06, 0x00, 0x03]);
        decoder.push(&QUERY);
        let (frames, noise) = drain(&mut decoder);
        assert_eq!(frames, 1);
        assert_eq!(noise.iter().map(|n| n.len).sum::<usize>(), 4);
        assert_eq!((noise[0].offset, noise[1].offset), (0, 1));
    }

    #[test]
    fn an_idle_line_frees_frames_behind_a_false_header() {
        let mut decoder = Lings::new();
        decoder.push(&[0xAA, 0x06, 0x00, 64]);
        decoder.push(&QUERY);
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
        assert_eq!((decoder.offset, decoder.pending()), (50 * 11, 0));
    }

    #[test]
    fn stray_bytes_before_a_frame_that_never_ends_are_reported_in_order() {
        let mut decoder = Lings::new();
        decoder.push(&[0x11]);
        assert_eq!(decoder.need(()), 1);
        assert!(decoder.next(()).is_none());
        decoder.push(&[0xAA]);
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
            decoder.commit(n);
            drain(&mut decoder);
        }
    }

    #[test]
    fn a_line_on_which_nothing_comes_stays_idle() {
        let mut decoder = Lings::new();
        decoder.push(&[0xAA, 0xAA]);
        let truncated = Reason::Truncated { missing: 3 };
        assert!(decoder.next(()).is_none());
        assert!(decoder.idle(()).is_some());
        decoder.commit(0);
        assert!(decoder.push(&[]).is_empty());
        assert!(matches!(decoder.next(()), Some(Err(noise)) if noise.reason == truncated));

        decoder.push(&[0xAA]);
        assert!(decoder.next(()).is_none(), "it is idle no more");
    }

    #[test]
    fn committing_more_than_the_room_takes_all_of_it() {
        let mut decoder = Lings::new();
        decoder.commit(usize::MAX);
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
        decoder.push(&STREAM);
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
            let room = decoder.space();
            assert_eq!(room.len(), xarm::MAX_FRAME);
            room.fill(0);
            decoder.commit(8);
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
            Scan::Skip(window.len(), Reason::Stray)
        }

        fn view(_bytes: &[u8]) -> Option<()> {
            None
        }
    }

    #[test]
    fn stray_bytes_break_a_reliable_line_at_once() {
        let mut decoder = Decoder::<Deaf, 4>::new();
        decoder.push(&[1, 2]);
        assert_eq!(decoder.need(()), 0);
        let noise = decoder.next(()).unwrap().unwrap_err();
        assert_eq!((noise.offset, noise.len, noise.reason), (0, 2, Reason::Stray));
        assert_eq!(decoder.broken(), Some(noise));
    }

    #[test]
    fn a_pause_on_a_reliable_line_means_nothing() {
        let (start, end) = HEARTBEAT.split_at(5);
        let mut decoder = Arms::new();
        decoder.push(start);
        assert!(decoder.next(REPLIES).is_none());
        assert_eq!((decoder.idle(REPLIES), decoder.pending()), (None, 5));
        decoder.push(end);
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
        decoder.push(&[0, 0]);
        assert_eq!(decoder.need(()), 1);
        assert_eq!(decoder.idle(()), None);
        assert!(decoder.next(()).is_none());
        assert_eq!(decoder.pending(), 0);
        // But where it ends a run of stray bytes, that run is.
        decoder.push(&[5]);
        assert!(decoder.next(()).is_none());
        decoder.push(&[0]);
        assert_eq!(decoder.need(()), 0);
        assert!(decoder.next(()).is_some_and(|next| next.is_err()));
    }
}
