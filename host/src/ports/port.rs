//! The port of an arm or an adapter: its text, and the connection to it.

use std::fmt;
use std::num::NonZeroU32;
use std::path::Path;
use std::str::FromStr;

use armwire::ling::legacy::Legacy;
use armwire::{Config, time};
use armwire_bridge::can::{Function, Node};
use armwire_bridge::slcan::{BIT_RATES, BitRate};

use crate::describe::{Arm, Protocol};
use crate::error::Error;
use crate::error::received::Missing;
use crate::error::text::{Remedy, Text};
use crate::ports::can::{self, CanLine, SharedBus};
use crate::ports::control::Adapter;
use crate::ports::control::usb::UsbLine;
use crate::ports::hid::{self, Selector};
use crate::ports::line::Line;
use crate::ports::line_reservation;
use crate::ports::link::Link;
use crate::ports::port_user::{self, User};
use crate::ports::raw_port::RawPort;
use crate::ports::serial::{self, Serial};
use crate::ports::system;
use crate::ports::tcp::{Tcp, TcpAddress};
use crate::ports::usb_name;

/// Maximum delay that a server adds to an answer, and the stale window behind it.
const TCP: Config = Config::TCP;
/// Maximum delay that CAN adds to an answer: its frames at 125 kbit/s, and the turns of other hosts.
const CAN_LATENCY: time::Duration = time::Duration::from_millis(100);
/// Default bit rate of a CAN bus: the default of an adapter.
const BIT_RATE: BitRate = BitRate::MAX;
/// Default baud rate of an SLCAN adapter. An adapter on USB ignores it.
const SLCAN_BAUD: u32 = 115_200;

/// Baud rate of a control port of its own, which ignores it.
const CONTROL_BAUD: u32 = 115_200;

/// A connection to a port by its text, such as `/dev/ttyUSB0`: see [`Port`]. Nothing but a bus is opened yet: see
/// [`Port::open`].
///
/// # Errors
///
/// The text is no port, or the CAN bus cannot be opened.
pub fn open(port: &str) -> Result<Connection, Error> {
    let port: Port = port.parse()?;
    port.open(Options::default())
}

/// Options for opening a port.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Options {
    /// Baud rate of this computer's serial port. The default is the arm's.
    pub baud: Option<NonZeroU32>,
}

impl Options {
    /// The options with this baud rate.
    #[must_use]
    pub const fn with_baud(self, baud: Option<NonZeroU32>) -> Self {
        Self { baud }
    }
}

/// A port: its text, such as `can:can0/3`, [parsed](FromStr).
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Port {
    /// A serial port of the system: its path, such as `/dev/ttyACM0` or `COM3`, or that of a pty. Or `usb:SERIAL`: the
    /// only one whose USB device has this serial number, looked up at each opening.
    Serial(String),
    /// `tcp:HOST:PORT`: a server of a serial port.
    Tcp(TcpAddress),
    /// `can:IFACE[/NODE]`: an adapter on a CAN bus of Linux.
    Can {
        /// The interface, such as `can0`.
        interface: String,
        /// The adapter's node id.
        node: Node,
    },
    /// `slcan:PORT[@BITRATE][/NODE]`: an adapter on the bus of a CAN adapter with the SLCAN protocol.
    Slcan {
        /// The serial port of the CAN adapter.
        port: String,
        /// The bit rate of the bus.
        bit_rate: BitRate,
        /// The adapter's node id.
        node: Node,
    },
    /// `hid:`, `hid:VID:PID` or `hid:NAME`: an Alpha1 as a HID device on USB.
    Hid(Selector),
    /// `control:PORT`: only the control port, on a port of its own, as the virtual board has it.
    Control(String),
    /// `usb:SERIAL/control`: only the control port of the adapter on USB with this serial number.
    UsbControl(String),
}

/// [`Error::Port`] if the text names no port.
impl FromStr for Port {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        parse(text).map_err(|reason| Error::Port(reason.into()))
    }
}

