//! Installations, one at a time.

use std::fs::File;

use anyhow::Result;

use crate::cargo::target_dir;

/// Runs an installation while no other process of this program runs one: apt-get and rustup do not wait for each other.
///
/// # Errors
///
/// If there is no target directory to lock a file in, or the installation fails.
pub(crate) fn with_lock<T>(install: impl FnOnce() -> Result<T>) -> Result<T> {
    let lock = File::create(target_dir()?.join("installation.lock"))?;
    lock.lock()?;
    install()
}
