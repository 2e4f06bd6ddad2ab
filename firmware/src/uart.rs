//! The arm's UART: circular DMA for reception, DMA for transmission.
//!
//! The HAL's ring-buffered receiver is not used. Each call reads the data register, which on older UARTs takes a byte
//! from the DMA if one arrives at that moment. It reports one error if the status register has several. After an error
//! it re-enables the DMA stream without a new configuration, and its position in the ring is then wrong. Here only the
//! interrupt handler reads the data register, and only to clear a flag. Each start of the receive path configures the
//! stream completely. The registers are in the board's [`usart`](crate::board::usart).
//!
//! # Time stamps
//!
//! The bridge gives the last byte of the next frame or, once known, the number of bytes before anything can be due. The
//! interrupt handler checks each byte, or each of the last ones. It therefore sees the byte that completes the frame as
//! it arrives, and records the time. Tasks and other interrupt handlers do not delay it: it preempts all of them.

use core::cell::{Cell, RefCell};
use core::sync::atomic::{AtomicBool, AtomicU8, Ordering};

use armwire_bridge::control::MAX_FRAME;
use armwire_bridge::{
    Bridge, Duration, Instant, Parity, RxRing, StopBits, Transmit, UartConfig, UartErrors, UartEvent,
};
use critical_section::Mutex;
use embassy_futures::join::join;
use embassy_futures::select::select;
use embassy_futures::yield_now;
use embassy_stm32::dma::{Channel, Transfer, TransferOptions};
use embassy_stm32::interrupt::typelevel::Handler;
use embassy_stm32::mode::Blocking;
use embassy_stm32::usart::{self as hal, UartRx};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::Timer;

use crate::adapter::{Adapter, Work, now};
use crate::board::usart::{self, Status};
use crate::board::{RX_REQUEST, RxInterrupt, TX_REQUEST, UartInterrupt, transmit_at};
use crate::priority::let_others_run;
use crate::progress::{Task, progress, rest};

/// Size of the receive ring in bytes. Half of it may be unread: 2.5 ms at 2 Mbaud.
const SIZE: usize = 1024;

/// The bytes of the receive ring, written by the DMA.
static BYTES: [AtomicU8; SIZE] = [const { AtomicU8::new(0) }; SIZE];
/// The positions in it, and the events of the interrupt handlers.
static RING: Mutex<RefCell<RxRing<SIZE>>> = Mutex::new(RefCell::new(RxRing::new()));
/// Wakes the receive task after an interrupt.
static EVENT: Signal<CriticalSectionRawMutex, ()> = Signal::new();
/// Errors already counted for a byte that the DMA did not fetch in time, and the byte's future position in the ring.
static COUNTED: Mutex<Cell<Option<(usize, Status)>>> = Mutex::new(Cell::new(None));
/// Errors that were not reported to the bridge yet.
static ERRORS: Mutex<Cell<Option<UartErrors>>> = Mutex::new(Cell::new(None));
/// The receive path must be restarted.
static RESTART: AtomicBool = AtomicBool::new(false);
static RING_OVERRUN: AtomicBool = AtomicBool::new(false);
/// On a single wire: the last bit was sent.
static SENT: Signal<CriticalSectionRawMutex, ()> = Signal::new();

/// Records the arrival of the threshold, idle lines and errors.
pub(crate) struct InterruptHandler;

impl Handler<UartInterrupt> for InterruptHandler {
    unsafe fn on_interrupt() {
        // The future position of the byte that the status belongs to, if it waits: the DMA may fetch it from here on.
        let place = tail();
        let status = usart::take_status();
        let is_byte = !status.is_error() && !status.idle && !usart::is_transmitted_interrupt();
        // Usually it is a byte inside a frame, which the DMA may not have counted yet.
        if is_byte && !usart::must_keep_parity_errors() && with_ring(|ring| ring.is_early(place, byte_at)) {
            return;
        }
        if !is_byte || !wait_for_dma() {
            return record_flags(status, place);
        }
        if record_bytes(tail(), now) {
            EVENT.signal(());
        }
    }
}

/// The byte at a position in the ring.
fn byte_at(position: usize) -> u8 {
    BYTES[position % SIZE].load(Ordering::Relaxed)
}

/// Calls the ring. Interrupt handlers wait meanwhile.
fn with_ring<R>(f: impl FnOnce(&mut RxRing<SIZE>) -> R) -> R {
    critical_section::with(|cs| f(&mut RING.borrow_ref_mut(cs)))
}