/// The port of this text, or the reason why it is none.
fn parse(text: &str) -> Result<Port, String> {
    let Some((kind, rest)) = text.split_once(':') else {
        return Ok(Port::Serial(non_empty(text, text)?));
    };
    Ok(match kind {
        "tcp" => Port::Tcp(TcpAddress::parse(rest, None)?),
        "can" => {
            let (interface, node) = split_node(rest)?;
            let interface = non_empty(interface, text)?;
            Port::Can { interface, node }
        }
        "slcan" => {
            let (port, bit_rate, node) = match rest.rsplit_once('@') {
                Some((port, bus)) => {
                    let (rate, node) = split_node(bus)?;
                    let bit_rate = rate.parse().ok().and_then(BitRate::new).ok_or_else(|| {
                        let rates = BIT_RATES.map(|rate| rate.to_string()).join(", ");
                        format!("'{text}': bit rate '{rate}' is not an SLCAN bit rate: {rates}")
                    })?;
                    (port, bit_rate, node)
                }
                None if ends_with_node(rest) => {
                    let (port, node) = split_node(rest)?;
                    (port, BIT_RATE, node)
                }
                None => (rest, BIT_RATE, Node::default()),
            };
            let port = non_empty(port, text)?;
            Port::Slcan { port, bit_rate, node }
        }
        "hid" => Port::Hid(Selector::parse(rest)),
        "usb" => match rest.strip_suffix(usb_name::CONTROL) {
            Some(serial) => Port::UsbControl(non_empty(serial, text)?),
            None => Port::Serial(usb_name::name_of(&non_empty(rest, text)?)),
        },
        "control" => Port::Control(non_empty(rest, text)?),
        // A path may contain colons, for example under /dev/serial/by-path.
        _ => Port::Serial(text.to_owned()),
    })
}

/// The name of the port in `text`. An empty name is an error.
fn non_empty(name: &str, text: &str) -> Result<String, String> {
    match name {
        "" => Err(format!("'{text}': the port's name is missing")),
        name => Ok(name.to_owned()),
    }
}

/// Splits the text at the last slash into its front and the node. The default is node 0.
fn split_node(text: &str) -> Result<(&str, Node), String> {
    let Some((front, node)) = text.rsplit_once('/') else {
        return Ok((text, Node::default()));
    };
    let number: u8 = node.parse().map_err(|_| {
        format!(
            "'{node}' after the last slash is not a node id, 0 to {}",
            Node::MAX.get()
        )
    })?;
    Ok((front, Node::new(number).map_err(|error| error.to_string())?))
}

/// Returns true if a node follows the last slash. After a folder, such as /dev/pts, the number is part of the path.
fn ends_with_node(text: &str) -> bool {
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    text.rsplit_once('/')
        .is_some_and(|(front, node)| is_number(node) && !Path::new(front).is_dir())
}

/// The text that is parsed, completed by the defaults. Node 0 is left out.
impl fmt::Display for Port {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let node = match self {
            Self::Serial(port) => return f.write_str(port),
            Self::Tcp(host) => return write!(f, "tcp:{host}"),
            Self::Hid(selector) => return write!(f, "hid:{selector}"),
            Self::Control(port) => return write!(f, "control:{port}"),
            Self::UsbControl(serial) => return f.write_str(&usb_name::control_name_of(serial)),
            Self::Can { interface, node } => {
                write!(f, "can:{interface}")?;
                node
            }
            Self::Slcan { port, bit_rate, node } => {
                write!(f, "slcan:{port}@{}", bit_rate.bits_per_second())?;
                node
            }
        };
        match node.get() {
            0 => Ok(()),
            node => write!(f, "/{node}"),
        }
    }
}

impl Port {
    /// The error of a serial port that this computer does not have.
    pub fn not_found(name: &str) -> Error {
        serial::not_found(name)
    }

    /// Parses the text of a control port: a path alone is the path of a control port, and `usb:SERIAL` the adapter's.
    ///
    /// # Errors
    ///
    /// [`Error::Port`] if the text names no port.
    pub fn of_control(text: &str) -> Result<Self, Error> {
        Ok(match text.parse()? {
            Self::Serial(port) => match usb_name::serial_in(&port) {
                Some(serial) => Self::UsbControl(serial.to_owned()),
                None => Self::Control(port),
            },
            other => other,
        })
    }

