//! An STM32G431CB with a crystal, USB on PA11/PA12 and the arm on PA2/PA3. It has not been tried on hardware:
//! `docs/porting.md` lists the points to check.
//!
//! Section numbers are those of RM0440.

mod boot;
mod can;
pub(super) mod capture;
mod clock;
mod flash;
pub(super) mod uart;
pub(in crate::board) mod usb;

use armwire_boards::{Chip, Port};
use embassy_stm32::dma::{self, Channel, Request};
use embassy_stm32::gpio::Pull;
use embassy_stm32::interrupt::{Interrupt, InterruptExt};
use embassy_stm32::pac;
use embassy_stm32::peripherals::{DMA1_CH1, USB};
use embassy_stm32::usart::{Config as UartConfig, UartRx};
use embassy_stm32::{bind_interrupts, usb as hal_usb};

use super::can::Can;
use super::time::{self, TimerHandler};
use super::{Board, ChipReset, Led, UsbDriver, Watchdog, enable_clocks, usart};
use crate::ceiling::DRIVERS;
use crate::service::ServiceHandler;
use crate::uart::{InterruptHandler, RingHandler, SentHandler, SleepHandler};

pub(crate) use boot::enter_boot_loader;
pub(crate) use can::{Controller, Waiting};
pub(crate) use flash::{CONFIG_FLASH, ConfigFlash, FlashError, is_supply_low};
pub(crate) use usb::{cancel_unfetched_packet, cancel_unfetched_packets};

pub(in crate::board) const CHIP: Chip = Chip::Stm32g431;

pub(crate) const CAN_FD: bool = true;

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

/// The clock: a 32-bit timer, its peripheral and its interrupt.
pub(super) const TIMER: pac::timer::TimGp32 = pac::TIM2;
/// Its input clock: that of APB1.
pub(super) const TIMER_HZ: u64 = 160_000_000;
/// See [`TIMER`].
pub(super) type TimerPeripheral = embassy_stm32::peripherals::TIM2;
/// See [`TIMER`].
pub(crate) type TimerInterrupt = embassy_stm32::interrupt::typelevel::TIM2;

/// The registers of the arm's UART.
pub(super) const UART: pac::usart::Usart = pac::USART2;

/// The TX pin, PA2, and the number of its alternate function (DS12589, table 13).
pub(super) const TX_PIN: (pac::gpio::Gpio, usize, u8) = (pac::GPIOA, 2, 7);

/// The interrupt of the arm's UART.
pub(crate) type UartInterrupt = embassy_stm32::interrupt::typelevel::USART2;

/// The interrupt of its receive DMA channel.
pub(crate) type RxInterrupt = embassy_stm32::interrupt::typelevel::DMA1_CHANNEL1;

/// The interrupt of its transmit DMA channel.
pub(crate) type TxInterrupt = embassy_stm32::interrupt::typelevel::DMA1_CHANNEL2;

/// The interrupt of a peripheral that is not used, for the [service](crate::service).
pub(crate) type ServiceInterrupt = embassy_stm32::interrupt::typelevel::SPI1;

/// The numbers of the receive and the transmit channel on DMA1, from 0.
const RX_CHANNEL: usize = 0;
/// See [`RX_CHANNEL`].
const TX_CHANNEL: usize = 1;

/// The DMAMUX inputs of USART2_RX and, below, USART2_TX (RM0440 13.3.2, assignment of inputs to resources).
pub(crate) const RX_REQUEST: Request = 26;
/// See [`RX_REQUEST`].
const TX_REQUEST: Request = 27;

/// Starts the clocks and takes the pins. The line to the arm is high from the beginning.
pub(crate) fn init(watchdog: &mut Watchdog) -> Board {
    enable_port(Port::A);
    usart::hold_tx_high();
    let mut led = Led::new();
    let mut p = embassy_stm32::init(embassy_stm32::Config::default());
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
    usart::set_half_duplex(false);
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

/// Starts the clock of a port of pins (7.4.14).
pub(super) fn enable_port(port: Port) {
    // GPIOAEN is bit 0, GPIOBEN bit 1, and so on.
    enable_clocks(pac::RCC.ahb2enr(), |w| w.0 |= 1 << port as u32);
}

/// Reads the cause of the last reset, and clears it for the next (RM0440 7.4, RCC_CSR).
pub(crate) fn take_reset() -> ChipReset {
    let cause = pac::RCC.csr().read();
    pac::RCC.csr().modify(|w| w.set_rmvf(true));
    if cause.borrstf() {
        ChipReset::PowerOn
    } else if cause.iwdgrstf() {
        ChipReset::Watchdog
    } else {
        ChipReset::Other
    }
}
