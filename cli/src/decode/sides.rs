//! The streams of bytes in a recording: each direction of a line, and each endpoint of a USB device.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::fmt::Arguments;

use armwire::alpha1::Alpha1;
use armwire::framing::Reason;
use armwire::ling::legacy::Legacy;
use armwire::xarm::XArm;

use super::doubts::Doubt;
use super::meaning::Sender;
use super::output::{Item, OnLine, Output};
use super::recording::{At, Counts, Frames, Generation, OfEither, Recording};
use super::servo_bus::ServoBus;
use super::unit::{Bytes, Hint, Transfer};
use super::xarm_line::XArmLine;
use crate::args::{ArmKind, Speaker};

/// Maximum number of bytes of a device that are kept for the case that they are frames of another arm.
const MAX_KEPT: usize = 4 * 1024;
/// Maximum number of devices in a capture. Each has decoders.
const MAX_DEVICES: usize = 64;
/// Maximum number of items that are held before the first frame of a device.
const MAX_HELD: usize = 64;

/// Properties of a recorded line.
#[derive(Clone, Copy)]
pub(super) struct Line {
    pub(super) arm: ArmKind,
    /// The sender of all bytes, if it is known.
    pub(super) from: Option<Speaker>,
    /// The sender of what a log calls TX.
    pub(super) tx: Speaker,
}

impl Line {
    /// The sender of bytes that a text calls those of this one.
    fn sender(&self, named: Speaker) -> Speaker {
        match self.tx {
            Speaker::Host => named,
            Speaker::Arm => opposite(named),
        }
    }
}

fn opposite(speaker: Speaker) -> Speaker {
    match speaker {
        Speaker::Host => Speaker::Arm,
        Speaker::Arm => Speaker::Host,
    }
}

/// A decoder for each stream.
pub(super) struct Sides {
    line: Line,
    /// By device. A recording of one line has one.
    devices: BTreeMap<Option<(u16, u16)>, Device>,
    /// The sender of the last bytes with a mark.
    last: Option<Speaker>,
    is_contradicted: bool,
    /// All frames of a side are those of the other one.
    is_turned: bool,
}

/// The streams of a device or of a line.
#[derive(Default)]
struct Device {
    /// The items before its first frame; `None` if they are shown.
    held: Option<Held>,
    /// By endpoint and sender.
    streams: BTreeMap<(u8, Side), Box<dyn Recording>>,
    beginning: Beginning,
}

/// The first bytes of a device.
#[derive(Default)]
struct Beginning {
    bytes: Vec<u8>,
    /// Endpoint, sender by the mark, and length of each part.
    parts: Vec<(u8, Option<Speaker>, usize)>,
}

impl Beginning {
    fn keep(&mut self, endpoint: u8, from: Option<Speaker>, bytes: &[u8]) {
        let bytes = &bytes[..bytes.len().min(MAX_KEPT - self.bytes.len())];
        self.bytes.extend(bytes);
        match self.parts.last_mut() {
            _ if bytes.is_empty() => {}
            Some((there, last, len)) if (*there, *last) == (endpoint, from) => *len += bytes.len(),
            _ => self.parts.push((endpoint, from, bytes.len())),
        }
    }

    /// Returns true if most of the bytes are frames of this line's arm.
    fn is_of(&self, line: Line) -> bool {
        let mut sides = Sides::new(line);
        let mut rest = &self.bytes[..];
        for (endpoint, from, len) in &self.parts {
            let (bytes, behind) = rest.split_at(*len);
            rest = behind;
            // One wire of the servo bus has both directions.
            let from = from.filter(|_| line.arm != ArmKind::Alpha1Servo);
            sides.push(None, *endpoint, from, bytes, At::OFFSET, &Nowhere);
        }
        let counts = sides.finish(&Nowhere);
        let known = 2 * counts.bytes.saturating_sub(counts.noise_bytes);
        counts.frames > counts.unknown && known > self.bytes.len() as u64
    }
}

/// Frames of another arm than the chosen one.
pub(super) struct Other {
    /// `None` for a recording of one line.
    pub(super) device: Option<(u16, u16)>,
    pub(super) arm: ArmKind,
    /// The sender, if it must be given.
    pub(super) from: Option<Speaker>,
}

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Side {
    Unnamed,
    ToArm,
    FromArm,
}

impl Side {
    fn of(from: Option<Speaker>) -> Self {
        match from {
            None => Self::Unnamed,
            Some(Speaker::Host) => Self::ToArm,
            Some(Speaker::Arm) => Self::FromArm,
        }
    }
}

impl Sides {
    pub(super) fn new(line: Line) -> Self {
        Self {
            line,
            devices: BTreeMap::new(),
            last: None,
            is_contradicted: false,
            is_turned: false,
        }
    }

