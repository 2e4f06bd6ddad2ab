//! The chip without a core: its registers written by the tests.

use std::collections::VecDeque;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};

use armwire_bridge::Instant;
use armwire_sim::serial::SerialDevice;

use super::*;
use crate::can::bus::Bus as CanBus;
use crate::core::{Access, Bus, Memory, Purpose, Width};
use crate::crystal::{Crystal, INTERNAL_HZ, LSI_HZ, Oscillator};
use crate::flash::{Flash, SIZE};
use crate::line::{Direction, Fault, Format, Line, LineByte, Outcome, Parity, SharedLine};
use crate::mcu::common::dma::{DELAYS, Delays};
use crate::mcu::common::flash::FlashInterface as _;
use crate::mcu::common::mcu::Mcu;
use crate::shared::Shared;
use crate::soc::machine::Chip;
use crate::timing::{Clock, Timing};
use crate::usb::host::Host;

const RCC: u32 = 0x4002_3800;
const RCC_AHB1ENR: u32 = 0x4002_3830;
const RCC_APB1ENR: u32 = 0x4002_3840;
const USART_SR: u32 = 0x4000_4400;
const USART_DR: u32 = 0x4000_4404;
const USART_BRR: u32 = 0x4000_4408;
const USART_CR1: u32 = 0x4000_440C;
const USART_CR2: u32 = 0x4000_4410;
const USART_CR3: u32 = 0x4000_4414;
/// DMA1's stream 5, which serves USART2's receiver on channel 4.
const STREAM_CR: u32 = 0x4002_6088;
const STREAM_NDTR: u32 = 0x4002_608C;
const STREAM_PAR: u32 = 0x4002_6090;
const STREAM_M0AR: u32 = 0x4002_6094;

const ORE: u32 = 1 << 3;
const FE: u32 = 1 << 1;
const NF: u32 = 1 << 2;
const RXNE: u32 = 1 << 5;

/// Channel 4, from the peripheral to memory, circular, memory pointer counting up.
const RECEIVE: u32 = 4 << 25 | 1 << 10 | 1 << 8;
const EN: u32 = 1;

/// Core-coupled memory, which is only on the processor's bus (2.3.1).
const CCM: u32 = 0x1000_0000;

/// The value of unwritten memory.
const UNTOUCHED: u8 = 0xEE;

/// DMA transfers without delays.
const PROMPT: Delays = Delays {
    arbitration: 0..=0,
    transfer: 0..=0,
    count: 0..=0,
};

/// The address and size of the DMA ring.
const RING: u32 = 0x2000_0000;
const RING_SIZE: u32 = 16;

mod clocks;
mod dma;
mod flash;
mod timers;
mod usart;

/// An arm that sends given bytes at given times.
#[derive(Debug, Default)]
struct Arm {
    output: VecDeque<(Instant, u8)>,
    received: Vec<(Instant, u8)>,
}

impl SerialDevice for Arm {
    fn receive(&mut self, now: Instant, byte: u8) {
        self.received.push((now, byte));
    }

    fn transmit(&mut self, now: Instant) -> Option<u8> {
        self.output
            .pop_front_if(|&mut (due, _)| due <= now)
            .map(|(_, byte)| byte)
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.output.front().map(|&(due, _)| due)
    }
}

/// The chip, its line, and its memories.
struct Bench {
    part: Mcu<Stm32f405>,
    line: SharedLine<Arm>,
    can: Shared<CanBus>,
    flash: Shared<Flash>,
    host: Shared<Host>,
    oscillator: Shared<Oscillator>,
    memory: Memory,
    now: Nanos,
    /// The changes of interrupt lines.
    interrupts: Vec<bool>,
    /// Number of violations read so far.
    seen_violations: usize,
}