    /// Opens the bus of a port on CAN. Any other port is opened with its arm or its control port, and is not touched
    /// before.
    ///
    /// # Errors
    ///
    /// The bus cannot be opened. [`Error::Baud`] if the port has no baud rate to set.
    pub fn open(&self, options: Options) -> Result<Connection, Error> {
        let Options { baud } = options;
        if baud.is_some() && !matches!(self, Self::Serial(_) | Self::Slcan { .. }) {
            return Err(Error::Baud {
                name: self.to_string().into(),
            });
        }
        let bus = match self {
            Self::Serial(_) | Self::Tcp(_) | Self::Hid(_) | Self::Control(_) | Self::UsbControl(_) => None,
            Self::Can { interface, node } => Some(can::open_interface(self.to_string(), interface, *node)?),
            Self::Slcan { port, bit_rate, .. } => {
                let serial = Serial::open(port, baud.map_or(SLCAN_BAUD, NonZeroU32::get))?;
                Some(can::open_slcan(serial, *bit_rate)?)
            }
        };
        let port = self.clone();
        Ok(Connection {
            port,
            baud,
            bus,
            control: None,
        })
    }
}

/// A port to open an arm, a [device of your own](Self::raw) or an adapter on. On CAN it has the open bus, which a clone
/// shares, with one arm or device and one control port at a time: a second is [`Error::InUse`].
#[derive(Clone)]
pub struct Connection {
    port: Port,
    baud: Option<NonZeroU32>,
    /// The bus of a port on CAN.
    bus: Option<SharedBus>,
    /// The adapter's control port, if it is not found by the arm's port.
    control: Option<Port>,
}

impl fmt::Debug for Connection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Connection")
            .field("port", &self.port)
            .field("baud", &self.baud)
            .finish_non_exhaustive()
    }
}

impl Connection {
    /// Returns true for a control port without an arm.
    pub fn is_control(&self) -> bool {
        matches!(self.port, Port::Control(_) | Port::UsbControl(_))
    }

    /// Returns true for a HID device. Only an Alpha1 is one.
    pub fn is_hid(&self) -> bool {
        matches!(self.port, Port::Hid(_))
    }

    /// Opens the line of a Ling arm of the older generation. It is only read:
    /// [`responses`](Link::responses) returns what it sends, and nothing can be sent to it.
    ///
    /// # Errors
    ///
    /// The line cannot be opened.
    pub fn legacy(&self) -> Result<Link<Legacy>, Error> {
        self.arm()
    }

    /// Opens the line of an arm, other than a [Ling arm](Self::ling).
    pub(crate) fn arm<P: Arm>(&self) -> Result<Link<P>, Error> {
        let (line, config) = self.line::<P>()?;
        Ok(Link::new(line, config))
    }

    /// Opens the port for a protocol of your own, and returns it with the timing of its line, for a
    /// [`Client`](armwire::Client).
    ///
    /// `usual` is the timing on a serial port. Its baud rate is the default of [`Options::baud`]. TCP and CAN add their
    /// delay, and TCP makes the stale window a second at least. There the baud rate is that of the line behind the
    /// server or the adapter, and sets nothing: the client's timeouts have the time of the bytes at this rate. On CAN
    /// the adapter must be set to `raw`, and a request has at most [`MAX_FRAME`](armwire_bridge::control::MAX_FRAME)
    /// bytes.
    ///
    /// A serial port has 8 data bits, no parity and 1 stop bit. It is locked, and bytes that arrived before are discarded.
    ///
    /// ```
    /// use armwire::{Client, Config, Output};
    /// use armwire_host::stopwatch::Stopwatch;
    /// # use armwire::ling::{Ling, MAX_FRAME, Request};
    ///
    /// # fn read(port: &str) -> Result<(), Box<dyn std::error::Error>> {
    /// let (mut port, config) = armwire_host::open(port)?.raw(Config::DEFAULT)?;
    /// let mut client = Client::<Ling, MAX_FRAME>::new(Ling, config); // any `Messages`
    /// let clock = Stopwatch::start();
    /// client.submit(&Request::ReadJoints)?;
    /// loop {
    ///     let wait = match client.poll(clock.now()) {
    ///         Output::Receive => std::time::Duration::ZERO,
    ///         Output::Timeout(until) => until.map_or(std::time::Duration::MAX, |until| clock.until(until)),
    ///         Output::Transmit(bytes) => {
    ///             let n = port.write(bytes)?;
    ///             client.transmitted(clock.now(), n)?;
    ///             continue;
    ///         }
    ///         Output::Event(event) => return Ok(println!("{event:?}")),
    ///     };
    ///     let n = port.read(client.space(), wait)?;
    ///     client.received(clock.now(), n)?;
    /// }
    /// # }
    /// ```
    ///
    /// # Errors
    ///
    /// The port cannot be opened. [`Error::InUse`] if another program has locked it, [`Error::Port`] if it has no line: a
    /// HID device, or a control port.
    pub fn raw(&self, usual: Config) -> Result<(RawPort, Config), Error> {
        let (line, config) = self.open_line(usual)?;
        Ok((RawPort::new(line), config))
    }

