//! Tables in the pages of `docs`.

/// The page with another table between the marks of this name; `None` if it has no such marks.
pub fn filled(page: &str, name: &str, table: &str) -> Option<String> {
    let (begin, end) = (format!("<!-- {name}: begin -->\n"), format!("<!-- {name}: end -->\n"));
    let (head, rest) = page.split_once(&begin)?;
    let (_, tail) = rest.split_once(&end)?;
    Some(format!("{head}{begin}\n{table}\n{end}{tail}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn table_replaces_the_one_between_its_marks() {
        let page = "before\n<!-- t: begin -->\nold\n<!-- t: end -->\nafter\n";
        let expected = "before\n<!-- t: begin -->\n\nnew\n<!-- t: end -->\nafter\n";
        assert_eq!(filled(page, "t", "new").as_deref(), Some(expected));
        assert_eq!(filled(page, "other", "new"), None);
    }
}
