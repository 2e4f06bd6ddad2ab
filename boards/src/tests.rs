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
fn each_chip_has_a_board() {
    for board in BOARDS {
        let generic = Board::find(board.chip.board());
        assert_eq!(generic.map(|generic| generic.chip), Some(board.chip));
    }
}

#[test]
fn pin_is_named_as_in_data_sheets() {
    assert_eq!(Pin(Port::B, 8).to_string(), "PB8");
    assert_eq!(Pin(Port::A, 15).to_string(), "PA15");
    assert_eq!(Pin(Port::Gp, 25).to_string(), "GP25");
}

/// Pins that boards use otherwise, on ports A to D. `docs/boards.md` has the sources.
const USED: &[(&str, &[Pin])] = {
    use Port::*;
    &[
        // The user button and the memory card.
        (
            "weact-f405",
            &[
                Pin(C, 13),
                Pin(C, 8),
                Pin(C, 9),
                Pin(C, 10),
                Pin(C, 11),
                Pin(C, 12),
                Pin(D, 2),
                Pin(A, 8),
            ],
        ),
        // The user button.
        ("weact-g431", &[Pin(C, 13)]),
        // The accelerometer, the button, the memory card and the other LEDs, two of which are the debugger's pins.
        (
            "pyboard",
            &[
                Pin(B, 2),
                Pin(B, 5),
                Pin(B, 3),
                Pin(A, 8),
                Pin(C, 8),
                Pin(C, 9),
                Pin(C, 10),
                Pin(C, 11),
                Pin(C, 12),
                Pin(D, 2),
                Pin(A, 13),
                Pin(A, 14),
                Pin(A, 15),
            ],
        ),
        // The battery, the NeoPixel, the flash and the memory card.
        (
            "feather-f405",
            &[
                Pin(A, 2),
                Pin(A, 3),
                Pin(C, 0),
                Pin(A, 15),
                Pin(B, 3),
                Pin(B, 4),
                Pin(B, 5),
                Pin(B, 12),
                Pin(C, 8),
                Pin(C, 9),
                Pin(C, 10),
                Pin(C, 11),
                Pin(C, 12),
                Pin(D, 2),
            ],
        ),
        // The button.
        ("olimex-h405", &[Pin(A, 0)]),
        // The flash, the button and the other LED.
        (
            "black-f407ve",
            &[Pin(B, 0), Pin(B, 3), Pin(B, 4), Pin(B, 5), Pin(A, 0), Pin(A, 7)],
        ),
        // The audio DAC, the accelerometer, the microphone, the button, USB's power switch and the other LEDs.
        (
            "f4-discovery",
            &[
                Pin(B, 6),
                Pin(B, 9),
                Pin(D, 4),
                Pin(A, 4),
                Pin(C, 7),
                Pin(C, 10),
                Pin(C, 12),
                Pin(A, 5),
                Pin(A, 6),
                Pin(A, 7),
                Pin(B, 10),
                Pin(C, 3),
                Pin(A, 0),
                Pin(C, 0),
                Pin(D, 5),
                Pin(D, 13),
                Pin(D, 14),
                Pin(D, 15),
            ],
        ),
    ]
};

#[test]
fn pins_that_a_board_uses_are_left_alone() {
    for (name, used) in USED {
        let board = Board::find(name).unwrap();
        let can = board.can.into_iter().flat_map(|can| [can.rx, can.tx]);
        for pin in can.chain([board.uart.tx(), board.uart.rx(), board.led.pin]) {
            assert!(!used.contains(&pin), "{name}: {pin}");
        }
    }
}

#[test]
fn page_lists_every_board() {
    let page = include_str!("../../docs/boards.md");
    for board in BOARDS {
        let start = std::format!("| `{}` | {} |", board.name, board.title);
        let row = page.lines().find(|line| line.starts_with(&start)).expect(&start);
        let cells: std::vec::Vec<_> = row.split('|').map(str::trim).collect();
        let &[_, _, _, _, _, crystal, led, can, _] = &*cells else {
            panic!("{row}");
        };
        assert_eq!(crystal, std::format!("{} MHz", board.crystal));
        assert_eq!(can, std::format!("{}, {}", board.can.rx, board.can.tx));
        let level = if board.led.on { "high is on" } else { "low is on" };
        let (pin, rest) = led.split_once([' ', ',']).unwrap();
        assert_eq!(pin, board.led.pin.to_string(), "{row}");
        assert!(rest.ends_with(level), "{row}");
    }
}
