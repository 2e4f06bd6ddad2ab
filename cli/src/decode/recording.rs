//! The frames of a recording of bytes, and the bytes between them.

use std::fmt::{self, Display};

use armwire::decoder::{Decoder, Kind, Span};
use armwire::framing::{Framing, Reason};
use armwire::ling::legacy::{Detector, Legacy, OlderGeneration};
use armwire::ling::{Ling, MAX_FRAME};
use armwire::messages::Messages;
use armwire::xarm;
use armwire_host::describe::Arm;

use super::meaning::{expected, meaning};
use super::output::{Item, OnLine, Output};
use crate::args::Speaker;

/// Buffer size: the longest frame of every protocol fits.
const BUFFER: usize = xarm::MAX_FRAME;
/// The longest run of stray bytes in one entry.
const MAX_STRAY: usize = 1024;
/// Maximum number of bytes before the generation of a Ling arm is known. After that the detector decides by one frame, as
/// at the end of a recording.
const MAX_BEGINNING: usize = 16 * 1024;

/// A decoder of bytes from a line.
pub(super) trait Recording {
    /// Takes the next bytes, in pieces of any size.
    fn push(&mut self, bytes: &[u8], out: &dyn Output);

    /// Ends the recording. Returns the counts for its sum.
    fn finish(&mut self, out: &dyn Output) -> Counts;

    /// Offset and reason of the break of a lossless stream, after which nothing can be decoded.
    fn broken(&self) -> Option<(u64, Reason)>;
}

/// The counts of a recording. They print as its sum.
#[derive(Clone, Copy, Default)]
pub(super) struct Counts {
    bytes: u64,
    frames: u64,
    noise_bytes: u64,
    padding: u64,
    /// The stream broke, and the rest was not read.
    is_broken: bool,
}

impl Counts {
    pub(super) fn has_bytes(&self) -> bool {
        self.bytes > 0
    }

    /// The counts of this and another direction.
    pub(super) fn with(self, other: Self) -> Self {
        Self {
            bytes: self.bytes + other.bytes,
            frames: self.frames + other.frames,
            noise_bytes: self.noise_bytes + other.noise_bytes,
            padding: self.padding + other.padding,
            is_broken: self.is_broken || other.is_broken,
        }
    }
}

impl Display for Counts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            bytes,
            frames,
            noise_bytes,
            padding,
            is_broken,
        } = self;
        write!(f, "bytes: {bytes}, frames: {frames}, noise bytes: {noise_bytes}")?;
        if *padding > 0 {
            write!(f, ", padding bytes: {padding}")?;
        }
        f.write_str(if *is_broken { ", the rest not read" } else { "" })
    }
}

/// The reading of a line: what comes next, and what a frame means.
pub(super) trait Reading {
    type Arm: Arm;

    /// The expectation of the next frame.
    fn expect(&self) -> <Self::Arm as Framing>::Expect;

    /// The sender of the bytes between frames, if it is known.
    fn from(&self) -> Option<Speaker>;

    /// The sender of a frame, if it is known, and the frame's meaning.
    fn meaning(&mut self, frame: &[u8]) -> (Option<Speaker>, String);
}

/// The bytes of one sender, or of one that the frames name.
pub(super) struct OneSender<P>(Option<Speaker>, P);

impl<P: Arm> Reading for OneSender<P> {
    type Arm = P;

    fn expect(&self) -> P::Expect {
        expected(&self.1, self.0)
    }

    fn from(&self) -> Option<Speaker> {
        self.0
    }

    fn meaning(&mut self, frame: &[u8]) -> (Option<Speaker>, String) {
        meaning(&self.1, frame, self.expect(), self.0)
    }
}

/// A recording of one protocol.
pub(super) struct Frames<P: Arm, R: Reading<Arm = P> = OneSender<P>> {
    arm: P,
    reading: R,
    decoder: Decoder<P, BUFFER>,
    /// Noise that may go on.
    run: Option<Run>,
    counts: Counts,
    /// The end of the last damaged frame: its bytes are not shown again as stray ones.
    damaged: u64,
}

/// Adjacent bytes that are noise for one reason.
struct Run {
    offset: u64,
    reason: Reason,
    bytes: Vec<u8>,
}

