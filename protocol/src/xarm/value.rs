//! The values in xArm messages: raw on the wire, and their meaning.

use core::fmt;
use core::ops::BitOr;
use core::str;

use crate::OutOfRange;
use crate::error::{at_most, within};

/// Maximum length of a message's parameters, in bytes.
///
/// With register and state they are as long as the longest body of Modbus TCP, which shares the connection. The vendor's
/// package sends at most 113, apart from data for a serial line at the tool.
pub const MAX_PARAMS: usize = 252;

/// Maximum number of axes of an arm.
pub const MAX_JOINTS: u8 = 7;

/// Length of a text parameter (registers 1 and 2) as sent by the arms, padded with NUL. The document has no length.
pub const TEXT: usize = 40;

/// The protocol id of a message. A response has that of its request.
///
/// The document has only the first. The vendor's package changes to the second if it reads reports and the arm's
/// firmware is 1.8.6 or later. It then supervises the connection: it reads the state after 30 s of silence, and
/// disconnects after 90 s. A supervision by the arm is not documented.
///
/// ```
/// assert_eq!(armwire::xarm::ProtocolId::Supervised as u16, 3);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ProtocolId {
    /// 2: the private protocol.
    Private = 2,
    /// 3: the same, on a connection that the host supervises.
    Supervised = 3,
}

/// The number of a function in standard Modbus, `0..=127`: bit 7 of its byte marks an exception (Modbus application
/// protocol V1.1b3, section 7).
///
/// ```
/// use armwire::xarm::ModbusFunction;
///
/// assert_eq!(ModbusFunction::new(3)?.number(), 3);
/// assert!(ModbusFunction::new(0x83).is_err());
/// # Ok::<(), armwire::OutOfRange>(())
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct ModbusFunction(
    #[cfg_attr(fuzzing, arbitrary(with = |u: &mut arbitrary::Unstructured<'_>| u.int_in_range(0..=127)))] u8,
);

impl ModbusFunction {
    /// The bit that marks an exception.
    pub(super) const REFUSED: u8 = 0x80;

    /// The function with this number.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] unless it is in `0..=127`.
    pub const fn new(number: u8) -> Result<Self, OutOfRange> {
        match number {
            0..Self::REFUSED => Ok(Self(number)),
            _ => Err(OutOfRange::new(
                "Modbus function",
                "",
                number as u16,
                0,
                Self::REFUSED as u16 - 1,
            )),
        }
    }

    /// The function of a request or of an exception, from its byte.
    pub(super) const fn of_byte(byte: u8) -> Self {
        Self(byte & !Self::REFUSED)
    }

    /// The byte in an exception.
    pub(super) const fn refused(self) -> u8 {
        self.0 | Self::REFUSED
    }

    /// Its number, `0..=127`.
    pub const fn number(self) -> u8 {
        self.0
    }
}

impl fmt::Display for ModbusFunction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// The registers of the document. Each has its own types.
///
/// ```
/// use armwire::xarm::Register;
///
/// assert_eq!(Register::from_code(10), Some(Register::SystemControl));
/// assert_eq!(Register::SystemControl as u8, 10);
/// assert_eq!(Register::from_code(3), None);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
#[non_exhaustive]
pub enum Register {
    /// 1: versions.
    Version = 1,
    /// 2: serial numbers.
    Serials = 2,
    /// 4: reloads the friction parameters.
    ReloadDynamics = 4,
    /// 5: the quantity that is reported as torque.
    TorqueSource = 5,
    /// 6: the radius of rotation of a joint.
    RotationRadius = 6,
    /// 10: shuts down or reboots.
    SystemControl = 10,
}

impl Register {
    /// The register with this number, if it is documented.
    pub const fn from_code(code: u8) -> Option<Self> {
        match code {
            1 => Some(Self::Version),
            2 => Some(Self::Serials),
            4 => Some(Self::ReloadDynamics),
            5 => Some(Self::TorqueSource),
            6 => Some(Self::RotationRadius),
            10 => Some(Self::SystemControl),
            _ => None,
        }
    }
}

