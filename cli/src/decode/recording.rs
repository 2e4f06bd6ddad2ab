//! The frames of a recording of bytes, and the bytes between them.

use armwire::decoder::{Decoder, Kind};
use armwire::framing::{Reason, Scan};
use armwire::ling::legacy::{Detector, Legacy};
use armwire::ling::{Ling, MAX_FRAME};
use armwire::messages::Messages;

use super::meaning::{expected, meaning};
use super::output::{Item, OnLine, Output};
use crate::args::Speaker;
use crate::describe::Arm;

/// The longest run of stray bytes in one entry.
const MAX_STRAY: usize = 1024;
/// Maximum number of bytes before the generation of a Ling arm is known. After that it is the current one.
const MAX_BEGINNING: usize = 2048;

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
    /// The bytes that are not decoded yet.
    window: Vec<u8>,
    /// Offset of the window in the recording.
    offset: u64,
    frames: u64,
    noise_bytes: u64,
    padding: u64,
    /// The end of the last damaged frame: its bytes are not shown again as noise.
    damaged: u64,
    broken: Option<(u64, Reason)>,
}

impl<P: Arm> Frames<P> {
    pub(super) fn new(from: Option<Speaker>) -> Self {
        let arm = P::default();
        let expect = expected(&arm, from);
        Self {
            arm,
            from,
            expect,
            window: Vec::new(),
            offset: 0,
            frames: 0,
            noise_bytes: 0,
            padding: 0,
            damaged: 0,
            broken: None,
        }
    }

    /// Decodes as much of the window as possible.
    fn scan(&mut self, is_end: bool, out: &dyn Output) {
        let window = std::mem::take(&mut self.window);
        let mut rest = &window[..];
        while !rest.is_empty() && self.broken.is_none() {
            let taken = self.scan_front(rest, is_end, out);
            if taken == 0 {
                break;
            }
            rest = &rest[taken..];
            self.offset += taken as u64;
        }
        let decoded = window.len() - rest.len();
        self.window = window;
        self.window.drain(..decoded);
    }

    /// Decodes the front of `rest`. Returns the number of decoded bytes; 0 if more bytes are needed.
    fn scan_front(&mut self, rest: &[u8], is_end: bool, out: &dyn Output) -> usize {
        let verdict = match is_end {
            // The end of the recording counts as an idle line.
            true => self.arm.scan_idle(rest, self.expect),
            false => self.arm.scan(rest, self.expect),
        };
        // The bytes that are shown, the number of bytes that are skipped, and the text.
        let (shown, len, text) = match verdict {
            Scan::Frame(len) => {
                let (from, text) = meaning(&self.arm, &rest[..len], self.expect, self.from);
                self.frames += 1;
                self.item(self.offset, &rest[..len], from, &text, out);
                return len;
            }
            Scan::Padding(len) => {
                self.padding += len as u64;
                return len;
            }
            Scan::Need(_) if !is_end => return 0,
            Scan::Need(_) => (
                0..rest.len(),
                rest.len(),
                "the recording ends within a frame".to_owned(),
            ),
            Scan::Noise(_, Reason::Stray) => {
                let len = self.stray(rest);
                // The run may continue.
                if len == rest.len() && len < MAX_STRAY && !is_end {
                    return 0;
                }
                let start = self.damaged.saturating_sub(self.offset).min(len as u64) as usize;
                (start..len, len, format!("noise: {}", Reason::Stray))
            }
            Scan::Noise(len, _) if len > rest.len() && !is_end => return 0,
            Scan::Noise(len, reason) if len > rest.len() => {
                let text = format!("noise: {reason}; the recording ends within it");
                (0..rest.len(), rest.len(), text)
            }
            // All of it is shown, but only its first byte is skipped: the others may contain a frame.
            Scan::Noise(len, reason @ Reason::Checksum { .. }) => {
                let end = self.decided(rest);
                self.damaged = self.damaged.max(self.offset + end as u64);
                (0..end, len, format!("noise: {reason}"))
            }
            Scan::Noise(len, reason) => (0..len, len, format!("noise: {reason}")),
            Scan::Broken(reason) => {
                let len = self.decided(rest);
                self.broken = Some((self.offset, reason));
                (0..len, len, format!("noise: {reason}"))
            }
        };
        if !shown.is_empty() {
            let at = self.offset + shown.start as u64;
            self.item(at, &rest[shown], self.from, &text, out);
        }
        self.noise_bytes += len as u64;
        len
    }

    fn item(&self, offset: u64, bytes: &[u8], from: Option<Speaker>, text: &str, out: &dyn Output) {
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

    /// Number of stray bytes at the front, at most [`MAX_STRAY`].
    fn stray(&self, bytes: &[u8]) -> usize {
        let mut len = 0;
        while len < bytes.len().min(MAX_STRAY)
            && let Scan::Noise(n, Reason::Stray) = self.arm.scan(&bytes[len..], self.expect)
        {
            len += n;
        }
        len.min(MAX_STRAY)
    }

    /// Number of bytes that the verdict about the front needed: all bytes of a damaged frame.
    fn decided(&self, bytes: &[u8]) -> usize {
        let undecided = |&len: &usize| matches!(self.arm.scan(&bytes[..len], self.expect), Scan::Need(_));
        (1..bytes.len()).take_while(undecided).count() + 1
    }
}

impl<P: Arm> Recording for Frames<P> {
    fn push(&mut self, bytes: &[u8], out: &dyn Output) {
        self.window.extend_from_slice(bytes);
        self.scan(false, out);
    }

    fn finish(&mut self, out: &dyn Output) {
        self.scan(true, out);
        let Self {
            frames,
            noise_bytes,
            padding,
            ..
        } = self;
        let padding = match padding {
            0 => String::new(),
            padding => format!(", padding bytes: {padding}"),
        };
        let rest = if self.broken.is_some() {
            ", the rest not read"
        } else {
            ""
        };
        out.remark(format_args!(
            "bytes: {}, frames: {frames}, noise bytes: {noise_bytes}{padding}{rest}",
            self.offset
        ));
    }

    fn broken(&self) -> Option<(u64, Reason)> {
        self.broken
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
    current: Decoder<MAX_FRAME>,
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

    /// Returns true if this byte ends a message of the current generation.
    fn ends_current_message(&mut self, byte: u8) -> bool {
        let byte = [byte];
        let left = self.current.push(&byte);
        debug_assert!(left.is_empty(), "after each byte the decoder has room for the next");
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
                out.remark(format_args!("This is {older}"));
                self.begin(Box::new(Frames::<Legacy>::new(self.from)), out);
            } else if self.ends_current_message(byte) || self.beginning.len() >= MAX_BEGINNING {
                self.begin(Box::new(Frames::<Ling>::new(self.from)), out);
            }
        }
        if let Some(frames) = &mut self.frames {
            frames.push(bytes.as_slice(), out);
        }
    }

    fn finish(&mut self, out: &dyn Output) {
        if self.frames.is_none() {
            self.begin(Box::new(Frames::<Ling>::new(self.from)), out);
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
