//! Arms: their requests, and what a motion depends on.

pub(crate) mod alpha1;
#[cfg(test)]
mod fake;
pub mod joints_file;
pub(crate) mod known;
mod legacy;
pub(crate) mod ling;
pub(crate) mod park_poses;
pub(crate) mod pose;
mod refusals;
pub(crate) mod shared;
mod stop;
pub(crate) mod xarm;
