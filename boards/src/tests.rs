extern crate std;

use std::string::ToString;

use super::*;

#[test]
fn names_are_unique_and_fit_the_identity() {
    for board in BOARDS {
        assert_eq!(Board::find(board.name), Some(board));
        assert!((1..=16).contains(&board.name.len()), "{board:?}");
        let plain = |letter: char| matches!(letter, 'a'..='z' | '0'..='9' | '-');
        assert!(board.name.chars().all(plain), "{board:?}");
    }
    for name in ["", "stm32f40", "stm32f4050", "STM32F405"] {
        assert_eq!(Board::find(name), None);
    }
}

#[test]
fn each_chip_has_a_board_of_its_name() {
    for board in BOARDS {
        let generic = Board::find(board.chip.name());
        assert_eq!(generic.map(|generic| generic.chip), Some(board.chip));
    }
}

#[test]
fn pin_is_named_as_in_data_sheets() {
    assert_eq!(Pin(Port::B, 8).to_string(), "PB8");
    assert_eq!(Pin(Port::A, 15).to_string(), "PA15");
}