/// Records the bytes before `end`, and their time if they reach the threshold. Returns true if they do.
// Inline: it is executed for each byte.
#[inline(always)]
fn record_bytes(end: usize, at: impl FnOnce() -> Instant) -> bool {
    let last = byte_at(end.wrapping_sub(1));
    with_ring(|ring| {
        let is_event = ring.arrived(end, last, at);
        if is_event && !ring.is_waiting() {
            usart::set_byte_interrupt(false);
        }
        is_event
    })
}

/// Records errors, an idle line and the end of a transmission. A byte that waits will be at `place` in the ring.
#[cold]
fn record_flags(status: Status, place: usize) {
    let at = now();
    if usart::is_transmitted_interrupt() {
        transmission_complete();
    }
    // The byte that triggered the handler is in the ring a few cycles later.
    let is_fetched = wait_for_dma();
    if status.is_error() {
        record_errors(status, place, is_fetched);
    }
    let end = tail();
    let is_event = record_bytes(end, || at);
    let is_idle = status.idle && with_ring(|ring| ring.idle(end, at));
    // Errors are reported to the bridge together with the bytes.
    if is_event || is_idle {
        EVENT.signal(());
    }
}

/// Polls of the interrupt handler for the DMA's fetch of a byte, which takes less time.
const FETCH_TRIES: usize = 16;

/// Cycles within which the DMA has written and counted a fetched byte.
const COUNT_CYCLES: u32 = 24;

/// Waits briefly until the DMA has fetched and counted the UART's byte. Returns true if it has.
// Inline: it is executed for each byte.
#[inline(always)]
fn wait_for_dma() -> bool {
    let is_fetched = (0..FETCH_TRIES).any(|_| !usart::is_byte_waiting());
    if is_fetched {
        usart::keep_parity_error();
    }
    cortex_m::asm::delay(COUNT_CYCLES);
    is_fetched
}

/// On a single wire: the last bit was sent.
#[cold]
fn transmission_complete() {
    usart::set_receiver(true);
    usart::set_transmitted_interrupt(false);
    SENT.signal(());
}

/// Counts the errors of a byte at this future position in the ring, but only once while the byte waits for the DMA.
#[cold]
fn record_errors(status: Status, place: usize, is_fetched: bool) {
    critical_section::with(|cs| {
        let counted = match COUNTED.borrow(cs).take() {
            Some((held, counted)) if held == place => counted,
            _ => Status::default(),
        };
        let mut errors = ERRORS.borrow(cs).get().unwrap_or_default();
        for (flag, was, counter) in [
            (status.framing, counted.framing, &mut errors.framing),
            (status.parity, counted.parity, &mut errors.parity),
            (status.noise, counted.noise, &mut errors.noise),
            (status.overrun, counted.overrun, &mut errors.overrun),
        ] {
            *counter += u32::from(flag && !was);
        }
        ERRORS.borrow(cs).set(Some(errors));
        if !is_fetched {
            COUNTED.borrow(cs).set(Some((place, status)));
        }
    });
    if is_fetched {
        usart::clear_errors();
    }
}

/// Checks, each time the DMA enters a half of the ring, that the content of that half had been read.
pub(crate) struct RingHandler;

impl Handler<RxInterrupt> for RingHandler {
    unsafe fn on_interrupt() {
        // With two checks per turn the DMA cannot pass the head unnoticed. With fewer, as after a stall for the flash,
        // `rx_has_wrapped` detects it.
        if with_ring(|ring| ring.unread(tail())) > SIZE / 2 - MARGIN || usart::rx_has_wrapped() {
            RING_OVERRUN.store(true, Ordering::Relaxed);
        }
        EVENT.signal(());
    }
}

/// Bytes that may arrive before the handler runs.
const MARGIN: usize = 16;

/// The DMA's next write position in the ring.
fn tail() -> usize {
    (SIZE - usart::rx_remaining()) % SIZE
}

/// Triggers a read of the UART without an event, which shows that the task runs.
pub(crate) fn wake() {
    EVENT.signal(());
}

/// Passes the bytes of the arm to the bridge.
#[embassy_executor::task]
pub(crate) async fn receive(adapter: &'static Adapter, mut dma: Channel<'static>) {
    let mut receiver = Receiver {
        adapter,
        chunk: [0; 64],
        rest: 0,
        idle: false,
    };
    loop {
        let transfer = receiver.start(&mut dma);
        receiver.pass_rest();
        receiver.serve().await;
        receiver.stop(transfer);
    }
}

/// Bytes on their way from the ring to the bridge.
struct Receiver {
    adapter: &'static Adapter,
    chunk: [u8; 64],
    /// The number of bytes in `chunk` that were in the ring when the stream was stopped.
    rest: usize,
    /// The line was idle after them.
    idle: bool,
}