    /// Takes the next bytes, in pieces of any size. A broken stream ends. The error is the reason why they are not
    /// understood.
    pub(super) fn take(&mut self, bytes: &Bytes<'_>, out: &dyn Output) -> Result<(), Doubt> {
        let Bytes {
            hint,
            bytes,
            nanos,
            transfer,
            ..
        } = bytes;
        let nanos = *nanos;
        let device = transfer.as_ref().map(|transfer| transfer.device);
        if self.devices.len() >= MAX_DEVICES && !self.devices.contains_key(&device) {
            return Err("more than 64 USB devices".into());
        }
        let from = self.marked(*hint);
        let (endpoint, place) = match transfer {
            Some(Transfer { endpoint, place, .. }) => (*endpoint, &place[..]),
            // The offset in the stream.
            None => (0, ""),
        };
        let at = At { place, nanos };
        self.push(device, endpoint, from, bytes, at, out);
        if let Some(device) = self.devices.get_mut(&device) {
            device.beginning.keep(endpoint, from, bytes);
        }
        Ok(())
    }

    /// Passes bytes to the decoder of their stream.
    fn push(
        &mut self,
        device: Option<(u16, u16)>,
        endpoint: u8,
        from: Option<Speaker>,
        bytes: &[u8],
        at: At<'_>,
        out: &dyn Output,
    ) {
        // Marks that are wrong for all frames of one side are so for the side that begins behind them.
        let turned = from.filter(|_| self.is_turned && device.is_none());
        let line = Line {
            from: self.line.from.or(turned.map(opposite)),
            ..self.line
        };
        let is_usb = device.is_some();
        let device = self.devices.entry(device).or_insert_with(|| Device {
            held: is_usb.then(Held::default),
            ..Device::default()
        });
        let side = Side::of(from);
        if !device.streams.contains_key(&(endpoint, side)) {
            let mut stream = decoder(line, from);
            let opposite = from.map(|from| Side::of(Some(opposite(from))));
            for (_, other) in device
                .streams
                .iter_mut()
                .filter(|((_, there), _)| Some(*there) == opposite)
            {
                other.trust_mark();
                stream.trust_mark();
            }
            device.streams.insert((endpoint, side), stream);
        }
        let Some(stream) = device.streams.get_mut(&(endpoint, side)) else {
            return;
        };
        match &device.held {
            None => stream.push(bytes, at, out),
            Some(held) => stream.push(bytes, at, held),
        }
        let is_contradicted = from.is_some() && !self.is_contradicted && stream.is_contradicted();
        let has_frames = device.held.is_some() && stream.has_frames();
        if let Some(held) = device.held.take_if(|_| has_frames) {
            held.show(out);
        }
        if is_contradicted {
            self.is_contradicted = true;
            self.is_turned = stream.is_turned();
            out.remark(format_args!(
                "The marks of direction contradict the frames, which are shown by their content: --tx turns the marks \
                 round, --from replaces them"
            ));
        }
    }

    /// The sender of bytes by their mark. The order of requests and answers tells them apart on the servo bus.
    fn marked(&mut self, hint: Hint) -> Option<Speaker> {
        let named = match hint {
            _ if self.line.arm == ArmKind::Alpha1Servo => None,
            Hint::None => None,
            Hint::From(named) => Some(self.line.sender(named)),
            // Only bytes that complete a frame are a continuation.
            Hint::Continued => self.last.filter(|last| self.is_inside_frame(*last)),
        };
        if hint != Hint::Continued {
            self.last = named;
        }
        named
    }

    /// Returns true if the bytes of this sender end inside a frame.
    fn is_inside_frame(&self, from: Speaker) -> bool {
        let streams = self.devices.get(&None).map(|device| &device.streams);
        let stream = streams.and_then(|streams| streams.get(&(0, Side::of(Some(from)))));
        stream.is_some_and(|stream| stream.is_inside_frame())
    }

    /// Ends the recording. Returns the counts of all streams.
    pub(super) fn finish(&mut self, out: &dyn Output) -> Counts {
        let mut sum = Counts::default();
        let is_broken = self.broken().is_some();
        for (name, device) in &mut self.devices {
            let mut counts = Counts::default();
            for stream in device.streams.values_mut() {
                counts = counts.with(match &device.held {
                    None => stream.finish(out),
                    Some(held) => stream.finish(held),
                });
            }
            if let Some(held) = device.held.take_if(|_| counts.frames > 0) {
                held.show(out);
            }
            // The break may be that of the arm, or the device is none.
            let breaks = device.streams.values().filter_map(|stream| stream.broken());
            for (offset, reason) in breaks.filter(|_| device.held.is_some()) {
                let (bus, address) = name.unwrap_or_default();
                sum.broken_streams += 1;
                out.remark(format_args!(
                    "broken stream: USB device {bus}.{address}, byte {offset}: {reason}"
                ));
            }
            sum = sum.with(match device.held {
                None => counts,
                Some(_) => counts.of_another_device(),
            });
        }
        // How much was read behind the break of the only stream depends on the size of reads.
        if is_broken {
            sum.behind_break = 0;
        }
        sum
    }

