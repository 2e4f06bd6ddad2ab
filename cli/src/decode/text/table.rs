//! Tables of a logic analyser, comma-separated, with a byte in each line.

/// Names of columns with bytes.
const NAMES: [&str; 2] = ["value", "data"];
/// A part of the name of a column whose bytes have no prefix.
const DECODER: &str = "uart";
/// The fewest columns of a table.
const MIN_COLUMNS: usize = 3;

/// The column that has the bytes.
pub(super) struct Column {
    index: usize,
    /// Number of columns.
    count: usize,
    /// Bytes are two digits without 0x.
    has_no_prefix: bool,
}

impl Column {
    /// The column in a line with the names of columns.
    pub(super) fn of(line: &str) -> Option<Self> {
        if line.matches(',').count() + 1 < MIN_COLUMNS {
            return None;
        }
        let names: Vec<_> = cells(line).map(str::to_ascii_lowercase).collect();
        let is_name = |name: &String| name.starts_with(|character: char| character.is_ascii_alphabetic());
        let is_number =
            |name: &String| name.starts_with(|character: char| character.is_ascii_digit()) && !name.contains(DECODER);
        if !names.first().is_some_and(is_name) || names.iter().any(is_number) {
            return None;
        }
        let find = |is: &dyn Fn(&str) -> bool| names.iter().position(|name| is(name));
        let (index, has_no_prefix) = match find(&|name| NAMES.contains(&name)) {
            Some(index) => (index, false),
            None => (find(&|name| name.contains(DECODER))?, true),
        };
        let count = names.len();
        Some(Self {
            index,
            count,
            has_no_prefix,
        })
    }

    /// Returns true if a line has as many columns.
    pub(super) fn is_row(&self, line: &str) -> bool {
        cells(line).count() == self.count
    }

    /// The byte in a line.
    pub(super) fn byte(&self, line: &str) -> Option<u8> {
        let cell = cells(line).nth(self.index)?;
        // Some have a character before it: 'A' (0x41).
        let number = cell
            .rsplit_once(" (")
            .map_or(cell, |(_, number)| number.trim_end_matches(')'));
        let digits = match number.strip_prefix("0x") {
            Some(digits) => digits,
            None => number.get(..2).filter(|_| self.has_no_prefix && number.len() == 2)?,
        };
        let are_digits = digits.bytes().all(|digit| digit.is_ascii_hexdigit());
        u8::from_str_radix(digits, 16).ok().filter(|_| are_digits)
    }
}

fn cells(line: &str) -> impl Iterator<Item = &str> {
    line.trim_end().split(',').map(|cell| cell.trim().trim_matches('"'))
}
