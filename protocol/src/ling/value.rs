//! The values in Ling messages: raw counts on the wire, SI units in the API.

use core::f32::consts::TAU;
use core::fmt;
use core::str;

use crate::OutOfRange;
use crate::error::within;

/// Number of joints, without the gripper.
pub const JOINTS: usize = 6;

/// Ticks in one turn of a joint.
pub const TICKS_PER_TURN: u16 = 4096;

/// The data bytes of an Alicia-D's answer with joints: the document's, and one more as in a comment of the vendor's
/// software.
const SHORTEST_JOINTS: u16 = 15;
const LONGEST_JOINTS: u16 = 16;

const CENTRE: f32 = TICKS_PER_TURN as f32 / 2.0;
const TICKS_PER_RADIAN: f32 = TICKS_PER_TURN as f32 / TAU;

/// The integer nearest to `value`, which is not negative.
fn nearest(value: f32) -> u16 {
    (value + 0.5) as u16
}

/// A joint position: `0..=4095` ticks, 2048 at 0 rad, 4096 ticks per turn.
///
/// The document gives only 0° = 0x0800; the scale is that of the vendor's software. Positions therefore range from -π
/// to one tick (0.0015 rad) below +π.
///
/// ```
/// use armwire::ling::Position;
///
/// assert_eq!(Position::from_radians(0.0)?.ticks(), 2048);
/// assert_eq!(Position::new(1024)?.radians(), -core::f32::consts::FRAC_PI_2);
/// assert!(Position::from_radians(core::f32::consts::PI).is_err());
/// # Ok::<(), armwire::OutOfRange<f32>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct Position(
    #[cfg_attr(fuzzing, arbitrary(with = |u: &mut arbitrary::Unstructured<'_>| u.int_in_range(0..=Self::MAX.0)))] u16,
);

impl Position {
    /// The maximum.
    pub const MAX: Self = Self(TICKS_PER_TURN - 1);
    /// 0 rad.
    pub const CENTRE: Self = Self(TICKS_PER_TURN / 2);

    /// A position in ticks.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] over 4095.
    pub const fn new(ticks: u16) -> Result<Self, OutOfRange> {
        if ticks <= Self::MAX.0 {
            return Ok(Self(ticks));
        }
        Err(OutOfRange::new("joint position", "ticks", ticks, 0, Self::MAX.0))
    }

    /// The position nearest to an angle in radians.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] unless the angle is in `-π..=π` less one tick.
    pub fn from_radians(angle: f32) -> Result<Self, OutOfRange<f32>> {
        let angle = within("joint angle", "rad", angle, Self(0).radians(), Self::MAX.radians())?;
        Ok(Self(nearest(angle * TICKS_PER_RADIAN + CENTRE)))
    }

    /// Ticks, `0..=4095`.
    pub const fn ticks(self) -> u16 {
        self.0
    }

    /// The angle in radians, `-π..π`.
    pub const fn radians(self) -> f32 {
        (self.0 as f32 - CENTRE) / TICKS_PER_RADIAN
    }
}

/// The speed of a joint: `0..=5000` ticks per second (section 2.5), which is 0 to 7.67 rad/s.
///
/// The vendor's software sends 50 to 5000 in steps of 50. The effect of less is not documented: an arm that rounds down
/// to its step takes less than 50 for 0. A decoder accepts every value; [`for_move`](Self::for_move) is for the speeds that
/// a person or a program states. A value above 50 is sent as it is, without rounding to a step.
///
/// ```
/// use armwire::ling::Speed;
///
/// let speed = Speed::from_radians_per_second(1.0)?;
/// assert_eq!(speed.ticks_per_second(), 652);
/// assert!((speed.radians_per_second() - 1.0).abs() < 0.001);
/// assert!(Speed::new(5001).is_err());
/// # Ok::<(), armwire::OutOfRange<f32>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct Speed(
    #[cfg_attr(fuzzing, arbitrary(with = |u: &mut arbitrary::Unstructured<'_>| u.int_in_range(0..=Self::MAX.0)))] u16,
);

