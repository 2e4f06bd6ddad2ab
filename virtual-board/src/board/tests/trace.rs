//! Traces with stored hashes: a change in the order or the time of any event changes them.
//!
//! A program for each chip uses timer interrupts, sends bytes to the arm by DMA, receives the arm's bytes by DMA, and
//! sends a frame on CAN. It does not depend on a compiler. After an intended change of a model, store the new hashes,
//! which the failing test prints.

use std::collections::VecDeque;

use armwire_bridge::{Duration, Instant};
use armwire_sim::serial::SerialDevice;

use super::*;
use crate::line::Direction;

/// An arm that returns each byte, inverted, after a delay.
#[derive(Debug, Default)]
struct Echo(VecDeque<(Instant, u8)>);

impl Echo {
    const AFTER: Duration = Duration::from_micros(35);
}

impl SerialDevice for Echo {
    fn receive(&mut self, now: Instant, byte: u8) {
        self.0
            .push_back((Instant::from_micros(now.as_micros() + Self::AFTER.as_micros()), !byte));
    }

    fn transmit(&mut self, now: Instant) -> Option<u8> {
        self.0.pop_front_if(|(due, _)| *due <= now).map(|(_, byte)| byte)
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.0.front().map(|(due, _)| *due)
    }
}

const FLASH: u32 = 0x0800_0000;
const STACK: u32 = 0x2000_1000;
/// Destination of the arm's bytes.
const RECEIVED: u32 = 0x2000_0000;
/// Number of words of the vector table, and of those before the interrupts.
const VECTORS: usize = 128;
const CORE_VECTORS: usize = 16;
/// Interrupt enable registers of the NVIC.
const ISER: u32 = 0xE000_E100;

/// Hand-assembled instructions.
struct Program {
    vectors: [u32; VECTORS],
    code: Vec<u16>,
}

impl Program {
    fn new() -> Self {
        let mut vectors = [0; VECTORS];
        vectors[0] = STACK;
        let code = Vec::new();
        Self { vectors, code }
    }

    /// Sets the entry point to the next instruction.
    fn start(&mut self) {
        self.vectors[1] = self.here();
    }

    /// The address of the next instruction, as in a vector.
    fn here(&self) -> u32 {
        FLASH + 4 * VECTORS as u32 + 2 * self.code.len() as u32 + 1
    }

    /// movw and movt r`register`
    fn constant(&mut self, register: u16, value: u32) {
        for (opcode, half) in [(0xF240, value as u16), (0xF2C0, (value >> 16) as u16)] {
            self.code.push(opcode | half >> 12 | half >> 1 & 0x400);
            self.code.push(half << 4 & 0x7000 | register << 8 | half & 0xFF);
        }
    }

    fn read(&mut self, address: u32) {
        self.constant(0, address);
        self.code.push(load(1, 0));
    }

    fn write(&mut self, address: u32, value: u32) {
        self.constant(0, address);
        self.constant(1, value);
        self.code.push(str(1, 0));
    }

    fn write_all(&mut self, base: u32, values: &[(u32, u32)]) {
        for &(offset, value) in values {
            self.write(base + offset, value);
        }
    }

    /// Polls a register until a bit has a value.
    fn wait(&mut self, address: u32, bit: u16, set: bool) {
        self.constant(0, address);
        // lsls r1, r1, #31-bit; bpl or bmi to the load
        let back = if set { 0xD5FC } else { 0xD4FC };
        self.code.extend([load(1, 0), (31 - bit) << 6 | 1 << 3 | 1, back]);
    }

    /// Enables an interrupt with a handler written by `handler`.
    fn handler(&mut self, interrupt: usize, handler: impl FnOnce(&mut Self)) {
        self.vectors[CORE_VECTORS + interrupt] = self.here();
        handler(self);
        // bx lr
        self.code.push(0x4770);
    }

    fn enable(&mut self, interrupt: usize) {
        self.write(ISER + interrupt as u32 / 32 * 4, 1 << (interrupt % 32));
    }

    /// Sleeps forever.
    fn sleep(&mut self) {
        self.code.extend([WFI, BACK]);
    }

    /// Sets a timer's compare 200 ticks ahead.
    fn compare_again(&mut self, timer: u32) {
        self.write(timer + 0x10, 0);
        self.constant(0, timer);
        // ldr r1, [r0, #CNT]; adds r1, #200; str r1, [r0, #CCR1]
        self.code.extend([0x6A41, 0x31C8, 0x6341]);
    }

    /// Reads the flags at one address, and clears them at another.
    fn clear_flags(&mut self, flags: u32, clear: u32) {
        self.read(flags);
        self.constant(0, clear);
        self.code.push(str(1, 0));
    }

