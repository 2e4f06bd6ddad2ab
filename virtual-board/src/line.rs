//! The serial line between the board's UART and the arm: time, faults, and a record of every byte.
//!
//! The board's UART determines the timing of the board's bytes. This file is the wire and the arm's own UART: if the
//! two have different rates, each samples the other's bits at its own times, and gets the same result as real hardware.
//!
//! In half-duplex mode (RM0090, 30.3.10) one wire is used for both directions: the board's receiver gets the board's
//! own bytes, and overlapping bytes collide. Both are then garbled, the board's own with a framing error.

use std::collections::BTreeMap;
use std::fmt::Debug;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use armwire_sim::serial::SerialDevice;

use crate::shared::Shared;
use crate::soc::chance::draw;
use crate::time::Nanos;

/// An arm for a board's UART: any serial device that can move to another thread.
pub trait Arm: SerialDevice + Send + Debug + 'static {}

impl<A: SerialDevice + Send + Debug + 'static> Arm for A {}

/// The line, shared by the chip and the board's owner.
pub(crate) type SharedLine<A> = Shared<Line<A>>;

/// The same for any arm: the board is compiled once, with this crate, and not for each arm.
pub(crate) type AnyLine = SharedLine<dyn Arm>;

/// A fault of a byte from the arm to the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// A missing stop bit, and wrong data.
    Framing,
    /// The board's samples of a bit differ; the majority is right.
    Noise,
    /// A wrong parity bit. Without parity the byte is unaffected.
    Parity,
    /// The line is low for the whole byte.
    Break,
    /// The board's DMA is late for the previous byte, if that ended just now: this byte is lost.
    Overrun,
}

/// Rates of each fault for bytes from the arm to the board, in parts per million.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FaultRates {
    /// [`Fault::Framing`].
    pub framing: u32,
    /// [`Fault::Noise`].
    pub noise: u32,
    /// [`Fault::Break`].
    pub line_break: u32,
    /// [`Fault::Overrun`].
    pub overrun: u32,
}

/// The parity bit of a byte.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Parity {
    /// No parity bit.
    #[default]
    None,
    /// Even number of ones in data and parity bit.
    Even,
    /// Odd number of ones.
    Odd,
}

/// The format of one side's bytes, with eight data bits. The default is no parity and one stop bit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Format {
    /// The parity bit.
    pub parity: Parity,
    /// True for two stop bits, false for one.
    pub two_stop_bits: bool,
}

impl Format {
    /// Number of bits of a byte on the line, 10 to 12.
    pub const fn bits(self) -> u64 {
        10 + !matches!(self.parity, Parity::None) as u64 + self.two_stop_bits as u64
    }

    /// The parity bit of a byte, if it has one.
    const fn parity_bit(self, byte: u8) -> Option<bool> {
        let odd = byte.count_ones() % 2 == 1;
        match self.parity {
            Parity::None => None,
            Parity::Even => Some(odd),
            Parity::Odd => Some(!odd),
        }
    }
}

/// The direction of a byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// From the board to the arm.
    ToArm,
    /// From the arm to the board.
    ToBoard,
}

/// The outcome of a byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// It arrived as sent.
    Arrived,
    /// It had a fault.
    Faulty(Fault),
    /// The two ends have different rates: another byte arrived.
    Garbled,
    /// The other side sent at the same time, on the one wire of half-duplex mode: another byte arrived.
    Collided,
    /// The receiver was off, or busy with an earlier byte.
    Lost,
}

/// A byte that crossed the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LineByte {
    /// End of its stop bit.
    pub at: Nanos,
    /// Its direction.
    pub direction: Direction,
    /// The byte sent.
    pub sent: u8,
    /// Its outcome.
    pub outcome: Outcome,
}

/// The arrival of a byte at the board's UART.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Arrival {
    pub(crate) value: u8,
    pub(crate) framing: bool,
    pub(crate) parity: bool,
    pub(crate) noise: bool,
}

impl Arrival {
    /// Another byte arrives, without a stop bit.
    pub(crate) fn garble(&mut self) {
        self.value = !self.value;
        self.framing = true;
    }
}

/// A byte in flight to the board.
#[derive(Clone, Copy, Debug)]
struct Flight {
    sent: u8,
    ends: Nanos,
    outcome: Outcome,
}

