//! The chip without a core: its registers written by the tests.

use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};

use super::*;
use crate::board::tests::NoArm;
use crate::core::{Access, Bus, Memory, Purpose, Width};
use crate::crystal::{Crystal, INTERNAL_HZ, LSI_HZ, Oscillator};
use crate::flash::{ERASED, Flash};
use crate::line::Line;
use crate::mcu::common::mcu::Mcu;
use crate::shared::lock;
use crate::soc::machine::Chip as _;
use crate::timing;

/// MODER and BSRR of GPIOA, CR1 of USART2, and the clocks of the two (RM0440, table 3).
const MODER: u32 = 0x4800_0000;
const BSRR: u32 = 0x4800_0018;
const USART_CR1: u32 = 0x4000_4400;
const AHB2ENR: u32 = 0x4002_104C;
const APB1ENR1: u32 = 0x4002_1058;

/// PA2's level and mode (9.4.1, 9.4.7).
const HIGH: u32 = 1 << 2;
const LOW: u32 = 1 << 18;
const OUTPUT: u32 = 1 << 4;
const ALTERNATE: u32 = 2 << 4;

fn chip() -> Mcu<Stm32g431> {
    let starve = Arc::new(AtomicBool::new(false));
    let flash = Flash::new(vec![ERASED; flash::SIZE], None, timing::Clock::default());
    let edges = Edges {
        line: Arc::new(Mutex::new(Line::new(NoArm, 1_000_000, 0, starve.clone()))),
        starve,
        host: Arc::default(),
        can: Arc::default(),
        flash: Arc::new(Mutex::new(flash)),
        oscillator: Arc::new(Mutex::new(Oscillator::new(
            Crystal::new(8_000_000),
            INTERNAL_HZ,
            LSI_HZ,
        ))),
    };
    let unique_id = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12];
    Mcu::new(
        Stm32g431::new(EccRegister::Correct, 0, &edges),
        unique_id,
        100,
        0,
        edges,
    )
}

fn access(address: u32, purpose: Purpose) -> Access {
    Access {
        address,
        width: Width::Word,
        cycle: 0,
        pc: 0,
        purpose,
        privileged: true,
    }
}

/// Writes a register. A read of RCC follows a write, as in firmware that enables a clock.
fn write(chip: &mut Mcu<Stm32g431>, address: u32, value: u32) {
    let mut none = Memory::new(0, Vec::new(), 0, 0);
    Bus::write(chip, access(address, Purpose::Data), value, &mut none).unwrap();
    if address & !0x3FF == AHB2ENR & !0x3FF {
        Bus::read(chip, access(AHB2ENR, Purpose::Data), &mut none).unwrap();
    }
}

/// A word as read by the debugger.
fn debug_read(chip: &mut Mcu<Stm32g431>, address: u32) -> Option<u32> {
    let mut none = Memory::new(0, Vec::new(), 0, 0);
    Bus::read(chip, access(address, Purpose::Debug), &mut none).ok()
}

#[test]
fn debugger_reads_the_system_memory() {
    let mut chip = chip();
    assert_eq!(debug_read(&mut chip, 0x1FFF_7590), Some(0x0403_0201));
    assert_eq!(debug_read(&mut chip, 0x1FFF_7000), None);
    assert!(chip.common.recorder.violations().is_empty());
}

#[test]
fn clock_runs_two_cycles_after_its_enable() {
    for (cycles, reads_back, refused) in [(1, false, 1), (2, false, 1), (3, false, 0), (1, true, 0)] {
        let mut chip = chip();
        let mut none = Memory::new(0, Vec::new(), 0, 0);
        let mut at = access(AHB2ENR, Purpose::Data);
        Bus::write(&mut chip, at, 1, &mut none).unwrap();
        if reads_back {
            at.cycle += 1;
            Bus::read(&mut chip, at, &mut none).unwrap();
        }
        at.cycle += cycles;
        at.address = BSRR;
        Bus::write(&mut chip, at, HIGH, &mut none).unwrap();
        let violations = chip.common.recorder.violations();
        assert_eq!(violations.len(), refused, "{cycles} cycles: {violations:?}");
    }
}

