//! Arguments that several commands have: where an arm is, and which it is.

use std::num::NonZeroU32;
use std::path::Path;

use clap::{Args, ValueEnum};

use crate::control::ControlLink;
use crate::error::Error;
use crate::port::{Connection, Port};
use crate::tcp::Host;

/// The port and the kind of an arm.
#[derive(Args)]
pub(crate) struct Place {
    /// The serial port, such as /dev/ttyACM0 or COM3; or tcp:HOST:PORT, a server of one; or slcan:PORT@BITRATE/NODE, an
    /// adapter on the bus of an SLCAN adapter; or can:IFACE/NODE, on a CAN bus of Linux; or hid:, an alpha1 that is a HID
    /// device (hid:VID:PID or hid:NAME where there are several). For xarm the host, such as 192.168.1.10 or
    /// 192.168.1.10:502.
    pub(crate) port: String,
    /// Kind of arm.
    #[arg(long, value_enum, default_value_t)]
    pub(crate) arm: ArmKind,
    #[command(flatten)]
    pub(crate) baud: Baud,
    /// The adapter's control port, where it cannot be found from the arm's port, as that of a virtual board:
    /// control:PORT, or PORT alone.
    #[arg(long, value_name = "PORT", value_parser = Port::of_control)]
    pub(crate) control: Option<Port>,
}

impl Place {
    /// The port of any other arm.
    pub(crate) fn connect(&self) -> Result<Connection, Error> {
        let port: Port = self.port.parse().map_err(Error::Usage)?;
        port.connect(self.baud.baud)
    }

    /// The control port of the adapter there.
    pub(crate) fn control(&self, connection: &Connection) -> Result<ControlLink, Error> {
        match &self.control {
            Some(port) => port.connect(None)?.control(),
            None => connection.control(),
        }
    }

    /// The host that an xArm is on.
    pub(crate) fn host(&self) -> Result<Host, Error> {
        let refused = |option| Err(Error::Usage(format!("an xarm is on a host, which has no {option}")));
        let is_port = !matches!(self.port.parse(), Ok(Port::Serial(_))) || Path::new(&self.port).exists();
        match (self.baud.baud, &self.control) {
            (None, None) if is_port => Err(Error::Usage(format!(
                "an xarm is on a host, such as 192.168.1.10, and not on {}: is it another arm (--arm ling or alpha1)?",
                self.port
            ))),
            (None, None) => self.port.parse().map_err(Error::Usage),
            (Some(_), _) => refused("--baud"),
            (None, Some(_)) => refused("--control"),
        }
    }
}

/// The port of an arm.
#[derive(Args)]
pub(crate) struct ArmPort {
    /// The arm's serial port, such as /dev/ttyACM0 or COM3; or tcp:HOST:PORT, a server of one; or
    /// slcan:PORT@BITRATE/NODE, an adapter on the bus of an SLCAN adapter; or can:IFACE/NODE, on a CAN bus of Linux.
    port: Port,
    #[command(flatten)]
    baud: Baud,
}

impl ArmPort {
    pub(crate) fn connect(&self) -> Result<Connection, Error> {
        self.port.connect(self.baud.baud)
    }
}

/// The baud rate of a serial port.
#[derive(Args)]
pub(crate) struct Baud {
    /// Baud rate of the serial port. Default: 1000000 for ling, 115200 for alpha1. A ling arm of the older generation may
    /// need 921600.
    #[arg(long)]
    pub(crate) baud: Option<NonZeroU32>,
}

/// The arms there are.
#[derive(Clone, Copy, Debug, Default, ValueEnum)]
pub enum ArmKind {
    /// Ling / Alicia-D, on a serial port.
    #[default]
    Ling,
    /// UFACTORY xArm, on TCP.
    Xarm,
    /// UBTECH Alpha1, on a serial port or as a HID device.
    Alpha1,
}

/// The sender of bytes on an arm's line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Speaker {
    /// The program that controls the arm.
    Host,
    /// The arm.
    Arm,
}