/// A byte of the board's own on the one wire of half-duplex mode.
#[derive(Clone, Copy, Debug)]
struct Own {
    sent: u8,
    starts: Nanos,
    /// True if the board's receiver gets it, too.
    received: bool,
    collided: bool,
}

/// The driver of the board's TX pin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Pin {
    /// An output that is high, or an input: the line is idle.
    Free,
    /// An output that is low.
    Low,
    /// The UART, if it transmits.
    Uart,
}

/// The violation for a TX pin that is low.
pub(crate) const LOW: &str =
    "8.3.7, 30.3.2: nothing drives PA2, or it is low, and the arm may take that for a start bit";

/// The line, and its arm.
#[derive(Debug)]
pub(crate) struct Line<A: ?Sized> {
    /// Bit time at the arm's rate and at the board's, in picoseconds. The board's is 0 without a rate.
    arm_bit: u64,
    board_bit: u64,
    arm_format: Format,
    board_format: Format,
    /// The earliest start of the arm's next byte.
    free: Nanos,
    flight: Option<Flight>,
    half_duplex: bool,
    /// Bytes that the core read before the DMA did.
    taken: u32,
    /// The board's TX pin, and true if its UART drives it.
    pin: Pin,
    transmits: bool,
    /// The board's byte in transmission, in half-duplex mode.
    own: Option<Own>,
    /// True if the board's own last byte has collided.
    own_collided: bool,
    /// End of the arm's last collided byte.
    collided_until: Nanos,
    rates: FaultRates,
    seed: u64,
    /// Number of bytes sent by the arm.
    count: u64,
    /// Planned faults of single bytes, by their index in `count`.
    planned: BTreeMap<u64, Fault>,
    /// Stops the board's DMA for its UART.
    starve: Arc<AtomicBool>,
    bytes: Vec<LineByte>,
    /// This field is last: a line with a given arm then coerces to one with any arm.
    arm: A,
}

impl<A: SerialDevice> Line<A> {
    pub(crate) fn new(arm: A, baud: u32, seed: u64, starve: Arc<AtomicBool>) -> Self {
        Self {
            arm_bit: bit(baud.into()),
            board_bit: 0,
            arm_format: Format::default(),
            board_format: Format::default(),
            free: Nanos(0),
            flight: None,
            half_duplex: false,
            taken: 0,
            pin: Pin::Free,
            transmits: false,
            own: None,
            own_collided: false,
            collided_until: Nanos(0),
            rates: FaultRates::default(),
            seed,
            count: 0,
            planned: BTreeMap::new(),
            starve,
            bytes: Vec::new(),
            arm,
        }
    }
}

impl<A: SerialDevice + ?Sized> Line<A> {
    pub(crate) fn arm_mut(&mut self) -> &mut A {
        &mut self.arm
    }

    pub(crate) fn bytes(&self) -> &[LineByte] {
        &self.bytes
    }

    pub(crate) fn forget_bytes(&mut self) {
        self.bytes.clear();
        self.taken = 0;
    }

    /// The core read a byte before the DMA did.
    pub(crate) fn take_byte(&mut self) {
        self.taken += 1;
    }

    pub(crate) fn taken(&self) -> u32 {
        self.taken
    }

    pub(crate) fn set_arm_baud(&mut self, baud: u32) {
        self.arm_bit = bit(baud.into());
    }

    pub(crate) fn set_arm_format(&mut self, format: Format) {
        self.arm_format = format;
    }

    pub(crate) fn set_board_format(&mut self, format: Format) {
        self.board_format = format;
    }

    pub(crate) fn board_format(&self) -> Format {
        self.board_format
    }

    /// Duration of a byte of the arm, and of the board.
    fn arm_byte(&self) -> Nanos {
        Nanos(self.arm_format.bits() * self.arm_bit / 1_000)
    }

    fn board_byte(&self) -> Nanos {
        Nanos(self.board_format.bits() * self.board_bit / 1_000)
    }

    /// Sets the bit time of the board's UART, in picoseconds; 0 while it does not run.
    pub(crate) fn set_board_bit(&mut self, picoseconds: u64) {
        self.board_bit = picoseconds;
    }

    /// The rate of the board's UART, in bits per second, if it runs.
    pub(crate) fn board_baud(&self) -> Option<u64> {
        (self.board_bit > 0).then(|| (SECOND + self.board_bit / 2) / self.board_bit)
    }

