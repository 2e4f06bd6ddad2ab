//! The arm's UART: in by circular DMA, out by DMA.
//!
//! The HAL's ring-buffered receiver is not used. It reads the data register each time it is asked for bytes, which on
//! older UARTs takes a byte from the DMA when one arrives in that moment; it reports one error where the status
//! register has several; and after an error it enables the DMA stream again without setting it up, so its count of the
//! ring no longer holds. Here the interrupt handler alone touches the data register, only when a flag needs clearing,
//! and each start of the receive path sets up the stream from nothing, so that it does not matter whether a stream that
//! is enabled again starts over or carries on. The registers themselves are the board's, in
//! [`usart`](crate::board::usart).
//!
//! # Time stamps
//!
//! The bridge says with which byte the next frame ends or, once it knows, how many bytes it needs before anything can be due.
//! The interrupt handler is asked to look at each byte, or at each of the last of them, so that it sees the one that
//! completes the frame come in and notes when that was. What the tasks and other interrupt handlers are doing in that
//! moment does not matter: it interrupts all of them.

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
use crate::watchdog::{Task, progress, rest};

/// Bytes the receive ring holds. Half of them may wait to be taken: 2.5 ms at 2 Mbaud.
const SIZE: usize = 1024;

/// A place in the ring, and what happened there.
#[derive(Clone, Copy)]
struct Mark {
    end: usize,
    /// When the byte before it came in or, where the line went idle, when that was known.
    at: Instant,
    idle: bool,
}

/// The receive ring, which the DMA writes.
static RING: [AtomicU8; SIZE] = [const { AtomicU8::new(0) }; SIZE];
/// Where in the ring the next byte to take lies.
static HEAD: AtomicUsize = AtomicUsize::new(0);
/// From where in the ring on the bytes are counted that are needed.
static FROM: AtomicUsize = AtomicUsize::new(0);
/// How many they must be for the interrupt handler to say so.
static NEEDED: AtomicUsize = AtomicUsize::new(SIZE);
/// Or how many, if the last of them is this one.
static LEAST: AtomicUsize = AtomicUsize::new(SIZE);
static LAST: AtomicU8 = AtomicU8::new(0);
/// Where they did, and where the line went idle. Several, as a frame may have such a byte just before its last, too.
static MARKS: Mutex<RefCell<Deque<Mark, 3>>> = Mutex::new(RefCell::new(Deque::new()));
/// What the interrupt handler has to say.
static EVENT: Signal<CriticalSectionRawMutex, ()> = Signal::new();
/// What was counted of a byte that the DMA did not fetch in time, and where in the ring it is to lie.
static COUNTED: Mutex<Cell<Option<(usize, Status)>>> = Mutex::new(Cell::new(None));
/// The errors that the bridge does not know of yet.
static ERRORS: Mutex<Cell<Option<UartErrors>>> = Mutex::new(Cell::new(None));
/// The receive path must be started anew.
static RESTART: AtomicBool = AtomicBool::new(false);
static RING_OVERRUN: AtomicBool = AtomicBool::new(false);
/// On a single wire: the last bit is out.
static SENT: Signal<CriticalSectionRawMutex, ()> = Signal::new();

/// Notes when the bytes that are needed have come, idle lines and errors.
pub(crate) struct InterruptHandler;

impl Handler<UartInterrupt> for InterruptHandler {
    unsafe fn on_interrupt() {
        // Where the byte is to lie of which the status tells, if it waits: the DMA may fetch it from here on.
        let place = tail();
        let status = usart::take_status();
        let is_byte = !status.is_error() && !status.idle && !usart::is_transmitted_interrupt();
        // Nearly always it is one more of the bytes before the one that is needed.
        if !is_byte || !wait_for_dma() {
            return note(status, place);
        }
        let end = tail();
        if is_reached(end) {
            reach(end, now());
            EVENT.signal(());
        }
    }
}

