//! Processes that keep the processors busy.

use std::process::{Child, Command, Stdio};
use std::thread::available_parallelism;

use crate::error::Error;

/// Counts while the program that started it lives.
const BUSY: &str = "while kill -0 $PPID 2>/dev/null; do :; done";

/// A process for each processor, until it is dropped.
pub(super) struct Load(Vec<Child>);

impl Load {
    pub(super) fn start() -> Result<Self, Error> {
        let mut load = Self(Vec::new());
        for _ in 0..processors() {
            let mut busy = Command::new("sh");
            busy.args(["-c", BUSY]).stdin(Stdio::null()).stdout(Stdio::null());
            let started = busy.spawn();
            load.0.push(started.map_err(|error| Error::at("sh", error))?);
        }
        Ok(load)
    }
}

impl Drop for Load {
    fn drop(&mut self) {
        for process in &mut self.0 {
            // It may have ended by itself.
            let _ = process.kill();
            let _ = process.wait();
        }
    }
}

/// Number of processors of this program.
pub(super) fn processors() -> usize {
    available_parallelism().map_or(1, usize::from)
}