/// The state of the arm, and the result of the request: the second byte of every response's body.
///
/// The document does not define the bits: three are from the vendor's later page, `INVALID` is from the vendor's
/// package. The other bits are kept.
///
/// ```
/// use armwire::xarm::State;
///
/// let state = State(0x31);
/// assert!(state.contains(State::NOT_READY | State::WARNING) && !state.contains(State::ERROR));
/// assert_eq!(state.to_string(), "not ready to move, warning, other bits 0x01");
/// assert_eq!(State::OK.to_string(), "ok");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct State(pub u8);

impl State {
    /// No bit is set.
    pub const OK: Self = Self(0);
    /// Bit 3: the request was refused or failed.
    pub const INVALID: Self = Self(0x08);
    /// Bit 4: the arm cannot move now.
    pub const NOT_READY: Self = Self(0x10);
    /// Bit 5: the arm has a warning.
    pub const WARNING: Self = Self(0x20);
    /// Bit 6: the arm has an error.
    pub const ERROR: Self = Self(0x40);

    /// Returns true if all bits of `other` are set.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// True if the arm has an error or a warning. [`Codes`](super::Codes) names them.
    pub const fn has_codes(self) -> bool {
        self.contains(Self::ERROR) || self.contains(Self::WARNING)
    }
}

impl BitOr for State {
    type Output = Self;

    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl fmt::Display for State {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = [
            (Self::INVALID, "invalid"),
            (Self::NOT_READY, "not ready to move"),
            (Self::WARNING, "warning"),
            (Self::ERROR, "error"),
        ];
        let mut separator = "";
        let mut others = self.0;
        for (bit, name) in names {
            others &= !bit.0;
            if self.contains(bit) {
                write!(f, "{separator}{name}")?;
                separator = ", ";
            }
        }
        match others {
            0 if separator.is_empty() => f.write_str("ok"),
            0 => Ok(()),
            _ => write!(f, "{separator}other bits {others:#04x}"),
        }
    }
}

/// A joint, `1..=7`.
///
/// ```
/// use armwire::xarm::Joint;
///
/// assert_eq!(Joint::new(6)?.number(), 6);
/// assert_eq!(Joint::new(0).unwrap_err().to_string(), "joint is 0, must be 1..=7");
/// # Ok::<(), armwire::OutOfRange>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct Joint(
    #[cfg_attr(fuzzing, arbitrary(with = |u: &mut arbitrary::Unstructured<'_>| u.int_in_range(1..=MAX_JOINTS)))] u8,
);

impl Joint {
    /// The joint with this number.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] unless it is in `1..=7`.
    pub const fn new(number: u8) -> Result<Self, OutOfRange> {
        match number {
            1..=MAX_JOINTS => Ok(Self(number)),
            _ => Err(OutOfRange::new("joint", "", number as u16, 1, MAX_JOINTS as u16)),
        }
    }

    /// Its number, `1..=7`.
    pub const fn number(self) -> u8 {
        self.0
    }
}

/// The quantity that the arm reports as the torque of its joints (register 5).
///
/// ```
/// assert_eq!(armwire::xarm::TorqueSource::Current as u8, 1);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub enum TorqueSource {
    /// 0: the torque of the joint, computed.
    Torque = 0,
    /// 1: the current of the servo, measured.
    Current = 1,
}

impl TorqueSource {
    pub(super) const fn from_code(code: u8) -> Result<Self, OutOfRange> {
        match code {
            0 => Ok(Self::Torque),
            1 => Ok(Self::Current),
            _ => Err(OutOfRange::new("torque source", "", code as u16, 0, 1)),
        }
    }
}

/// The radius of rotation of a joint relative to the tool (register 6), as sent by the arm.
///
/// Two values are equal if their bytes on the wire are the same, NaN included.
///
/// ```
/// use armwire::xarm::RotationRadius;
///
/// assert_eq!(RotationRadius::from_metres(0.25)?.millimetres, 250.0);
/// assert_eq!(RotationRadius { millimetres: 76.0 }.metres()?, 0.076);
/// let error = RotationRadius { millimetres: f32::NAN }.metres().unwrap_err();
/// assert_eq!(error.to_string(), "rotation radius is NaN m, must be 0..=100");
/// # Ok::<(), armwire::OutOfRange<f32>>(())
/// ```
#[derive(Clone, Copy, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct RotationRadius {
    /// Millimetres, as received: any number.
    pub millimetres: f32,
}

impl RotationRadius {
    /// The maximum, in metres. The document has no limit; no arm is this long.
    pub const MAX_METRES: f32 = 100.0;