/// TIM16, which captures the crystal's clock (RM0440, 31.8), and its clock.
const TIM_CR1: u32 = 0x4001_4400;
const TIM_SR: u32 = TIM_CR1 + 0x10;
const TIM_CCMR1: u32 = TIM_CR1 + 0x18;
const TIM_CCER: u32 = TIM_CR1 + 0x20;
const TIM_CCR1: u32 = TIM_CR1 + 0x34;
const TIM_TISEL: u32 = TIM_CR1 + 0x5C;
const TIM_OR1: u32 = TIM_CR1 + 0x68;
const APB2ENR: u32 = 0x4002_1060;
const RCC_CR: u32 = 0x4002_1000;
const HSEON: u32 = 1 << 16;
const CC1IF: u32 = 1 << 1;

/// A chip whose running crystal is captured, every eighth edge.
fn capturing(hertz: u32) -> Mcu<Stm32g431> {
    let mut chip = chip();
    lock(&chip.common.edges.oscillator).crystal = Crystal::new(hertz);
    let control = read(&mut chip, RCC_CR);
    write(&mut chip, RCC_CR, control | HSEON);
    run_for(&mut chip, Nanos::from_millis(3));
    for (address, value) in [
        (APB2ENR, 1 << 17),
        (TIM_OR1, 1),
        (TIM_TISEL, 3),
        (TIM_CCMR1, 3 << 2 | 1),
        (TIM_CCER, 1),
        (TIM_CR1, 1),
    ] {
        write(&mut chip, address, value);
    }
    chip
}

fn read(chip: &mut Mcu<Stm32g431>, address: u32) -> u32 {
    let mut none = Memory::new(0, Vec::new(), 0, 0);
    Bus::read(chip, access(address, Purpose::Data), &mut none).unwrap()
}

fn run_for(chip: &mut Mcu<Stm32g431>, span: Nanos) {
    let mut none = Memory::new(0, Vec::new(), 0, 0);
    let until = chip.common.now + span;
    while chip.next_event() <= until {
        chip.handle_event(&mut none);
    }
    chip.common.now = until;
}

#[test]
fn timer_captures_crystal_divided_by_32() {
    for (hertz, cycles) in [
        (8_000_000, 512..=512),
        (12_000_000, 341..=342),
        (16_000_000, 256..=256),
        (25_000_000, 163..=164),
    ] {
        let mut chip = capturing(hertz);
        let mut capture = || {
            while read(&mut chip, TIM_SR) & CC1IF == 0 {
                run_for(&mut chip, Nanos(1_000));
            }
            read(&mut chip, TIM_CCR1)
        };
        let first = capture();
        let captured = capture().wrapping_sub(first) & 0xFFFF;
        assert!(cycles.contains(&captured), "{hertz} Hz: {captured}");
        assert!(chip.common.recorder.violations().is_empty());
    }
}

#[test]
fn capture_needs_the_divided_clock_and_the_input() {
    for (address, value) in [(TIM_OR1, 0), (TIM_TISEL, 0), (RCC_CR, 1 << 8)] {
        let mut chip = capturing(8_000_000);
        write(&mut chip, address, value);
        write(&mut chip, TIM_SR, 0);
        run_for(&mut chip, Nanos::from_millis(1));
        assert_eq!(read(&mut chip, TIM_SR), 0, "{address:#x}");
    }
}

#[test]
fn floating_arm_pin_is_reported() {
    // The violations for the UART's transmitter on or off, the pin's mode, and its level.
    let on = 1 | 1 << 3;
    for (steps, reported) in [
        (&[(USART_CR1, on), (MODER, ALTERNATE)][..], 0),
        (&[(USART_CR1, on), (MODER, ALTERNATE), (USART_CR1, 1 << 3)], 1),
        (&[(USART_CR1, on), (MODER, ALTERNATE), (USART_CR1, 1)], 1),
        (&[(USART_CR1, 0), (MODER, ALTERNATE)], 1),
        (
            &[
                (USART_CR1, 0),
                (BSRR, HIGH),
                (MODER, OUTPUT),
                (USART_CR1, on),
                (MODER, ALTERNATE),
            ],
            0,
        ),
        (&[(MODER, OUTPUT)], 1),
        (&[(BSRR, HIGH), (MODER, OUTPUT), (BSRR, LOW)], 1),
    ] {
        let mut chip = chip();
        write(&mut chip, AHB2ENR, 1);
        write(&mut chip, APB1ENR1, 1 << 17);
        for &(address, value) in steps {
            write(&mut chip, address, value);
        }
        let violations = chip.common.recorder.violations();
        assert_eq!(violations.len(), reported, "{steps:x?}: {violations:?}");
    }
}
