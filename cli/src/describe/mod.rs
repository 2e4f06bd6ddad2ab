//! Arms and their messages, for people and for programs: one file for each protocol.

mod alpha1;
mod arm;
mod fact;
pub(crate) mod legacy;
mod ling;
pub(crate) mod xarm;

pub(crate) use arm::Arm;
pub(crate) use fact::{Fact, line, number, object};
