//! The adapter's ports in real time, for any program on this machine.
//!
//! Virtual time follows the wall clock and never overtakes it. Each port is a pty:
//!
//! * The arm's serial port. The baud rate that a program sets reaches the firmware as a line coding; DTR and RTS cannot, a
//!   pty has no modem lines, and are on.
//! * The CAN bus, behind an adapter that speaks [SLCAN](armwire_sim::slcan) and is the only other node. While its channel
//!   is closed nobody acknowledges what the firmware sends.

mod can;
mod serial;

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use armwire_sim::pty::{self, Pty};

use crate::board::{Error, VirtualBoard};
use crate::line::Arm;
use crate::time::Nanos;
use can::CanPort;
use serial::SerialPort;

/// How long the board runs, at most, before the ptys are looked at.
const SLICE: Nanos = Nanos::from_millis(1);

/// How long to sleep, at most, once virtual time has caught up.
const NAP: Duration = Duration::from_millis(1);

/// How far virtual time may lag and still catch up. What is lost beyond, to a slow machine or in a debugger, stays lost.
const PATIENCE: Nanos = Nanos::from_millis(100);

/// How many bytes wait for either side before the other is not read any more.
const BACKLOG: usize = 4096;

/// What is served, and where: a symbolic link to each pty if there is to be one.
#[derive(Clone, Copy, Debug, Default)]
pub struct Places<'a> {
    /// The arm's serial port.
    pub serial: Option<&'a Path>,
    /// The CAN bus, if that is served.
    pub can: Option<Option<&'a Path>>,
}

/// Opens the adapter's serial port and connects it, and what else is asked for, to a pty each, until Ctrl-C.
///
/// # Errors
///
/// When there is no pty or a link cannot be made, and when the board fails.
pub fn serve<A: Arm>(mut board: VirtualBoard<A>, places: Places<'_>) -> Result<(), Error> {
    // It ends the emulator too: a debugger may hold that, and us with it.
    let stop = board.interrupt();
    let stopped = stop.clone();
    ctrlc::set_handler(move || stopped.store(true, Ordering::Relaxed))
        .map_err(|error| Error::Serve(std::io::Error::other(error)))?;
    let mut ports = Ports::open(&mut board, places)?;
    println!("serving on {}; Ctrl-C ends it", ports.names().join(", "));
    match run(&mut board, &mut ports, &stop) {
        Err(_) if stop.load(Ordering::Relaxed) => Ok(()),
        result => result,
    }
}

/// What is served.
struct Ports {
    serial: SerialPort,
    can: Option<CanPort>,
}

impl Ports {
    fn open<A: Arm>(board: &mut VirtualBoard<A>, places: Places<'_>) -> Result<Self, Error> {
        let open = |link| Pty::open(link).map_err(Error::Serve);
        let serial = open(places.serial)?;
        let can = places.can.map(open).transpose()?;
        board.usb().attach();
        Ok(Self {
            serial: SerialPort::open(serial, board)?,
            can: can.map(CanPort::new),
        })
    }

    fn names(&self) -> Vec<String> {
        let serial = self.serial.pty().path().display().to_string();
        let can = self
            .can
            .as_ref()
            .map(|can| format!("{} (SLCAN)", can.pty().path().display()));
        [serial].into_iter().chain(can).collect()
    }

    /// Takes to the board what programs wrote.
    fn take<A: Arm>(&mut self, board: &mut VirtualBoard<A>) -> Result<(), Error> {
        self.serial.take(board)?;
        match &mut self.can {
            Some(can) => can.take(board),
            None => Ok(()),
        }
    }

    /// Gives programs what the board said.
    fn give<A: Arm>(&mut self, board: &mut VirtualBoard<A>) -> Result<(), Error> {
        self.serial.give(board)?;
        match &mut self.can {
            Some(can) => can.give(board),
            None => Ok(()),
        }
    }

    /// Waits for a program to write, though not for long.
    fn nap(&self) -> Result<(), Error> {
        let mut ptys = vec![self.serial.pty()];
        ptys.extend(self.can.as_ref().map(CanPort::pty));
        pty::wait_for_any(&ptys, Some(NAP)).map_err(Error::Serve)?;
        Ok(())
    }
}

/// Passes bytes and time until told to stop.
fn run<A: Arm>(board: &mut VirtualBoard<A>, ports: &mut Ports, stop: &AtomicBool) -> Result<(), Error> {
    let (mut wall, mut virtual_time) = (Instant::now(), board.now());
    while !stop.load(Ordering::Relaxed) {
        ports.take(board)?;
        let target = virtual_time + Nanos(u64::try_from(wall.elapsed().as_nanos()).unwrap_or(u64::MAX));
        let behind = target.since(board.now());
        if behind > PATIENCE {
            (wall, virtual_time) = (Instant::now(), board.now());
        }
        if behind == Nanos(0) {
            ports.nap()?;
        } else {
            let has_news = |board: &mut VirtualBoard<A>| board.usb().unread() > 0 || board.can().unread() > 0;
            match board.run_until(behind.min(SLICE), has_news) {
                Ok(_) | Err(Error::TimedOut { .. }) => {}
                Err(error) => return Err(error),
            }
        }
        ports.give(board)?;
        // A run without end must not keep its records.
        board.usb().forget_packets();
        board.uart().forget_bytes();
        board.can().forget_frames();
    }
    Ok(())
}
