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
//! `xxd` has an ASCII column behind two spaces, `hexdump -C` between bars, `od -t x1z` between angle brackets. A line `*`
//! stands for repetitions of the line before it. `hexdump` and `od` end with the offset of the end.

/// Maximum number of bytes that a line `*` stands for.
const MAX_REPEATED: u64 = 16 * 1024 * 1024;
/// The shortest offset with a colon, and without one, in digits.
const MIN_OFFSET: (usize, usize) = (4, 6);
/// The longest offset, in digits.
const MAX_OFFSET: usize = 16;
/// The bases of offsets, the more common first.
const BASES: [u32; 3] = [16, 8, 10];

/// A line of a dump.
#[derive(Debug, PartialEq)]
pub(in super::super) enum Line<'a> {
    /// `*`.
    Repeated,
    Data {
        offset: &'a str,
        /// The offset has a colon.
        has_colon: bool,
        words: Vec<&'a str>,
        ascii: Option<&'a str>,
    },
}

/// Splits a line into its columns. `None` if it is no line of a dump.
pub(in super::super) fn columns(line: &str) -> Option<Line<'_>> {
    let line = line.trim_end();
    if line == "*" {
        return Some(Line::Repeated);
    }
    let line = line.trim_start();
    let (first, rest) = line.split_at(line.find([' ', '\t']).unwrap_or(line.len()));
    let (offset, has_colon) = first.strip_suffix(':').map_or((first, false), |offset| (offset, true));
    let offset = offset.strip_prefix("0x").unwrap_or(offset);
    let min = if has_colon { MIN_OFFSET.0 } else { MIN_OFFSET.1 };
    if !(min..=MAX_OFFSET).contains(&offset.len()) || !is_hex(offset) {
        return None;
    }
    let (data, ascii) = match has_colon {
        true => split_spaced(rest),
        false => split_framed(rest),
    };
    let words: Vec<_> = data.split_whitespace().collect();
    let are_words = words.iter().all(|word| is_hex(word));
    are_words.then_some(Line::Data {
        offset,
        has_colon,
        words,
        ascii,
    })
}

/// The columns of `xxd`: two spaces are before the ASCII column.
fn split_spaced(rest: &str) -> (&str, Option<&str>) {
    let start = rest.len() - rest.trim_start().len();
    match rest[start..].find("  ") {
        Some(end) => (&rest[..start + end], Some(&rest[start + end + 2..])),
        None => (rest, None),
    }
}

/// The columns of `hexdump -C` and `od -t x1z`: marks are around the ASCII column.
fn split_framed(rest: &str) -> (&str, Option<&str>) {
    match rest.find(['|', '>']) {
        Some(mark) => (&rest[..mark], Some(&rest[mark + 1..])),
        None => (rest, None),
    }
}

/// Returns true if the offset of `next` fits to that of `line` and the bytes between, in some base.
pub(in super::super) fn follows(line: &str, next: &str) -> bool {
    let mut dump = Dump::default();
    let mut push = |line| dump.push(line, &mut |_| {});
    matches!(push(line), Ok(None)) && matches!(push(next), Ok(None))
}

fn is_hex(word: &str) -> bool {
    !word.is_empty() && word.bytes().all(|byte| byte.is_ascii_hexdigit())
}

/// The order of the bytes in a word.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Order {
    Big,
    Little,
    Bits,
}

/// The bytes of a line's words.
fn bytes_of(words: &[&str], order: Order) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    for word in words {
        if order == Order::Bits {
            let byte = u8::from_str_radix(word, 2).ok().filter(|_| word.len() == 8);
            bytes.push(byte.ok_or_else(|| format!("'{word}' is not a byte in bits"))?);
            continue;
        }
        if word.len() % 2 != 0 {
            return Err(format!("'{word}' is not a byte or bytes in hexadecimal"));
        }
        let start = bytes.len();
        for at in (0..word.len()).step_by(2) {
            bytes.extend(u8::from_str_radix(&word[at..at + 2], 16));
        }
        if order == Order::Little {
            bytes[start..].reverse();
        }
    }
    Ok(bytes)
}

/// Returns true if the characters of an ASCII column are those of the bytes.
fn is_shown(bytes: &[u8], ascii: &str) -> bool {
    let shows = |(byte, character): (&u8, char)| match byte {
        b' '..=b'~' => char::from(*byte) == character,
        _ => character == '.',
    };
    ascii.chars().count() >= bytes.len() && bytes.iter().zip(ascii.chars()).all(shows)
}

/// A dump that is being read.
#[derive(Default)]
pub(super) struct Dump {
    /// The bases of the offsets that fit so far.
    bases: Vec<u32>,
    order: Option<Order>,
    /// The offset of the last line in each of `bases`.
    offsets: Vec<u64>,
    /// The bytes of the last line.
    last: Vec<u8>,
    /// The last line is not passed on yet: its end may be padding.
    is_held: bool,
    /// The length of its longest word, in bytes.
    word: usize,
    is_repeated: bool,
}

