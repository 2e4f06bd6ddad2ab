//! The board of the image: one of the list with the feature's chip.

use armwire_boards::{Board, Chip};

/// The chip.
const CHIP: Chip = if cfg!(feature = "board-rp2040") {
    Chip::Rp2040
} else if cfg!(feature = "board-stm32g431") {
    Chip::Stm32g431
} else {
    Chip::Stm32f405
};

/// This board's data.
pub(super) const THIS: &Board = match Board::find(match option_env!("ARMWIRE_BOARD") {
    Some(name) => name,
    None => CHIP.board(),
}) {
    Some(board) => board,
    None => panic!("ARMWIRE_BOARD is no board of armwire-boards"),
};

const _: () = assert!(THIS.chip as u8 == CHIP as u8, "ARMWIRE_BOARD has another chip");

/// True if the board has CAN.
pub(crate) const HAS_CAN: bool = THIS.can.is_some();

const _: () = assert!(
    HAS_CAN == cfg!(feature = "can"),
    "the feature `can` is that of boards with CAN"
);

/// The board's name.
pub(crate) const NAME: &str = THIS.name;
