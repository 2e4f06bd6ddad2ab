//! All tests named in `docs/virtual-board.md` exist.

use std::fs;
use std::path::{Path, PathBuf};

/// Every Rust file under `folder`.
fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(sources(&path));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
    found
}

#[test]
fn documented_behaviours_have_tests_of_that_name() {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let page = fs::read_to_string(here.join("../docs/virtual-board.md")).unwrap();
    let (_, rest) = page.split_once("## Modelled behaviour").unwrap();
    let (table, _) = rest.split_once("\n## ").unwrap();
    // Frames on the CAN bus are the simulator's.
    let code: String = [here.join("src"), here.join("../sim/src/can")]
        .iter()
        .flat_map(|folder| sources(folder))
        .map(|path| fs::read_to_string(path).unwrap())
        .collect();
    let rows: Vec<&str> = table.lines().filter(|line| line.contains('`')).collect();
    assert!(rows.len() > 30, "{} rows", rows.len());
    for row in rows {
        // Every other part of a line is between backticks.
        for name in row.split('`').skip(1).step_by(2) {
            let test = format!("#[test]\nfn {name}(");
            let nested = format!("#[test]\n    fn {name}(");
            assert!(
                code.contains(&test) || code.contains(&nested),
                "no test is called {name}"
            );
        }
    }
}
