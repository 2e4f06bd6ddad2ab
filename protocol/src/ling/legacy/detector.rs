//! Detection of arms of the older generation.

use core::fmt;

use super::{BAUD_RATES, Legacy, MAX_FRAME};
use crate::decoder::{Decoder, Kind};
use crate::messages::Messages;

/// Number of frames that make a detection while the arm transmits.
///
/// Random bytes form a joint or gripper frame at a given place with probability 2⁻³⁸; two do not occur.
const REQUIRED_FRAMES: u8 = 2;

/// The detection of an arm of the older generation, with a text for the user of the arm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct OlderGeneration;

impl fmt::Display for OlderGeneration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [usual, other] = BAUD_RATES;
        write!(
            f,
            "a Ling arm of the older generation (firmware from before late 2025, {usual} or {other} baud). armwire reads \
             its joints and sends nothing to it. All other functions need a firmware update from the vendor."
        )
    }
}

impl core::error::Error for OlderGeneration {}

/// Detects an arm of the older generation from its bytes.
///
/// A detection takes two joint or gripper frames, whatever is between them: damaged frames, frames of other kinds, noise.
/// It depends on the bytes, not on time: the size of chunks has no effect. A detection is permanent.
///
/// For a recording without a frame of the current generation, [`finish`](Self::finish) detects by one frame.
///
/// ```
/// use armwire::ling::legacy::{Detector, OlderGeneration};
///
/// let joints = [
///     0xAA, 0x14, 0x12, 0xA9, 0x07, 0xA9, 0x07, 0xE6, 0x0C, 0x19, 0x03, 0x6D, 0x06, 0x92, 0x09, 0x2F, 0x07, 0xED,
///     0x04, 0x81, 0x08, 0x00, 0xFF,
/// ];
/// let mut detector = Detector::new();
/// assert_eq!(detector.push(&joints), None);
/// assert_eq!(detector.push(&joints), Some(OlderGeneration));
/// ```
#[derive(Debug, Default)]
pub struct Detector {
    decoder: Decoder<Legacy, MAX_FRAME>,
    /// Number of frames, up to [`REQUIRED_FRAMES`].
    frames: u8,
}

impl Detector {
    /// A detector without received bytes.
    pub const fn new() -> Self {
        Self {
            decoder: Decoder::new(),
            frames: 0,
        }
    }

    /// Processes the next bytes from the arm. Returns the detection, also if it was made earlier.
    pub fn push(&mut self, mut bytes: &[u8]) -> Option<OlderGeneration> {
        loop {
            self.count_frames();
            if self.frames >= REQUIRED_FRAMES {
                return Some(OlderGeneration);
            }
            if bytes.is_empty() {
                return None;
            }
            bytes = self.decoder.push(bytes);
        }
    }

    /// Ends a recording that has no frame of the current generation: one joint or gripper frame is enough. An incomplete
    /// frame at the end is discarded.
    ///
    /// Do not use it while an arm may still transmit: [`push`](Self::push) needs two frames.
    ///
    /// ```
    /// use armwire::ling::legacy::{Detector, OlderGeneration};
    ///
    /// let gripper = [0xAA, 0x12, 0x07, 0x01, 0x03, 0x08, 0xFF, 0x08, 0x00, 0x01, 0x00, 0xFF];
    /// let mut detector = Detector::new();
    /// assert_eq!(detector.push(&gripper), None);
    /// assert_eq!(detector.finish(), Some(OlderGeneration));
    /// ```
    pub fn finish(&mut self) -> Option<OlderGeneration> {
        self.decoder.idle();
        self.count_frames();
        (self.frames > 0).then_some(OlderGeneration)
    }

    /// Counts the frames in the decoder, up to [`REQUIRED_FRAMES`].
    fn count_frames(&mut self) {
        while self.frames < REQUIRED_FRAMES
            && let Some(item) = self.decoder.next(&Legacy, ())
        {
            if item.kind == Kind::Frame && Legacy.parse_response(item.bytes, ()).is_ok() {
                self.frames += 1;
            }
        }
    }
}
