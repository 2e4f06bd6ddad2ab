//! The values in the messages of the force-feedback leader.
//!
//! The source is the vendor's candidate document of September 2026, for this arm only: no other arm answers these
//! messages.

use super::JOINTS;
use super::frame::{put_words, words};
use crate::OutOfRange;
use crate::error::Cause;

/// The control mode of the joints. It is not their torque, which may be off in both.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
#[repr(u8)]
pub enum ControlMode {
    /// 00: the joints follow positions. After a return to this mode the torque stays off.
    Position = 0,
    /// 01: the joints follow currents.
    Current = 1,
}

/// The verdict on a requested mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
#[repr(u8)]
pub enum ModeResult {
    /// 00: accepted, which is not applied.
    Accepted = 0,
    /// 01: the mode is invalid.
    Invalid = 1,
    /// 02: the mode is not supported, or the request was not queued.
    Unsupported = 2,
}

/// The answer to a requested mode. It does not say that the mode is applied: a [`ModeChange`](super::ModeChange) reads
/// that.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct ModeReply {
    /// The requested mode as sent, which is no [`ControlMode`] if it is invalid.
    pub requested: u8,
    /// The verdict.
    pub result: ModeResult,
}

/// The applied mode, and the torques and currents of the joints.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct ModeState {
    /// The applied mode.
    pub mode: ControlMode,
    /// The blocked joints. Only joints 2 and 3 are documented.
    pub blocked: JointMask,
    /// The joints whose values are valid.
    pub valid: JointMask,
    /// The values of joints 1 to 6.
    pub joints: [JointForce; JOINTS],
}

/// Torque and currents of a joint, signed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct JointForce {
    /// The remote residual torque, in 0.001 Nm.
    pub residual_torque: i16,
    /// The requested current, in 0.001 A.
    pub requested_current: i16,
    /// The output current, in 0.001 A.
    pub output_current: i16,
    /// The measured current, in 0.001 A.
    pub measured_current: i16,
}

/// One bit for each joint, joint 1 lowest.
///
/// ```
/// use armwire::ling::JointMask;
///
/// assert_eq!(JointMask(0b00_0110).to_string(), "2 3");
/// assert_eq!(JointMask(0).to_string(), "none");
/// assert!(JointMask(0b00_0110).has(3));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct JointMask(pub u8);

/// The state of the force feedback. *Requested* is not *effective*.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct ForceFeedback {
    /// It is requested.
    pub is_requested: bool,
    /// It acts on the joints.
    pub is_effective: bool,
    /// The reasons why it does not act.
    pub inhibit: Inhibit,
    /// The synchronization with another arm is active.
    pub is_sync_active: bool,
    /// The torque is on.
    pub is_torque_enabled: bool,
    /// The torque is requested.
    pub is_torque_requested: bool,
    /// Diagnostic: the state of the transition.
    pub transition: u8,
    /// Diagnostic: the raw value of the grip.
    pub grip: u8,
    /// Diagnostic: the requested mode.
    pub requested_mode: u8,
}

/// The reasons why the force feedback does not act: one bit for each.
///
/// ```
/// use armwire::ling::Inhibit;
///
/// let inhibit = Inhibit(Inhibit::NO_TELEOPERATION | Inhibit::STALE | 0x02);
/// assert_eq!(inhibit.to_string(), "not in teleoperation; link or sample older than 30 ms; unknown 0x02");
/// assert_eq!(Inhibit(0).to_string(), "none");
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct Inhibit(pub u8);

impl ControlMode {
    pub(super) const fn from_code(code: u8) -> Result<Self, OutOfRange> {
        match code {
            0 => Ok(Self::Position),
            1 => Ok(Self::Current),
            _ => Err(OutOfRange::new("control mode", "", code as u16, 0, 1)),
        }
    }
}

impl JointMask {
    /// True if the bit of this joint, 1 to 8, is set.
    pub const fn has(self, joint: u8) -> bool {
        matches!(joint, 1..=8) && self.0 >> (joint - 1) & 1 == 1
    }
}

