//! The start of the clocks, the pins, and the interrupts.

use embassy_rp::bind_interrupts;
use embassy_rp::interrupt::{Interrupt, InterruptExt, Priority};
use embassy_rp::peripherals::USB;
use embassy_rp::usb::{Driver, InterruptHandler as UsbHandler};

use super::{ConfigFlash, LESS_URGENT, Led, Watchdog, flash, time, uart, usb};
use crate::board::{TimerHandler, UsbDriver};
use crate::ceiling::DRIVERS;
use crate::service::ServiceHandler;
use crate::uart::state::STATE;
use crate::uart::{BurstHandler, Dma, IdleHandler, InterruptHandler, RingHandler, SentHandler, Uart};

bind_interrupts!(struct Irqs {
    // Ahead of the HAL's handler, which disables the interrupts that it has seen.
    USBCTRL_IRQ => usb::SetupHandler, UsbHandler<USB>;
    TIMER_IRQ_0 => TimerHandler;
    TIMER_IRQ_1 => BurstHandler;
    TIMER_IRQ_2 => IdleHandler;
    UART1_IRQ => InterruptHandler;
    DMA_IRQ_0 => RingHandler;
    DMA_IRQ_1 => SentHandler;
    SWI_IRQ_0 => ServiceHandler;
});

/// The interrupts of the UART, its DMA and its alarms.
const MOST_URGENT: [Interrupt; 5] = [
    Interrupt::UART1_IRQ,
    Interrupt::DMA_IRQ_0,
    Interrupt::DMA_IRQ_1,
    Interrupt::TIMER_IRQ_1,
    Interrupt::TIMER_IRQ_2,
];

/// The peripherals that the board provides.
pub(crate) struct Board {
    /// The status LED.
    pub(crate) led: Led,
    /// The arm's UART.
    pub(crate) uart: Uart,
    /// Its receive DMA.
    pub(crate) rx_dma: Dma,
    /// USB full speed.
    pub(crate) usb: UsbDriver,
    /// The flash with the configuration.
    pub(crate) flash: ConfigFlash,
}

/// Starts the clocks and takes the pins. Until then a pull-down holds the line to the arm (2.19.6.3): the chip starts
/// so.
pub(crate) fn init(_: &mut Watchdog) -> Board {
    let p = embassy_rp::init(embassy_rp::config::Config::default());
    uart::hold_tx_high();
    for interrupt in LESS_URGENT {
        interrupt.set_priority(DRIVERS);
    }
    time::start();
    let flash = flash::new(p.FLASH);
    STATE.usart.start();
    for interrupt in MOST_URGENT {
        interrupt.set_priority(Priority::P0);
        // SAFETY: the handlers share state with others in critical sections and atomics.
        unsafe { interrupt.enable() };
    }
    Board {
        led: Led::new(),
        uart: Uart,
        rx_dma: Dma,
        usb: UsbDriver(Driver::new(p.USB, Irqs)),
        flash,
    }
}