impl Speed {
    /// The slowest speed that the vendor's software sends.
    pub const SLOWEST: Self = Self(50);
    /// The slowest speed of a force-feedback leader, which its answer to [`ReadMode`](super::Request::ReadMode) shows.
    pub const SLOWEST_OF_FORCE_FEEDBACK: Self = Self(1);
    /// The maximum speed of a joint.
    pub const MAX: Self = Self(5000);

    const TOO_SLOW: &'static str = "joint speed (an arm may take less than 50 ticks/s for 0)";

    /// A speed in ticks per second.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] over 5000.
    pub const fn new(ticks_per_second: u16) -> Result<Self, OutOfRange> {
        if ticks_per_second <= Self::MAX.0 {
            return Ok(Self(ticks_per_second));
        }
        Err(OutOfRange::new(
            "joint speed",
            "ticks/s",
            ticks_per_second,
            0,
            Self::MAX.0,
        ))
    }

    /// The speed nearest to one in radians per second.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] under 0 and over 5000 ticks/s.
    pub fn from_radians_per_second(speed: f32) -> Result<Self, OutOfRange<f32>> {
        let speed = within("joint speed", "rad/s", speed, 0.0, Self::MAX.radians_per_second())?;
        Ok(Self(nearest(speed * TICKS_PER_RADIAN)))
    }

    /// The speed of a joint that is to move, in ticks per second: `50..=5000`.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] under [`SLOWEST`](Self::SLOWEST) and over [`MAX`](Self::MAX).
    ///
    /// ```
    /// use armwire::ling::Speed;
    ///
    /// assert_eq!(Speed::for_move(50), Ok(Speed::SLOWEST));
    /// let error = Speed::for_move(46).unwrap_err();
    /// let text = "joint speed (an arm may take less than 50 ticks/s for 0) is 46 ticks/s, must be 50..=5000";
    /// assert_eq!(error.to_string(), text);
    /// ```
    pub const fn for_move(ticks_per_second: u16) -> Result<Self, OutOfRange> {
        Self::from_slowest(Self::SLOWEST, ticks_per_second)
    }

    /// The speed of a joint that is to move, of an arm with this slowest speed.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] under that speed and over [`MAX`](Self::MAX).
    ///
    /// ```
    /// use armwire::ling::Speed;
    ///
    /// let slowest = Speed::SLOWEST_OF_FORCE_FEEDBACK;
    /// assert_eq!(Speed::from_slowest(slowest, 1), Ok(slowest));
    /// assert!(Speed::from_slowest(slowest, 0).is_err());
    /// ```
    pub const fn from_slowest(slowest: Self, ticks_per_second: u16) -> Result<Self, OutOfRange> {
        let (slowest, max) = (slowest.0, Self::MAX.0);
        if slowest <= ticks_per_second && ticks_per_second <= max {
            return Ok(Self(ticks_per_second));
        }
        let what = if ticks_per_second < slowest {
            Self::too_slow(slowest)
        } else {
            "joint speed"
        };
        Err(OutOfRange::new(what, "ticks/s", ticks_per_second, slowest, max))
    }

    /// The name of a speed that is less than this slowest one.
    const fn too_slow(slowest: u16) -> &'static str {
        match slowest == Self::SLOWEST.0 {
            true => Self::TOO_SLOW,
            false => "joint speed",
        }
    }

    /// The speed of a joint that is to move, nearest to one in radians per second.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] as in [`for_move`](Self::for_move): under 0.0767 and over 7.67 rad/s.
    pub fn for_move_radians_per_second(speed: f32) -> Result<Self, OutOfRange<f32>> {
        Self::from_slowest_radians_per_second(Self::SLOWEST, speed)
    }

    /// The speed of a joint that is to move, nearest to one in radians per second, of an arm with this slowest speed.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] as in [`from_slowest`](Self::from_slowest).
    pub fn from_slowest_radians_per_second(slowest: Self, speed: f32) -> Result<Self, OutOfRange<f32>> {
        let (least, max) = (slowest.radians_per_second(), Self::MAX.radians_per_second());
        let what = match Self::from_radians_per_second(speed) {
            Ok(nearest) if nearest >= slowest => return Ok(nearest),
            Ok(_) => Self::too_slow(slowest.0),
            Err(_) => "joint speed",
        };
        Err(OutOfRange::new(what, "rad/s", speed, least, max))
    }

    /// Ticks per second, `0..=5000`.
    pub const fn ticks_per_second(self) -> u16 {
        self.0
    }

    /// Radians per second.
    pub const fn radians_per_second(self) -> f32 {
        self.0 as f32 / TICKS_PER_RADIAN
    }
}

