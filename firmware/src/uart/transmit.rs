//! Bursts to the arm.

use armwire_bridge::control::MAX_FRAME;
use armwire_bridge::{Bridge, Instant, Transmit};

use super::state::STATE;
use crate::board::hal::interrupt::typelevel::Handler;
use crate::board::{TxInterrupt, transmit_at, usart};
use crate::clock::now;

/// The transmitter.
pub(crate) struct Sender {
    /// The burst that the DMA reads, other than a poll sent ahead, which it reads from flash. It is written only while the
    /// DMA does not read it.
    burst: [u8; MAX_FRAME],
    /// The line is being changed.
    is_changing: bool,
}

impl Sender {
    /// An idle transmitter.
    pub(crate) const fn new() -> Self {
        Self {
            burst: [0; MAX_FRAME],
            is_changing: false,
        }
    }

    /// Starts the poll that follows the answer just received, before the bridge accounts for the answer. Returns true
    /// if it did.
    pub(crate) fn transmit_ahead(&mut self, bridge: &mut Bridge) -> bool {
        if self.is_busy() {
            return false;
        }
        bridge.uart_transmit_ahead(&mut self.burst, |poll| {
            let at = now();
            send(poll, None);
            at
        })
    }

    /// Starts the bridge's next burst or change of the line, if the UART is ready for it. Returns true if it did.
    // One copy, not one for each call of the bridge.
    #[inline(never)]
    pub(crate) fn transmit(&mut self, bridge: &mut Bridge) -> bool {
        if self.is_busy() {
            return false;
        }
        match bridge.uart_transmit(&mut self.burst, now(), send) {
            Some(Transmit::Burst { .. }) => true,
            Some(Transmit::Configure(wanted)) => {
                self.is_changing = true;
                STATE.tx.change.signal(wanted);
                true
            }
            None => false,
        }
    }

    fn is_busy(&self) -> bool {
        self.is_changing || STATE.tx.is_sending()
    }

    /// The line has been changed.
    pub(crate) fn changed(&mut self) {
        self.is_changing = false;
    }

    /// Stops the burst that is going out. The bytes that the UART holds still go out: the one on the line and the next,
    /// or those in its FIFO.
    pub(crate) fn cut(&mut self) {
        if STATE.tx.is_sending() {
            STATE.usart.stop_sending();
            // The burst may have waited for its start.
            usart::set_transmit_requests(true);
            dma_ended();
        }
    }
}

/// Sends `bytes`, the first of them at `start`.
fn send(bytes: &[u8], start: Option<Instant>) {
    STATE.tx.begin();
    if STATE.usart.is_half_duplex() {
        STATE.usart.set_receiver(false);
    }
    if start.is_some() {
        usart::set_transmit_requests(false);
    }
    // This makes the flag refer to these bytes, not to earlier ones.
    usart::clear_transmitted();
    STATE.usart.start_sending(bytes);
    if let Some(start) = start {
        transmit_at(start);
    }
}

/// Ends a burst when the DMA has written its last byte to the UART, behind the one on the line.
pub(crate) struct SentHandler;

impl Handler<TxInterrupt> for SentHandler {
    unsafe fn on_interrupt() {
        usart::clear_sent();
        dma_ended();
    }
}

/// The DMA has written the last byte. If the next burst must wait for bytes before it, an interrupt follows.
fn dma_ended() {
    match STATE.usart.sends_after_dma() {
        true => STATE.usart.set_transmitted_interrupt(true),
        false => STATE.tx.end(),
    }
}

/// The last bit of a burst was sent, or as much of it as the next burst waits for.
#[cold]
pub(super) fn transmission_complete() {
    STATE.usart.set_receiver(true);
    STATE.usart.set_transmitted_interrupt(false);
    STATE.tx.end();
}