    pub(crate) fn set_fault_rates(&mut self, rates: FaultRates) {
        self.rates = rates;
    }

    /// Plans a fault for the arm's byte after `after` others.
    pub(crate) fn plan_fault(&mut self, after: u64, fault: Fault) {
        self.planned.insert(self.count + after, fault);
    }

    /// The time at which the arm next sends, if known.
    pub(crate) fn due(&self) -> Option<Nanos> {
        Some(Nanos::from(self.arm.poll_timeout()?).max(self.free))
    }

    /// Sets the driver of the board's TX pin.
    pub(crate) fn set_pin(&mut self, pin: Pin) {
        self.pin = pin;
    }

    /// Sets whether the board's UART and its transmitter are enabled.
    pub(crate) fn set_transmits(&mut self, transmits: bool) {
        self.transmits = transmits;
    }

    /// Returns true if the arm may see the line low without a byte from the board.
    pub(crate) fn is_pin_low(&self) -> bool {
        self.pin == Pin::Low || self.pin == Pin::Uart && !self.transmits
    }

    /// Sets half-duplex mode.
    pub(crate) fn set_half_duplex(&mut self, half_duplex: bool) {
        self.half_duplex = half_duplex;
        if !half_duplex {
            self.own = None;
        }
    }

    pub(crate) fn is_half_duplex(&self) -> bool {
        self.half_duplex
    }

    /// The board starts to send a byte, in half-duplex mode.
    pub(crate) fn board_starts(&mut self, now: Nanos, sent: u8) {
        let mut collided = now < self.collided_until;
        if let Some(flight) = self.flight.as_mut().filter(|flight| now < flight.ends) {
            flight.outcome = Outcome::Collided;
            collided = true;
        }
        self.own = Some(Own {
            sent,
            starts: now,
            received: false,
            collided,
        });
    }

    /// The arm's bytes during a transmission of the board collide, in half-duplex mode.
    pub(crate) fn collide(&mut self, now: Nanos) {
        let byte = self.arm_byte();
        while let Some(own) = &mut self.own
            && let Some(due) = self.arm.poll_timeout()
            && Nanos::from(due).max(self.free) <= now
            && let Some(sent) = self.arm.transmit(now.instant())
        {
            own.collided = true;
            self.count += 1;
            self.free = now + byte;
            self.collided_until = self.free;
            self.record(self.collided_until, sent, Outcome::Collided);
        }
    }

    /// Returns true if the byte that the board receives has collided.
    pub(crate) fn has_collided(&self) -> bool {
        let arriving = self.flight.is_some_and(|flight| flight.outcome == Outcome::Collided);
        arriving || self.own_collided || self.own.is_some_and(|own| own.collided && own.received)
    }

    /// The board sent a byte; its stop bit ended at `now`.
    pub(crate) fn board_sent(&mut self, now: Nanos, sent: u8) {
        let board = (self.board_bit, self.board_format);
        let received = sample(sent, board, (self.arm_bit, self.arm_format));
        let mut value = received.value;
        let collided = self.own.take().filter(|own| own.collided);
        self.own_collided = collided.is_some_and(|own| own.received);
        let outcome = if collided.is_some() {
            value = !sent;
            Outcome::Collided
        } else if received.is_clean(sent) {
            Outcome::Arrived
        } else {
            Outcome::Garbled
        };
        self.bytes.push(LineByte {
            at: now,
            direction: Direction::ToArm,
            sent,
            outcome,
        });
        self.arm.receive(now.instant(), value);
    }

