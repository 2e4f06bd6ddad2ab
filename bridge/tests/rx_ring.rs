//! The receive ring against a plain model: a vector of all bytes.

use armwire::framing::Length;
use armwire_bridge::config::{ArmKind, Config};
use armwire_bridge::control::Identity;
use armwire_bridge::{Bridge, Instant, PACKET, RxRing, RxThreshold, RxWait, Start, UartEvent, UsbEvent};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::test_runner::TestCaseResult;

const SIZE: usize = 32;
const TERMINATOR: u8 = 0xFF;
const HEADER: u8 = 0xAA;
const LENGTH: Length = Length {
    header: HEADER,
    at: 2,
    max: 9,
    overhead: 4,
};

/// A step of the UART, its interrupt handler, or the task.
#[derive(Clone, Copy, Debug)]
enum Step {
    /// A byte arrives. The interrupt handler runs at once, or with the next byte. It may run before the DMA has counted
    /// the byte.
    Byte { byte: u8, is_late: bool, is_counted: bool },
    /// The line goes idle.
    Idle,
    /// The task reads, and waits for this.
    Read(RxWait),
    /// The task reads, and does not know yet what to wait for.
    Take,
    /// The receive path restarts.
    Restart,
    /// A turn of the ring was lost.
    Overrun,
}

/// The ring, and all bytes that ever arrived.
#[derive(Default)]
struct Model {
    ring: RxRing<SIZE>,
    content: [u8; SIZE],
    /// All bytes since the last restart, and the number of those that were read.
    line: Vec<u8>,
    read: usize,
    now: u64,
    /// The wait in force: the number of bytes before it. `None` after its first event.
    wait: Option<(usize, RxWait)>,
    /// The number of bytes after which the interrupt handler saw each event since the last read, with the time.
    ends: Vec<(usize, u64)>,
    /// The last idle line since the last read.
    idle: Option<(usize, u64)>,
}

impl Model {
    fn end(&self) -> usize {
        self.line.len() % SIZE
    }

    /// Returns true if a byte may arrive: neither more bytes are unread, nor have more arrived since the wait began.
    fn has_room(&self) -> bool {
        let oldest = self.wait.map_or(self.read, |(from, _)| from.min(self.read));
        self.line.len() - oldest < SIZE - 1
    }

    fn step(&mut self, step: Step) -> TestCaseResult {
        self.now += 10;
        match step {
            Step::Byte {
                byte,
                is_late,
                is_counted,
            } if self.has_room() => {
                self.content[self.end()] = byte;
                self.line.push(byte);
                if !is_late {
                    self.on_byte(is_counted)?;
                }
            }
            Step::Byte { .. } => {}
            Step::Idle => {
                self.on_byte(true)?;
                let is_event = self.ring.idle(self.end(), Instant::from_micros(self.now));
                // Behind the first event of a wait, the task is not notified again.
                let is_new = self.line.len() > self.read;
                prop_assert_eq!(is_event, self.wait.is_some_and(|(_, wait)| wait.idle || is_new));
                if is_event || self.wait.is_none() {
                    self.idle = Some((self.line.len(), self.now));
                }
            }
            Step::Read(wait) => {
                self.read_all()?;
                self.ring.set(wait);
                self.wait = Some((self.read, wait));
                prop_assert!(self.ring.is_waiting() && !self.ring.has_mark());
            }
            Step::Take => {
                let is_new = self.line.len() > self.read;
                self.read_all()?;
                if let Some((_, wait)) = &mut self.wait {
                    wait.idle |= is_new;
                }
            }
            Step::Restart => {
                self.ring.restart();
                *self = Self {
                    now: self.now,
                    ..Self::default()
                };
            }
            Step::Overrun => {
                self.ring.discard(self.end());
                self.read = self.line.len();
                self.wait = None;
                self.ends.clear();
                self.idle = None;
            }
        }
        prop_assert_eq!(self.ring.unread(self.end()), self.line.len() - self.read);
        Ok(())
    }

