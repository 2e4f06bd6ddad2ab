//! Time: clocks, stamps, and repetitions at a rate.

pub(crate) mod pace;
pub(crate) mod rate;
pub(crate) mod silence;
pub mod stamps;
pub mod stopwatch;
