//! The time of a line in a log.

use super::time::{clock, is_date};
use crate::decode::log::decimal;

/// Number of decimals of a time in seconds and in milliseconds, to a nanosecond.
pub(super) const SECONDS: usize = 9;
const MILLIS: usize = 6;
const DAY: u64 = 24 * 60 * 60 * 1_000_000_000;
/// The fewest decimals of a time in seconds: other numbers have fewer.
const MIN_DECIMALS: usize = 3;
/// The levels of ESP-IDF's log, each before a time in milliseconds: `I (1234)`.
const LEVELS: [&str; 5] = ["E", "W", "I", "D", "V"];

/// The time at the beginning of a line, in ns: since 1970 for a date and a time of day, which is taken as UTC without
/// an offset; since midnight for a time of day alone; as it is for a time in seconds or of ESP-IDF. A date that has two
/// readings is none.
pub(super) fn of_line(line: &str) -> Option<u64> {
    let mut words = words(line);
    let first = words.next()?;
    if LEVELS.contains(&first) && line.contains(" (") {
        return decimal(words.next()?, MILLIS);
    }
    let both = first.split_once('T').filter(|(date, _)| is_date(date));
    match both.or_else(|| is_date(first).then(|| words.next().map(|clock| (first, clock)))?) {
        Some((date, time)) => days(date)?.checked_mul(DAY)?.checked_add_signed(utc(time)?),
        None if first.contains(':') => u64::try_from(utc(first)?).ok(),
        None => {
            let decimals = first.split_once('.')?.1.len();
            decimal(first, SECONDS).filter(|_| decimals >= MIN_DECIMALS)
        }
    }
}

/// The words of a line, without brackets around them.
fn words(line: &str) -> impl Iterator<Item = &str> {
    let is_between = |character: char| character.is_whitespace() || "[]()\"".contains(character);
    let words = line.split(is_between).filter(|word| !word.is_empty());
    words.map(|word| word.trim_end_matches([':', ',', ';']))
}

/// A time of day, in ns since midnight of UTC. It may have an offset: `12:34:56.789+02:00`.
fn utc(text: &str) -> Option<i64> {
    let Some(at) = text.find(['+', '-']) else {
        return clock(text)?.try_into().ok();
    };
    let (text, offset) = text.split_at(at);
    let (sign, offset) = offset.split_at(1);
    let offset = match offset.split_at_checked(2) {
        Some((hours, minutes)) if !minutes.starts_with(':') => clock(&format!("{hours}:{minutes}")),
        _ => clock(offset),
    };
    let (time, offset): (i64, i64) = (clock(text)?.try_into().ok()?, offset?.try_into().ok()?);
    Some(if sign == "+" { time - offset } else { time + offset })
}

/// The days of a date since 1970. `None` if its day may be its month.
fn days(date: &str) -> Option<u64> {
    let mark = date.find(['-', '/', '.'])?;
    let mut parts = date.split(['-', '/', '.']).map(|part| part.parse::<u64>().ok());
    let (first, middle, last) = (parts.next()??, parts.next()??, parts.next()??);
    let (year, month, day) = match (mark, date[mark..].starts_with('.')) {
        (4, _) => (first, middle, last),
        _ if last < 100 => return None,
        (_, true) => (last, middle, first),
        _ if first > 12 => (last, middle, first),
        _ if middle > 12 => (last, first, middle),
        _ => return None,
    };
    // A year begins in March here, so that the day of a leap year is its last.
    let (year, month) = if month < 3 {
        (year - 1, month + 9)
    } else {
        (year, month - 3)
    };
    let day = (153 * month + 2) / 5 + day - 1 + 365 * year + year / 4 - year / 100 + year / 400;
    day.checked_sub(719_468)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: u64 = 1_000_000_000;

    #[test]
    fn time_of_a_line_is_in_nanoseconds() {
        let noon = 1_718_193_600 * SECOND;
        for (line, nanos) in [
            ("2024-06-12 12:00:00.5 RX: AA", Some(noon + SECOND / 2)),
            ("2024-06-12T12:00:00,25Z DEBUG AA", Some(noon + SECOND / 4)),
            ("[2024-06-12 14:00:00+02:00] AA", Some(noon)),
            ("2024-06-12T07:30:00-0430 AA", Some(noon)),
            ("12.06.2024 12:00:00 AA", Some(noon)),
            ("06/13/2024 12:00:00 AA", Some(noon + DAY)),
            ("1970-01-01 00:00:01 AA", Some(SECOND)),
            ("2000-02-29 00:00:00 AA", Some(951_782_400 * SECOND)),
            ("06/12/2024 12:00:00 AA", None),
            ("24-06-12 12:00:00 AA", None),
            ("2024-06-12 AA 06", None),
            ("[00:00:01.000000001][D] AA", Some(SECOND + 1)),
            ("00:00:02.5 -> AA", Some(2 * SECOND + SECOND / 2)),
            ("[    1.000250] uart: AA", Some(SECOND + 250_000)),
            ("000001.250 TX   0000  AA", Some(SECOND + SECOND / 4)),
            ("I (1234) uart: AA", Some(SECOND + 234_000_000)),
            ("1.5 mm AA", None),
            ("AA 06", None),
            ("", None),
        ] {
            assert_eq!(of_line(line), nanos, "{line}");
        }
    }
}
