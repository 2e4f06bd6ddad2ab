//! The campaign's options. `cargo xtask campaign` has them too, so its help needs no build.

use clap::Parser;

#[derive(Parser)]
pub(crate) struct Options {
    /// The number of runs
    #[arg(long, value_name = "N", default_value_t = 300)]
    pub(crate) runs: u32,

    /// The first run, of those from 0 to N
    #[arg(long, value_name = "NUMBER")]
    pub(crate) from: Option<u32>,

    /// The seed of all that is random
    #[arg(long, value_name = "S", default_value_t = 1)]
    pub(crate) seed: u64,

    /// Make this run only
    #[arg(long, value_name = "NUMBER")]
    pub(crate) only: Option<u32>,

    /// Write the table of all runs into docs/faults.md
    #[arg(long, conflicts_with_all = ["from", "only"])]
    pub(crate) write: bool,
}
