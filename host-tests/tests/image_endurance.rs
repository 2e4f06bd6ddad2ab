//! Long runs: every byte of a saturated line, polls for hours, and the wraparound of hardware counters.
//!
//! The memory of the process is checked on Linux only.

use std::env;
use std::fs;
use std::time::Instant;

use armwire_bridge::config::{Config, Poll};
use armwire_bridge::control::{
    Event, FromAdapter, FromHost, Identity, Initiator, MAX_COBS, MAX_FRAME, MAX_MESSAGE, Reader, Request, Stamp,
    Subscription, encode_cobs,
};
use armwire_bridge::time;
use armwire_bridge::{Bridge, Counters, PACKET, Start, Transmit, UartEvent, UsbEvent};
use armwire_host_tests::image::{
    Control, MEGABAUD, TicketArm, Traffic, byte_time, counters, facts, numbered_answer, on_board, plug_in,
};
use armwire_sim::serial::SerialDevice;
use armwire_virtual_board::line::Direction;
use armwire_virtual_board::{Nanos, VirtualBoard};

/// Bytes each way in the run of the saturated line.
const BYTES: u64 = 1_000_000;

/// Polls of the image per second.
const HERTZ: u16 = 200;

/// Maximum growth of memory from a tenth of a long run to its end. The emulator takes some 60 kB per second of a
/// saturated line. A record of the traffic on the wires would take 100 MB.
const MORE_MEMORY: u64 = 16 << 20;

/// The memory of this process, in bytes. `None` if the system does not report it.
fn memory() -> Option<u64> {
    const PAGE: u64 = 4096;
    let pages = fs::read_to_string("/proc/self/statm").ok()?;
    Some(pages.split(' ').nth(1)?.parse::<u64>().ok()? * PAGE)
}

/// Fails if the memory grew since it was `before`.
fn expect_flat(before: Option<u64>) {
    if let (Some(before), Some(after)) = (before, memory()) {
        println!("{} kB of memory, {} kB before", after >> 10, before >> 10);
        assert!(after < before + MORE_MEMORY, "{after} bytes of memory, {before} before");
    }
}

/// Bytes without a pattern and without an end.
#[derive(Clone, Debug)]
struct Endless(u64);

impl Iterator for Endless {
    type Item = u8;

    fn next(&mut self) -> Option<u8> {
        // Knuth's linear congruential generator of 64 bits.
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        Some((self.0 >> 56) as u8)
    }
}

/// Compares received with expected bytes, without a record of either.
#[derive(Debug)]
struct Check {
    expected: Endless,
    count: u64,
    wrong: Option<u64>,
}

impl Check {
    fn new(expected: Endless) -> Self {
        Self {
            expected,
            count: 0,
            wrong: None,
        }
    }

    fn take(&mut self, byte: u8) {
        if self.expected.next() != Some(byte) && self.wrong.is_none() {
            self.wrong = Some(self.count);
        }
        self.count += 1;
    }
}

const DOWN: Endless = Endless(1);
const UP: Endless = Endless(2);

/// Sends bytes without a pause up to a limit, and checks the received bytes.
#[derive(Debug)]
struct Streamer {
    tx: Endless,
    left: u64,
    received: Check,
}

impl SerialDevice for Streamer {
    fn receive(&mut self, _: time::Instant, byte: u8) {
        self.received.take(byte);
    }

    fn transmit(&mut self, _: time::Instant) -> Option<u8> {
        self.left = self.left.checked_sub(1)?;
        self.tx.next()
    }

    fn poll_timeout(&self) -> Option<time::Instant> {
        (self.left > 0).then_some(time::Instant::ZERO)
    }
}

