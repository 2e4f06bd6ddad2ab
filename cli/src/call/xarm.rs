//! The requests of an xArm.

use armwire::xarm::{Joint, ProtocolId, Raw, Request};
use armwire_host::{TcpAddress, XArm};
use clap::{Args, Subcommand};

use super::values::{made, whole};
use crate::error::Error;
use crate::hex;

/// A request and its host.
#[derive(Args)]
pub(crate) struct OnHost {
    /// The control box, such as 192.168.1.10 or 192.168.1.10:502.
    #[arg(value_name = "HOST[:PORT]")]
    host: TcpAddress,
    /// Use protocol id 3 instead of 2. The vendor's package uses 3 with reports and firmware 1.8.6 or later.
    #[arg(long)]
    supervised: bool,
    #[command(subcommand)]
    command: Command,
}

/// One request.
#[derive(Subcommand)]
enum Command {
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
    /// Shut the control box down. It must be switched on by hand afterwards.
    Shutdown,
    /// Restart the arm's control box.
    Reboot,
    /// Send a heartbeat.
    Heartbeat,
    /// Send a request for a register that has no command here, unchecked. Register 42 reads joint positions, 23 moves the arm.
    Raw {
        /// The register, 0 to 255.
        #[arg(allow_negative_numbers = true, value_parser = whole::<u8>(0..=u8::MAX.into()))]
        register: u8,
        /// Parameters, in hexadecimal, such as 'DB 0F 49 40'.
        #[arg(value_name = "HEX", value_parser = bytes)]
        params: Vec<Hex>,
    },
}

/// Bytes of the command line.
type Hex = Box<[u8]>;

impl OnHost {
    /// Connects to the arm, to speak with the protocol id of the options.
    pub(super) fn connect(&self) -> Result<XArm, Error> {
        let mut arm = XArm::connect(&self.host)?;
        if self.supervised {
            arm.set_protocol(ProtocolId::Supervised);
        }
        Ok(arm)
    }

    /// The parameters of a register without a type of its own.
    pub(super) fn params(&self) -> Vec<u8> {
        match &self.command {
            Command::Raw { params, .. } => params.concat(),
            _ => Vec::new(),
        }
    }

    pub(super) fn request<'a>(&self, params: &'a [u8]) -> Result<Request<'a>, String> {
        Ok(match &self.command {
            Command::Version => Request::ReadVersion,
            Command::Serials => Request::ReadSerials,
            Command::ReloadDynamics => Request::ReloadDynamics,
            Command::TorqueSource => Request::ReadTorqueSource,
            Command::RotationRadius { joint } => Request::ReadRotationRadius(*joint),
            Command::Shutdown => Request::Shutdown,
            Command::Reboot => Request::Reboot,
            Command::Heartbeat => Request::Heartbeat,
            Command::Raw { register, .. } => {
                Request::Raw(Raw::new(*register, params).map_err(|error| error.to_string())?)
            }
        })
    }
}

fn joint(text: &str) -> Result<Joint, String> {
    made(text, "a number from 1 to 7", Joint::new)
}

fn bytes(text: &str) -> Result<Hex, String> {
    match hex::parse(text) {
        Ok(bytes) => Ok(bytes.into()),
        Err(wrong) => Err(format!("'{}' is not a byte or bytes in hexadecimal", wrong.word)),
    }
}
