//! The adapter's configuration and its limits.

use core::fmt;

use armwire::time::Duration;
use serde::{Deserialize, Serialize};

use crate::can::Node;
#[cfg(fuzzing)]
use crate::fuzzing::{mostly, optional, up_to_excess};

/// The highest poll rate, in hertz.
pub const MAX_POLL_HZ: u16 = 1_000;

/// The bit rates of a CAN bus, in bits per second: recommended by CiA 301 and supported by the bit timing of every
/// board.
pub const CAN_BIT_RATES: [u32; 4] = [125_000, 250_000, 500_000, 1_000_000];

/// The bit rates of the data phase of a CAN FD bus, in bits per second.
pub const CAN_DATA_BIT_RATES: [u32; 4] = [1_000_000, 2_000_000, 4_000_000, 5_000_000];

/// The share of a CAN bus that cyclic telemetry may take, in percent. The rest is for exchanges and other nodes.
pub const CAN_TELEMETRY_SHARE: u32 = 60;

/// The frames of a telemetry sample, and the bits of a classic frame of eight bytes with the maximum of stuff bits:
/// 111, plus one for every four of the 98 bits that are stuffed.
const TELEMETRY_FRAMES: u32 = 3;
const FRAME_BITS: u32 = 135;

/// The configuration of an adapter: set on the control port and stored in flash.
///
/// ```
/// use armwire_bridge::config::{ArmKind, Config, ConfigError, Poll};
///
/// let mut config = Config::default();
/// config.poll = Poll::Hertz(200);
/// assert_eq!(config.check(), Ok(()));
/// config.poll = Poll::Hertz(1_001);
/// assert_eq!(config.check(), Err(ConfigError::PollRate { max: 1_000, got: 1_001 }));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Config {
    /// The device on the UART.
    pub arm: ArmKind,
    /// The rate of the adapter's own requests to the arm.
    pub poll: Poll,
    /// The CAN bus.
    pub can: Can,
    /// The timeout of a host that streams motion.
    pub host_timeout: HostTimeout,
}

/// The configuration in flash.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub enum Saved {
    /// A valid configuration.
    Config(Config),
    /// No configuration: none was ever saved, or it was reset.
    Nothing,
    /// No valid configuration of this version, for example corrupted data, or a first save interrupted by a loss of
    /// power. The data stays in flash until later saves overwrite it.
    Unreadable,
}

/// The device on the UART: it determines baud rate, framing and wiring.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ArmKind {
    /// Ling / Alicia-D: 1 Mbaud.
    #[default]
    Ling,
    /// UBTECH Alpha1's PC protocol: 115 200 baud.
    Alpha1,
    /// The bus of Alpha1's servos: 115 200 baud on a single wire, half duplex.
    Alpha1Servo,
    /// Any other device, without framing: 1 Mbaud until the host sets another line coding.
    Raw,
}

/// The rate of the adapter's own requests: the joints of a Ling arm, the servo states of an Alpha1.
///
/// A servo bus is not polled: a servo switches its motor off when its angle is read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Poll {
    /// Never.
    #[default]
    Off,
    /// Polls per second, 1 to [`MAX_POLL_HZ`], each at its slot by the adapter's own clock.
    Hertz(#[cfg_attr(fuzzing, arbitrary(with = |u: &mut _| up_to_excess(u, MAX_POLL_HZ)))] u16),
    /// Continuous polling: the next poll goes out when the answer is in and no host waits.
    Fastest,
}

/// The CAN bus, and the adapter's behaviour on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Can {
    /// The adapter's node id on the bus.
    pub node: Node,
    /// Bits per second, one of [`CAN_BIT_RATES`].
    #[cfg_attr(fuzzing, arbitrary(with = |u: &mut _| mostly(u, &CAN_BIT_RATES)))]
    pub bit_rate: u32,
    /// Bits per second of the data phase, one of [`CAN_DATA_BIT_RATES`]: CAN FD. `None` is classic CAN.
    #[cfg_attr(fuzzing, arbitrary(with = |u: &mut _| optional(u, |u| mostly(u, &CAN_DATA_BIT_RATES))))]
    pub data_bit_rate: Option<u32>,
    /// The rate of cyclic state frames, in hertz: 0 for off, at most 1000 and within [`CAN_TELEMETRY_SHARE`] of the
    /// bus. An unchanged state is not sent again.
    #[cfg_attr(fuzzing, arbitrary(with = |u: &mut _| up_to_excess(u, MAX_POLL_HZ)))]
    pub telemetry_hz: u16,
    /// Enables cyclic command frames, which move the arm.
    pub commands: bool,
    /// Three limits in milliseconds, 1 to 10 000: the time for a command to be complete, its maximum wait for a turn,
    /// and the time after the last command at which the stream ends.
    #[cfg_attr(fuzzing, arbitrary(with = |u: &mut _| up_to_excess(u, MAX_COMMAND_TIMEOUT_MS)))]
    pub command_timeout_ms: u16,
    /// Sends the arm's unsolicited frames by ISO-TP, too.
    pub unsolicited: bool,
}

