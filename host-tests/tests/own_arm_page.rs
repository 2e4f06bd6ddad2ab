//! The code in `docs/own-arm.md` is that of `examples/own-arm`, which `cargo xtask examples` builds and tests.

use std::fs;
use std::path::Path;

const PAGE: &str = include_str!("../../docs/own-arm.md");

/// The texts of all files in a folder of the example.
fn files(folder: &str) -> Vec<String> {
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/own-arm");
    let files = fs::read_dir(example.join(folder)).unwrap();
    files
        .map(|file| fs::read_to_string(file.unwrap().path()).unwrap())
        .collect()
}

/// The blocks of a language on the page.
fn blocks(language: &str) -> impl Iterator<Item = &str> {
    let blocks = PAGE.split(&format!("```{language}\n")).skip(1).collect::<Vec<_>>();
    blocks.into_iter().map(|rest| rest.split("```").next().unwrap())
}

/// The lines of a text, without their indentation.
fn lines(text: &str) -> Vec<&str> {
    text.lines().map(str::trim).collect()
}

#[test]
fn code_on_the_page_is_that_of_the_example() {
    let sources = [files("src"), files("examples")].concat();
    let mut count = 0;
    for block in blocks("rust") {
        let block = lines(block);
        let is_part = |source: &String| lines(source).windows(block.len()).any(|part| part == block);
        assert!(
            sources.iter().any(is_part),
            "not in a file of the example:\n{}",
            block.join("\n")
        );
        count += 1;
    }
    assert!(count >= 6, "{count} blocks: others are missing");
}

#[test]
fn dependency_on_the_page_is_that_of_the_example() {
    let manifest = include_str!("../../examples/own-arm/Cargo.toml");
    let mut lines = blocks("toml").flat_map(str::lines).peekable();
    assert!(lines.peek().is_some());
    assert!(lines.all(|line| manifest.lines().any(|other| other == line)));
}

#[test]
fn tests_on_the_page_are_those_of_the_example() {
    let tests = files("tests").concat();
    let (_, table) = PAGE.split_once("| Test in ").unwrap();
    let (table, _) = table.split_once("\n\n").unwrap();
    let names = table.lines().skip(2).filter_map(|row| row.split('|').nth(1));
    let names: Vec<_> = names
        .flat_map(|cell| cell.split(','))
        .map(|name| name.trim().trim_matches('`'))
        .collect();
    assert!(names.len() >= 10, "{names:?}");
    for name in names {
        assert!(
            tests.contains(&format!("#[test]\nfn {name}() {{")),
            "{name} is no test of the example"
        );
    }
}