/// The opening of the gripper: `0..=1000`, 0 closed, 1000 at its full stroke (section 2.5).
///
/// ```
/// use armwire::ling::{Opening, Stroke};
///
/// let half = Opening::from_fraction(0.5)?;
/// assert_eq!(half.per_mille(), 500);
/// assert_eq!(half.millimetres(Stroke::Mm100), 50.0);
/// assert_eq!(Opening::from_millimetres(25.0, Stroke::Mm50)?, half);
/// assert!(Opening::new(1001).is_err());
/// # Ok::<(), armwire::OutOfRange<f32>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct Opening(
    #[cfg_attr(fuzzing, arbitrary(with = |u: &mut arbitrary::Unstructured<'_>| u.int_in_range(0..=Self::OPEN.0)))] u16,
);

impl Opening {
    /// Closed.
    pub const CLOSED: Self = Self(0);
    /// Open to the full stroke.
    pub const OPEN: Self = Self(1000);

    /// An opening in thousandths of the stroke.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] over 1000.
    pub const fn new(per_mille: u16) -> Result<Self, OutOfRange> {
        if per_mille <= Self::OPEN.0 {
            return Ok(Self(per_mille));
        }
        Err(OutOfRange::new("gripper opening", "‰", per_mille, 0, Self::OPEN.0))
    }

    /// The opening nearest to a fraction of the stroke.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] unless it is in `0.0..=1.0`.
    pub fn from_fraction(fraction: f32) -> Result<Self, OutOfRange<f32>> {
        let fraction = within("gripper opening as a fraction", "", fraction, 0.0, 1.0)?;
        Ok(Self(nearest(fraction * f32::from(Self::OPEN.0))))
    }

    /// The opening nearest to a distance in millimetres, for a gripper of this stroke.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] under 0 and over the stroke.
    pub fn from_millimetres(distance: f32, stroke: Stroke) -> Result<Self, OutOfRange<f32>> {
        let full = f32::from(stroke.millimetres());
        let distance = within("gripper opening", "mm", distance, 0.0, full)?;
        Ok(Self(nearest(distance / full * f32::from(Self::OPEN.0))))
    }

    /// Thousandths of the stroke, `0..=1000`.
    pub const fn per_mille(self) -> u16 {
        self.0
    }

    /// Fraction of the stroke, `0.0..=1.0`.
    pub const fn fraction(self) -> f32 {
        self.0 as f32 / Self::OPEN.0 as f32
    }

    /// The distance in millimetres, for a gripper of this stroke.
    pub const fn millimetres(self, stroke: Stroke) -> f32 {
        self.fraction() * stroke.millimetres() as f32
    }
}

/// The stroke of a gripper: one of three types (section 2.3).
///
/// ```
/// assert_eq!(armwire::ling::Stroke::Mm75.millimetres(), 75);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
#[repr(u8)]
pub enum Stroke {
    /// 50 mm.
    Mm50 = 0,
    /// 75 mm.
    Mm75 = 1,
    /// 100 mm.
    Mm100 = 2,
}

impl Stroke {
    /// The stroke in millimetres.
    pub const fn millimetres(self) -> u8 {
        match self {
            Self::Mm50 => 50,
            Self::Mm75 => 75,
            Self::Mm100 => 100,
        }
    }

    pub(super) const fn from_code(code: u8) -> Result<Self, OutOfRange> {
        match code {
            0 => Ok(Self::Mm50),
            1 => Ok(Self::Mm75),
            2 => Ok(Self::Mm100),
            _ => Err(OutOfRange::new("gripper stroke type", "", code as u16, 0, 2)),
        }
    }
}

