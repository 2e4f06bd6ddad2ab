//! A Raspberry Pi Pico: an RP2040 with a crystal of 12 MHz, 2 MB of flash, USB, and the arm on GP4/GP5. It has no CAN.
//! It has not been tried on hardware.
//!
//! Section numbers are those of the RP2040 datasheet.

mod boot;
mod flash;
mod mask;
pub(super) mod time;
pub(crate) mod uart;
pub(super) mod usb;

use armwire_boards::Chip;
use embassy_rp::bind_interrupts;
use embassy_rp::gpio::{AnyPin, Level, Output};
use embassy_rp::interrupt::{Interrupt, InterruptExt};
use embassy_rp::pac;
use embassy_rp::peripherals::{USB, WATCHDOG};
use embassy_rp::usb::{Driver, InterruptHandler as UsbHandler};
use embassy_time::Duration;

use super::{ChipReset, THIS, UsbDriver};
use crate::ceiling::DRIVERS;
use crate::service::ServiceHandler;
use crate::uart::{Dma, IdleHandler, InterruptHandler, RingHandler, SentHandler, Uart};
use time::{BurstHandler, TimerHandler};

pub(crate) use boot::enter_boot_loader;
pub(crate) use embassy_rp as hal;
pub(crate) use flash::{CONFIG_FLASH, ConfigFlash, FlashError, is_supply_low, serial_number};
pub(crate) use mask::mask;
pub(crate) use time::{clear_idle_alarm, has_passed, set_idle_alarm, transmit_at};
pub(crate) use uart as usart;
pub(crate) use usb::{cancel_unfetched_packet, cancel_unfetched_packets};

/// The chip.
pub(super) const CHIP: Chip = Chip::Rp2040;

pub(crate) const CAN_FD: bool = false;

/// A poll is prepared after its alarm, and later if a task uses the bridge at that time: four times the lead time of an
/// STM32.
pub(crate) const POLL_LEAD_TIME: armwire_bridge::Duration = armwire_bridge::Duration::from_micros(100);

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

/// The interrupts of drivers: those of the UART, its DMA and its alarms preempt them.
const LESS_URGENT: [Interrupt; 2] = [Interrupt::USBCTRL_IRQ, Interrupt::TIMER_IRQ_0];
/// The interrupts of the UART, its DMA and its alarms.
const MOST_URGENT: [Interrupt; 5] = [
    Interrupt::UART1_IRQ,
    Interrupt::DMA_IRQ_0,
    Interrupt::DMA_IRQ_1,
    Interrupt::TIMER_IRQ_1,
    Interrupt::TIMER_IRQ_2,
];

/// The interrupt for errors of the arm's UART.
pub(crate) type UartInterrupt = embassy_rp::interrupt::typelevel::UART1_IRQ;
/// The interrupt of the receive DMA.
pub(crate) type RxInterrupt = embassy_rp::interrupt::typelevel::DMA_IRQ_0;
/// The interrupt of the transmit DMA.
pub(crate) type TxInterrupt = embassy_rp::interrupt::typelevel::DMA_IRQ_1;
/// The interrupt of the alarm for an idle line.
pub(crate) type IdleInterrupt = embassy_rp::interrupt::typelevel::TIMER_IRQ_2;
/// An interrupt without a peripheral (2.3.2), for the [service](crate::service).
pub(crate) type ServiceInterrupt = embassy_rp::interrupt::typelevel::SWI_IRQ_0;

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

/// The status LED.
pub(crate) struct Led(Output<'static>);

impl Led {
    /// Takes the pin. The LED is off.
    fn new() -> Self {
        // SAFETY: nothing else has the pin.
        let pin = unsafe { AnyPin::steal(THIS.led.pin.1) };
        Self(Output::new(pin, Level::from(!THIS.led.on)))
    }

    /// Switches the LED on or off.
    pub(crate) fn set(&mut self, on: bool) {
        self.0.set_level(Level::from(on == THIS.led.on));
    }
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
    uart::start();
    for interrupt in MOST_URGENT {
        interrupt.set_priority(embassy_rp::interrupt::Priority::P0);
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

/// Reads the cause of the last reset. The chip clears it at the next (2.12.7, 4.7.6).
pub(crate) fn take_reset() -> ChipReset {
    let watchdog = pac::WATCHDOG.reason().read();
    if watchdog.timer() {
        ChipReset::Watchdog
    } else if !watchdog.force() && pac::VREG_AND_CHIP_RESET.chip_reset().read().had_por() {
        ChipReset::PowerOn
    } else {
        ChipReset::Other
    }
}

/// The watchdog. Its ticks come from the crystal: it counts from [`init`] on.
pub(crate) struct Watchdog {
    hal: embassy_rp::watchdog::Watchdog,
    timeout: Duration,
}

impl Watchdog {
    /// Starts the watchdog. Only a reset stops it. Call this once.
    pub(crate) fn start(timeout_us: u32) -> Self {
        // SAFETY: no other code takes it.
        let mut hal = embassy_rp::watchdog::Watchdog::new(unsafe { WATCHDOG::steal() });
        let timeout = Duration::from_micros(timeout_us.into());
        hal.start(timeout);
        Self { hal, timeout }
    }

    /// Starts the timeout again.
    pub(crate) fn pet(&mut self) {
        self.hal.feed(self.timeout);
    }
}

/// Restarts the chip with all peripherals. A reset by the core's own register would leave these as they are.
pub(crate) fn reset() -> ! {
    // SAFETY: nothing else runs from here on.
    embassy_rp::watchdog::Watchdog::new(unsafe { WATCHDOG::steal() }).trigger_reset();
    loop {
        cortex_m::asm::nop();
    }
}
