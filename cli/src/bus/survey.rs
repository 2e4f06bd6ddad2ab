//! The reads of a servo bus, and what became of each. No I/O.

use armwire::Config;
use armwire_bridge::{Duration, Instant};
use armwire_feetech::register::{self, Register};
use armwire_feetech::{Event, Feetech, Host, MAX_FRAME, Request, Status};

/// Time beyond the line's after which an answer is late, on a serial port.
const LATENCY: Duration = Duration::from_millis(40);
/// Time after which a late answer is lost, on a serial port.
const STALE: Duration = Duration::from_millis(500);
/// Shortest time from one reading of all servos to the next.
const PERIOD: Duration = Duration::from_millis(10);
/// Times that a setting is asked for.
const TRIES: u8 = 3;

/// The registers of settings: the first 40 bytes.
const SETTINGS: (u8, u8) = (0, register::TORQUE.address);
/// The registers of readings, from the torque to the current.
const READINGS: (u8, u8) = (
    register::TORQUE.address,
    register::CURRENT.address + 2 - register::TORQUE.address,
);

/// The counts and readings of a servo.
#[derive(Clone, Debug, Default)]
pub(super) struct Servo {
    pub(super) id: u8,
    /// The bytes from address 0 on, without those that were not read.
    settings: Vec<u8>,
    /// The number of requests for them, and the time of the next one.
    tries: u8,
    next_try: Instant,
    /// The bytes of the last reading.
    readings: Vec<u8>,
    pub(super) volts: Option<(i32, i32)>,
    /// The largest load, without its sign, in thousandths, and the highest temperature. None without a reading.
    pub(super) load: Option<i32>,
    pub(super) temperature: Option<i32>,
    /// The error bits of all answers.
    pub(super) errors: u8,
    pub(super) lost: u32,
    pub(super) late: u32,
    pub(super) damaged: u32,
    /// Times from request to answer.
    pub(super) latencies: Vec<Duration>,
}

impl Servo {
    /// A setting. None if it was not read.
    pub(super) fn setting(&self, row: Register) -> Option<i32> {
        value(&self.settings, SETTINGS.0, row)
    }

    /// True if its torque is on. None without a reading.
    pub(super) fn has_torque(&self) -> Option<bool> {
        value(&self.readings, READINGS.0, register::TORQUE).map(|torque| torque == 1)
    }

    fn take_readings(&mut self, bytes: &[u8]) {
        self.readings = bytes.to_vec();
        let value = |row| value(bytes, READINGS.0, row).unwrap_or(0);
        let volts = value(register::VOLTAGE);
        let (least, most) = self.volts.unwrap_or((volts, volts));
        self.volts = Some((least.min(volts), most.max(volts)));
        self.load = self.load.max(Some(value(register::LOAD).abs()));
        self.temperature = self.temperature.max(Some(value(register::TEMPERATURE)));
    }
}

/// The value of a register in bytes that begin at this address.
fn value(bytes: &[u8], first: u8, row: Register) -> Option<i32> {
    let at = usize::from(row.address.checked_sub(first)?);
    let bytes = bytes.get(at..at + usize::from(row.len))?;
    let high = if row.len == 2 { bytes[1] } else { 0 };
    Some(row.value([bytes[0], high]))
}

/// The purpose of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Purpose {
    /// A servo with this id.
    Id,
    /// Settings or readings of the servo with this index.
    Settings(usize),
    Readings(usize),
}

/// The request in flight.
#[derive(Clone, Copy, Debug)]
struct Asked {
    purpose: Purpose,
    id: u8,
    area: (u8, u8),
    at: Instant,
    /// Noise came after it.
    is_damaged: bool,
}

/// The timing of a serial port at this baud rate.
pub(super) fn timing(baud: u32) -> Config {
    Config {
        baud: baud.try_into().ok(),
        latency: LATENCY,
        stale_window: STALE,
        ..Config::DEFAULT
    }
}

/// A survey of the servos with some ids.
pub(super) struct Survey {
    host: Host<64>,
    /// Time after which no answer to a request arrives any more.
    lost_after: Duration,
    /// Servos are searched for: an answer may still come.
    is_searching: bool,
    /// Ids that were not asked for yet, the last one first.
    ids: Vec<u8>,
    pub(super) servos: Vec<Servo>,
    asked: Option<Asked>,
    /// The servo to read next, and the begin of this round.
    next: usize,
    round: Instant,
    pub(super) noise: u64,
    pub(super) echoes: u64,
    pub(super) unsolicited: u64,
}

impl Survey {
    /// A survey of the servos with these ids on a line with this timing.
    pub(super) fn new(ids: &[u8], config: Config) -> Self {
        Self {
            host: Host::new(Feetech::default(), config),
            lost_after: config.latency + config.stale_window,
            is_searching: true,
            ids: ids.iter().rev().copied().collect(),
            servos: Vec::new(),
            asked: None,
            next: 0,
            round: Instant::ZERO,
            noise: 0,
            echoes: 0,
            unsolicited: 0,
        }
    }

