//! Reads of the receive ring, and the start and stop of the DMA that fills it.

use core::ops::Range;

use armwire_bridge::{Bridge, Instant, LineCoding, RxRing, RxWait, UartEvent};

use super::chip::{self, Dma, Transfer, tail};
use super::state::{STATE, WORD, word_at};
use crate::clock::now;

/// Maximum number of bytes that are passed to the bridge at once.
const CHUNK: usize = 64;

/// Words of the ring with up to [`CHUNK`] bytes from any position.
type Words = [[u8; WORD]; CHUNK / WORD + 1];
const CLEAR: Words = [[0; WORD]; CHUNK / WORD + 1];

/// Reads of the receive ring.
pub(crate) struct Reader {
    /// The bytes that are passed to the bridge. To clear them for each read would take longer than the copy.
    chunk: Words,
}

impl Reader {
    pub(crate) const fn new() -> Self {
        Self { chunk: CLEAR }
    }

    /// Passes received bytes to the bridge, up to the end of a frame. Returns true if one ended.
    pub(crate) fn read(&mut self, bridge: &mut Bridge) -> bool {
        let mut errors = STATE.rx.take_errors();
        if STATE.rx.take_overrun() {
            // The ring contains bytes of two turns, which cannot be separated.
            STATE.rx.ring(|ring| ring.discard(tail()));
            errors.get_or_insert_default().ring_overrun = 1;
        }
        // Later bytes are read the next time.
        let (end, at) = critical_section::with(|_| (tail(), now()));
        let (mut frames, mut late, mut is_marked) = (0, 0, false);
        // A frame goes out before the bytes after it are read.
        while frames == 0
            && let Some(mark) = STATE.rx.ring(|ring| ring.take_mark(end))
        {
            is_marked = true;
            if mark.idle {
                // The detection takes one byte time.
                let at = mark.at - chip::byte_time();
                late = self.pass(bridge, mark.end, at);
                frames = late + bridge.uart_event(UartEvent::Idle, mark.at);
            } else {
                frames = self.pass(bridge, mark.end, mark.at);
            }
        }
        if !is_marked || frames == 0 && STATE.rx.ring(|ring| ring.unread(end)) > 0 {
            late = self.pass(bridge, end, at);
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
    }

    /// Passes the bytes before `end`, possibly none, to the bridge. Returns the number of frames that ended.
    fn pass(&mut self, bridge: &mut Bridge, end: usize, at: Instant) -> usize {
        let mut frames = 0;
        loop {
            let bytes = copy(&mut self.chunk, end);
            frames += bridge.uart_received(&self.chunk.as_flattened()[bytes], at);
            if STATE.rx.ring(|ring| ring.unread(end)) == 0 {
                return frames;
            }
        }
    }
}

/// Makes the interrupt handler wait for these events. Returns true if one has already come that pends no service.
pub(crate) fn wait(wait: RxWait) -> bool {
    STATE.rx.ring(|ring| {
        ring.set(wait);
        chip::listen(ring)
    })
}

/// Copies bytes before `end` out of the ring, as many as fit, and returns their place. It copies whole words: the first
/// and the last may contain other bytes, which do not count.
fn copy(words: &mut Words, end: usize) -> Range<usize> {
    // The bytes are copied outside of the critical section: the interrupt handler must not wait.
    let [first, second] = STATE.rx.ring(|ring| ring.take(end, CHUNK));
    let len = first.len() + second.len();
    let index = first.start % WORD;
    for (i, word) in words.iter_mut().enumerate().take((index + len).div_ceil(WORD)) {
        *word = word_at(first.start + i * WORD);
    }
    index..index + len
}

/// The receive path: its start and stop, and the bytes in between.
pub(super) struct Receiver {
    /// The words with the bytes that were in the ring when the DMA was stopped.
    words: Words,
    /// Their place in `words`.
    rest: Range<usize>,
}

impl Receiver {
    pub(super) const fn new() -> Self {
        Self {
            words: CLEAR,
            rest: 0..0,
        }
    }

    /// Starts the DMA into the ring.
    ///
    /// Since [`stop`](Self::stop) the UART may hold a byte, which is lost when the next one is in, too. No call of the
    /// bridge may come in between.
    pub(super) fn start<'a>(&self, dma: &'a mut Dma, coding: LineCoding) -> Transfer<'a> {
        // An interrupt handler in between would record an old position of the DMA in the new ring.
        critical_section::with(|_| {
            STATE.rx.ring(RxRing::restart);
            let transfer = chip::start(dma, coding);
            // Bytes before the start are no part of later ones, and their idle line may have passed.
            STATE.rx.ring(|ring| ring.idle(tail(), now()));
            transfer
        })
    }

    /// Passes the bytes that were kept when the DMA was stopped to the bridge. The start reports the idle line after them.
    pub(super) fn pass_rest(&self, bridge: &mut Bridge) {
        bridge.uart_received(&self.words.as_flattened()[self.rest.clone()], now());
    }

    /// Stops the DMA and keeps the unread bytes: those that arrived since the last of [`Reader::read`].
    pub(super) fn stop(&mut self, transfer: Transfer<'_>) {
        chip::stop(transfer);
        self.rest = copy(&mut self.words, tail());
    }
}