/// The timeout of a host that streams motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct HostTimeout {
    /// The timeout, in milliseconds, 0 for never.
    pub after_ms: u16,
    /// Switches the torque off at the timeout. The arm may fall.
    pub torque_off: bool,
}

/// The reason for a refused configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum ConfigError {
    /// A poll rate of 0 or above the maximum, in hertz.
    PollRate {
        /// The maximum.
        max: u16,
        /// The requested rate.
        got: u16,
    },
    /// This kind of arm is not polled.
    NotPolled(ArmKind),
    /// A bit rate that is not in [`CAN_BIT_RATES`].
    BitRate(u32),
    /// A bit rate of the data phase that is not in [`CAN_DATA_BIT_RATES`].
    DataBitRate(u32),
    /// Telemetry that takes more than its share of the bus.
    Telemetry {
        /// The maximum on this bus, in hertz.
        max: u16,
        /// The requested rate, in hertz.
        got: u16,
    },
    /// This kind of arm takes no cyclic commands.
    NotCommanded(ArmKind),
    /// A command timeout outside 1 to 10 000 milliseconds.
    CommandTimeout {
        /// The maximum, in milliseconds.
        max: u16,
        /// The requested timeout, in milliseconds.
        got: u16,
    },
    /// A bit rate of the data phase for an adapter without CAN FD.
    NoCanFd,
    /// Settings of the bus other than the factory defaults, for an adapter without CAN. Since version 6.
    NoCan,
}

/// The longest command timeout, in milliseconds.
const MAX_COMMAND_TIMEOUT_MS: u16 = 10_000;

impl Config {
    /// Checks the configuration against the limits.
    ///
    /// # Errors
    ///
    /// The first value that is out of range or not supported.
    pub fn check(&self) -> Result<(), ConfigError> {
        match self.poll {
            Poll::Hertz(got @ (0 | MAX_POLL_HZ..)) if got != MAX_POLL_HZ => {
                return Err(ConfigError::PollRate { max: MAX_POLL_HZ, got });
            }
            Poll::Hertz(_) | Poll::Fastest if !self.arm.is_polled() => {
                return Err(ConfigError::NotPolled(self.arm));
            }
            _ => {}
        }
        self.can.check()?;
        if self.can.commands && self.arm != ArmKind::Ling {
            return Err(ConfigError::NotCommanded(self.arm));
        }
        Ok(())
    }
}

impl ArmKind {
    /// All kinds.
    pub const ALL: [Self; 4] = [Self::Ling, Self::Alpha1, Self::Alpha1Servo, Self::Raw];

    /// Returns true if the adapter polls this kind.
    const fn is_polled(self) -> bool {
        matches!(self, Self::Ling | Self::Alpha1)
    }

    /// The kind's name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ling => "ling",
            Self::Alpha1 => "alpha1",
            Self::Alpha1Servo => "alpha1-servo",
            Self::Raw => "raw",
        }
    }
}

impl Can {
    /// The settings that the controller and the hosts on the bus must agree on.
    pub(crate) const fn bus(&self) -> (Node, u32, Option<u32>) {
        (self.node, self.bit_rate, self.data_bit_rate)
    }

    fn check(&self) -> Result<(), ConfigError> {
        if !CAN_BIT_RATES.contains(&self.bit_rate) {
            return Err(ConfigError::BitRate(self.bit_rate));
        }
        match self.data_bit_rate {
            Some(rate) if !CAN_DATA_BIT_RATES.contains(&rate) => return Err(ConfigError::DataBitRate(rate)),
            _ => {}
        }
        let max = self.max_telemetry_hz();
        if self.telemetry_hz > max {
            return Err(ConfigError::Telemetry {
                max,
                got: self.telemetry_hz,
            });
        }
        if !(1..=MAX_COMMAND_TIMEOUT_MS).contains(&self.command_timeout_ms) {
            return Err(ConfigError::CommandTimeout {
                max: MAX_COMMAND_TIMEOUT_MS,
                got: self.command_timeout_ms,
            });
        }
        Ok(())
    }

    /// The fastest cyclic telemetry on this bus, in hertz.
    ///
    /// ```
    /// let can = armwire_bridge::config::Can { bit_rate: 125_000, ..Default::default() };
    /// assert_eq!(can.max_telemetry_hz(), 185);
    /// ```
    pub const fn max_telemetry_hz(&self) -> u16 {
        let hertz = self.bit_rate / 100 * CAN_TELEMETRY_SHARE / (TELEMETRY_FRAMES * FRAME_BITS);
        if hertz < MAX_POLL_HZ as u32 {
            hertz as u16
        } else {
            MAX_POLL_HZ
        }
    }
}

