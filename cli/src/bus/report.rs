//! The report of a survey: a table, findings with advice, JSON.

use std::collections::BTreeMap;
use std::fmt::Write;

use armwire_bridge::Duration;
use armwire_feetech::register::{self, Access, REGISTERS, Register};
use armwire_feetech::{ERRORS, MAX_FRAME};
use clap::ValueEnum;
use serde_json::{Value, json};

use super::survey::{Servo, Survey};

/// A pause of this computer from which on a program with a timeout of 50 ms gives answers up.
const LONG_PAUSE: Duration = Duration::from_millis(50);
/// Settings that servos do not share.
const OWN: [Register; 4] = [
    register::ID,
    register::OFFSET,
    register::MIN_POSITION,
    register::MAX_POSITION,
];

/// A kind of finding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
pub(super) enum Kind {
    /// Answers that did not come.
    Lost,
    /// Answers that came too late.
    Late,
    /// Answers with a wrong checksum or length.
    Damaged,
    /// Error bits of servos.
    Errors,
    /// Settings that differ between servos.
    Differs,
    /// Bytes that are no packet, or packets that were not asked for.
    Noise,
    /// A line that returns the host's bytes.
    Echo,
    /// A pause of this computer of 50 ms or more.
    Pause,
}

impl Kind {
    pub(super) fn name(self) -> String {
        self.to_possible_value()
            .map_or_else(String::new, |value| value.get_name().to_owned())
    }
}

/// A finding, with advice.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Finding {
    pub(super) kind: Kind,
    pub(super) text: String,
}

/// A finished survey.
pub(super) struct Report<'a> {
    /// The baud rate of a serial port.
    pub(super) baud: Option<u32>,
    pub(super) survey: &'a Survey,
    /// The longest time that this computer did not run the program when it should have.
    pub(super) pause: Duration,
}

