//! The adapter's serial port in real time, for any serial program on this machine.
//!
//! Virtual time follows the wall clock and never overtakes it. A pty stands in for the USB serial port: the baud rate that
//! a program sets reaches the firmware as a line coding; DTR and RTS cannot, a pty has no modem lines, and are on.

use std::collections::VecDeque;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use armwire_sim::pty::Pty;

use crate::board::{Error, VirtualBoard};
use crate::line::Arm;
use crate::time::Nanos;
use crate::usb::cdc::LineCoding;

/// How long the board runs, at most, before the pty is looked at.
const SLICE: Nanos = Nanos::from_millis(1);

/// How long to sleep, at most, once virtual time has caught up.
const NAP: Duration = Duration::from_millis(1);

/// How far virtual time may lag and still catch up. What is lost beyond, to a slow machine or in a debugger, stays lost.
const PATIENCE: Nanos = Nanos::from_millis(100);

/// How many bytes wait for either side before the other is not read any more.
const BACKLOG: usize = 4096;

/// Opens the adapter's serial port and connects it to a pty, at `link` if given, until Ctrl-C.
///
/// # Errors
///
/// When there is no pty or the link cannot be made, and when the board fails.
pub fn serve<A: Arm>(mut board: VirtualBoard<A>, link: Option<&Path>) -> Result<(), Error> {
    // It ends the emulator too: a debugger may hold that, and us with it.
    let stop = board.interrupt();
    let stopped = stop.clone();
    ctrlc::set_handler(move || stopped.store(true, Ordering::Relaxed))
        .map_err(|error| Error::Serve(std::io::Error::other(error)))?;
    let pty = Pty::open(link).map_err(Error::Serve)?;
    board.usb().attach();
    let baud = pty.baud().map_err(Error::Serve)?;
    board.usb().open(0, LineCoding::new(baud))?;
    println!("serving on {}; Ctrl-C ends it", pty.path().display());
    match pump(&mut board, &pty, baud, &stop) {
        Err(_) if stop.load(Ordering::Relaxed) => Ok(()),
        result => result,
    }
}

/// Passes bytes and time until told to stop. `baud` is the rate that the firmware was told of.
fn pump<A: Arm>(board: &mut VirtualBoard<A>, pty: &Pty, mut baud: u32, stop: &AtomicBool) -> Result<(), Error> {
    let mut buffer = [0; BACKLOG];
    let mut to_program: VecDeque<u8> = VecDeque::new();
    let (mut wall, mut virtual_time) = (Instant::now(), board.now());

    while !stop.load(Ordering::Relaxed) {
        let wanted = pty.baud().map_err(Error::Serve)?;
        if !board.usb().is_open() || wanted != baud {
            // A firmware that started over is a new device.
            board.usb().open(0, LineCoding::new(wanted))?;
            baud = wanted;
        }
        if board.usb().unsent() < BACKLOG {
            let count = pty.read(&mut buffer).map_err(Error::Serve)?;
            board.usb().write(&buffer[..count])?;
        }

        let target = virtual_time + Nanos(u64::try_from(wall.elapsed().as_nanos()).unwrap_or(u64::MAX));
        let behind = target.since(board.now());
        if behind > PATIENCE {
            (wall, virtual_time) = (Instant::now(), board.now());
        }
        if behind == Nanos(0) {
            pty.wait(Some(NAP)).map_err(Error::Serve)?;
        } else {
            match board.run_until(behind.min(SLICE), |board| board.usb().unread() > 0) {
                Ok(_) | Err(Error::TimedOut { .. }) => {}
                Err(error) => return Err(error),
            }
        }

        to_program.extend(board.usb().read());
        let count = pty.write(to_program.make_contiguous()).map_err(Error::Serve)?;
        to_program.drain(..count);
        board.usb().set_reading(to_program.len() < BACKLOG);
        // A run without end must not keep its records.
        board.usb().forget_packets();
        board.uart().forget_bytes();
    }
    Ok(())
}