#[test]
fn every_byte_of_a_saturated_line_passes() {
    /// Number of bytes that the host keeps queued, to keep the line busy.
    const AHEAD: usize = 4_096;
    let began = Instant::now();
    let arm = Streamer {
        tx: UP,
        left: 0,
        received: Check::new(DOWN),
    };
    on_board(arm, |board| {
        plug_in(board, MEGABAUD);
        let mut traffic = Traffic::begin(board);
        board.with_arm(|arm| arm.left = BYTES);
        let start = board.now();
        let (mut tx, mut sent, mut received) = (DOWN, 0, Check::new(UP));
        let mut before = None;
        let limit = start + Nanos(BYTES * byte_time(MEGABAUD).0 * 11 / 10);
        while received.count < BYTES || board.with_arm(|arm| arm.received.count) < BYTES {
            assert!(board.now() < limit, "the line is not at full load");
            if sent < BYTES && board.usb().unsent() < AHEAD {
                let bytes: Vec<u8> = tx.by_ref().take(AHEAD.min((BYTES - sent) as usize)).collect();
                sent += bytes.len() as u64;
                board.usb().write(&bytes).unwrap();
            }
            board.run_for(Nanos::from_millis(5)).unwrap();
            board.usb().read().into_iter().for_each(|byte| received.take(byte));
            traffic.count(board);
            if before.is_none() && received.count > BYTES / 10 {
                before = memory();
            }
        }
        let seconds = board.now().since(start).0 as f64 / 1e9;
        println!(
            "{BYTES} bytes each way in {seconds:.2} s of virtual time, {:.0} s of real time",
            began.elapsed().as_secs_f64()
        );
        expect_flat(before);
        let arm = board.with_arm(|arm| (arm.received.count, arm.received.wrong));
        assert_eq!((received.count, received.wrong), (BYTES, None), "bytes at the host");
        assert_eq!(arm, (BYTES, None), "bytes at the arm");
        let counted = counters(board);
        assert_eq!(u64::from(counted.arm_to_host_bytes), BYTES);
        assert_eq!(u64::from(counted.host_to_arm_bytes), BYTES);
        let lost = [
            counted.dropped_bytes,
            counted.undelivered_bytes,
            counted.refused_bytes,
            counted.overrun_errors,
            counted.ring_overruns,
            counted.framing_errors,
            counted.noise_errors,
        ];
        assert_eq!(lost, [0; 7], "bytes counted as lost, and errors");
        // All of it in at most a hundredth more time than the bits take.
        let bits = (BYTES * byte_time(MEGABAUD).0) as f64 / 1e9;
        assert!(seconds < bits * 1.01, "{seconds} s for {bits} s of bits");
    });
}

fn polled(hertz: u16) -> Config {
    Config {
        poll: Poll::Hertz(hertz),
        ..Config::default()
    }
}

/// The output of the control interface, read by a subscriber to all events.
struct Listener {
    reader: Reader<MAX_MESSAGE>,
    frames: u64,
    bytes: u64,
    last: Stamp,
}

impl Listener {
    /// Reads all packets of the adapter at `at`.
    fn read_packets(&mut self, bridge: &mut Bridge, at: time::Instant) {
        let mut packet = [0; PACKET];
        while bridge.update(at).control {
            if let Some(len) = bridge.control_transmit(&mut packet, at) {
                self.on_packet(&packet[..len], at);
            }
        }
    }

    /// Checks a packet. Its frames ended at `at`.
    fn on_packet(&mut self, mut packet: &[u8], at: time::Instant) {
        while !packet.is_empty() {
            packet = self.reader.push(packet);
            while let Some(message) = self.reader.next::<FromAdapter>() {
                let FromAdapter::Event { at: stamp, event } = message.unwrap() else {
                    continue;
                };
                let Event::Frame {
                    initiator: Some(Initiator::Poll),
                    bytes,
                } = event
                else {
                    panic!("{event:?} at {stamp:?}");
                };
                assert_eq!(
                    bytes[..],
                    numbered_answer(self.frames as u32)[..],
                    "an answer of another poll"
                );
                assert!(stamp > self.last || self.frames == 0, "{stamp:?} after {:?}", self.last);
                assert_eq!(stamp.0, at.as_micros(), "the stamp of answer {}", self.frames);
                self.last = stamp;
                self.frames += 1;
                self.bytes += bytes.len() as u64;
            }
        }
    }
}

