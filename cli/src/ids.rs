//! Ids of servos as text.

/// The ids of a list of numbers and ascending ranges, such as '1-6' or '1,2,7'. `id` parses one.
pub(crate) fn ids(text: &str, id: impl Fn(&str) -> Result<u8, String>) -> Result<Vec<u8>, String> {
    let mut ids = Vec::new();
    for part in text.split(',') {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        let (first, last) = (id(first)?, id(last)?);
        if first > last {
            return Err(format!("'{part}' is a descending range"));
        }
        ids.extend(first..=last);
    }
    Ok(ids)
}
