//! The items decoded from a line of bytes, with their positions.

use core::ops::Range;

use armwire::decoder::{Decoder, Kind};
use armwire::framing::Reason;

use crate::Subject;

/// A decoded item, with its position on the line.
#[derive(Clone, Debug, PartialEq)]
pub struct Span {
    /// The position on the line.
    pub range: Range<usize>,
    /// The kind of item.
    pub kind: Kind,
}

impl Span {
    /// The position of a frame. `None` for other items.
    pub fn frame(&self) -> Option<Range<usize>> {
        (self.kind == Kind::Frame).then(|| self.range.clone())
    }
}

/// A decoder, its input and its output.
pub struct LineDecoder<P: Subject, const N: usize> {
    decoder: Decoder<P, N>,
    protocol: P,
    expect: P::Expect,
    line: Vec<u8>,
    /// The decoded items in order. Adjacent items of the same kind are joined, except frames.
    pub received: Vec<Span>,
}

impl<P: Subject, const N: usize> LineDecoder<P, N> {
    /// A decoder without input.
    pub fn new(expect: P::Expect) -> Self {
        Self {
            decoder: Decoder::new(),
            protocol: P::default(),
            expect,
            line: Vec::new(),
            received: Vec::new(),
        }
    }

    /// Receives bytes in one chunk.
    pub fn on_bytes(&mut self, bytes: &[u8]) {
        let mut rest = bytes;
        while !rest.is_empty() {
            let later = self.decoder.push(rest);
            assert!(later.len() < rest.len(), "no room once next is done");
            self.line.extend(&rest[..rest.len() - later.len()]);
            rest = later;
            self.drain();
        }
    }

    /// Receives bytes like a driver that reads into the decoder's buffer, at most `most` at a time.
    pub fn on_bytes_into_room(&mut self, bytes: &[u8], most: usize) {
        let mut rest = bytes;
        while !rest.is_empty() {
            let room = self.decoder.space();
            assert!(!room.is_empty(), "no room once next is done");
            let n = rest.len().min(room.len()).min(most.max(1));
            let (now, later) = rest.split_at(n);
            room[..n].copy_from_slice(now);
            self.decoder.commit(n).expect("there is room");
            self.line.extend(now);
            rest = later;
            self.drain();
        }
    }

    /// Receives bytes like a driver with a receive threshold: as soon as a frame can be due, not before.
    pub fn on_bytes_by_threshold(&mut self, bytes: &[u8]) {
        let mut rest = bytes;
        while !rest.is_empty() {
            let need = self.decoder.need(&self.protocol, self.expect);
            assert!(need > 0, "something is due once next is done");
            let (now, later) = rest.split_at(need.min(rest.len()));
            rest = later;
            if let Some((last, before)) = now.split_last() {
                let frames = self.frames();
                self.on_bytes(before);
                assert_eq!(self.frames(), frames, "a frame was due {need} bytes early");
                self.on_bytes(&[*last]);
            }
        }
    }

    /// The line goes idle.
    pub fn idle(&mut self) {
        self.decoder.idle();
        self.drain();
        assert!(P::LOSSLESS || self.decoder.pending() == 0, "undecided on an idle line");
    }

    /// Number of undecided bytes.
    pub fn pending(&self) -> usize {
        self.decoder.pending()
    }

    /// The reason for a broken stream.
    pub fn broken(&self) -> Option<Reason> {
        self.decoder.broken().map(|(_, reason)| reason)
    }

    fn frames(&self) -> usize {
        self.received.iter().filter(|span| span.kind == Kind::Frame).count()
    }

    fn drain(&mut self) {
        while let Some(item) = self.decoder.next(&self.protocol, self.expect) {
            let start = usize::try_from(item.offset).expect("lines are short");
            let range = start..start + item.bytes.len();
            assert_eq!(item.bytes, &self.line[range.clone()], "other bytes than came");
            match self.received.last_mut() {
                Some(last) if last.kind == item.kind && item.kind != Kind::Frame && last.range.end == start => {
                    last.range.end = range.end;
                }
                _ => self.received.push(Span { range, kind: item.kind }),
            }
        }
    }
}
