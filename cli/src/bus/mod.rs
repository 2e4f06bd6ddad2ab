//! `armwire bus`: the health of a real bus of Feetech servos.

mod report;
mod survey;

use std::num::NonZeroU32;
use std::str::FromStr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time;

use armwire_bridge::{Duration, Instant};
use armwire_feetech::MAX_FRAME;
use armwire_feetech::register::BAUD_RATES;
use armwire_host::stopwatch::Stopwatch;
use armwire_host::{Error as Host, Missing, Options, Port, RawPort};
use clap::Args;

use crate::call::values::{parse, seconds};
use crate::error::Error;
use crate::ids::ids;
use crate::output::{print, print_error, print_json};
use crate::status::StatusArg;
use report::{Kind, Report};
use survey::{Servo, Survey, timing};

/// Longest wait for bytes, after which the time is looked at.
const WAIT: time::Duration = time::Duration::from_millis(5);

/// The arguments of `armwire bus`.
#[derive(Args)]
pub(crate) struct Bus {
    /// Port of the bus: a serial port (/dev/ttyACM0, COM3, or usb:SERIAL by its USB serial number), tcp:HOST:PORT (serial
    /// port server), can:IFACE/NODE (SocketCAN), or slcan:PORT@BITRATE/NODE (SLCAN adapter).
    port: Port,
    /// Time for which the servos are read.
    #[arg(long, value_name = "S", default_value = "5", value_parser = seconds)]
    seconds: time::Duration,
    /// Ids to look for, 0 to 253, such as '1-6' or '1,2,7'.
    #[arg(long, default_value = "0-12")]
    ids: Ids,
    /// Baud rate of the serial port, or 'auto': each rate of a servo, the fastest first, until one answers.
    #[arg(long, value_name = "N", default_value = "auto")]
    baud: Baud,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
    /// Findings with which the command fails, with exit status 1, after its report.
    #[arg(long, value_name = "FINDINGS", value_delimiter = ',', value_enum)]
    fail_on: Vec<Kind>,
    #[command(flatten)]
    status: StatusArg,
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

/// A baud rate. `None` is 'auto'.
#[derive(Clone, Copy, Debug)]
struct Baud(Option<NonZeroU32>);

impl FromStr for Baud {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "auto" => Ok(Self(None)),
            text => Ok(Self(Some(parse(text, "a baud rate or 'auto'")?))),
        }
    }
}

impl Bus {
    pub(crate) fn run(&self, stop: &AtomicBool) -> Result<(), Error> {
        let connection = self.port.open(Options::default().with_baud(self.baud.0))?;
        let mut status = self.status.line();
        let mut failed = Vec::new();
        for baud in self.rates() {
            let (port, config) = connection.raw(timing(baud))?;
            let mut line = Line::new(port);
            let mut survey = Survey::new(&self.ids.0, config);
            let baud = matches!(self.port, Port::Serial(_)).then_some(baud);
            let at = baud.map_or_else(String::new, |baud| format!(" at {baud} baud"));
            line.run(&mut survey, stop, |survey, _| {
                status.show(|| {
                    let found = servos(survey.servos.len());
                    format!("{found} found{at}, {} ids left", survey.ids_left())
                });
                survey.is_searching()
            })?;
            if !survey.servos.is_empty() {
                drop(status);
                if !self.json {
                    print_error(&format_args!(
                        "{}{at}; reading them for {} s, until Ctrl-C",
                        servos(survey.servos.len()),
                        self.seconds.as_secs_f32()
                    ));
                }
                return self.read(line, survey, baud, stop);
            }
            failed.push(survey);
            if stop.load(Ordering::Relaxed) {
                return Err(Error::at(&self.port.to_string(), "interrupted before a servo answered"));
            }
        }
        drop(status);
        Err(connection.explain(self.no_servo(&failed)).into())
    }

    /// The error of a bus on which these surveys found no servo.
    fn no_servo(&self, surveys: &[Survey]) -> Host {
        let sum = |count: fn(&Survey) -> u64| surveys.iter().map(count).sum::<u64>();
        let noise = sum(|survey| survey.noise);
        let unsolicited = sum(|survey| survey.unsolicited);
        let echoes = sum(|survey| survey.echoes);
        let cause = format!(
            "no servo answers to the ids of --ids; {noise} noise bytes, {unsolicited} answers without a request, {echoes} \
             echoes came"
        );
        let hint = match self.port {
            Port::Can { .. } | Port::Slcan { .. } => {
                "is it a bus of Feetech servos, with its supply on, and is the adapter set to raw?"
            }
            _ => "is it a bus of Feetech servos, with its supply on?",
        };
        Host::NoAnswer {
            name: self.port.to_string().into(),
            cause: cause.into(),
            hint: hint.into(),
            missing: missing(noise, unsolicited),
            bytes: sum(Survey::received).try_into().unwrap_or(usize::MAX),
        }
    }

