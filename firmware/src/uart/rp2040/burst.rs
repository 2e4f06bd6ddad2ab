//! The start and the end of a burst.

use super::super::state::STATE;
use super::super::transmit::transmission_complete;
use crate::board::hal::interrupt::typelevel::Handler;
use crate::board::{BurstInterrupt, clear_burst_alarm, set_end_alarm, usart};
use crate::clock::now;

/// Starts a burst, or ends it when its last byte has left the FIFO.
pub(crate) struct BurstHandler;

impl Handler<BurstInterrupt> for BurstHandler {
    unsafe fn on_interrupt() {
        clear_burst_alarm();
        // The transmit requests of a burst that waits for its start are off.
        if !usart::has_transmit_requests() {
            usart::set_transmit_requests(true);
        } else if STATE.usart.is_waiting_for_end() {
            match STATE.usart.has_burst_ended() {
                true => transmission_complete(),
                false => set_end_alarm(now() + STATE.usart.line_time(1)),
            }
        }
    }
}
