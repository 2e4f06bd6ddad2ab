//! Reads a virtual Ling arm a hundred times over a line that damages bytes, in virtual time.
//!
//! Usage: lossy_line [SEED]. The same seed has the same faults.

use std::env;
use std::error::Error;

use armwire::ling::{Ling, MAX_FRAME, Request};
use armwire_sim::faults::{Line, Rates};
use armwire_sim::ling::{Config, LingArm};
use armwire_sim::wire::{LineEvent, Wire};

/// Number of readings.
const READINGS: usize = 100;

fn main() -> Result<(), Box<dyn Error>> {
    let seed = env::args().nth(1).map_or(Ok(1), |seed| seed.parse())?;
    // Of a million bytes, 2,000 have each fault.
    let rates = Rates::each(2_000);
    let line = Line::new(LingArm::new(Config::follower()), rates, rates, seed);
    let mut wire = Wire::<Ling, _, MAX_FRAME>::new(armwire::Config::DEFAULT, line);
    let mut answers = 0;
    for _ in 0..READINGS {
        // A read is repeated without an answer.
        if wire.call(Request::ReadJoints).is_ok() {
            answers += 1;
        }
    }
    println!("{answers} of {READINGS} readings in {} µs", wire.elapsed().as_micros());
    println!("to the arm:   {:?}", wire.device().injected_to_device());
    println!("from the arm: {:?}", wire.device().injected_from_device());
    let noise = wire.take_events().into_iter().map(|event| match event {
        LineEvent::Noise { bytes, .. } => bytes.len(),
        _ => 0,
    });
    println!("{} bytes outside of valid frames", noise.sum::<usize>());
    Ok(())
}
