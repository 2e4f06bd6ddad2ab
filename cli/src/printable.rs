//! Text from outside, as a terminal may show it: a file name, a line of a log, an adapter's identity.

pub(crate) use armwire_host::describe::escaped;

/// The longest text from a file that is shown, in characters.
const MAX_SHOWN: usize = 120;

/// JSON, with escapes of its own in place of characters that a terminal would act on. All of them are in its strings.
pub(crate) fn escaped_json(json: &str) -> String {
    let mut text = String::with_capacity(json.len());
    for character in json.chars() {
        if character == '\n' || !character.escape_debug().to_string().starts_with("\\u") {
            text.push(character);
            continue;
        }
        for unit in character.encode_utf16(&mut [0; 2]) {
            text += &format!("\\u{unit:04x}");
        }
    }
    text
}

/// The text, cut after [`MAX_SHOWN`] characters.
pub(crate) fn cut(text: &str) -> String {
    match text.char_indices().nth(MAX_SHOWN) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn json_stays_json_when_escaped() {
        let value = serde_json::json!({ "text": "a\u{9B}2J\u{7F}b\u{202E}\u{E0001}\r\n\"µ\\" });
        let text = escaped_json(&value.to_string());
        assert_eq!(text, r#"{"text":"a\u009b2J\u007fb\u202e\udb40\udc01\r\n\"µ\\"}"#);
        assert_eq!(serde_json::from_str::<serde_json::Value>(&text).unwrap(), value);
    }

    #[test]
    fn long_text_is_cut() {
        assert_eq!(cut(&"µ".repeat(MAX_SHOWN)), "µ".repeat(MAX_SHOWN));
        assert_eq!(cut(&"µ".repeat(4_000_000)).chars().count(), MAX_SHOWN + 1);
    }
}
