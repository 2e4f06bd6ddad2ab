//! The sources of the image, for `build.rs` and a check of them in xtask.

/// Sources of the image, besides dependencies: files and folders. A change of one makes another image, whose commit has a
/// `+` until the change is committed.
pub(crate) const SOURCES: [&str; 7] = [
    ".",
    "../boards",
    "../bridge",
    "../protocol",
    "../memory.x",
    "../Cargo.toml",
    "../Cargo.lock",
];
