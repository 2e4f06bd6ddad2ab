//! Time: clocks, stamps, and repetitions at a rate.

pub(crate) mod pace;
pub mod stamps;
pub mod stopwatch;
