//! The arm's UART: in by circular DMA, out by DMA.
//!
//! The HAL's ring-buffered receiver is not used. It reads the data register each time it is asked for bytes, which on
//! older UARTs takes a byte from the DMA when one arrives in that moment; it reports one error where the status register
//! has several; and after an error it enables the DMA stream again without setting it up, so its count of the ring no
//! longer holds. Here the interrupt handler alone touches the data register, only when a flag needs clearing, and each
//! start of the receive path sets up the stream from nothing, so that it does not matter whether a stream that is enabled
//! again starts over or carries on. The registers themselves are the board's, in [`usart`](crate::board::usart).

use core::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, AtomicUsize, Ordering};

use armwire::Micros;
use armwire_bridge::{LineCoding, Parity, StopBits, UartErrors, Wake};
use embassy_futures::select::select;
use embassy_futures::yield_now;
use embassy_stm32::dma::{Channel, Transfer, TransferOptions};
use embassy_stm32::interrupt::typelevel::Handler;
use embassy_stm32::mode::Blocking;
use embassy_stm32::usart::{self as hal, Uart};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::{Instant, Timer};

use crate::adapter::{Adapter, now};
use crate::board::{RX_REQUEST, RxInterrupt, TX_REQUEST, UartInterrupt, usart};

/// Bytes the receive ring holds. Half of them may wait to be taken: 2.5 ms at 2 Mbaud.
const SIZE: usize = 1024;

/// The receive ring, which the DMA writes.
static RING: [AtomicU8; SIZE] = [const { AtomicU8::new(0) }; SIZE];
/// Where in the ring the next byte to take lies.
static HEAD: AtomicUsize = AtomicUsize::new(0);
/// What the interrupt handler has to say.
static EVENT: Signal<CriticalSectionRawMutex, ()> = Signal::new();
/// Where in the ring the line went idle, [`NOWHERE`] if it did not.
static IDLE: AtomicUsize = AtomicUsize::new(NOWHERE);
const NOWHERE: usize = SIZE;
/// The receive path must be started anew.
static RESTART: AtomicBool = AtomicBool::new(false);
static FRAMING: AtomicU32 = AtomicU32::new(0);
static PARITY: AtomicU32 = AtomicU32::new(0);
static NOISE: AtomicU32 = AtomicU32::new(0);
static OVERRUN: AtomicU32 = AtomicU32::new(0);
static RING_OVERRUN: AtomicBool = AtomicBool::new(false);

/// Notes idle lines and errors, and that a byte has come where that was asked for.
pub(crate) struct InterruptHandler;

impl Handler<UartInterrupt> for InterruptHandler {
    unsafe fn on_interrupt() {
        let status = usart::take_status();
        if status.is_error() {
            for (flag, counter) in [
                (status.framing, &FRAMING),
                (status.parity, &PARITY),
                (status.noise, &NOISE),
                (status.overrun, &OVERRUN),
            ] {
                counter.fetch_add(flag.into(), Ordering::Relaxed);
            }
            // Errors that wait for the DMA to fetch a byte would bring the handler here again and again until then.
            // Whoever restarts the receive path asks for errors again.
            usart::mute_errors();
            RESTART.store(true, Ordering::Relaxed);
        }
        if status.idle {
            IDLE.store(tail(), Ordering::Relaxed);
        }
        usart::set_byte_interrupt(false);
        EVENT.signal(());
    }
}

/// Checks, each time the DMA enters a half of the ring, that what was in it had been taken.
pub(crate) struct RingHandler;

impl Handler<RxInterrupt> for RingHandler {
    unsafe fn on_interrupt() {
        // Asked twice per turn, this cannot miss that the DMA went past the head.
        let untaken = (tail() + SIZE - HEAD.load(Ordering::Relaxed)) % SIZE;
        if untaken > SIZE / 2 - MARGIN {
            RING_OVERRUN.store(true, Ordering::Relaxed);
        }
        EVENT.signal(());
    }
}

/// Bytes that may arrive before the handler runs.
const MARGIN: usize = 16;

/// Where in the ring the DMA writes next.
fn tail() -> usize {
    (SIZE - usart::rx_remaining()) % SIZE
}

/// Looks at the UART even though nothing happened, so that whoever asks sees the task is alive.
pub(crate) fn wake() {
    EVENT.signal(());
}

/// Passes what the arm says to the bridge.
#[embassy_executor::task]
pub(crate) async fn receive(adapter: &'static Adapter, mut dma: Channel<'static>) {
    let mut receiver = Receiver {
        adapter,
        chunk: [0; 64],
    };
    loop {
        let transfer = receiver.start(&mut dma);
        receiver.serve().await;
        receiver.stop(transfer);
    }
}

/// The way of bytes from the ring to the bridge.
struct Receiver {
    adapter: &'static Adapter,
    chunk: [u8; 64],
}

impl Receiver {
    /// Sets up the DMA stream and lets the UART feed it.
    ///
    /// Since [`stop`](Self::stop) the UART itself holds a byte, which is lost only when the one after it is in, too.
    fn start<'a>(&self, dma: &'a mut Channel<'static>) -> Transfer<'a> {
        HEAD.store(0, Ordering::Relaxed);
        if IDLE.swap(NOWHERE, Ordering::Relaxed) != NOWHERE {
            self.adapter.with(|bridge| bridge.uart_idle(now()));
        }
        let ring = core::ptr::slice_from_raw_parts_mut(RING.as_ptr().cast::<u8>().cast_mut(), SIZE);
        let mut options = TransferOptions::default();
        options.circular = true;
        options.half_transfer_ir = true;
        // SAFETY: the source is the UART's data register, whose stream this is; the target is made of atomics, for good.
        let transfer = unsafe { dma.read_raw(RX_REQUEST, usart::rx_data(), ring, options) };
        usart::start_receiving();
        transfer
    }