    /// The board's receiver is free: the byte in flight has arrived, and the next may start.
    pub(crate) fn board_receives(&mut self, now: Nanos) -> Option<Arrival> {
        let follows = self.land(now);
        self.starve.store(false, Ordering::Relaxed);
        self.own_collided = false;
        if let Some(own) = &mut self.own {
            // On one wire, it is busy with the board's own byte. A byte whose start bit was missed is not received.
            let starts = !own.received && now.since(own.starts).0 <= self.board_bit / 2_000;
            own.received |= starts;
            return starts.then_some(Arrival {
                value: own.sent,
                framing: false,
                parity: false,
                noise: false,
            });
        }
        if now < self.free {
            return None;
        }
        let sent = self.arm.transmit(now.instant())?;
        let mut outcome = Outcome::Arrived;
        let arm = (self.arm_bit, self.arm_format);
        let mut arrival = sample(sent, arm, (self.board_bit, self.board_format));
        if !arrival.is_clean(sent) {
            outcome = Outcome::Garbled;
        } else if let Some(fault) = self.fault(self.count).filter(|&fault| match fault {
            Fault::Overrun => follows,
            Fault::Parity => self.board_format.parity != Parity::None,
            _ => true,
        }) {
            outcome = Outcome::Faulty(fault);
            // The previous byte waits in the UART until this one is in, too.
            self.starve.store(fault == Fault::Overrun, Ordering::Relaxed);
            arrival = Arrival {
                value: match fault {
                    Fault::Framing => !sent,
                    Fault::Break => 0,
                    Fault::Noise | Fault::Parity | Fault::Overrun => sent,
                },
                framing: matches!(fault, Fault::Framing | Fault::Break),
                parity: fault == Fault::Parity,
                noise: fault == Fault::Noise,
            };
        }
        self.count += 1;
        let ends = now + self.board_byte();
        self.flight = Some(Flight { sent, ends, outcome });
        if outcome == Outcome::Garbled {
            // The receiver reads the bits of a faster arm as part of the same byte.
            self.free = now + self.arm_byte();
            while self.free < ends && self.lose(self.free) {}
        }
        Some(arrival)
    }

    /// The board's receiver was switched off during the byte in flight, which has arrived.
    pub(crate) fn last_arrived(&mut self, now: Nanos) {
        self.land(now);
    }

    /// The board garbles the byte in flight.
    pub(crate) fn board_garbles(&mut self) {
        if let Some(flight) = &mut self.flight {
            flight.outcome = Outcome::Garbled;
        }
    }

    /// The board's receiver is off: the arm's bytes are lost.
    pub(crate) fn nobody_receives(&mut self, now: Nanos) {
        self.starve.store(false, Ordering::Relaxed);
        if let Some(flight) = self.flight.take() {
            self.record(flight.ends, flight.sent, Outcome::Lost);
            self.free = self.free.max(flight.ends);
        }
        if self.free <= now {
            self.lose(now);
        }
    }

    /// Sends one byte without a receiver at `at`. Returns false if there was none.
    fn lose(&mut self, at: Nanos) -> bool {
        let Some(sent) = self.arm.transmit(at.instant()) else {
            return false;
        };
        self.count += 1;
        self.free = at + self.arm_byte();
        self.record(self.free, sent, Outcome::Lost);
        true
    }

    /// Records the byte in flight. Returns true if it arrived just now.
    fn land(&mut self, now: Nanos) -> bool {
        let Some(flight) = self.flight.take() else {
            return false;
        };
        // The UART ends the byte by its own clock, which samples a bit 16 times.
        let on_time = now.0.abs_diff(flight.ends.0) <= self.board_bit / 16_000;
        let (at, outcome) = if on_time {
            (now, flight.outcome)
        } else {
            (flight.ends, Outcome::Lost)
        };
        self.record(at, flight.sent, outcome);
        on_time
    }

    fn record(&mut self, at: Nanos, sent: u8, outcome: Outcome) {
        self.bytes.push(LineByte {
            at,
            direction: Direction::ToBoard,
            sent,
            outcome,
        });
    }

    /// The fault of the `nth` byte from the arm.
    fn fault(&self, nth: u64) -> Option<Fault> {
        let drawn = |(name, rate, fault): (&str, u32, Fault)| {
            (draw(self.seed, name, nth) % 1_000_000 < rate.into()).then_some(fault)
        };
        self.planned.get(&nth).copied().or_else(|| {
            [
                ("framing", self.rates.framing, Fault::Framing),
                ("noise", self.rates.noise, Fault::Noise),
                ("break", self.rates.line_break, Fault::Break),
                ("overrun", self.rates.overrun, Fault::Overrun),
            ]
            .into_iter()
            .find_map(drawn)
        })
    }
}

/// Picoseconds in a second.
pub(crate) const SECOND: u64 = 1_000_000_000_000;

/// One bit at `baud`, in picoseconds.
fn bit(baud: u64) -> u64 {
    SECOND / baud.max(1)
}

impl Arrival {
    /// Returns true if the byte arrived as sent, without an error.
    fn is_clean(self, sent: u8) -> bool {
        self.value == sent && !self.framing && !self.parity
    }
}

