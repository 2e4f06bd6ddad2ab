//! The position of the receive DMA.

use super::super::state::SIZE;
use crate::board::usart;

/// The DMA's next write position in the ring.
pub(in crate::uart) fn tail() -> usize {
    (SIZE - usart::rx_remaining()) % SIZE
}
