//! Text from outside, as a terminal may show it: a file name, a line of a log, an adapter's identity.

pub(crate) use armwire_host::describe::escaped;

/// The longest text from a file that is shown, in characters.
const MAX_SHOWN: usize = 120;

/// The text of several lines, with escapes in place of characters that a terminal would act on. Ends of lines, returns to
/// their start and tabs stay.
pub(crate) fn escaped_lines(text: &str) -> String {
    const KEPT: [char; 3] = ['\r', '\n', '\t'];
    let piece = |piece: &str| {
        let shown = piece.trim_end_matches(KEPT);
        escaped(shown) + &piece[shown.len()..]
    };
    text.split_inclusive(KEPT).map(piece).collect()
}

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
    fn lines_and_tabs_stay_lines_and_tabs() {
        let shown = escaped_lines("Download\t 20%\r\x1b]0;name\x07\n\n\x7f\u{9B}2J");
        assert_eq!(shown, "Download\t 20%\r\\u{1b}]0;name\\u{7}\n\n\\u{7f}\\u{9b}2J");
        assert_eq!(escaped_lines(""), "");
    }

    #[test]
    fn long_text_is_cut() {
        assert_eq!(cut(&"µ".repeat(MAX_SHOWN)), "µ".repeat(MAX_SHOWN));
        assert_eq!(cut(&"µ".repeat(4_000_000)).chars().count(), MAX_SHOWN + 1);
    }
}
