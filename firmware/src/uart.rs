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
use core::sync::atomic::{AtomicBool, AtomicU8, AtomicUsize, Ordering};

use armwire_bridge::control::MAX_FRAME;
use armwire_bridge::{
    Bridge, Duration, Instant, Parity, RxThreshold, StopBits, Transmit, UartConfig, UartErrors, UartEvent,
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
use heapless::Deque;

use crate::adapter::{Adapter, Work, now};
use crate::board::usart::{self, Status};
use crate::board::{RX_REQUEST, RxInterrupt, TX_REQUEST, UartInterrupt, transmit_at};
use crate::priority::let_others_run;
use crate::progress::{Task, progress, rest};

/// Size of the receive ring in bytes. Half of it may be unread: 2.5 ms at 2 Mbaud.
const SIZE: usize = 1024;

/// An event at a position in the ring.
#[derive(Clone, Copy)]
struct Mark {
    end: usize,
    /// Arrival of the byte before it or, for an idle line, the time of detection.
    at: Instant,
    idle: bool,
}

/// The receive ring, written by the DMA.
static RING: [AtomicU8; SIZE] = [const { AtomicU8::new(0) }; SIZE];
/// The ring position of the next byte to read.
static HEAD: AtomicUsize = AtomicUsize::new(0);
/// The ring position from which the threshold counts.
static FROM: AtomicUsize = AtomicUsize::new(0);
/// The threshold: the interrupt handler records an event after this many bytes.
static NEEDED: AtomicUsize = AtomicUsize::new(SIZE);
/// The threshold with a terminator: this many bytes, if the last of them is the terminator.
static LEAST: AtomicUsize = AtomicUsize::new(SIZE);
static LAST: AtomicU8 = AtomicU8::new(0);
/// Ring positions of candidate frame ends and idle events. Up to 3: the terminator may also occur inside a frame.
static MARKS: Mutex<RefCell<Deque<Mark, 3>>> = Mutex::new(RefCell::new(Deque::new()));
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
        // Usually it is a byte before the threshold.
        if !is_byte || !wait_for_dma() {
            return record_flags(status, place);
        }
        let end = tail();
        if is_reached(end) {
            record_threshold(end, now());
            EVENT.signal(());
        }
    }
}

/// Records the arrival of the threshold. While there is room for further events, only further candidate frame ends are
/// checked.
fn record_threshold(end: usize, at: Instant) {
    let is_full = critical_section::with(|cs| {
        let mut marks = MARKS.borrow_ref_mut(cs);
        // Any other event, for example the idle line after it, triggers the handler again.
        if marks.back().is_none_or(|last| last.end != end) {
            let _ = marks.push_back(Mark { end, at, idle: false });
        }
        marks.is_full()
    });
    NEEDED.store(SIZE, Ordering::Relaxed);
    if is_full || LEAST.load(Ordering::Relaxed) == SIZE {
        LEAST.store(SIZE, Ordering::Relaxed);
        usart::set_byte_interrupt(false);
    }
}

/// Records an idle line. Without room, the last recorded event was shortly before.
fn record_idle(end: usize, at: Instant) {
    critical_section::with(|cs| {
        let mut marks = MARKS.borrow_ref_mut(cs);
        if marks.is_full() {
            marks.pop_back();
        }
        let _ = marks.push_back(Mark { end, at, idle: true });
    });
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
    let reached = is_reached(end);
    if reached {
        record_threshold(end, at);
    }
    if status.idle {
        record_idle(end, at);
    }
    // Errors are reported to the bridge together with the bytes.
    if reached || status.idle {
        EVENT.signal(());
    }
}

/// Returns true if the bytes before `end` reach the threshold.
fn is_reached(end: usize) -> bool {
    let n = (end + SIZE - FROM.load(Ordering::Relaxed)) % SIZE;
    let last = RING.get(end.wrapping_sub(1) % SIZE);
    let is_mark = || last.is_some_and(|last| last.load(Ordering::Relaxed) == LAST.load(Ordering::Relaxed));
    n >= NEEDED.load(Ordering::Relaxed) || n >= LEAST.load(Ordering::Relaxed) && is_mark()
}

