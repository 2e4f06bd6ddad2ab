//! Hex dumps with a column of offsets.
//!
//! | Program | Offset | Words |
//! |---|---|---|
//! | `xxd` | 8 digits or more and a colon, base 16, or 10 with `-d` | bytes in file order, in groups of any size |
//! | `xxd -e` | the same | little-endian |
//! | `xxd -b` | the same | bits |
//! | `hexdump -C` | 8 digits, base 16 | bytes |
//! | `hexdump` | 7 digits, base 16 | 16 bits, little-endian |
//! | `od -t x1`, `-x`, `-t x4`, `-t x8` | 7 digits, base 8 or 10, or 6 digits, base 16 | 8 to 64 bits, little-endian |
//!
//! A column of characters may be behind the words, in `hexdump -C` between bars, in `od -t x1z` between angle brackets. A
//! line `*` stands for repetitions of the line before it. `hexdump` and `od` end with the offset of the end. A heading
//! with the numbers of the columns is skipped. An offset of 0 begins a new dump.

use super::column::before_column;
use super::logged::{Log, without_escapes};
use super::word::{Word, words};
use crate::decode::doubts::{Doubt, Place};
use crate::decode::lines::LineReader;
use crate::decode::unit::{Bytes, Read, Take, Unit};
use crate::hex;

/// Maximum number of bytes that a line `*` stands for.
const MAX_REPEATED: u64 = 16 * 1024 * 1024;
/// The shortest offset with a colon, and without one, in digits.
const MIN_OFFSET: (usize, usize) = (2, 4);
/// The longest offset, in digits.
const MAX_OFFSET: usize = 16;
/// Maximum number of lines before the order of bytes is known.
const MAX_WAITING: usize = 64;
/// Minimum length of a line that ends the wait, in bytes.
const MAX_WAITING_LEN: usize = 1024;
/// The bases of offsets, the more common first.
const BASES: [u32; 3] = [16, 8, 10];

/// A line of a dump.
#[derive(Debug, PartialEq)]
pub(in super::super) enum Line<'a> {
    /// `*`.
    Repeated,
    Data(Row<'a>),
}

/// A line with an offset.
#[derive(Debug, PartialEq)]
pub(in super::super) struct Row<'a> {
    pub(in super::super) offset: &'a str,
    /// The offset has a colon or a bar.
    pub(in super::super) has_colon: bool,
    pub(in super::super) words: Vec<Word<'a>>,
    /// The orders of bytes in which a column has the characters of the words; `None` without a column.
    column: Option<Vec<Order>>,
}

impl Row<'_> {
    pub(in super::super) fn has_column(&self) -> bool {
        self.column.is_some()
    }

    /// The length of the longest word, in digits.
    pub(in super::super) fn widest(&self) -> usize {
        self.words.iter().map(|word| word.text.len()).max().unwrap_or_default()
    }

    /// Returns true if the order of bytes makes no difference.
    fn is_same_in_any_order(&self) -> bool {
        bytes_of(&self.words, Order::Big) == bytes_of(&self.words, Order::Little)
    }
}

/// Splits a line into its columns. `None` if it is no line of a dump.
pub(in super::super) fn columns(line: &str) -> Option<Line<'_>> {
    if line.trim() == "*" {
        return Some(Line::Repeated);
    }
    let mut all = words(line);
    let first = all.next()?.text;
    let (offset, has_colon) = first
        .strip_suffix([':', '|'])
        .map_or((first, false), |offset| (offset, true));
    let offset = offset.strip_prefix("0x").unwrap_or(offset);
    let min = if has_colon { MIN_OFFSET.0 } else { MIN_OFFSET.1 };
    if !(min..=MAX_OFFSET).contains(&offset.len()) || !is_hex(offset) {
        return None;
    }
    // A dash may be between offset and words, and in the middle of them.
    let words = all.filter(|word| word.text != "-");
    let mut words: Vec<_> = words.map(Word::without_prefix).collect();
    let count = words.iter().take_while(|word| is_hex(word.text)).count();
    let before = |order| before_column(line, &words[..count], |word| word_bytes(word, order).ok());
    let mut found: Vec<_> = Order::ALL
        .into_iter()
        .filter_map(|order| Some((before(order)?, order)))
        .collect();
    let column = match found.iter().map(|(count, _)| *count).max() {
        Some(count) => {
            words.truncate(count);
            found.retain(|(there, _)| *there == count);
            Some(found.into_iter().map(|(_, order)| order).collect())
        }
        None if words.get(count).is_some_and(|word| word.text.starts_with(['|', '>'])) => {
            // The characters are others.
            words.truncate(count);
            Some(Vec::new())
        }
        None if count == words.len() => None,
        None => return None,
    };
    Some(Line::Data(Row {
        offset,
        has_colon,
        words,
        column,
    }))
}

