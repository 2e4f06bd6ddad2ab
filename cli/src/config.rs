//! `armwire config`: what an adapter is told to be.

use std::str::FromStr;

use armwire_bridge::can::Node;
use armwire_bridge::config::{ArmKind, Config, Poll};
use armwire_bridge::control::{Reply, Request};
use clap::{Args, Subcommand};
use serde_json::{Value, json};

use crate::adapter::{self, AdapterPort};
use crate::control::ControlLink;
use crate::error::Error;
use crate::output::{print, print_json};

/// The arguments of `armwire config`.
#[derive(Args)]
pub(crate) struct Configure {
    #[command(flatten)]
    adapter: AdapterPort,
    /// Print the configuration as one JSON object.
    #[arg(long, global = true)]
    json: bool,
    #[command(subcommand)]
    action: Option<Action>,
}

/// What is done. Each prints the configuration that is in force then.
#[derive(Clone, Subcommand)]
enum Action {
    /// Print the configuration in force, as `set` takes it. This is done unless you say otherwise.
    Show,
    /// Change settings, until the next start of the adapter unless they are saved.
    #[command(after_help = help())]
    Set {
        /// Such as poll=200 or can.node=3; `armwire config help set` lists them.
        #[arg(required = true, value_name = "KEY=VALUE", value_parser = setting)]
        settings: Vec<Setting>,
        /// Keep the whole configuration for later starts, too.
        #[arg(long)]
        save: bool,
    },
    /// Keep the configuration in force for later starts, too.
    Save,
    /// Forget what was saved, and be as from the factory.
    Reset,
}

/// One setting of an adapter.
struct Key {
    name: &'static str,
    /// What it is, and which values there are.
    help: &'static str,
    get: fn(&Config) -> Value,
    set: fn(&mut Config, &str) -> Result<(), String>,
}

/// All settings.
static KEYS: [Key; 11] = [
    Key {
        name: "arm",
        help: "what hangs on the UART: ling, alpha1, alpha1-servo or raw",
        get: |config| json!(config.arm.name()),
        set: |config, text| {
            let kind = ArmKind::ALL.into_iter().find(|kind| kind.name() == text);
            config.arm = kind.ok_or_else(|| "ling, alpha1, alpha1-servo or raw".to_owned())?;
            Ok(())
        },
    },
    Key {
        name: "poll",
        help: "how often the adapter asks the arm by itself: off, fastest, or a rate in hertz, 1 to 1000",
        get: |config| match config.poll {
            Poll::Off => json!("off"),
            Poll::Fastest => json!("fastest"),
            Poll::Hertz(hertz) => json!(hertz),
        },
        set: |config, text| {
            config.poll = match text {
                "off" => Poll::Off,
                "fastest" => Poll::Fastest,
                rate => Poll::Hertz(
                    rate.parse()
                        .map_err(|_| "off, fastest, or a rate in hertz, 1 to 1000")?,
                ),
            };
            Ok(())
        },
    },
    Key {
        name: "can.node",
        help: "which of the adapters on the bus this one is: 0 to 15",
        get: |config| json!(config.can.node.get()),
        set: |config, text| {
            let node = number(text, "a node id, 0 to 15")?;
            config.can.node = Node::new(node).map_err(|_| "a node id, 0 to 15")?;
            Ok(())
        },
    },
    Key {
        name: "can.bit-rate",
        help: "in bits per second: 125000, 250000, 500000 or 1000000",
        get: |config| json!(config.can.bit_rate),
        set: |config, text| {
            config.can.bit_rate = number(text, "a number of bits per second")?;
            Ok(())
        },
    },
    Key {
        name: "can.data-bit-rate",
        help: "CAN FD, on boards that have it, with its data phase in bits per second: off, 1000000, 2000000, 4000000 \
               or 5000000",
        get: |config| config.can.data_bit_rate.map_or(json!("off"), |rate| json!(rate)),
        set: |config, text| {
            config.can.data_bit_rate = match text {
                "off" => None,
                rate => Some(number(rate, "off, or a number of bits per second")?),
            };
            Ok(())
        },
    },
    Key {
        name: "can.telemetry-hz",
        help: "how often the arm's newest state goes out in cyclic frames: 0 for never, up to 1000",
        get: |config| json!(config.can.telemetry_hz),
        set: |config, text| {
            config.can.telemetry_hz = number(text, "a rate in hertz, 0 for never")?;
            Ok(())
        },
    },
    Key {
        name: "can.commands",
        help: "whether cyclic command frames move the arm: on or off",
        get: |config| json!(config.can.commands),
        set: |config, text| {
            config.can.commands = switch(text)?;
            Ok(())
        },
    },
    Key {
        name: "can.command-timeout-ms",
        help: "after how many milliseconds a stream of commands counts as ended: 1 to 10000",
        get: |config| json!(config.can.command_timeout_ms),
        set: |config, text| {
            config.can.command_timeout_ms = number(text, "a time in milliseconds, 1 to 10000")?;
            Ok(())
        },
    },
    Key {
        name: "can.unsolicited",
        help: "whether what the arm says unasked goes out on CAN: on or off",
        get: |config| json!(config.can.unsolicited),
        set: |config, text| {
            config.can.unsolicited = switch(text)?;
            Ok(())
        },
    },
    Key {
        name: "silence.after-ms",
        help: "after how many milliseconds a host that streamed motion counts as silent: 0 for never, up to 65535",
        get: |config| json!(config.host_timeout.after_ms),
        set: |config, text| {
            config.host_timeout.after_ms = number(text, "a time in milliseconds, 0 for never, up to 65535")?;
            Ok(())
        },
    },
    Key {
        name: "silence.torque-off",
        help: "whether the torque is switched off then, so that the arm may fall: on or off",
        get: |config| json!(config.host_timeout.torque_off),
        set: |config, text| {
            config.host_timeout.torque_off = switch(text)?;
            Ok(())
        },
    },
];