impl Report<'_> {
    pub(super) fn findings(&self) -> Vec<Finding> {
        let servos = &self.survey.servos;
        let missing = [
            missing(Kind::Lost, servos, |servo| servo.lost),
            missing(Kind::Late, servos, |servo| servo.late),
            missing(Kind::Damaged, servos, |servo| servo.damaged),
        ];
        let errors = servos.iter().filter(|servo| servo.errors != 0).map(failing);
        let settings = REGISTERS.iter().filter(|row| is_shared(row));
        let differences = settings.filter_map(|row| difference(*row, servos));
        let findings = missing.into_iter().flatten().chain(errors).chain(differences);
        findings.chain(self.of_line()).collect()
    }

    /// The findings about the line and this computer.
    fn of_line(&self) -> impl Iterator<Item = Finding> {
        let Survey {
            noise,
            unsolicited,
            echoes,
            ..
        } = *self.survey;
        let noise = (noise > 0 || unsolicited > 0).then(|| Finding {
            kind: Kind::Noise,
            text: format!(
                "{noise} noise bytes, {unsolicited} answers without a request: of damaged or repeated answers, of ids that \
                 occur twice, or of another program on the bus"
            ),
        });
        let echo = (echoes > 0).then(|| Finding {
            kind: Kind::Echo,
            text:
                "the line returns the host's bytes: use a board with a direction switch, or a program that skips its \
                   own bytes"
                    .to_owned(),
        });
        let pause = (self.pause >= LONG_PAUSE).then(|| Finding {
            kind: Kind::Pause,
            text: format!(
                "this computer paused for {} ms: a program that gives answers up in that time may take them for later ones",
                self.pause.as_micros() / 1000
            ),
        });
        [noise, echo, pause].into_iter().flatten()
    }

    pub(super) fn text(&self) -> String {
        let mut text = String::new();
        let mut row = |cells: [&str; 13]| {
            let [
                id,
                model,
                firmware,
                volts,
                heat,
                load,
                torque,
                answers,
                lost,
                late,
                damaged,
                times,
                errors,
            ] = cells;
            let _ = writeln!(
                text,
                "{id:>3}  {model:>5}  {firmware:>8}  {volts:>9}  {heat:>4}  {load:>5}  {torque:>6}  {answers:>7}  {lost:>4}  \
                 {late:>4}  {damaged:>7}  {times:>18}  {errors}"
            );
        };
        row([
            "id",
            "model",
            "firmware",
            "volts",
            "°C",
            "load",
            "torque",
            "answers",
            "lost",
            "late",
            "damaged",
            "ms: median p99 max",
            "errors",
        ]);
        for servo in &self.survey.servos {
            let setting = |row| {
                servo
                    .setting(row)
                    .map_or_else(|| "-".to_owned(), |value| value.to_string())
            };
            let firmware = format!(
                "{}.{}",
                setting(register::FIRMWARE_MAJOR),
                setting(register::FIRMWARE_MINOR)
            );
            let volts = servo.volts.map_or_else(
                || "-".to_owned(),
                |(least, most)| format!("{}-{}", tenths(least), tenths(most)),
            );
            let times = latencies(servo).map(|times| times.map(|time| format!("{time:.1}")).join(" "));
            let dash = || "-".to_owned();
            row([
                &servo.id.to_string(),
                &setting(register::MODEL),
                &firmware,
                &volts,
                &servo.temperature.map_or_else(dash, |celsius| celsius.to_string()),
                &servo.load.map_or_else(dash, |load| format!("{}%", tenths(load))),
                servo
                    .has_torque()
                    .map_or("-", |torque| if torque { "on" } else { "off" }),
                &servo.latencies.len().to_string(),
                &servo.lost.to_string(),
                &servo.late.to_string(),
                &servo.damaged.to_string(),
                &times.unwrap_or_else(dash),
                &if servo.errors == 0 {
                    "-".to_owned()
                } else {
                    errors(servo.errors)
                },
            ]);
        }
        let pause = self.pause.as_micros() as f64 / 1e3;
        let baud = self.baud.map_or_else(String::new, |baud| format!("{baud} baud; "));
        let _ = writeln!(
            text,
            "{baud}{} noise bytes, {} answers without a request, {} echoes; longest pause of this computer {pause:.1} ms",
            self.survey.noise, self.survey.unsolicited, self.survey.echoes
        );
        for finding in self.findings() {
            let _ = writeln!(text, "{}: {}", finding.kind.name(), finding.text);
        }
        text
    }

    pub(super) fn json(&self) -> Value {
        let servos: Vec<_> = self.survey.servos.iter().map(servo_json).collect();
        let findings = self.findings().into_iter();
        let findings: Vec<_> = findings
            .map(|finding| json!({ "kind": finding.kind.name(), "text": finding.text }))
            .collect();
        json!({
            "baud": self.baud,
            "servos": servos,
            "noise_bytes": self.survey.noise,
            "answers_without_a_request": self.survey.unsolicited,
            "echoes": self.survey.echoes,
            "longest_pause_ms": self.pause.as_micros() as f64 / 1e3,
            "findings": findings,
        })
    }
}

/// The finding that answers of some servos are missing in this way.
fn missing(kind: Kind, servos: &[Servo], count: impl Fn(&Servo) -> u32) -> Option<Finding> {
    let ids = servos.iter().filter(|servo| count(servo) > 0).map(|servo| servo.id);
    let ids: Vec<_> = ids.collect();
    let advice = match kind {
        Kind::Lost => "check the cable to the first of them, and its supply",
        Kind::Late => "a program that gives them up earlier may take them for later ones",
        _ => "check the ground, the length of the cables, and ids that occur twice",
    };
    let text = || format!("answers of {} are {}: {advice}", list(&ids), kind.name());
    (!ids.is_empty()).then(|| Finding { kind, text: text() })
}

