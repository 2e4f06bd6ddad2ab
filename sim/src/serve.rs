//! A device on a pseudo-terminal, in real time.

use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use armwire::time;

use crate::pty::Pty;
use crate::serial::SerialDevice;

/// Maximum reaction time to the stop flag.
const POLL_PERIOD: Duration = Duration::from_millis(100);

/// The baud rate for a pty before its clients open it: a client that sets none, such as a shell, is then heard.
pub const BAUD: u32 = 1_000_000;

/// Byte counts of a pty.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Served {
    /// Bytes from clients to the device.
    pub received: u64,
    /// Bytes from the device to clients.
    pub sent: u64,
    /// Bytes from the device that were lost because no client reads.
    pub lost: u64,
}

/// Connects a device to a pty until `stop` is set or the device is gone. The reaction time is at most 100 ms.
///
/// The device's time zero is the time of the call. The baud rate of a pty is a number without effect, which the device is
/// told: bytes take no time. The output of one instant is one write, so frames with a pause between them reach the client
/// one by one.
///
/// # Errors
///
/// Errors of the pty.
pub fn serve(device: &mut impl SerialDevice, pty: &Pty, stop: &AtomicBool) -> io::Result<Served> {
    serve_since(Instant::now(), device, pty, stop)
}

/// As [`serve`], with the device's time zero at `start`: another thread then knows the device's time.
///
/// # Errors
///
/// Errors of the pty.
pub fn serve_since(start: Instant, device: &mut impl SerialDevice, pty: &Pty, stop: &AtomicBool) -> io::Result<Served> {
    let now = || time::Instant::from_micros(start.elapsed().as_micros().try_into().unwrap_or(u64::MAX));
    let mut served = Served::default();
    let mut input = [0; 256];
    let mut output = Vec::new();
    while !stop.load(Ordering::Relaxed) && !device.is_gone() {
        let n = pty.read(&mut input)?;
        served.received += n as u64;
        let instant = now();
        if n > 0 {
            device.set_baud(pty.baud()?);
        }
        for &byte in &input[..n] {
            device.receive(instant, byte);
        }

        output.clear();
        output.extend(std::iter::from_fn(|| device.transmit(instant)));
        if !output.is_empty() {
            let sent = pty.write(&output)?;
            served.sent += sent as u64;
            served.lost += (output.len() - sent) as u64;
        }

        let timeout = device.poll_timeout().map(|due| Duration::from(due.since(now())));
        pty.wait(Some(timeout.unwrap_or(POLL_PERIOD).min(POLL_PERIOD)))?;
    }
    Ok(served)
}

#[cfg(test)]
mod tests {
    use std::fs::OpenOptions;
    use std::io::{Read, Write};
    use std::thread;

    use super::*;
    use crate::ling::{Config, LingArm};

    #[test]
    fn clients_are_answered_until_stop_flag() {
        let pty = Pty::open(None).unwrap();
        let stop = AtomicBool::new(false);
        let mut arm = LingArm::new(Config::follower());
        thread::scope(|scope| {
            let server = scope.spawn(|| serve(&mut arm, &pty, &stop));
            for _ in 0..2 {
                let mut client = OpenOptions::new().read(true).write(true).open(pty.path()).unwrap();
                client.write_all(&[0xAA, 0x04, 0x0E, 0x01, 0xFE, 0x1B, 0xFF]).unwrap();
                let mut answer = [0; 7];
                client.read_exact(&mut answer).unwrap();
                assert_eq!(answer, [0xAA, 0x04, 0x0E, 0x01, 0x00, 0x00, 0xFF]);
            }
            stop.store(true, Ordering::Relaxed);
            let served = server.join().unwrap().unwrap();
            assert_eq!((served.received, served.sent, served.lost), (14, 14, 0));
        });
        assert_eq!(arm.counters().answered, 2);
    }
}
