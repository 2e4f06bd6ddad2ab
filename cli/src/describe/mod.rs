//! Arms and their messages, for people and for programs: one file for each protocol.

mod alpha1;
mod arm;
mod fact;
pub(crate) mod legacy;
mod ling;
pub(crate) mod xarm;

pub use arm::{Arm, Protocol};
pub use fact::Fact;
pub(crate) use fact::{line, number, object};
