//! Where things are.

use std::path::Path;

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
