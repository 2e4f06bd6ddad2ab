//! Tables of a logic analyser, with a byte in each line.

use super::stamp;
use crate::decode::log::decimal;

/// Names of columns with bytes.
const NAMES: [&str; 3] = ["value", "data", "decoded protocol result"];
/// A part of the name of a column whose bytes have no prefix.
const DECODER: &str = "uart";
/// Columns of Saleae's tables: numbers without a prefix are decimal.
const OF_SALEAE: [&str; 2] = ["parity error", "start_time"];
/// The beginnings of the names of columns with times, and the ends of those that are not in seconds, with the number of
/// decimals to a nanosecond.
const TIMES: [&str; 2] = ["time", "start"];
const UNITS: [(&str, usize); 3] = [("[ns]", 0), ("[us]", 3), ("[ms]", 6)];
/// The marks between columns.
const SEPARATORS: [char; 3] = [',', ';', '\t'];
/// The fewest columns of a table.
const MIN_COLUMNS: usize = 3;

/// The column that has the bytes.
pub(super) struct Column {
    separator: char,
    index: usize,
    /// Number of columns.
    count: usize,
    base: Base,
    /// The column of times, and the number of decimals to a nanosecond.
    time: Option<(usize, usize)>,
}

/// The base of numbers without a prefix.
enum Base {
    Unknown,
    Decimal,
    /// Two digits.
    Hexadecimal,
}

impl Column {
    /// The column in a line with the names of columns.
    pub(super) fn of(line: &str) -> Option<Self> {
        let is_separator = |mark: &char| line.matches(*mark).count() + 1 >= MIN_COLUMNS;
        let separator = SEPARATORS.into_iter().find(is_separator)?;
        let names: Vec<_> = cells(line, separator).map(str::to_ascii_lowercase).collect();
        let is_name = |name: &String| name.starts_with(|character: char| character.is_ascii_alphabetic());
        let is_number =
            |name: &String| name.starts_with(|character: char| character.is_ascii_digit()) && !name.contains(DECODER);
        if !names.first().is_some_and(is_name) || names.iter().any(is_number) {
            return None;
        }
        let find = |is: &dyn Fn(&str) -> bool| names.iter().position(|name| is(name));
        let is_decimal = find(&|name| OF_SALEAE.contains(&name)).is_some();
        let (index, base) = match find(&|name| NAMES.contains(&name)) {
            Some(index) if is_decimal => (index, Base::Decimal),
            Some(index) => (index, Base::Unknown),
            None => (find(&|name| name.contains(DECODER))?, Base::Hexadecimal),
        };
        let time = find(&|name| TIMES.iter().any(|time| name.starts_with(time)));
        let unit = |index: usize| {
            let unit = UNITS.iter().find(|(end, _)| names[index].ends_with(end));
            (index, unit.map_or(stamp::SECONDS, |(_, decimals)| *decimals))
        };
        Some(Self {
            separator,
            index,
            count: names.len(),
            base,
            time: time.map(unit),
        })
    }

    /// Returns true if a line has as many columns.
    pub(super) fn is_row(&self, line: &str) -> bool {
        cells(line, self.separator).count() == self.count
    }

    /// Returns true if a line has columns, perhaps another number of them.
    pub(super) fn has_columns(&self, line: &str) -> bool {
        line.contains(self.separator)
    }

    /// The time of a row in ns.
    pub(super) fn nanos(&self, line: &str) -> Option<u64> {
        let (index, decimals) = self.time?;
        let cell = cells(line, self.separator).nth(index)?;
        decimal(cell, decimals).or_else(|| stamp::of_line(cell))
    }

    /// The byte in a line.
    pub(super) fn byte(&self, line: &str) -> Option<u8> {
        let cell = cells(line, self.separator).nth(self.index)?;
        // Some have a character before it: 'A' (0x41).
        let number = cell
            .rsplit_once(" (")
            .map_or(cell, |(_, number)| number.trim_end_matches(')'));
        let (digits, base) = match (number.split_at_checked(2), &self.base) {
            (Some(("0x", digits)), _) => (digits, 16),
            (Some(("0b", digits)), _) => (digits, 2),
            (_, Base::Decimal) => (number, 10),
            (Some((digits, "")), Base::Hexadecimal) => (digits, 16),
            _ => return None,
        };
        // Groups of bits have spaces between them.
        let digits = digits.replace(' ', "");
        let are_digits = digits.chars().all(|digit| digit.is_digit(base));
        u8::from_str_radix(&digits, base).ok().filter(|_| are_digits)
    }
}

fn cells(line: &str, separator: char) -> impl Iterator<Item = &str> {
    line.trim_end_matches(['\r', '\n', ' '])
        .split(separator)
        .map(|cell| cell.trim().trim_matches('"'))
}
