//! The frames of a recording of bytes, and the bytes between them.

use armwire::decoder::{Decoder, Kind, Span};
use armwire::framing::{Framing, Reason};
use armwire::ling::legacy::{Detector, Legacy, OlderGeneration};
use armwire::ling::{Ling, MAX_FRAME};
use armwire::messages::Messages;
use armwire::xarm;
use armwire_host::describe::Arm;

use super::meaning::{Meaning, Sender, expected, meaning};
use super::output::{Item, OnLine, Output};
use super::sum::Part;
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
    fn push(&mut self, bytes: &[u8], at: At<'_>, out: &dyn Output);

    /// Ends the recording. Returns the counts for its sum.
    fn finish(&mut self, out: &dyn Output) -> Counts;

    /// Returns true if there was a frame.
    fn has_frames(&self) -> bool;

    /// Returns true if the bytes so far end inside a frame.
    fn is_inside_frame(&self) -> bool;

    /// Returns true if a frame is a message of another sender than the one that a mark names.
    fn is_contradicted(&self) -> bool;

    /// Returns true if all frames are taken as those of another sender than the one that a mark names.
    fn is_turned(&self) -> bool {
        false
    }

    /// Takes note that the other direction has its own mark.
    fn trust_mark(&mut self);

    /// Offset and reason of the break of a lossless stream, after which nothing can be decoded.
    fn broken(&self) -> Option<(u64, Reason)>;
}

/// The place of bytes in a recording.
#[derive(Clone, Copy)]
pub(super) struct At<'a> {
    /// Time and endpoint of a transfer; empty for the offset in the stream.
    pub(super) place: &'a str,
    /// Time in ns; 0 if the recording has no times.
    pub(super) nanos: u64,
}

impl At<'_> {
    /// The offset in the stream.
    pub(super) const OFFSET: Self = Self { place: "", nanos: 0 };
}

/// The counts of a recording.
#[derive(Clone, Copy, Default)]
pub(super) struct Counts {
    pub(super) bytes: u64,
    pub(super) frames: u64,
    pub(super) noise_bytes: u64,
    /// Number of bytes behind the break of a stream without losses, which are not in `bytes`.
    pub(super) behind_break: u64,
    padding: u64,
    /// Number of frames without a known message.
    pub(super) unknown: u64,
    /// Number of frames that may be the other sender's.
    uncertain: u64,
    /// Number of bytes of USB devices without a frame, and of their streams that break.
    others: u64,
    pub(super) broken_streams: u64,
}

impl Counts {
    pub(super) fn has_bytes(&self) -> bool {
        self.bytes + self.others > 0
    }

    /// The counts of a device that is no arm.
    pub(super) fn of_another_device(self) -> Self {
        Self {
            others: self.bytes + self.behind_break,
            ..Self::default()
        }
    }

    /// The counts of this and another direction.
    pub(super) fn with(self, other: Self) -> Self {
        Self {
            bytes: self.bytes + other.bytes,
            frames: self.frames + other.frames,
            noise_bytes: self.noise_bytes + other.noise_bytes,
            behind_break: self.behind_break + other.behind_break,
            padding: self.padding + other.padding,
            unknown: self.unknown + other.unknown,
            uncertain: self.uncertain + other.uncertain,
            others: self.others + other.others,
            broken_streams: self.broken_streams + other.broken_streams,
        }
    }

    /// The counts for the sum.
    pub(super) fn parts(&self) -> Vec<Part> {
        vec![
            Part::always("bytes", self.bytes),
            Part::always("frames", self.frames),
            Part::always("noise bytes", self.noise_bytes).flaw(),
            Part::some("bytes behind a break", self.behind_break).flaw(),
            Part::some("padding bytes", self.padding),
            Part::some("frames without a message", self.unknown).flaw(),
            Part::some("frames of uncertain direction", self.uncertain).flaw(),
            Part::some("bytes of other devices", self.others),
            Part::some("broken streams", self.broken_streams).flaw(),
        ]
    }
}

/// The reading of a line: what comes next, and what a frame means.
pub(super) trait Reading {
    type Arm: Arm;

    /// The expectation of the next frame.
    fn expect(&self) -> <Self::Arm as Framing>::Expect;

    /// The sender of the bytes between frames, if it is known.
    fn from(&self) -> Option<Speaker>;

    fn meaning(&mut self, frame: &[u8]) -> Meaning;

