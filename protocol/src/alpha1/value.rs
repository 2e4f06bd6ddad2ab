//! The values in Alpha1 messages: raw bytes on the wire, degrees and durations in the API.

use core::fmt;
use core::str;
use core::time::Duration;

use crate::OutOfRange;
use crate::error::at_most;

/// The maximum length of a version or a name, in bytes: the count byte includes itself.
pub const MAX_TEXT: usize = u8::MAX as usize - 1;

/// Number of servos in an action (row FB). An Alpha1 has [fewer](INSTALLED), and the servo states (row EF) have more.
pub const SERVOS: usize = 20;

/// Number of servos in an Alpha1.
pub const INSTALLED: usize = 16;

/// The oldest firmware with this protocol, in the format of [`FirmwareVersion`](super::FirmwareVersion).
///
/// The English print of the document has 201512159, with a digit missing.
pub const OLDEST_FIRMWARE: [u8; 10] = *b"2015121519";

/// The unit of all durations on the wire, in milliseconds.
const UNIT_MILLIS: u64 = 20;

/// The angle of a servo: `0..=240` whole degrees.
///
/// The document gives no range; 240° is the servo's range, and an Alpha1 stays within 180°. Any byte from the wire is
/// accepted except FF, which is not an angle: 241 to 254 are kept, and have no [`degrees`](Self::degrees).
///
/// ```
/// use armwire::alpha1::Angle;
///
/// assert_eq!(Angle::new(90)?.degrees(), Some(90));
/// let error = Angle::new(241).unwrap_err();
/// assert_eq!(error.to_string(), "servo angle is 241 degrees, must be 0..=240");
/// # Ok::<(), armwire::OutOfRange>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct Angle(
    #[cfg_attr(fuzzing, arbitrary(with = |u: &mut arbitrary::Unstructured<'_>| u.int_in_range(0..=Self::MAX.0)))] u8,
);

impl Angle {
    /// The servo's maximum.
    pub const MAX: Self = Self(240);

    /// An angle in degrees.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] over 240.
    pub const fn new(degrees: u8) -> Result<Self, OutOfRange> {
        if degrees <= Self::MAX.0 {
            return Ok(Self(degrees));
        }
        Err(OutOfRange::new(
            "servo angle",
            "degrees",
            degrees as u16,
            0,
            Self::MAX.0 as u16,
        ))
    }

    /// The angle in degrees; `None` if it came from the wire and is over 240.
    pub const fn degrees(self) -> Option<u8> {
        if self.0 <= Self::MAX.0 { Some(self.0) } else { None }
    }

    /// The byte on the wire, never FF.
    pub const fn raw(self) -> u8 {
        self.0
    }

    /// FF is not an angle: in an action it leaves the servo unchanged, in a move it releases the servo.
    pub(super) const fn from_wire(byte: u8) -> Option<Self> {
        if byte == u8::MAX { None } else { Some(Self(byte)) }
    }
}

/// Duration of a servo's move: 0 to 5.1 s in steps of 20 ms.
///
/// ```
/// use core::time::Duration;
/// use armwire::alpha1::MoveTime;
///
/// let time = MoveTime::from_duration(Duration::from_millis(509))?; // to the nearest step
/// assert_eq!((time.units(), time.duration()), (25, Duration::from_millis(500)));
/// let error = MoveTime::from_duration(Duration::from_secs(6)).unwrap_err();
/// assert_eq!(error.to_string(), "move time is 6 s, must be 0..=5.1");
/// # Ok::<(), armwire::OutOfRange<f32>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct MoveTime(u8);

impl MoveTime {
    /// 5.1 s.
    pub const MAX: Self = Self(u8::MAX);

    /// A time in units of 20 ms.
    pub const fn new(units: u8) -> Self {
        Self(units)
    }

    /// The time nearest to a duration.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`], in seconds, over 5.1 s.
    pub fn from_duration(duration: Duration) -> Result<Self, OutOfRange<f32>> {
        nearest("move time", duration, Self::MAX.duration()).map(|units| Self(units as u8))
    }

    /// Units of 20 ms.
    pub const fn units(self) -> u8 {
        self.0
    }

    /// The time as a duration.
    pub const fn duration(self) -> Duration {
        Duration::from_millis(self.0 as u64 * UNIT_MILLIS)
    }
}

/// The time from one frame of an action to the next, or the completion time of a servo's move: 0 to 1310.7 s in steps
/// of 20 ms.
///
/// ```
/// use core::time::Duration;
/// use armwire::alpha1::Interval;
///
/// let interval = Interval::from_duration(Duration::from_secs(60))?;
/// assert_eq!(interval.units(), 3000);
/// let error = Interval::from_duration(Duration::from_secs(3600)).unwrap_err();
/// assert_eq!(error.to_string(), "interval is 3600 s, must be 0..=1310.7");
/// # Ok::<(), armwire::OutOfRange<f32>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct Interval(u16);

impl Interval {
    /// 1310.7 s.
    pub const MAX: Self = Self(u16::MAX);

    /// An interval in units of 20 ms.
    pub const fn new(units: u16) -> Self {
        Self(units)
    }

