//! `armwire bus`: the health of a real bus of Feetech servos.

mod report;
mod survey;

use std::io;
use std::str::FromStr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time;

use armwire_bridge::{Duration, Instant};
use armwire_feetech::MAX_FRAME;
use armwire_feetech::register::BAUD_RATES;
use clap::Args;
use serial2::{KeepSettings, SerialPort};

use crate::call::values::{parse, seconds};
use crate::error::Error;
use crate::ids::ids;
use crate::output::{print, print_error, print_json};
use report::{Kind, Report};
use survey::Survey;

/// Longest wait for bytes, after which the time is looked at.
const WAIT: time::Duration = time::Duration::from_millis(5);

/// The arguments of `armwire bus`.
#[derive(Args)]
pub(crate) struct Bus {
    /// Serial port of the bus.
    port: String,
    /// Time for which the servos are read.
    #[arg(long, value_name = "S", default_value = "5", value_parser = seconds)]
    seconds: time::Duration,
    /// Ids to look for, 0 to 253, such as '1-6' or '1,2,7'.
    #[arg(long, default_value = "0-12")]
    ids: Ids,
    /// Baud rate, or 'auto': each rate of a servo, the fastest first, until one answers.
    #[arg(long, value_name = "N", default_value = "auto", value_parser = bauds)]
    baud: Bauds,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
    /// Findings with which the command fails, with exit status 1, after its report.
    #[arg(long, value_name = "FINDINGS", value_delimiter = ',', value_enum)]
    fail_on: Vec<Kind>,
}

#[derive(Clone, Debug)]
struct Ids(Vec<u8>);

impl FromStr for Ids {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let id = |text: &str| match parse(text, "an id from 0 to 253")? {
            id @ 0..=armwire_feetech::MAX_ID => Ok(id),
            id => Err(format!("'{id}' is not an id from 0 to 253")),
        };
        let ids = ids(text, id)?;
        match (1..ids.len()).find(|&nth| ids[..nth].contains(&ids[nth])) {
            Some(nth) => Err(format!("id {} is there twice", ids[nth])),
            None => Ok(Self(ids)),
        }
    }
}

/// The baud rates to try.
#[derive(Clone, Debug)]
struct Bauds(Vec<u32>);

fn bauds(text: &str) -> Result<Bauds, String> {
    match text {
        "auto" => Ok(Bauds(BAUD_RATES.to_vec())),
        text => match parse(text, "a baud rate or 'auto'")? {
            0 => Err("'0' is not a baud rate or 'auto'".to_owned()),
            baud => Ok(Bauds(vec![baud])),
        },
    }
}

impl Bus {
    pub(crate) fn run(&self, stop: &AtomicBool) -> Result<(), Error> {
        let (mut noise, mut echoes, mut unsolicited) = (0, 0, 0);
        for &baud in &self.baud.0 {
            let mut line = Line::open(&self.port, baud)?;
            let mut survey = Survey::new(&self.ids.0, baud);
            line.run(&mut survey, stop, |survey, _| survey.is_searching())?;
            if survey.servos.is_empty() {
                noise += survey.noise;
                echoes += survey.echoes;
                unsolicited += survey.unsolicited;
                if stop.load(Ordering::Relaxed) {
                    return Err(Error::at(&self.port, "interrupted before a servo answered"));
                }
                continue;
            }
            if !self.json {
                print_error(&format_args!(
                    "{} servos at {baud} baud; reading them for {} s, until Ctrl-C",
                    survey.servos.len(),
                    self.seconds.as_secs_f32()
                ));
            }
            let end = line.now() + Duration::try_from(self.seconds).unwrap_or(Duration::MAX);
            let read = line.run(&mut survey, stop, |_, now| now < end);
            let pause = line.pause;
            let printed = self.print(&Report {
                baud,
                survey: &survey,
                pause,
            });
            // A lost port does not take the report so far along.
            return read.and(printed);
        }
        let reason = format!(
            "no servo answers to the {} ids of --ids; {noise} noise bytes, {unsolicited} answers without a request, \
             {echoes} echoes came: is it a bus of Feetech servos, with its supply on?",
            self.ids.0.len()
        );
        Err(Error::at(&self.port, reason))
    }

    fn print(&self, report: &Report<'_>) -> Result<(), Error> {
        match self.json {
            true => print_json(&report.json())?,
            false => print(&report.text())?,
        }
        let mut kinds: Vec<_> = report.findings().iter().map(|finding| finding.kind).collect();
        kinds.retain(|kind| self.fail_on.contains(kind));
        kinds.dedup();
        match kinds.as_slice() {
            [] => Ok(()),
            kinds => {
                let names: Vec<_> = kinds.iter().map(|kind| kind.name()).collect();
                Err(Error::at(&self.port, format!("found: {}", names.join(", "))))
            }
        }
    }
}

/// Keeps other programs of this project off the port. The error says that one of them has it.
#[cfg(unix)]
fn lock(port: &SerialPort) -> io::Result<()> {
    use rustix::fs::{FlockOperation, flock};
    match flock(port, FlockOperation::NonBlockingLockExclusive) {
        Err(rustix::io::Errno::WOULDBLOCK) => Err(io::Error::other("another program uses the port")),
        result => Ok(result?),
    }
}

/// Windows opens a port for one program only.
#[cfg(not(unix))]
fn lock(_: &SerialPort) -> io::Result<()> {
    Ok(())
}

/// The port, and the time.
struct Line<'a> {
    name: &'a str,
    port: SerialPort,
    start: time::Instant,
    /// The longest time by which a wait was longer than it should have been.
    pause: Duration,
}

impl<'a> Line<'a> {
    fn open(name: &'a str, baud: u32) -> Result<Self, Error> {
        let opened = SerialPort::open(name, KeepSettings).and_then(|mut port| {
            // The settings of a port that another program uses are not ours to change.
            lock(&port)?;
            let mut settings = port.get_configuration()?;
            settings.set_raw();
            settings.set_baud_rate(baud)?;
            port.set_configuration(&settings)?;
            port.set_read_timeout(WAIT)?;
            port.discard_input_buffer()?;
            Ok(port)
        });
        Ok(Self {
            name,
            port: opened.map_err(|error| Error::at(name, error))?,
            start: time::Instant::now(),
            pause: Duration::ZERO,
        })
    }

    fn now(&self) -> Instant {
        Instant::from_micros(self.start.elapsed().as_micros().try_into().unwrap_or(u64::MAX))
    }

    /// Surveys the bus while `goes_on`, until Ctrl-C.
    fn run(
        &mut self,
        survey: &mut Survey,
        stop: &AtomicBool,
        goes_on: impl Fn(&Survey, Instant) -> bool,
    ) -> Result<(), Error> {
        let (mut out, mut input) = ([0; MAX_FRAME], [0; 512]);
        while goes_on(survey, self.now()) && !stop.load(Ordering::Relaxed) {
            if let Some(n) = survey.request(self.now(), &mut out) {
                self.port
                    .write_all(&out[..n])
                    .map_err(|error| Error::at(self.name, error))?;
            }
            // A port that takes no bytes is no pause of this computer.
            let before = self.now();
            let n = match self.port.read(&mut input) {
                Ok(n) => n,
                Err(error) if matches!(error.kind(), io::ErrorKind::TimedOut | io::ErrorKind::Interrupted) => 0,
                Err(error) => return Err(Error::at(self.name, error)),
            };
            let now = self.now();
            let waited = now.since(before + Duration::try_from(WAIT).unwrap_or(Duration::ZERO));
            self.pause = self.pause.max(waited);
            survey.receive(now, &input[..n]);
        }
        Ok(())
    }
}
