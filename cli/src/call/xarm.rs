//! The requests of an xArm.

use armwire::xarm::{Command, Header, Joint, ProtocolId, Raw, Reply, Request, Response, State, Transactions, XArm};
use clap::{Args, Subcommand};

use crate::hex;
use crate::link::{Line, Link};
use crate::problem::Problem;
use crate::tcp::Host;

/// A request, and the host it goes to.
#[derive(Args)]
pub(crate) struct OnHost {
    /// The control box, such as 192.168.1.10 or 192.168.1.10:502.
    #[arg(value_name = "HOST[:PORT]")]
    host: Host,
    /// Speak with protocol id 3, as the vendor's package does to firmware 1.8.6 and later, instead of 2.
    #[arg(long)]
    supervised: bool,
    #[command(subcommand)]
    ask: Ask,
}

/// One request.
#[derive(Subcommand)]
enum Ask {
    /// Read axes, type and versions.
    Version,
    /// Read the serial numbers of the arm and of its control box.
    Serials,
    /// Reload the friction parameters.
    ReloadDynamics,
    /// Read whether joint torque or servo current is reported.
    TorqueSource,
    /// Read the radius of rotation of a joint relative to the tool.
    RotationRadius {
        /// The joint, 1 to 7.
        #[arg(allow_negative_numbers = true, value_parser = joint)]
        joint: Joint,
    },
    /// Shut the arm's control box down. It comes back when it is switched on by hand.
    Shutdown,
    /// Restart the arm's control box.
    Reboot,
    /// Say that we are there.
    Heartbeat,
    /// Ask any other register, whatever it does: 42, say, reads joint positions, and 23 moves.
    Raw {
        /// The register, 0 to 255.
        #[arg(allow_negative_numbers = true)]
        register: u8,
        /// Its parameters, as hexadecimal text such as 'DB 0F 49 40'.
        #[arg(value_name = "HEX", value_parser = bytes)]
        params: Vec<Hex>,
    },
}

/// Bytes that were typed.
type Hex = Box<[u8]>;

impl OnHost {
    pub(super) fn host(&self) -> &Host {
        &self.host
    }

    pub(super) fn request(&self) -> Result<Request, String> {
        let command = match &self.ask {
            Ask::Version => Command::ReadVersion,
            Ask::Serials => Command::ReadSerials,
            Ask::ReloadDynamics => Command::ReloadDynamics,
            Ask::TorqueSource => Command::ReadTorqueSource,
            Ask::RotationRadius { joint } => Command::ReadRotationRadius(*joint),
            Ask::Shutdown => Command::Shutdown,
            Ask::Reboot => Command::Reboot,
            Ask::Heartbeat => return Ok(Request::Heartbeat),
            Ask::Raw { register, params } => {
                let raw = Raw::new(*register, &params.concat());
                Command::Raw(raw.map_err(|error| error.to_string())?)
            }
        };
        let protocol = match self.supervised {
            true => ProtocolId::Supervised,
            false => ProtocolId::Private,
        };
        let transaction = Transactions::new().next_id();
        let header = Header { transaction, protocol };
        Ok(Request::Call { header, command })
    }
}

/// Asks something of an arm and returns its state and what it has to say.
pub(crate) fn ask(
    link: &mut Link<XArm, impl Line>,
    transactions: &mut Transactions,
    command: Command,
) -> Result<Option<(State, Reply)>, Problem> {
    let header = Header {
        transaction: transactions.next_id(),
        protocol: ProtocolId::Private,
    };
    Ok(match link.call(Request::Call { header, command })? {
        Some(Response::Reply { state, reply, .. }) => Some((state, reply)),
        _ => None,
    })
}

fn joint(text: &str) -> Result<Joint, String> {
    let number = text
        .parse()
        .map_err(|_| format!("'{text}' is not a number from 1 to 7"))?;
    Joint::new(number).map_err(|error| error.to_string())
}

fn bytes(text: &str) -> Result<Hex, String> {
    match hex::parse(text) {
        Ok(bytes) => Ok(bytes.into()),
        Err(word) => Err(format!("'{word}' is not a byte or bytes in hexadecimal")),
    }
}
