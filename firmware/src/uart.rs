//! The arm's UART: circular DMA in, DMA out, one interrupt.
//!
//! The HAL's ring-buffered receiver is not used. It reads the data register each time it is asked for bytes, which on
//! this UART takes a byte from the DMA when one arrives in that moment; it reports one error where the status register
//! has several; and after an error it enables the DMA stream again without setting it up, so its count of the ring no
//! longer holds. Here the interrupt handler alone touches the data register, only when a flag needs clearing, and each
//! start of the receive path sets up the stream from nothing.

use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use armwire::Micros;
use armwire_bridge::{LineCoding, Parity, StopBits, UartErrors, Wake};
use embassy_futures::select::select;
use embassy_stm32::dma::{Channel, ReadableRingBuffer};
use embassy_stm32::interrupt::typelevel::Handler;
use embassy_stm32::mode::Blocking;
use embassy_stm32::usart::{self, Uart};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::{Instant, Timer};

use crate::adapter::{Adapter, now};
use crate::board::{RX_REQUEST, RX_STREAM, TX_REQUEST, UART, UartInterrupt};

/// The receive ring: 5 ms at 2 Mbaud.
pub(crate) const RING: usize = 1024;

/// What the interrupt handler has to say.
static EVENT: Signal<CriticalSectionRawMutex, ()> = Signal::new();
/// Where the DMA stood when the line went idle: the stream's NDTR plus one, 0 for no idle line.
static IDLE: AtomicU32 = AtomicU32::new(0);
/// The receive path must be started anew.
static RESTART: AtomicBool = AtomicBool::new(false);
static FRAMING: AtomicU32 = AtomicU32::new(0);
static PARITY: AtomicU32 = AtomicU32::new(0);
static NOISE: AtomicU32 = AtomicU32::new(0);
static OVERRUN: AtomicU32 = AtomicU32::new(0);

/// Notes idle lines and errors, and that a byte has come where that was asked for.
pub(crate) struct InterruptHandler;

impl Handler<UartInterrupt> for InterruptHandler {
    unsafe fn on_interrupt() {
        let status = UART.sr().read();
        let error = status.fe() || status.pe() || status.ne() || status.ore();
        if (error || status.idle()) && !status.rxne() {
            // RM0090 30.6.1: reading SR and then DR clears the flags. With RXNE set the DMA is about to do that read,
            // and must: the byte is its.
            UART.dr().read();
        }
        if error {
            for (flag, counter) in [
                (status.fe(), &FRAMING),
                (status.pe(), &PARITY),
                (status.ne(), &NOISE),
                (status.ore(), &OVERRUN),
            ] {
                counter.fetch_add(flag.into(), Ordering::Relaxed);
            }
            RESTART.store(true, Ordering::Relaxed);
        }
        if status.idle() {
            IDLE.store(remaining() + 1, Ordering::Relaxed);
        }
        UART.cr1().modify(|w| w.set_rxneie(false));
        EVENT.signal(());
    }
}

/// Looks at the UART even though nothing happened, so that whoever asks sees the task is alive.
pub(crate) fn wake() {
    EVENT.signal(());
}

/// Passes what the arm says to the bridge.
#[embassy_executor::task]
pub(crate) async fn receive(adapter: &'static Adapter, mut dma: Channel<'static>, buffer: &'static mut [u8; RING]) {
    loop {
        let mut ring = Ring::start(&mut dma, buffer, adapter);
        ring.serve(adapter).await;
        ring.stop(adapter);
    }
}

/// The receive path, from one start to the next.
struct Ring<'a> {
    dma: ReadableRingBuffer<'a, u8>,
    /// Where the next byte to take lies.
    head: usize,
    chunk: [u8; 64],
}

impl<'a> Ring<'a> {
    /// Sets up the DMA stream and lets the UART feed it.
    ///
    /// Until it runs, the UART itself holds the next byte and the one arriving after it.
    fn start(dma: &'a mut Channel<'static>, buffer: &'a mut [u8; RING], adapter: &Adapter) -> Self {
        // SAFETY: the address is that of the UART's data register, and the stream is the one wired to it.
        let mut dma = unsafe {
            ReadableRingBuffer::new(
                dma.reborrow(),
                RX_REQUEST,
                UART.dr().as_ptr().cast(),
                buffer,
                Default::default(),
            )
        };
        if IDLE.swap(0, Ordering::Relaxed) != 0 {
            adapter.with(|bridge| bridge.uart_idle());
        }
        dma.start();
        UART.cr1().modify(|w| {
            w.set_idleie(true);
            w.set_peie(w.pce());
        });
        UART.cr3().modify(|w| {
            w.set_eie(true);
            w.set_dmar(true);
        });
        Self {
            dma,
            head: 0,
            chunk: [0; 64],
        }
    }