impl<P: Arm> Frames<P> {
    pub(super) fn new(from: Option<Speaker>) -> Self {
        Self::of(OneSender(from, P::default()))
    }
}

impl<P: Arm, R: Reading<Arm = P>> Frames<P, R> {
    pub(super) fn of(reading: R) -> Self {
        Self {
            arm: P::default(),
            reading,
            decoder: Decoder::new(),
            run: None,
            counts: Counts::default(),
            damaged: 0,
        }
    }

    /// Takes the items that are complete.
    fn take_items(&mut self, out: &dyn Output) {
        while self.decoder.broken().is_none()
            && let Some(span) = self.decoder.advance(&self.arm, self.reading.expect())
        {
            self.take(span, out);
        }
    }

    fn take(&mut self, span: Span, out: &dyn Output) {
        let len = span.len() as u64;
        self.counts.bytes = span.offset + len;
        match span.kind {
            Kind::Frame => {
                self.end_run("", out);
                self.counts.frames += 1;
                let frame = self.decoder.item(span).bytes;
                let (from, text) = self.reading.meaning(frame);
                self.show(span.offset, frame, from, &text, out);
            }
            Kind::Padding => {
                self.end_run("", out);
                self.counts.padding += len;
            }
            // All of it is shown, but it counts by its bytes: the others may contain a frame.
            Kind::Noise(reason @ Reason::Checksum { .. }) => {
                self.end_run("", out);
                self.counts.noise_bytes += len;
                self.damaged = self.damaged.max(span.offset + self.show_candidate(span, reason, out));
            }
            Kind::Noise(reason) => {
                self.counts.noise_bytes += len;
                self.extend_run(span, reason, out);
            }
            Kind::Broken(reason) => {
                self.end_run("", out);
                let len = self.show_candidate(span, reason, out);
                self.counts.noise_bytes += len;
                self.counts.bytes = span.offset + len;
            }
        }
    }

    /// Adds noise to the run, which ends with it unless more may follow. An item is shorter than [`MAX_STRAY`].
    fn extend_run(&mut self, span: Span, reason: Reason, out: &dyn Output) {
        if self.run.as_ref().is_some_and(|run| run.reason != reason) {
            self.end_run("", out);
        }
        let run = self.run.get_or_insert_with(|| Run {
            offset: span.offset,
            reason,
            bytes: Vec::new(),
        });
        run.bytes.extend(self.decoder.item(span).bytes);
        match reason {
            Reason::Stray if run.bytes.len() >= MAX_STRAY => {
                let next = Run {
                    offset: run.offset + MAX_STRAY as u64,
                    reason,
                    bytes: run.bytes.split_off(MAX_STRAY),
                };
                self.end_run("", out);
                self.run = Some(next);
            }
            Reason::Stray => {}
            _ if self.decoder.skipping() > 0 => {}
            _ => self.end_run("", out),
        }
    }

    /// Shows the run.
    fn end_run(&mut self, remark: &str, out: &dyn Output) {
        let Some(Run { offset, reason, bytes }) = self.run.take() else {
            return;
        };
        let shown = match reason {
            Reason::Stray => self.damaged.saturating_sub(offset).min(bytes.len() as u64),
            _ => 0,
        };
        let bytes = &bytes[shown as usize..];
        if !bytes.is_empty() {
            self.show(
                offset + shown,
                bytes,
                self.reading.from(),
                &format!("noise: {reason}{remark}"),
                out,
            );
        }
    }

    /// Shows all bytes that the verdict on a piece of noise needed. Returns their number.
    fn show_candidate(&self, span: Span, reason: Reason, out: &dyn Output) -> u64 {
        let bytes = self.decoder.candidate(span, &self.arm, self.reading.expect());
        self.show(
            span.offset,
            bytes,
            self.reading.from(),
            &format!("noise: {reason}"),
            out,
        );
        bytes.len() as u64
    }

    fn show(&self, offset: u64, bytes: &[u8], from: Option<Speaker>, text: &str, out: &dyn Output) {
        let on_line = Some(OnLine {
            protocol: P::PROTOCOL,
            from,
            nanos: 0,
        });
        out.item(&Item {
            place: format_args!("{offset:8}"),
            bytes,
            text,
            on_line,
        });
    }
}