    /// Opens the arm's line, and returns its timing.
    pub(crate) fn line<P: Arm>(&self) -> Result<(Box<dyn Line>, Config), Error> {
        match &self.port {
            Port::Hid(selector) if P::ON_HID => Ok((hid::open(selector)?, P::CONFIG)),
            Port::Hid(_) => {
                let text = Text::from(format!("{} is a HID device, and only an alpha1 is one", self.port));
                Err(Error::Port(text.remedy(Remedy::OpenAs(Protocol::Alpha1))))
            }
            _ => self.open_line(P::CONFIG).map_err(|error| match (&self.port, error) {
                (Port::Serial(port), Error::At { name, reason }) if serial::is_host(port) => Error::At {
                    name,
                    reason: reason
                        .and("; is it an xarm's host")
                        .remedy(Remedy::OpenAs(Protocol::Xarm))
                        .and("?"),
                },
                (_, error) => error,
            }),
        }
    }

    /// Opens the line of a protocol with this timing on a serial port, and returns its timing on this port.
    fn open_line(&self, usual: Config) -> Result<(Box<dyn Line>, Config), Error> {
        Ok(match &self.port {
            Port::Serial(port) => {
                let Some(baud) = self.baud.or(usual.baud) else {
                    return Err(Error::at(port, "a serial port needs a baud rate"));
                };
                let config = Config {
                    baud: Some(baud),
                    ..usual
                };
                (Box::new(Serial::open(port, baud.get())?), config)
            }
            Port::Tcp(host) => {
                let config = Config {
                    latency: usual.latency + TCP.latency,
                    stale_window: usual.stale_window.max(TCP.stale_window),
                    ..usual
                };
                (Box::new(Tcp::connect(host, true)?), config)
            }
            Port::Can { node, .. } | Port::Slcan { node, .. } => {
                let line = self.on_can(*node, Function::ArmRequest, Function::ArmAnswer)?;
                let latency = usual.latency + CAN_LATENCY;
                (Box::new(line), Config { latency, ..usual })
            }
            Port::Hid(_) => {
                let text = format!("{} is a HID device, which has no line", self.port);
                return Err(Error::Port(text.into()));
            }
            Port::Control(_) | Port::UsbControl(_) => {
                let text = format!("{} is a control port: only its adapter is on it", self.port);
                return Err(Error::Port(text.into()));
            }
        })
    }

    /// Opens the bus of a port on CAN again, after everything else on the old one was closed. Does nothing otherwise.
    pub(crate) fn reopen(&mut self) -> Result<(), Error> {
        if let Port::Can { .. } | Port::Slcan { .. } = self.port {
            self.bus = None;
            self.bus = self.port.open(Options::default().with_baud(self.baud))?.bus;
        }
        Ok(())
    }

    /// The connection to an adapter whose control port is this one, such as a virtual board's.
    #[must_use]
    pub fn with_control(self, control: Option<Port>) -> Self {
        Self { control, ..self }
    }

