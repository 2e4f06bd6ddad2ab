//! Arms and their messages, for people and for programs: one file for each protocol.

mod alpha1;
mod arm;
mod fact;
pub mod legacy;
mod ling;
pub mod xarm;

pub use arm::{Arm, Protocol};
pub use fact::Fact;
pub use fact::{line, number, object};