    /// The threshold once `arrived` bytes are known to have arrived since it was set: the frame's end if its length is
    /// among them.
    fn threshold(from: &[u8], arrived: usize, wait: RxWait) -> RxThreshold {
        match (wait.length, &from[..arrived]) {
            (Some(_), &[HEADER, _, len, ..]) if len <= LENGTH.max => {
                let len = wait.threshold.max.min(usize::from(len) + LENGTH.overhead);
                RxThreshold {
                    max: len,
                    min: len,
                    terminator: None,
                }
            }
            _ => wait.threshold,
        }
    }

    /// The interrupt handler sees the last byte.
    fn on_byte(&mut self, is_counted: bool) -> TestCaseResult {
        let counted = self.line.len() - usize::from(!is_counted);
        let content = self.content;
        let is_early = self.ring.quiet(counted % SIZE, |at| content[at % SIZE]) > 0;
        let last = self.line.last().copied().unwrap_or(0);
        let (was_waiting, now) = (self.ring.is_waiting(), Instant::from_micros(self.now));
        let is_event = !is_early && self.ring.arrived(self.end(), last, || now);
        prop_assert!(was_waiting || !is_event);
        let len = self.line.len();
        if let Some((from, wait)) = self.wait {
            let threshold = Self::threshold(&self.line[from..], counted.saturating_sub(from), wait);
            prop_assert_eq!(is_event, threshold.is_met(len - from, last));
            if is_event {
                self.wait = None;
            }
        } else if is_event {
            // Further candidates for the end of the same frame.
            prop_assert_eq!(last, TERMINATOR);
        }
        if is_event {
            self.ends.push((len, self.now));
        }
        Ok(())
    }

    /// The task reads all bytes: those before each mark, and the rest.
    fn read_all(&mut self) -> TestCaseResult {
        let (mut idle, mut stamped) = (None, Vec::new());
        while let Some(mark) = self.ring.take_mark(self.end()) {
            self.read_to(mark.end)?;
            let at = (self.read, mark.at.as_micros());
            match mark.idle {
                true => idle = Some(at),
                false => stamped.push(at),
            }
        }
        // No idle line is lost, and each end has the time at which the handler saw it, once.
        prop_assert_eq!(idle, self.idle);
        prop_assert!(stamped.windows(2).all(|pair| pair[0].0 < pair[1].0), "{:?}", stamped);
        prop_assert!(stamped.iter().all(|stamp| self.ends.contains(stamp)), "{:?}", stamped);
        let first = self.ends.first().filter(|_| self.idle.is_none());
        prop_assert!(first.is_none_or(|first| stamped.contains(first)), "{:?}", stamped);
        self.read_to(self.end())?;
        prop_assert_eq!(self.read, self.line.len());
        self.ends.clear();
        self.idle = None;
        Ok(())
    }

    /// The task reads the bytes before a position, in chunks.
    fn read_to(&mut self, end: usize) -> TestCaseResult {
        loop {
            let taken = self.ring.take(end, 5);
            let bytes: Vec<u8> = taken
                .into_iter()
                .flat_map(|part| &self.content[part])
                .copied()
                .collect();
            if bytes.is_empty() {
                return Ok(());
            }
            prop_assert_eq!(&bytes[..], &self.line[self.read..self.read + bytes.len()]);
            self.read += bytes.len();
        }
    }
}

fn any_wait() -> impl Strategy<Value = RxWait> {
    (any_threshold(), any::<bool>(), any::<bool>()).prop_map(|(threshold, has_length, idle)| RxWait {
        threshold,
        length: has_length.then_some(LENGTH),
        idle,
    })
}

fn any_threshold() -> impl Strategy<Value = RxThreshold> {
    (1..SIZE, 1..SIZE, any::<bool>()).prop_map(|(max, min, has_terminator)| match has_terminator {
        true => RxThreshold {
            max: max.max(min),
            min: max.min(min),
            terminator: Some(TERMINATOR),
        },
        false => RxThreshold {
            max,
            min: max,
            terminator: None,
        },
    })
}

