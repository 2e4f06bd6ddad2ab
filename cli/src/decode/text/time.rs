//! Times and dates that may be bytes as well.

/// Returns true if the first word of a line may be a time of day or a date as well as bytes, with others behind it.
pub(in super::super) fn begins_with_time_or_bytes(line: &str) -> bool {
    let mut words = line.split_whitespace();
    words.next().is_some_and(is_time) && words.next().is_some()
}

/// Returns true for `12:34:56` and `24-01-31`.
pub(super) fn is_time(word: &str) -> bool {
    let parts = |mark| {
        let parts: Vec<_> = word.split(mark).filter_map(|part| part.parse::<u8>().ok()).collect();
        let is_all = word.len() == 8 && word.split(mark).all(|part| part.len() == 2);
        is_all.then_some(parts).filter(|parts| parts.len() == 3)
    };
    parts(':').is_some_and(|time| time[0] < 24 && time[1] < 60 && time[2] < 61)
        || parts('-').is_some_and(|date| (1..=12).contains(&date[1]) && (1..=31).contains(&date[2]))
}
