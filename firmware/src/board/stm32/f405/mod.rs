//! An STM32F405RG, or an STM32F407, with a crystal and USB on PA11/PA12.
//!
//! Section numbers are those of RM0090.

mod boot;
mod can;
pub(super) mod capture;
mod clock;
mod flash;
pub(super) mod uart;
#[cfg(not(arm_at_usart3))]
mod usart2;
#[cfg(arm_at_usart3)]
mod usart3;
pub(in crate::board) mod usb;

use armwire_boards::{Chip, Port, Uart};
use armwire_bridge::PACKET;
use embassy_stm32::dma::{Channel, Request};
use embassy_stm32::gpio::Pull;
use embassy_stm32::interrupt::{Interrupt, InterruptExt};
use embassy_stm32::pac;
use embassy_stm32::pac::common::{RW, Reg};
use embassy_stm32::pac::otg::regs::Diepctl;
use embassy_stm32::peripherals::USB_OTG_FS;
use embassy_stm32::usart::{Config as UartConfig, UartRx};
use embassy_stm32::{bind_interrupts, usb as hal_usb};
use static_cell::StaticCell;

use super::can::Can;
use super::crystal;
use super::time::{self, TimerHandler};
use super::{Board, ChipReset, Led, THIS, UsbDriver, Watchdog, enable_clocks, pin, usart};
use crate::board::usb_driver::soon;
use crate::ceiling::DRIVERS;
use crate::service::ServiceHandler;
use crate::uart::SleepHandler;

pub(crate) use boot::enter_boot_loader;
pub(crate) use can::{Controller, Waiting};
pub(crate) use flash::{CONFIG_FLASH, ConfigFlash, FlashError, is_supply_low};
#[cfg(not(arm_at_usart3))]
pub(crate) use usart2::*;
#[cfg(arm_at_usart3)]
pub(crate) use usart3::*;

pub(in crate::board) const CHIP: Chip = Chip::Stm32f405;

pub(crate) const CAN_FD: bool = false;

bind_interrupts!(struct Irqs {
    // Ahead of the HAL's handler, which clears the events.
    OTG_FS => usb::SetupHandler, hal_usb::InterruptHandler<USB_OTG_FS>;
    // Ahead of the clock's handler, which clears all flags.
    TIM5 => SleepHandler, TimerHandler;
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

/// The clock: a 32-bit timer, its peripheral and its interrupt.
pub(super) const TIMER: pac::timer::TimGp32 = pac::TIM5;
/// Its input clock: twice that of APB1.
pub(super) const TIMER_HZ: u64 = 84_000_000;
/// See [`TIMER`].
pub(super) type TimerPeripheral = embassy_stm32::peripherals::TIM5;
/// See [`TIMER`].
pub(crate) type TimerInterrupt = embassy_stm32::interrupt::typelevel::TIM5;

/// The TX pin, and the number of its alternate function (DS8626, table 9).
pub(super) const TX_PIN: (pac::gpio::Gpio, usize, u8) = {
    let (port, pin) = pin::registers(THIS.uart.tx());
    (port, pin, 7)
};

/// The interrupt of a peripheral that is not used, for the [service](crate::service).
pub(crate) type ServiceInterrupt = embassy_stm32::interrupt::typelevel::SPI1;

/// The channel of the streams of USART2 and USART3, in each direction (RM0090 table 42).
pub(crate) const RX_REQUEST: Request = 4;
/// See [`RX_REQUEST`].
const TX_REQUEST: Request = 4;

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
        rx_dma: Channel::new(rx_dma, UartIrqs),
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

/// Starts the clock of a port of pins (7.3.10).
pub(super) fn enable_port(port: Port) {
    // GPIOAEN is bit 0, GPIOBEN bit 1, and so on.
    enable_clocks(pac::RCC.ahb1enr(), |w| w.0 |= 1 << port as u32);
}

/// Reads the cause of the last reset, and clears it for the next (RM0090 7.3.21).
pub(crate) fn take_reset() -> ChipReset {
    let cause = pac::RCC.csr().read();
    pac::RCC.csr().modify(|w| w.set_rmvf(true));
    if cause.porrstf() || cause.borrstf() {
        ChipReset::PowerOn
    } else if cause.wdgrstf() {
        ChipReset::Watchdog
    } else {
        ChipReset::Other
    }
}

/// Withdraws the packets in endpoints that the host will not fetch.
///
/// A bus reset leaves these endpoints enabled, and the HAL would wait forever for their packets (RM0090 34.17.6, "IN
/// endpoint disable").
pub(crate) fn cancel_unfetched_packets() {
    for endpoint in 1..usb::ENDPOINTS {
        let control = pac::USB_OTG_FS.diepctl(endpoint);
        if control.read().epena() {
            disable(control);
        }
    }
}

/// Withdraws the packet in an IN endpoint. Returns true if it was still unfetched (RM0090 34.17.6, "IN endpoint
/// disable").
pub(crate) fn cancel_unfetched_packet(endpoint: usize) -> bool {
    let (control, flags) = (pac::USB_OTG_FS.diepctl(endpoint), pac::USB_OTG_FS.diepint(endpoint));
    // The HAL's interrupt handler clears an endpoint's flags.
    critical_section::with(|_| {
        if !control.read().epena() {
            return false;
        }
        // Writing back EPENA as a one would restart a transfer that ended in between.
        control.modify(|w| {
            w.set_epena(false);
            w.set_snak(true);
        });
        // A packet on the wire is completed. It then counts as fetched.
        if !soon(|| flags.read().inepne()) {
            control.modify(|w| {
                w.set_epena(false);
                w.set_cnak(true);
            });
            return false;
        }
        if !control.read().epena() {
            return false;
        }
        disable(control);
        let is_back = soon(|| !control.read().epena());
        flush(endpoint) && is_back
    })
}

/// Begins to disable an IN endpoint. It answers with NAK.
fn disable(endpoint: Reg<Diepctl, RW>) {
    endpoint.modify(|w| {
        w.set_epena(false);
        w.set_snak(true);
        w.set_epdis(true);
    });
}

/// Flushes the transmit FIFO of a disabled endpoint. Returns true if it is empty.
fn flush(endpoint: usize) -> bool {
    let resets = pac::USB_OTG_FS.grstctl();
    resets.write(|w| {
        w.set_txfnum(endpoint as u8);
        w.set_txfflsh(true);
    });
    soon(|| !resets.read().txfflsh())
}