/// Returns true for the heading of a dump, such as `Offset(h) 00 01 02 03 04 05 06 07`.
pub(in super::super) fn is_ruler(line: &str) -> bool {
    let mut words = line.split_whitespace().peekable();
    while words.next_if(|word| u8::from_str_radix(word, 16) != Ok(0)).is_some() {}
    let numbers: Vec<_> = words.take(8).map(|word| u8::from_str_radix(word, 16).ok()).collect();
    numbers == [0, 1, 2, 3, 4, 5, 6, 7].map(Some)
}

/// Returns true if the line begins with a number and a colon.
fn has_offset(line: &str) -> bool {
    let word = words(line).next().map_or("", |word| word.text);
    word.strip_suffix(':').is_some_and(is_hex)
}

/// Returns true if the offset of `next` fits to that of `line` and the bytes between, in some base.
pub(in super::super) fn follows(line: &str, next: &str) -> bool {
    let mut dump = Dump::new(Order::Big);
    let mut fits = |line| match dump.line(line) {
        Ok(Unit::Bytes(bytes)) => bytes.gap.is_none(),
        unit => unit.is_ok(),
    };
    fits(line) && fits(next)
}

/// The order of the bytes in the dump that begins with these lines; `None` if more lines may tell it. The error is the
/// number and the text of a line that cannot be read, and the reason.
pub(in super::super) fn order<'a>(
    lines: impl Iterator<Item = (u64, &'a str)>,
    is_all: bool,
) -> Result<Option<Order>, (u64, String, String)> {
    let mut has_colon = false;
    let mut ambiguous = None;
    let mut left = MAX_WAITING;
    for (number, text) in lines {
        let plain = without_escapes(text);
        let Some(Line::Data(row)) = columns(&plain) else {
            continue;
        };
        match order_of(&row) {
            Ok(None) => {}
            Ok(order) => return Ok(order),
            Err(reason) => return Err((number, text.to_owned(), reason)),
        }
        has_colon |= row.has_colon;
        // The groups of `xxd -e` have 4 bytes unless it is told another size.
        if row.has_colon && row.widest() == 8 && !row.is_same_in_any_order() {
            ambiguous = Some((number, text.to_owned(), AMBIGUOUS.to_owned()));
        }
        left -= 1;
        if left == 0 || text.len() >= MAX_WAITING_LEN {
            break;
        }
    }
    match ambiguous {
        _ if !is_all && left > 0 => Ok(None),
        Some(ambiguous) => Err(ambiguous),
        // Programs that write no colon write words of the machine.
        None => Ok(Some(if has_colon { Order::Big } else { Order::Little })),
    }
}

fn is_hex(word: &str) -> bool {
    !word.is_empty() && word.bytes().all(|byte| byte.is_ascii_hexdigit())
}

/// The order of the bytes in a word.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in super::super) enum Order {
    /// The order of the file.
    Big,
    Little,
    /// Each word is a byte in bits.
    Bits,
}

impl Order {
    const ALL: [Self; 3] = [Self::Bits, Self::Big, Self::Little];
}

