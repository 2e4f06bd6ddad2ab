//! The adapter's ports in real time, for any program on this machine.
//!
//! Virtual time follows the wall clock and never overtakes it. Each port is a pty:
//!
//! * The arm's serial port. The baud rate that a program sets reaches the firmware as a line coding. DTR and RTS are
//!   always on, because a pty has no modem lines.
//! * The control port: the bytes of the adapter's vendor-specific interface.
//! * The CAN bus, behind an [SLCAN](armwire_sim::slcan) adapter, which is the only other node and supports FD frames.
//!   While its channel is closed, the firmware's frames are not acknowledged.
//!
//! [`serve_bus`] serves a CAN bus without a board.

mod bus;
mod bytes;
mod can;

use std::fmt::Display;
use std::io::{Write, stdout};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use armwire_sim::pty::{self, Pty};

use crate::board::VirtualBoard;
use crate::error::Error;
use crate::line::Arm;
use crate::time::Nanos;
use crate::usb::cdc::LineCoding;
pub use bus::serve_bus;
use bytes::BytePort;
use can::CanPort;

/// Maximum virtual time between checks of the ptys.
const SLICE: Nanos = Nanos::from_millis(1);

/// Maximum sleep once virtual time has caught up.
const MAX_SLEEP: Duration = Duration::from_millis(1);

/// Maximum lag of virtual time that is caught up. More lag, on a slow machine or in a debugger, is not caught up.
const MAX_LAG: Nanos = Nanos::from_millis(100);

/// The serial port's baud rate until a program sets another: the arm's, which hosts on CAN use too.
const BAUD: u32 = 1_000_000;

/// The adapter's node on the board's CAN bus.
const NODE: u8 = 0;

/// The served ports, with an optional symbolic link to each pty.
#[derive(Clone, Copy, Debug, Default)]
pub struct Places<'a> {
    /// The arm's serial port.
    pub serial: Option<&'a Path>,
    /// The control port, if served.
    pub control: Option<Option<&'a Path>>,
    /// The CAN bus, if served.
    pub can: Option<Option<&'a Path>>,
}

/// Opens the adapter's serial port and connects it, and the other requested ports, to a pty each, until Ctrl-C.
///
/// # Errors
///
/// If no pty is available, a link cannot be created, or the board fails.
pub fn serve<A: Arm>(mut board: VirtualBoard<A>, places: Places<'_>) -> Result<(), Error> {
    // It ends the run too: a debugger may halt the run, and this loop with it.
    let stop = board.interrupt();
    stop_at(stop.clone())?;
    board.usb().attach();
    // The port must be open before a program can find the pty.
    board.usb().open(0, LineCoding::new(BAUD))?;
    let mut ports = Ports::open(places)?;
    ports.reopen(&mut board)?;
    let gdb = board.gdb().map_or(String::new(), |gdb| format!(", gdb {gdb}"));
    print_line(format_args!("serving on {}{gdb}; Ctrl-C ends it", ports.names()));
    match run(&mut board, &mut ports, &stop) {
        Err(_) if stop.load(Ordering::Relaxed) => Ok(()),
        result => result,
    }
}

/// Sets `stop` on Ctrl-C.
fn stop_at(stop: Arc<AtomicBool>) -> Result<(), Error> {
    ctrlc::set_handler(move || stop.store(true, Ordering::Relaxed))
        .map_err(|error| Error::Serve(std::io::Error::other(error)))
}

/// Returns true if there is output for a program.
fn has_news<A: Arm>(board: &mut VirtualBoard<A>) -> bool {
    let usb = board.usb();
    usb.serial().unread() > 0 || usb.vendor().unread() > 0 || board.can().unread() > 0
}

/// The served ports.
struct Ports {
    serial: BytePort,
    /// The rate that was passed to the firmware.
    baud: u32,
    control: Option<BytePort>,
    can: Option<CanPort>,
}

impl Ports {
    fn open(places: Places<'_>) -> Result<Self, Error> {
        let open = |link| Pty::open(link).map_err(Error::Serve);
        let serial = open(places.serial)?;
        serial.set_baud(BAUD).map_err(Error::Serve)?;
        Ok(Self {
            baud: BAUD,
            serial: BytePort::new(serial),
            control: places.control.map(open).transpose()?.map(BytePort::new),
            can: places.can.map(open).transpose()?.map(|pty| CanPort::new(pty, NODE)),
        })
    }