impl Inhibit {
    /// Bit 0: not in teleoperation.
    pub const NO_TELEOPERATION: u8 = 1 << 0;
    /// Bit 2: the link or the sample is older than 30 ms.
    pub const STALE: u8 = 1 << 2;
    /// Bit 3: a hardware fault.
    pub const FAULT: u8 = 1 << 3;
    /// Bit 4: not supported.
    pub const UNSUPPORTED: u8 = 1 << 4;
}

impl ModeReply {
    pub(super) const LEN: usize = 3;
    const VERSION: u8 = 1;

    pub(super) fn from_data(data: &[u8; Self::LEN]) -> Result<Self, Cause> {
        let [version, requested, result] = *data;
        check(0, &[Self::VERSION], version)?;
        let result = match result {
            0 => ModeResult::Accepted,
            1 => ModeResult::Invalid,
            2 => ModeResult::Unsupported,
            got => return Err(Cause::byte(2, &[0, 1, 2], got)),
        };
        Ok(Self { requested, result })
    }

    pub(super) const fn to_data(self) -> [u8; Self::LEN] {
        [Self::VERSION, self.requested, self.result as u8]
    }
}

impl ModeState {
    pub(super) const LEN: usize = 52;
    const VERSION: u8 = 1;

    pub(super) fn from_data(data: &[u8; Self::LEN]) -> Result<Self, Cause> {
        let [version, mode, blocked, valid, values @ ..] = data;
        check(0, &[Self::VERSION], *version)?;
        let mut joints = [JointForce::default(); JOINTS];
        for (joint, values) in joints.iter_mut().zip(values.as_chunks::<8>().0) {
            let [torque, requested, output, measured] = words(values).map(u16::cast_signed);
            *joint = JointForce {
                residual_torque: torque,
                requested_current: requested,
                output_current: output,
                measured_current: measured,
            };
        }
        Ok(Self {
            mode: ControlMode::from_code(*mode).map_err(|error| Cause::value(1, error))?,
            blocked: JointMask(*blocked),
            valid: JointMask(*valid),
            joints,
        })
    }

    pub(super) fn to_data(self) -> [u8; Self::LEN] {
        let mut data = [0; Self::LEN];
        let [version, mode, blocked, valid, values @ ..] = &mut data;
        (*version, *mode, *blocked, *valid) = (Self::VERSION, self.mode as u8, self.blocked.0, self.valid.0);
        for (values, joint) in values.chunks_exact_mut(8).zip(self.joints) {
            let currents = [joint.requested_current, joint.output_current, joint.measured_current];
            let [requested, output, measured] = currents;
            let joint = [joint.residual_torque, requested, output, measured];
            put_words(values, &joint.map(i16::cast_unsigned));
        }
        data
    }
}

impl ForceFeedback {
    pub(super) const LEN: usize = 10;
    const VERSION: u8 = 2;

    pub(super) fn from_data(data: &[u8; Self::LEN]) -> Result<Self, Cause> {
        let [
            version,
            requested,
            effective,
            inhibit,
            sync,
            enabled,
            torque,
            transition,
            grip,
            requested_mode,
        ] = *data;
        check(0, &[Self::VERSION], version)?;
        for (offset, switch) in [(1, requested), (2, effective), (4, sync), (5, enabled), (6, torque)] {
            check(offset, &[0, 1], switch)?;
        }
        Ok(Self {
            is_requested: requested == 1,
            is_effective: effective == 1,
            inhibit: Inhibit(inhibit),
            is_sync_active: sync == 1,
            is_torque_enabled: enabled == 1,
            is_torque_requested: torque == 1,
            transition,
            grip,
            requested_mode,
        })
    }

    pub(super) const fn to_data(self) -> [u8; Self::LEN] {
        [
            Self::VERSION,
            self.is_requested as u8,
            self.is_effective as u8,
            self.inhibit.0,
            self.is_sync_active as u8,
            self.is_torque_enabled as u8,
            self.is_torque_requested as u8,
            self.transition,
            self.grip,
            self.requested_mode,
        ]
    }
}

/// Checks a byte that has few values.
fn check(offset: usize, allowed: &'static [u8], got: u8) -> Result<(), Cause> {
    match allowed.contains(&got) {
        true => Ok(()),
        false => Err(Cause::byte(offset, allowed, got)),
    }
}