impl Bench {
    /// USART2 runs at 1 Mbaud from the initial 16 MHz, and its DMA fills a ring, without delays.
    fn new(reenabled: Reenabled) -> Self {
        let starve = Arc::new(AtomicBool::new(false));
        let line = Arc::new(Mutex::new(Line::new(Arm::default(), 1_000_000, 0, starve.clone())));
        let flash = Arc::new(Mutex::new(Flash::new(vec![0; SIZE], None, Clock::default())));
        let oscillator = Arc::new(Mutex::new(Oscillator::new(
            Crystal::new(8_000_000),
            INTERNAL_HZ,
            LSI_HZ,
        )));
        let edges = Edges {
            line: line.clone(),
            starve,
            host: Arc::default(),
            can: Arc::default(),
            flash: flash.clone(),
            oscillator: oscillator.clone(),
        };
        let mut peripherals = Stm32f405::new(IDENTITY, ArmUart::Usart2, reenabled, OtgVariant::default(), 0, &edges);
        peripherals.dma.set_delays(PROMPT);
        let part = Mcu::new(peripherals, [0; 12], 100, 0, edges.clone());
        let mut memory = Memory::new(map::MAP.flash, vec![0; SIZE], map::MAP.ram, map::MAP.ram_size);
        memory.fill_ram(|| UNTOUCHED);
        let mut bench = Self {
            part,
            line,
            can: edges.can,
            flash,
            host: edges.host,
            oscillator,
            memory,
            now: Nanos(0),
            interrupts: Vec::new(),
            seen_violations: 0,
        };
        for (address, value) in [
            (RCC_AHB1ENR, 1 << 21),
            (RCC_APB1ENR, 1 << 17),
            (STREAM_PAR, USART_DR),
            (STREAM_M0AR, RING),
            (STREAM_NDTR, RING_SIZE),
            (STREAM_CR, RECEIVE | EN),
            (USART_BRR, 16),
            (USART_CR3, 1 << 6),
            (USART_CR1, 1 << 13 | 1 << 3 | 1 << 2),
        ] {
            bench.write(address, value);
        }
        bench
    }

    /// Executes due events, and records the changes of interrupt lines.
    fn settle(&mut self) {
        while self.part.next_event() <= self.now {
            self.part.handle_event(&mut self.memory);
        }
        while let Some((_, high)) = self.part.take_interrupt() {
            self.interrupts.push(high);
        }
    }

    fn access(&self, address: u32, width: Width) -> Access {
        Access {
            address,
            width,
            cycle: self.part.common.clock.tick(self.now),
            pc: 0,
            purpose: Purpose::Data,
            privileged: true,
        }
    }

    fn store(&mut self, address: u32, width: Width, value: u32) {
        self.part.common.now = self.now;
        let access = self.access(address, width);
        self.part.write(access, value, &mut self.memory).unwrap();
        self.settle();
    }

    /// Writes a register. A read of RCC follows a write, as in firmware that enables a clock.
    fn write(&mut self, address: u32, value: u32) {
        self.store(address, Width::Word, value);
        if address & !0x3FF == RCC & !0x3FF {
            self.read(RCC_AHB1ENR);
        }
    }

    fn read(&mut self, address: u32) -> u32 {
        self.part.common.now = self.now;
        let access = self.access(address, Width::Word);
        let value = self.part.read(access, &mut self.memory).unwrap();
        self.settle();
        value
    }

    /// Returns true if there is nothing at an address, or if it refuses the access.
    fn is_refused(&mut self, address: u32) -> bool {
        let before = self.part.recorder().violations().len();
        let access = self.access(address, Width::Word);
        let read = self.part.read(access, &mut self.memory);
        read.is_err() || self.part.recorder().violations().len() > before
    }

    /// Checks for changes by the test, then executes each event at its instant.
    fn run_until(&mut self, until: Nanos) {
        self.part.come_near(self.now);
        self.part.sync(self.now, &mut self.memory);
        self.settle();
        while self.part.next_event() <= until {
            self.now = self.part.next_event();
            self.settle();
        }
        self.now = until;
    }

    fn restart(&mut self, cause: Cause) {
        self.part.restart(cause, self.now, &mut self.memory);
        self.settle();
    }