/// Notes that a byte has come that is needed, and asks only for others with which a frame can end, as long as there is
/// room to note them.
fn reach(end: usize, at: Instant) {
    let is_full = critical_section::with(|cs| {
        let mut marks = MARKS.borrow_ref_mut(cs);
        // What is not one more byte, such as the idle line behind it, brings the handler here again.
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

/// Notes where the line went idle. Without room, what was noted last was not long before.
fn fall_idle(end: usize, at: Instant) {
    critical_section::with(|cs| {
        let mut marks = MARKS.borrow_ref_mut(cs);
        if marks.is_full() {
            marks.pop_back();
        }
        let _ = marks.push_back(Mark { end, at, idle: true });
    });
}

/// Notes what the UART has to say besides, of a byte that is to lie at this place in the ring if it waits.
#[cold]
fn note(status: Status, place: usize) {
    let at = now();
    if usart::is_transmitted_interrupt() {
        listen();
    }
    // The byte that brought the handler here is in the ring a few cycles later.
    let is_fetched = wait_for_dma();
    if status.is_error() {
        note_errors(status, place, is_fetched);
    }
    let end = tail();
    let reached = is_reached(end);
    if reached {
        reach(end, at);
    }
    if status.idle {
        fall_idle(end, at);
    }
    // The bridge is told of errors with the bytes.
    if reached || status.idle {
        EVENT.signal(());
    }
}

/// Whether as many bytes have come before `end` as are needed.
fn is_reached(end: usize) -> bool {
    let n = (end + SIZE - FROM.load(Ordering::Relaxed)) % SIZE;
    let last = RING.get(end.wrapping_sub(1) % SIZE);
    let is_mark = || last.is_some_and(|last| last.load(Ordering::Relaxed) == LAST.load(Ordering::Relaxed));
    n >= NEEDED.load(Ordering::Relaxed) || n >= LEAST.load(Ordering::Relaxed) && is_mark()
}

/// Asks the interrupt handler to say when this is met.
fn look_for(need: RxThreshold) {
    let (last, least) = need.terminator.map_or((0, SIZE), |mark| (mark, need.min));
    // The handler is not to see a part of it.
    critical_section::with(|_| {
        FROM.store(HEAD.load(Ordering::Relaxed), Ordering::Relaxed);
        LAST.store(last, Ordering::Relaxed);
        LEAST.store(least, Ordering::Relaxed);
        NEEDED.store(need.max, Ordering::Relaxed);
        usart::set_byte_interrupt(true);
    });
}

/// How often the interrupt handler looks whether the DMA has fetched a byte, which takes it less long.
const FETCH_TRIES: usize = 16;

/// Cycles in which the DMA has written and counted a byte that it has fetched.
const COUNT_CYCLES: u32 = 24;

/// Waits until the DMA has fetched what the UART holds, and counted it, but not for long. Returns whether it has.
fn wait_for_dma() -> bool {
    let is_fetched = (0..FETCH_TRIES).any(|_| !usart::is_byte_waiting());
    cortex_m::asm::delay(COUNT_CYCLES);
    is_fetched
}

/// On a single wire: the last bit is out.
#[cold]
fn listen() {
    usart::set_receiver(true);
    usart::set_transmitted_interrupt(false);
    SENT.signal(());
}

/// Counts the errors of a byte that is to lie at this place in the ring, but not again those of a byte that still waits for
/// the DMA.
#[cold]
fn note_errors(status: Status, place: usize, is_fetched: bool) {
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

/// Checks, each time the DMA enters a half of the ring, that what was in it had been taken.
pub(crate) struct RingHandler;

impl Handler<RxInterrupt> for RingHandler {
    unsafe fn on_interrupt() {
        // Asked twice per turn, this cannot miss that the DMA went past the head. Asked less often, as after the core
        // stood still for the flash, it sees that itself.
        if untaken(tail()) > SIZE / 2 - MARGIN || usart::rx_went_round() {
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

/// How many bytes lie in the ring before `end`.
fn untaken(end: usize) -> usize {
    (end + SIZE - HEAD.load(Ordering::Relaxed)) % SIZE
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

/// The way of bytes from the ring to the bridge.
struct Receiver {
    adapter: &'static Adapter,
    chunk: [u8; 64],
    /// How many bytes of `chunk` were in the ring when the stream was stopped.
    rest: usize,
    /// Whether the line was idle behind them.
    idle: bool,
}

impl Receiver {
    /// Sets up the DMA stream and lets the UART feed it.
    ///
    /// Since [`stop`](Self::stop) the UART itself holds a byte, which is lost only when the one after it is in, too. So
    /// there is no time in between to tell the bridge anything.
    fn start<'a>(&self, dma: &'a mut Channel<'static>) -> Transfer<'a> {
        HEAD.store(0, Ordering::Relaxed);
        NEEDED.store(SIZE, Ordering::Relaxed);
        LEAST.store(SIZE, Ordering::Relaxed);
        let ring = core::ptr::slice_from_raw_parts_mut(RING.as_ptr().cast::<u8>().cast_mut(), SIZE);
        let mut options = TransferOptions::default();
        options.circular = true;
        options.half_transfer_ir = true;
        let transfer = critical_section::with(|cs| {
            // The byte that the UART holds is the ring's first now, and what was counted of it stays counted.
            let counted = COUNTED.borrow(cs);
            let held = counted.take().filter(|&(end, _)| end == tail());
            counted.set(held.map(|(_, status)| (0, status)));
            // SAFETY: the source is the UART's data register, whose stream this is; the target is made of atomics, for
            // good.
            unsafe { dma.read_raw(RX_REQUEST, usart::rx_data(), ring, options) }
        });
        usart::start_receiving();
        transfer
    }

    /// Takes bytes as the bridge asks for them, until the receive path must be started anew.
    async fn serve(&mut self) {
        while !RESTART.swap(false, Ordering::Relaxed) {
            progress(Task::Receive);
            if self.look() {
                // The packet goes out before all else that a frame leads to.
                yield_now().await;
                self.adapter.wake(Work::Uart);
                self.adapter.wake(Work::Dispatch);
                if self.adapter.take(|bridge| bridge.has_delivery()) {
                    self.adapter.wake(Work::Can);
                }
            }
            let need = self.adapter.take(|bridge| bridge.rx_threshold());
            look_for(need);
            // Bytes that came before the interrupt handler knew of the need give no signal. What came before them, and what
            // is asked next, goes out before they are looked at.
            if has_mark() || untaken(tail()) >= need.min.min(need.max) {
                let_others_run().await;
            } else {
                let resting = rest(Task::Receive);
                EVENT.wait().await;
                drop(resting);
            }
        }
    }

    /// Passes what has arrived to the bridge, stops the stream and keeps the rest.
    fn stop(&mut self, mut transfer: Transfer<'_>) {
        self.look();
        // The interrupt handler leaves a byte in the data register to the DMA, which will not come for it now.
        usart::stop_receiving();
        transfer.request_pause();
        while transfer.is_running() {}
        self.rest = copy(&mut self.chunk, tail());
        // Places in the ring mean nothing from here on.
        let marks = critical_section::with(|cs| MARKS.take(cs));
        self.idle = marks.iter().any(|mark| mark.idle);
    }

    /// Passes what was kept when the stream was stopped to the bridge.
    fn pass_rest(&mut self) {
        let at = now();
        self.adapter.with(|bridge| {
            bridge.uart_received(&self.chunk[..self.rest], at);
            if self.idle {
                bridge.uart_event(UartEvent::Idle, at);
            }
        });
    }

    /// Passes what has arrived to the bridge, and returns whether a frame ended.
    fn look(&mut self) -> bool {
        let chunk = &mut self.chunk;
        let is_frame = self.adapter.take(|bridge| {
            let mut errors = critical_section::with(|cs| ERRORS.borrow(cs).take());
            if RING_OVERRUN.swap(false, Ordering::Relaxed) {
                // What the ring holds is of two turns: none of it can be told apart.
                critical_section::with(|cs| {
                    HEAD.store(tail(), Ordering::Relaxed);
                    MARKS.borrow_ref_mut(cs).clear();
                });
                errors.get_or_insert_default().ring_overrun = 1;
            }
            // What comes from here on is looked at the next time.
            let (end, at) = critical_section::with(|_| (tail(), now()));
            let (mut frames, mut late, mut is_marked) = (0, 0, false);
            // A frame goes out before what is behind it is looked at.
            while frames == 0
                && let Some(mark) = take_mark(end)
            {
                is_marked = true;
                if mark.idle {
                    // It takes the time of a byte to know.
                    let at = mark.at - Duration::from_micros(bridge.line_coding().micros(1));
                    late = take(bridge, chunk, mark.end, at);
                    frames = late + bridge.uart_event(UartEvent::Idle, mark.at);
                } else {
                    frames = take(bridge, chunk, mark.end, mark.at);
                }
            }
            if !is_marked || frames == 0 && untaken(end) > 0 {
                late = take(bridge, chunk, end, at);
                frames = late;
            }
            if late > 0 {
                // No interrupt handler saw their last bytes come.
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

/// Whether there is a mark that was not looked at.
fn has_mark() -> bool {
    critical_section::with(|cs| !MARKS.borrow_ref(cs).is_empty())
}

/// The first mark that is not after `end`.
fn take_mark(end: usize) -> Option<Mark> {
    critical_section::with(|cs| {
        let mut marks = MARKS.borrow_ref_mut(cs);
        let first = marks.front()?;
        if untaken(first.end) > untaken(end) {
            return None;
        }
        marks.pop_front()
    })
}

/// Passes the bytes before `end` to the bridge, or tells it that there are none. Returns the number of frames that ended.
fn take(bridge: &mut Bridge, chunk: &mut [u8; 64], end: usize, at: Instant) -> usize {
    let mut frames = 0;
    loop {
        let n = copy(chunk, end);
        frames += bridge.uart_received(&chunk[..n], at);
        if untaken(end) == 0 {
            return frames;
        }
    }
}

/// Copies bytes before `end` out of the ring, as many as there is room for, and returns how many.
fn copy(chunk: &mut [u8; 64], end: usize) -> usize {
    let n = untaken(end).min(chunk.len());
    let head = HEAD.load(Ordering::Relaxed);
    let (sooner, later) = chunk[..n].split_at_mut(n.min(SIZE - head));
    load(sooner, &RING[head..]);
    load(later, &RING);
    HEAD.store((head + n) % SIZE, Ordering::Relaxed);
    n
}

/// Loads as many bytes as there is room for.
fn load(to: &mut [u8], from: &[AtomicU8]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to = from.load(Ordering::Relaxed);
    }
}

/// Sends what the bridge has for the arm, and changes the line between two bytes.
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
                // Bytes that were to be cut before this burst have been.
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

/// Hands `bytes` to the UART, the first of which is to start at `start`. Returns when the last one waits behind the one
/// on the line; on a single wire, when it is out and the receiver listens again. When it is dropped, no further byte goes to
/// the UART.
async fn send(dma: &mut Channel<'static>, bytes: &[u8], start: Option<Instant>, half_duplex: bool) {
    if half_duplex {
        usart::set_receiver(false);
    }
    if start.is_some() {
        usart::set_transmit_requests(false);
    }
    // To tell when these bytes are out, not the ones before.
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

/// Waits for the last bit to leave the line as it was, and changes it.
async fn change(uart: &mut UartRx<'static, Blocking>, was: UartConfig, wanted: UartConfig) {
    while !usart::is_transmitted() {
        Timer::after_micros(10).await;
    }
    // That may be true of the byte before the last transfer, if it ended between the clearing and the first byte. Then
    // two bytes are left: one in the shift register, one behind it.
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
    // The bridge lets through only what this UART can do.
    if uart.set_config(&config).is_err() {
        unreachable!()
    }
    usart::set_half_duplex(wanted.half_duplex);
    usart::release_tx();
}