    fn image(self) -> Image {
        let words = self.vectors.iter().flat_map(|vector| vector.to_le_bytes());
        let code = self.code.iter().flat_map(|half| half.to_le_bytes());
        Image::plain(FLASH.into(), words.chain(code).collect())
    }
}

/// Number of bytes to the arm, from the vector table on, and size of the receive ring.
const SENT: u32 = 40;
const RING: u32 = 16;

/// Core, buses and CAN run at 16 MHz.
fn stm32f405() -> Program {
    const RCC: u32 = 0x4002_3800;
    const GPIOA: u32 = 0x4002_0000;
    const DMA1: u32 = 0x4002_6000;
    const USART2: u32 = 0x4000_4400;
    const TIM5: u32 = 0x4000_0C00;
    const CAN1: u32 = 0x4000_6400;
    let mut program = Program::new();
    // DMA1_Stream5 and DMA1_Stream6: HISR, HIFCR.
    for stream in [16, 17] {
        program.handler(stream, |program| program.clear_flags(DMA1 + 0x04, DMA1 + 0x0C));
    }
    // CAN1_TX: RQCP0 of TSR.
    program.handler(19, |program| program.write(CAN1 + 0x08, 1));
    // USART2: SR, DR.
    program.handler(38, |program| {
        program.read(USART2);
        program.read(USART2 + 0x04);
    });
    program.handler(50, |program| program.compare_again(TIM5));

    program.start();
    // ACR of the flash: 5 wait states, prefetch, caches.
    program.write(0x4002_3C00, 0x705);
    // AHB1ENR, APB1ENR.
    program.write_all(RCC, &[(0x30, 1 << 21 | 1), (0x40, 1 << 25 | 1 << 17 | 1 << 3)]);
    for interrupt in [16, 17, 19, 38, 50] {
        program.enable(interrupt);
    }
    // CCR1, DIER: CC1IE, CR1: CEN.
    program.write_all(TIM5, &[(0x34, 200), (0x0C, 2), (0x00, 1)]);
    // BRR: 1 Mbaud, CR3: DMAT and DMAR, CR1: UE, IDLEIE, TE, RE.
    program.write_all(USART2, &[(0x08, 0x10), (0x14, 0xC0), (0x0C, 0x201C)]);
    // PA2 and PA3 are USART2's: AFRL, MODER.
    program.write_all(GPIOA, &[(0x20, 0x7700), (0x00, 0xA800_00A0)]);
    // Stream 5, from the UART in a ring, and stream 6, to the UART: SxPAR, SxM0AR, SxNDTR, SxCR.
    for (stream, memory, count, control) in [(5, RECEIVED, RING, 0x0800_0519), (6, FLASH, SENT, 0x0800_0451)] {
        let registers = [(0x18, USART2 + 0x04), (0x1C, memory), (0x14, count), (0x10, control)];
        program.write_all(DMA1 + 0x18 * stream, &registers);
    }
    // MCR: INRQ; IER: TMEIE; BTR: 500 kbit/s; and back.
    program.write(CAN1, 1);
    program.wait(CAN1 + 0x04, 0, true);
    program.write_all(CAN1, &[(0x14, 1), (0x1C, 0x001C_0001), (0x00, 0)]);
    program.wait(CAN1 + 0x04, 0, false);
    // TDT0R, TDL0R, TDH0R, TI0R.
    let frame = [(0x184, 8), (0x188, 0x3322_1100), (0x18C, 0x7766_5544)];
    program.write_all(CAN1, &frame);
    program.write(CAN1 + 0x180, 0x123 << 21 | 1);
    program.sleep();
    program
}