fn number<T: FromStr>(text: &str, what: &str) -> Result<T, String> {
    text.parse().map_err(|_| what.to_owned())
}

fn switch(text: &str) -> Result<bool, String> {
    match text {
        "on" | "true" => Ok(true),
        "off" | "false" => Ok(false),
        _ => Err("on or off".to_owned()),
    }
}

/// A setting as it was typed. The value can be read; whether the adapter can be like that, it says itself.
#[derive(Clone)]
struct Setting {
    key: &'static Key,
    value: String,
}

fn setting(text: &str) -> Result<Setting, String> {
    let (name, value) = text.split_once('=').ok_or("it has no =, as poll=200 has")?;
    let key = KEYS.iter().find(|key| key.name == name).ok_or_else(|| {
        let names: Vec<_> = KEYS.iter().map(|key| key.name).collect();
        format!("there is no setting '{name}'; there are: {}", names.join(", "))
    })?;
    (key.set)(&mut Config::default(), value).map_err(|wanted| format!("'{value}' is not {wanted}"))?;
    let value = value.to_owned();
    Ok(Setting { key, value })
}

/// What settings there are, in lines for 80 columns.
fn help() -> String {
    let lines = KEYS
        .iter()
        .map(|key| format!("  {}\n      {}\n", key.name, key.help.replace(": ", ":\n      ")));
    lines.fold("Settings:\n".to_owned(), |text, line| text + &line)
}

impl Configure {
    pub(crate) fn run(&self) -> Result<(), Error> {
        let mut control = self.adapter.open()?;
        match self.action.as_ref().unwrap_or(&Action::Show) {
            Action::Show => {}
            Action::Set { settings, save } => {
                let mut config = get(&mut control)?;
                for Setting { key, value } in settings {
                    (key.set)(&mut config, value).map_err(Error::Usage)?;
                }
                control.call(Request::SetConfig(config))?;
                control = self.follow(control, &config)?;
                if *save {
                    control.call(Request::SaveConfig)?;
                }
            }
            Action::Save => {
                control.call(Request::SaveConfig)?;
            }
            Action::Reset => {
                control.call(Request::ResetConfig)?;
                control = self.follow(control, &Config::default())?;
            }
        }
        adapter::tell_holder(&mut control)?;
        let config = get(&mut control)?;
        if self.json {
            return print_json(&object(&config));
        }
        print(&show(&config))
    }

