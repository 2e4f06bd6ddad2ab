//! The ports of this computer: from the name that a user types, to a line, and to a link with the protocol's rules on it.

pub mod adapter;
pub(crate) mod available;
mod can;
pub mod control;
#[cfg(test)]
mod endless;
pub(crate) mod hid;
pub(crate) mod interrupt;
pub(crate) mod line;
pub mod line_reservation;
pub(crate) mod link;
pub(crate) mod lost_line;
pub(crate) mod port;
mod port_user;
pub(crate) mod raw_port;
mod serial;
pub mod settings;
pub(crate) mod system;
pub(crate) mod tap;
pub(crate) mod tcp;
mod usb_name;