/// The temperature limit of the overheat protection, `0..=253` or 255 °C; 85 °C from the factory (section 2.5).
///
/// 254 cannot be encoded: on the wire it reads the temperatures.
///
/// ```
/// use armwire::ling::TemperatureLimit;
///
/// assert_eq!(TemperatureLimit::new(100)?.celsius(), 100);
/// assert_eq!(TemperatureLimit::FACTORY.celsius(), 85);
/// let error = TemperatureLimit::new(254).unwrap_err();
/// assert_eq!(error.to_string(), "temperature limit other than 255 is 254 °C, must be 0..=253");
/// # Ok::<(), armwire::OutOfRange<f32>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct TemperatureLimit(
    #[cfg_attr(fuzzing, arbitrary(with = |u: &mut arbitrary::Unstructured<'_>| u.int_in_range(0..=253)))] u8,
);

impl TemperatureLimit {
    /// The limit of a new arm.
    pub const FACTORY: Self = Self(85);

    /// A limit in °C.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] for 254.
    pub const fn new(celsius: u8) -> Result<Self, OutOfRange> {
        if celsius != 254 {
            return Ok(Self(celsius));
        }
        Err(OutOfRange::new(
            "temperature limit other than 255",
            "°C",
            celsius as u16,
            0,
            253,
        ))
    }

    /// The limit in °C.
    pub const fn celsius(self) -> u8 {
        self.0
    }
}

/// The motion status (section 2.5). Undocumented values are kept.
///
/// ```
/// use armwire::ling::MotionStatus;
///
/// assert_eq!(MotionStatus::from(0xE1), MotionStatus::Overheating);
/// assert_eq!(u8::from(MotionStatus::from(0x42)), 0x42);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum MotionStatus {
    /// 00: idle.
    Idle,
    /// 01: locked.
    Locked,
    /// 10: following a leader arm.
    Syncing,
    /// 11: following a leader arm, and locked.
    SyncLocked,
    /// E1: a servo is over its temperature limit.
    Overheating,
    /// E2: stopped by the overheat protection.
    OverheatProtection,
    /// Any other value. A later version may name it: compare values as `u8`.
    Other(u8),
    /// None: the answer is not an Alicia-D's.
    Foreign(Foreign),
}

/// An answer with joints that is not an Alicia-D's: it has another length than the document's 15 data bytes, or 16 as in
/// the vendor's software. Its bytes may have other meanings. They are for reading: nothing that moves or holds an arm is
/// made from them.
///
/// ```
/// use armwire::ling::{Foreign, MotionStatus};
///
/// let status = MotionStatus::of_answer(0x01, 33);
/// assert_eq!(status, MotionStatus::Foreign(Foreign { data_bytes: 33, byte: 0x01 }));
/// assert_eq!(status.to_string(), "not an Alicia-D but a Bessica-D (33 data bytes)");
/// assert_eq!(MotionStatus::of_answer(0x01, 16), MotionStatus::Locked);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Foreign {
    /// The number of its data bytes.
    pub data_bytes: u8,
    /// The byte in the place of the status.
    pub byte: u8,
}

/// The reason why an arm gets no motion.
///
/// ```
/// use armwire::ling::MotionStatus;
///
/// let reason = MotionStatus::from(0x42).check_motion().unwrap_err();
/// assert_eq!(reason.to_string(), "no document explains the arm's status 0x42");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Immovable {
    /// The torque is off, as in this status.
    TorqueOff(MotionStatus),
    /// The status is [`Other`](MotionStatus::Other). A stop is possible.
    UnknownStatus(u8),
    /// It is another robot. Nothing holds it, either.
    Foreign(Foreign),
}

impl fmt::Display for Immovable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TorqueOff(status) => write!(f, "the torque is off (status {status})"),
            Self::UnknownStatus(status) => write!(f, "no document explains the arm's status {status:#04x}"),
            Self::Foreign(foreign) => write!(f, "the arm is {foreign}"),
        }
    }
}

impl core::error::Error for Immovable {}

impl Foreign {
    /// The name of the robot, if its answers are known.
    pub const fn robot(self) -> Option<&'static str> {
        match self.data_bytes {
            // Two arms.
            33 => Some("Bessica-D"),
            _ => None,
        }
    }

    /// The error of a use as an Alicia-D's answer.
    pub(super) const fn error(self) -> OutOfRange {
        let what = match self.robot() {
            Some(_) => "not an Alicia-D but a Bessica-D: its answer",
            None => "not an Alicia-D: its answer",
        };
        OutOfRange::new(
            what,
            "data bytes",
            self.data_bytes as u16,
            SHORTEST_JOINTS,
            LONGEST_JOINTS,
        )
    }
}