    /// Opens the adapter's control port. On CAN it is on the bus of the arm.
    ///
    /// # Errors
    ///
    /// [`Error::NoControl`] if the port has no control port, or if the system does not show whose it is: no adapter is asked
    /// by a guess. The control port cannot be opened. On CAN, [`Error::InUse`] while this connection has one.
    pub fn adapter(&self) -> Result<Adapter, Error> {
        if let Some(control) = &self.control {
            return control.open(Options::default())?.adapter();
        }
        match &self.port {
            Port::Serial(port) => Ok(Adapter::on_line(Box::new(UsbLine::open(port)?))),
            Port::UsbControl(serial) => Ok(Adapter::on_line(Box::new(UsbLine::open_by_serial(
                self.port.to_string(),
                serial,
            )?))),
            Port::Control(port) => Ok(Adapter::on_line(Box::new(Serial::open(port, CONTROL_BAUD)?))),
            Port::Can { node, .. } | Port::Slcan { node, .. } => {
                let line = self.on_can(*node, Function::ControlRequest, Function::ControlAnswer)?;
                Ok(Adapter::new(Box::new(line)))
            }
            Port::Tcp(_) | Port::Hid(_) => Err(Error::no_adapter(&self.port.to_string())),
        }
    }

    /// The name of the adapter on this port, if it is in [recovery](crate::RECOVERY). `None` if that cannot be known: the
    /// port has no adapter, another program has its control port, or it is on CAN, where an adapter in recovery is silent.
    pub fn adapter_in_recovery(&self) -> Option<String> {
        let Port::Serial(_) = &self.port else {
            return None;
        };
        let mut control = self.adapter().ok()?;
        let is_in_recovery = control.is_in_recovery().ok()?;
        is_in_recovery.then(|| control.name().to_owned())
    }

    /// Adds to the error of a missing answer on a serial port of Linux who else has the port open, and may take the answers.
    /// Other errors are unchanged.
    #[must_use]
    pub fn explain_by_system(&self, mut error: Error) -> Error {
        if let Some(user) = self.other_user(&error)
            && let Error::NoAnswer { hint, .. } = &mut error
        {
            *hint = format!("the port is also open in {user}, which may take the answers: close that one first").into();
        }
        error
    }

    /// Adds to the error of a missing answer what others know: on a serial port [the system](Self::explain_by_system), on
    /// CAN the adapters, which know a reservation of the line to the arm, or the errors of the bus. It asks them, which takes
    /// up to 3 s. Other errors are unchanged.
    #[must_use]
    pub fn explain(&self, error: Error) -> Error {
        let mut error = self.explain_by_system(error);
        if let (Some(bus), Error::NoAnswer { hint, missing, .. }) = (&self.bus, &mut error)
            && let Missing::Silent | Missing::Adapter = missing
        {
            // The request for the reservation reads the state, too, which clears it.
            let state = bus.error_state();
            let reservation = (*missing == Missing::Silent).then(|| self.reservation()).flatten();
            match (reservation, state) {
                (Some(rate), _) => *hint = Text::from("the line to the arm runs at ").append(&rate),
                (None, Some(state)) => *hint = Text::from(state + ": ").append(hint),
                (None, None) => {}
            }
        }
        error
    }

    /// Another user of the serial port on which an answer is missing.
    fn other_user(&self, error: &Error) -> Option<User> {
        let Error::NoAnswer { missing, .. } = error else {
            return None;
        };
        let port = match &self.port {
            // The control port is another interface.
            Port::Serial(_) if *missing == Missing::Adapter => return None,
            Port::Serial(port) | Port::Control(port) => port,
            Port::Slcan { .. } | Port::Tcp(_) | Port::Can { .. } | Port::Hid(_) | Port::UsbControl(_) => return None,
        };
        port_user::other(&system::serial_path(port).ok()?)
    }

    /// The reservation of the line to the arm, read from the adapter. `None` without one, without a reply, or while the
    /// program itself has the control port.
    fn reservation(&self) -> Option<Text> {
        let line = self.adapter().ok()?.line().ok()??;
        line_reservation::describe(&line)
    }