    /// A radius in metres.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] unless it is in `0..=100` m.
    pub fn from_metres(metres: f32) -> Result<Self, OutOfRange<f32>> {
        Ok(Self {
            millimetres: radius_in_range(metres)? * 1000.0,
        })
    }

    /// The radius in metres.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] unless it is in `0..=100` m.
    pub fn metres(self) -> Result<f32, OutOfRange<f32>> {
        radius_in_range(self.millimetres / 1000.0)
    }
}

fn radius_in_range(metres: f32) -> Result<f32, OutOfRange<f32>> {
    within("rotation radius", "m", metres, 0.0, RotationRadius::MAX_METRES)
}

impl PartialEq for RotationRadius {
    fn eq(&self, other: &Self) -> bool {
        self.millimetres.to_bits() == other.millimetres.to_bits()
    }
}

impl Eq for RotationRadius {}

/// The kind of the arm and the versions of its software, as sent by the arm (register 1): text, padded with NUL.
///
/// ```
/// use armwire::xarm::VersionText;
///
/// let bytes = VersionText::encode("6,6,XI1202,AC1302,v1.12.10")?;
/// let text = VersionText(&bytes);
/// let version = text.version().unwrap();
/// assert_eq!((version.axes, version.kind), (6, 6));
/// assert_eq!((version.arm, version.control_box), ("XI1202", "AC1302"));
/// assert_eq!(version.firmware_numbers(), Some([1, 12, 10]));
/// # Ok::<(), armwire::OutOfRange>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct VersionText<'a>(
    #[cfg_attr(fuzzing, arbitrary(with = |u: &mut _| crate::fuzzing::bytes(u, 1..=MAX_PARAMS)))] pub &'a [u8],
);

impl<'a> VersionText<'a> {
    /// The bytes that an arm sends for this text.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] for more than 39 characters, because the vendor's package needs a NUL after them, or if one of
    /// them is not printable ASCII.
    pub fn encode(text: &str) -> Result<[u8; TEXT], OutOfRange> {
        at_most("version text", "characters", text.len(), TEXT as u16 - 1)?;
        check_characters("character of a version", text, b' ')?;
        let mut bytes = [0; TEXT];
        put(&mut bytes, text.bytes());
        Ok(bytes)
    }

    /// The text up to the first NUL, or `None` if one of its bytes is not printable ASCII.
    pub fn as_str(self) -> Option<&'a str> {
        printable(self.text())
    }

    /// The parts of the text: axes, type, arm, control box and firmware, separated by commas.
    ///
    /// The document's text has the type before the axes. In its example both are 6. The vendor's package reads the axes
    /// first.
    ///
    /// # Errors
    ///
    /// [`VersionError`] for any other text. Old firmware sends only its own version.
    pub fn version(self) -> Result<Version<'a>, VersionError> {
        let text = self.as_str().ok_or(VersionError::NotText)?;
        // Not `str::split`: in `core` it has a path to a panic.
        let mut fields = text.as_bytes().split(|&byte| byte == b',');
        let got = fields.clone().count();
        let mut next = || fields.next();
        let (Some(axes), Some(kind), Some(arm), Some(control_box), Some(firmware), None) =
            (next(), next(), next(), next(), next(), next())
        else {
            return Err(VersionError::Fields { got });
        };
        let [arm, control_box, firmware] =
            [arm, control_box, firmware].map(|field| str::from_utf8(field).unwrap_or_default());
        Ok(Version {
            axes: number(axes).ok_or(VersionError::Number("number of axes"))?,
            kind: number(kind).ok_or(VersionError::Number("type"))?,
            arm,
            control_box,
            firmware,
        })
    }

    fn text(self) -> &'a [u8] {
        self.0.split(|&byte| byte == 0).next().unwrap_or_default()
    }
}

/// Non-printable bytes are escaped, because they come from the connection.
impl fmt::Display for VersionText<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.text().escape_ascii())
    }
}

/// The parts of a [`VersionText`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Version<'a> {
    /// Number of axes, 5 to 7.
    pub axes: u8,
    /// The type of the arm, a number assigned by the vendor.
    pub kind: u8,
    /// The arm's hardware, for example XI1202.
    pub arm: &'a str,
    /// The control box's hardware, for example AC1302.
    pub control_box: &'a str,
    /// The firmware, for example v1.12.10.
    pub firmware: &'a str,
}