/// The reception of a byte. Each side has a bit time in picoseconds and a format.
///
/// The receiver samples the middle of each bit, counted from the falling edge of the start bit; after the last bit the
/// line is high.
fn sample(byte: u8, (sender, sent): (u64, Format), (receiver, expected): (u64, Format)) -> Arrival {
    let mut arrival = Arrival {
        value: byte,
        framing: false,
        parity: false,
        noise: false,
    };
    if receiver == 0 || sender == 0 {
        return arrival;
    }
    let low_parity = sent.parity_bit(byte) == Some(false);
    let frame = u64::from(byte) << 1 | u64::from(!low_parity) << 9;
    let level = |nth: u64| {
        let at = ((2 * nth + 1) * receiver / 2) / sender;
        at > 9 || frame >> at & 1 != 0
    };
    arrival.value = (0..8).fold(0, |value, nth| value | u8::from(level(nth + 1)) << nth);
    let parity = expected.parity_bit(arrival.value);
    arrival.parity = parity.is_some_and(|parity| parity != level(9));
    arrival.framing = !level(9 + u64::from(parity.is_some()));
    arrival
}

#[cfg(test)]
pub(crate) mod tests {
    use std::collections::VecDeque;

    use armwire_bridge::Instant;

    use super::*;

    /// An arm that sends the given bytes at once, and records received ones.
    #[derive(Debug, Default)]
    pub(crate) struct ScriptedArm {
        pub(crate) output: VecDeque<u8>,
        pub(crate) received: Vec<u8>,
    }

    impl SerialDevice for ScriptedArm {
        fn receive(&mut self, _: Instant, byte: u8) {
            self.received.push(byte);
        }

        fn transmit(&mut self, _: Instant) -> Option<u8> {
            self.output.pop_front()
        }

        fn poll_timeout(&self) -> Option<Instant> {
            (!self.output.is_empty()).then_some(Instant::ZERO)
        }
    }

    const MEGABAUD_BIT: u64 = 1_000_000;

    fn line(output: &[u8]) -> Line<ScriptedArm> {
        let arm = ScriptedArm {
            output: output.iter().copied().collect(),
            received: Vec::new(),
        };
        let mut line = Line::new(arm, 1_000_000, 7, Arc::default());
        line.set_board_bit(MEGABAUD_BIT);
        line
    }

    /// Lets the board's receiver take bytes at full speed.
    fn receive_all(line: &mut Line<ScriptedArm>) -> Vec<Arrival> {
        (0..)
            .map_while(|nth| line.board_receives(Nanos(nth * 10 * line.board_bit / 1_000)))
            .collect()
    }

    fn outcomes(line: &Line<ScriptedArm>) -> Vec<Outcome> {
        line.bytes().iter().map(|byte| byte.outcome).collect()
    }

    #[test]
    fn bytes_cross_unchanged_when_the_rates_agree() {
        for baud in [970_000, 1_000_000, 1_030_000] {
            let mut line = line(&[0x00, 0x55, 0xFF]);
            line.set_arm_baud(baud);
            let values: Vec<u8> = receive_all(&mut line).iter().map(|arrival| arrival.value).collect();
            assert_eq!(values, [0x00, 0x55, 0xFF], "{baud} baud");
            assert_eq!(line.bytes().last().unwrap().at, Nanos(30_000));
        }
    }

    #[test]
    fn wrong_rate_garbles_both_ways() {
        let mut line = line(&[0xAA; 20]);
        line.set_arm_baud(115_200);
        let first = line.board_receives(Nanos(0)).unwrap();
        assert_eq!(
            (first.value, first.framing),
            (0x00, true),
            "the start bit alone lasts 8.7 of the board's bits"
        );
        line.board_sent(Nanos(0), 0xAA);
        assert_ne!(line.arm_mut().received, [0xAA]);
    }

    #[test]
    fn faster_arm_bytes_are_lost_within_slow_byte() {
        let mut line = line(&[0x00; 20]);
        line.set_board_bit(bit(115_200));
        let arrival = line.board_receives(Nanos(0)).unwrap();
        assert_ne!(arrival.value, 0x00);
        assert_eq!(line.arm.output.len(), 20 - 9, "87 us of a megabaud");
    }

