//! The arm's UART: circular DMA for reception, DMA for transmission.
//!
//! The bridge gives the last byte of the next frame or, once known, the number of bytes before anything can be due. The
//! chip's part finds the byte that completes the frame, records the time of its arrival, and wakes the service.

mod change;
mod receive;
#[cfg(feature = "board-rp2040")]
mod rp2040;
pub(crate) mod state;
#[cfg(feature = "stm32")]
mod stm32;
mod transmit;

#[cfg(feature = "board-rp2040")]
use rp2040 as chip;
#[cfg(feature = "stm32")]
use stm32 as chip;

pub(crate) use change::change;
#[cfg(feature = "stm32")]
pub(crate) use chip::SleepHandler;
#[cfg(feature = "board-rp2040")]
pub(crate) use chip::{BurstHandler, IdleHandler, stall};
pub(crate) use chip::{Dma, InterruptHandler, RingHandler, Uart};
pub(crate) use receive::{Reader, wait};
pub(crate) use state::{take_event, wake};
pub(crate) use transmit::{Sender, SentHandler};
