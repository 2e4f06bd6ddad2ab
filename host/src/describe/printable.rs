//! Text and bytes as a terminal may show them.

/// Bytes as `AA 06 00`.
pub fn hex(bytes: &[u8]) -> String {
    let bytes: Vec<_> = bytes.iter().map(|byte| format!("{byte:02X}")).collect();
    bytes.join(" ")
}

/// The text in one line, with escapes in place of characters that a terminal would act on.
pub fn escaped(text: &str) -> String {
    let mut line = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '\'' | '"' | '\\' => line.push(character),
            _ => line.extend(character.escape_debug()),
        }
    }
    line
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_escaped() {
        assert_eq!(escaped("a\x1B[2Jb\r\n\u{202E}\0"), r"a\u{1b}[2Jb\r\n\u{202e}\0");
    }

    #[test]
    fn printable_text_stays() {
        let text = r#"/dev/ttyÄ0: 'a' "b" \c 20 °C, 30 µs"#;
        assert_eq!(escaped(text), text);
    }
}
