//! ISO-TP: messages longer than a CAN frame (ISO 15765-2:2016, normal addressing, classic and FD).

mod config;
mod endpoint;
mod event;

pub use config::{Config, Link, SeparationTime};
pub use endpoint::{Endpoint, MAX_PDU};
pub use event::{Error, Event, Events, Ignored, Refused, SendError};