fn any_step() -> impl Strategy<Value = Step> {
    let byte = prop_oneof![Just(TERMINATOR), Just(HEADER), 0..12_u8, any::<u8>()];
    prop_oneof![
        60 => (byte, prop::bool::weighted(0.2), any::<bool>())
            .prop_map(|(byte, is_late, is_counted)| Step::Byte { byte, is_late, is_counted }),
        4 => Just(Step::Idle),
        10 => any_wait().prop_map(Step::Read),
        4 => Just(Step::Take),
        1 => Just(Step::Restart),
        1 => Just(Step::Overrun),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn ring_agrees_with_a_plain_line(steps in vec(any_step(), 0..300)) {
        let mut model = Model::default();
        for step in steps {
            model.step(step)?;
        }
        model.step(Step::Idle)?;
        model.read_all()?;
    }
}

/// The packets that are due.
fn packets(bridge: &mut Bridge) -> Vec<Vec<u8>> {
    let mut packet = [0; PACKET];
    let next = || bridge.usb_transmit(&mut packet).map(|len| packet[..len].to_vec());
    std::iter::from_fn(next).collect()
}

proptest! {
    #[test]
    fn unwanted_idle_line_changes_nothing(
        chunks in vec((chunk(), any::<bool>(), any::<bool>()), 0..40),
        kind in prop::sample::select(&[ArmKind::Ling, ArmKind::Alpha1, ArmKind::Raw][..]),
    ) {
        let open = || {
            let config = Config { arm: kind, ..Config::default() };
            let mut bridge = Bridge::new(Identity::default(), config, Start::default());
            bridge.usb_event(UsbEvent::Configured(true), Instant::ZERO);
            bridge
        };
        let (mut all, mut wanted) = (open(), open());
        for (nth, (bytes, is_idle, is_read)) in (1..).zip(chunks) {
            let now = Instant::from_micros(1_000 * nth);
            prop_assert_eq!(all.uart_received(&bytes, now), wanted.uart_received(&bytes, now));
            if is_idle {
                let frames = all.uart_event(UartEvent::Idle, now);
                let also = match wanted.rx_wait().idle {
                    true => wanted.uart_event(UartEvent::Idle, now),
                    false => 0,
                };
                prop_assert_eq!(frames, also);
            }
            prop_assert_eq!(all.rx_wait(), wanted.rx_wait());
            if is_read {
                prop_assert_eq!(packets(&mut all), packets(&mut wanted));
            }
        }
        prop_assert_eq!(packets(&mut all), packets(&mut wanted));
        prop_assert_eq!(all.counters(), wanted.counters());
    }
}

proptest! {
    #[test]
    fn every_frame_ends_at_an_event(
        chunks in vec(chunk(), 0..20),
        kind in prop::sample::select(&[ArmKind::Ling, ArmKind::Alpha1][..]),
        is_counted in vec(any::<bool>(), 1..20),
    ) {
        let config = Config { arm: kind, ..Config::default() };
        let open = || Bridge::new(Identity::default(), config, Start::default());
        // One bridge gets each byte at once, the other the bytes of the ring, at its events.
        let (mut eager, mut lazy) = (open(), open());
        let mut ring = RxRing::<1024>::new();
        ring.set(lazy.rx_wait());
        let line = chunks.concat();
        // The interrupt handler does not see the bytes before this position.
        let mut asleep = 0;
        for (before, (byte, is_counted)) in line.iter().zip(is_counted.into_iter().cycle()).enumerate().take(1_000) {
            let end = before + 1;
            let now = Instant::from_micros(10 * end as u64);
            let is_due = eager.uart_received(&[*byte], now) > 0;
            let counted = before + usize::from(is_counted);
            let mut is_event = false;
            if end > asleep {
                let quiet = ring.quiet(counted, |at| line[at]);
                asleep = counted + quiet;
                is_event = quiet == 0 && ring.arrived(end, *byte, || now);
            }
            prop_assert!(is_event || !is_due, "an unreported frame at {}", end);
            while let Some(mark) = ring.take_mark(end) {
                prop_assert_eq!((mark.end, mark.at), (end, now));
                let [bytes, _] = ring.take(mark.end, line.len());
                prop_assert_eq!(lazy.uart_received(&line[bytes], mark.at) > 0, is_due);
            }
            if is_event {
                ring.set(lazy.rx_wait());
            }
        }
        prop_assert_eq!(eager.counters().frames, lazy.counters().frames);
    }
}

/// Whole frames, parts of them, and other bytes, at most a packet.
fn chunk() -> impl Strategy<Value = Vec<u8>> {
    let frame = [0xAA, 0x05, 0x00, 0x01, 0x01, 0xF9, 0xFF];
    prop_oneof![
        2 => Just(frame.to_vec()),
        1 => (1..7_usize).prop_map(move |len| frame[..len].to_vec()),
        1 => Just(vec![0xF2, 0x2F, 0xAA, 0xED]),
        1 => vec(any::<u8>(), 0..=PACKET),
        1 => Just(vec![0x11; PACKET]),
    ]
}

const WAIT: RxWait = RxWait {
    threshold: RxThreshold {
        max: 20,
        min: 3,
        terminator: Some(TERMINATOR),
    },
    length: None,
    idle: false,
};

#[test]
fn length_of_a_frame_is_its_threshold() {
    let mut ring = RxRing::<SIZE>::new();
    ring.set(RxWait {
        length: Some(LENGTH),
        ..WAIT
    });
    // The terminator is in the frame three times before its end.
    let frame = [HEADER, TERMINATOR, 5, TERMINATOR, 4, TERMINATOR, 6, 7, TERMINATOR];
    let byte = |at: usize| frame[at];
    for (counted, last) in (1..).zip(frame) {
        let quiet = ring.quiet(counted, byte);
        assert_eq!(quiet, [1, 0, 5, 4, 3, 2, 1, 0, 0][counted - 1], "{counted}");
        let is_event = quiet == 0 && ring.arrived(counted, last, || Instant::ZERO);
        assert_eq!(is_event, counted == 9, "{counted}");
    }
}

#[test]
fn idle_line_behind_a_frame_is_no_event() {
    let mut ring = RxRing::<SIZE>::new();
    ring.set(WAIT);
    assert!(ring.arrived(7, TERMINATOR, || Instant::ZERO));
    // The task has not read the frame: whether the bridge waits for the idle line is unknown.
    assert!(!ring.idle(7, Instant::ZERO));
    assert!(ring.take_mark(7).is_some());
    assert_eq!(ring.take(7, 64), [0..7, 0..0]);
    ring.set(WAIT);
    assert!(!ring.has_mark());
    // Now it is known.
    assert!(!ring.idle(7, Instant::ZERO) && !ring.has_mark());
    // New bytes wait for it.
    assert!(ring.idle(9, Instant::ZERO) && ring.has_mark());
}

#[test]
fn idle_line_behind_a_frame_is_kept_for_the_bridge() {
    let mut ring = RxRing::<SIZE>::new();
    ring.set(WAIT);
    assert!(ring.arrived(7, TERMINATOR, || Instant::ZERO));
    assert!(!ring.idle(7, Instant::ZERO));
    assert!(ring.take_mark(7).is_some());
    assert_eq!(ring.take(7, 64), [0..7, 0..0]);
    ring.set(RxWait { idle: true, ..WAIT });
    assert!(ring.take_mark(7).is_some_and(|mark| mark.idle));
}

#[test]
fn terminator_inside_a_frame_marks_both_places() {
    let mut ring = RxRing::<SIZE>::new();
    ring.set(WAIT);
    let line = [1, TERMINATOR, 2, TERMINATOR, 3, TERMINATOR];
    for (end, byte) in (1..).zip(line) {
        let is_event = ring.arrived(end, byte, || Instant::from_micros(end as u64));
        assert_eq!(is_event, [4, 6].contains(&end));
    }
    let marks: Vec<_> = std::iter::from_fn(|| ring.take_mark(6)).map(|mark| mark.end).collect();
    assert_eq!(marks, [4, 6]);
}

#[test]
fn mark_after_the_end_is_kept() {
    let mut ring = RxRing::<SIZE>::new();
    ring.idle(7, Instant::ZERO);
    assert_eq!(ring.take_mark(5), None);
    assert_eq!(ring.take_mark(7).map(|mark| mark.end), Some(7));
}

#[test]
fn mark_of_bytes_already_read_hides_no_later_one() {
    let mut ring = RxRing::<SIZE>::new();
    ring.set(WAIT);
    assert_eq!(ring.take_mark(7), None);
    // The interrupt handler is behind the DMA, and reports these bytes between both calls of the task.
    assert!(ring.arrived(4, TERMINATOR, || Instant::ZERO));
    assert!(ring.arrived(6, TERMINATOR, || Instant::ZERO));
    assert_eq!(ring.take(7, 64), [0..7, 0..0]);
    ring.set(WAIT);
    assert!(ring.idle(9, Instant::ZERO));
    assert_eq!(ring.take_mark(9).map(|mark| mark.end), Some(9));
}

/// A handler that has the time of each byte looks at two frames before an idle line, one after the other.
#[test]
fn frame_before_a_recorded_idle_line_has_its_own_mark() {
    let mut ring = RxRing::<SIZE>::new();
    ring.set(WAIT);
    assert!(ring.arrived(7, TERMINATOR, || Instant::ZERO));
    assert!(!ring.idle(14, Instant::from_micros(2)));
    assert!(ring.look_again(14, |_, _| panic!("the frame comes first")));
    assert!(ring.take_mark(14).is_some());
    assert_eq!(ring.take(7, 64), [0..7, 0..0]);
    ring.set(WAIT);
    assert!(ring.look_again(20, |ring, end| {
        assert_eq!(end, 14, "the bytes behind the idle line are no part of the frame");
        ring.arrived(end, TERMINATOR, || Instant::from_micros(1))
    }));
    let marks: Vec<_> = std::iter::from_fn(|| ring.take_mark(14)).collect();
    assert_eq!(
        marks.iter().map(|mark| (mark.end, mark.idle)).collect::<Vec<_>>(),
        [(14, false), (14, true)]
    );
}

#[test]
fn recorded_idle_lines_keep_their_order() {
    let mut ring = RxRing::<SIZE>::new();
    ring.set(WAIT);
    assert!(ring.arrived(7, TERMINATOR, || Instant::ZERO));
    assert!(!ring.idle(14, Instant::ZERO) && !ring.idle(21, Instant::ZERO));
    assert!(ring.take_mark(21).is_some());
    assert_eq!(ring.take(7, 64), [0..7, 0..0]);
    ring.set(WAIT);
    assert!(ring.look_again(21, |_, _| false));
    let marks: Vec<_> = std::iter::from_fn(|| ring.take_mark(21)).map(|mark| mark.end).collect();
    assert_eq!(marks, [14, 21]);
}

/// The handler has not looked at bytes that arrived while the task looked.
#[test]
fn bytes_looked_at_twice_have_one_mark() {
    let mut ring = RxRing::<SIZE>::new();
    ring.set(WAIT);
    for end in [5, 6, 5, 6] {
        ring.arrived(end, TERMINATOR, || Instant::ZERO);
    }
    let marks: Vec<_> = std::iter::from_fn(|| ring.take_mark(6)).map(|mark| mark.end).collect();
    assert_eq!(marks, [5, 6]);
    assert!(!ring.has_mark());
}

#[test]
fn bytes_around_the_turn_are_two_ranges() {
    let mut ring = RxRing::<SIZE>::new();
    ring.discard(30);
    assert_eq!(ring.take(3, 4), [30..32, 0..2]);
    assert_eq!(ring.take(3, 4), [2..3, 0..0]);
    assert_eq!(ring.take(3, 4), [3..3, 0..0]);
}