impl HostTimeout {
    /// The timeout, zero for never.
    pub(crate) const fn after(&self) -> Duration {
        Duration::from_millis(self.after_ms as u64)
    }
}

/// Node 0 on a classic bus at 1 Mbit/s, without telemetry and commands.
impl Default for Can {
    fn default() -> Self {
        Self {
            node: Node::default(),
            bit_rate: 1_000_000,
            data_bit_rate: None,
            telemetry_hz: 0,
            commands: false,
            command_timeout_ms: 100,
            unsolicited: false,
        }
    }
}

/// A timeout of half a second, without torque-off.
impl Default for HostTimeout {
    fn default() -> Self {
        Self {
            after_ms: 500,
            torque_off: false,
        }
    }
}

impl fmt::Display for ArmKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::PollRate { max, got } => write!(f, "poll rate {got} Hz, allowed 1 to {max} Hz"),
            Self::NotPolled(arm) => write!(f, "polling is not supported for arm {arm}"),
            Self::BitRate(got) => write!(f, "CAN bit rate {got} bit/s, allowed {CAN_BIT_RATES:?}"),
            Self::DataBitRate(got) => {
                write!(f, "CAN FD data bit rate {got} bit/s, allowed {CAN_DATA_BIT_RATES:?}")
            }
            Self::Telemetry { max, got } => write!(f, "telemetry at {got} Hz, at most {max} Hz on this bus"),
            Self::NotCommanded(arm) => write!(f, "cyclic commands are not supported for arm {arm}"),
            Self::CommandTimeout { max, got } => write!(f, "command timeout {got} ms, allowed 1 to {max} ms"),
            Self::NoCanFd => f.write_str("CAN FD data bit rate on an adapter with classic CAN"),
            Self::NoCan => f.write_str("CAN settings on an adapter without CAN"),
        }
    }
}

impl core::error::Error for ConfigError {}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::string::ToString;

    use super::*;

    #[test]
    fn every_arm_kind_has_a_unique_name() {
        let names = ArmKind::ALL.map(|kind| kind.to_string());
        assert_eq!(names, ["ling", "alpha1", "alpha1-servo", "raw"]);
        assert_eq!(names, ArmKind::ALL.map(ArmKind::name));
    }

    #[test]
    fn telemetry_rate_is_limited_by_bus_and_polls() {
        let hertz = CAN_BIT_RATES.map(|bit_rate| {
            let can = Can {
                bit_rate,
                ..Can::default()
            };
            can.max_telemetry_hz()
        });
        // A sample has three frames of 135 bits at most, and 60 % of the bus.
        assert_eq!(hertz, [185, 370, 740, 1_000]);
    }

    #[test]
    fn unsupported_bus_settings_are_refused() {
        let timeout = |got| ConfigError::CommandTimeout { max: 10_000, got };
        let can = Can::default();
        let cases = [
            (
                Can {
                    bit_rate: 300_000,
                    ..can
                },
                ConfigError::BitRate(300_000),
            ),
            (
                Can {
                    data_bit_rate: Some(3_000_000),
                    ..can
                },
                ConfigError::DataBitRate(3_000_000),
            ),
            (
                Can {
                    telemetry_hz: 1_001,
                    ..can
                },
                ConfigError::Telemetry { max: 1_000, got: 1_001 },
            ),
            (
                Can {
                    command_timeout_ms: 0,
                    ..can
                },
                timeout(0),
            ),
            (
                Can {
                    command_timeout_ms: 10_001,
                    ..can
                },
                timeout(10_001),
            ),
        ];
        for (can, error) in cases {
            let config = Config {
                can,
                ..Config::default()
            };
            assert_eq!(config.check(), Err(error));
        }
        let mut config = Config::default();
        config.can.telemetry_hz = 1_000;
        (config.can.data_bit_rate, config.can.command_timeout_ms) = (Some(5_000_000), 10_000);
        assert_eq!(config.check(), Ok(()));
    }

    #[test]
    fn invalid_values_are_named_with_valid_ones() {
        let too_fast = Config {
            poll: Poll::Hertz(1_001),
            ..Config::default()
        };
        let error = too_fast.check().unwrap_err();
        assert_eq!(error.to_string(), "poll rate 1001 Hz, allowed 1 to 1000 Hz");
        let polled_raw = Config {
            arm: ArmKind::Raw,
            poll: Poll::Fastest,
            ..Config::default()
        };
        let error = polled_raw.check().unwrap_err();
        assert_eq!(error.to_string(), "polling is not supported for arm raw");
    }
}
