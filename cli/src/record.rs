//! `armwire record`: a recording of an arm.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use clap::Args;

use crate::call::values::whole;
use crate::error::Error;
use crate::monitor::{Form, Readings};
use crate::status::StatusArg;

/// The arguments of `armwire record`.
#[derive(Args)]
pub(crate) struct Record {
    #[command(flatten)]
    readings: Readings,
    /// MCAP file. An existing file is not replaced.
    file: PathBuf,
    /// Readings per second.
    #[arg(long, default_value_t = 100, value_parser = whole::<u32>(1..=1_000))]
    rate: u32,
    #[command(flatten)]
    status: StatusArg,
}

impl Record {
    pub(crate) fn run(&self, stop: &AtomicBool) -> Result<(), Error> {
        let form = Form::of_recording(self.status);
        self.readings.watch(self.rate, Some(&self.file), form, stop)
    }
}
