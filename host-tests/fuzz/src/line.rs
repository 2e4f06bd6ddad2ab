//! What comes out of a line of bytes, and where on the line it lay.

use core::ops::Range;

use armwire::{Decoder, Noise};

use crate::Subject;

/// Something that came out of a decoder.
#[derive(Clone, Debug, PartialEq)]
pub enum Out {
    /// A frame, by its place on the line.
    Frame(Range<usize>),
    /// Bytes in no frame.
    Noise(Noise),
}

impl Out {
    /// Its place on the line, if it is a frame.
    pub fn frame(&self) -> Option<Range<usize>> {
        match self {
            Self::Frame(range) => Some(range.clone()),
            Self::Noise(_) => None,
        }
    }

    /// Its place on the line.
    pub fn range(&self) -> Range<usize> {
        match self {
            Self::Frame(range) => range.clone(),
            Self::Noise(noise) => {
                let start = usize::try_from(noise.offset).expect("lines are short");
                start..start + noise.len
            }
        }
    }
}

/// A decoder, and what came out of it.
pub struct Ear<P: Subject, const N: usize> {
    decoder: Decoder<P, N>,
    expect: P::Expect,
    taken: usize,
    /// In the order in which it came.
    pub heard: Vec<Out>,
}

impl<P: Subject, const N: usize> Ear<P, N> {
    /// One that has heard nothing.
    pub fn new(expect: P::Expect) -> Self {
        Self {
            decoder: Decoder::new(),
            expect,
            taken: 0,
            heard: Vec::new(),
        }
    }

    /// Hears bytes, in one piece.
    pub fn hear(&mut self, bytes: &[u8]) {
        let mut rest = bytes;
        while let Some(next) = self.decoder.decode(&mut rest, self.expect) {
            let next = next.map(P::wire_len);
            let taken = bytes.len() - rest.len();
            self.note(next, self.taken + taken - self.decoder.pending());
        }
        assert!(rest.is_empty(), "it says nothing and leaves bytes");
        self.taken += bytes.len();
    }

    /// Hears bytes, in one piece, all of them by way of the decoder's buffer.
    pub fn hear_buffered(&mut self, bytes: &[u8]) {
        let mut rest = bytes;
        while !rest.is_empty() {
            let later = self.decoder.push(rest);
            assert!(later.len() < rest.len(), "no room once next is done");
            self.taken += rest.len() - later.len();
            rest = later;
            self.drain();
        }
    }

    /// Hears bytes as a driver with a receive threshold hands them in: as soon as something can be due, not before.
    pub fn hear_by_need(&mut self, bytes: &[u8]) {
        let mut rest = bytes;
        while !rest.is_empty() {
            let need = self.decoder.need(self.expect);
            assert!(need > 0, "something is due once next is done");
            let (now, later) = rest.split_at(need.min(rest.len()));
            rest = later;
            if let Some((last, before)) = now.split_last() {
                let heard = self.heard.len();
                self.hear(before);
                assert_eq!(self.heard.len(), heard, "something was due {need} bytes early");
                self.hear(&[*last]);
            }
        }
    }

    /// The line goes idle.
    pub fn idle(&mut self) {
        loop {
            let before = self.heard.len();
            self.heard.extend(self.decoder.idle(self.expect).map(Out::Noise));
            self.drain();
            if self.heard.len() == before {
                break;
            }
        }
        assert!(P::RELIABLE || self.decoder.pending() == 0, "undecided on an idle line");
    }

    /// How many bytes are not decided on.
    pub fn pending(&self) -> usize {
        self.decoder.pending()
    }

    /// What broke the stream.
    pub fn broken(&self) -> Option<Noise> {
        self.decoder.broken()
    }

    fn drain(&mut self) {
        while let Some(next) = self.decoder.next(self.expect) {
            let next = next.map(P::wire_len);
            self.note(next, self.taken - self.decoder.pending());
        }
    }

    /// Notes what came out and where it ended, if it is a frame.
    fn note(&mut self, next: Result<usize, Noise>, end: usize) {
        self.heard.push(match next {
            Ok(len) => Out::Frame(end - len..end),
            Err(noise) => Out::Noise(noise),
        });
    }
}