    fn on_can(&self, node: Node, tx: Function, rx: Function) -> Result<CanLine, Error> {
        let name = self.port.to_string();
        match &self.bus {
            Some(bus) => CanLine::new(name, bus, node, tx, rx),
            None => Err(Error::lost(&name, "the bus is not open")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn port_is_parsed_and_printed_again() {
        for (typed, printed) in [
            ("/dev/ttyACM0", "/dev/ttyACM0"),
            ("COM3", "COM3"),
            (
                "/dev/serial/by-path/pci-0000:00:14.0-usb-0:1",
                "/dev/serial/by-path/pci-0000:00:14.0-usb-0:1",
            ),
            ("tcp:arm.local:4000", "tcp:arm.local:4000"),
            ("tcp:[::1]:4000", "tcp:[::1]:4000"),
            ("can:can0", "can:can0"),
            ("can:can0/0", "can:can0"),
            ("can:can0/15", "can:can0/15"),
            ("slcan:/dev/pts/3", "slcan:/dev/pts/3@1000000"),
            ("slcan:/dev/ttyACM1@500000/2", "slcan:/dev/ttyACM1@500000/2"),
            ("slcan:/dev/no-such-port/2", "slcan:/dev/no-such-port@1000000/2"),
            ("slcan:COM3/15", "slcan:COM3@1000000/15"),
            ("slcan:COM3@250000", "slcan:COM3@250000"),
            ("control:/tmp/control", "control:/tmp/control"),
            ("usb:A50285BI", "usb:A50285BI"),
            ("usb:35FFD8/control", "usb:35FFD8/control"),
            ("slcan:usb:A50285BI@500000/2", "slcan:usb:A50285BI@500000/2"),
            ("hid:", "hid:"),
            ("hid:0483:5750", "hid:0483:5750"),
            ("hid:046D:C52B", "hid:046d:c52b"),
            ("hid:/dev/hidraw3", "hid:/dev/hidraw3"),
        ] {
            let port: Port = typed.parse().unwrap();
            assert_eq!(port.to_string(), printed);
            assert_eq!(printed.parse::<Port>().unwrap(), port);
        }
    }

    #[test]
    fn bare_path_is_a_control_port_for_control() {
        let of_control = |text| Port::of_control(text).unwrap();
        let control = Port::Control("/tmp/control".to_owned());
        assert_eq!(of_control("/tmp/control"), control);
        assert_eq!(of_control("control:/tmp/control"), control);
        let on_usb = Port::UsbControl("35FFD8".to_owned());
        assert_eq!(of_control("usb:35FFD8"), on_usb);
        assert_eq!(of_control("usb:35FFD8/control"), on_usb);
        assert_eq!(of_control("can:can0/3"), "can:can0/3".parse().unwrap());
    }

    #[test]
    fn text_of_a_port_is_escaped_in_errors() {
        let error = "can:can0/\x1B[2J\n".parse::<Port>().unwrap_err();
        let text = r"'\u{1b}[2J\n' after the last slash is not a node id, 0 to 15";
        assert_eq!(error.to_string(), text);
        assert_eq!(error.with(|_| String::new()), text);
        let port = crate::open("tcp:\x07:1").unwrap();
        let error = port.adapter().unwrap_err();
        assert!(error.to_string().starts_with(r"tcp:\u{7}:1: "), "{error}");
        assert!(matches!(&error, Error::NoControl { name, .. } if name.as_str() == "tcp:\x07:1"));
    }

    #[test]
    fn invalid_port_is_an_error_with_its_reason() {
        for (typed, error) in [
            ("tcp:arm.local", "'arm.local' has no port, such as arm.local:4000"),
            ("can:can0/16", "node id is 16, must be 0..=15"),
            ("can:can0/x", "'x' after the last slash is not a node id, 0 to 15"),
            ("", "'': the port's name is missing"),
            ("can:", "'can:': the port's name is missing"),
            ("usb:", "'usb:': the port's name is missing"),
            ("usb:/control", "'usb:/control': the port's name is missing"),
            ("can:/3", "'can:/3': the port's name is missing"),
            ("slcan:@500000", "'slcan:@500000': the port's name is missing"),
            ("slcan:COM3/16", "node id is 16, must be 0..=15"),
            (
                "slcan:COM3@/3",
                "'slcan:COM3@/3': bit rate '' is not an SLCAN bit rate: 10000, 20000, 50000, 100000, \
                 125000, 250000, 500000, 800000, 1000000",
            ),
        ] {
            assert_eq!(typed.parse::<Port>().unwrap_err().to_string(), error);
        }
    }
}
