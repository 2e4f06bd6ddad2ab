//! Ports, blocking calls and errors with remedies.
#![forbid(unsafe_code)]
#![allow(missing_docs, reason = "the modules become private as the API grows")]

pub mod adapter;
pub mod available;
pub mod can;
pub mod config;
pub mod control;
pub mod describe;
pub mod error;
#[cfg(feature = "hid")]
pub mod hid;
#[cfg(not(feature = "hid"))]
#[path = "no_hid.rs"]
pub mod hid;
pub mod hid_selector;
pub mod legacy;
pub mod line_holder;
pub mod link;
pub mod port;
mod port_holder;
pub mod received;
pub mod serial;
pub mod stamps;
pub mod stop;
pub mod stopwatch;
mod tap;
pub mod tcp;
pub mod text;

pub use adapter::{RECOVERY, counters, identify, is_in_recovery, latencies};
pub use config::{get as config, object as config_object, set as change_config};
pub use control::ControlLink;
pub use describe::{Arm, Fact, Protocol};
pub use error::Error;
pub use hid_selector::Selector;
pub use legacy::open as open_ling;
pub use link::{Interrupt, Line, LineErrors, Link, Names, Reception};
pub use port::{Connection, Port};
pub use received::Missing;
pub use stop::{stop, stop_interruptibly};
pub use tap::Tap;
pub use tcp::Host;
pub use text::{Remedy, Text};
