//! The emulator library as an engine: on a thread of its own, in lock step with the program.

use std::collections::BTreeMap;
use std::io::Read;
use std::net::TcpStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender};
use std::thread::JoinHandle;

use crate::board::Error;
use crate::engine::{Engine, Stopped, Watched};
use crate::machine::{Command, Reply};
use crate::report::Report;
use crate::time::Nanos;

/// The thread.
#[derive(Debug)]
pub(crate) struct Library {
    pub(crate) commands: Option<Sender<Command>>,
    pub(crate) replies: Receiver<Reply>,
    pub(crate) interrupt: Arc<AtomicBool>,
    pub(crate) thread: Option<JoinHandle<()>>,
    pub(crate) log: TcpStream,
}

impl Library {
    fn send(&mut self, command: Command) -> Result<(), Error> {
        let sent = self
            .commands
            .as_ref()
            .is_some_and(|commands| commands.send(command).is_ok());
        if sent { Ok(()) } else { Err(self.ended()) }
    }

    /// Waits for the emulator to stand still.
    pub(crate) fn stopped(&mut self) -> Result<Stopped, Error> {
        match self.replies.recv() {
            Ok(Reply::Stopped(stopped)) => Ok(stopped),
            Ok(Reply::Ended(why)) => Err(Error::Ended(why)),
            Ok(Reply::Report(_) | Reply::Profile(_) | Reply::Read(_) | Reply::Written(_)) | Err(_) => Err(self.ended()),
        }
    }

    fn ended(&mut self) -> Error {
        match self.replies.try_recv() {
            Ok(Reply::Ended(why)) => Error::Ended(why),
            _ => Error::Ended("the emulator is gone".to_owned()),
        }
    }
}

impl Engine for Library {
    fn run(&mut self, until: Nanos, watched: Watched) -> Result<Stopped, Error> {
        self.send(Command::Run { until, watched })?;
        self.stopped()
    }

    fn report(&mut self) -> Result<Report, Error> {
        self.send(Command::Report)?;
        match self.replies.recv() {
            Ok(Reply::Report(report)) => Ok(*report),
            Ok(Reply::Ended(why)) => Err(Error::Ended(why)),
            _ => Err(self.ended()),
        }
    }

    fn profile(&mut self) -> Result<BTreeMap<u64, u64>, Error> {
        self.send(Command::Profile)?;
        match self.replies.recv() {
            Ok(Reply::Profile(profile)) => Ok(profile),
            _ => Err(self.ended()),
        }
    }

    fn read(&mut self, address: u64) -> Result<Option<u32>, Error> {
        self.send(Command::Read { address })?;
        match self.replies.recv() {
            Ok(Reply::Read(value)) => Ok(value),
            _ => Err(self.ended()),
        }
    }

    fn write(&mut self, address: u64, value: u32) -> Result<bool, Error> {
        self.send(Command::Write { address, value })?;
        match self.replies.recv() {
            Ok(Reply::Written(written)) => Ok(written),
            _ => Err(self.ended()),
        }
    }

    fn hold(&mut self, held: bool) -> Result<(), Error> {
        self.send(Command::Hold(held))
    }

    fn log(&mut self) -> Vec<u8> {
        let mut bytes = Vec::new();
        // It ends with an error when there is no more for now.
        let _ = self.log.read_to_end(&mut bytes);
        bytes
    }
}

impl Drop for Library {
    fn drop(&mut self) {
        // Without anyone to command it, the emulator ends its run; a debugger that holds it must not keep it.
        self.commands = None;
        self.interrupt.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // What it died of, it has said in its last reply.
            let _ = thread.join();
        }
    }
}