    fn arm_sends(&mut self, bytes: &[u8]) {
        let due = self.now.instant();
        lock(&self.line)
            .arm_mut()
            .output
            .extend(bytes.iter().map(|&byte| (due, byte)));
        self.part.sync(self.now, &mut self.memory);
        self.settle();
    }

    fn ring(&self, count: u32) -> Vec<u8> {
        (0..count).map(|at| self.byte(RING + at)).collect()
    }

    /// A byte of the memories.
    fn byte(&self, address: u32) -> u8 {
        self.memory.read(address, Width::Byte).unwrap() as u8
    }

    /// The changes of interrupt lines since the last call: true for a rising edge.
    fn drain_interrupts(&mut self) -> Vec<bool> {
        std::mem::take(&mut self.interrupts)
    }

    /// Number of violations since the last call.
    fn drain_violations(&mut self) -> usize {
        let seen_violations = self.part.recorder().violations().len();
        seen_violations - std::mem::replace(&mut self.seen_violations, seen_violations)
    }
}

#[test]
fn arm_bytes_reach_memory_ten_bits_apart() {
    let mut bench = Bench::new(Reenabled::Restarts);
    bench.arm_sends(&[1, 2, 3]);
    bench.run_until(Nanos(20_000));
    assert_eq!(bench.ring(3), [1, 2, 0xEE]);
    bench.run_until(Nanos(30_000));
    assert_eq!(bench.ring(3), [1, 2, 3]);
    let ends: Vec<u64> = lock(&bench.line).bytes().iter().map(|byte| byte.at.0).collect();
    assert_eq!(ends, [10_000, 20_000, 30_000]);
}

#[test]
fn board_bytes_take_ten_bits_at_set_rate() {
    let mut bench = Bench::new(Reenabled::Restarts);
    bench.run_until(Nanos(50_000));
    bench.write(USART_DR, 0x55);
    bench.run_until(Nanos(100_000));
    let received = lock(&bench.line).arm_mut().received.clone();
    assert_eq!(received, [(Instant::from_micros(60), 0x55)]);
    assert_eq!(lock(&bench.line).board_baud(), Some(1_000_000));
}

#[test]
fn framing_error_and_noise_are_flagged_with_byte() {
    for (fault, flag, value) in [
        (Fault::Framing, FE, !0x42),
        (Fault::Noise, NF, 0x42),
        (Fault::Break, FE, 0),
    ] {
        let mut bench = Bench::new(Reenabled::Restarts);
        bench.write(USART_CR3, 0);
        lock(&bench.line).plan_fault(0, fault);
        bench.arm_sends(&[0x42]);
        bench.run_until(Nanos(10_000));
        assert_eq!(bench.read(USART_SR) & (FE | NF | ORE | RXNE), flag | RXNE, "{fault:?}");
        assert_eq!(bench.read(USART_DR) as u8, value, "{fault:?}");
    }
}

#[test]
fn parity_byte_with_two_stops_lasts_twelve_bits() {
    let mut bench = Bench::new(Reenabled::Restarts);
    // STOP = 2; M, PCE and PS: odd.
    bench.write(USART_CR2, 2 << 12);
    bench.write(USART_CR1, 1 << 13 | 1 << 12 | 1 << 10 | 1 << 9 | 1 << 3 | 1 << 2);
    let format = Format {
        parity: Parity::Odd,
        two_stop_bits: true,
    };
    assert_eq!(lock(&bench.line).board_format(), format);
    lock(&bench.line).set_arm_format(format);
    bench.run_until(Nanos(50_000));
    bench.arm_sends(&[0x55, 0x07]);
    bench.write(USART_DR, 0x42);
    bench.run_until(Nanos(100_000));
    assert_eq!(bench.ring(2), [0x55, 0x07]);
    assert_eq!(
        bytes(&bench),
        [
            (62_000, Direction::ToArm, 0x42, Outcome::Arrived),
            (62_000, Direction::ToBoard, 0x55, Outcome::Arrived),
            (74_000, Direction::ToBoard, 0x07, Outcome::Arrived),
        ]
    );
}

