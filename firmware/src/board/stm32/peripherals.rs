//! The peripherals of the firmware.

use super::{Can, ConfigFlash, Led};
use crate::board::UsbDriver;
use crate::uart::{Dma, Uart};

/// The peripherals that the board provides.
pub(crate) struct Board {
    /// The status LED.
    pub(crate) led: Led,
    /// The arm's UART, for its line coding. The TX pin is not given to the HAL, which would leave it floating while the
    /// UART is disabled: see [`usart`](super::usart).
    pub(crate) uart: Uart,
    /// The receive DMA.
    pub(crate) rx_dma: Dma,
    /// USB full speed.
    pub(crate) usb: UsbDriver,
    /// The CAN bus, not yet started.
    pub(crate) can: Can,
    /// The flash with the configuration.
    pub(crate) flash: ConfigFlash,
}