    #[test]
    fn byte_length_of_10_to_12_must_agree() {
        let formats = [Parity::None, Parity::Even, Parity::Odd].map(|parity| Format {
            parity,
            two_stop_bits: false,
        });
        assert_eq!(formats.map(Format::bits), [10, 11, 11]);
        let twelve = Format {
            two_stop_bits: true,
            ..formats[1]
        };
        assert_eq!(twelve.bits(), 12);
        let [none, even, odd] = formats;
        // 0x07 has three ones: its even parity bit is high, like a stop bit; its odd one is low.
        for (arm, board, framing, parity) in [
            (none, none, false, false),
            (even, even, false, false),
            (odd, odd, false, false),
            (even, odd, false, true),
            (odd, even, false, true),
            (even, none, false, false),
            (odd, none, true, false),
            (none, odd, false, true),
        ] {
            let mut line = line(&[0x07]);
            line.set_arm_format(arm);
            line.set_board_format(board);
            let arrival = line.board_receives(Nanos(0)).unwrap();
            assert_eq!(
                (arrival.value, arrival.framing, arrival.parity),
                (0x07, framing, parity),
                "{arm:?} {board:?}"
            );
        }
    }

    #[test]
    fn parity_fault_needs_a_parity_bit() {
        for (parity, faulty) in [(Parity::None, false), (Parity::Odd, true)] {
            let mut line = line(&[1]);
            let format = Format {
                parity,
                two_stop_bits: false,
            };
            line.set_arm_format(format);
            line.set_board_format(format);
            line.plan_fault(0, Fault::Parity);
            let arrival = line.board_receives(Nanos(0)).unwrap();
            assert_eq!((arrival.value, arrival.parity), (1, faulty));
        }
    }

    #[test]
    fn planned_faults_hit_the_byte_they_are_for() {
        let mut line = line(&[1, 2, 3, 4]);
        line.plan_fault(1, Fault::Framing);
        line.plan_fault(2, Fault::Noise);
        line.plan_fault(3, Fault::Break);
        let arrivals = receive_all(&mut line);
        assert_eq!((arrivals[0].value, arrivals[0].framing), (1, false));
        assert_eq!((arrivals[1].value, arrivals[1].framing), (!2, true));
        assert_eq!((arrivals[2].value, arrivals[2].noise), (3, true));
        assert_eq!((arrivals[3].value, arrivals[3].framing), (0, true));
    }

    #[test]
    fn overrun_hides_previous_byte_from_the_dma() {
        let mut line = line(&[1, 2, 3]);
        line.plan_fault(1, Fault::Overrun);
        let starve = line.starve.clone();
        let mut starving = Vec::new();
        for nth in 0..4 {
            line.board_receives(Nanos(nth * 10_000));
            starving.push(starve.load(Ordering::Relaxed));
        }
        assert_eq!(starving, [false, true, false, false]);
        assert_eq!(
            outcomes(&line),
            [Outcome::Arrived, Outcome::Faulty(Fault::Overrun), Outcome::Arrived]
        );
    }

    #[test]
    fn seed_repeats_its_faults() {
        let run = |seed| {
            let mut line = line(&[0; 1000]);
            line.seed = seed;
            line.set_fault_rates(FaultRates {
                framing: 50_000,
                ..FaultRates::default()
            });
            receive_all(&mut line);
            outcomes(&line)
        };
        assert_eq!(run(1), run(1));
        assert_ne!(run(1), run(2));
        let faulty = run(1)
            .iter()
            .filter(|&&outcome| outcome == Outcome::Faulty(Fault::Framing))
            .count();
        assert!((25..100).contains(&faulty), "{faulty} of 1000 at 5 %");
    }

    #[test]
    fn byte_ends_by_the_sampling_clock_of_the_uart() {
        for (late, outcome) in [(62, Outcome::Arrived), (63, Outcome::Lost)] {
            let mut line = line(&[1]);
            line.board_receives(Nanos(0));
            line.board_receives(Nanos(10_000 + late));
            assert_eq!(outcomes(&line), [outcome], "{late} ns");
        }
    }

    #[test]
    fn disabled_receiver_loses_bytes_at_arm_pace() {
        let mut line = line(&[1, 2]);
        line.nobody_receives(Nanos(0));
        line.nobody_receives(Nanos(5_000));
        assert_eq!(outcomes(&line), [Outcome::Lost]);
        assert_eq!(line.due(), Some(Nanos(10_000)));
        line.nobody_receives(Nanos(10_000));
        assert_eq!(outcomes(&line), [Outcome::Lost; 2]);
    }
}
