//! Bytes as hexadecimal text, and back.

/// Bytes as `AA 06 00`.
pub(crate) fn show(bytes: &[u8]) -> String {
    let bytes: Vec<_> = bytes.iter().map(|byte| format!("{byte:02X}")).collect();
    bytes.join(" ")
}

/// The bytes that a line of text means: pairs of digits, with or without white space, commas, colons and 0x. Otherwise
/// the first word that means none.
pub(crate) fn parse(line: &str) -> Result<Vec<u8>, &str> {
    let mut bytes = Vec::new();
    for word in line.split([' ', '\t', ',', ':']).filter(|word| !word.is_empty()) {
        let digits = word.strip_prefix("0x").or(word.strip_prefix("0X")).unwrap_or(word);
        let pair = |pair: &[u8]| u8::from_str_radix(str::from_utf8(pair).ok()?, 16).ok();
        let word_bytes: Option<Vec<u8>> = match digits.as_bytes().as_chunks::<2>() {
            (pairs, []) if digits.bytes().all(|digit| digit.is_ascii_hexdigit()) => {
                pairs.iter().map(|digits| pair(digits)).collect()
            }
            _ => None,
        };
        bytes.extend(word_bytes.ok_or(word)?);
    }
    Ok(bytes)
}