    /// Takes bytes as the bridge asks for them, until the receive path must be started anew.
    async fn serve(&mut self) {
        // On a line that brings nothing but errors, the other tasks get their turn here.
        yield_now().await;
        while !RESTART.swap(false, Ordering::Relaxed) {
            self.look();
            match self.adapter.with(|bridge| bridge.wake()) {
                Wake::Byte => {
                    usart::set_byte_interrupt(true);
                    // A byte that came before that gives no signal.
                    if tail() == HEAD.load(Ordering::Relaxed) {
                        EVENT.wait().await;
                    }
                }
                Wake::At(time) => {
                    select(EVENT.wait(), Timer::at(Instant::from_micros(time.0))).await;
                }
            }
        }
    }

    /// Takes what has arrived, stops the stream and takes the rest.
    fn stop(&mut self, mut transfer: Transfer<'_>) {
        let errors = UartErrors {
            framing: FRAMING.swap(0, Ordering::Relaxed),
            parity: PARITY.swap(0, Ordering::Relaxed),
            noise: NOISE.swap(0, Ordering::Relaxed),
            overrun: OVERRUN.swap(0, Ordering::Relaxed),
        };
        self.adapter.with(|bridge| bridge.uart_errors(errors));
        self.look();
        // The interrupt handler leaves a byte in the data register to the DMA, which will not come for it now.
        usart::stop_receiving();
        transfer.request_pause();
        while transfer.is_running() {}
        self.look();
    }

    /// Passes what has arrived to the bridge.
    fn look(&mut self) {
        if RING_OVERRUN.swap(false, Ordering::Relaxed) {
            // What the ring holds is of two turns: none of it can be told apart.
            HEAD.store(tail(), Ordering::Relaxed);
            IDLE.store(NOWHERE, Ordering::Relaxed);
            self.adapter.with(|bridge| bridge.uart_ring_overrun());
        }
        let now = now();
        // At once, or the line could go idle in between, short of the tail.
        let (idle, tail) = critical_section::with(|_| (IDLE.swap(NOWHERE, Ordering::Relaxed), tail()));
        if idle != NOWHERE {
            // What came after the idle line belongs to the next frame.
            self.take(idle, now);
            self.adapter.with(|bridge| bridge.uart_idle(now));
        }
        self.take(tail, now);
        if self.adapter.with(|bridge| bridge.usb_due()) {
            self.adapter.packet.signal(());
        }
    }

    /// Takes the bytes in the ring up to `end`.
    fn take(&mut self, end: usize, now: Micros) {
        let mut head = HEAD.load(Ordering::Relaxed);
        loop {
            let mut n = 0;
            for byte in &mut self.chunk {
                if head == end {
                    break;
                }
                *byte = RING[head].load(Ordering::Relaxed);
                head = (head + 1) % SIZE;
                n += 1;
            }
            HEAD.store(head, Ordering::Relaxed);
            self.adapter.with(|bridge| bridge.uart_received(&self.chunk[..n], now));
            if head == end {
                break;
            }
        }
    }
}

/// Sends what the bridge has for the arm, and changes the line coding between two bytes.
#[embassy_executor::task]
pub(crate) async fn transmit(adapter: &'static Adapter, mut uart: Uart<'static, Blocking>, mut dma: Channel<'static>) {
    usart::start_transmitting();
    let mut current = LineCoding::LING;
    let mut chunk = [0; 64];
    loop {
        if let Some(burst) = adapter.with(|bridge| bridge.uart_transmit(&mut chunk, now())) {
            adapter.room.signal(());
            send(&mut dma, &chunk[..burst.len]).await;
        } else if let Some(line) = adapter.with(|bridge| bridge.line_change()) {
            change(&mut uart, current, line.coding).await;
            current = line.coding;
            adapter.with(|bridge| bridge.line_changed(line));
            adapter.room.signal(());
            RESTART.store(true, Ordering::Relaxed);
            wake();
        } else {
            adapter.bytes.wait().await;
        }
    }
}

/// Hands `bytes` to the UART. Returns when the last one waits behind the one on the line.
async fn send(dma: &mut Channel<'static>, bytes: &[u8]) {
    // To tell when these bytes are out, not the ones before.
    usart::clear_transmitted();
    // SAFETY: the address is that of the UART's data register, and the stream is the one wired to it.
    unsafe { dma.write(TX_REQUEST, bytes, usart::tx_data(), Default::default()) }.await;
}

/// Waits for the last bit to leave at the current line coding, and changes it.
async fn change(uart: &mut Uart<'static, Blocking>, current: LineCoding, coding: LineCoding) {
    while !usart::is_transmitted() {
        Timer::after_micros(10).await;
    }
    // That may be true of the byte before the last transfer, if it ended between the clearing and the first byte. Then two
    // bytes are left: one in the shift register, one behind it.
    Timer::after_micros(current.micros(2)).await;
    let mut config = hal::Config::default();
    config.baudrate = coding.baud;
    config.parity = match coding.parity {
        Parity::None => hal::Parity::ParityNone,
        Parity::Odd => hal::Parity::ParityOdd,
        Parity::Even => hal::Parity::ParityEven,
    };
    config.stop_bits = match coding.stop_bits {
        StopBits::One => hal::StopBits::STOP1,
        StopBits::Two => hal::StopBits::STOP2,
    };
    let (uart, _) = uart.split_ref();
    // The bridge lets through only what this UART can do.
    if uart.set_config(&config).is_err() {
        unreachable!()
    }
}
