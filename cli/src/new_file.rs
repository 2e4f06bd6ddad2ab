//! Files that a command writes.

use std::fs::{self, File};
use std::io::ErrorKind;
use std::path::Path;

use crate::error::Error;

/// Creates a file, or opens a device or a pipe. A file that exists is not replaced.
///
/// # Errors
///
/// The path, and why it cannot be written.
pub(crate) fn create(path: &Path) -> Result<File, Error> {
    let is_special = fs::metadata(path).is_ok_and(|found| !found.is_file() && !found.is_dir());
    let file = match is_special {
        true => File::options().write(true).open(path),
        false => File::create_new(path),
    };
    file.map_err(|error| {
        let name = path.display().to_string();
        match error.kind() {
            ErrorKind::AlreadyExists => Error::at(&name, "the file exists: delete it, or name another"),
            _ => Error::at(&name, error),
        }
    })
}
