//! The start and the end of a burst.

use super::super::transmit::transmission_complete;
use crate::board::hal::interrupt::typelevel::Handler;
use crate::board::{BurstInterrupt, set_end_alarm, take_burst_alarm, usart};
use crate::clock::now;

/// Starts a burst, or ends it when its last byte has left the FIFO.
pub(crate) struct BurstHandler;

impl Handler<BurstInterrupt> for BurstHandler {
    unsafe fn on_interrupt() {
        if take_burst_alarm() {
            usart::set_transmit_requests(true);
        } else if usart::is_waiting_for_end() {
            match usart::has_burst_ended() {
                true => transmission_complete(),
                false => set_end_alarm(now() + usart::line_time(1)),
            }
        }
    }
}
