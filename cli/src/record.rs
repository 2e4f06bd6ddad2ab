//! `armwire record`: a recording of an arm.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use clap::Args;

use crate::args::Place;
use crate::error::Error;
use crate::monitor::{Form, Watch};
use crate::status::StatusArg;

/// The arguments of `armwire record`.
#[derive(Args)]
pub(crate) struct Record {
    #[command(flatten)]
    place: Place,
    /// MCAP file. An existing file is not replaced.
    file: PathBuf,
    /// Readings per second.
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..=1000))]
    rate: u32,
    /// Stop after this many readings. Without it: q or Ctrl-C.
    #[arg(long)]
    count: Option<u64>,
    /// Send nothing to the arm: record each reading that the adapter receives for its polls or for other hosts, with the
    /// adapter's stamps. The arm's port stays free for another program.
    #[arg(long, conflicts_with_all = ["rate", "arm"])]
    from_adapter: bool,
    #[command(flatten)]
    status: StatusArg,
}

impl Record {
    pub(crate) fn run(&self, stop: &AtomicBool) -> Result<(), Error> {
        let watch = Watch {
            place: &self.place,
            rate: self.rate,
            count: self.count,
            from_adapter: self.from_adapter,
            mcap: Some(&self.file),
            form: Form::of_recording(self.status),
        };
        watch.run(stop)
    }
}
