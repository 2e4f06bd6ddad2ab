//! Where things are.

use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::Result;
use crate::process::{cargo, output};

/// What is no member of the workspace, as an argument of cargo: what only they need is compiled for nobody else.
pub(crate) const ALONE: [&str; 3] = [
    "--manifest-path=host-tests/no-panic/Cargo.toml",
    "--manifest-path=host-tests/fuzz/Cargo.toml",
    "--manifest-path=host-tests/benches/Cargo.toml",
];

/// The root of the workspace.
pub(crate) fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .expect("xtask is a folder of the workspace")
}

/// Where cargo puts what it builds: `CARGO_TARGET_DIR` and cargo's configuration have a say.
pub(crate) fn target_dir() -> Result<PathBuf> {
    let metadata = metadata(&["--no-deps"])?;
    let dir = metadata["target_directory"]
        .as_str()
        .ok_or("`cargo metadata` names no target directory")?;
    Ok(dir.into())
}

/// What `cargo metadata` says.
pub(crate) fn metadata(args: &[&str]) -> Result<Value> {
    let text = output(
        cargo()
            .args(["metadata", "--format-version", "1"])
            .args(args)
            .current_dir(root()),
    )?;
    Ok(serde_json::from_str(&text)?)
}