    /// The interval nearest to a duration.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`], in seconds, over 1310.7 s.
    pub fn from_duration(duration: Duration) -> Result<Self, OutOfRange<f32>> {
        nearest("interval", duration, Self::MAX.duration()).map(Self)
    }

    /// Units of 20 ms.
    pub const fn units(self) -> u16 {
        self.0
    }

    /// The interval as a duration.
    pub const fn duration(self) -> Duration {
        Duration::from_millis(self.0 as u64 * UNIT_MILLIS)
    }
}

/// The number of units nearest to a duration that is not over `max`, which is at most 65535 units.
fn nearest(what: &'static str, duration: Duration, max: Duration) -> Result<u16, OutOfRange<f32>> {
    if duration > max {
        let (got, max) = (duration.as_secs_f32(), max.as_secs_f32());
        return Err(OutOfRange::new(what, "s", got, 0.0, max));
    }
    let unit = UNIT_MILLIS * 1_000;
    let micros = duration.as_secs() * 1_000_000 + u64::from(duration.subsec_micros());
    Ok(((micros + unit / 2) / unit) as u16)
}

/// The id of a servo on the bus, `1..=240`.
///
/// Id 0 addresses all servos, see [`Address`]. Only moves, releases and LED settings accept it. The servo manual forbids
/// it for reading the version and does not mention it for the other commands: all servos would answer together, and all
/// would have the same id after a change of id. Such requests are neither sent nor accepted.
///
/// ```
/// use armwire::alpha1::ServoId;
///
/// assert_eq!(ServoId::new(16)?.get(), 16);
/// let error = ServoId::new(0).unwrap_err();
/// assert_eq!(error.to_string(), "servo id is 0, must be 1..=240");
/// # Ok::<(), armwire::OutOfRange>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct ServoId(
    #[cfg_attr(fuzzing, arbitrary(with = |u: &mut arbitrary::Unstructured<'_>| u.int_in_range(1..=Self::MAX.0)))] u8,
);

impl ServoId {
    /// The highest id.
    pub const MAX: Self = Self(240);

    /// A servo's id.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] for 0 and over 240.
    pub const fn new(id: u8) -> Result<Self, OutOfRange> {
        if 1 <= id && id <= Self::MAX.0 {
            return Ok(Self(id));
        }
        Err(OutOfRange::new("servo id", "", id as u16, 1, Self::MAX.0 as u16))
    }

    /// The number.
    pub const fn get(self) -> u8 {
        self.0
    }
}

/// The target of a move, a release or an LED setting: one servo, or all of them. A request to all is not answered. All
/// other requests address one [`ServoId`].
///
/// ```
/// use armwire::alpha1::{Address, ServoId};
///
/// assert_eq!(Address::One(ServoId::new(3)?).id(), 3);
/// assert_eq!(Address::All.id(), 0);
/// # Ok::<(), armwire::OutOfRange>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub enum Address {
    /// Every servo on the bus.
    All,
    /// One servo.
    One(ServoId),
}

impl Address {
    /// The id on the wire, 0 for all.
    pub const fn id(self) -> u8 {
        match self {
            Self::All => 0,
            Self::One(servo) => servo.get(),
        }
    }

    pub(super) fn from_wire(id: u8) -> Result<Self, OutOfRange> {
        match id {
            0 => Ok(Self::All),
            _ => ServoId::new(id).map(Self::One),
        }
    }
}

/// A servo's zero offset: `-90..=90` thirds of a degree, -30° to 30°.
///
/// ```
/// use armwire::alpha1::Offset;
///
/// assert_eq!(Offset::new(-9)?.degrees(), -3.0);
/// let error = Offset::new(91).unwrap_err();
/// assert_eq!(error.to_string(), "servo offset is 91 thirds of a degree, must be -90..=90");
/// # Ok::<(), armwire::OutOfRange<i16>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct Offset(
    #[cfg_attr(fuzzing, arbitrary(with = |u: &mut arbitrary::Unstructured<'_>| u.int_in_range(-90..=90)))] i16,
);

impl Offset {
    /// -30°.
    pub const MIN: Self = Self(-90);
    /// 30°.
    pub const MAX: Self = Self(90);

    /// An offset in thirds of a degree.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] under -90 and over 90.
    pub const fn new(thirds: i16) -> Result<Self, OutOfRange<i16>> {
        if Self::MIN.0 <= thirds && thirds <= Self::MAX.0 {
            return Ok(Self(thirds));
        }
        Err(OutOfRange::new(
            "servo offset",
            "thirds of a degree",
            thirds,
            Self::MIN.0,
            Self::MAX.0,
        ))
    }

    /// Thirds of a degree, `-90..=90`.
    pub const fn thirds(self) -> i16 {
        self.0
    }

    /// Degrees, `-30.0..=30.0`.
    pub const fn degrees(self) -> f32 {
        self.0 as f32 / 3.0
    }
}