impl Version<'_> {
    /// The firmware version as three numbers, which can be compared; `None` if it is not `v` and three numbers.
    pub fn firmware_numbers(&self) -> Option<[u16; 3]> {
        let [b'v' | b'V', numbers @ ..] = self.firmware.as_bytes() else {
            return None;
        };
        let mut fields = numbers.split(|&byte| byte == b'.');
        let mut numbers = [0; 3];
        for n in &mut numbers {
            *n = number(fields.next()?)?;
        }
        fields.next().is_none().then_some(numbers)
    }
}

/// The number with these digits, if it fits.
fn number<T: str::FromStr>(digits: &[u8]) -> Option<T> {
    let only_digits = digits.iter().all(u8::is_ascii_digit);
    let digits = str::from_utf8(digits).ok().filter(|_| only_digits)?;
    digits.parse().ok()
}

/// The reason why a text is not a version.
///
/// ```
/// use armwire::xarm::VersionText;
///
/// let error = VersionText(b"v1.0.2").version().unwrap_err();
/// assert_eq!(error.to_string(), "the version has 1 fields, expected axes,type,arm,control box,firmware");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum VersionError {
    /// A byte is not printable ASCII.
    NotText,
    /// The number of fields is not five.
    Fields {
        /// The number of fields.
        got: usize,
    },
    /// This field is not a number up to 255.
    Number(&'static str),
}

impl fmt::Display for VersionError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotText => f.write_str("the version is not printable ASCII"),
            Self::Fields { got } => write!(
                f,
                "the version has {got} fields, expected axes,type,arm,control box,firmware"
            ),
            Self::Number(field) => write!(f, "the {field} in the version is not a number up to 255"),
        }
    }
}

impl core::error::Error for VersionError {}

/// The serial numbers of the arm and of its control box, as sent by the arm (register 2): the first, NUL, the second, a
/// line feed, padded with NUL.
///
/// ```
/// use armwire::xarm::SerialsText;
///
/// let bytes = SerialsText::encode("XI120204201B02", "AC130202B02L02")?;
/// let serials = SerialsText(&bytes);
/// assert_eq!(serials.arm(), Some("XI120204201B02"));
/// assert_eq!(serials.control_box(), Some("AC130202B02L02"));
/// # Ok::<(), armwire::OutOfRange>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct SerialsText<'a>(
    #[cfg_attr(fuzzing, arbitrary(with = |u: &mut _| crate::fuzzing::bytes(u, 1..=MAX_PARAMS)))] pub &'a [u8],
);

impl<'a> SerialsText<'a> {
    /// The bytes that an arm sends for these serial numbers.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] if the two have more than 37 characters together, or if one of them is not visible ASCII.
    pub fn encode(arm: &str, control_box: &str) -> Result<[u8; TEXT], OutOfRange> {
        let len = arm.len().saturating_add(control_box.len());
        at_most("serial numbers", "characters", len, TEXT as u16 - 3)?;
        check_characters("character of a serial number", arm, b'!')?;
        check_characters("character of a serial number", control_box, b'!')?;
        let mut bytes = [0; TEXT];
        let text = arm.bytes().chain([0]).chain(control_box.bytes()).chain([b'\n']);
        put(&mut bytes, text);
        Ok(bytes)
    }

    /// The arm's serial number, or `None` if it is not printable ASCII.
    pub fn arm(self) -> Option<&'a str> {
        printable(self.part(0))
    }

    /// The control box's serial number, or `None` if it is not printable ASCII.
    pub fn control_box(self) -> Option<&'a str> {
        printable(self.part(1))
    }

    /// The text between two NULs, without the line feed at its end.
    fn part(self, n: usize) -> &'a [u8] {
        let part = self.0.split(|&byte| byte == 0).nth(n).unwrap_or_default();
        part.strip_suffix(b"\n").unwrap_or(part)
    }
}

/// Non-printable bytes are escaped, because they come from the connection.
impl fmt::Display for SerialsText<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (arm, control_box) = (self.part(0).escape_ascii(), self.part(1).escape_ascii());
        write!(f, "{arm}, control box {control_box}")
    }
}

/// The text, if all of it is printable ASCII.
fn printable(text: &[u8]) -> Option<&str> {
    let printable = text.iter().all(|byte| (b' '..=b'~').contains(byte));
    str::from_utf8(text).ok().filter(|_| printable)
}

