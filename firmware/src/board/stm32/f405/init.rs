//! The start of the clocks, the pins, and the interrupts.

use armwire_boards::Uart;
use armwire_bridge::PACKET;
use embassy_stm32::dma::{self, Channel};
use embassy_stm32::gpio::Pull;
use embassy_stm32::interrupt::{Interrupt, InterruptExt};
use embassy_stm32::pac;
use embassy_stm32::peripherals::USB_OTG_FS;
use embassy_stm32::usart::{Config as UartConfig, UartRx};
use embassy_stm32::{bind_interrupts, usb as hal_usb};
use static_cell::StaticCell;

use super::super::rcc::enable_clocks;
use super::super::{Board, Can, Led, Watchdog, crystal, time, usart};
use super::{Controller, Peripheral, RxDma, RxPin, can, clock, enable_port, flash, usb};
use crate::board::this::THIS;
use crate::board::{TimerHandler, UsbDriver};
use crate::ceiling::DRIVERS;
use crate::service::ServiceHandler;
use crate::uart::{InterruptHandler, RingHandler, SentHandler, SleepHandler};

bind_interrupts!(struct Irqs {
    // Ahead of the HAL's handler, which clears the events.
    OTG_FS => usb::SetupHandler, hal_usb::InterruptHandler<USB_OTG_FS>;
    // Ahead of the clock's handler, which clears all flags.
    TIM5 => SleepHandler, TimerHandler;
    #[cfg(not(arm_at_usart3))]
    USART2 => InterruptHandler;
    #[cfg(not(arm_at_usart3))]
    DMA1_STREAM5 => RingHandler, dma::InterruptHandler<RxDma>;
    #[cfg(not(arm_at_usart3))]
    DMA1_STREAM6 => SentHandler;
    #[cfg(arm_at_usart3)]
    USART3 => InterruptHandler;
    #[cfg(arm_at_usart3)]
    DMA1_STREAM1 => RingHandler, dma::InterruptHandler<RxDma>;
    #[cfg(arm_at_usart3)]
    DMA1_STREAM3 => SentHandler;
    SPI1 => ServiceHandler;
    CAN1_TX => can::TransmitHandler;
    CAN1_RX0 => can::ReceiveHandler;
    CAN1_SCE => can::StatusHandler;
});

/// The interrupts that are preempted by those of the UART and of its DMA.
const LESS_URGENT: [Interrupt; 5] = [
    Interrupt::OTG_FS,
    Interrupt::TIM5,
    Interrupt::CAN1_TX,
    Interrupt::CAN1_RX0,
    Interrupt::CAN1_SCE,
];

/// Starts the clocks and takes the pins. The line to the arm is high from the beginning.
pub(crate) fn init(watchdog: &mut Watchdog) -> Board {
    enable_port(THIS.uart.tx().0);
    usart::hold_tx_high();
    let mut led = Led::new();
    enable_clocks(pac::RCC.apb1enr(), |w| w.set_tim5en(true));
    let crystal = crystal::start(watchdog, &mut led);
    let p = embassy_stm32::init(clock::config(crystal));
    clock::accelerate_flash();
    for interrupt in LESS_URGENT {
        interrupt.set_priority(DRIVERS);
    }
    time::start();
    info!("clock: 168 MHz, from a crystal of {=u32} MHz", crystal.megahertz());

    let mut line = UartConfig::default();
    line.baudrate = 1_000_000;
    // Without an arm the line must look idle.
    line.rx_pull = Pull::Up;
    // SAFETY: nothing else has the UART, its RX pin and its receive stream.
    let (uart, rx, rx_dma) = unsafe { (Peripheral::steal(), RxPin::steal(), RxDma::steal()) };
    let Ok(uart) = UartRx::new_blocking(uart, rx, line) else {
        unreachable!()
    };
    usart::start_transmitter();

    // One packet for each of the three OUT endpoints.
    static OUT_PACKETS: StaticCell<[u8; 3 * PACKET]> = StaticCell::new();
    let mut usb = hal_usb::Config::default();
    // VBUS is not connected to PA9 on most boards; without detection the adapter counts as plugged in.
    usb.vbus_detection = false;

    Board {
        led,
        uart,
        rx_dma: Channel::new(rx_dma, Irqs),
        usb: UsbDriver(hal_usb::Driver::new_fs(
            p.USB_OTG_FS,
            Irqs,
            p.PA12,
            p.PA11,
            OUT_PACKETS.init([0; 3 * PACKET]),
            usb,
        )),
        can: Can::new(Controller::new(p.CAN1)),
        flash: flash::new(p.FLASH),
    }
}

const _: () = assert!(
    matches!(THIS.uart, Uart::Usart3) == cfg!(arm_at_usart3),
    "the UART of `build.rs`"
);
