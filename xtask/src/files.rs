//! Folders and files.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};

/// Creates this folder without any content.
///
/// # Errors
///
/// If its old content cannot be removed, or it cannot be created.
pub(crate) fn empty_folder(folder: &Path) -> Result<()> {
    if folder.exists() {
        fs::remove_dir_all(folder).with_context(|| format!("cannot remove {}", folder.display()))?;
    }
    fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))
}

/// The only file or folder in a folder.
///
/// # Errors
///
/// If there is none, or more than one.
pub(crate) fn only_entry(folder: &Path) -> Result<PathBuf> {
    let mut entries = fs::read_dir(folder)?;
    let entry = entries
        .next()
        .with_context(|| format!("{} is empty", folder.display()))??;
    ensure!(entries.next().is_none(), "{} has several entries", folder.display());
    Ok(entry.path())
}

/// All files in a folder and those below, sorted.
///
/// # Errors
///
/// If a folder cannot be read.
pub(crate) fn list(folder: &Path) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        match path.is_dir() {
            true => files.extend(list(&path)?),
            false => files.push(path),
        }
    }
    files.sort();
    Ok(files)
}
