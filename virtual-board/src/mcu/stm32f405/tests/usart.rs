//! USART2 without its DMA: its flags and their clearing (RM0090, 30.3.2 to 30.3.4, 30.6.1).

use super::*;

const IDLE: u32 = 1 << 4;
const TC: u32 = 1 << 6;
const TXE: u32 = 1 << 7;

/// Bits of CR1.
const RE: u32 = 1 << 2;
const TE: u32 = 1 << 3;
const IDLEIE: u32 = 1 << 4;
const RXNEIE: u32 = 1 << 5;
const TCIE: u32 = 1 << 6;
const TXEIE: u32 = 1 << 7;
const UE: u32 = 1 << 13;
const OVER8: u32 = 1 << 15;

const ON: u32 = UE | TE | RE;

/// USART2 at 1 Mbaud, after the initial idle frame of its transmitter, without DMA, with these interrupts.
fn port(interrupts: u32) -> Bench {
    let mut bench = Bench::new(Reenabled::Restarts);
    bench.write(USART_CR3, 0);
    bench.run_until(Nanos(50_000));
    bench.write(USART_CR1, ON | interrupts);
    bench.drain_interrupts();
    bench
}

impl Bench {
    /// The flags `of` in SR, without side effects.
    fn flags(&mut self, of: u32) -> u32 {
        self.part.peripherals.uart.peek(USART_SR & 0x3FF, self.now).unwrap() & of
    }

    /// The new level of the interrupt line since the last call, if it changed.
    fn interrupted(&mut self) -> Option<bool> {
        self.drain_interrupts().pop()
    }
}

#[test]
fn idle_is_flagged_once_per_burst() {
    let mut bench = port(IDLEIE);
    bench.run_until(Nanos(100_000));
    assert_eq!(bench.flags(IDLE), 0, "nothing has come yet");
    bench.arm_sends(&[1, 2]);
    bench.run_until(Nanos(129_999));
    assert_eq!(
        (bench.flags(IDLE), bench.interrupted()),
        (0, None),
        "no gap between the two"
    );
    bench.run_until(Nanos(130_000));
    assert_eq!((bench.flags(IDLE), bench.interrupted()), (IDLE, Some(true)));
    bench.read(USART_SR);
    assert_eq!(bench.flags(IDLE), IDLE, "reading SR alone clears nothing");
    bench.read(USART_DR);
    assert_eq!((bench.flags(IDLE), bench.interrupted()), (0, Some(false)));
    bench.run_until(Nanos(500_000));
    assert_eq!(bench.flags(IDLE), 0, "the line is idle still");
    bench.arm_sends(&[3]);
    bench.run_until(Nanos(520_000));
    assert_eq!(bench.flags(IDLE), IDLE);
}

#[test]
fn byte_within_idle_frame_postpones_idle() {
    let mut bench = port(0);
    bench.arm_sends(&[1]);
    bench.run_until(Nanos(65_000));
    assert_eq!(bench.flags(IDLE | RXNE), RXNE);
    bench.arm_sends(&[2]);
    bench.run_until(Nanos(84_999));
    assert_eq!(bench.flags(IDLE), 0);
    bench.run_until(Nanos(85_000));
    assert_eq!(bench.flags(IDLE), IDLE);
}

#[test]
fn rxne_interrupts_until_the_byte_is_read() {
    let mut bench = port(RXNEIE);
    bench.arm_sends(&[0x42]);
    bench.run_until(Nanos(60_000));
    assert_eq!((bench.flags(RXNE), bench.interrupted()), (RXNE, Some(true)));
    assert_eq!(bench.read(USART_DR), 0x42);
    assert_eq!((bench.flags(RXNE), bench.interrupted()), (0, Some(false)));
}

#[test]
fn overrun_keeps_first_byte_until_sr_dr_clear() {
    let mut bench = port(RXNEIE);
    bench.arm_sends(&[1, 2]);
    bench.run_until(Nanos(69_999));
    assert_eq!(bench.flags(ORE | RXNE), RXNE);
    bench.run_until(Nanos(70_000));
    assert_eq!(bench.flags(ORE | RXNE), ORE | RXNE);
    bench.interrupted();
    assert_eq!(bench.read(USART_DR), 1);
    assert_eq!(bench.flags(ORE | RXNE), ORE, "DR alone does not clear it");
    assert_eq!(bench.interrupted(), None, "it interrupts with RXNEIE");
    bench.read(USART_SR);
    assert_eq!(bench.flags(ORE), ORE, "nor does SR alone");
    bench.read(USART_DR);
    assert_eq!((bench.flags(ORE | RXNE), bench.interrupted()), (0, Some(false)));
    bench.arm_sends(&[3]);
    bench.run_until(Nanos(100_000));
    assert_eq!((bench.flags(ORE | RXNE), bench.read(USART_DR)), (RXNE, 3));
}

#[test]
fn error_after_sr_read_survives_dr_read() {
    let mut bench = port(0);
    bench.arm_sends(&[1]);
    bench.run_until(Nanos(60_000));
    bench.read(USART_SR);
    bench.arm_sends(&[2]);
    bench.run_until(Nanos(80_000));
    assert_eq!(bench.read(USART_DR), 1);
    assert_eq!(bench.flags(ORE), ORE);
}