    /// Takes bytes as the bridge asks for them, until the receive path must be started anew.
    async fn serve(&mut self, adapter: &Adapter) {
        while !RESTART.swap(false, Ordering::Relaxed) && self.look(adapter) {
            match adapter.with(|bridge| bridge.wake()) {
                Wake::Byte => {
                    UART.cr1().modify(|w| w.set_rxneie(true));
                    // A byte that came before that gives no signal.
                    if remaining() == (RING - self.head) as u32 {
                        EVENT.wait().await;
                    }
                }
                Wake::At(time) => {
                    select(EVENT.wait(), Timer::at(Instant::from_micros(time.0))).await;
                }
            }
        }
    }

    /// Stops the stream and takes what it had received.
    fn stop(mut self, adapter: &Adapter) {
        // Stopping a stream sets its transfer complete flag. Its handler must not count that as a turn of the ring
        // before the last bytes are out.
        critical_section::with(|_| {
            self.dma.request_pause();
            while self.dma.is_running() {}
            self.look(adapter);
        });
        let errors = UartErrors {
            framing: FRAMING.swap(0, Ordering::Relaxed),
            parity: PARITY.swap(0, Ordering::Relaxed),
            noise: NOISE.swap(0, Ordering::Relaxed),
            overrun: OVERRUN.swap(0, Ordering::Relaxed),
        };
        adapter.with(|bridge| bridge.uart_errors(errors));
    }

    /// Passes what has arrived to the bridge. Returns whether all of it was still there.
    fn look(&mut self, adapter: &Adapter) -> bool {
        let now = now();
        let idle = IDLE.swap(0, Ordering::Relaxed) as usize;
        let mut intact = true;
        if idle > 0 {
            // What came after the idle line belongs to the next frame.
            let before = (2 * RING - (idle - 1) - self.head) % RING;
            intact &= self.take(before, now, adapter);
            adapter.with(|bridge| bridge.uart_idle());
        }
        intact &= self.take(usize::MAX, now, adapter);

        if adapter.with(|bridge| bridge.usb_due()) {
            adapter.packet.signal(());
        }
        intact
    }

    /// Takes up to `limit` bytes.
    fn take(&mut self, mut limit: usize, now: Micros, adapter: &Adapter) -> bool {
        while limit > 0 {
            let room = limit.min(self.chunk.len());
            let Ok((n, _)) = self.dma.read(&mut self.chunk[..room]) else {
                adapter.with(|bridge| bridge.uart_ring_overrun());
                return false;
            };
            adapter.with(|bridge| bridge.uart_received(&self.chunk[..n], now));
            self.head = (self.head + n) % RING;
            limit -= n;
            if n < room {
                break;
            }
        }
        true
    }
}

/// Bytes the DMA has left to write before it is at the start of the ring again.
fn remaining() -> u32 {
    let (dma, stream) = RX_STREAM;
    dma.st(stream).ndtr().read().0
}

/// Sends what the bridge has for the arm, and changes the line coding between two bytes.
#[embassy_executor::task]
pub(crate) async fn transmit(adapter: &'static Adapter, mut uart: Uart<'static, Blocking>, mut dma: Channel<'static>) {
    UART.cr3().modify(|w| w.set_dmat(true));
    let mut chunk = [0; 64];
    loop {
        let n = adapter.with(|bridge| bridge.uart_transmit(&mut chunk, now()));
        if n > 0 {
            adapter.room.signal(());
            send(&mut dma, &chunk[..n]).await;
        } else if let Some(coding) = adapter.with(|bridge| bridge.line_coding_change()) {
            change(&mut uart, coding).await;
            adapter.with(|bridge| bridge.line_coding_changed(coding));
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
    // TC is to tell when these bytes are out, not the ones before (RM0090 30.3.13). Writing 1 leaves other flags alone.
    UART.sr().write(|w| {
        w.0 = !0;
        w.set_tc(false);
    });
    // SAFETY: the address is that of the UART's data register, and the stream is the one wired to it.
    unsafe { dma.write(TX_REQUEST, bytes, UART.dr().as_ptr().cast::<u8>(), Default::default()) }.await;
}

/// Waits for the last bit to leave and changes the line coding.
async fn change(uart: &mut Uart<'static, Blocking>, coding: LineCoding) {
    while !UART.sr().read().tc() {
        Timer::after_micros(10).await;
    }
    let mut config = usart::Config::default();
    config.baudrate = coding.baud;
    config.parity = match coding.parity {
        Parity::None => usart::Parity::ParityNone,
        Parity::Odd => usart::Parity::ParityOdd,
        Parity::Even => usart::Parity::ParityEven,
    };
    config.stop_bits = match coding.stop_bits {
        StopBits::One => usart::StopBits::STOP1,
        StopBits::Two => usart::StopBits::STOP2,
    };
    let (uart, _) = uart.split_ref();
    // The bridge lets through only what this UART can do.
    if uart.set_config(&config).is_err() {
        unreachable!()
    }
}
