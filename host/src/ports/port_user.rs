//! The program that has a serial port open, from the files of Linux's `/proc`.

use std::fs::{self, DirEntry};
use std::path::Path;

/// The program that has this port open, and has locked it if one has. `None` if it cannot be found, for example because
/// it belongs to another user.
pub(crate) fn find(port: &str) -> Option<String> {
    let device = fs::canonicalize(port).ok()?;
    let processes = entries(Path::new("/proc"));
    let others = processes.filter_map(|process| process.file_name().to_str()?.parse::<u32>().ok());
    let others = others.filter(|&id| id != std::process::id());
    // The server of a pty has its port open, too, but without a lock.
    let (_, id) = others.filter_map(|id| Some((has_locked(id, &device)?, id))).max()?;
    let name = fs::read_to_string(format!("/proc/{id}/comm")).ok()?;
    Some(format!("{} (process {id})", name.trim_end()))
}

/// True if the process has locked the port. `None` if it does not have it open.
fn has_locked(process: u32, device: &Path) -> Option<bool> {
    let folder = format!("/proc/{process}/fd");
    let files = entries(Path::new(&folder)).filter(|file| fs::read_link(file.path()).is_ok_and(|path| path == device));
    let locked = files.map(|file| {
        let number = file.file_name();
        let info = fs::read_to_string(format!("/proc/{process}/fdinfo/{}", number.display()));
        info.is_ok_and(|info| info.contains("lock:"))
    });
    locked.max()
}

/// The entries of a folder, or none if it cannot be read.
fn entries(folder: &Path) -> impl Iterator<Item = DirEntry> {
    fs::read_dir(folder).into_iter().flatten().flatten()
}