#[test]
fn parity_flag_lasts_until_status_and_data_reads() {
    const PE: u32 = 1;
    let mut bench = Bench::new(Reenabled::Restarts);
    bench.write(USART_CR3, 0);
    bench.write(USART_CR1, 1 << 13 | 1 << 12 | 1 << 10 | 1 << 3 | 1 << 2);
    lock(&bench.line).set_arm_format(Format {
        parity: Parity::Even,
        two_stop_bits: false,
    });
    lock(&bench.line).plan_fault(1, Fault::Parity);
    bench.arm_sends(&[0x41]);
    bench.run_until(Nanos(11_000));
    assert_eq!(bench.read(USART_SR) & (PE | RXNE), RXNE);
    assert_eq!(bench.read(USART_DR) as u8, 0x41);
    bench.arm_sends(&[0x42]);
    bench.run_until(Nanos(30_000));
    assert_eq!(bench.read(USART_SR) & (PE | RXNE | FE), PE | RXNE);
    assert_eq!(bench.read(USART_DR) as u8, 0x42);
    assert_eq!(bench.read(USART_SR) & PE, 0);
    let fared: Vec<Outcome> = bytes(&bench).iter().map(|&(.., outcome)| outcome).collect();
    assert_eq!(fared, [Outcome::Arrived, Outcome::Faulty(Fault::Parity)]);
}

#[test]
fn parity_error_interrupts_if_enabled() {
    for (enabled, levels) in [(false, vec![]), (true, vec![true, false])] {
        let mut bench = Bench::new(Reenabled::Restarts);
        bench.write(USART_CR3, 0);
        let parity = 1 << 13 | 1 << 12 | 1 << 10 | 1 << 3 | 1 << 2;
        bench.write(USART_CR1, parity | u32::from(enabled) << 8);
        // The arm has no parity bit: its stop bit is high in the place of the low even parity of 0x41.
        bench.arm_sends(&[0x41]);
        bench.run_until(Nanos(20_000));
        bench.read(USART_SR);
        bench.read(USART_DR);
        let mut received = bench.drain_interrupts();
        received.dedup();
        assert_eq!(received, levels);
    }
}

#[test]
fn late_dma_loses_byte_after_the_waiting_one() {
    let mut bench = Bench::new(Reenabled::Restarts);
    lock(&bench.line).plan_fault(2, Fault::Overrun);
    bench.arm_sends(&[1, 2, 3, 4]);
    bench.run_until(Nanos(20_000));
    assert_eq!(bench.ring(2), [1, 0xEE], "the second waits in the UART");
    bench.run_until(Nanos(30_000));
    assert_eq!(bench.ring(2), [1, 2]);
    assert_eq!(bench.read(USART_SR) & ORE, ORE);
    bench.run_until(Nanos(40_000));
    assert_eq!(bench.ring(4), [1, 2, 4, 0xEE]);
    let lost = lock(&bench.line).bytes()[2];
    assert_eq!((lost.sent, lost.outcome), (3, Outcome::Faulty(Fault::Overrun)));
}

#[test]
fn reenabled_stream_restarts_or_resumes() {
    for (reenabled, ring) in [
        (Reenabled::Restarts, [3, 4, 0xEE, 0xEE]),
        (Reenabled::Resumes, [1, 2, 3, 4]),
    ] {
        let mut bench = Bench::new(reenabled);
        bench.arm_sends(&[1, 2]);
        bench.run_until(Nanos(30_000));
        bench.write(STREAM_CR, RECEIVE);
        assert_eq!(bench.read(STREAM_CR) & EN, 0);
        assert_eq!(bench.read(STREAM_NDTR), RING_SIZE - 2, "{reenabled:?}");
        bench.write(STREAM_CR, RECEIVE | EN);
        bench.arm_sends(&[3, 4]);
        bench.run_until(Nanos(60_000));
        assert_eq!(bench.ring(4), ring, "{reenabled:?}");
    }
}