    /// The number of frames so far that may be the other sender's.
    fn uncertain(&self) -> u64 {
        0
    }

    /// Takes note that the other direction has its own mark.
    fn trust_mark(&mut self) {}
}

/// The bytes of one sender, or of one that the frames name.
pub(super) struct OneSender<P>(Sender, P);

impl<P: Arm> Reading for OneSender<P> {
    type Arm = P;

    fn expect(&self) -> P::Expect {
        expected(&self.1, self.0.speaker())
    }

    fn from(&self) -> Option<Speaker> {
        self.0.speaker()
    }

    fn meaning(&mut self, frame: &[u8]) -> Meaning {
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
    /// Number of bytes so far.
    pushed: u64,
    /// The end of the last damaged frame: its bytes are not shown again as stray ones.
    damaged: u64,
    is_contradicted: bool,
    /// The place of the last bytes.
    place: String,
    nanos: u64,
}

/// Adjacent bytes that are noise for one reason.
struct Run {
    offset: u64,
    reason: Reason,
    bytes: Vec<u8>,
    /// The place of its first bytes.
    place: String,
    nanos: u64,
}

impl<P: Arm> Frames<P> {
    pub(super) fn new(sender: Sender) -> Self {
        Self::of(OneSender(sender, P::default()))
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
            pushed: 0,
            damaged: 0,
            is_contradicted: false,
            place: String::new(),
            nanos: 0,
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
                let Meaning { from, text, is_message } = self.reading.meaning(frame);
                self.counts.unknown += u64::from(!is_message);
                self.is_contradicted |= is_message && self.reading.from().is_some_and(|named| from != Some(named));
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
            place: self.place.clone(),
            nanos: self.nanos,
        });
        run.bytes.extend(self.decoder.item(span).bytes);
        match reason {
            Reason::Stray if run.bytes.len() >= MAX_STRAY => {
                let next = Run {
                    offset: run.offset + MAX_STRAY as u64,
                    reason,
                    bytes: run.bytes.split_off(MAX_STRAY),
                    place: self.place.clone(),
                    nanos: self.nanos,
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
        let Some(run) = self.run.take() else { return };
        let Run {
            offset, reason, bytes, ..
        } = run;
        let shown = match reason {
            Reason::Stray => self.damaged.saturating_sub(offset).min(bytes.len() as u64),
            _ => 0,
        };
        let bytes = &bytes[shown as usize..];
        if !bytes.is_empty() {
            let at = At {
                place: &run.place,
                nanos: run.nanos,
            };
            let text = format!("noise: {reason}{remark}");
            self.show_at(at, offset + shown, bytes, self.reading.from(), &text, out);
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
        let at = At {
            place: &self.place,
            nanos: self.nanos,
        };
        self.show_at(at, offset, bytes, from, text, out);
    }

    fn show_at(&self, at: At<'_>, offset: u64, bytes: &[u8], from: Option<Speaker>, text: &str, out: &dyn Output) {
        let on_line = Some(OnLine {
            protocol: P::PROTOCOL,
            from,
            nanos: at.nanos,
        });
        let item = |place| Item {
            place,
            bytes,
            text,
            on_line,
        };
        match at.place {
            "" => out.item(&item(format_args!("{offset:8}"))),
            place => out.item(&item(format_args!("{place}"))),
        }
    }
}

impl<P: Arm, R: Reading<Arm = P>> Recording for Frames<P, R> {
    fn push(&mut self, mut bytes: &[u8], at: At<'_>, out: &dyn Output) {
        at.place.clone_into(&mut self.place);
        self.nanos = at.nanos;
        self.pushed += bytes.len() as u64;
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
        self.counts.behind_break = self.pushed - self.counts.bytes;
        self.counts.uncertain = self.reading.uncertain();
        self.counts
    }

    fn has_frames(&self) -> bool {
        self.counts.frames > 0
    }

    fn is_inside_frame(&self) -> bool {
        !self.decoder.window().is_empty()
    }

    fn is_contradicted(&self) -> bool {
        self.is_contradicted
    }

    fn trust_mark(&mut self) {
        self.reading.trust_mark();
    }

    fn broken(&self) -> Option<(u64, Reason)> {
        self.decoder.broken()
    }
}

/// What decides how a stream is decoded, byte by byte: the result must not depend on the size of pieces.
pub(super) trait Trial {
    /// Takes the next byte of the stream. Returns the decoder if it is certain.
    fn push(&mut self, byte: u8, out: &dyn Output) -> Option<Box<dyn Recording>>;

    /// Returns the decoder by the bytes so far.
    fn finish(&mut self, out: &dyn Output) -> Box<dyn Recording>;

    /// Returns true if the bytes so far end inside a frame.
    fn is_inside_frame(&self) -> bool;

    /// Returns true if the decision contradicts a mark.
    fn is_turned(&self) -> bool {
        false
    }
}

/// A stream whose decoder its first message decides.
pub(super) struct Undecided<T> {
    trial: T,
    /// The bytes before the decision, and their parts by place: its text, its time in ns, and the number of bytes.
    beginning: Vec<u8>,
    parts: Vec<(String, u64, usize)>,
    /// The other direction has its own mark.
    is_trusted: bool,
    frames: Option<Box<dyn Recording>>,
}

impl<T: Trial> Undecided<T> {
    fn new(trial: T) -> Self {
        Self {
            trial,
            beginning: Vec::new(),
            parts: Vec::new(),
            is_trusted: false,
            frames: None,
        }
    }

    /// Passes the bytes so far to their decoder.
    fn begin(&mut self, mut frames: Box<dyn Recording>, out: &dyn Output) {
        if self.is_trusted {
            frames.trust_mark();
        }
        let beginning = std::mem::take(&mut self.beginning);
        let mut rest = &beginning[..];
        for (place, nanos, len) in std::mem::take(&mut self.parts) {
            let (bytes, behind) = rest.split_at(len);
            frames.push(bytes, At { place: &place, nanos }, out);
            rest = behind;
        }
        self.frames = Some(frames);
    }

    /// Keeps a byte before the decision.
    fn keep(&mut self, byte: u8, at: At<'_>) {
        self.beginning.push(byte);
        match self.parts.last_mut() {
            Some((place, nanos, len)) if place == at.place && *nanos == at.nanos => *len += 1,
            _ => self.parts.push((at.place.to_owned(), at.nanos, 1)),
        }
    }
}

impl<T: Trial> Recording for Undecided<T> {
    fn push(&mut self, bytes: &[u8], at: At<'_>, out: &dyn Output) {
        let mut bytes = bytes.iter();
        while self.frames.is_none()
            && let Some(&byte) = bytes.next()
        {
            self.keep(byte, at);
            let is_full = self.beginning.len() >= MAX_BEGINNING;
            let found = self.trial.push(byte, out);
            if let Some(frames) = found.or_else(|| is_full.then(|| self.trial.finish(out))) {
                self.begin(frames, out);
            }
        }
        if let Some(frames) = &mut self.frames {
            frames.push(bytes.as_slice(), at, out);
        }
    }

    fn finish(&mut self, out: &dyn Output) -> Counts {
        if self.frames.is_none() {
            let frames = self.trial.finish(out);
            self.begin(frames, out);
        }
        self.frames
            .as_mut()
            .map_or(Counts::default(), |frames| frames.finish(out))
    }

    fn has_frames(&self) -> bool {
        self.frames.as_ref().is_some_and(|frames| frames.has_frames())
    }

    fn is_inside_frame(&self) -> bool {
        let frames = self.frames.as_ref();
        frames.map_or_else(|| self.trial.is_inside_frame(), |frames| frames.is_inside_frame())
    }

    fn is_contradicted(&self) -> bool {
        self.is_turned() || self.frames.as_ref().is_some_and(|frames| frames.is_contradicted())
    }

    fn is_turned(&self) -> bool {
        self.trial.is_turned()
    }

    fn trust_mark(&mut self) {
        self.is_trusted = true;
        if let Some(frames) = &mut self.frames {
            frames.trust_mark();
        }
    }

    fn broken(&self) -> Option<(u64, Reason)> {
        self.frames.as_ref().and_then(|frames| frames.broken())
    }
}

/// The sender of a protocol whose frames differ by it. A mark names one, and the first message decides.
pub(super) struct OfEither<P: Arm> {
    /// A decoder for each sender, the more likely one first.
    trials: [(Speaker, Decoder<P, BUFFER>); 2],
    /// The frames behind the decision.
    frames: fn(Speaker) -> Box<dyn Recording>,
    is_turned: bool,
    is_marked: bool,
}

impl<P: Arm + 'static> OfEither<P> {
    /// The frames of a sender that is not known. Without a mark they are the arm's unless the first one is a request
    /// only.
    pub(super) fn recording(sender: Sender, frames: fn(Speaker) -> Box<dyn Recording>) -> Box<dyn Recording> {
        let speakers = match sender.speaker() {
            Some(Speaker::Host) => [Speaker::Host, Speaker::Arm],
            Some(Speaker::Arm) | None => [Speaker::Arm, Speaker::Host],
        };
        Box::new(Undecided::new(Self {
            trials: speakers.map(|speaker| (speaker, Decoder::new())),
            frames,
            is_turned: false,
            is_marked: sender.speaker().is_some(),
        }))
    }
}

impl<P: Arm + 'static> Trial for OfEither<P> {
    fn push(&mut self, byte: u8, _: &dyn Output) -> Option<Box<dyn Recording>> {
        let arm = P::default();
        let found = self.trials.iter_mut().position(|(speaker, decoder)| {
            let expect = expected(&arm, Some(*speaker));
            has_message(decoder, byte, &arm, expect, |frame| {
                meaning(&arm, frame, expect, Sender::Known(*speaker)).is_message
            })
        });
        let are_broken = || self.trials.iter().all(|(_, decoder)| decoder.broken().is_some());
        let found = found.or_else(|| are_broken().then_some(0))?;
        self.is_turned = found > 0 && self.is_marked;
        Some((self.frames)(self.trials[found].0))
    }

    fn finish(&mut self, _: &dyn Output) -> Box<dyn Recording> {
        (self.frames)(self.trials[0].0)
    }

    fn is_inside_frame(&self) -> bool {
        !self.trials[0].1.window().is_empty()
    }

    fn is_turned(&self) -> bool {
        self.is_turned
    }
}

/// Returns true if this byte ends a message.
fn has_message<P: Arm, const N: usize>(
    decoder: &mut Decoder<P, N>,
    byte: u8,
    arm: &P,
    expect: P::Expect,
    is_message: impl Fn(&[u8]) -> bool,
) -> bool {
    if decoder.broken().is_none() {
        let byte = [byte];
        let left = decoder.push(&byte);
        debug_assert!(left.is_empty(), "after each byte the decoder has room for the next");
    }
    find_message(decoder, arm, expect, is_message)
}

/// Returns true if the decoder has a message.
fn find_message<P: Arm, const N: usize>(
    decoder: &mut Decoder<P, N>,
    arm: &P,
    expect: P::Expect,
    is_message: impl Fn(&[u8]) -> bool,
) -> bool {
    while decoder.broken().is_none()
        && let Some(item) = decoder.next(arm, expect)
    {
        if item.kind == Kind::Frame && is_message(item.bytes) {
            return true;
        }
    }
    false
}

/// The generation of a Ling arm.
pub(super) struct Generation {
    sender: Sender,
    older: Detector,
    current: Decoder<Ling, MAX_FRAME>,
}

impl Generation {
    pub(super) fn recording(sender: Sender) -> Box<dyn Recording> {
        Box::new(Undecided::new(Self {
            sender,
            older: Detector::new(),
            current: Decoder::new(),
        }))
    }

