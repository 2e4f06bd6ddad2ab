//! The tables in `docs/integrity.md`.

use std::{env, fs};

const PATH: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/integrity.md");
const END: &str = "\n<!-- end -->";

/// Checks that each of these tables is in the document, between `<!-- measured: NAME -->` and `<!-- end -->`. Writes
/// them there if `ARMWIRE_WRITE` is set.
pub(crate) fn holds(tables: &[(&str, String)]) {
    let mut document = fs::read_to_string(PATH).expect(PATH);
    let mut stale = Vec::new();
    for (name, table) in tables {
        let start = format!("<!-- measured: {name} -->\n\n");
        let (before, rest) = document
            .split_once(&start)
            .unwrap_or_else(|| panic!("{PATH} has no {start}"));
        let (written, after) = rest
            .split_once(END)
            .unwrap_or_else(|| panic!("{PATH} has no end of {name}"));
        if written != table {
            stale.push(*name);
            document = [before, &start, table, END, after].concat();
        }
    }
    if env::var_os("ARMWIRE_WRITE").is_some() {
        fs::write(PATH, document).expect(PATH);
    } else {
        assert!(
            stale.is_empty(),
            "{stale:?} in docs/integrity.md is not what was measured: `cargo xtask integrity --write`"
        );
    }
}
