//! The start of the clocks, the pins, and the interrupts.

use armwire_boards::Port;
use embassy_stm32::dma::{self, Channel};
use embassy_stm32::gpio::Pull;
use embassy_stm32::interrupt::{Interrupt, InterruptExt};
use embassy_stm32::peripherals::{DMA1_CH1, USB};
use embassy_stm32::usart::{Config as UartConfig, UartRx};
use embassy_stm32::{bind_interrupts, usb as hal_usb};

use super::super::sleep::hal_config;
use super::super::{Board, Can, Led, Watchdog, time, usart};
use super::{Controller, can, clock, enable_port, flash, usb};
use crate::board::{TimerHandler, UsbDriver};
use crate::ceiling::DRIVERS;
use crate::service::ServiceHandler;
use crate::uart::state::STATE;
use crate::uart::{InterruptHandler, RingHandler, SentHandler, SleepHandler};

bind_interrupts!(struct Irqs {
    // Ahead of the HAL's handler, which clears the flags.
    USB_LP => usb::EventHandler, hal_usb::InterruptHandler<USB>;
    // Ahead of the clock's handler, which clears all flags.
    TIM2 => SleepHandler, TimerHandler;
    USART2 => InterruptHandler;
    // Ahead of the HAL's handler, which clears the flags.
    DMA1_CHANNEL1 => RingHandler, dma::InterruptHandler<DMA1_CH1>;
    DMA1_CHANNEL2 => SentHandler;
    SPI1 => ServiceHandler;
    FDCAN1_IT0 => can::InterruptHandler;
});

/// The interrupts that are preempted by those of the UART and of its DMA.
const LESS_URGENT: [Interrupt; 3] = [Interrupt::USB_LP, Interrupt::TIM2, Interrupt::FDCAN1_IT0];

/// Starts the clocks and takes the pins. The line to the arm is high from the beginning.
pub(crate) fn init(watchdog: &mut Watchdog) -> Board {
    enable_port(Port::A);
    usart::hold_tx_high();
    let mut led = Led::new();
    let mut p = embassy_stm32::init(hal_config());
    let crystal = clock::start(&mut p.RCC, watchdog, &mut led);
    for interrupt in LESS_URGENT {
        interrupt.set_priority(DRIVERS);
    }
    time::start();
    info!("clock: 160 MHz, from a crystal of {=u32} MHz", crystal.megahertz());

    let mut line = UartConfig::default();
    line.baudrate = 1_000_000;
    // Without an arm the line must look idle.
    line.rx_pull = Pull::Up;
    let Ok(uart) = UartRx::new_blocking(p.USART2, p.PA3, line) else {
        unreachable!()
    };
    STATE.usart.set_half_duplex(false);
    usart::start_transmitter();

    Board {
        led,
        uart,
        rx_dma: Channel::new(p.DMA1_CH1, Irqs),
        usb: UsbDriver(hal_usb::Driver::new(p.USB, Irqs, p.PA12, p.PA11)),
        can: Can::new(Controller::new(p.FDCAN1)),
        flash: flash::new(p.FLASH),
    }
}
