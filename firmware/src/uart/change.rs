//! Changes of the line between two bytes, and the start of the receive path after each.

use armwire_bridge::UartConfig;
use embassy_time::Timer;

use super::chip::{self, Dma, Uart};
use super::receive::Receiver;
use super::state::{STATE, wake};
use crate::adapter::Adapter;
use crate::board::usart;
use crate::ceiling::{SERVICE, mask};
use crate::progress::{Task, rest};

/// Starts the receive path, and changes the line.
#[embassy_executor::task]
pub(crate) async fn change(adapter: &'static Adapter, mut uart: Uart, mut dma: Dma) {
    usart::set_transmit_requests(true);
    let mut config = UartConfig::default();
    let mut receiver = Receiver::new();
    let mut masked = mask(SERVICE);
    loop {
        // From the stop of the receive path to here the UART can hold a single byte: the service waits.
        let transfer = receiver.start(&mut dma, config.coding);
        adapter.with(|bridge| receiver.pass_rest(bridge));
        wake();
        drop(masked);
        let resting = rest(Task::Line);
        let wanted = STATE.tx.change.wait().await;
        drop(resting);
        configure(&mut uart, config, wanted).await;
        config = wanted;
        info!("line: {}", wanted);
        masked = mask(SERVICE);
        adapter.line_changed(wanted);
        receiver.stop(transfer);
    }
}

/// Waits for the last bit at the old configuration, and applies the new one.
async fn configure(uart: &mut Uart, was: UartConfig, wanted: UartConfig) {
    while !STATE.usart.is_transmitted() {
        Timer::after_micros(10).await;
    }
    // The flag may refer to the byte before the last transfer, if that byte ended between the clearing and the first
    // byte. Two bytes are then left: one in the shift register, one behind it.
    Timer::after_micros(was.coding.micros(2)).await;
    // The UART is disabled meanwhile.
    usart::hold_tx_high();
    chip::configure(uart, was.coding, wanted.coding).await;
    STATE.usart.set_half_duplex(wanted.half_duplex);
    usart::release_tx();
}