/// The setting of a servo's LED, as the byte on the wire.
///
/// The sources contradict each other: in the servos' manual 0 is off and 1 blinks; public programs for the same servos
/// send 0 for on and 1 for off. The byte is therefore not interpreted.
///
/// ```
/// assert_eq!(armwire::alpha1::Led(1).0, 1);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct Led(pub u8);

/// A version or the name of an action: 0 to 254 bytes. Their character set is not documented; names may be GBK.
///
/// ```
/// use armwire::alpha1::Text;
///
/// let name = Text::new(b"dance")?;
/// assert_eq!((name.as_bytes(), name.as_str()), (&b"dance"[..], Some("dance")));
/// assert_eq!(Text::new(b"\x1b[2J")?.to_string(), "\\x1b[2J");
/// let error = Text::new(&[b'a'; 255]).unwrap_err();
/// assert_eq!(error.to_string(), "text length is 255 bytes, must be 0..=254");
/// # Ok::<(), armwire::OutOfRange>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct Text<'a>(
    #[cfg_attr(fuzzing, arbitrary(with = |u: &mut _| crate::fuzzing::bytes(u, 0..=MAX_TEXT)))] &'a [u8],
);

impl<'a> Text<'a> {
    /// A text of these bytes.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] over 254 bytes.
    pub fn new(text: &'a [u8]) -> Result<Self, OutOfRange> {
        at_most("text length", "bytes", text.len(), MAX_TEXT as u16)?;
        Ok(Self(text))
    }

    /// The bytes.
    pub const fn as_bytes(self) -> &'a [u8] {
        self.0
    }

    /// The text, or `None` if one of its bytes is not printable ASCII.
    pub fn as_str(self) -> Option<&'a str> {
        let printable = self.0.iter().all(|byte| matches!(byte, b' '..=b'~'));
        str::from_utf8(self.0).ok().filter(|_| printable)
    }
}

/// Non-printable bytes are escaped, because they come from the line.
impl fmt::Display for Text<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.0.escape_ascii())
    }
}

/// The servo states, as the four bytes on the wire (row EF). A servo is either running, or powered off and free to turn
/// by hand. A servo that the robot does not have is not running either: an Alpha1 has the first [`INSTALLED`] of the 32.
///
/// The document defines the least significant bit as servo 1, but not the order of the bytes. All other numbers of this
/// family are big-endian, and the methods assume the same: servo 1 is bit 0 of the last byte.
///
/// ```
/// use armwire::alpha1::ServoStates;
///
/// let states = ServoStates([0x00, 0x00, 0x80, 0x05]);
/// assert!(states.running().eq([1, 3, 16]));
/// assert_eq!(ServoStates::from_bits(0x8005), states);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct ServoStates(pub [u8; 4]);

impl ServoStates {
    /// The states from a mask, servo 1 lowest.
    pub const fn from_bits(bits: u32) -> Self {
        Self(bits.to_be_bytes())
    }

    /// The mask, servo 1 lowest.
    pub const fn bits(self) -> u32 {
        u32::from_be_bytes(self.0)
    }

    /// The numbers, from 1, of the running servos.
    pub fn running(self) -> impl Iterator<Item = u8> {
        (1..=32).filter(move |servo| self.bits() >> (servo - 1) & 1 == 1)
    }
}

/// The angles of a servo, in degrees.
///
/// ```
/// let angles = armwire::alpha1::ServoAngles { target: 91, actual: 90 };
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ServoAngles {
    /// The target.
    pub target: u16,
    /// The actual angle.
    pub actual: u16,
}

/// The result of a request to the robot or a servo.
///
/// ```
/// assert!(armwire::alpha1::Outcome::Success.is_success());
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[must_use]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub enum Outcome {
    /// AA: success.
    Success = 0xAA,
    /// EE: failure, without a reason.
    Failure = 0xEE,
}

impl Outcome {
    /// Returns true for success.
    ///
    /// ```
    /// use armwire::alpha1::Outcome;
    ///
    /// assert!(Outcome::Success.is_success() && !Outcome::Failure.is_success());
    /// ```
    pub const fn is_success(self) -> bool {
        matches!(self, Self::Success)
    }

    pub(super) const fn from_wire(byte: u8) -> Option<Self> {
        match byte {
            0xAA => Some(Self::Success),
            0xEE => Some(Self::Failure),
            _ => None,
        }
    }
}

/// The state of the servo offset tool (row F4).
///
/// ```
/// # use armwire::alpha1::{OffsetTool, Request};
/// let request = Request::SetOffsetTool(OffsetTool::Connect);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub enum OffsetTool {
    /// Bluetooth is available.
    Disconnect = 0x00,
    /// Bluetooth is not available.
    Connect = 0x01,
}

/// The robot's USB device type (row F9). The vendor recommends HID for this protocol.
///
/// ```
/// # use armwire::alpha1::{Request, UsbType};
/// let request = Request::SetUsbType(UsbType::Hid);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub enum UsbType {
    /// A disk: **this protocol is no longer available.**
    Disk = 0x01,
    /// A virtual serial port.
    SerialPort = 0x02,
    /// A HID device with reports of 64 bytes.
    Hid = 0x03,
}
