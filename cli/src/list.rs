//! `armwire list`: the ports of this computer, and the adapters and arms on them.

use armwire::alpha1;
use armwire::ling;
use armwire_bridge::config::ArmKind;
use armwire_host::describe::{Arm, Fact, line, object};
use armwire_host::{Adapter, Connection, Link, Options, Port, ports};
use clap::Args;
use serde_json::Value;

use crate::adapter::identity;
use crate::error::Error;
use crate::output::{print_json, print_line};

/// The arguments of `armwire list`.
#[derive(Args)]
pub(crate) struct List {
    /// Additional ports to query, such as a virtual arm's.
    ports: Vec<String>,
    /// Query every serial port and HID device, including devices that are not arms. By default only adapters are queried.
    #[arg(long)]
    ask: bool,
    /// Print a JSON array with an object for each port.
    #[arg(long)]
    json: bool,
}

impl List {
    pub(crate) fn run(&self) -> Result<(), Error> {
        let mut found = Vec::new();
        for there in ports() {
            let is_adapter = there.adapter.is_some();
            // On a bus, the node of an adapter is unknown.
            let is_asked = self.ask && !matches!(there.port, Port::Can { .. });
            self.show(
                &mut found,
                on_port(&there.port.to_string(), there.usb.as_ref(), is_adapter, is_asked),
            )?;
        }
        for port in &self.ports {
            self.show(&mut found, on_port(port, None, false, true))?;
        }
        match found.as_slice() {
            found if self.json => print_json(&Value::from(found)),
            [] => print_line("no ports: is the adapter plugged in?"),
            _ => Ok(()),
        }
    }

    /// Shows a port at once, and keeps it.
    fn show(&self, found: &mut Vec<Value>, port: Vec<Fact>) -> Result<(), Error> {
        found.push(object(&port).into());
        if self.json {
            return Ok(());
        }
        match port.as_slice() {
            [port] => print_line(&port.text),
            [port, rest @ ..] => print_line(format_args!("{}  {}", port.text, line(rest))),
            [] => Ok(()),
        }
    }
}

/// The description of a serial port, or of the arm on another port. `usb` is its name by its USB serial number.
fn on_port(name: &str, usb: Option<&Port>, is_adapter: bool, is_asked: bool) -> Vec<Fact> {
    let mut facts = vec![Fact::words("port", name)];
    facts.extend(usb.map(|usb| Fact::words("name", usb)));
    if !is_adapter && !is_asked {
        return facts;
    }
    let opened = name.parse::<Port>().and_then(|port| port.open(Options::default()));
    let described = match opened {
        Ok(connection) if is_adapter => on_adapter(&connection),
        Ok(connection) => arm(&connection),
        Err(error) => Err(error.into()),
    };
    facts.extend(described.unwrap_or_else(|error| vec![Fact::words("error", error)]));
    facts
}

/// The adapter, and the arm for which it is set.
fn on_adapter(connection: &Connection) -> Result<Vec<Fact>, Error> {
    let mut control: Adapter = connection.adapter()?;
    let mut facts = vec![identity(&control.identify()?)];
    let arm = control
        .config()
        .map_err(Error::from)
        .and_then(|config| match config.arm {
            ArmKind::Ling => ling(connection),
            ArmKind::Alpha1 => alpha1(connection),
            ArmKind::Alpha1Servo | ArmKind::Raw => Ok(Vec::new()),
        });
    // Without its arm, the adapter is still there.
    facts.extend(arm.unwrap_or_else(|error| vec![Fact::words("error", error)]));
    Ok(facts)
}

/// The arm on a port, of any kind.
fn arm(connection: &Connection) -> Result<Vec<Fact>, Error> {
    if connection.is_hid() {
        return alpha1(connection);
    }
    match ling(connection) {
        Err(Error::Host(armwire_host::Error::NoAnswer { .. })) => {}
        Err(Error::Host(armwire_host::Error::Legacy { .. })) => {
            return Ok(vec![Fact::words("arm", "Ling of the older generation")]);
        }
        known => return known,
    }
    match alpha1(connection) {
        Err(Error::Host(armwire_host::Error::NoAnswer { .. })) => Ok(vec![Fact::words("arm", "no answer")]),
        known => known,
    }
}

fn ling(connection: &Connection) -> Result<Vec<Fact>, Error> {
    answer(connection.ling()?.link(), &ling::Request::ReadInfo)
}

fn alpha1(connection: &Connection) -> Result<Vec<Fact>, Error> {
    answer(connection.alpha1()?.link(), &alpha1::Request::ReadHardwareVersion)
}

fn answer<P: Arm>(link: &mut Link<P>, request: &P::Request<'_>) -> Result<Vec<Fact>, Error> {
    let facts = link.call(request, |response| P::facts(&response))?;
    Ok(facts.unwrap_or_default())
}