/// Sets the threshold of the interrupt handler.
fn set_threshold(need: RxThreshold) {
    let (last, least) = need.terminator.map_or((0, SIZE), |mark| (mark, need.min));
    // The handler must not see a partial update.
    critical_section::with(|_| {
        FROM.store(HEAD.load(Ordering::Relaxed), Ordering::Relaxed);
        LAST.store(last, Ordering::Relaxed);
        LEAST.store(least, Ordering::Relaxed);
        NEEDED.store(need.max, Ordering::Relaxed);
        usart::set_byte_interrupt(true);
    });
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
        if unread(tail()) > SIZE / 2 - MARGIN || usart::rx_has_wrapped() {
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

/// The number of bytes in the ring before `end`.
fn unread(end: usize) -> usize {
    (end + SIZE - HEAD.load(Ordering::Relaxed)) % SIZE
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
    fn start<'a>(&self, dma: &'a mut Channel<'static>) -> Transfer<'a> {
        HEAD.store(0, Ordering::Relaxed);
        NEEDED.store(SIZE, Ordering::Relaxed);
        LEAST.store(SIZE, Ordering::Relaxed);
        let ring = core::ptr::slice_from_raw_parts_mut(RING.as_ptr().cast::<u8>().cast_mut(), SIZE);
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
            let need = self.adapter.take(|bridge| bridge.rx_threshold());
            set_threshold(need);
            // Bytes that arrived before the interrupt handler knew the threshold cause no signal. Results of earlier
            // bytes, and the next request, go out before they are read.
            if has_mark() || unread(tail()) >= need.min.min(need.max) {
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
        // Positions in the ring are invalid from here on.
        let marks = critical_section::with(|cs| MARKS.take(cs));
        self.idle = marks.iter().any(|mark| mark.idle);
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
                critical_section::with(|cs| {
                    HEAD.store(tail(), Ordering::Relaxed);
                    MARKS.borrow_ref_mut(cs).clear();
                });
                errors.get_or_insert_default().ring_overrun = 1;
            }
            // Later bytes are read the next time.
            let (end, at) = critical_section::with(|_| (tail(), now()));
            let (mut frames, mut late, mut is_marked) = (0, 0, false);
            // A frame goes out before the bytes after it are read.
            while frames == 0
                && let Some(mark) = take_mark(end)
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
            if !is_marked || frames == 0 && unread(end) > 0 {
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

/// Returns true if an event is unread.
fn has_mark() -> bool {
    critical_section::with(|cs| !MARKS.borrow_ref(cs).is_empty())
}

/// The first event that is not after `end`.
fn take_mark(end: usize) -> Option<Mark> {
    critical_section::with(|cs| {
        let mut marks = MARKS.borrow_ref_mut(cs);
        let first = marks.front()?;
        if unread(first.end) > unread(end) {
            return None;
        }
        marks.pop_front()
    })
}

/// Passes the bytes before `end`, possibly none, to the bridge. Returns the number of frames that ended.
fn take(bridge: &mut Bridge, chunk: &mut [u8; 64], end: usize, at: Instant) -> usize {
    let mut frames = 0;
    loop {
        let n = copy(chunk, end);
        frames += bridge.uart_received(&chunk[..n], at);
        if unread(end) == 0 {
            return frames;
        }
    }
}

/// Copies bytes before `end` out of the ring, as many as fit, and returns their number.
fn copy(chunk: &mut [u8; 64], end: usize) -> usize {
    let n = unread(end).min(chunk.len());
    let head = HEAD.load(Ordering::Relaxed);
    let (sooner, later) = chunk[..n].split_at_mut(n.min(SIZE - head));
    load(sooner, &RING[head..]);
    load(later, &RING);
    HEAD.store((head + n) % SIZE, Ordering::Relaxed);
    n
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
