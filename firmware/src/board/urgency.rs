//! The priorities of interrupt handlers, below that of the UART and its DMA.

use super::hal::interrupt::Priority;

/// The priority of the handlers of USB, the timer and CAN. Those of the UART and its DMA have a higher one.
pub(crate) const DRIVERS: Priority = Priority::P1;
/// The priority of the [service](crate::service), the lowest.
pub(crate) const SERVICE: Priority = Priority::P2;
