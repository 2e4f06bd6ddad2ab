//! Files that a command writes.

use std::fs::{self, File};
use std::io::{ErrorKind, IsTerminal as _};
use std::path::Path;

use crate::error::Error;

/// Checks that a file does not exist, and that its folder does.
///
/// # Errors
///
/// The path, and why it cannot be written.
pub(crate) fn check(path: &Path) -> Result<(), Error> {
    let name = path.display().to_string();
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    match path.exists() {
        // It is refused, or is a device or a pipe.
        true => create(path).map(drop),
        false => match folder.map(fs::metadata) {
            Some(Err(error)) => Err(Error::at(&name, format_args!("its folder: {error}"))),
            _ => Ok(()),
        },
    }
}

/// Creates a file, or opens a device or a pipe. A file that exists is not replaced, and a serial port is none: it would
/// be an arm's.
///
/// # Errors
///
/// The path, and why it cannot be written.
pub(crate) fn create(path: &Path) -> Result<File, Error> {
    let name = path.display().to_string();
    let is_special = fs::metadata(path).is_ok_and(|found| !found.is_file() && !found.is_dir());
    let file = match is_special {
        true => File::options().write(true).open(path),
        false => File::create_new(path),
    };
    let file = file.map_err(|error| match error.kind() {
        ErrorKind::AlreadyExists => Error::at(&name, "the file exists: delete it, or name another"),
        _ => Error::at(&name, error),
    })?;
    match is_special && file.is_terminal() {
        true => Err(Error::at(&name, "this is a port, not a file to write")),
        false => Ok(file),
    }
}