#[test]
fn stream_that_is_stopped_moves_nothing() {
    for reenabled in [Reenabled::Restarts, Reenabled::Resumes] {
        let mut bench = Bench::new(reenabled);
        bench.write(STREAM_CR, RECEIVE);
        bench.arm_sends(&[1]);
        bench.run_until(Nanos(30_000));
        assert_eq!(bench.ring(1), [0xEE], "{reenabled:?}");
        bench.write(STREAM_CR, RECEIVE | EN);
        assert_eq!(bench.ring(1), [1], "{reenabled:?}: the byte waited in the UART");
    }
}

#[test]
fn reconfigured_stream_restarts_even_if_resumable() {
    let mut bench = Bench::new(Reenabled::Resumes);
    bench.arm_sends(&[1, 2]);
    bench.run_until(Nanos(30_000));
    bench.write(STREAM_CR, RECEIVE);
    bench.write(STREAM_NDTR, RING_SIZE);
    bench.write(STREAM_M0AR, RING);
    bench.write(STREAM_CR, RECEIVE | EN);
    bench.arm_sends(&[3]);
    bench.run_until(Nanos(60_000));
    assert_eq!(bench.ring(2), [3, 2]);
    assert_eq!(bench.read(STREAM_NDTR), RING_SIZE - 1);
}

#[test]
fn dma_does_not_reach_core_coupled_memory() {
    let mut bench = Bench::new(Reenabled::Restarts);
    bench.write(STREAM_CR, RECEIVE);
    bench.write(STREAM_M0AR, CCM);
    bench.write(STREAM_CR, RECEIVE | EN);
    bench.arm_sends(&[1]);
    bench.run_until(Nanos(30_000));
    assert_eq!(bench.read(STREAM_CR) & EN, 0, "a transfer error stops it");
}

#[test]
fn arm_outlives_a_reset_of_the_part() {
    let mut bench = Bench::new(Reenabled::Restarts);
    bench.arm_sends(&[1]);
    lock(&bench.line)
        .arm_mut()
        .output
        .push_back((Instant::from_micros(500), 2));
    bench.run_until(Nanos(50_000));
    bench.restart(Cause::Software);
    assert!(bench.is_refused(USART_CR1), "its clock is off");
    bench.run_until(Nanos(600_000));
    let line = lock(&bench.line);
    let last = line.bytes().last().unwrap();
    assert_eq!(
        (last.sent, last.outcome),
        (2, Outcome::Lost),
        "it was sent when it was due, without a receiver"
    );
}

/// USART2 on one wire, with its DMA, and its receiver on or off.
fn half_duplex(receives: bool) -> Bench {
    let mut bench = Bench::new(Reenabled::Restarts);
    bench.write(USART_CR3, 1 << 6 | 1 << 3);
    bench.write(USART_CR1, 1 << 13 | 1 << 3 | u32::from(receives) << 2);
    bench.run_until(Nanos(50_000));
    bench
}

/// The bytes on the line: time, direction, byte, outcome.
fn bytes(bench: &Bench) -> Vec<(u64, Direction, u8, Outcome)> {
    let line = lock(&bench.line);
    let each = |byte: &LineByte| (byte.at.0, byte.direction, byte.sent, byte.outcome);
    line.bytes().iter().map(each).collect()
}

#[test]
fn one_wire_board_receives_itself_then_arm() {
    let mut bench = half_duplex(true);
    assert!(lock(&bench.line).is_half_duplex());
    bench.write(USART_DR, 0x11);
    bench.write(USART_DR, 0x22);
    bench.run_until(Nanos(59_999));
    assert_eq!(bench.ring(1), [0xEE]);
    bench.run_until(Nanos(70_000));
    assert_eq!(bench.ring(3), [0x11, 0x22, 0xEE], "each as its stop bit ends");
    bench.arm_sends(&[0x33]);
    bench.run_until(Nanos(100_000));
    assert_eq!(bench.ring(4), [0x11, 0x22, 0x33, 0xEE]);
    assert_eq!(
        bytes(&bench),
        [
            (60_000, Direction::ToArm, 0x11, Outcome::Arrived),
            (70_000, Direction::ToArm, 0x22, Outcome::Arrived),
            (80_000, Direction::ToBoard, 0x33, Outcome::Arrived),
        ]
    );
}

