//! MCAP recordings of a line: every frame in both directions, and the joint positions in them, as ROS 2 messages.
//!
//! ```text
//!  line ──► capture: bytes as frames with times ──┐
//!                                                 ├─► recorder ──► writer: MCAP file
//!  adapter: frames with stamps ───────────────────┘      └─► joint_states: frames as joint positions
//! ```
//!
//! The recorder is that of [`monitor`](crate::monitor).

mod capture;
mod frame;
mod joint_states;
pub(crate) mod messages;
#[cfg(test)]
pub(crate) mod tests;
mod writer;

pub(crate) use capture::Capture;
pub(crate) use frame::Frame;
pub(crate) use writer::Writer;
