//! Arguments that several commands have: where an arm is, and which it is.

use std::num::NonZeroU32;

use armwire::alpha1::Alpha1;
use armwire::ling::Ling;
use armwire::ling::legacy::Legacy;
use armwire::xarm::XArm;
use armwire_host::describe::Arm as _;
use armwire_host::{Connection, Options, Port, TcpAddress, has_serial_port};
use clap::{Args, ValueEnum};

use crate::adapter;
use crate::error::Error;
use crate::output::print_error;

/// The port and the kind of an arm.
#[derive(Args)]
pub(crate) struct Place {
    /// Port of the arm: a serial port (/dev/ttyACM0, COM3, or usb:SERIAL by its USB serial number), tcp:HOST:PORT (serial
    /// port server), can:IFACE/NODE (SocketCAN), slcan:PORT@BITRATE/NODE (SLCAN adapter), or hid: (Alpha1; hid:VID:PID or
    /// hid:NAME selects one of several). For xarm: HOST or HOST:PORT.
    pub(crate) port: String,
    /// Kind of arm.
    #[arg(long, value_enum, default_value_t)]
    pub(crate) arm: LiveArm,
    #[command(flatten)]
    pub(crate) baud: Baud,
    /// Control port of the adapter, if it is not found by the arm's port: usb:SERIAL/control, or control:PATH or
    /// PATH. A virtual board needs it, and a serial port of Windows or macOS.
    #[arg(long, value_name = "PORT", value_parser = Port::of_control)]
    pub(crate) control: Option<Port>,
}

impl Place {
    /// The port of any other arm, and of the adapter there.
    pub(crate) fn connect(&self) -> Result<Connection, Error> {
        let port: Port = self.port.parse()?;
        let connection = port.open(Options::default().with_baud(self.baud.baud))?;
        Ok(connection.with_control(self.control.clone()))
    }

    /// The host that an xArm is on.
    pub(crate) fn host(&self) -> Result<TcpAddress, Error> {
        let refused = |option| Err(Error::Usage(format!("{option} does not apply to an xarm")));
        let is_port = !matches!(self.port.parse(), Ok(Port::Serial(_))) || has_serial_port(&self.port);
        match (self.baud.baud, &self.control) {
            (None, None) if is_port => Err(Error::Usage(format!(
                "an xarm is on a host, such as 192.168.1.10, and not on {}: is it another arm (--arm ling or alpha1)?",
                self.port
            ))),
            (None, None) => Ok(self.port.parse()?),
            (Some(_), _) => refused("--baud"),
            (None, Some(_)) => refused("--control"),
        }
    }
}

/// The port of an arm.
#[derive(Args)]
pub(crate) struct ArmPort {
    /// Port of the arm: a serial port (/dev/ttyACM0, COM3, or usb:SERIAL by its USB serial number), tcp:HOST:PORT (serial
    /// port server), can:IFACE/NODE (SocketCAN), or slcan:PORT@BITRATE/NODE (SLCAN adapter).
    port: Port,
    #[command(flatten)]
    baud: Baud,
    /// Control port of the adapter, which is asked whether it is in recovery, and whether it refuses motion. The default is
    /// that of the arm's port; a virtual board needs control:PATH, and a serial port of Windows or macOS usb:SERIAL/control.
    #[arg(long, value_name = "PORT", value_parser = Port::of_control)]
    control: Option<Port>,
}

impl ArmPort {
    /// Opens the port. Warns of an adapter in recovery.
    pub(crate) fn connect(&self) -> Result<Connection, Error> {
        let connection = self.port.open(Options::default().with_baud(self.baud.baud))?;
        match &self.control {
            Some(port) => adapter::report_recovery(&mut port.open(Options::default())?.adapter()?)?,
            None => {
                if let Some(name) = connection.adapter_in_recovery() {
                    print_error(&format_args!("{name}: the adapter has {}", armwire_host::RECOVERY));
                }
            }
        }
        Ok(connection.with_control(self.control.clone()))
    }
}

/// The baud rate of a serial port.
#[derive(Args)]
pub(crate) struct Baud {
    /// Baud rate of the serial port. Default: 1000000 for ling, 115200 for alpha1. A ling arm of the older generation may
    /// need 921600.
    #[arg(long, value_parser = baud_rate)]
    pub(crate) baud: Option<NonZeroU32>,
}

fn baud_rate(text: &str) -> Result<NonZeroU32, &'static str> {
    text.parse().map_err(|_| "a baud rate is a number from 1 to 4294967295")
}

/// The arms on a port.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum LiveArm {
    /// Ling / Alicia-D, on a serial port.
    #[default]
    Ling,
    /// Ling / Alicia-D of the older generation, on a serial port. Nothing is sent to it.
    LingLegacy,
    /// UFACTORY xArm, on TCP.
    Xarm,
    /// UBTECH Alpha1, on a serial port or as a HID device.
    Alpha1,
}

/// The arms of recordings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum ArmKind {
    /// Ling / Alicia-D. The generation is detected.
    #[default]
    Ling,
    /// Ling / Alicia-D of the older generation.
    LingLegacy,
    /// UFACTORY xArm.
    Xarm,
    /// UBTECH Alpha1.
    Alpha1,
    /// The servo bus of a UBTECH Alpha1: one wire, both directions.
    Alpha1Servo,
}

impl ArmKind {
    /// The arm, in words.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Ling => Ling::NAME,
            Self::LingLegacy => Legacy::NAME,
            Self::Xarm => XArm::NAME,
            Self::Alpha1 => Alpha1::NAME,
            Self::Alpha1Servo => "the servo bus of an Alpha1",
        }
    }
}

/// The sender of bytes on an arm's line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Speaker {
    /// The program that controls the arm.
    Host,
    /// The arm.
    Arm,
}