    /// The adapter where it is on the CAN bus now that it is so.
    fn follow(&self, control: ControlLink, config: &Config) -> Result<ControlLink, Error> {
        let moved = self.adapter.moved(&config.can);
        if moved == self.adapter {
            return Ok(control);
        }
        // The port is opened once.
        drop(control);
        moved.open()
    }
}

/// The configuration in force.
pub(crate) fn get(control: &mut ControlLink) -> Result<Config, Error> {
    match control.call(Request::GetConfig)? {
        Reply::Config(config) => Ok(config),
        reply => Err(adapter::odd(control, &reply)),
    }
}

/// A configuration as a JSON object.
pub(crate) fn object(config: &Config) -> Value {
    let settings = KEYS.iter().map(|key| (key.name.to_owned(), (key.get)(config)));
    Value::Object(settings.collect())
}

/// A line for each setting, as `set` takes it.
fn show(config: &Config) -> String {
    let lines = KEYS.iter().map(|key| {
        let value = match (key.get)(config) {
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

    /// One that differs from the usual in every setting.
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
        let Setting { key, value } = setting(text).unwrap_or_else(|error| panic!("{error}"));
        (key.set)(config, &value).unwrap();
    }

    #[test]
    fn what_is_shown_can_be_set_again() {
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
            show(&shown).lines().for_each(|line| set(&mut config, line));
            assert_eq!(config, shown);
        }
    }

    #[test]
    fn document_has_every_can_setting_and_its_default() {
        const DOCUMENT: &str = include_str!("../../docs/can.md");
        let shown = show(&Config::default());
        for (name, value) in shown.lines().filter_map(|line| line.split_once('=')) {
            let is_row = |line: &&str| line.starts_with(&format!("| `{name}` | "));
            let row = DOCUMENT.lines().find(is_row);
            assert_eq!(row.is_some(), name.starts_with("can."), "{name}");
            let usual = row.and_then(|row| row.split(" | ").nth(2)).unwrap_or(value);
            assert!(usual.starts_with(value), "{name}: {usual}, not {value}");
        }
    }

    #[test]
    fn every_setting_has_a_line() {
        let (usual, unusual) = (show(&Config::default()), show(&UNUSUAL));
        assert_eq!(usual.lines().count(), KEYS.len());
        assert!(
            usual.lines().zip(unusual.lines()).all(|(a, b)| a != b),
            "{usual}\n{unusual}"
        );
        assert!(usual.starts_with("arm=ling\npoll=off\ncan.node=0\ncan.bit-rate=1000000\ncan.data-bit-rate=off\n"));
    }

    #[test]
    fn refused_settings_come_with_allowed_values() {
        for (text, told) in [
            (
                "speed=3",
                "there is no setting 'speed'; there are: arm, poll, can.node, can.bit-rate",
            ),
            ("poll", "it has no =, as poll=200 has"),
            (
                "poll=often",
                "'often' is not off, fastest, or a rate in hertz, 1 to 1000",
            ),
            ("arm=xarm", "'xarm' is not ling, alpha1, alpha1-servo or raw"),
            ("can.node=16", "'16' is not a node id, 0 to 15"),
            ("can.commands=yes", "'yes' is not on or off"),
            ("silence.after-ms=65536", "'65536' is not a time in milliseconds"),
            ("can.data-bit-rate=", "'' is not off, or a number"),
        ] {
            let error = setting(text).err().unwrap();
            assert!(error.starts_with(told), "{error}");
        }
    }
}
