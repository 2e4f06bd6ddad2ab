//! Runs an image of `host-tests/counts` on a Cortex-M in the emulator, and prints how many instructions each case took.
//!
//! `counts IMAGE`. A line for each case: its name and the instructions from its first one to the first of `done`.

use std::collections::BTreeMap;
use std::env;
use std::error::Error;
use std::path::Path;
use std::process::ExitCode;

use object::{Object, ObjectSymbol};
use rigless::emulator::{self, Driver, Host, Settled, Start, Stop, Watch};
use rigless::image::Image;
use rigless::machine::stm32f427_bench::Stm32f427Bench;
use rigless::session::Session;
use rigless::time::VirtualNanos;

/// What the names of cases begin with, and where each ends.
const CASE: &str = "count_";
const DONE: &str = "done";

/// The first case, and what is there once all is well and done.
const NOTHING: &str = "count_nothing";

/// So long an image may run, in virtual time: far longer than any does.
const LIMIT: VirtualNanos = VirtualNanos(1_000_000_000);

fn main() -> ExitCode {
    match env::args_os()
        .nth(1)
        .ok_or("usage: counts IMAGE".into())
        .and_then(|image| count(Path::new(&image)))
    {
        Ok(counts) => {
            for (name, count) in counts {
                println!("{name} {count}");
            }
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

/// The instructions of each case of an image, without what the empty one takes.
fn count(path: &Path) -> Result<BTreeMap<String, u64>, Box<dyn Error>> {
    let image = Image::read(path, None)?;
    let file = object::File::parse(image.bytes())?;
    let symbols: BTreeMap<u64, String> = file
        .symbols()
        .filter(|symbol| symbol.is_definition())
        .filter_map(|symbol| Some((symbol.address() & !1, symbol.name().ok()?.to_owned())))
        .filter(|(_, name)| name == DONE || name.starts_with(CASE))
        .collect();
    let mut session = Session::new(Box::new(Stm32f427Bench::new()?), 0, VirtualNanos(0))?;
    for address in symbols.keys() {
        session.watch(Watch::Instruction(*address));
    }
    let images = [image];
    let counter = Counter {
        symbols: symbols.clone(),
        begun: None,
        counts: BTreeMap::new(),
    };
    let finished = emulator::run(session, &Start::new(&images), counter)?;
    let mut counts = finished.driver.counts;
    for name in symbols.values().filter(|name| *name != DONE) {
        if !counts.contains_key(name) {
            return Err(format!("{name} did not come to its end, or came to another result than it should").into());
        }
    }
    let nothing = counts.remove(NOTHING).ok_or("the image has no empty case")?;
    Ok(counts
        .into_iter()
        .map(|(name, count)| (name, count.saturating_sub(nothing)))
        .collect())
}

/// Notes when a case begins and ends.
struct Counter {
    symbols: BTreeMap<u64, String>,
    /// Which case has begun, and after how many instructions.
    begun: Option<(String, u64)>,
    counts: BTreeMap<String, u64>,
}

impl Driver<Stm32f427Bench> for Counter {
    fn on_settled(&mut self, _: &mut Session<Stm32f427Bench>, _: &mut dyn Host, settled: Settled) {
        let Settled::Hit(hit) = settled else {
            return;
        };
        match self.symbols.get(&hit.address) {
            Some(name) if name != DONE => self.begun = Some((name.clone(), hit.instruction_count)),
            _ => {
                if let Some((name, begin)) = self.begun.take() {
                    self.counts.insert(name, hit.instruction_count - begin);
                }
            }
        }
    }

    fn on_stop(&mut self, _: &mut Session<Stm32f427Bench>, stop: Stop, _: &mut dyn Host) -> Option<VirtualNanos> {
        (stop.at < LIMIT).then_some(LIMIT)
    }
}
