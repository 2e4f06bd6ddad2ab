//! The command line.

use std::collections::HashMap;
use std::net::Ipv4Addr;
use std::path::PathBuf;

use armwire_host::Port;
use armwire_host::joints_file::{self, Joints};
use clap::{Parser, ValueEnum};

/// Serve robot arms as ROS 2 nodes over DDS. Nothing leaves this computer unless an interface is named.
#[derive(Parser)]
#[command(name = "armwire-ros2", version, max_term_width = 100)]
pub(crate) struct Options {
    /// An arm: its name, which is its namespace, and its port as for 'armwire', such as left=ling:/dev/ttyACM0 or
    /// right=ling:can:can0/3. May be repeated.
    #[arg(long = "arm", required = true, value_name = "NAME=ling:PORT")]
    arms: Vec<String>,
    /// The control port of an arm's adapter, if it cannot be found by the arm's port.
    #[arg(long = "control", value_name = "NAME=PORT")]
    controls: Vec<String>,
    /// The file with the names, units, limits and tolerances of the joints. Without it: joint1 to joint6 in rad and
    /// gripper in m, with the limits of the protocol.
    #[arg(long, value_name = "FILE")]
    joints: Option<PathBuf>,
    /// Readings per second of an arm without an adapter. An adapter polls at its own rate.
    #[arg(long, default_value_t = 200, value_parser = clap::value_parser!(u32).range(1..=500))]
    rate: u32,
    /// The network interface to use, by name or IPv4 address.
    #[arg(long, default_value = "127.0.0.1")]
    interface: String,
    /// The DDS domain.
    #[arg(long, env = "ROS_DOMAIN_ID", default_value_t = 0, value_parser = clap::value_parser!(u16).range(..=232))]
    domain: u16,
    /// The middleware of the service clients. Each has its own format of requests.
    #[arg(long, value_enum, default_value_t = Rmw::Fastrtps)]
    rmw: Rmw,
    /// Allow set_zero, which changes an arm's zero position permanently and drops the arm.
    #[arg(long)]
    allow_set_zero: bool,
    /// Park the arms when the node ends: each goes slowly to the pose that 'armwire park --save' has saved for it, and its
    /// torque goes off there. A second Ctrl-C stops them, and they keep their torque. An arm without a saved pose is not
    /// served.
    #[arg(long)]
    park: bool,
}

/// ROS 2's middleware.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Rmw {
    /// rmw_fastrtps_cpp
    Fastrtps,
    /// rmw_cyclonedds_cpp
    Cyclonedds,
}

/// Consistent options.
#[derive(Debug)]
pub(crate) struct Checked {
    pub(crate) arms: Vec<Arm>,
    pub(crate) address: Ipv4Addr,
    pub(crate) domain: u16,
    pub(crate) rmw: Rmw,
}

/// One arm.
#[derive(Debug)]
pub(crate) struct Arm {
    pub(crate) name: String,
    pub(crate) port: Port,
    /// The adapter's control port, if it is not found from the arm's port.
    pub(crate) control: Option<Port>,
    pub(crate) joints: Joints,
    pub(crate) rate: u32,
    pub(crate) allow_set_zero: bool,
    /// The arm is parked at the end.
    pub(crate) park: bool,
}

impl Options {
    /// Checks the options for consistency.
    ///
    /// # Errors
    ///
    /// The first inconsistent option, with the reason.
    pub(crate) fn checked(&self) -> Result<Checked, String> {
        let mut controls = by_name("--control", &self.controls)?;
        let joints = self.joints.as_deref().map(joints_file::read).transpose();
        let mut joints = joints.map_err(|error| format!("--joints {error}"))?.unwrap_or_default();
        let mut arms: Vec<Arm> = Vec::new();
        for text in &self.arms {
            let (name, address) = split("--arm", text)?;
            if !is_name(name) {
                return Err(format!(
                    "--arm {text:?}: the name {name:?} must have letters, digits and _, a letter first"
                ));
            }
            if arms.iter().any(|arm| arm.name == name) {
                return Err(format!("--arm {name}: the name is given twice"));
            }
            let Some(port) = address.strip_prefix("ling:") else {
                return Err(format!(
                    "--arm {text:?}: the port must be ling:PORT; no other arm reports joint positions"
                ));
            };
            let wrong = |error: armwire_host::Error| format!("--arm {text:?}: {error}");
            let port = port.parse().map_err(wrong)?;
            let control = controls.remove(name).map(Port::of_control).transpose().map_err(wrong)?;
            if let Some(other) = arms.iter().find(|arm| arm.port == port) {
                return Err(format!("--arm {text:?}: {} has the same port", other.name));
            }
            arms.push(Arm {
                name: name.to_owned(),
                port,
                control,
                joints: joints.remove(name).unwrap_or_default(),
                rate: self.rate,
                allow_set_zero: self.allow_set_zero,
                park: self.park,
            });
        }
        if let Some(name) = controls.keys().next() {
            return Err(format!("--control {name}=…: no --arm {name}=…"));
        }
        // A misspelt name must not leave an arm without its limits.
        if let Some(name) = joints.keys().next() {
            return Err(format!(
                "--joints: the file has the arm {name:?}, but there is no --arm {name}=…"
            ));
        }
        let address = interface(&self.interface)?;
        Ok(Checked {
            arms,
            address,
            domain: self.domain,
            rmw: self.rmw,
        })
    }
}