/// The bytes of a line's words.
fn bytes_of(words: &[Word<'_>], order: Order) -> Result<Vec<u8>, String> {
    let bytes: Result<Vec<_>, _> = words.iter().map(|word| word_bytes(word.text, order)).collect();
    Ok(bytes?.concat())
}

fn word_bytes(word: &str, order: Order) -> Result<Vec<u8>, String> {
    if order == Order::Bits {
        let byte = u8::from_str_radix(word, 2).ok().filter(|_| word.len() == 8);
        return Ok(vec![byte.ok_or_else(|| format!("'{word}' is not a byte in bits"))?]);
    }
    let mut bytes = hex::parse(word).map_err(|_| format!("'{word}' is not a byte or bytes in hexadecimal"))?;
    if order == Order::Little {
        bytes.reverse();
    }
    Ok(bytes)
}

/// A dump that is being read.
pub(super) struct Dump {
    order: Order,
    /// The bases of the offsets that fit so far.
    bases: Vec<u32>,
    /// The offset of the last line in each of `bases`.
    offsets: Vec<u64>,
    /// The bytes of the last line.
    last: Vec<u8>,
    /// The last line is not passed on yet: its end may be padding.
    is_delayed: bool,
    /// The length of its longest word, in bytes.
    word: usize,
    is_repeated: bool,
    /// The bytes to pass on.
    ready: Vec<u8>,
}

impl Dump {
    /// A dump whose words have this order of bytes.
    pub(super) fn new(order: Order) -> Self {
        Self {
            order,
            bases: Vec::new(),
            offsets: Vec::new(),
            last: Vec::new(),
            is_delayed: false,
            word: 0,
            is_repeated: false,
            ready: Vec::new(),
        }
    }

    /// Takes a line with an offset.
    fn row(&mut self, row: &Row<'_>) -> Read<'static> {
        let gap = self.advance(row)?;
        let bytes = bytes_of(&row.words, self.order);
        self.last = bytes.map_err(|reason| Doubt::new("no bytes in hexadecimal", reason))?;
        self.word = row.widest() / 2;
        self.is_delayed = self.order == Order::Little && self.word > 1;
        if !self.is_delayed {
            self.ready.extend(&self.last);
        }
        let bytes = Bytes::new(std::mem::take(&mut self.ready));
        Ok(Unit::Bytes(Bytes { gap, ..bytes }))
    }

    fn pass_last(&mut self) {
        if std::mem::take(&mut self.is_delayed) {
            self.ready.extend(&self.last);
        }
    }

    /// Passes on what ends at this offset.
    fn advance(&mut self, row: &Row<'_>) -> Result<Option<Doubt>, Doubt> {
        let text = row.offset;
        let is_end = row.words.is_empty();
        let value = |base| u64::from_str_radix(text, base).ok();
        if self.bases.is_empty() {
            self.bases = bases(text.len(), row.has_colon)
                .into_iter()
                .filter(|&base| value(base).is_some())
                .collect();
            self.offsets = self.bases.iter().filter_map(|&base| value(base)).collect();
            return Ok(None);
        }
        let len = self.last.len() as u64;
        let known = self.bases.iter().copied().zip(self.offsets.iter().copied());
        let gaps: Vec<_> = known
            .filter_map(|(base, before)| {
                let offset = value(base)?;
                Some((base, offset, offset.wrapping_sub(before.wrapping_add(len)) as i64))
            })
            .collect();
        let is_padding = |gap: i64| {
            let padding = gap.unsigned_abs() as usize;
            let is_possible = self.is_delayed && is_end && gap < 0 && padding < self.word && padding < self.last.len();
            is_possible && self.last.iter().rev().take(padding).all(|&byte| byte == 0)
        };
        let is_repeat = |gap: i64| self.is_repeated && gap >= 0 && (gap as u64).is_multiple_of(len.max(1));
        let fits = |&&(_, _, gap): &&(u32, u64, i64)| gap == 0 || is_padding(gap) || is_repeat(gap);
        let fitting: Vec<_> = gaps.iter().filter(fits).copied().collect();
        if let [(one, _, a), (other, _, b), ..] = fitting[..]
            && a != b
        {
            self.is_repeated = false;
            return Err(Doubt::last(format!(
                "the offset '{text}' may have base {one} or {other}: choose the option of the dump"
            )));
        }
        let is_restart = !is_end && gaps.iter().all(|(_, offset, _)| *offset == 0);
        let doubt = match fitting.first() {
            Some(&(_, _, gap)) => {
                self.pass_delayed(gap);
                match self.is_repeated && gap > 0 {
                    true => self.repeat(gap as u64),
                    false => None,
                }
            }
            None if is_restart => {
                self.pass_delayed(0);
                self.is_repeated.then(endless)
            }
            None => {
                self.pass_delayed(0);
                let expected: Vec<_> = self.offsets.iter().map(|before| before.wrapping_add(len)).collect();
                let reason = misfit(text, &self.bases, &expected);
                Some(Doubt::new("offsets that do not fit", reason))
            }
        };
        let kept = if fitting.is_empty() { &gaps } else { &fitting };
        self.bases = kept.iter().map(|&(base, _, _)| base).collect();
        self.offsets = kept.iter().map(|&(_, offset, _)| offset).collect();
        self.last.clear();
        self.is_repeated = false;
        if self.bases.is_empty() {
            let reason = format!("'{text}' is no offset in the base of the others");
            return Err(Doubt::last(reason));
        }
        Ok(doubt)
    }

    /// Passes on the last line, without padding at its end.
    fn pass_delayed(&mut self, gap: i64) {
        if gap < 0 {
            self.last
                .truncate(self.last.len().saturating_sub(gap.unsigned_abs() as usize));
        }
        self.pass_last();
    }

    /// Passes on the repetitions of the last line.
    fn repeat(&mut self, len: u64) -> Option<Doubt> {
        if len > MAX_REPEATED {
            let text = format!("the line '*' stands for {len} bytes, at most {MAX_REPEATED} are repeated");
            return Some(Doubt::new("repetitions that are too long", text));
        }
        for _ in 0..len / self.last.len().max(1) as u64 {
            self.ready.extend(&self.last);
        }
        None
    }
}

impl LineReader for Dump {
    fn line<'a>(&mut self, line: &'a str) -> Read<'a> {
        let plain = without_escapes(line);
        match columns(&plain) {
            Some(Line::Data(row)) => self.row(&row),
            // A second one stands for nothing.
            Some(Line::Repeated) if self.last.is_empty() || self.is_repeated => {
                Err("no line is before the repetition".into())
            }
            Some(Line::Repeated) => {
                self.is_repeated = true;
                Ok(Unit::Comment)
            }
            // The numbers of the columns.
            None if self.bases.is_empty() && is_ruler(&plain) => Ok(Unit::Comment),
            None if has_offset(&plain) || !matches!(Log::default().find(&plain), Ok(None)) => {
                Err("no offset and bytes of a hex dump".into())
            }
            None => Ok(Unit::NO_BYTES),
        }
    }

    fn end(&mut self, take: &mut Take<'_>) {
        self.pass_last();
        let rest = std::mem::take(&mut self.ready);
        if !rest.is_empty() {
            take(Place::End, Ok(Unit::Bytes(Bytes::new(rest))));
        }
        if self.is_repeated {
            take(Place::End, Err(endless()));
        }
    }
}