#[test]
fn one_wire_disabled_receiver_misses_the_board() {
    let mut bench = half_duplex(false);
    bench.write(USART_DR, 0x11);
    bench.run_until(Nanos(65_000));
    bench.write(USART_CR1, 1 << 13 | 1 << 3 | 1 << 2);
    bench.arm_sends(&[0x33]);
    bench.run_until(Nanos(100_000));
    assert_eq!(bench.ring(2), [0x33, 0xEE]);
}

#[test]
fn two_wire_board_does_not_receive_itself() {
    let mut bench = Bench::new(Reenabled::Restarts);
    bench.run_until(Nanos(50_000));
    bench.write(USART_DR, 0x11);
    bench.arm_sends(&[0x33]);
    bench.run_until(Nanos(100_000));
    assert_eq!(bench.ring(2), [0x33, 0xEE]);
}

#[test]
fn on_one_wire_bytes_that_overlap_collide() {
    // The arm starts within the board's byte, then the board within the arm's.
    for arm_first in [false, true] {
        let mut bench = half_duplex(true);
        if arm_first {
            bench.arm_sends(&[0x33]);
            bench.run_until(Nanos(54_000));
            bench.write(USART_DR, 0x11);
        } else {
            bench.write(USART_DR, 0x11);
            bench.run_until(Nanos(54_000));
            bench.arm_sends(&[0x33]);
        }
        bench.run_until(Nanos(200_000));
        let mut bytes = bytes(&bench);
        bytes.sort_by_key(|&(at, ..)| at);
        let (first, second) = match arm_first {
            true => ((Direction::ToBoard, 0x33), (Direction::ToArm, 0x11)),
            false => ((Direction::ToArm, 0x11), (Direction::ToBoard, 0x33)),
        };
        let collided = Outcome::Collided;
        let at = if arm_first { 64_000 } else { bytes[1].0 };
        assert_eq!(
            bytes,
            [(60_000, first.0, first.1, collided), (at, second.0, second.1, collided)]
        );
        assert_eq!(lock(&bench.line).arm_mut().received[0].1, !0x11);
        assert!(!bench.ring(2).contains(&0x11) && !bench.ring(2).contains(&0x33));
        assert_eq!(bench.read(USART_SR) & FE, FE);
        // The line works again.
        bench.arm_sends(&[0x44]);
        bench.run_until(Nanos(300_000));
        assert!(bench.ring(4).contains(&0x44));
    }
}

#[test]
fn can1_runs_on_its_enabled_bus_clock() {
    const MCR: u32 = 0x4000_6400;
    const BTR: u32 = 0x4000_641C;
    const TI0R: u32 = 0x4000_6580;
    let mut bench = Bench::new(Reenabled::Restarts);
    assert!(bench.is_refused(MCR), "its clock is off");
    lock(&bench.can).attach(1_000_000);
    // 16 quanta of the initial 16 MHz.
    for (address, value) in [
        (RCC_APB1ENR, 1 << 17 | 1 << 25),
        (MCR, 1),
        (BTR, 12 << 16 | 1 << 20),
        (MCR, 0),
    ] {
        bench.write(address, value);
    }
    bench.run_until(Nanos(20_000));
    bench.write(TI0R, 0x7FF << 21 | 1);
    bench.run_until(Nanos(100_000));
    let can = lock(&bench.can);
    let [record] = can.records() else {
        panic!("one frame: {:?}", can.records());
    };
    assert_eq!((record.start, record.end), (Nanos(20_000), Nanos(67_000)));
}

#[test]
fn missing_f405_peripherals_have_no_address() {
    let mut bench = Bench::new(Reenabled::Restarts);
    let uart7 = 0x4000_7800;
    assert!(bench.is_refused(uart7));
    let otg_host_channel = 0x5000_0500;
    bench.write(0x4002_3834, 1 << 7);
    assert!(bench.is_refused(otg_host_channel));
    assert_eq!(bench.read(0x5000_003C), 0x1200, "the USB core's identification");
}