    /// True while servos are searched for.
    pub(super) fn is_searching(&self) -> bool {
        self.is_searching
    }

    /// The number of ids that were not asked for yet.
    pub(super) fn ids_left(&self) -> usize {
        self.ids.len()
    }

    /// The number of bytes received.
    pub(super) fn received(&self) -> u64 {
        self.host.decoder.received()
    }

    /// Writes the next request, if it is time for one, and returns its length. Each is a read.
    pub(super) fn request(&mut self, now: Instant, out: &mut [u8; MAX_FRAME]) -> Option<usize> {
        if self.asked.is_some() {
            return None;
        }
        if self.is_searching && self.ids.is_empty() {
            // A servo may answer late.
            self.is_searching = !self.host.exchange.is_idle();
            return None;
        }
        let (purpose, id, area) = self.next(now)?;
        let (address, len) = area;
        let sent = self.host.send(&Request::Read { id, address, len }, now, out);
        match purpose {
            Purpose::Id => drop(self.ids.pop()),
            Purpose::Settings(index) => {
                let servo = &mut self.servos[index];
                (servo.tries, servo.next_try) = (servo.tries + 1, now + self.lost_after);
            }
            Purpose::Readings(_) => self.next += 1,
        }
        // An answer of this servo may still arrive: it is asked again in the next round.
        let n = sent.ok().flatten()?;
        let (at, is_damaged) = (now, false);
        self.asked = Some(Asked {
            purpose,
            id,
            area,
            at,
            is_damaged,
        });
        Some(n)
    }

    /// The next request, if it is time for one.
    fn next(&mut self, now: Instant) -> Option<(Purpose, u8, (u8, u8))> {
        if let Some(id) = self.ids.last() {
            // Not a ping, whose echo is the answer of a servo with an error.
            return Some((Purpose::Id, *id, (register::ID.address, register::ID.len)));
        }
        let lacks_settings = |servo: &Servo| servo.settings.is_empty() && servo.tries < TRIES && servo.next_try <= now;
        if let Some(index) = self.servos.iter().position(lacks_settings) {
            return Some((Purpose::Settings(index), self.servos[index].id, SETTINGS));
        }
        if self.next >= self.servos.len() && self.round + PERIOD <= now {
            (self.next, self.round) = (0, now);
        }
        let servo = self.servos.get(self.next)?;
        Some((Purpose::Readings(self.next), servo.id, READINGS))
    }

    /// Takes received bytes, and the time.
    pub(super) fn receive(&mut self, now: Instant, mut bytes: &[u8]) {
        loop {
            bytes = self.host.decoder.push(bytes);
            while let Some(event) = self.host.poll(now) {
                match event {
                    Event::Answer(status) => {
                        if let Some(asked) = self.asked.take_if(|asked| asked.id == status.id) {
                            answered(&mut self.servos, asked, now, status);
                        }
                    }
                    Event::Missing(id) => {
                        // A packet with a wrong length ends here.
                        self.host.decoder.idle();
                        if let Some(asked) = self.asked.take_if(|asked| asked.id == id) {
                            missing(&mut self.servos, asked);
                        }
                    }
                    Event::Late(status) => late(&mut self.servos, status),
                    Event::Unsolicited(status) if self.asked.is_some_and(|asked| is_echo(asked, status)) => {
                        self.echoes += 1;
                    }
                    Event::Unsolicited(_) => self.unsolicited += 1,
                    Event::Echo(_) => self.echoes += 1,
                    Event::Noise(bytes, _) => {
                        self.noise += bytes.len() as u64;
                        self.asked.iter_mut().for_each(|asked| asked.is_damaged = true);
                    }
                }
            }
            if bytes.is_empty() {
                return;
            }
        }
    }
}

/// Returns true for the echo of a read: it has the form of an answer.
fn is_echo(asked: Asked, status: Status<'_>) -> bool {
    let (address, len) = asked.area;
    (status.id, status.error, status.data) == (asked.id, 2, &[address, len])
}

/// Takes an answer whose request counts as lost.
fn late(servos: &mut Vec<Servo>, status: Status<'_>) {
    let mut servo = servos.iter_mut().find(|servo| servo.id == status.id);
    if let Some(servo) = &mut servo {
        servo.errors |= status.error;
    }
    match servo {
        None => found(servos, status),
        Some(servo) if status.data.len() == usize::from(SETTINGS.1) => servo.settings = status.data.to_vec(),
        Some(servo) if status.data.len() == usize::from(READINGS.1) => {
            (servo.lost, servo.late) = (servo.lost.saturating_sub(1), servo.late + 1);
        }
        Some(_) => {}
    }
}

/// Adds a servo, in the order of ids.
fn found(servos: &mut Vec<Servo>, status: Status<'_>) {
    let (id, errors) = (status.id, status.error);
    let at = servos.partition_point(|servo| servo.id < id);
    servos.insert(
        at,
        Servo {
            id,
            errors,
            ..Servo::default()
        },
    );
}