impl fmt::Display for Foreign {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("not an Alicia-D")?;
        if let Some(robot) = self.robot() {
            write!(f, " but a {robot}")?;
        }
        write!(f, " ({} data bytes)", self.data_bytes)
    }
}

impl MotionStatus {
    /// The status in an answer with joints, by its byte and the number of data bytes of the answer.
    pub const fn of_answer(byte: u8, data_bytes: u8) -> Self {
        match data_bytes as u16 {
            SHORTEST_JOINTS..=LONGEST_JOINTS => Self::of_byte(byte),
            _ => Self::Foreign(Foreign { data_bytes, byte }),
        }
    }

    const fn of_byte(byte: u8) -> Self {
        match byte {
            0x00 => Self::Idle,
            0x01 => Self::Locked,
            0x10 => Self::Syncing,
            0x11 => Self::SyncLocked,
            0xE1 => Self::Overheating,
            0xE2 => Self::OverheatProtection,
            other => Self::Other(other),
        }
    }

    /// Checks that an arm with this status may be moved: the torque is not off, and the status is a documented one of
    /// an Alicia-D. A [`Stop`](super::Stop) is possible with an undocumented one, too.
    ///
    /// # Errors
    ///
    /// The reason why nothing may move it.
    pub const fn check_motion(self) -> Result<(), Immovable> {
        match self {
            Self::Idle | Self::OverheatProtection => Err(Immovable::TorqueOff(self)),
            Self::Other(byte) => Err(Immovable::UnknownStatus(byte)),
            Self::Foreign(foreign) => Err(Immovable::Foreign(foreign)),
            Self::Locked | Self::Syncing | Self::SyncLocked | Self::Overheating => Ok(()),
        }
    }

    /// True if the torque is on and the arm holds its position, false if it is off. `None` if the status does not show
    /// it: an overheating arm may hold, and the document does not say what a syncing arm does.
    ///
    /// ```
    /// use armwire::ling::MotionStatus;
    ///
    /// assert_eq!(MotionStatus::Locked.is_holding(), Some(true));
    /// assert_eq!(MotionStatus::Overheating.is_holding(), None);
    /// ```
    pub const fn is_holding(self) -> Option<bool> {
        match self {
            Self::Locked | Self::SyncLocked => Some(true),
            Self::Idle | Self::OverheatProtection => Some(false),
            Self::Syncing | Self::Overheating | Self::Other(_) | Self::Foreign(_) => None,
        }
    }

    /// True if the torque is off. False if it is on, and if the status does not show it.
    pub const fn is_torque_off(self) -> bool {
        matches!(self.is_holding(), Some(false))
    }
}

/// The status in an answer of an Alicia-D.
impl From<u8> for MotionStatus {
    fn from(byte: u8) -> Self {
        Self::of_byte(byte)
    }
}

impl From<MotionStatus> for u8 {
    fn from(status: MotionStatus) -> Self {
        match status {
            MotionStatus::Idle => 0x00,
            MotionStatus::Locked => 0x01,
            MotionStatus::Syncing => 0x10,
            MotionStatus::SyncLocked => 0x11,
            MotionStatus::Overheating => 0xE1,
            MotionStatus::OverheatProtection => 0xE2,
            MotionStatus::Other(other) => other,
            MotionStatus::Foreign(foreign) => foreign.byte,
        }
    }
}

impl fmt::Display for MotionStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Idle => f.write_str("idle"),
            Self::Locked => f.write_str("locked"),
            Self::Syncing => f.write_str("syncing"),
            Self::SyncLocked => f.write_str("syncing, locked"),
            Self::Overheating => f.write_str("overheating"),
            Self::OverheatProtection => f.write_str("overheat protection"),
            Self::Other(code) => write!(f, "unknown status {code:#04x}"),
            Self::Foreign(foreign) => foreign.fmt(f),
        }
    }
}

/// A hardware or firmware version, as sent by the arm: 610 is v6.10 (section 2.1).
///
/// The vendor's software writes the same number as 6.1.0.
///
/// ```
/// assert_eq!(armwire::ling::Version(610).to_string(), "v6.10");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct Version(pub u32);