    /// The devices, or the line, most of whose first bytes are frames of another arm than the chosen one.
    pub(super) fn others(&self) -> impl Iterator<Item = Other> {
        const HOST: Option<Speaker> = Some(Speaker::Host);
        const ARMS: [(ArmKind, Option<Speaker>); 6] = [
            (ArmKind::Ling, None),
            (ArmKind::Xarm, None),
            (ArmKind::Xarm, HOST),
            (ArmKind::Alpha1, None),
            (ArmKind::Alpha1, HOST),
            (ArmKind::Alpha1Servo, None),
        ];
        self.devices.iter().filter_map(|(device, Device { beginning, .. })| {
            if beginning.is_of(self.line) {
                return None;
            }
            let is_other = |(arm, from): &(ArmKind, Option<Speaker>)| *arm != self.line.arm || from.is_some();
            let mut others = ARMS.into_iter().filter(is_other);
            let (arm, from) = others.find(|&(arm, from)| beginning.is_of(Line { arm, from, ..self.line }))?;
            let device = *device;
            Some(Other { device, arm, from })
        })
    }

    /// Offset and reason of the break of the only stream, after which nothing can be decoded. Beside others the
    /// bytes behind a break are counted.
    pub(super) fn broken(&self) -> Option<(u64, Reason)> {
        let device = self.devices.get(&None)?;
        device.streams.get(&(0, Side::Unnamed))?.broken()
    }
}

/// The decoder of bytes that a mark says to be those of `from`.
fn decoder(line: Line, from: Option<Speaker>) -> Box<dyn Recording> {
    let sender = match (line.from, from) {
        (Some(from), _) => Sender::Known(from),
        (None, Some(from)) => Sender::Marked(from),
        (None, None) => Sender::Unknown,
    };
    match line.arm {
        ArmKind::Ling => Generation::recording(sender),
        ArmKind::LingLegacy => Box::new(Frames::<Legacy>::new(sender)),
        ArmKind::Xarm => match sender {
            Sender::Known(_) => Box::new(Frames::<XArm>::new(sender)),
            _ => OfEither::<XArm>::recording(sender, |speaker| Box::new(Frames::of(XArmLine::new(speaker)))),
        },
        ArmKind::Alpha1 => match sender {
            Sender::Known(_) => alpha1(sender),
            Sender::Marked(_) => OfEither::<Alpha1>::recording(sender, |speaker| alpha1(Sender::Known(speaker))),
            Sender::Unknown => alpha1(Sender::Known(Speaker::Arm)),
        },
        ArmKind::Alpha1Servo => Box::new(Frames::of(ServoBus::default())),
    }
}

fn alpha1(sender: Sender) -> Box<dyn Recording> {
    Box::new(Frames::<Alpha1>::new(sender))
}

/// An output that keeps nothing.
struct Nowhere;

impl Output for Nowhere {
    fn item(&self, _: &Item<'_>) {}

    fn remark(&self, _: Arguments<'_>) {}
}

/// The items of a device without a frame so far, which may be no arm, and the number of those that are not kept.
#[derive(Default)]
struct Held(RefCell<(Vec<Entry>, usize)>);

/// An item, or a remark.
struct Entry {
    place: String,
    bytes: Vec<u8>,
    text: String,
    on_line: Option<OnLine>,
}

impl Held {
    fn push(&self, entry: Entry) {
        let (entries, dropped) = &mut *self.0.borrow_mut();
        match entries.len() < MAX_HELD {
            true => entries.push(entry),
            false => *dropped += 1,
        }
    }

    fn show(self, out: &dyn Output) {
        let (entries, dropped) = self.0.into_inner();
        if dropped > 0 {
            out.remark(format_args!("not shown before the first frame of a device: {dropped}"));
        }
        for Entry {
            place,
            bytes,
            text,
            on_line,
        } in entries
        {
            match place.is_empty() {
                true => out.remark(format_args!("{text}")),
                false => out.item(&Item {
                    place: format_args!("{place}"),
                    bytes: &bytes,
                    text: &text,
                    on_line,
                }),
            }
        }
    }
}

impl Output for Held {
    fn item(&self, item: &Item<'_>) {
        self.push(Entry {
            place: item.place.to_string(),
            bytes: item.bytes.to_vec(),
            text: item.text.to_owned(),
            on_line: item.on_line,
        });
    }

    fn remark(&self, text: Arguments<'_>) {
        self.push(Entry {
            place: String::new(),
            bytes: Vec::new(),
            text: text.to_string(),
            on_line: None,
        });
    }
}
