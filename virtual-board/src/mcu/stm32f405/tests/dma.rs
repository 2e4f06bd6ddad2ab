//! DMA1 and USART2: rings, flags, stops (RM0090, 10.3.6 to 10.3.18, 10.5).

use super::*;

const HISR: u32 = 0x4002_6004;
const HIFCR: u32 = 0x4002_600C;
/// Stream 6, which serves USART2's transmitter on channel 4.
const SENDER_CR: u32 = 0x4002_60A0;
const SENDER_NDTR: u32 = 0x4002_60A4;
const SENDER_PAR: u32 = 0x4002_60A8;
const SENDER_M0AR: u32 = 0x4002_60AC;

/// Flags of stream 5 in HISR; those of stream 6 are ten bits up.
const TE: u32 = 1 << 9;
const HT: u32 = 1 << 10;
const TC: u32 = 1 << 11;
const ALL: u32 = 0x3D << 6;
const SENDER: u32 = 10;

/// Enables of SxCR.
const TEIE: u32 = 1 << 2;
const HTIE: u32 = 1 << 3;
const TCIE: u32 = 1 << 4;

/// Channel 4, memory to peripheral, memory pointer counting up.
const SEND: u32 = 4 << 25 | 1 << 10 | 1 << 6;

const NUMBERS: [u8; 32] = {
    let mut numbers = [0; 32];
    let mut nth = 0;
    while nth < 32 {
        numbers[nth] = nth as u8 + 1;
        nth += 1;
    }
    numbers
};

impl Bench {
    /// Runs until `count` more bytes have arrived.
    fn receive(&mut self, count: u32) {
        self.run_until(self.now + Nanos(10_000 * u64::from(count)));
    }
}

#[test]
fn ring_flags_half_and_end_then_restarts() {
    let mut bench = Bench::new(Reenabled::Restarts);
    bench.arm_sends(&NUMBERS[..20]);
    let mut seen = Vec::new();
    for nth in 1..=20 {
        bench.receive(1);
        seen.push((nth, bench.read(HISR) & ALL, bench.read(STREAM_NDTR)));
    }
    let at = |nth: usize| seen[nth - 1];
    assert_eq!(at(1), (1, 0, 15));
    assert_eq!(at(7), (7, 0, 9));
    assert_eq!(at(8), (8, HT, 8));
    assert_eq!(at(15), (15, HT, 1));
    assert_eq!(at(16), (16, HT | TC, 16));
    assert_eq!(at(20), (20, HT | TC, 12));
    let mut ring = NUMBERS[..16].to_vec();
    ring[..4].copy_from_slice(&NUMBERS[16..20]);
    assert_eq!(bench.ring(16), ring);
    assert_eq!(bench.byte(RING + RING_SIZE), UNTOUCHED, "nothing behind the ring");
    assert_eq!(bench.read(STREAM_CR) & EN, EN);
}

#[test]
fn half_and_end_come_again_in_every_round() {
    let mut bench = Bench::new(Reenabled::Restarts);
    bench.arm_sends(&NUMBERS);
    for flags in [HT, TC, HT, TC] {
        bench.receive(8);
        assert_eq!(bench.read(HISR) & ALL, flags);
        bench.write(HIFCR, flags);
        assert_eq!(bench.read(HISR) & ALL, 0);
    }
}

#[test]
fn flags_clear_separately_and_interrupt_if_enabled() {
    for (enable, first) in [(0, 0), (HTIE, 8), (TCIE, 16)] {
        let mut bench = Bench::new(Reenabled::Restarts);
        bench.write(STREAM_CR, RECEIVE);
        bench.write(HIFCR, ALL);
        bench.write(STREAM_CR, RECEIVE | enable | EN);
        bench.drain_interrupts();
        bench.arm_sends(&NUMBERS[..16]);
        let rose = (1..=16).find(|_| {
            bench.receive(1);
            bench.drain_interrupts().iter().any(|&high| high)
        });
        assert_eq!(rose.unwrap_or(0), first);
        bench.receive(16);
        assert_eq!(bench.read(HISR) & ALL, HT | TC);
        bench.write(HIFCR, HT);
        assert_eq!(bench.read(HISR) & ALL, TC);
    }
}

#[test]
fn transfer_without_ring_stops_and_rest_overruns() {
    let mut bench = Bench::new(Reenabled::Restarts);
    bench.write(STREAM_CR, RECEIVE & !(1 << 8));
    bench.write(HIFCR, ALL);
    bench.write(STREAM_NDTR, 4);
    bench.write(STREAM_CR, RECEIVE & !(1 << 8) | EN);
    bench.arm_sends(&NUMBERS[..6]);
    bench.receive(4);
    assert_eq!(bench.read(HISR) & ALL, HT | TC);
    assert_eq!((bench.read(STREAM_CR) & EN, bench.read(STREAM_NDTR)), (0, 0));
    assert_eq!(bench.read(USART_SR) & (RXNE | ORE), 0);
    bench.receive(2);
    assert_eq!(bench.ring(5), [1, 2, 3, 4, 0xEE]);
    assert_eq!(bench.read(USART_SR) & (RXNE | ORE), RXNE | ORE);
}

