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

/// Pins that boards use otherwise. `docs/boards.md` has the sources.
const USED: [(&str, &str); 8] = [
    // The user button and the memory card.
    ("weact-f405", "PC13 PC8 PC9 PC10 PC11 PC12 PD2 PA8"),
    // The user button.
    ("weact-g431", "PC13"),
    // The accelerometer, the button, the memory card and the other LEDs, two of which are the debugger's pins.
    ("pyboard", "PB2 PB5 PB3 PA8 PC8 PC9 PC10 PC11 PC12 PD2 PA13 PA14 PA15"),
    // The battery, the NeoPixel, the flash and the memory card.
    (
        "feather-f405",
        "PA2 PA3 PC0 PA15 PB3 PB4 PB5 PB12 PC8 PC9 PC10 PC11 PC12 PD2",
    ),
    // The button.
    ("olimex-h405", "PA0"),
    // The flash, the button and the other LED.
    ("black-f407ve", "PB0 PB3 PB4 PB5 PA0 PA7"),
    // The audio DAC, the accelerometer, the microphone, the button, USB's power switch and the other LEDs.
    (
        "f4-discovery",
        "PB6 PB9 PD4 PA4 PC7 PC10 PC12 PA5 PA6 PA7 PB10 PC3 PA0 PC0 PD5 PD13 PD14 PD15",
    ),
    // The regulator's mode, and the measurement of USB's and the supply's voltage; the radio chip of a Pico W.
    ("pico", "GP23 GP24 GP29"),
];

#[test]
fn pins_that_a_board_uses_are_left_alone() {
    for (name, used) in USED {
        let board = Board::find(name).unwrap();
        let can = board.can.into_iter().flat_map(|can| [can.rx, can.tx]);
        for pin in can.chain([board.uart.tx(), board.uart.rx(), board.led.pin]) {
            let name_of_pin = pin.to_string();
            assert!(used.split(' ').all(|used| used != name_of_pin), "{name}: {pin}");
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
        let pins = board.can.map(|pins| std::format!("{}, {}", pins.rx, pins.tx));
        assert_eq!(can, pins.as_deref().unwrap_or("none"));
        let level = if board.led.on { "high is on" } else { "low is on" };
        let (pin, rest) = led.split_once([' ', ',']).unwrap();
        assert_eq!(pin, board.led.pin.to_string(), "{row}");
        assert!(rest.ends_with(level), "{row}");
    }
}