fn check_characters(what: &'static str, text: &str, min: u8) -> Result<(), OutOfRange> {
    match text.bytes().find(|byte| !(min..=b'~').contains(byte)) {
        None => Ok(()),
        Some(got) => Err(OutOfRange::new(what, "", got.into(), min.into(), b'~'.into())),
    }
}

fn put(bytes: &mut [u8], text: impl Iterator<Item = u8>) {
    for (byte, character) in bytes.iter_mut().zip(text) {
        *byte = character;
    }
}

/// An undocumented register and its raw parameters.
///
/// In parameters, 16-bit numbers are big-endian; 32-bit integers and floating-point numbers are little-endian.
///
/// ```
/// use armwire::xarm::{Raw, Register, RawError};
///
/// let mode = Raw::new(19, &[1])?;
/// assert_eq!((mode.register(), mode.params()), (19, &[1][..]));
/// assert_eq!(Raw::new(10, &[1]), Err(RawError::Typed(Register::SystemControl)));
/// assert_eq!(
///     Raw::new(19, &[0; 253]).unwrap_err().to_string(),
///     "a message has at most 252 bytes of parameters, not 253"
/// );
/// # Ok::<(), RawError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct Raw<'a> {
    #[cfg_attr(fuzzing, arbitrary(with = |u: &mut arbitrary::Unstructured<'_>| u.int_in_range(11..=255)))]
    register: u8,
    #[cfg_attr(fuzzing, arbitrary(with = |u: &mut _| crate::fuzzing::bytes(u, 0..=MAX_PARAMS)))]
    params: &'a [u8],
}

impl<'a> Raw<'a> {
    /// A register and its parameters.
    ///
    /// # Errors
    ///
    /// [`RawError`] if the register has a type of its own, or if the parameters are longer than [`MAX_PARAMS`] bytes.
    pub const fn new(register: u8, params: &'a [u8]) -> Result<Self, RawError> {
        if let Some(register) = Register::from_code(register) {
            return Err(RawError::Typed(register));
        }
        match params.len() {
            0..=MAX_PARAMS => Ok(Self { register, params }),
            got => Err(RawError::TooLong { max: MAX_PARAMS, got }),
        }
    }

    /// A register outside of [`Register`], and its parameters, as received in a frame.
    pub(super) const fn from_wire(register: u8, params: &'a [u8]) -> Self {
        Self { register, params }
    }

    /// The register.
    pub const fn register(&self) -> u8 {
        self.register
    }

    /// The parameters.
    pub const fn params(&self) -> &'a [u8] {
        self.params
    }
}

/// The reason why [`Raw::new`] rejected a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum RawError {
    /// The register has a type of its own.
    Typed(Register),
    /// The parameters are too long.
    TooLong {
        /// The maximum length of the parameters, in bytes.
        max: usize,
        /// Their length, in bytes.
        got: usize,
    },
}

impl fmt::Display for RawError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Typed(register) => write!(f, "register {} has types of its own", *register as u8),
            Self::TooLong { max, got } => write!(f, "a message has at most {max} bytes of parameters, not {got}"),
        }
    }
}

