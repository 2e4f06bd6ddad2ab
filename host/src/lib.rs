//! Ports, blocking calls and errors with remedies.
#![forbid(unsafe_code)]
#![allow(missing_docs, reason = "the modules become private as the API grows")]

pub mod adapter;
mod alpha1;
pub mod available;
pub mod can;
pub mod control;
pub mod describe;
pub mod error;
pub mod hid;
mod legacy;
pub mod line_holder;
mod ling;
pub mod link;
pub mod port;
mod port_holder;
pub mod received;
pub mod serial;
pub mod settings;
pub mod stamps;
mod stop;
pub mod stopwatch;
mod tap;
pub mod tcp;
pub mod text;
mod xarm;

pub use adapter::RECOVERY;
pub use alpha1::Alpha1;
pub use control::Adapter;
pub use describe::{Arm, Fact, Protocol};
pub use error::Error;
pub use hid::Selector;
pub use ling::Ling;
pub use link::{Interrupt, Line, LineErrors, Link, Names, Reception};
pub use port::{Connection, Options, Port, open};
pub use received::Missing;
pub use tap::Tap;
pub use tcp::Host;
pub use text::{Remedy, Text};
pub use xarm::XArm;
