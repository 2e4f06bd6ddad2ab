//! The settings of an adapter, by their names.

use std::error;
use std::fmt::{self, Display, Formatter};
use std::str::FromStr;

use armwire_bridge::can::Node;
use armwire_bridge::config::{ArmKind, Config, Poll};
use armwire_bridge::control::Identity;
use serde_json::{Value, json};

use crate::error::outside::Outside;

/// One setting of an adapter.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct Key {
    /// The name.
    pub name: &'static str,
    /// The description.
    pub help: &'static str,
    /// The allowed values.
    pub values: &'static str,
    /// Its field of a configuration.
    field: fn(&mut Config) -> Field<'_>,
}

/// All settings. An adapter without CAN has none whose name begins with `can.`.
pub static KEYS: &[Key] = &[
    Key {
        name: "arm",
        help: "kind of arm on the UART",
        values: "ling, alpha1, alpha1-servo or raw",
        field: |config| Field::Arm(&mut config.arm),
    },
    Key {
        name: "poll",
        help: "rate of the adapter's own polls",
        values: "off, fastest, or a rate in hertz, 1 to 1000",
        field: |config| Field::Poll(&mut config.poll),
    },
    Key {
        name: "can.node",
        help: "number of this adapter on the bus",
        values: "a node id, 0 to 15",
        field: |config| Field::Node(&mut config.can.node),
    },
    Key {
        name: "can.bit-rate",
        help: "bit rate of the bus",
        values: "a number of bits per second: 125000, 250000, 500000 or 1000000",
        field: |config| Field::Long(&mut config.can.bit_rate),
    },
    Key {
        name: "can.data-bit-rate",
        help: "CAN FD, on boards that have it: bit rate of its data phase",
        values: "off, or a number of bits per second: 1000000, 2000000, 4000000, 5000000",
        field: |config| Field::DataBitRate(&mut config.can.data_bit_rate),
    },
    Key {
        name: "can.telemetry-hz",
        help: "rate of cyclic frames with the arm's newest state",
        values: "a rate in hertz, 0 for never, up to 1000",
        field: |config| Field::Short(&mut config.can.telemetry_hz),
    },
    Key {
        name: "can.commands",
        help: "whether cyclic command frames move the arm",
        values: "on or off",
        field: |config| Field::Switch(&mut config.can.commands),
    },
    Key {
        name: "can.command-timeout-ms",
        help: "silence that ends a stream of commands",
        values: "a time in milliseconds, 1 to 10000",
        field: |config| Field::Short(&mut config.can.command_timeout_ms),
    },
    Key {
        name: "can.unsolicited",
        help: "whether the arm's unsolicited frames go out on CAN",
        values: "on or off",
        field: |config| Field::Switch(&mut config.can.unsolicited),
    },
    Key {
        name: "host-timeout.after-ms",
        help: "pause after which a host that streamed motion counts as silent",
        values: "a time in milliseconds, 0 for never, up to 65535",
        field: |config| Field::Short(&mut config.host_timeout.after_ms),
    },
    Key {
        name: "host-timeout.torque-off",
        help: "switch the torque off at the host timeout: the arm may fall",
        values: "on or off",
        field: |config| Field::Switch(&mut config.host_timeout.torque_off),
    },
];

