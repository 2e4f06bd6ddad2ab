//! armwire-virtual-board