impl fmt::Display for Version {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "v{}.{:02}", self.0 / 100, self.0 % 100)
    }
}

/// A serial number: 16 ASCII characters, the product first (section 2.1).
///
/// ```
/// use armwire::ling::{Kind, SerialNumber};
///
/// let serial = SerialNumber(*b"ADLS251205123456");
/// assert_eq!(serial.as_str(), Some("ADLS251205123456"));
/// assert_eq!(serial.kind(), Some(Kind::Leader));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct SerialNumber(pub [u8; 16]);

impl SerialNumber {
    /// The characters up to the first NUL, or `None` if one of them is not a printable ASCII character.
    pub fn as_str(&self) -> Option<&str> {
        let text = self.text();
        let printable = text.iter().all(u8::is_ascii_graphic);
        str::from_utf8(text).ok().filter(|_| printable)
    }

    /// The bytes up to the first NUL.
    pub(super) fn text(&self) -> &[u8] {
        self.0.split(|&byte| byte == 0).next().unwrap_or_default()
    }

    /// The kind of arm by its product identifier; `None` if the vendor's software does not know it.
    pub fn kind(&self) -> Option<Kind> {
        match self.0 {
            [b'A', b'D', b'L', ..] => Some(Kind::Leader),
            [b'A', b'D', b'F', ..] => Some(Kind::Follower),
            _ => None,
        }
    }
}

/// Non-printable bytes are escaped, because they come from the line.
impl fmt::Display for SerialNumber {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.text().escape_ascii())
    }
}

/// The two kinds of arm.
///
/// ```
/// assert_eq!(armwire::ling::Kind::Follower.servos(), 10);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Kind {
    /// Moved by hand: 6 servos.
    Leader,
    /// Moves under power: 10 servos.
    Follower,
}

impl Kind {
    /// Number of servos: 6 or 10 (section 2.5).
    pub const fn servos(self) -> usize {
        match self {
            Self::Leader => 6,
            Self::Follower => 10,
        }
    }
}

/// One reading for each servo, in the order of their ids: 6 from a leader arm, 10 from a follower (section 2.5).
///
/// ```
/// use armwire::ling::{Kind, PerServo};
///
/// let temperatures = PerServo::Leader([35, 36, 35, 38, 35, 38]);
/// assert_eq!(temperatures.kind(), Kind::Leader);
/// assert_eq!(temperatures.as_slice().iter().max(), Some(&38));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub enum PerServo<T> {
    /// From a leader arm.
    Leader([T; 6]),
    /// From a follower arm.
    Follower([T; 10]),
}

impl<T> PerServo<T> {
    /// The readings, servo 1 first.
    pub const fn as_slice(&self) -> &[T] {
        match self {
            Self::Leader(readings) => readings,
            Self::Follower(readings) => readings,
        }
    }

    /// The kind of arm with this number of servos.
    pub const fn kind(&self) -> Kind {
        match self {
            Self::Leader(_) => Kind::Leader,
            Self::Follower(_) => Kind::Follower,
        }
    }
}

/// The result of a self-check: one bit per servo, servo 1 lowest, 1 = normal (section 2.6).
///
/// ```
/// use armwire::ling::{Kind, SelfCheck};
///
/// let check = SelfCheck(0b11_1111_1011);
/// assert!(!check.all_normal(Kind::Follower));
/// assert!(check.faulty(Kind::Follower).eq([3]));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct SelfCheck(pub u16);

impl SelfCheck {
    /// Returns true if every servo of this kind of arm is normal.
    pub fn all_normal(self, kind: Kind) -> bool {
        self.faulty(kind).next().is_none()
    }