impl Dump {
    /// Takes the next line. Returns a remark about an offset that does not fit to the bytes before it.
    pub(super) fn push(&mut self, line: &str, take: &mut dyn FnMut(&[u8])) -> Result<Option<String>, String> {
        if line.trim().is_empty() {
            return Ok(None);
        }
        let (offset, has_colon, words, ascii) = match columns(line) {
            None => return Err("no offset and bytes of a hex dump".to_owned()),
            Some(Line::Repeated) if self.last.is_empty() => return Err("no line is before the repetition".to_owned()),
            Some(Line::Repeated) => {
                self.is_repeated = true;
                return Ok(None);
            }
            Some(Line::Data {
                offset,
                has_colon,
                words,
                ascii,
            }) => (offset, has_colon, words, ascii),
        };
        let remark = self.advance(offset, has_colon, words.is_empty(), take)?;
        let order = match self.order {
            Some(order) => order,
            None if words.is_empty() => return Ok(remark),
            None => order_of(&words, has_colon, ascii)?,
        };
        self.order = Some(order);
        self.last = bytes_of(&words, order)?;
        if let Some(ascii) = ascii
            && has_colon
            && ascii.trim().chars().count() > self.last.len()
        {
            return Err(format!(
                "the column of characters is longer than the {} bytes",
                self.last.len()
            ));
        }
        self.word = words.iter().map(|word| word.len() / 2).max().unwrap_or_default();
        self.is_held = order == Order::Little && self.word > 1;
        if !self.is_held {
            take(&self.last);
        }
        Ok(remark)
    }

    /// Ends the dump.
    pub(super) fn finish(&mut self, take: &mut dyn FnMut(&[u8])) {
        if std::mem::take(&mut self.is_held) {
            take(&self.last);
        }
    }

    /// Passes on what ends at this offset.
    fn advance(
        &mut self,
        text: &str,
        has_colon: bool,
        is_end: bool,
        take: &mut dyn FnMut(&[u8]),
    ) -> Result<Option<String>, String> {
        let value = |base| u64::from_str_radix(text, base).ok();
        if self.bases.is_empty() {
            self.bases = bases(text.len(), has_colon)
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
            let is_possible = self.is_held && is_end && gap < 0 && padding < self.word && padding < self.last.len();
            is_possible && self.last.iter().rev().take(padding).all(|&byte| byte == 0)
        };
        let is_repeat = |gap: i64| self.is_repeated && gap >= 0 && (gap as u64).is_multiple_of(len.max(1));
        let fits = |&&(_, _, gap): &&(u32, u64, i64)| gap == 0 || is_padding(gap) || is_repeat(gap);
        let fitting: Vec<_> = gaps.iter().filter(fits).copied().collect();
        if let [(one, _, a), (other, _, b), ..] = fitting[..]
            && a != b
        {
            return Err(format!(
                "the offset '{text}' may have base {one} or {other}: choose the option of the dump"
            ));
        }
        let remark = match fitting.first() {
            Some(&(_, _, gap)) => {
                self.pass_held(gap, take);
                if self.is_repeated && gap > 0 {
                    self.repeat(gap as u64, take)?;
                }
                None
            }
            None => {
                self.pass_held(0, take);
                let expected: Vec<_> = self.offsets.iter().map(|before| before.wrapping_add(len)).collect();
                Some(misfit(text, &self.bases, &expected))
            }
        };
        let kept = if fitting.is_empty() { &gaps } else { &fitting };
        self.bases = kept.iter().map(|&(base, _, _)| base).collect();
        self.offsets = kept.iter().map(|&(_, offset, _)| offset).collect();
        self.last.clear();
        self.is_repeated = false;
        if self.bases.is_empty() {
            return Err(format!("'{text}' is no offset in the base of the others"));
        }
        Ok(remark)
    }

    /// Passes on the last line, without padding at its end.
    fn pass_held(&mut self, gap: i64, take: &mut dyn FnMut(&[u8])) {
        if gap < 0 {
            self.last
                .truncate(self.last.len().saturating_sub(gap.unsigned_abs() as usize));
        }
        self.finish(take);
    }

    /// Passes on the repetitions of the last line.
    fn repeat(&self, len: u64, take: &mut dyn FnMut(&[u8])) -> Result<(), String> {
        if len > MAX_REPEATED {
            return Err(format!(
                "the line '*' stands for {len} bytes, at most {MAX_REPEATED} are repeated"
            ));
        }
        for _ in 0..len / self.last.len().max(1) as u64 {
            take(&self.last);
        }
        Ok(())
    }
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

/// The order of the bytes in the first line.
fn order_of(words: &[&str], has_colon: bool, ascii: Option<&str>) -> Result<Order, String> {
    let longest = words.iter().map(|word| word.len()).max().unwrap_or_default();
    if !has_colon {
        // od without options writes words in octal.
        return match words.iter().find(|word| !matches!(word.len(), 2 | 4 | 8 | 16)) {
            Some(word) => Err(format!("'{word}' is no word in hexadecimal: od needs -t x1")),
            None => Ok(Order::Little),
        };
    }
    let fits = |order| ascii.is_none_or(|ascii| bytes_of(words, order).is_ok_and(|bytes| is_shown(&bytes, ascii)));
    let are_bits = words
        .iter()
        .all(|word| word.len() == 8 && word.bytes().all(|bit| matches!(bit, b'0' | b'1')));
    if are_bits && ascii.is_some_and(|ascii| ascii.trim().chars().count() <= words.len()) {
        return Ok(Order::Bits);
    }
    let is_same = bytes_of(words, Order::Big) == bytes_of(words, Order::Little);
    match (fits(Order::Big), fits(Order::Little)) {
        (false, true) => Ok(Order::Little),
        // The groups of `xxd -e` have 4 bytes unless it is told another size.
        (true, true) if longest == 8 && !is_same => Err(
            "the words may be in file order (xxd -g 4) or little-endian (xxd -e): make the dump without these"
                .to_owned(),
        ),
        _ => Ok(Order::Big),
    }
}