fn answered(servos: &mut Vec<Servo>, asked: Asked, now: Instant, status: Status<'_>) {
    let (Purpose::Settings(index) | Purpose::Readings(index)) = asked.purpose else {
        return found(servos, status);
    };
    let servo = &mut servos[index];
    servo.errors |= status.error;
    match asked.purpose {
        Purpose::Settings(_) => servo.settings = status.data.to_vec(),
        _ => {
            servo.latencies.push(now.since(asked.at));
            servo.take_readings(status.data);
        }
    }
}

fn missing(servos: &mut [Servo], asked: Asked) {
    if let Purpose::Readings(index) = asked.purpose {
        match asked.is_damaged {
            true => servos[index].damaged += 1,
            false => servos[index].lost += 1,
        }
    }
}

#[cfg(test)]
mod tests {
    use armwire_sim::serial::SerialDevice;
    use armwire_sim::so101::{Config, So101};

    use super::*;

    /// Surveys a virtual arm for a second of virtual time, with these orders once its servos are found.
    fn survey(mut arm: So101, orders: &[&str]) -> Survey {
        let (mut survey, mut out) = (
            Survey::new(&[0, 1, 2, 3, 4, 5, 6, 7], timing(1_000_000)),
            [0; MAX_FRAME],
        );
        let mut orders = Some(orders);
        for micros in (0..2_000_000).step_by(50) {
            let now = Instant::from_micros(micros);
            let bytes: Vec<u8> = std::iter::from_fn(|| arm.transmit(now)).collect();
            survey.receive(now, &bytes);
            if !survey.is_searching() {
                for order in orders.take().into_iter().flatten() {
                    arm.order(now, order.parse().unwrap()).unwrap();
                }
            }
            if let Some(n) = survey.request(now, &mut out) {
                out[..n].iter().for_each(|byte| arm.receive(now, *byte));
            }
        }
        survey
    }

    fn arm() -> So101 {
        So101::new(Config::default())
    }

    #[test]
    fn servos_are_found_and_read() {
        let survey = survey(arm(), &[]);
        assert_eq!(
            survey.servos.iter().map(|servo| servo.id).collect::<Vec<_>>(),
            [1, 2, 3, 4, 5, 6]
        );
        for servo in &survey.servos {
            assert!(
                servo.latencies.len() > 100 && servo.lost + servo.late + servo.damaged == 0,
                "{servo:?}"
            );
            assert_eq!(
                (servo.setting(register::MODEL), servo.volts),
                (Some(777), Some((74, 74)))
            );
            assert_eq!(
                (servo.has_torque(), servo.temperature, servo.errors),
                (Some(false), Some(31), 0)
            );
        }
        assert_eq!((survey.noise, survey.echoes, survey.unsolicited), (0, 0, 0));
    }

    #[test]
    fn late_servo_is_found_too() {
        let mut arm = arm();
        arm.order(Instant::ZERO, "late 3:200".parse().unwrap()).unwrap();
        let survey = survey(arm, &[]);
        assert_eq!(
            survey.servos.iter().map(|servo| servo.id).collect::<Vec<_>>(),
            [1, 2, 3, 4, 5, 6]
        );
    }

    #[test]
    fn error_of_a_late_answer_is_kept() {
        let mut servos = vec![Servo {
            id: 1,
            ..Servo::default()
        }];
        let (id, error, data) = (1, 32, &[][..]);
        late(&mut servos, Status { id, error, data });
        assert_eq!(servos[0].errors, 32);
    }

    #[test]
    fn each_fault_is_counted_for_its_servo() {
        let survey = survey(arm(), &["late 15", "error 4 32", "damaged 40"]);
        let sum = |count: fn(&Servo) -> u32| survey.servos.iter().map(count).sum::<u32>();
        assert_eq!(
            (
                sum(|servo| servo.late),
                sum(|servo| servo.damaged),
                sum(|servo| servo.lost)
            ),
            (1, 1, 0)
        );
        assert_eq!(survey.servos[3].errors, 32);
        assert!(survey.noise > 0);
    }

    #[test]
    fn silent_servo_is_lost_and_others_are_read() {
        let survey = survey(arm(), &["silent 3"]);
        assert!(survey.servos[2].lost >= 2, "{:?}", survey.servos[2]);
        assert!(
            survey
                .servos
                .iter()
                .filter(|servo| servo.id != 3)
                .all(|servo| servo.lost == 0)
        );
    }

    #[test]
    fn echoes_are_no_answers() {
        let mut arm = arm();
        arm.order(Instant::ZERO, "echo".parse().unwrap()).unwrap();
        let survey = survey(arm, &[]);
        assert_eq!(survey.servos.len(), 6);
        assert!(survey.echoes > 100 && survey.noise == 0);
        assert!(survey.servos.iter().all(|servo| servo.errors == 0 && servo.lost == 0));
    }
}