/// The doubt about repetitions without the offset behind them.
fn endless() -> Doubt {
    let text = "no offset tells how many bytes the line '*' stands for";
    Doubt::new("repetitions without an end", text)
}

/// The bases that an offset of this length may have.
fn bases(len: usize, has_colon: bool) -> Vec<u32> {
    match (has_colon, len) {
        (true, _) => vec![16, 10],
        (false, 7) => BASES.to_vec(),
        (false, _) => vec![16],
    }
}

fn misfit(text: &str, bases: &[u32], expected: &[u64]) -> String {
    let expected = match (bases.first(), expected.first()) {
        (Some(8), Some(offset)) => format!("{offset:o}"),
        (Some(10), Some(offset)) => format!("{offset}"),
        (_, Some(offset)) => format!("{offset:x}"),
        (_, None) => "another".to_owned(),
    };
    format!("the offset {text} does not fit to the bytes before it: {expected} is expected")
}

const AMBIGUOUS: &str = "the words may be in file order (--format dump-be), as of 'xxd -g 4', or little-endian \
                         (--format dump-le), as of 'xxd -e'";

/// The order of the bytes in a line; `None` if it does not tell. The error is the reason why it cannot be read.
fn order_of(row: &Row<'_>) -> Result<Option<Order>, String> {
    if row.words.is_empty() {
        return Ok(None);
    }
    // od without options writes words in octal.
    let is_word = |word: &&Word<'_>| matches!(word.text.len(), 2 | 4 | 8 | 16);
    if let Some(word) = row.words.iter().find(|word| !is_word(word)).filter(|_| !row.has_colon) {
        return Err(format!("'{}' is no word in hexadecimal: od needs -t x1", word.text));
    }
    Ok(match row.column.as_deref() {
        Some([order]) => Some(*order),
        Some([Order::Bits, ..]) => Some(Order::Bits),
        _ if row.widest() == 2 => Some(Order::Big),
        None if !row.has_colon => Some(Order::Little),
        // The column has the same characters in either order, or others.
        _ => None,
    })
}