    /// The baud rates to try. Only a serial port has one to set.
    fn rates(&self) -> Vec<u32> {
        match (&self.port, self.baud.0) {
            (Port::Serial(_), Some(baud)) => vec![baud.get()],
            (Port::Serial(_), None) => BAUD_RATES.to_vec(),
            _ => vec![BAUD_RATES[0]],
        }
    }

    /// Reads the servos that were found, and prints the report.
    fn read(&self, mut line: Line, mut survey: Survey, baud: Option<u32>, stop: &AtomicBool) -> Result<(), Error> {
        let start = line.clock.now();
        let time = Duration::try_from(self.seconds).unwrap_or(Duration::MAX);
        let mut status = self.status.bar(time.as_micros());
        let read = line.run(&mut survey, stop, |survey, now| {
            let since = now.since(start);
            status.show_at(since.as_micros(), || progress(since, &survey.servos));
            since < time
        });
        drop(status);
        let printed = self.print(&Report {
            baud,
            survey: &survey,
            pause: line.pause,
        });
        // A lost port does not take the report so far along.
        read.and(printed)
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
                Err(Error::at(
                    &self.port.to_string(),
                    format!("found: {}", names.join(", ")),
                ))
            }
        }
    }
}

/// The probable cause of the silence of all servos. Echoes are bytes of this computer, and none of a servo.
fn missing(noise: u64, unsolicited: u64) -> Missing {
    match (noise, unsolicited) {
        (0, 0) => Missing::Silent,
        (_, 0) => Missing::Foreign,
        _ => Missing::Elsewhere,
    }
}

/// A number of servos, in words.
fn servos(count: usize) -> String {
    match count {
        1 => "1 servo".into(),
        count => format!("{count} servos"),
    }
}

/// The reading after this time, in words.
fn progress(since: Duration, servos: &[Servo]) -> String {
    let sum = |count: fn(&Servo) -> u64| servos.iter().map(count).sum::<u64>();
    format!(
        "{} s: {} answers, {} lost, {} late, {} damaged",
        since.as_micros() / 1_000_000,
        sum(|servo| servo.latencies.len() as u64),
        sum(|servo| servo.lost.into()),
        sum(|servo| servo.late.into()),
        sum(|servo| servo.damaged.into()),
    )
}

/// The port, and the time.
struct Line {
    port: RawPort,
    clock: Stopwatch,
    /// The longest time by which a wait was longer than it should have been.
    pause: Duration,
}

impl Line {
    fn new(port: RawPort) -> Self {
        Self {
            port,
            clock: Stopwatch::start(),
            pause: Duration::ZERO,
        }
    }

    /// Surveys the bus while `goes_on`, until Ctrl-C.
    fn run(
        &mut self,
        survey: &mut Survey,
        stop: &AtomicBool,
        mut goes_on: impl FnMut(&Survey, Instant) -> bool,
    ) -> Result<(), Error> {
        let (mut out, mut input) = ([0; MAX_FRAME], [0; 512]);
        while goes_on(survey, self.clock.now()) && !stop.load(Ordering::Relaxed) {
            if let Some(n) = survey.request(self.clock.now(), &mut out) {
                self.port.write_all(&out[..n])?;
            }
            // A port that takes no bytes is no pause of this computer.
            let before = self.clock.now();
            let n = self.port.read(&mut input, WAIT)?;
            let now = self.clock.now();
            let waited = now.since(before + Duration::try_from(WAIT).unwrap_or(Duration::ZERO));
            self.pause = self.pause.max(waited);
            survey.receive(now, &input[..n]);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ANSWER_OF_2: [u8; 6] = [0xFF, 0xFF, 0x02, 0x02, 0x00, 0xFB];

    /// A search for servo 1 that receives what this makes of its request.
    fn search(receive: fn(&[u8]) -> Vec<u8>) -> Survey {
        let (mut survey, mut out) = (Survey::new(&[1], timing(1_000_000)), [0; MAX_FRAME]);
        let n = survey.request(Instant::ZERO, &mut out).unwrap();
        survey.receive(Instant::ZERO, &receive(&out[..n]));
        survey
    }

    #[test]
    fn silence_foreign_bytes_and_other_answers_are_told_apart() {
        let bus = Bus {
            port: "tcp:localhost:7000".parse().unwrap(),
            seconds: time::Duration::ZERO,
            ids: Ids(vec![1]),
            baud: Baud(None),
            json: false,
            fail_on: Vec::new(),
            status: StatusArg::default(),
        };
        for (surveys, expected) in [
            (vec![search(|_| Vec::new())], (Missing::Silent, 0)),
            (vec![search(<[u8]>::to_vec)], (Missing::Silent, 8)),
            (
                vec![search(<[u8]>::to_vec), search(|_| vec![7; 3])],
                (Missing::Foreign, 11),
            ),
            (
                vec![search(|_| ANSWER_OF_2.to_vec()), search(|_| vec![7; 3])],
                (Missing::Elsewhere, 9),
            ),
        ] {
            let Host::NoAnswer { missing, bytes, .. } = bus.no_servo(&surveys) else {
                panic!("no missing answer");
            };
            assert_eq!((missing, bytes), expected);
        }
    }
}