/// The bridge alone, with a clock of its own: the image would take hours, see `day_of_polls_on_the_image`.
#[test]
fn hours_of_polls_keep_counters_and_stamps_exact() {
    /// Longer than it takes microseconds to turn over in 32 bits.
    const SPAN: u64 = 2 * 3_600 * 1_000_000;
    /// Polls per second. More would take a minute.
    const FEW: u16 = 20;
    const BYTE: u64 = 10;
    /// Minimum turnaround of the arm in microseconds. It grows with each answer, up to twice this.
    const TURNAROUND: u64 = 100;
    let began = Instant::now();
    let mut bridge = Bridge::new(Identity::default(), polled(FEW), Start::default());
    bridge.usb_event(UsbEvent::Configured(true), time::Instant::ZERO);
    let mut listener = Listener {
        reader: Reader::new(),
        frames: 0,
        bytes: 0,
        last: Stamp(0),
    };
    let request = Request::Subscribe(Subscription {
        frames: true,
        events: true,
    });
    let mut message = [0; MAX_COBS];
    let len = encode_cobs(&FromHost { sequence: 1, request }, &mut message).unwrap();
    bridge.control_received(&message[..len], time::Instant::ZERO);

    let mut now = time::Instant::ZERO;
    let (mut polls, mut received) = (0_u32, 0_u64);
    let mut before = None;
    loop {
        while let Some(transmit) = bridge.uart_transmit(&mut [0; MAX_FRAME], now, |_, _| {}) {
            let Transmit::Burst { len, start } = transmit else {
                panic!("the line is the arm's from the start: {transmit:?}");
            };
            let start = start.unwrap_or(now);
            received += len as u64;
            let answer = numbered_answer(polls);
            let turnaround = TURNAROUND + u64::from(polls) % TURNAROUND;
            let end = time::Instant::from_micros(start.as_micros() + BYTE * (len + answer.len()) as u64 + turnaround);
            polls += 1;
            bridge.uart_received(&answer, end);
            bridge.uart_event(UartEvent::Idle, time::Instant::from_micros(end.as_micros() + BYTE));
            now = end;
            listener.read_packets(&mut bridge, end);
        }
        now = bridge.timeout().unwrap().max(now);
        if now.as_micros() >= SPAN {
            break;
        }
        bridge.tick(now);
        listener.read_packets(&mut bridge, now);
        // Answers to polls go to no other host.
        assert_eq!(bridge.usb_transmit(&mut [0; PACKET]), None);
        if before.is_none() && now.as_micros() > SPAN / 10 {
            before = memory();
        }
    }
    println!(
        "{polls} polls in two hours of virtual time, {:.0} s of real time",
        began.elapsed().as_secs_f64()
    );
    expect_flat(before);
    assert_eq!(u64::from(polls), SPAN / 1_000_000 * u64::from(FEW));
    assert_eq!(listener.frames, u64::from(polls));
    let counted = bridge.counters();
    let mut expected = Counters::default();
    expected.arm_to_host_bytes = listener.bytes as u32;
    expected.host_to_arm_bytes = received as u32;
    expected.frames = polls;
    expected.requests_poll = polls;
    expected.control_requests = 1;
    assert_eq!(counted, expected);
}

/// Maximum difference between a stamp and the end of its frame on the line: both are rounded down to microseconds, and
/// the interrupt that takes the stamp may be delayed.
const STAMPS_WITHIN: i64 = 3;

/// Sets the clock's timer, as a debugger can, with a deadline right after.
fn preset(board: &mut VirtualBoard<TicketArm>, count: u32) {
    let chip = facts(board.chip()).registers();
    board.write_word(chip.clock_count, count).unwrap();
    board.write_word(chip.clock_due, count.wrapping_add(10)).unwrap();
    board.run_for(Nanos::from_millis(2)).unwrap();
}

/// Deviations of the stamps of answers.
#[derive(Debug, Default)]
struct Stamps {
    frames: u32,
    /// By how much the adapter's clock is ahead of the board's, in microseconds, once it is known.
    ahead: Option<i64>,
    /// Stamps that were further from that than [`STAMPS_WITHIN`], and by how much.
    wrong: Vec<(Stamp, i64)>,
}

/// Runs a subscriber to polls for `span`, and compares every stamp with the end of the frame on the line.
fn listen(
    board: &mut VirtualBoard<TicketArm>,
    control: &mut Control,
    traffic: &mut Traffic,
    span: Nanos,
    stamps: &mut Stamps,
) {
    let end = board.now() + span;
    let mut ends: Vec<Nanos> = Vec::new();
    while board.now() < end {
        board.run_for(Nanos::from_millis(1)).unwrap();
        let line = board.uart().bytes();
        let sent = line.iter().filter(|byte| byte.direction == Direction::ToBoard);
        ends.extend(sent.map(|byte| byte.at));
        traffic.count(board);
        for (stamp, event) in control.take_events(board) {
            let Event::Frame { bytes, .. } = event else {
                panic!("{event:?}");
            };
            let last = ends.drain(..bytes.len()).next_back().unwrap();
            let ahead = stamp.0.wrapping_sub(last.instant().as_micros()) as i64;
            let off = ahead - *stamps.ahead.get_or_insert(ahead);
            if off.abs() > STAMPS_WITHIN {
                stamps.wrong.push((stamp, off));
            }
            stamps.frames += 1;
        }
    }
}