#[test]
fn framing_and_noise_clear_by_sr_then_dr() {
    for (fault, flag) in [(Fault::Framing, FE), (Fault::Noise, NF), (Fault::Break, FE)] {
        let mut bench = port(0);
        lock(&bench.line).plan_fault(0, fault);
        bench.arm_sends(&[0x42]);
        bench.run_until(Nanos(60_000));
        bench.read(USART_SR);
        assert_eq!(bench.flags(FE | NF), flag, "{fault:?}");
        bench.read(USART_DR);
        assert_eq!(bench.flags(FE | NF | RXNE), 0, "{fault:?}");
    }
}

#[test]
fn line_error_interrupts_by_eie_only_with_dma() {
    for (control, interrupts) in [(1, false), (1 | 1 << 6, true)] {
        let mut bench = port(0);
        bench.write(USART_CR3, control);
        lock(&bench.line).plan_fault(0, Fault::Noise);
        bench.arm_sends(&[0x42]);
        // This comes before the DMA's read of DR, which would complete the sequence if SR had been read.
        bench.run_until(Nanos(70_000));
        assert_eq!(bench.interrupted(), interrupts.then_some(true));
        assert_eq!(bench.flags(NF), NF);
    }
}

#[test]
fn txe_allows_next_byte_tc_follows_last() {
    let mut bench = port(0);
    assert_eq!(bench.flags(TXE | TC), TXE | TC);
    bench.read(USART_SR);
    bench.write(USART_DR, 1);
    assert_eq!(bench.flags(TXE | TC), TXE, "it is in the shift register at once");
    bench.write(USART_DR, 2);
    assert_eq!(bench.flags(TXE | TC), 0);
    bench.run_until(Nanos(59_999));
    assert_eq!(bench.flags(TXE | TC), 0);
    bench.run_until(Nanos(60_000));
    assert_eq!(bench.flags(TXE | TC), TXE);
    bench.run_until(Nanos(69_999));
    assert_eq!(bench.flags(TXE | TC), TXE);
    bench.run_until(Nanos(70_000));
    assert_eq!(bench.flags(TXE | TC), TXE | TC);
    let received = lock(&bench.line).arm_mut().received.clone();
    assert_eq!(received, [(Instant::from_micros(60), 1), (Instant::from_micros(70), 2)]);
}

#[test]
fn written_zero_clears_tc_but_not_txe() {
    let mut bench = port(0);
    bench.write(USART_SR, !(TC | TXE));
    assert_eq!(bench.flags(TXE | TC), TXE);
    bench.write(USART_DR, 1);
    bench.run_until(Nanos(60_000));
    assert_eq!(bench.flags(TXE | TC), TXE | TC);
    bench.write(USART_SR, !TXE);
    assert_eq!(bench.flags(TXE | TC), TXE | TC, "a written one clears nothing");
}

#[test]
fn transmit_interrupts_follow_their_flags() {
    for (enable, at) in [(TXEIE, 60_000), (TCIE, 70_000)] {
        let mut bench = port(0);
        bench.read(USART_SR);
        bench.write(USART_DR, 1);
        bench.write(USART_DR, 2);
        bench.write(USART_CR1, ON | enable);
        bench.run_until(Nanos(at - 1));
        assert_eq!(bench.interrupted(), None);
        bench.run_until(Nanos(at));
        assert_eq!(bench.interrupted(), Some(true));
    }
}

#[test]
fn rate_follows_brr_and_oversampling() {
    // 30.3.4: from 16 MHz, as mantissa and fraction in sixteenths or eighths.
    for (over8, divisor, baud) in [
        (0, 0x10, 1_000_000),
        (0, 0x8B, 115_108),
        (0, 1 << 4 | 4, 800_000),
        (OVER8, 2 << 4, 1_000_000),
        (OVER8, 1 << 4, 2_000_000),
        (OVER8, 0x11 << 4 | 3, 115_108),
    ] {
        let mut bench = port(over8);
        bench.write(USART_BRR, divisor);
        let set = lock(&bench.line).board_baud().unwrap();
        assert_eq!(set, baud, "{divisor:#x}");
        lock(&bench.line).set_arm_baud(baud as u32);
        let start = bench.now;
        bench.write(USART_DR, 0x55);
        bench.run_until(Nanos(500_000));
        let sent = lock(&bench.line).bytes()[0];
        let lasted = sent.at.since(start).0;
        let ten_bits = 10_000_000_000 / baud;
        assert!(lasted.abs_diff(ten_bits) <= 2, "{lasted} ns at {baud} baud");
        assert_eq!(sent.outcome, Outcome::Arrived);
    }
}

#[test]
fn dr_takes_a_byte_from_the_dma() {
    // The byte ends at 20 us; its DMA transfer takes at least 25 ns from there.
    let read_data_at = |at| {
        let mut bench = Bench::new(Reenabled::Restarts);
        bench.part.peripherals.dma.set_delays(DELAYS);
        bench.run_until(Nanos(10_000));
        bench.arm_sends(&[0x31]);
        bench.run_until(Nanos(19_990));
        assert_eq!(bench.read(USART_SR) & RXNE, 0, "the byte has not ended");
        bench.run_until(Nanos(at));
        bench.read(USART_DR);
        bench.run_until(Nanos(30_000));
        let taken = lock(&bench.line).taken();
        (taken, bench.byte(RING), bench.read(STREAM_NDTR))
    };
    assert_eq!(read_data_at(19_995), (0, 0x31, RING_SIZE - 1));
    assert_eq!(read_data_at(20_010), (1, UNTOUCHED, RING_SIZE));
    assert_eq!(read_data_at(21_000), (0, 0x31, RING_SIZE - 1));
}
