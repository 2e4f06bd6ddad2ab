//! The peripherals that the drivers use.

use embassy_rp::interrupt::Interrupt;

pub(crate) const CAN_FD: bool = false;

/// A poll is prepared after its alarm, and later if a task uses the bridge at that time: four times the lead time of an
/// STM32.
pub(crate) const POLL_LEAD_TIME: armwire_bridge::Duration = armwire_bridge::Duration::from_micros(100);

/// The interrupts of drivers: those of the UART, its DMA and its alarms preempt them.
pub(super) const LESS_URGENT: [Interrupt; 2] = [Interrupt::USBCTRL_IRQ, Interrupt::TIMER_IRQ_0];

/// The interrupt for errors of the arm's UART.
pub(crate) type UartInterrupt = embassy_rp::interrupt::typelevel::UART1_IRQ;
/// The interrupt of the receive DMA.
pub(crate) type RxInterrupt = embassy_rp::interrupt::typelevel::DMA_IRQ_0;
/// The interrupt of the transmit DMA.
pub(crate) type TxInterrupt = embassy_rp::interrupt::typelevel::DMA_IRQ_1;
/// The interrupt of the alarm of the next timer.
pub(crate) type TimerInterrupt = embassy_rp::interrupt::typelevel::TIMER_IRQ_0;
/// The interrupt of the alarm of a burst.
pub(crate) type BurstInterrupt = embassy_rp::interrupt::typelevel::TIMER_IRQ_1;
/// The interrupt of the alarm for an idle line.
pub(crate) type IdleInterrupt = embassy_rp::interrupt::typelevel::TIMER_IRQ_2;
/// An interrupt without a peripheral (2.3.2), for the [service](crate::service).
pub(crate) type ServiceInterrupt = embassy_rp::interrupt::typelevel::SWI_IRQ_0;
