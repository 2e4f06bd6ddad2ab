//! The settings in the page about CAN.

use crate::common::board::Board;
use crate::common::success;

const PAGE: &str = include_str!("../../../docs/can.md");

#[test]
fn page_has_every_can_setting_and_its_default() {
    let board = Board::start("page");
    let shown = success(&["config", &board.control]);
    let mut settings = 0;
    for (name, value) in shown.lines().filter_map(|line| line.split_once('=')) {
        let is_row = |line: &&str| line.starts_with(&format!("| `{name}` | "));
        let row = PAGE.lines().find(is_row);
        assert_eq!(row.is_some(), name.starts_with("can."), "{name}");
        let usual = row.and_then(|row| row.split(" | ").nth(2)).unwrap_or(value);
        assert!(usual.starts_with(value), "{name}: {usual}, not {value}");
        settings += usize::from(row.is_some());
    }
    assert!(settings >= 7, "{shown}");
}
