//! Lines of fields: a field is shown whole, or a mark in its place.

use std::mem;

use ratatui::style::Style;
use ratatui::text::{Line, Span};

/// The mark of a field or of lines without room.
pub(super) const MISSING: &str = "…";

/// Lines of cells of one width.
pub(super) fn grid(cells: Vec<String>, width: usize) -> Vec<Line<'static>> {
    let Some(longest) = cells.iter().map(|cell| cell.chars().count()).max() else {
        return Vec::new();
    };
    let cell = (longest + 1).min(width);
    let fields = cells.into_iter().map(|text| Span::raw(format!("{text:<cell$}")));
    wrapped(Span::raw(""), 0, fields, width)
}

/// The words of a text, each a field.
pub(super) fn words(text: &str, style: Style) -> Vec<Span<'static>> {
    text.split_whitespace()
        .map(|word| Span::styled(word.to_owned(), style))
        .collect()
}

/// A text as one field behind an indent, or its words if it is too long for that.
pub(super) fn words_if_long(text: &str, indent: usize, width: usize) -> Vec<Span<'static>> {
    let field = Span::raw(text.to_owned());
    match indent + field.width() <= width {
        true => vec![field],
        false => words(text, Style::new()),
    }
}

/// Lines of whole fields, the first behind `first`, the others behind an indent. A field without room on a line is
/// [`MISSING`].
pub(super) fn wrapped(
    first: Span<'static>,
    indent: usize,
    fields: impl IntoIterator<Item = Span<'static>>,
    width: usize,
) -> Vec<Line<'static>> {
    let mut lines = vec![];
    let mut line = Line::from(whole(first, width));
    let mut has_field = false;
    for field in fields {
        let field = whole(field, width.saturating_sub(indent));
        if line.width() + usize::from(has_field) + field.width() > width {
            lines.push(mem::replace(&mut line, Line::from(" ".repeat(indent))));
            has_field = false;
        }
        if has_field {
            line.push_span(" ");
        }
        line.push_span(field);
        has_field = true;
    }
    lines.push(line);
    lines
}

/// The field, or the mark of a missing one if it has no room.
pub(super) fn whole(field: Span<'static>, width: usize) -> Span<'static> {
    match field.width() <= width {
        true => field,
        false => Span::styled(MISSING, field.style),
    }
}

/// The first `most` lines. The mark stands for the others, in the place of the last field.
pub(super) fn capped(mut lines: Vec<Line<'static>>, most: usize) -> Vec<Line<'static>> {
    if lines.len() > most {
        lines.truncate(most);
        if let Some(last) = lines.last_mut()
            && let Some(field) = last.spans.last_mut()
        {
            *field = Span::styled(MISSING, field.style);
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(lines: &[Line<'_>]) -> Vec<String> {
        lines.iter().map(Line::to_string).collect()
    }

    fn numbers(width: usize) -> Vec<Line<'static>> {
        wrapped(Span::raw("n "), 2, words("12 345 6789 0", Style::new()), width)
    }

    #[test]
    fn fields_go_to_the_next_line_behind_the_indent() {
        assert_eq!(text(&numbers(15)), ["n 12 345 6789 0"]);
        assert_eq!(text(&numbers(14)), ["n 12 345 6789", "  0"]);
        assert_eq!(text(&numbers(6)), ["n 12", "  345", "  6789", "  0"]);
    }

    #[test]
    fn field_without_room_is_a_mark() {
        assert_eq!(text(&numbers(5)), ["n 12", "  345", "  … 0"]);
        assert_eq!(text(&numbers(3)), ["n …", "  …", "  …", "  0"]);
        assert_eq!(
            text(&grid(vec!["a 1".to_owned(), "b 1234".to_owned()], 5)),
            ["a 1  ", "…"]
        );
    }

    #[test]
    fn mark_stands_for_lines_above_the_maximum() {
        assert_eq!(text(&capped(numbers(6), 4)), text(&numbers(6)));
        assert_eq!(text(&capped(numbers(6), 2)), ["n 12", "  …"]);
    }
}
