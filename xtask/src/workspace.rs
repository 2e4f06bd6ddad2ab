//! Paths of the repository.

use std::path::{Path, PathBuf};

/// Packages outside the workspace, as arguments of cargo: their dependencies are compiled for them alone.
pub(crate) const ALONE: [&str; 2] = [
    "--manifest-path=host-tests/fuzz/Cargo.toml",
    "--manifest-path=host-tests/benches/Cargo.toml",
];

pub(crate) fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .expect("xtask is a folder of the workspace")
}

/// The folder of the firmware. Cargo's configuration there has the profiles of its images.
pub(crate) fn firmware() -> PathBuf {
    root().join("firmware")
}
