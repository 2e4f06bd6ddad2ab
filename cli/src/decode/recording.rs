//! The frames of a recording of bytes, and the bytes between them.

use armwire::decoder::{Decoder, Kind, Span};
use armwire::framing::Reason;
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

    /// Ends the recording, and prints the sum.
    fn finish(&mut self, out: &dyn Output);

    /// Offset and reason of the break of a lossless stream, after which nothing can be decoded.
    fn broken(&self) -> Option<(u64, Reason)>;
}

/// A recording of one protocol.
pub(super) struct Frames<P: Arm> {
    arm: P,
    from: Option<Speaker>,
    expect: P::Expect,
    decoder: Decoder<P, BUFFER>,
    /// Noise that may go on.
    run: Option<Run>,
    frames: u64,
    noise_bytes: u64,
    padding: u64,
    /// The end of the last damaged frame: its bytes are not shown again as stray ones.
    damaged: u64,
    /// The end of what was decoded, as an offset in the recording.
    end: u64,
}

/// Adjacent bytes that are noise for one reason.
struct Run {
    offset: u64,
    reason: Reason,
    bytes: Vec<u8>,
}

impl<P: Arm> Frames<P> {
    pub(super) fn new(from: Option<Speaker>) -> Self {
        let arm = P::default();
        let expect = expected(&arm, from);
        Self {
            arm,
            from,
            expect,
            decoder: Decoder::new(),
            run: None,
            frames: 0,
            noise_bytes: 0,
            padding: 0,
            damaged: 0,
            end: 0,
        }
    }

    /// Takes the items that are complete.
    fn take_items(&mut self, out: &dyn Output) {
        while self.decoder.broken().is_none()
            && let Some(span) = self.decoder.advance(&self.arm, self.expect)
        {
            self.take(span, out);
        }
    }

    fn take(&mut self, span: Span, out: &dyn Output) {
        let len = span.len() as u64;
        self.end = span.offset + len;
        match span.kind {
            Kind::Frame => {
                self.end_run("", out);
                self.frames += 1;
                let frame = self.decoder.item(span).bytes;
                let (from, text) = meaning(&self.arm, frame, self.expect, self.from);
                self.show(span.offset, frame, from, &text, out);
            }
            Kind::Padding => {
                self.end_run("", out);
                self.padding += len;
            }
            // All of it is shown, but it counts by its bytes: the others may contain a frame.
            Kind::Noise(reason @ Reason::Checksum { .. }) => {
                self.end_run("", out);
                self.noise_bytes += len;
                self.damaged = self.damaged.max(span.offset + self.show_candidate(span, reason, out));
            }
            Kind::Noise(reason) => {
                self.noise_bytes += len;
                self.extend_run(span, reason, out);
            }
            Kind::Broken(reason) => {
                self.end_run("", out);
                let len = self.show_candidate(span, reason, out);
                self.noise_bytes += len;
                self.end = span.offset + len;
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
                self.from,
                &format!("noise: {reason}{remark}"),
                out,
            );
        }
    }

    /// Shows all bytes that the verdict on a piece of noise needed. Returns their number.
    fn show_candidate(&self, span: Span, reason: Reason, out: &dyn Output) -> u64 {
        let bytes = self.decoder.candidate(span, &self.arm, self.expect);
        self.show(span.offset, bytes, self.from, &format!("noise: {reason}"), out);
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

impl<P: Arm> Recording for Frames<P> {
    fn push(&mut self, mut bytes: &[u8], out: &dyn Output) {
        while !bytes.is_empty() && self.decoder.broken().is_none() {
            bytes = self.decoder.push(bytes);
            self.take_items(out);
        }
    }

    fn finish(&mut self, out: &dyn Output) {
        // The end of the recording counts as an idle line.
        let skips = self.decoder.skipping() > 0;
        self.decoder.idle();
        self.take_items(out);
        self.end_run(if skips { "; the recording ends within it" } else { "" }, out);
        let rest = self.decoder.window();
        if !rest.is_empty() {
            let text = "the recording ends within a frame";
            self.show(self.decoder.offset(), rest, self.from, text, out);
            self.noise_bytes += rest.len() as u64;
            self.end += rest.len() as u64;
        }
        let Self {
            frames,
            noise_bytes,
            padding,
            end,
            ..
        } = self;
        let padding = match padding {
            0 => String::new(),
            padding => format!(", padding bytes: {padding}"),
        };
        let rest = match self.decoder.broken() {
            Some(_) => ", the rest not read",
            None => "",
        };
        out.remark(format_args!(
            "bytes: {end}, frames: {frames}, noise bytes: {noise_bytes}{padding}{rest}"
        ));
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

    fn finish(&mut self, out: &dyn Output) {
        if self.frames.is_none() {
            self.decide(out);
        }
        if let Some(frames) = &mut self.frames {
            frames.finish(out);
        }
    }

    fn broken(&self) -> Option<(u64, Reason)> {
        // A UART is not lossless.
        None
    }
}
