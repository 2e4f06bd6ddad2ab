//! The blocks of `protocol/doc/first_lines.md` that its crate does not compile are lines of programs that are tested.

use std::fs;
use std::path::Path;

/// The blocks by their languages, and the programs.
const BLOCKS: [(&str, &str); 3] = [
    ("rust,ignore", "host/src/lib.rs"),
    ("c", "examples/c/serial.c"),
    ("python", "python/examples/move.py"),
];

#[test]
fn first_lines_are_those_of_tested_programs() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let page = fs::read_to_string(root.join("protocol/doc/first_lines.md")).unwrap();
    for (language, path) in BLOCKS {
        let fence = format!("```{language}\n");
        let mut blocks = page.split(&fence).skip(1);
        let block = blocks.next().and_then(|rest| rest.split("```").next()).unwrap();
        assert_eq!(blocks.next(), None, "blocks of {language}");
        let program = fs::read_to_string(root.join(path)).unwrap();
        let mut lines = program.lines().map(|line| line.trim_start_matches("//! ").trim());
        for line in block.lines().map(str::trim).filter(|line| !line.is_empty()) {
            assert!(
                lines.any(|other| other == line),
                "{path} has no line in this order: {line}"
            );
        }
    }
}