impl<P: Arm, R: Reading<Arm = P>> Recording for Frames<P, R> {
    fn push(&mut self, mut bytes: &[u8], out: &dyn Output) {
        while !bytes.is_empty() && self.decoder.broken().is_none() {
            bytes = self.decoder.push(bytes);
            self.take_items(out);
        }
    }

    fn finish(&mut self, out: &dyn Output) -> Counts {
        // The end of the recording counts as an idle line.
        let skips = self.decoder.skipping() > 0;
        self.decoder.idle();
        self.take_items(out);
        self.end_run(if skips { "; the recording ends within it" } else { "" }, out);
        let rest = self.decoder.window();
        if !rest.is_empty() {
            let text = "the recording ends within a frame";
            self.show(self.decoder.offset(), rest, self.reading.from(), text, out);
            self.counts.noise_bytes += rest.len() as u64;
            self.counts.bytes += rest.len() as u64;
        }
        self.counts.is_broken = self.decoder.broken().is_some();
        self.counts
    }

    fn broken(&self) -> Option<(u64, Reason)> {
        self.decoder.broken()
    }
}

/// A recording of a Ling arm of either generation.
pub(super) struct LingFrames {
    from: Option<Speaker>,
    /// The decoder of the generation; `None` before it is known.
    frames: Option<Box<dyn Recording>>,
    /// The bytes before the generation is known.
    beginning: Vec<u8>,
    older: Detector,
    current: Decoder<Ling, MAX_FRAME>,
}

impl LingFrames {
    pub(super) fn new(from: Option<Speaker>) -> Self {
        Self {
            from,
            frames: None,
            beginning: Vec::new(),
            older: Detector::new(),
            current: Decoder::new(),
        }
    }

    /// Passes the bytes so far to the decoder of the generation.
    fn begin(&mut self, mut frames: Box<dyn Recording>, out: &dyn Output) {
        frames.push(&std::mem::take(&mut self.beginning), out);
        self.frames = Some(frames);
    }

    fn begin_older(&mut self, older: OlderGeneration, out: &dyn Output) {
        out.remark(format_args!("This is {older}"));
        self.begin(Box::new(Frames::<Legacy>::new(self.from)), out);
    }

    /// Decides by the bytes so far, which have no message of the current generation, except perhaps behind an incomplete
    /// frame.
    fn decide(&mut self, out: &dyn Output) {
        self.current.idle();
        let is_current = self.has_current_message();
        match self.older.finish().filter(|_| !is_current) {
            Some(older) => self.begin_older(older, out),
            None => self.begin(Box::new(Frames::<Ling>::new(self.from)), out),
        }
    }

    /// Returns true if this byte ends a message of the current generation.
    fn ends_current_message(&mut self, byte: u8) -> bool {
        let byte = [byte];
        let left = self.current.push(&byte);
        debug_assert!(left.is_empty(), "after each byte the decoder has room for the next");
        self.has_current_message()
    }

    /// Returns true if the decoder finds a message of the current generation.
    fn has_current_message(&mut self) -> bool {
        while let Some(item) = self.current.next(&Ling, ()) {
            let is_message = || Ling.parse_request(item.bytes).is_ok() || Ling.parse_response(item.bytes, ()).is_ok();
            if item.kind == Kind::Frame && is_message() {
                return true;
            }
        }
        false
    }
}

impl Recording for LingFrames {
    fn push(&mut self, bytes: &[u8], out: &dyn Output) {
        let mut bytes = bytes.iter();
        // Byte by byte: the result must not depend on the size of pieces.
        while self.frames.is_none()
            && let Some(&byte) = bytes.next()
        {
            self.beginning.push(byte);
            if let Some(older) = self.older.push(&[byte]) {
                self.begin_older(older, out);
            } else if self.ends_current_message(byte) {
                self.begin(Box::new(Frames::<Ling>::new(self.from)), out);
            } else if self.beginning.len() >= MAX_BEGINNING {
                self.decide(out);
            }
        }
        if let Some(frames) = &mut self.frames {
            frames.push(bytes.as_slice(), out);
        }
    }

    fn finish(&mut self, out: &dyn Output) -> Counts {
        if self.frames.is_none() {
            self.decide(out);
        }
        self.frames
            .as_mut()
            .map_or(Counts::default(), |frames| frames.finish(out))
    }

    fn broken(&self) -> Option<(u64, Reason)> {
        // A UART is not lossless.
        None
    }
}