/// The text before the first `=`, and the text after it.
fn split<'a>(option: &str, text: &'a str) -> Result<(&'a str, &'a str), String> {
    text.split_once('=')
        .ok_or_else(|| format!("{option} {text:?}: = is missing"))
}

fn by_name<'a>(option: &str, texts: &'a [String]) -> Result<HashMap<&'a str, &'a str>, String> {
    let mut all = HashMap::new();
    for text in texts {
        let (name, value) = split(option, text)?;
        if all.insert(name, value).is_some() {
            return Err(format!("{option} {name}: given twice"));
        }
    }
    Ok(all)
}

/// Returns true if the name is valid as a part of a ROS 2 topic's name.
fn is_name(name: &str) -> bool {
    name.starts_with(|first: char| first.is_ascii_alphabetic())
        && name.chars().all(|char| char.is_ascii_alphanumeric() || char == '_')
        && !name.contains("__")
}

/// The IPv4 address of an interface of this computer.
fn interface(text: &str) -> Result<Ipv4Addr, String> {
    let interfaces = netdev::get_interfaces();
    let address: Option<Ipv4Addr> = text.parse().ok();
    for interface in &interfaces {
        let mut addresses = interface.ipv4.iter().map(|net| net.addr());
        let found = match address {
            Some(address) => addresses.find(|own| *own == address),
            None if interface.name == text => addresses.next(),
            None => None,
        };
        if let Some(found) = found {
            return Ok(found);
        }
    }
    let names: Vec<_> = interfaces.iter().map(|interface| &*interface.name).collect();
    Err(format!(
        "--interface {text:?}: no interface of this computer with an IPv4 address has this name or address: {}",
        names.join(", ")
    ))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn checked(args: &[&str]) -> Result<Checked, String> {
        let args = ["armwire-ros2"].iter().chain(args);
        Options::try_parse_from(args)
            .map_err(|error| error.to_string())?
            .checked()
    }

    /// A file of joints with this text.
    fn joints(text: &str) -> PathBuf {
        let name = format!("armwire-ros2-{}-{}.toml", std::process::id(), text.len());
        let path = std::env::temp_dir().join(name);
        fs::write(&path, text).unwrap();
        path
    }

    #[test]
    fn arms_have_names_ports_joints_and_limits() {
        let file = joints("[right.joints]\njoint2 = { name = \"b\", min = -1.5, max = 1 }");
        let checked = checked(&[
            "--arm=left=ling:/dev/ttyACM0",
            "--arm=right=ling:can:can0/3",
            "--control=left=/tmp/control",
            &format!("--joints={}", file.display()),
        ])
        .unwrap();
        assert_eq!(checked.address, Ipv4Addr::LOCALHOST);
        let [left, right] = &checked.arms[..] else {
            panic!("two arms")
        };
        assert_eq!(left.port, Port::Serial("/dev/ttyACM0".to_owned()));
        assert_eq!(left.control, Some(Port::Control("/tmp/control".to_owned())));
        assert_eq!(left.joints, Joints::default());
        let joint = &right.joints.all[1];
        assert_eq!((&*joint.name, joint.min, joint.max), ("b", -1.5, 1.0));
    }

    #[test]
    fn inconsistent_options_are_refused() {
        let file = joints("[lefft]");
        let other_arm = format!("--joints={}", file.display());
        for (args, error) in [
            (
                &["--arm=left=ling:x", &*other_arm][..],
                "has the arm \"lefft\", but there is no --arm lefft",
            ),
            (
                &["--arm=a=ling:x", "--joints=/nowhere/joints.toml"],
                "--joints /nowhere/joints.toml: No such file",
            ),
            (&["--arm=left"], "= is missing"),
            (&["--arm=a=xarm:1.2.3.4"], "no other arm reports joint positions"),
            (&["--arm=a/b=ling:x"], "must have letters"),
            (&["--arm=a=ling:x", "--arm=a=ling:y"], "twice"),
            (&["--arm=a=ling:x", "--control=b=y"], "no --arm b"),
            (&["--arm=a=ling:x", "--arm=b=ling:x"], "a has the same port"),
            (
                &["--arm=a=ling:x", "--arm=b=ling:x", "--control=b=y"],
                "a has the same port",
            ),
            (
                &["--arm=a=ling:x", "--interface=192.0.2.1"],
                "no interface of this computer",
            ),
        ] {
            let text = checked(args).unwrap_err();
            assert!(text.contains(error), "{text}");
        }
    }
}