#[test]
fn stamps_stay_exact_across_timer_wraparound() {
    const BEFORE_US: u32 = 300_000;
    const SPAN: Nanos = Nanos::from_millis(700);
    const SETTLING: Nanos = Nanos::from_millis(20);
    on_board(TicketArm::new(time::Duration::from_micros(100)), |board| {
        plug_in(board, MEGABAUD);
        let mut control = Control::open(board);
        control.subscribe(board);
        let mut last = 0;
        // The middle of the timer's first turn, and its end: the clock goes on from both.
        for turn in [1 << 31, 1_u64 << 32] {
            preset(board, (turn as u32).wrapping_sub(BEFORE_US));
            let before = counters(board);
            let arm_counts = board.with_arm(|arm| arm.counts);
            let mut traffic = Traffic::begin(board);
            let mut stamps = Stamps::default();
            control.order(board, Request::SetConfig(polled(HERTZ)));
            listen(board, &mut control, &mut traffic, SPAN, &mut stamps);
            control.order(board, Request::SetConfig(Config::default()));
            listen(board, &mut control, &mut traffic, SETTLING, &mut stamps);
            let Stamps { frames, ahead, wrong } = stamps;
            assert_eq!(wrong, [], "stamps that are wrong, and by how many microseconds");
            let now = board.now().instant().as_micros().wrapping_add_signed(ahead.unwrap());
            assert!(last < turn && turn < now, "the turn at {turn}: {now} us");
            last = now;
            let after = counters(board);
            let polls = board.with_arm(|arm| arm.counts).polls - arm_counts.polls;
            println!("{frames} answers over {turn} us");
            assert!(frames == polls && polls >= 130, "{frames} of {polls}");
            assert_eq!(after.requests_poll - before.requests_poll, polls);
            assert_eq!(after.frames - before.frames, polls);
            assert_eq!(after.missed_polls, before.missed_polls);
            assert_eq!(after.unanswered_requests + after.late_answers, 0);
        }
    });
}

/// Polls on the image for `ARMWIRE_HOURS` hours, 24 by default.
#[test]
#[ignore = "takes hours: ARMWIRE_HOURS=24 cargo test --features image --test image_endurance -- --ignored --nocapture"]
fn day_of_polls_on_the_image() {
    const HOUR: u64 = 3_600_000;
    const STEP: Nanos = Nanos::from_millis(1_000);
    let hours = env::var("ARMWIRE_HOURS").map_or(24.0, |hours| hours.parse::<f64>().unwrap());
    let began = Instant::now();
    on_board(TicketArm::new(time::Duration::from_micros(100)), |board| {
        plug_in(board, MEGABAUD);
        let mut control = Control::open(board);
        control.subscribe(board);
        control.order(board, Request::SetConfig(polled(HERTZ)));
        let mut traffic = Traffic::begin(board);
        let start = board.now();
        let end = start + Nanos::from_millis((hours * HOUR as f64) as u64);
        let (mut stamps, mut before) = (Stamps::default(), None);
        while board.now() < end {
            listen(board, &mut control, &mut traffic, STEP, &mut stamps);
            if before.is_none() && board.now().since(start).0 > end.since(start).0 / 10 {
                before = memory();
            }
        }
        control.order(board, Request::SetConfig(Config::default()));
        listen(board, &mut control, &mut traffic, Nanos::from_millis(20), &mut stamps);
        let polls = board.with_arm(|arm| arm.counts).polls;
        println!(
            "{polls} polls in {hours} h of virtual time, {:.0} s of real time; stamps that are wrong: {:?}",
            began.elapsed().as_secs_f64(),
            stamps.wrong
        );
        assert_eq!(stamps.wrong, [], "stamps that are wrong, and by how many microseconds");
        expect_flat(before);
        let counted = counters(board);
        assert_eq!(stamps.frames, polls);
        assert_eq!((counted.requests_poll, counted.frames), (polls, polls));
        assert_eq!(
            (counted.missed_polls, counted.unanswered_requests, counted.noise_bytes),
            (0, 0, 0)
        );
        let slots = board.now().since(start).0 * u64::from(HERTZ) / 1_000_000_000;
        assert!(u64::from(polls).abs_diff(slots) <= 5, "{polls} polls in {slots} slots");
    });
}