#[test]
fn stream_disabled_midway_keeps_count_and_bytes() {
    let mut bench = Bench::new(Reenabled::Restarts);
    bench.arm_sends(&NUMBERS[..5]);
    bench.receive(5);
    assert_eq!(bench.read(HISR) & ALL, 0);
    bench.write(STREAM_CR, RECEIVE);
    assert_eq!(bench.read(HISR) & ALL, TC, "10.3.14");
    assert_eq!((bench.read(STREAM_CR) & EN, bench.read(STREAM_NDTR)), (0, 11));
    assert_eq!(bench.ring(6), [1, 2, 3, 4, 5, 0xEE]);
}

#[test]
fn running_stream_count_and_addresses_are_write_protected() {
    let mut bench = Bench::new(Reenabled::Restarts);
    for (register, value) in [(STREAM_NDTR, 3), (STREAM_PAR, 0x2000_0100), (STREAM_M0AR, 0x2000_0200)] {
        let before = bench.read(register);
        bench.write(register, value);
        assert_eq!(bench.read(register), before, "{register:#x}");
    }
    bench.arm_sends(&[7]);
    bench.receive(1);
    assert_eq!(bench.ring(1), [7]);
}

#[test]
fn memory_reaches_arm_in_order_before_wire_ends() {
    let mut bench = Bench::new(Reenabled::Restarts);
    bench.run_until(Nanos(50_000));
    for (address, byte) in (0x2000_0100..).zip(NUMBERS) {
        bench.memory.write(address, Width::Byte, byte.into()).unwrap();
    }
    for (register, value) in [
        (USART_CR3, 1 << 7 | 1 << 6),
        (USART_SR, !(1 << 6)),
        (SENDER_PAR, USART_DR),
        (SENDER_M0AR, 0x2000_0100),
        (SENDER_NDTR, 6),
        (SENDER_CR, SEND | EN),
    ] {
        bench.write(register, value);
    }
    // One byte is on the wire, one waits in the UART.
    assert_eq!(bench.read(SENDER_NDTR), 4);
    assert_eq!(bench.read(HISR) & ALL << SENDER, 0);
    bench.receive(1);
    assert_eq!(bench.read(HISR) & ALL << SENDER, HT << SENDER);
    bench.receive(3);
    assert_eq!(bench.read(HISR) & ALL << SENDER, (HT | TC) << SENDER);
    assert_eq!(bench.read(SENDER_CR) & EN, 0);
    assert_eq!(bench.read(USART_SR) & 1 << 6, 0, "the wire is busy still");
    bench.receive(2);
    assert_eq!(bench.read(USART_SR) & 1 << 6, 1 << 6);
    let received: Vec<u8> = lock(&bench.line)
        .arm_mut()
        .received
        .iter()
        .map(|&(_, byte)| byte)
        .collect();
    assert_eq!(received, NUMBERS[..6]);
    assert_eq!(bench.read(HISR) & ALL, 0, "the other stream's flags are its own");
}

#[test]
fn stream_listens_to_its_channel_alone() {
    let mut bench = Bench::new(Reenabled::Restarts);
    bench.write(STREAM_CR, RECEIVE);
    let other = RECEIVE & !(7 << 25) | 3 << 25;
    bench.write(STREAM_CR, other | EN);
    bench.arm_sends(&[1]);
    bench.receive(2);
    assert_eq!((bench.ring(1), bench.read(STREAM_NDTR)), (vec![0xEE], RING_SIZE));
}

#[test]
fn unreachable_memory_is_transfer_error_stopping_the_stream() {
    for enable in [0, TEIE] {
        let mut bench = Bench::new(Reenabled::Restarts);
        bench.write(STREAM_CR, RECEIVE);
        bench.write(HIFCR, ALL);
        bench.write(STREAM_M0AR, CCM);
        bench.write(STREAM_CR, RECEIVE | enable | EN);
        bench.drain_interrupts();
        bench.arm_sends(&[1]);
        bench.receive(1);
        assert_eq!(bench.read(HISR) & ALL, TE);
        assert_eq!(bench.read(STREAM_CR) & EN, 0);
        let rose = bench.drain_interrupts().iter().any(|&high| high);
        assert_eq!(rose, enable != 0);
    }
}