impl core::error::Error for RawError {}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;

    #[test]
    fn unrepresentable_value_is_an_error_not_a_clamp() {
        for metres in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -0.001, 100.01] {
            assert!(RotationRadius::from_metres(metres).is_err(), "{metres}");
            let millimetres = metres * 1000.0;
            assert!(RotationRadius { millimetres }.metres().is_err(), "{metres}");
        }
        for number in [0, 8, 255] {
            let error = Joint::new(number).unwrap_err();
            assert_eq!((error.got, error.min, error.max), (number.into(), 1, 7));
        }
    }

    #[test]
    fn every_radius_in_millimetres_survives_metres() {
        for millimetres in 0..=100_000_u32 {
            let millimetres = millimetres as f32;
            let metres = RotationRadius { millimetres }.metres().unwrap();
            let back = RotationRadius::from_metres(metres).unwrap().millimetres;
            assert!(
                (back - millimetres).abs() <= millimetres * f32::EPSILON,
                "{millimetres}"
            );
        }
    }

    #[test]
    fn every_state_names_each_of_its_bits() {
        for bits in 0..=u8::MAX {
            let text = std::format!("{}", State(bits));
            for (bit, name) in [(8, "invalid"), (16, "not ready"), (32, "warning"), (64, "error")] {
                assert_eq!(text.contains(name), bits & bit != 0, "{bits:#04x}: {text}");
            }
            assert_eq!(text.contains("other bits"), bits & 0x87 != 0, "{bits:#04x}: {text}");
            assert_eq!(text == "ok", bits == 0, "{bits:#04x}: {text}");
        }
    }

    #[test]
    fn version_has_five_fields_starting_with_two_numbers() {
        let version = |text| {
            let bytes = VersionText::encode(text).unwrap();
            VersionText(&bytes).version().map(|version| version.axes)
        };
        assert_eq!(version("7,12,XI1300,AC1300,v2.5.0"), Ok(7));
        assert_eq!(version("v1.0.2"), Err(VersionError::Fields { got: 1 }));
        assert_eq!(
            version("6,6,XI1202,AC1302,v1.12.10,x"),
            Err(VersionError::Fields { got: 6 })
        );
        assert_eq!(version("+6,6,a,b,v1.1.1"), Err(VersionError::Number("number of axes")));
        assert_eq!(version("six,6,a,b,v1.1.1"), Err(VersionError::Number("number of axes")));
        assert_eq!(version("6,256,a,b,v1.1.1"), Err(VersionError::Number("type")));
        assert_eq!(VersionText(&[0xFF; TEXT]).version(), Err(VersionError::NotText));
    }

    #[test]
    fn firmware_versions_compare_as_numbers() {
        let firmware = |firmware| {
            let version = Version {
                axes: 6,
                kind: 6,
                arm: "",
                control_box: "",
                firmware,
            };
            version.firmware_numbers()
        };
        assert!(firmware("v1.12.10") > firmware("v1.8.103"));
        assert_eq!(firmware("V1.12.10"), Some([1, 12, 10]));
        for bad in ["1.12.10", "v1.12", "v1.12.10.1", "v1.12.x", "v1.12.65536", "v", ""] {
            assert_eq!(firmware(bad), None, "{bad}");
        }
    }

    #[test]
    fn text_without_nul_is_read_to_its_end() {
        let mut text = [b'7'; TEXT];
        assert_eq!(VersionText(&text).as_str().map(str::len), Some(TEXT));
        text[20] = 0;
        assert_eq!(SerialsText(&text).arm().map(str::len), Some(20));
        assert_eq!(SerialsText(&text).control_box().map(str::len), Some(19));
        assert_eq!(SerialsText(&[0; TEXT]).control_box(), Some(""));
    }

    #[test]
    fn oversized_or_unprintable_text_is_refused() {
        let long = "0123456789012345678901234567890123456789";
        let error = VersionText::encode(long).unwrap_err();
        assert_eq!(std::format!("{error}"), "version text is 40 characters, must be 0..=39");
        assert!(VersionText::encode(&long[..39]).is_ok_and(|text| text[39] == 0));
        assert!(SerialsText::encode(&long[..20], &long[..18]).is_err());
        assert!(SerialsText::encode(&long[..20], &long[..17]).is_ok_and(|text| text[39] == 0));
        assert!(SerialsText::encode("A B", "C").is_err() && SerialsText::encode("A", "B\n").is_err());
        assert!(SerialsText::encode("\u{E9}", "C").is_err() && SerialsText::encode("A", "\u{7F}").is_err());
        assert!(VersionText::encode("6,6\n").is_err() && VersionText::encode("\u{E9}").is_err());
    }

    #[test]
    fn texts_of_an_arm_escape_terminal_sequences() {
        let mut text = [0; TEXT];
        put(&mut text, b"AD\x1b[31m\0\x07\n".iter().copied());
        assert_eq!(SerialsText(&text).arm(), None);
        assert_eq!(std::format!("{}", SerialsText(&text)), "AD\\x1b[31m, control box \\x07");
        assert_eq!(std::format!("{}", VersionText(&text)), "AD\\x1b[31m");
        // Valid UTF-8, but control characters of a terminal: DEL and CSI.
        for control in ["\u{7F}", "\u{9B}31m"] {
            let mut text = [0; TEXT];
            put(&mut text, control.bytes());
            assert_eq!((VersionText(&text).as_str(), SerialsText(&text).arm()), (None, None));
        }
    }
}
