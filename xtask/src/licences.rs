//! The licences of all dependencies, against those that may be used under MIT or Apache-2.0.

use serde_json::Value;
use spdx::{Expression, Licensee, ParseMode};

use crate::Result;
use crate::workspace;

/// Licences that ask for no more than a notice.
const ALLOWED: [&str; 9] = [
    "0BSD",
    "Apache-2.0",
    "Apache-2.0 WITH LLVM-exception",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "ISC",
    "MIT",
    "Unicode-3.0",
    "Zlib",
];

/// Checks every package of the lock file.
///
/// # Errors
///
/// If there is one whose licence is not known to be allowed: all of them, one a line.
pub(crate) fn run() -> Result {
    let allowed = ALLOWED
        .iter()
        .map(|licence| Licensee::parse(licence))
        .collect::<Result<Vec<_>, _>>()?;
    let metadata = workspace::metadata(&["--all-features"])?;
    let packages = metadata["packages"]
        .as_array()
        .ok_or("`cargo metadata` names no packages")?;

    let refused: Vec<String> = packages
        .iter()
        .filter_map(|package| refusal(package, &allowed))
        .collect();
    if !refused.is_empty() {
        return Err(format!("licences that may not be used here:\n{}", refused.join("\n")).into());
    }
    println!("{} packages, all under licences that may be used here", packages.len());
    Ok(())
}

/// Why a package may not be used, or `None` if it may.
fn refusal(package: &Value, allowed: &[Licensee]) -> Option<String> {
    let name = &package["name"];
    let Some(licence) = package["license"].as_str() else {
        return Some(format!("{name}: no licence"));
    };
    // Old packages write MIT/Apache-2.0.
    let Ok(expression) = Expression::parse_mode(licence, ParseMode::LAX) else {
        return Some(format!("{name}: `{licence}` is not an SPDX expression"));
    };
    let may = expression.evaluate(|needed| allowed.iter().any(|licensee| licensee.satisfies(needed)));
    (!may).then(|| format!("{name}: {licence}"))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn is_allowed(licence: Value) -> bool {
        let allowed = ALLOWED.map(|licence| Licensee::parse(licence).unwrap());
        refusal(&json!({ "name": "some", "license": licence }), &allowed).is_none()
    }

    #[test]
    fn one_allowed_licence_to_choose_is_enough() {
        assert!(is_allowed(json!("MIT/Apache-2.0")));
        assert!(is_allowed(json!("MIT OR Apache-2.0 OR LGPL-2.1-or-later")));
        assert!(is_allowed(json!("(MIT OR Apache-2.0) AND Unicode-3.0")));
    }

    #[test]
    fn a_licence_that_is_missing_unknown_or_demanding_is_refused() {
        assert!(!is_allowed(json!(null)));
        assert!(!is_allowed(json!("as you like it")));
        assert!(!is_allowed(json!("GPL-3.0-only")));
        assert!(!is_allowed(json!("MIT AND GPL-3.0-only")));
    }
}