/// Core, buses and CAN run at 16 MHz.
fn stm32g431() -> Program {
    const RCC: u32 = 0x4002_1000;
    const GPIOA: u32 = 0x4800_0000;
    const DMA1: u32 = 0x4002_0000;
    const DMAMUX: u32 = 0x4002_0800;
    const USART2: u32 = 0x4000_4400;
    const TIM2: u32 = 0x4000_0000;
    const FDCAN1: u32 = 0x4000_6400;
    /// The first transmit buffer in the message RAM.
    const BUFFER: u32 = 0x4000_A400 + 0x278;
    let mut program = Program::new();
    // DMA1_CH1 and DMA1_CH2: ISR, IFCR.
    for channel in [11, 12] {
        program.handler(channel, |program| program.clear_flags(DMA1, DMA1 + 0x04));
    }
    // FDCAN1_IT0: TC of IR.
    program.handler(21, |program| program.write(FDCAN1 + 0x50, 1 << 7));
    program.handler(28, |program| program.compare_again(TIM2));
    // USART2: ISR, IDLECF of ICR.
    program.handler(38, |program| {
        program.read(USART2 + 0x1C);
        program.write(USART2 + 0x20, 1 << 4);
    });

    program.start();
    // ACR of the flash: 4 wait states, prefetch, caches.
    program.write(0x4002_2000, 0x0004_0704);
    // AHB1ENR, AHB2ENR, APB1ENR1, CCIPR: FDCAN has PCLK1.
    let clocks = [
        (0x48, 1 << 2 | 1),
        (0x4C, 1),
        (0x58, 1 << 25 | 1 << 17 | 1),
        (0x88, 2 << 24),
    ];
    program.write_all(RCC, &clocks);
    for interrupt in [11, 12, 21, 28, 38] {
        program.enable(interrupt);
    }
    // CCR1, DIER: CC1IE, CR1: CEN.
    program.write_all(TIM2, &[(0x34, 200), (0x0C, 2), (0x00, 1)]);
    // BRR: 1 Mbaud, CR3: DMAT and DMAR, CR1: IDLEIE, TE, RE, UE.
    program.write_all(USART2, &[(0x0C, 0x10), (0x08, 0xC0), (0x00, 0x1D)]);
    // PA2 and PA3 are USART2's: AFRL, MODER.
    program.write_all(GPIOA, &[(0x20, 0x7700), (0x00, 0xABFF_FFAF)]);
    // The requests of USART2.
    program.write_all(DMAMUX, &[(0x00, 26), (0x04, 27)]);
    // Channel 1, from the UART in a ring, and channel 2, to the UART: CPARx, CMARx, CNDTRx, CCRx.
    for (channel, register, memory, count, control) in [(0, 0x24, RECEIVED, RING, 0xA7), (1, 0x28, FLASH, SENT, 0x93)] {
        let registers = [
            (0x10, USART2 + register),
            (0x14, memory),
            (0x0C, count),
            (0x08, control),
        ];
        program.write_all(DMA1 + 0x14 * channel, &registers);
    }
    // CCCR: INIT, then CCE; NBTP: 500 kbit/s; TXBTIE, IE: TC; ILE; and back.
    program.write(FDCAN1 + 0x18, 1);
    program.wait(FDCAN1 + 0x18, 0, true);
    program.write_all(
        FDCAN1,
        &[(0x18, 3), (0x1C, 0x0001_0C01), (0xDC, 1), (0x54, 1 << 7), (0x5C, 1)],
    );
    program.write(FDCAN1 + 0x18, 0);
    program.wait(FDCAN1 + 0x18, 0, false);
    let frame = [
        (0x00, 0x123 << 18),
        (0x04, 8 << 16),
        (0x08, 0x3322_1100),
        (0x0C, 0x7766_5544),
    ];
    program.write_all(BUFFER, &frame);
    // TXBAR.
    program.write(FDCAN1 + 0xCC, 1);
    program.sleep();
    program
}

fn hex(hash: u64) -> String {
    format!("{hash:#018X}")
}

/// The hash of a run of 2 ms: [`VirtualBoard::trace_hash`], 64-bit FNV-1a of [`Trace`]. With `exact_cycles`,
/// instructions take a Cortex-M4's cycles with the flash's wait states; without, one each.
fn hash(chip: Chip, program: Program, exact_cycles: bool) -> u64 {
    let config = Config {
        chip: Some(chip),
        exact_cycles,
        ..Config::new("test", Echo::default())
    };
    let mut board = VirtualBoard::start_image(program.image(), config).unwrap();
    board.can().attach(500_000);
    board.run_for(Nanos::from_millis(2)).unwrap();
    board.check().unwrap();
    // All events did occur.
    let bytes = board.uart().bytes();
    let to_arm = bytes.iter().filter(|byte| byte.direction == Direction::ToArm).count();
    assert_eq!((to_arm, bytes.len()), (SENT as usize, 2 * SENT as usize));
    assert_ne!(board.read_word(RECEIVED.into()).unwrap(), 0);
    // Some 130 interrupts of the timer.
    assert!(board.instructions() > 1_500, "{}", board.instructions());
    let frames = board.can().frames();
    assert!(matches!(
        frames[..],
        [BusFrame {
            sender: Sender::Board,
            outcome: Outcome::Sent,
            ..
        }]
    ));
    board.trace_hash()
}

#[test]
fn stm32f405_trace_matches_the_reference() {
    let hashes = [false, true].map(|exact| hash(Chip::Stm32f405, stm32f405(), exact));
    assert_eq!(hashes.map(hex), ["0x978D3AB084B78421", "0x93899499C0BCADDD"]);
}

#[test]
fn stm32g431_trace_matches_the_reference() {
    let hashes = [false, true].map(|exact| hash(Chip::Stm32g431, stm32g431(), exact));
    assert_eq!(hashes.map(hex), ["0xDA93BB7229EF23E8", "0xA4215481DA0D61CA"]);
}