impl Receiver {
    /// Configures the DMA stream and connects it to the UART.
    ///
    /// Since [`stop`](Self::stop) the UART may hold a byte, which is lost when the next one is in, too. No call of the
    /// bridge may come in between.
    fn start<'a>(&mut self, dma: &'a mut Channel<'static>) -> Transfer<'a> {
        // Positions of before are invalid from here on.
        self.idle = with_ring(RxRing::restart);
        let ring = core::ptr::slice_from_raw_parts_mut(BYTES.as_ptr().cast::<u8>().cast_mut(), SIZE);
        let mut options = TransferOptions::default();
        options.circular = true;
        options.half_transfer_ir = true;
        let transfer = critical_section::with(|cs| {
            // The byte that the UART holds becomes the first in the ring, and its counted errors stay counted.
            let counted = COUNTED.borrow(cs);
            let held = counted.take().filter(|&(end, _)| end == tail());
            counted.set(held.map(|(_, status)| (0, status)));
            // SAFETY: the source is the UART's data register, whose stream this is; the target consists of static
            // atomics.
            unsafe { dma.read_raw(RX_REQUEST, usart::rx_data(), ring, options) }
        });
        usart::start_receiving();
        transfer
    }

    /// Serves the bridge's threshold until the receive path must be restarted.
    async fn serve(&mut self) {
        while !RESTART.swap(false, Ordering::Relaxed) {
            progress(Task::Receive);
            if self.poll() {
                // The packet is sent before all other work for a frame.
                yield_now().await;
                self.adapter.wake(Work::Uart);
                self.adapter.wake(Work::Dispatch);
                if self.adapter.take(|bridge| bridge.has_delivery()) {
                    self.adapter.wake(Work::Can);
                }
            }
            let wait = self.adapter.take(|bridge| bridge.rx_wait());
            let need = wait.threshold;
            let is_due = with_ring(|ring| {
                ring.set(wait);
                usart::set_byte_interrupt(true);
                ring.has_mark() || ring.unread(tail()) >= need.min.min(need.max)
            });
            // Bytes that arrived before the interrupt handler knew the threshold cause no signal. Results of earlier
            // bytes, and the next request, go out before they are read.
            if is_due {
                let_others_run().await;
            } else {
                let resting = rest(Task::Receive);
                EVENT.wait().await;
                drop(resting);
            }
        }
    }

    /// Passes received bytes to the bridge, stops the stream and keeps the rest.
    fn stop(&mut self, mut transfer: Transfer<'_>) {
        self.poll();
        // The interrupt handler leaves a byte in the data register to the DMA, which will not fetch it now.
        usart::stop_receiving();
        transfer.request_pause();
        while transfer.is_running() {}
        self.rest = copy(&mut self.chunk, tail());
    }

    /// Passes the bytes that were kept when the stream was stopped to the bridge.
    fn pass_rest(&mut self) {
        let at = now();
        self.adapter.with(|bridge| {
            bridge.uart_received(&self.chunk[..self.rest], at);
            if self.idle {
                bridge.uart_event(UartEvent::Idle, at);
            }
        });
    }

    /// Passes received bytes to the bridge. Returns true if a frame ended.
    fn poll(&mut self) -> bool {
        let chunk = &mut self.chunk;
        let is_frame = self.adapter.take(|bridge| {
            let mut errors = critical_section::with(|cs| ERRORS.borrow(cs).take());
            if RING_OVERRUN.swap(false, Ordering::Relaxed) {
                // The ring contains bytes of two turns, which cannot be separated.
                with_ring(|ring| ring.discard(tail()));
                errors.get_or_insert_default().ring_overrun = 1;
            }
            // Later bytes are read the next time.
            let (end, at) = critical_section::with(|_| (tail(), now()));
            let (mut frames, mut late, mut is_marked) = (0, 0, false);
            // A frame goes out before the bytes after it are read.
            while frames == 0
                && let Some(mark) = with_ring(|ring| ring.take_mark(end))
            {
                is_marked = true;
                if mark.idle {
                    // The detection takes one byte time.
                    let at = mark.at - Duration::from_micros(bridge.line_coding().micros(1));
                    late = take(bridge, chunk, mark.end, at);
                    frames = late + bridge.uart_event(UartEvent::Idle, mark.at);
                } else {
                    frames = take(bridge, chunk, mark.end, mark.at);
                }
            }
            if !is_marked || frames == 0 && with_ring(|ring| ring.unread(end)) > 0 {
                late = take(bridge, chunk, end, at);
                frames = late;
            }
            if late > 0 {
                // The interrupt handler missed their last bytes.
                errors.get_or_insert_default().late_stamps = late as u32;
            }
            if let Some(errors) = errors {
                bridge.uart_event(UartEvent::Errors(errors), at);
            }
            frames > 0
        });
        self.adapter.wake(Work::Port);
        is_frame
    }
}