/// A setting in a configuration.
enum Field<'a> {
    Arm(&'a mut ArmKind),
    Poll(&'a mut Poll),
    Node(&'a mut Node),
    DataBitRate(&'a mut Option<u32>),
    Switch(&'a mut bool),
    Short(&'a mut u16),
    Long(&'a mut u32),
}

impl Key {
    /// Returns true if the adapter with this identity has the setting.
    pub fn is_of(&self, adapter: &Identity) -> bool {
        !(adapter.no_can && self.name.starts_with("can."))
    }

    fn get(&self, mut config: Config) -> Value {
        match (self.field)(&mut config) {
            Field::Arm(kind) => json!(kind.name()),
            Field::Poll(Poll::Hertz(rate)) => json!(rate),
            Field::Poll(Poll::Fastest) => json!("fastest"),
            Field::Poll(Poll::Off) | Field::DataBitRate(None) => json!("off"),
            Field::DataBitRate(Some(rate)) => json!(rate),
            Field::Node(node) => json!(node.get()),
            Field::Switch(is_on) => json!(is_on),
            Field::Short(number) => json!(number),
            Field::Long(number) => json!(number),
        }
    }

    /// Sets it to a typed value.
    ///
    /// # Errors
    ///
    /// [`SettingError::Value`] if the value does not exist, as far as this program can know.
    pub fn set(&self, config: &mut Config, text: &str) -> Result<(), SettingError> {
        let mut set = || {
            match ((self.field)(config), text) {
                (Field::Arm(kind), _) => *kind = ArmKind::ALL.into_iter().find(|kind| kind.name() == text)?,
                (Field::Poll(poll), "off") => *poll = Poll::Off,
                (Field::Poll(poll), "fastest") => *poll = Poll::Fastest,
                (Field::Poll(poll), _) => *poll = Poll::Hertz(text.parse().ok()?),
                (Field::DataBitRate(rate), "off") => *rate = None,
                (Field::DataBitRate(rate), _) => *rate = Some(text.parse().ok()?),
                (Field::Node(node), _) => *node = Node::new(text.parse().ok()?).ok()?,
                (Field::Switch(is_on), "on" | "true") => *is_on = true,
                (Field::Switch(is_on), "off" | "false") => *is_on = false,
                (Field::Switch(_), _) => return None,
                (Field::Short(number), _) => *number = text.parse().ok()?,
                (Field::Long(number), _) => *number = text.parse().ok()?,
            }
            Some(())
        };
        set().ok_or_else(|| SettingError::Value {
            key: self.name,
            value: text.into(),
            allowed: self.values,
        })
    }
}

/// A setting with a value, such as `poll=200`, [parsed](FromStr). The adapter checks the whole configuration.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Setting {
    /// The setting.
    pub key: &'static Key,
    /// The value, as typed.
    pub value: String,
}

impl Setting {
    /// Sets the value in `config`.
    ///
    /// # Errors
    ///
    /// [`SettingError::Value`] if the value does not exist. A parsed one does.
    pub fn apply(&self, config: &mut Config) -> Result<(), SettingError> {
        self.key.set(config, &self.value)
    }
}

impl FromStr for Setting {
    type Err = SettingError;

    fn from_str(text: &str) -> Result<Self, SettingError> {
        let (name, value) = text
            .split_once('=')
            .ok_or_else(|| SettingError::Form { text: text.into() })?;
        let mut keys = KEYS.iter();
        let key = keys
            .find(|key| key.name == name)
            .ok_or_else(|| SettingError::Name { name: name.into() })?;
        key.set(&mut Config::default(), value)?;
        let value = value.to_owned();
        Ok(Self { key, value })
    }
}

/// The reason why a text is no setting.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum SettingError {
    /// It is not `KEY=VALUE`.
    Form {
        /// The text.
        text: Outside,
    },
    /// There is no setting of this name: [`KEYS`] has all.
    Name {
        /// The name.
        name: Outside,
    },
    /// The setting does not have this value.
    Value {
        /// The name of the setting.
        key: &'static str,
        /// The value.
        value: Outside,
        /// The allowed values, in words.
        allowed: &'static str,
    },
}

impl Display for SettingError {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Form { .. } => f.write_str("expected KEY=VALUE, for example poll=200"),
            Self::Name { name } => {
                let names: Vec<_> = KEYS.iter().map(|key| key.name).collect();
                write!(f, "there is no setting '{name}'; there are: {}", names.join(", "))
            }
            Self::Value { value, allowed, .. } => write!(f, "'{value}' is not {allowed}"),
        }
    }
}

impl error::Error for SettingError {}

/// The settings of an adapter.
fn keys(adapter: &Identity) -> impl Iterator<Item = &'static Key> {
    KEYS.iter().filter(|key| key.is_of(adapter))
}

/// The configuration of an adapter as a JSON object.
pub fn object(config: &Config, adapter: &Identity) -> Value {
    let settings = keys(adapter).map(|key| (key.name.to_owned(), key.get(*config)));
    Value::Object(settings.collect())
}

/// A line for each setting of an adapter, as `set` takes it.
pub fn show(config: &Config, adapter: &Identity) -> String {
    let lines = keys(adapter).map(|key| {
        let value = match key.get(*config) {
            Value::String(text) => text,
            Value::Bool(true) => "on".to_owned(),
            Value::Bool(false) => "off".to_owned(),
            number => number.to_string(),
        };
        format!("{}={value}\n", key.name)
    });
    lines.collect()
}

#[cfg(test)]
mod tests {
    use armwire_bridge::config::{Can, HostTimeout};

    use super::*;

    /// A configuration that differs from the default in every setting.
    const UNUSUAL: Config = Config {
        arm: ArmKind::Alpha1,
        poll: Poll::Hertz(200),
        can: Can {
            node: Node::MAX,
            bit_rate: 500_000,
            data_bit_rate: Some(2_000_000),
            telemetry_hz: 100,
            commands: true,
            command_timeout_ms: 40,
            unsolicited: true,
        },
        host_timeout: HostTimeout {
            after_ms: 0,
            torque_off: true,
        },
    };

    fn set(config: &mut Config, text: &str) {
        let setting: Setting = text.parse().unwrap_or_else(|error| panic!("{error}"));
        setting.apply(config).unwrap();
    }

    #[test]
    fn shown_configuration_can_be_set_again() {
        for shown in [
            UNUSUAL,
            Config {
                poll: Poll::Fastest,
                ..UNUSUAL
            },
            Config::default(),
        ] {
            let mut config = Config {
                poll: Poll::Fastest,
                ..UNUSUAL
            };
            let lines = show(&shown, &Identity::default());
            lines.lines().for_each(|line| set(&mut config, line));
            assert_eq!(config, shown);
        }
    }

    #[test]
    fn every_setting_has_a_line() {
        let [usual, unusual] = [Config::default(), UNUSUAL].map(|config| show(&config, &Identity::default()));
        assert_eq!(usual.lines().count(), KEYS.len());
        assert!(
            usual.lines().zip(unusual.lines()).all(|(a, b)| a != b),
            "{usual}\n{unusual}"
        );
        assert!(usual.starts_with("arm=ling\npoll=off\ncan.node=0\ncan.bit-rate=1000000\ncan.data-bit-rate=off\n"));
    }

    #[test]
    fn adapter_without_can_has_no_can_settings() {
        let adapter = Identity {
            no_can: true,
            ..Identity::default()
        };
        let shown = "arm=ling\npoll=off\nhost-timeout.after-ms=500\nhost-timeout.torque-off=off\n";
        assert_eq!(show(&Config::default(), &adapter), shown);
        assert_eq!(
            object(&Config::default(), &adapter),
            json!({
                "arm": "ling", "poll": "off", "host-timeout.after-ms": 500, "host-timeout.torque-off": false
            })
        );
    }

    #[test]
    fn refused_settings_come_with_allowed_values() {
        for (text, expected) in [
            (
                "speed=3",
                "there is no setting 'speed'; there are: arm, poll, can.node, can.bit-rate",
            ),
            ("poll", "expected KEY=VALUE, for example poll=200"),
            (
                "poll=often",
                "'often' is not off, fastest, or a rate in hertz, 1 to 1000",
            ),
            ("arm=xarm", "'xarm' is not ling, alpha1, alpha1-servo or raw"),
            ("can.node=16", "'16' is not a node id, 0 to 15"),
            ("can.commands=yes", "'yes' is not on or off"),
            ("host-timeout.after-ms=65536", "'65536' is not a time in milliseconds"),
            ("can.data-bit-rate=", "'' is not off, or a number"),
        ] {
            let error = text.parse::<Setting>().unwrap_err();
            assert!(error.to_string().starts_with(expected), "{error}");
        }
    }

    #[test]
    fn refused_value_is_known_to_programs() {
        assert_eq!(
            "can.node=\x07".parse::<Setting>().unwrap_err(),
            SettingError::Value {
                key: "can.node",
                value: "\x07".into(),
                allowed: "a node id, 0 to 15",
            }
        );
    }
}
