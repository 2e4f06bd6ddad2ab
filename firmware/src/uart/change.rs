//! Changes of the line between two bytes, and the start of the receive path after each.

use armwire_bridge::{Parity, StopBits, UartConfig};
use embassy_stm32::dma::Channel;
use embassy_stm32::mode::Blocking;
use embassy_stm32::usart::{self as hal, UartRx};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::Timer;

use super::receive::Receiver;
use super::{byte_interrupt, wake};
use crate::adapter::Adapter;
use crate::board::usart;
use crate::ceiling::{SERVICE, mask};
use crate::progress::{Task, rest};

/// The configuration to change to. Nothing is sent until the change is done.
pub(super) static CHANGE: Signal<CriticalSectionRawMutex, UartConfig> = Signal::new();

/// Starts the receive path, and changes the line.
#[embassy_executor::task]
pub(crate) async fn change(adapter: &'static Adapter, mut uart: UartRx<'static, Blocking>, mut dma: Channel<'static>) {
    usart::set_transmit_requests(true);
    let mut config = UartConfig::default();
    let mut receiver = Receiver::new();
    let mut masked = mask(SERVICE);
    loop {
        // From the stop of the receive path to here the UART can hold a single byte: the service waits.
        byte_interrupt::set_coding(config.coding);
        let transfer = receiver.start(&mut dma);
        adapter.with(|bridge| receiver.pass_rest(bridge));
        wake();
        drop(masked);
        let resting = rest(Task::Line);
        let wanted = CHANGE.wait().await;
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
async fn configure(uart: &mut UartRx<'static, Blocking>, was: UartConfig, wanted: UartConfig) {
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
