//! CAN frames and identifiers of the adapter.

pub mod bus;
pub mod command;
mod frame;
mod ids;
mod refused_request;
pub mod telemetry;

pub use frame::{FD_LENGTHS, Frame, FrameError, Id, MAX_CLASSIC, MAX_FD};
pub use ids::{Function, Node};
pub use refused_request::RefusedRequest;