    /// The ids, from 1, of the servos that are not normal.
    pub fn faulty(self, kind: Kind) -> impl Iterator<Item = u8> {
        (1..=kind.servos() as u8).filter(move |id| self.0 >> (id - 1) & 1 == 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_position_survives_conversion_to_radians() {
        for ticks in 0..TICKS_PER_TURN {
            let position = Position::new(ticks).unwrap();
            assert_eq!(Position::from_radians(position.radians()), Ok(position));
        }
    }

    #[test]
    fn quarter_turn_from_centre_is_half_pi() {
        let quarter = core::f32::consts::FRAC_PI_2;
        assert_eq!(Position::from_radians(quarter), Ok(Position::new(3072).unwrap()));
        assert_eq!(Position::from_radians(-quarter), Ok(Position::new(1024).unwrap()));
    }

    #[test]
    fn every_speed_survives_radians_per_second() {
        for ticks in 0..=5000 {
            let speed = Speed::new(ticks).unwrap();
            assert_eq!(Speed::from_radians_per_second(speed.radians_per_second()), Ok(speed));
        }
    }

    #[test]
    fn speed_for_a_move_is_at_least_the_slowest() {
        for ticks in 0..=u16::MAX {
            let is_allowed = (50..=5000).contains(&ticks);
            assert_eq!(Speed::for_move(ticks).is_ok(), is_allowed, "{ticks}");
            if let Ok(speed) = Speed::new(ticks) {
                let nearest = Speed::for_move_radians_per_second(speed.radians_per_second());
                assert_eq!(nearest.ok(), is_allowed.then_some(speed));
            }
        }
        for speed in [-1.0, 0.0, 0.05, 7.7, f32::NAN, f32::INFINITY] {
            let error = Speed::for_move_radians_per_second(speed).unwrap_err();
            assert!(error.min > 0.07 && error.max < 7.68, "{error}");
        }
    }

    #[test]
    fn every_opening_survives_fractions_and_millimetres() {
        for per_mille in 0..=1000 {
            let opening = Opening::new(per_mille).unwrap();
            assert_eq!(Opening::from_fraction(opening.fraction()), Ok(opening));
            for stroke in [Stroke::Mm50, Stroke::Mm75, Stroke::Mm100] {
                assert_eq!(
                    Opening::from_millimetres(opening.millimetres(stroke), stroke),
                    Ok(opening)
                );
            }
        }
    }

    #[test]
    fn unrepresentable_value_is_an_error_not_a_clamp() {
        for angle in [f32::NAN, f32::INFINITY, -3.2, core::f32::consts::PI] {
            let error = Position::from_radians(angle).unwrap_err();
            assert!(error.got.is_nan() == angle.is_nan() && error.max < core::f32::consts::PI);
        }
        assert!(Speed::from_radians_per_second(-0.0001).is_err());
        assert!(Speed::from_radians_per_second(f32::NAN).is_err());
        assert!(Opening::from_fraction(1.0001).is_err());
        assert!(Opening::from_fraction(-0.0001).is_err());
        assert!(Opening::from_millimetres(50.01, Stroke::Mm50).is_err());
        assert!(TemperatureLimit::new(254).is_err() && TemperatureLimit::new(255).is_ok());
    }

    #[test]
    fn serial_number_escapes_terminal_sequences() {
        extern crate std;
        let serial = SerialNumber(*b"AD\x1b[31m\x07\0\0\0\0\0\0\0\0");
        assert_eq!(serial.as_str(), None);
        assert_eq!(std::format!("{serial}"), "AD\\x1b[31m\\x07");
    }

    #[test]
    fn every_motion_status_keeps_its_byte() {
        for code in 0..=u8::MAX {
            assert_eq!(u8::from(MotionStatus::from(code)), code);
        }
    }

    #[test]
    fn every_motion_status_has_a_unique_text() {
        extern crate std;
        let text = |code| std::format!("{}", MotionStatus::from(code));
        let known = [0x00, 0x01, 0x10, 0x11, 0xE1, 0xE2, 0x02, 0x03].map(text);
        let different = std::collections::BTreeSet::from(known.clone());
        assert_eq!(different.len(), known.len());
        assert_eq!(known[0], "idle");
        assert_eq!(known[6], "unknown status 0x02");
    }

    #[test]
    fn clear_bit_of_an_existing_servo_means_faulty() {
        for id in 1..=10_u8 {
            let check = SelfCheck(!(1 << (id - 1)));
            assert!(check.faulty(Kind::Follower).eq([id]));
            assert!(!check.all_normal(Kind::Follower));
            assert_eq!(check.all_normal(Kind::Leader), id > 6);
        }
        assert!(SelfCheck(0b11_1111_1111).all_normal(Kind::Follower));
        assert!(SelfCheck(0).faulty(Kind::Leader).eq(1..=6));
    }
}