    fn older(&self, older: OlderGeneration, out: &dyn Output) -> Box<dyn Recording> {
        out.remark(format_args!("This is {older}"));
        Box::new(Frames::<Legacy>::new(self.sender))
    }
}

impl Trial for Generation {
    fn push(&mut self, byte: u8, out: &dyn Output) -> Option<Box<dyn Recording>> {
        if let Some(older) = self.older.push(&[byte]) {
            return Some(self.older(older, out));
        }
        let is_current = has_message(&mut self.current, byte, &Ling, (), is_ling_message);
        is_current.then(|| Box::new(Frames::<Ling>::new(self.sender)) as Box<dyn Recording>)
    }

    /// The bytes so far have no message of the current generation, except perhaps behind an incomplete frame.
    fn finish(&mut self, out: &dyn Output) -> Box<dyn Recording> {
        self.current.idle();
        let is_current = find_message(&mut self.current, &Ling, (), is_ling_message);
        match self.older.finish().filter(|_| !is_current) {
            Some(older) => self.older(older, out),
            None => Box::new(Frames::<Ling>::new(self.sender)),
        }
    }

    fn is_inside_frame(&self) -> bool {
        !self.current.window().is_empty()
    }
}

fn is_ling_message(frame: &[u8]) -> bool {
    Ling.parse_request(frame).is_ok() || Ling.parse_response(frame, ()).is_ok()
}
