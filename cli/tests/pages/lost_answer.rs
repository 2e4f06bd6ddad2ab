//! The page about latency states what a lost answer of a Ling arm costs. It is measured in virtual time.

use armwire::Config;
use armwire::ling::{Ling, MAX_FRAME, Request, Response};
use armwire_bridge::{Duration, Instant};
use armwire_host::describe::Arm;
use armwire_sim::ling::{self, LingArm};
use armwire_sim::serial::SerialDevice;
use armwire_sim::wire::Wire;

const LATENCY: &str = include_str!("../../../docs/latency.md");
const PYTHON: &str = include_str!("../../../docs/python.md");
const LING_PY: &str = include_str!("../../../python/python/armwire/_ling.py");

/// An arm whose line loses some of its answers.
struct Lossy {
    arm: LingArm,
    /// The numbers of the lost answers, from 0 on.
    lost: Vec<usize>,
    /// The number of the answer that is being sent, its bytes so far, and its length once that is known.
    answer: usize,
    sent: usize,
    len: usize,
}

impl Lossy {
    /// Returns true if the next byte of the arm is one of a lost answer.
    fn loses(&mut self, byte: u8) -> bool {
        /// The place of the length in a frame, and the bytes beside the data.
        const LENGTH: (usize, usize) = (3, 6);
        let is_lost = self.lost.contains(&self.answer);
        if self.sent == LENGTH.0 {
            self.len = usize::from(byte) + LENGTH.1;
        }
        self.sent += 1;
        if self.sent == self.len {
            (self.answer, self.sent, self.len) = (self.answer + 1, 0, 0);
        }
        is_lost
    }
}

impl SerialDevice for Lossy {
    fn receive(&mut self, now: Instant, byte: u8) {
        self.arm.receive(now, byte);
    }

    fn transmit(&mut self, now: Instant) -> Option<u8> {
        loop {
            let byte = self.arm.transmit(now)?;
            if !self.loses(byte) {
                return Some(byte);
            }
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.arm.poll_timeout()
    }
}

/// The durations of two reads on a line that loses these answers. `Err` for those that fail.
fn reads(config: Config, lost: &[usize]) -> [Result<Duration, Duration>; 2] {
    let device = Lossy {
        arm: LingArm::new(ling::Config::follower()),
        lost: lost.to_vec(),
        answer: 0,
        sent: 0,
        len: 0,
    };
    let mut wire = Wire::<Ling, _, MAX_FRAME>::new(config, device);
    [(); 2].map(|()| {
        let begin = wire.elapsed();
        let is_answered = matches!(wire.call(Request::ReadJoints), Ok(Some(Response::Joints(_))));
        let duration = wire.elapsed().since(begin);
        if is_answered { Ok(duration) } else { Err(duration) }
    })
}

/// A duration in seconds with this number of decimals, without zeros at its end.
fn seconds(duration: Duration, decimals: usize) -> String {
    let rounded = format!("{:.decimals$}", duration.as_micros() as f64 / 1e6);
    rounded.trim_end_matches('0').to_owned()
}

/// The cost of losses: the time by which a read is longer.
fn cost(config: Config, lost: &[usize], read: usize) -> Duration {
    let usual = reads(config, &[])[read].unwrap();
    let (Ok(duration) | Err(duration)) = reads(config, lost)[read];
    Duration::from_micros(duration.as_micros() - usual.as_micros())
}

#[test]
fn page_states_the_cost_of_a_lost_answer() {
    let says = |text: &str| assert!(LATENCY.contains(text), "{text}");
    let [on_pc, of_crate] = [Ling::CONFIG, Config::DEFAULT];
    let both = |lost: &[usize]| [on_pc, of_crate].map(|config| seconds(cost(config, lost, 0), 2));
    let [pc, own] = both(&[0]);
    says(&format!(
        "\n| one lost answer to a call, which is repeated | {pc} s | {own} s |\n"
    ));
    says(&format!("| a lost answer | {pc} s until the repeat of `read_joints`: "));
    let [pc, own] = both(&[0, 1]);
    says(&format!("\n| two in a row | {pc} s | {own} s |\n"));
    let three = &[0, 1, 2];
    assert!([on_pc, of_crate].iter().all(|config| reads(*config, three)[0].is_err()));
    let [pc, own] = both(three);
    says(&format!(
        "\n| three in a row: the call fails | after {pc} s | after {own} s |\n"
    ));
}

#[test]
fn page_states_the_cost_of_a_lost_fence() {
    let [pc, own] = [Ling::CONFIG, Config::DEFAULT].map(|config| {
        // The read after a lost answer: without a loss, with one fence that is lost, and with two.
        let [none, one, two] = [&[0][..], &[0, 2], &[0, 2, 3]].map(|lost| cost(config, lost, 1).as_micros() / 1_000);
        assert_eq!(none, 0, "it is the answer to the fence");
        [one, two - one]
    });
    let ([first, second], [own_first, own_second]) = (pc, own);
    let row = format!("{first} ms more if that is lost, then {second} ms | {own_first} ms, {own_second} ms |");
    assert!(LATENCY.contains(&row), "{row}");
}

#[test]
fn page_states_the_time_of_a_silent_line() {
    let all: Vec<_> = (0..100).collect();
    let [pc, own] = [Ling::CONFIG, Config::DEFAULT].map(|config| {
        let [_, second] = reads(config, &all);
        seconds(second.unwrap_err(), 2)
    });
    let row = format!("until it lets go | calls fail after {pc} s | after {own} s |");
    assert!(LATENCY.contains(&row), "{row}");
}

#[test]
fn pages_state_the_time_of_an_absent_arm() {
    let late = Ling::CONFIG.stale_window;
    let total = seconds(cost(Ling::CONFIG, &[0, 1, 2], 0) + late, 1);
    let late = seconds(late, 1);
    let page = LATENCY.split_whitespace().collect::<Vec<_>>().join(" ");
    let sentence = format!("waits {late} s more for a late answer before it fails, {total} s in all.");
    assert!(page.contains(&sentence), "{sentence}");
    assert!(page.contains(&format!("an answer is lost if it is {late} s late.")));
    assert!(PYTHON.contains(&format!("an absent Ling arm is reported after {total} s.")));
    assert!(LING_PY.contains(&format!("Reads are retried twice and time out after {total} s.")));
}

#[test]
fn page_states_the_allowance_of_each_config() {
    let millis = |duration: Duration| duration.as_micros() / 1_000;
    let [pc, own] = [Ling::CONFIG, Config::DEFAULT].map(|config| millis(config.latency));
    let page = LATENCY.split_whitespace().collect::<Vec<_>>().join(" ");
    for sentence in [
        format!("They allow {pc} ms for a busy system, the defaults of the crate {own} ms."),
        format!(
            "A TCP connection allows {} s more for each answer, and an answer may be {} late there.",
            seconds(Config::TCP.latency, 1),
            match millis(Config::TCP.stale_window) {
                1_000 => "a second",
                other => panic!("{other} ms"),
            }
        ),
    ] {
        assert!(page.contains(&sentence), "{sentence}");
    }
}