/// The finding that a servo reports errors.
fn failing(servo: &Servo) -> Finding {
    let limits = (
        servo.setting(register::MIN_VOLTAGE),
        servo.setting(register::MAX_VOLTAGE),
    );
    let advice = match (servo.volts, limits) {
        (Some((least, most)), (Some(min), Some(max))) if least < min || most > max => format!(
            "its supply is {} to {} V, its registers 15 and 14 allow {} to {} V",
            tenths(least),
            tenths(most),
            tenths(min),
            tenths(max)
        ),
        _ => "many programs refuse its answers".to_owned(),
    };
    let text = format!("servo {} reports {}: {advice}", servo.id, errors(servo.errors));
    let kind = Kind::Errors;
    Finding { kind, text }
}

/// The finding that a setting differs between servos.
fn difference(row: Register, servos: &[Servo]) -> Option<Finding> {
    let mut values: BTreeMap<i32, Vec<u8>> = BTreeMap::new();
    for servo in servos {
        if let Some(value) = servo.setting(row) {
            values.entry(value).or_default().push(servo.id);
        }
    }
    let advice = match row {
        register::FIRMWARE_MAJOR | register::FIRMWARE_MINOR => ": some programs refuse such a bus",
        register::RETURN_DELAY => ": each 250 takes 0.5 ms of an answer",
        _ => "",
    };
    let is_different = values.len() > 1;
    let values = values.iter().map(|(value, ids)| format!("{value} ({})", list(ids)));
    let text = format!(
        "{} differs: {}{advice}",
        row.name,
        values.collect::<Vec<_>>().join(", ")
    );
    let kind = Kind::Differs;
    is_different.then_some(Finding { kind, text })
}

fn servo_json(servo: &Servo) -> Value {
    let latency = latencies(servo);
    let settings = REGISTERS
        .iter()
        .filter_map(|row| Some((row.name.to_owned(), servo.setting(*row)?.into())));
    json!({
        "id": servo.id,
        "settings": Value::Object(settings.collect()),
        "volts": servo.volts.map(|(least, most)| [f64::from(least) / 10.0, f64::from(most) / 10.0]),
        "temperature": servo.temperature,
        "load_percent": servo.load.map(|load| f64::from(load) / 10.0),
        "torque": servo.has_torque(),
        "answers": servo.latencies.len(),
        "lost": servo.lost,
        "late": servo.late,
        "damaged": servo.damaged,
        "latency_ms": latency.map(|[median, p99, max]| json!({ "median": median, "p99": p99, "max": max })),
        "error_bits": servo.errors,
    })
}

/// True for a setting that the servos of an arm usually have in common.
fn is_shared(row: &Register) -> bool {
    let is_version = [register::FIRMWARE_MAJOR, register::FIRMWARE_MINOR, register::MODEL].contains(row);
    is_version || row.access == Access::Eeprom && !OWN.contains(row)
}

/// The median, the 99th percentile and the maximum, in ms. None without an answer.
fn latencies(servo: &Servo) -> Option<[f64; 3]> {
    let mut times = servo.latencies.clone();
    times.sort_unstable();
    let last = times.len().checked_sub(1)?;
    Some([50, 99, 100].map(|percent| times[(times.len() * percent / 100).min(last)].as_micros() as f64 / 1e3))
}

fn tenths(count: i32) -> String {
    format!("{:.1}", f64::from(count) / 10.0)
}

/// The names of error bits.
fn errors(bits: u8) -> String {
    let set = (0..).zip(ERRORS).filter(|(bit, _)| bits >> bit & 1 != 0);
    set.map(|(_, name)| name).collect::<Vec<_>>().join(", ")
}

/// Ids, as 'servo 3' or 'servos 3, 4'.
fn list(ids: &[u8]) -> String {
    let numbers: Vec<_> = ids.iter().map(u8::to_string).collect();
    let noun = if ids.len() == 1 { "servo" } else { "servos" };
    format!("{noun} {}", numbers.join(", "))
}

// A request of all settings and its answer fit a packet.
const _: () = assert!(register::TORQUE.address as usize + 6 <= MAX_FRAME);
