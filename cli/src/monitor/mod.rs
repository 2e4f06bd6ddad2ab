//! `armwire monitor`: how an arm is, as it changes.

mod alpha1;
mod legacy;
mod ling;
mod xarm;

use std::io::{IsTerminal, Write, stdout};
use std::sync::atomic::{AtomicBool, Ordering};

use armwire::Micros;
use armwire::ling::legacy::Legacy;
use clap::Args;

use crate::describe::Arm;
use crate::link::{Line, Link};
use crate::problem::Problem;
use crate::{ArmKind, Place, older};

/// The arguments of `armwire monitor`.
#[derive(Args)]
pub(crate) struct Monitor {
    #[command(flatten)]
    place: Place,
    /// Readings per second.
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=1000))]
    rate: u32,
    /// Stop after so many readings.
    #[arg(long)]
    count: Option<u64>,
}

/// What an arm is at one moment.
struct Reading {
    /// On several lines.
    rows: Vec<String>,
    /// The same on one line.
    line: String,
}

impl Monitor {
    pub(crate) fn run(&self, stop: &AtomicBool) -> Result<(), Problem> {
        match self.place.arm {
            ArmKind::Ling => {
                let connection = self.place.connect()?;
                let watched = older::open(&connection).and_then(|link| self.watch(link, ling::read, stop));
                let Err(problem @ Problem::Older { .. }) = watched else {
                    return watched;
                };
                eprintln!("armwire: {problem}");
                let mut gripper = None;
                let link = connection.arm::<Legacy>()?;
                self.watch(link, |link| legacy::read(link, &mut gripper), stop)
            }
            ArmKind::Alpha1 => self.watch(self.place.connect()?.arm()?, alpha1::read, stop),
            ArmKind::Xarm => {
                let mut watch = xarm::Watch::default();
                self.watch(Link::connect(&self.place.host()?)?, |link| watch.read(link), stop)
            }
        }
    }

    fn watch<P: Arm, L: Line>(
        &self,
        mut link: Link<P, L>,
        mut read: impl FnMut(&mut Link<P, L>) -> Result<Option<Reading>, Problem>,
        stop: &AtomicBool,
    ) -> Result<(), Problem> {
        let mut out = stdout().lock();
        let terminal = out.is_terminal();
        let period = 1_000_000 / u64::from(self.rate);
        let mut shown = 0;
        for _ in 0..self.count.unwrap_or(u64::MAX) {
            if stop.load(Ordering::Relaxed) {
                break;
            }
            let reading = match read(&mut link) {
                // Who has asked us to end does not ask why there is no answer.
                Err(_) if stop.load(Ordering::Relaxed) => break,
                reading => reading?,
            };
            if let Some(reading) = reading {
                let text = if terminal {
                    block(&reading, std::mem::replace(&mut shown, reading.rows.len()))
                } else {
                    format!("{:9.3} s  {}\n", link.now().0 as f64 / 1e6, reading.line)
                };
                out.write_all(text.as_bytes())
                    .and_then(|()| out.flush())
                    .map_err(Problem::Output)?;
            }
            // After a pause in the line there is no catching up.
            let now = link.now();
            link.sleep_until(Micros((now.0 / period + 1) * period));
        }
        Ok(())
    }
}

/// One reading on several lines, in the place of the one before, which had `shown` lines.
fn block(reading: &Reading, shown: usize) -> String {
    let mut text = String::new();
    if shown > 0 {
        text += &format!("\x1b[{shown}A");
    }
    for row in &reading.rows {
        text += &format!("{row}\x1b[K\n");
    }
    text + "\x1b[J"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reading_takes_the_place_of_the_one_before_whatever_their_lengths() {
        let reading = |rows: &[&str]| Reading {
            rows: rows.iter().map(|&row| row.to_owned()).collect(),
            line: String::new(),
        };
        assert_eq!(block(&reading(&["a", "b"]), 0), "a\x1b[K\nb\x1b[K\n\x1b[J");
        assert_eq!(block(&reading(&["c"]), 2), "\x1b[2Ac\x1b[K\n\x1b[J");
    }
}
