//! Reads the pose of a Ling arm 50 times a second, for ten seconds. It sends no motion.
//!
//! Usage: joints PORT, such as /dev/ttyUSB0, COM3, can:can0 or tcp:arm.local:4000.

use std::env;
use std::error::Error;
use std::time::{Duration, Instant};

use armwire_host::{Rate, Reader, Shared};

const TIME: Duration = Duration::from_secs(10);
const TIMEOUT: Duration = Duration::from_secs(1);

fn main() -> Result<(), Box<dyn Error>> {
    let port = env::args().nth(1).ok_or("usage: joints PORT")?;
    let arm = Shared::new(&port, armwire_host::open(&port)?.ling()?);
    println!("serial number {}", arm.call(|arm| arm.read_info())?.serial);
    // Other calls of the arm, such as a move, go between two readings.
    let reader = Reader::start(&arm, Rate::new(50)?)?;
    let (start, mut seen) = (Instant::now(), 0);
    while start.elapsed() < TIME {
        let next = reader.next_after(seen, TIMEOUT)?;
        let reading = next.ok_or("no answer in a second")?;
        seen = reading.number;
        println!("{}", reading.pose);
    }
    Ok(())
}
