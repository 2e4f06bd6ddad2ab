//! A line with faults: bytes are dropped, corrupted, duplicated, delayed or inserted.
//!
//! Each direction has its own random sequence from the seed: the same bytes get the same faults in every run.

use std::collections::VecDeque;

use armwire::time::{Duration, Instant};
use oorandom::Rand32;
#[cfg(test)]
use proptest::prelude::*;

use crate::serial::SerialDevice;

/// Rate of each fault, in parts per million of the bytes.
///
/// ```
/// use armwire_sim::faults::Rates;
///
/// let one_in_a_hundred_damaged = Rates { corrupt: 10_000, ..Rates::NONE };
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rates {
    /// The byte does not arrive.
    pub drop: u32,
    /// One of its bits is flipped.
    pub corrupt: u32,
    /// It arrives twice.
    pub duplicate: u32,
    /// It is delayed by up to `max_delay`, and the following bytes with it.
    pub delay: u32,
    /// A random byte arrives before it.
    pub noise: u32,
    /// The longest delay.
    pub max_delay: Duration,
}

impl Rates {
    /// No faults.
    pub const NONE: Self = Self::each(0);

    /// Returns the same rate for each fault, with delays up to 5 ms.
    pub const fn each(ppm: u32) -> Self {
        Self {
            drop: ppm,
            corrupt: ppm,
            duplicate: ppm,
            delay: ppm,
            noise: ppm,
            max_delay: Duration::from_millis(5),
        }
    }
}

/// Count of each fault.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Injected {
    /// Bytes that did not arrive.
    pub dropped: u64,
    /// Bytes with a flipped bit.
    pub corrupted: u64,
    /// Bytes that arrived twice.
    pub duplicated: u64,
    /// Bytes that were delayed.
    pub delayed: u64,
    /// Bytes that were inserted.
    pub noise: u64,
}

/// One direction of the line.
#[derive(Debug)]
struct Direction {
    rates: Rates,
    random: Rand32,
    injected: Injected,
    /// Bytes with their due times, in order.
    queue: VecDeque<(Instant, u8)>,
}

impl Direction {
    fn new(rates: Rates, seed: u64, stream: u64) -> Self {
        Self {
            rates,
            random: Rand32::new_inc(seed, stream),
            injected: Injected::default(),
            queue: VecDeque::new(),
        }
    }

    fn happens(&mut self, ppm: u32) -> bool {
        self.random.rand_range(0..1_000_000) < ppm
    }

    fn random_byte(&mut self) -> u8 {
        self.random.rand_range(0..256) as u8
    }

    /// Applies the faults to a byte and queues the result.
    fn put(&mut self, now: Instant, mut byte: u8) {
        let rates = self.rates;
        // Delays overlap: no byte is later than `max_delay`, and none overtakes another.
        let mut due = self.queue.back().map_or(now, |&(due, _)| due.max(now));
        if self.happens(rates.noise) {
            self.injected.noise += 1;
            let noise = self.random_byte();
            self.queue.push_back((due, noise));
        }
        if self.happens(rates.drop) {
            self.injected.dropped += 1;
            return;
        }
        if self.happens(rates.corrupt) {
            self.injected.corrupted += 1;
            byte ^= 1 << self.random.rand_range(0..8);
        }
        if self.happens(rates.delay) {
            self.injected.delayed += 1;
            let longest = rates.max_delay.as_micros().min(u64::from(u32::MAX - 1)) as u32;
            let delay = Duration::from_micros(self.random.rand_range(0..longest + 1).into());
            due = due.max(now + delay);
        }
        self.queue.push_back((due, byte));
        if self.happens(rates.duplicate) {
            self.injected.duplicated += 1;
            self.queue.push_back((due, byte));
        }
    }

    fn take(&mut self, now: Instant) -> Option<(Instant, u8)> {
        self.queue.pop_front_if(|&mut (due, _)| due <= now)
    }

    fn due(&self) -> Option<Instant> {
        self.queue.front().map(|&(due, _)| due)
    }
}

/// A device behind a line with faults. It implements [`SerialDevice`] itself.
///
/// ```
/// use armwire::time::Instant;
/// use armwire_sim::faults::{Line, Rates};
/// use armwire_sim::ling::{Config, LingArm};
/// use armwire_sim::serial::SerialDevice;
///
/// let deaf = Rates { drop: 1_000_000, ..Rates::NONE };
/// let mut line = Line::new(LingArm::new(Config::follower()), deaf, Rates::NONE, 1);
/// line.receive(Instant::from_micros(10), 0xAA);
/// assert_eq!(line.device().counters().bytes, 0);
/// assert_eq!(line.injected_to_device().dropped, 1);
/// ```
#[derive(Debug)]
pub struct Line<D> {
    device: D,
    to_device: Direction,
    from_device: Direction,
}

impl<D: SerialDevice> Line<D> {
    /// Connects `device` by a line with these fault rates per direction.
    pub fn new(device: D, to_device: Rates, from_device: Rates, seed: u64) -> Self {
        Self {
            device,
            to_device: Direction::new(to_device, seed, 1),
            from_device: Direction::new(from_device, seed, 2),
        }
    }

