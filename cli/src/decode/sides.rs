//! The directions of a line in a recording.

use armwire::alpha1::Alpha1;
use armwire::framing::Reason;
use armwire::ling::legacy::Legacy;
use armwire::xarm::XArm;

use super::output::Output;
use super::recording::{Counts, Frames, LingFrames, Recording};
use super::servo_bus::ServoBus;
use crate::args::{ArmKind, Speaker};
use crate::error::Error;

/// A decoder for each direction that the recording names, and one for bytes without a direction.
pub(super) struct Sides {
    arm: ArmKind,
    unnamed: Option<Box<dyn Recording>>,
    to_arm: Option<Box<dyn Recording>>,
    from_arm: Option<Box<dyn Recording>>,
    from: Option<Speaker>,
}

impl Sides {
    /// The decoders of an arm. Bytes without a direction are those of `from`.
    pub(super) fn new(arm: ArmKind, from: Option<Speaker>) -> Result<Self, Error> {
        if let (ArmKind::Alpha1Servo, Some(_)) = (arm, from) {
            let reason = "--from does not apply to alpha1-servo: one wire has both directions";
            return Err(Error::Usage(reason.to_owned()));
        }
        Ok(Self {
            arm,
            unnamed: None,
            to_arm: None,
            from_arm: None,
            from,
        })
    }

    /// Takes the next bytes, in pieces of any size.
    pub(super) fn push(&mut self, from: Option<Speaker>, bytes: &[u8], out: &dyn Output) {
        let arm = self.arm;
        // The order of requests and answers tells them apart on the servo bus.
        let (side, from) = match from.filter(|_| arm != ArmKind::Alpha1Servo) {
            None => (&mut self.unnamed, self.from),
            Some(Speaker::Host) => (&mut self.to_arm, from),
            Some(Speaker::Arm) => (&mut self.from_arm, from),
        };
        side.get_or_insert_with(|| recording(arm, from)).push(bytes, out);
    }

    /// Ends the recording. Returns the counts of all directions.
    pub(super) fn finish(&mut self, out: &dyn Output) -> Counts {
        let sides = [&mut self.unnamed, &mut self.to_arm, &mut self.from_arm];
        let counts = sides.into_iter().flatten().map(|side| side.finish(out));
        counts.fold(Counts::default(), Counts::with)
    }

    /// Offset and reason of the break of a lossless stream, after which nothing can be decoded.
    pub(super) fn broken(&self) -> Option<(u64, Reason)> {
        let sides = [&self.unnamed, &self.to_arm, &self.from_arm];
        sides.into_iter().flatten().find_map(|side| side.broken())
    }
}

fn recording(arm: ArmKind, from: Option<Speaker>) -> Box<dyn Recording> {
    match arm {
        ArmKind::Ling => Box::new(LingFrames::new(from)),
        ArmKind::LingLegacy => Box::new(Frames::<Legacy>::new(from)),
        ArmKind::Xarm => Box::new(Frames::<XArm>::new(from.or(Some(Speaker::Arm)))),
        ArmKind::Alpha1 => Box::new(Frames::<Alpha1>::new(from.or(Some(Speaker::Arm)))),
        ArmKind::Alpha1Servo => Box::new(Frames::of(ServoBus::default())),
    }
}
