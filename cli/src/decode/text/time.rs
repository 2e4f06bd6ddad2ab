//! Times and dates before bytes, which may look like bytes.

const YEARS: std::ops::Range<u32> = 1970..2100;
const MONTHS: [&str; 12] = [
    "Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec",
];

/// The line behind a date, a time, or both, if anything is behind them.
pub(in super::super) fn behind_times(line: &str) -> Option<&str> {
    if !line.trim_start().starts_with(|first: char| first.is_ascii_digit()) {
        return behind_names(line);
    }
    let (first, rest) = split_word(line);
    let (second, behind) = split_word(rest);
    let rest = match is_clock(second) {
        true if is_date(first) || is_digits_of_date(first) => behind,
        _ if is_time(first) => rest,
        _ => return None,
    };
    (!rest.trim().is_empty()).then_some(rest)
}

/// The line behind a date with the name of a month, and a time: `Jun 12 12:00:00`, as of a system log, or
/// `Wed Jun 12 12:00:00 2024`.
fn behind_names(line: &str) -> Option<&str> {
    let (first, rest) = split_word(line);
    let has_weekday = first.len() == 3 && !MONTHS.contains(&first);
    let (month, rest) = if has_weekday { split_word(rest) } else { (first, rest) };
    let (day, rest) = split_word(rest);
    let (clock, rest) = split_word(rest);
    let is_date = MONTHS.contains(&month) && number(Some(day), 1..=2).is_some() && is_clock(clock);
    let (year, behind) = split_word(rest);
    let has_year = has_weekday && number(Some(year), 4..=4).is_some_and(|year| YEARS.contains(&year));
    let rest = if has_year { behind } else { rest };
    (is_date && !rest.trim().is_empty()).then_some(rest)
}

/// Returns true if the first word of a line is a time or a date as well as bytes in the form of the words behind it.
pub(in super::super) fn begins_with_time_or_bytes(line: &str) -> bool {
    let (first, _) = split_word(line);
    let mark = if is_clock(first) { ':' } else { '-' };
    let has_year = first.split(mark).any(|part| part.len() > 2);
    !has_year && behind_times(line).is_some_and(|rest| rest.contains(mark))
}

fn split_word(text: &str) -> (&str, &str) {
    let text = text.trim_start();
    text.split_at(text.find(char::is_whitespace).unwrap_or(text.len()))
}

/// Returns true for a date or a time, or both with a T between them.
pub(super) fn is_time(word: &str) -> bool {
    /// The shortest time is `1:02`.
    const MIN_LEN: usize = 4;
    if word.len() < MIN_LEN || !word.starts_with(|first: char| first.is_ascii_digit()) {
        return false;
    }
    let both = word.split_once('T');
    is_clock(word) || is_date(word) || both.is_some_and(|(date, clock)| is_date(date) && is_clock(clock))
}

fn is_clock(word: &str) -> bool {
    clock(word).is_some()
}

/// The ns since midnight of `12:34` and `12:34:56`, and of a fraction of a second behind it, such as `12:34:56.789Z`.
pub(super) fn clock(word: &str) -> Option<u64> {
    let word = word.trim_end_matches(['Z', ',']);
    let mut parts = word.splitn(3, ':');
    let (hour, minute) = (number(parts.next(), 1..=2)?, number(parts.next(), 2..=2)?);
    let mut seconds = parts.next().unwrap_or("00").splitn(2, [':', '.', ',']);
    let second = number(seconds.next(), 2..=2)?;
    let nanos = match seconds.next() {
        Some(fraction) => u64::from(number(Some(fraction), 1..=9)?) * 10_u64.pow(9 - fraction.len() as u32),
        None => 0,
    };
    let seconds = u64::from((60 * hour + minute) * 60 + second);
    (hour < 24 && minute < 60 && second < 61).then_some(seconds * 1_000_000_000 + nanos)
}

/// Returns true for `2024-01-31`, `24-01-31`, `31-01-2024` and the like, with dashes, dots or slashes.
pub(super) fn is_date(word: &str) -> bool {
    ['-', '/', '.'].into_iter().any(|mark| {
        let parts: Vec<_> = word.split(mark).collect();
        let [first, middle, last] = parts[..] else { return false };
        let day = |part| number(Some(part), 2..=2).is_some_and(|part| (1..=31).contains(&part));
        let year = |part| number(Some(part), 4..=4).is_some_and(|year| YEARS.contains(&year));
        let month = || day(middle) && number(Some(middle), 2..=2) <= Some(12);
        let is_short = number(Some(first), 2..=2).is_some() && month() && day(last);
        is_short || year(first) && month() && day(last) || day(first) && day(middle) && year(last)
    })
}

/// Returns true for `20240131`, which is a date only before a time.
fn is_digits_of_date(word: &str) -> bool {
    let parts = word.get(..4).zip(word.get(4..6)).zip(word.get(6..));
    parts.is_some_and(|((year, month), day)| is_date(&format!("{year}-{month}-{day}")))
}

/// A decimal number with so many digits.
fn number(text: Option<&str>, digits: std::ops::RangeInclusive<usize>) -> Option<u32> {
    let text = text.filter(|text| digits.contains(&text.len()) && text.bytes().all(|digit| digit.is_ascii_digit()))?;
    text.parse().ok()
}