    /// Sets the fault rates. Delayed bytes keep their delay.
    pub fn set_rates(&mut self, to_device: Rates, from_device: Rates) {
        self.to_device.rates = to_device;
        self.from_device.rates = from_device;
    }

    /// Returns the faults injected towards the device.
    pub fn injected_to_device(&self) -> Injected {
        self.to_device.injected
    }

    /// Returns the faults injected towards the host.
    pub fn injected_from_device(&self) -> Injected {
        self.from_device.injected
    }

    /// Returns the device.
    pub fn device(&self) -> &D {
        &self.device
    }

    /// Returns the device.
    pub fn device_mut(&mut self) -> &mut D {
        &mut self.device
    }

    fn deliver(&mut self, now: Instant) {
        while let Some((due, byte)) = self.to_device.take(now) {
            self.device.receive(due, byte);
        }
    }
}

impl<D: SerialDevice> SerialDevice for Line<D> {
    fn receive(&mut self, now: Instant, byte: u8) {
        self.deliver(now);
        self.to_device.put(now, byte);
        self.deliver(now);
    }

    fn transmit(&mut self, now: Instant) -> Option<u8> {
        self.deliver(now);
        while self.from_device.queue.is_empty() {
            let byte = self.device.transmit(now)?;
            self.from_device.put(now, byte);
        }
        self.from_device.take(now).map(|(_, byte)| byte)
    }

    fn poll_timeout(&self) -> Option<Instant> {
        // The device is not polled while one of its bytes is delayed.
        let from = self.from_device.due().or_else(|| self.device.poll_timeout());
        [self.to_device.due(), from].into_iter().flatten().min()
    }

    fn set_baud(&mut self, baud: u32) {
        self.device.set_baud(baud);
    }

    fn is_gone(&self) -> bool {
        self.device.is_gone()
    }
}

/// Generates fault rates, mostly low enough that some frames pass.
#[cfg(test)]
pub(crate) fn any_rates() -> impl Strategy<Value = Rates> {
    prop_oneof![
        1 => Just(0),
        8 => 0..20_000_u32,
        1 => 0..1_000_000_u32,
        1 => Just(1_000_000),
    ]
    .prop_map(Rates::each)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Echoes every byte at once.
    #[derive(Default)]
    struct Mirror(VecDeque<u8>);

    impl SerialDevice for Mirror {
        fn receive(&mut self, _now: Instant, byte: u8) {
            self.0.push_back(byte);
        }

        fn transmit(&mut self, _now: Instant) -> Option<u8> {
            self.0.pop_front()
        }

        fn poll_timeout(&self) -> Option<Instant> {
            (!self.0.is_empty()).then_some(Instant::ZERO)
        }
    }

    const BYTES: usize = 100_000;

    /// Returns the echo of many bytes, one every 10 µs, with its times.
    fn run(line: &mut Line<Mirror>) -> Vec<(Instant, u8)> {
        let mut back = Vec::new();
        for i in 0..BYTES as u64 + 10_000 {
            let now = Instant::from_micros(10 * i);
            if i < BYTES as u64 {
                line.receive(now, i as u8);
            }
            back.extend(std::iter::from_fn(|| line.transmit(now)).map(|byte| (now, byte)));
        }
        back
    }

    #[test]
    fn without_faults_every_byte_passes_at_once() {
        let mut line = Line::new(Mirror::default(), Rates::NONE, Rates::NONE, 1);
        let back = run(&mut line);
        assert_eq!(back.len(), BYTES);
        assert!(
            back.iter()
                .enumerate()
                .all(|(i, &(at, byte))| at == Instant::from_micros(10 * i as u64) && byte == i as u8)
        );
    }

    #[test]
    fn seed_determines_the_run() {
        let line = |seed| Line::new(Mirror::default(), Rates::each(10_000), Rates::each(10_000), seed);
        assert_eq!(run(&mut line(5)), run(&mut line(5)));
        assert_ne!(run(&mut line(5)), run(&mut line(6)));
    }

    #[test]
    fn faults_occur_at_their_rate_and_are_counted() {
        let mut line = Line::new(Mirror::default(), Rates::each(10_000), Rates::NONE, 1);
        let back = run(&mut line);
        let injected = line.injected_to_device();
        let Injected {
            dropped,
            corrupted,
            duplicated,
            delayed,
            noise,
        } = injected;
        for count in [dropped, corrupted, duplicated, delayed, noise] {
            assert!((800..1_200).contains(&count), "{injected:?}");
        }
        assert_eq!(back.len() as u64, BYTES as u64 - dropped + duplicated + noise);
        assert_eq!(line.injected_from_device(), Injected::default());
    }

    #[test]
    fn delayed_bytes_are_late_but_in_order() {
        let rates = Rates {
            delay: 1_000,
            ..Rates::NONE
        };
        for (to, from) in [(rates, Rates::NONE), (Rates::NONE, rates)] {
            let mut line = Line::new(Mirror::default(), to, from, 1);
            let back = run(&mut line);
            assert!(back.iter().enumerate().all(|(i, &(_, byte))| byte == i as u8));
            assert!(
                back.iter()
                    .enumerate()
                    .any(|(i, &(at, _))| at > Instant::from_micros(10 * i as u64))
            );
            assert_eq!(line.poll_timeout(), None);
        }
    }
}