/// Passes the bytes before `end`, possibly none, to the bridge. Returns the number of frames that ended.
fn take(bridge: &mut Bridge, chunk: &mut [u8; 64], end: usize, at: Instant) -> usize {
    let mut frames = 0;
    loop {
        let n = copy(chunk, end);
        frames += bridge.uart_received(&chunk[..n], at);
        if with_ring(|ring| ring.unread(end)) == 0 {
            return frames;
        }
    }
}

/// Copies bytes before `end` out of the ring, as many as fit, and returns their number.
fn copy(chunk: &mut [u8; 64], end: usize) -> usize {
    // The bytes are copied outside of the critical section: the interrupt handler must not wait.
    let [first, second] = with_ring(|ring| ring.take(end, chunk.len()));
    let (sooner, later) = chunk.split_at_mut(first.len());
    load(sooner, &BYTES[first.clone()]);
    load(later, &BYTES[second.clone()]);
    first.len() + second.len()
}

/// Loads as many bytes as fit.
fn load(to: &mut [u8], from: &[AtomicU8]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to = from.load(Ordering::Relaxed);
    }
}

/// Transmits the bridge's bytes for the arm, and changes the line between two bytes.
#[embassy_executor::task]
pub(crate) async fn transmit(
    adapter: &'static Adapter,
    mut uart: UartRx<'static, Blocking>,
    mut dma: Channel<'static>,
) {
    usart::set_transmit_requests(true);
    let mut config = UartConfig::default();
    let mut chunk = [0; MAX_FRAME];
    loop {
        progress(Task::Transmit);
        let at = now();
        match adapter.take(|bridge| bridge.uart_transmit(&mut chunk, at)) {
            Some(Transmit::Burst { len, start }) => {
                // Bytes to cut before this burst have been cut.
                adapter.reset(Work::UartCut);
                let sending = send(&mut dma, &chunk[..len], start, config.half_duplex);
                let accounting = async {
                    adapter.take(|bridge| bridge.uart_transmitted(at));
                    adapter.wake(Work::Dispatch);
                };
                select(join(sending, accounting), adapter.wait(Work::UartCut)).await;
            }
            Some(Transmit::Configure(wanted)) => {
                change(&mut uart, config, wanted).await;
                config = wanted;
                info!("line: {}", wanted);
                adapter.with(|bridge| bridge.uart_event(UartEvent::Configured(wanted), now()));
                RESTART.store(true, Ordering::Relaxed);
                wake();
            }
            None => {
                let resting = rest(Task::Transmit);
                adapter.wait(Work::Uart).await;
                drop(resting);
            }
        }
    }
}

/// Transmits `bytes`, the first of them at `start`. Returns when the last one is in the data register behind the one on
/// the line; on a single wire, when it was sent and the receiver is on again. After a drop, no further byte goes to the
/// UART.
async fn send(dma: &mut Channel<'static>, bytes: &[u8], start: Option<Instant>, half_duplex: bool) {
    if half_duplex {
        usart::set_receiver(false);
    }
    if start.is_some() {
        usart::set_transmit_requests(false);
    }
    // This makes the flag refer to these bytes, not to earlier ones.
    usart::clear_transmitted();
    // SAFETY: the address is that of the UART's data register, and the stream is the one wired to it.
    let transfer = unsafe { dma.write(TX_REQUEST, bytes, usart::tx_data(), Default::default()) };
    if let Some(start) = start {
        transmit_at(start);
    }
    transfer.await;
    if half_duplex {
        usart::set_transmitted_interrupt(true);
        SENT.wait().await;
    }
}

/// Waits for the last bit at the old configuration, and applies the new one.
async fn change(uart: &mut UartRx<'static, Blocking>, was: UartConfig, wanted: UartConfig) {
    while !usart::is_transmitted() {
        Timer::after_micros(10).await;
    }
    // The flag may refer to the byte before the last transfer, if that byte ended between the clearing and the first
    // byte. Two bytes are then left: one in the shift register, one behind it.
    Timer::after_micros(was.coding.micros(2)).await;
    let coding = wanted.coding;
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
    // The UART is disabled meanwhile.
    usart::hold_tx_high();
    // The bridge accepts only configurations that this UART supports.
    if uart.set_config(&config).is_err() {
        unreachable!()
    }
    usart::set_half_duplex(wanted.half_duplex);
    usart::release_tx();
}
