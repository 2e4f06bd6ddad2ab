//! An adapter on the command line: its port, and the reservation of its line.

use armwire_bridge::config::Can;
use armwire_bridge::slcan::BitRate;
use armwire_host::{Adapter, Options, Port, RECOVERY, has_serial_port, line_reservation};
use clap::Args;

use crate::error::Error;
use crate::output::print_error;
use crate::remedies::words;

pub(crate) use armwire_host::adapter::{describe, histogram_json, histograms, identity, limit, percentile, total};

/// The port of an adapter.
#[derive(Args, Debug, PartialEq, Eq)]
pub(crate) struct AdapterPort {
    /// Port of the adapter: a serial port (/dev/ttyACM0, COM3, or usb:SERIAL by its USB serial number), usb:SERIAL/control (its
    /// control port alone), can:IFACE/NODE (SocketCAN), slcan:PORT@BITRATE/NODE (SLCAN adapter), or control:PATH (control
    /// port of a virtual board).
    port: Port,
    /// Control port of the adapter, if it is not found by its serial port: usb:SERIAL/control, or control:PATH or PATH. A
    /// virtual board needs it, and a serial port of Windows or macOS.
    #[arg(long, value_name = "PORT", value_parser = Port::of_control)]
    control: Option<Port>,
}

impl AdapterPort {
    /// The port after the adapter has this configuration of the CAN bus.
    pub(crate) fn moved(&self, can: &Can) -> Self {
        let port = match self.named().clone() {
            Port::Can { interface, .. } => Port::Can {
                interface,
                node: can.node,
            },
            Port::Slcan { port, bit_rate, .. } => Port::Slcan {
                port,
                bit_rate: BitRate::new(can.bit_rate).unwrap_or(bit_rate),
                node: can.node,
            },
            other => other,
        };
        match self.control {
            None => Self { port, control: None },
            Some(_) => Self {
                port: self.port.clone(),
                control: Some(port),
            },
        }
    }

    /// The port by which the adapter is reached.
    fn named(&self) -> &Port {
        self.control.as_ref().unwrap_or(&self.port)
    }

    /// The name of a virtual board's port. A real adapter has no control port with a path of its own.
    pub(crate) fn virtual_board(&self) -> Option<String> {
        matches!(self.named(), Port::Control(_)).then(|| self.named().to_string())
    }

    /// Opens the adapter's control port.
    pub(crate) fn open(&self) -> Result<Adapter, Error> {
        let port = self.named();
        match (port.open(Options::default())?.adapter(), port) {
            // The error is the missing port, and not its missing control port.
            (Err(armwire_host::Error::NoControl { .. }), Port::Serial(port)) if !has_serial_port(port) => {
                Err(Port::not_found(port).into())
            }
            (opened, _) => Ok(opened?),
        }
    }
}

/// Reports the reservation of the line on standard error, if there is one.
pub(crate) fn report_reservation(control: &mut Adapter) -> Result<(), Error> {
    if let Some(reservation) = control.line()?.as_ref().and_then(line_reservation::describe) {
        print_error(&format_args!(
            "{}: the line runs at {}",
            control.name(),
            reservation.with(words)
        ));
    }
    Ok(())
}

/// Warns on standard error of an adapter in recovery.
pub(crate) fn report_recovery(control: &mut Adapter) -> Result<(), Error> {
    if control.is_in_recovery()? {
        print_error(&format_args!("{}: the adapter has {RECOVERY}", control.name()));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use armwire_bridge::can::Node;

    use super::*;

    #[test]
    fn configuration_moves_an_adapter_on_can() {
        let can = Can {
            node: Node::MAX,
            bit_rate: 250_000,
            ..Can::default()
        };
        for (before, after) in [
            ("can:can0/3", "can:can0/15"),
            ("slcan:/dev/ttyACM1@500000/2", "slcan:/dev/ttyACM1@250000/15"),
            ("/dev/ttyACM0", "/dev/ttyACM0"),
        ] {
            let port = |text: &str| AdapterPort {
                port: text.parse().unwrap(),
                control: None,
            };
            assert_eq!(port(before).moved(&can), port(after));
            let control = |text: &str| AdapterPort {
                port: "can:can1/3".parse().unwrap(),
                control: Some(text.parse().unwrap()),
            };
            assert_eq!(control(before).moved(&can), control(after));
        }
    }
}
