//! The account of a recording: what became of each unit of it, and the sum.

use clap::ValueEnum;

use super::bus::Buses;
use super::doubts::{Doubt, Doubts, Place};
use super::format::Format;
use super::framed::Framed;
use super::output::Output;
use super::sides::{Line, Other, Sides};
use super::sum::Part;
use super::unit::{Read, Unit};
use crate::args::ArmKind;
use crate::error::Error;
use crate::hex;

/// The owner of all units of a recording. It hands their data on, counts the others, and prints the sum.
pub(super) struct Account<'a> {
    out: &'a dyn Output,
    line: Line,
    format: Format,
    sides: Sides,
    buses: Buses,
    frames: Framed,
    /// Number of units with data, and of comments.
    data: u64,
    comments: u64,
    /// Counts of other records, in the order of the first of each kind.
    others: Vec<(&'static str, u64)>,
    dropped: u64,
    doubts: Doubts,
}

impl<'a> Account<'a> {
    pub(super) fn new(format: Format, line: Line, out: &'a dyn Output) -> Result<Self, Error> {
        if let (ArmKind::Alpha1Servo, Some(_)) = (line.arm, line.from) {
            let reason = "--from does not apply to alpha1-servo: one wire has both directions";
            return Err(Error::Usage(reason.to_owned()));
        }
        if line.arm == ArmKind::Xarm && format.is_of_bus() {
            return Err(Error::Usage("an xarm is not on a CAN bus".to_owned()));
        }
        Ok(Self {
            out,
            line,
            format,
            sides: Sides::new(line),
            buses: Buses::new(line.arm),
            frames: Framed::default(),
            data: 0,
            comments: 0,
            others: Vec::new(),
            dropped: 0,
            doubts: Doubts::default(),
        })
    }

    /// Takes the next unit.
    pub(super) fn take(&mut self, place: Place<'_>, read: Read<'_>) {
        let taken = match &read {
            Ok(unit) => self.take_unit(place, unit),
            Err(_) => Ok(()),
        };
        if let Some(doubt) = read.err().or(taken.err()) {
            self.doubts.add(place, &doubt, self.out);
        }
    }

    /// Takes a unit that its reader understood. The error is the reason why its data are not.
    fn take_unit(&mut self, place: Place<'_>, unit: &Unit<'_>) -> Result<(), Doubt> {
        match unit {
            Unit::Can(logged) => {
                self.buses.take(logged, self.out)?;
                self.data += 1;
            }
            Unit::Bytes(bytes) => {
                if let Some(doubt) = &bytes.gap {
                    self.doubts.add(place, doubt, self.out);
                }
                self.sides.take(bytes, self.out)?;
                self.data += 1;
            }
            Unit::Frame(frame) => {
                self.frames.take(frame, self.out);
                self.data += 1;
            }
            Unit::Comment => self.comments += 1,
            Unit::Other(kind) => match self.others.iter_mut().find(|(there, _)| there == kind) {
                Some((_, count)) => *count += 1,
                None => self.others.push((kind, 1)),
            },
            Unit::Dropped(frames) => self.dropped = self.dropped.saturating_add(*frames),
        }
        Ok(())
    }

    /// Returns true behind the break of a stream without losses: nothing can be decoded there.
    pub(super) fn is_broken(&self) -> bool {
        self.sides.broken().is_some()
    }

    /// Ends the recording `name`, which was read with this result, and prints the sum.
    pub(super) fn finish(mut self, name: &str, beginning: &[u8], read: Result<(), Error>) -> Result<Verdict, Error> {
        let line = self.sides.finish(self.out);
        let bus = self.buses.finish(self.out);
        let frames = line.frames + bus.arm_frames + self.frames.frames;
        let of_bus = bus.other_arm.map(|arm| Other {
            device: None,
            arm,
            from: None,
        });
        let others: Vec<_> = self.sides.others().chain(of_bus).collect();
        let mut parts = Vec::new();
        for (is_used, more) in [
            (line.has_bytes() || self.format.is_of_line(), line.parts()),
            (bus.frames > 0 || self.format.is_of_bus(), bus.parts()),
            (
                self.frames.has_bytes() || self.format == Format::Mcap,
                self.frames.parts(),
            ),
        ] {
            parts.extend(more.into_iter().filter(|part| is_used && part.is_shown()));
        }
        let dropped = Some(Part::some("not logged", self.dropped).flaw()).filter(Part::is_shown);
        if parts.is_empty() {
            parts.push(Part::always("packets read", 0));
        }
        // Units before an error have a sum, too.
        if read.is_ok() || self.data > 0 || self.doubts.count() > 0 {
            let others = self.others.iter().map(|(kind, count)| Part::some(kind, *count));
            let mut sum: Vec<_> = parts.iter().map(Part::to_string).collect();
            sum.extend(others.map(|part| part.to_string()));
            sum.extend(dropped.iter().map(Part::to_string));
            sum.extend(self.sides.broken().map(|_| "the rest not read".to_owned()));
            sum.extend(self.doubts.sum());
            self.out.remark(format_args!("{}", sum.join(", ")));
        }
        for Other { device, arm, from } in others {
            let option = arm
                .to_possible_value()
                .map_or(String::new(), |value| value.get_name().to_owned());
            let from = from.map_or("", |_| " --from host");
            let name = arm.name();
            match device {
                None => self
                    .out
                    .remark(format_args!("These are frames of {name}: --arm {option}{from}")),
                Some((bus, address)) => self.out.remark(format_args!(
                    "USB device {bus}.{address} has frames of {name}: --arm {option}{from}"
                )),
            }
        }
        read?;
        if let Some((offset, reason)) = self.sides.broken() {
            let name = name.to_owned();
            return Err(Error::Undecodable { name, offset, reason });
        }
        let mut warnings = Vec::new();
        warnings.extend((frames == 0).then(|| self.no_frame(beginning)));
        warnings.extend((self.doubts.count() > 0).then(|| format!("not understood: {}", self.doubts.count())));
        let flaws = parts
            .iter()
            .chain(&dropped)
            .filter(|part| part.is_flaw && part.count > 0);
        Ok(Verdict {
            warnings,
            flaws: flaws.map(Part::to_string).collect(),
        })
    }

    /// The warning of a recording without a frame: what it looks like.
    fn no_frame(&self, beginning: &[u8]) -> String {
        let arm = match self.format {
            Format::Mcap => "an arm",
            _ => self.line.arm.name(),
        };
        let units = self.data + self.comments + self.dropped + self.doubts.count() + self.others.len() as u64;
        let format = self.format.to_possible_value();
        let format = format.as_ref().map_or("", |value| value.get_name());
        match (units, beginning) {
            (0, _) => format!("no frame of {arm}: the input is empty"),
            (_, []) => format!("no frame of {arm}: the input was read as the format '{format}'"),
            _ => {
                let beginning = hex::show(beginning);
                format!("no frame of {arm}: the input looks like the format '{format}', and begins with {beginning}")
            }
        }
    }
}

/// The faults of a recording, in words.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Verdict {
    /// Those that are printed in any case: parts that are not understood, and the lack of a frame.
    pub(super) warnings: Vec<String>,
    /// Those that only the sum shows: noise, and the like.
    pub(super) flaws: Vec<String>,
}