    /// The ports in the syntax of `armwire`.
    fn names(&self) -> String {
        let mut names = self.serial.pty().path().display().to_string();
        if let Some(control) = &self.control {
            names += &format!(", control port control:{}", control.pty().path().display());
        }
        if let Some(can) = &self.can {
            names += &format!(", CAN bus slcan:{}", can.pty().path().display());
        }
        names
    }

    /// Opens closed ports on the board. Firmware that has restarted is a new device.
    fn reopen<A: Arm>(&mut self, board: &mut VirtualBoard<A>) -> Result<(), Error> {
        let wanted = self.serial.pty().baud().map_err(Error::Serve)?;
        let mut usb = board.usb();
        if !usb.is_open() || wanted != self.baud {
            usb.open(0, LineCoding::new(wanted))?;
            self.baud = wanted;
        }
        if self.control.is_some() && !usb.vendor().is_open() {
            usb.open_vendor()?;
        }
        Ok(())
    }

    /// Passes the programs' input on to the board.
    fn take<A: Arm>(&mut self, board: &mut VirtualBoard<A>) -> Result<(), Error> {
        self.serial.take(board.usb().serial())?;
        if let Some(control) = &mut self.control {
            control.take(board.usb().vendor())?;
        }
        if let Some(can) = &mut self.can {
            can.take(&board.can(), board.now())?;
        }
        Ok(())
    }

    /// Passes the board's output on to the programs.
    fn give<A: Arm>(&mut self, board: &mut VirtualBoard<A>) -> Result<(), Error> {
        self.serial.give(board.usb().serial())?;
        if let Some(control) = &mut self.control {
            control.give(board.usb().vendor())?;
        }
        if let Some(can) = &mut self.can {
            can.give(&board.can(), board.now())?;
        }
        Ok(())
    }

    /// Waits briefly for input of a program.
    fn wait_for_input(&self) -> Result<(), Error> {
        let mut ptys = vec![self.serial.pty()];
        ptys.extend(self.control.as_ref().map(BytePort::pty));
        ptys.extend(self.can.as_ref().map(CanPort::pty));
        pty::wait_for_any(&ptys, Some(MAX_SLEEP)).map_err(Error::Serve)?;
        Ok(())
    }
}

/// Prints a line. Serving goes on if the reader of the output is gone.
fn print_line(line: impl Display) {
    let _ = writeln!(stdout(), "{line}");
}

/// Passes bytes and advances time until stopped.
fn run<A: Arm>(board: &mut VirtualBoard<A>, ports: &mut Ports, stop: &AtomicBool) -> Result<(), Error> {
    let (mut wall, mut virtual_time) = (Instant::now(), board.now());
    while !stop.load(Ordering::Relaxed) {
        if board.is_in_boot_loader() {
            print_line("the firmware is in its boot loader, which the virtual board does not have");
            return Ok(());
        }
        match ports.reopen(board) {
            // The boot loader was started while the host waited.
            Err(_) if board.is_in_boot_loader() => continue,
            opened => opened?,
        }
        ports.take(board)?;
        let target = virtual_time + Nanos(u64::try_from(wall.elapsed().as_nanos()).unwrap_or(u64::MAX));
        let behind = target.since(board.now());
        if behind > MAX_LAG {
            (wall, virtual_time) = (Instant::now(), board.now());
        }
        if behind == Nanos(0) {
            ports.wait_for_input()?;
        } else {
            match board.run_until(behind.min(SLICE), has_news) {
                Ok(_) | Err(Error::TimedOut { .. }) => {}
                Err(error) => return Err(error),
            }
        }
        ports.give(board)?;
        // Records of an endless run must not accumulate.
        board.usb().forget_packets();
        board.uart().forget_bytes();
        board.can().forget_frames();
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::board::tests::board_into_boot_loader;

    #[test]
    fn firmware_entering_boot_loader_ends_service() {
        let mut board = board_into_boot_loader();
        board.usb().attach();
        let mut ports = Ports::open(Places::default()).unwrap();
        run(&mut board, &mut ports, &AtomicBool::new(false)).unwrap();
        assert!(board.is_in_boot_loader());
    }
}
