//! The command line.

use std::collections::HashMap;
use std::net::Ipv4Addr;
use std::time::Duration;

use armwire::ling::JOINTS;
use armwire_host::Port;
use clap::{Parser, ValueEnum};

use crate::joint_states;
use crate::tolerances::DEFAULT_GOAL_TIME;
use crate::trajectory::{self, Joint};

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
    /// The names of an arm's joints; joint1 to joint6 and gripper by default.
    #[arg(long = "joints", value_name = "NAME=J1,J2,J3,J4,J5,J6,GRIPPER")]
    joints: Vec<String>,
    /// The range of a joint in trajectories, in rad. Without it, the range of the protocol, ±π less one tick.
    #[arg(long = "limit", value_name = "NAME/JOINT=MIN:MAX")]
    limits: Vec<String>,
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
    /// The six joints and the gripper. The arm reports the gripper's range.
    pub(crate) joints: Vec<Joint>,
    /// Time after the last point of a goal, by default, until the joints must be at it.
    pub(crate) goal_time: Duration,
    pub(crate) rate: u32,
    pub(crate) allow_set_zero: bool,
}

impl Options {
    /// Checks the options for consistency.
    ///
    /// # Errors
    ///
    /// The first inconsistent option, with the reason.
    pub(crate) fn checked(&self) -> Result<Checked, String> {
        let mut controls = by_name("--control", &self.controls)?;
        let mut joints = by_name("--joints", &self.joints)?;
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
            let names = match joints.remove(name) {
                Some(names) => joint_names(names).map_err(|error| format!("--joints {name}={names:?}: {error}"))?,
                None => joint_states::DEFAULT_NAMES.map(str::to_owned).to_vec(),
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
                joints: joint_states::joints(&names),
                goal_time: DEFAULT_GOAL_TIME,
                rate: self.rate,
                allow_set_zero: self.allow_set_zero,
            });
        }
        for (option, left) in [("--control", controls), ("--joints", joints)] {
            if let Some(name) = left.keys().next() {
                return Err(format!("{option} {name}=…: no --arm {name}=…"));
            }
        }
        for text in &self.limits {
            set_limit(&mut arms, text).map_err(|error| format!("--limit {text:?}: {error}"))?;
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

fn joint_names(text: &str) -> Result<Vec<String>, String> {
    let names: Vec<_> = text.split(',').map(str::to_owned).collect();
    let is_repeated = |nth: usize| names[..nth].contains(&names[nth]);
    if names.len() != JOINTS + 1 || names.iter().any(String::is_empty) {
        return Err("must be seven names, of six joints and the gripper".to_owned());
    }
    if let Some(name) = names.iter().find(|name| name.contains(char::is_control)) {
        return Err(format!("{name:?} contains a control character"));
    }
    match (0..names.len()).find(|&nth| is_repeated(nth)) {
        Some(nth) => Err(format!("{:?} is given twice", names[nth])),
        None => Ok(names),
    }
}

fn set_limit(arms: &mut [Arm], text: &str) -> Result<(), String> {
    let (name, range) = text.split_once('=').ok_or("= is missing")?;
    let (arm, joint) = name.split_once('/').ok_or("/ between arm and joint is missing")?;
    let (min, max) = range.split_once(':').ok_or(": in the range is missing")?;
    let number = |text: &str| text.parse::<f64>().map_err(|_| format!("{text:?} is not a number"));
    let (min, max) = trajectory::limit(number(min)?, number(max)?)?;
    let arm = arms
        .iter_mut()
        .find(|one| one.name == arm)
        .ok_or_else(|| format!("no --arm {arm}=…"))?;
    let joint = arm.joints[..JOINTS]
        .iter_mut()
        .find(|one| one.name == joint)
        .ok_or_else(|| format!("no joint {joint:?}"))?;
    (joint.min, joint.max) = (joint.min.max(min), joint.max.min(max));
    Ok(())
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
    use super::*;

    fn checked(args: &[&str]) -> Result<Checked, String> {
        let args = ["armwire-ros2"].iter().chain(args);
        Options::try_parse_from(args)
            .map_err(|error| error.to_string())?
            .checked()
    }

    #[test]
    fn arms_have_names_ports_joints_and_limits() {
        let checked = checked(&[
            "--arm=left=ling:/dev/ttyACM0",
            "--arm=right=ling:can:can0/3",
            "--control=left=/tmp/control",
            "--joints=right=a,b,c,d,e,f,g",
            "--limit=right/b=-1.5:1",
        ])
        .unwrap();
        assert_eq!(checked.address, Ipv4Addr::LOCALHOST);
        let [left, right] = &checked.arms[..] else {
            panic!("two arms")
        };
        assert_eq!(left.port, Port::Serial("/dev/ttyACM0".to_owned()));
        assert_eq!(left.control, Some(Port::Control("/tmp/control".to_owned())));
        assert_eq!(left.joints[0].name, "joint1");
        assert_eq!(
            (right.joints[1].name.as_str(), right.joints[1].min, right.joints[1].max),
            ("b", -1.5, 1.0)
        );
    }

    #[test]
    fn inconsistent_options_are_refused() {
        for (args, error) in [
            (&["--arm=left"][..], "= is missing"),
            (&["--arm=a=xarm:1.2.3.4"], "no other arm reports joint positions"),
            (&["--arm=a/b=ling:x"], "must have letters"),
            (&["--arm=a=ling:x", "--arm=a=ling:y"], "twice"),
            (&["--arm=a=ling:x", "--control=b=y"], "no --arm b"),
            (&["--arm=a=ling:x", "--joints=a=b"], "seven names"),
            (
                &["--arm=a=ling:x", "--joints=a=b,c,d,e,f,g,h\u{7}"],
                "a control character",
            ),
            (&["--arm=a=ling:x", "--arm=b=ling:x"], "a has the same port"),
            (
                &["--arm=a=ling:x", "--arm=b=ling:x", "--control=b=y"],
                "a has the same port",
            ),
            (&["--arm=a=ling:x", "--limit=a/joint9=0:1"], "no joint \"joint9\""),
            (&["--arm=a=ling:x", "--limit=a/joint1=1:0"], "the lower end first"),
            (&["--arm=a=ling:x", "--limit=a/joint1=0:NaN"], "the lower end first"),
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
