//! The measurements of a board.

use armwire_virtual_board::Nanos;

use crate::board::Board;
use crate::latency::Latency;
use crate::scenes::Figures;

/// The measurements of a board.
pub(crate) struct Measured {
    pub(crate) board: Board,
    pub(crate) latency: Latency,
    /// In the order of [`Scene::ALL`](crate::scenes::Scene::ALL).
    pub(crate) scenes: Vec<Option<Figures>>,
    /// Median latencies of an answer to USB and a request from USB without other load.
    pub(crate) quiet: [Nanos; 2],
}
