//! Endpoint 0 of USB: the HAL's, extended for hosts that abandon a request.
//!
//! The HAL waits for the end of each stage of a request, but the host may begin another request at any time (USB 2.0,
//! 8.5.3). The registers are in the board's `usb`.

use core::future::{Future, poll_fn};
use core::pin::pin;
use core::sync::atomic::Ordering;
use core::task::Poll;

use embassy_usb::driver::{self, EndpointError};

use super::usb::{HalControlPipe, data_in, is_over, poll_request, withdraw_answer};
use super::usb_stage::{SETUP_ARRIVED, wait_for_stage};

/// Waits for the end of a stage of a request. `None` once the host has ended the request.
async fn unless_over<R>(stage: impl Future<Output = R>) -> Option<R> {
    let mut stage = pin!(stage);
    poll_fn(|cx| {
        wait_for_stage(cx.waker());
        // An answer that is armed just as the host begins another request is withdrawn before the host fetches it. The
        // host needs 5 µs, and an interrupt handler in between may take as long.
        critical_section::with(|_| {
            if !is_over() {
                let polled = stage.as_mut().poll(cx).map(Some);
                if !is_over() {
                    return polled;
                }
            }
            withdraw_answer();
            Poll::Ready(None)
        })
    })
    .await
}

/// Endpoint 0.
pub(crate) struct ControlPipe(pub(super) HalControlPipe);

impl driver::ControlPipe for ControlPipe {
    fn max_packet_size(&self) -> usize {
        self.0.max_packet_size()
    }

    async fn setup(&mut self) -> [u8; 8] {
        poll_fn(|cx| {
            critical_section::with(|_| {
                let request = poll_request(&mut self.0, cx);
                if request.is_ready() {
                    SETUP_ARRIVED.store(false, Ordering::Relaxed);
                }
                request
            })
        })
        .await
    }

    async fn data_out(&mut self, buf: &mut [u8], first: bool, last: bool) -> Result<usize, EndpointError> {
        let stage = unless_over(self.0.data_out(buf, first, last)).await;
        stage.unwrap_or(Err(EndpointError::Disabled))
    }

    async fn data_in(&mut self, data: &[u8], first: bool, last: bool) -> Result<(), EndpointError> {
        let stage = unless_over(data_in(&mut self.0, data, first, last)).await;
        stage.unwrap_or(Err(EndpointError::Disabled))
    }

    async fn accept(&mut self) {
        unless_over(self.0.accept()).await;
    }

    async fn reject(&mut self) {
        unless_over(self.0.reject()).await;
    }

    async fn accept_set_address(&mut self, address: u8) {
        unless_over(self.0.accept_set_address(address)).await;
    }
}
