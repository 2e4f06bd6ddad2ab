//! The symbolic link to a pty.
//!
//! A killed server leaves its link behind, and the system may soon give the pty number in it to another process or to
//! the next server. The target alone therefore does not show whether the link is stale. Each server holds a lock on the
//! file `PATH.lock`, which the system releases when the server dies.

use std::fs::{self, File, TryLockError};
use std::io::{self, ErrorKind};
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::{MetadataExt, symlink};
use std::path::{Path, PathBuf};

use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;

/// A symbolic link to a pty. It is removed on drop.
#[derive(Debug)]
pub(super) struct Link {
    path: PathBuf,
    device: PathBuf,
    _lock: Lock,
}

impl Link {
    /// Creates a link at `path` to `device`, a pty of this process.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::AlreadyExists`] if anything but a stale link is there, others if a system call fails.
    pub(super) fn place(path: &Path, device: &Path) -> io::Result<Self> {
        let (lock, left_behind) = Lock::take(path)?;
        match fs::symlink_metadata(path) {
            Ok(there) if there.file_type().is_symlink() => {
                let target = fs::read_link(path)?;
                let is_stale = target == device || is_gone(&target) || left_behind && is_pty(&target);
                if !is_stale {
                    return Err(already_exists(path, &describe_target(&target)));
                }
                fs::remove_file(path)?;
            }
            Ok(_) => {
                return Err(already_exists(
                    path,
                    "exists and is not a symbolic link; choose another path",
                ));
            }
            Err(error) if error.kind() == ErrorKind::NotFound => {}
            Err(error) => return Err(error),
        }
        symlink(device, path)
            .map_err(|error| io::Error::new(error.kind(), format!("cannot link {}: {error}", path.display())))?;
        Ok(Self {
            path: path.to_owned(),
            device: device.to_owned(),
            _lock: lock,
        })
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        // A link that another process has replaced meanwhile stays.
        if fs::read_link(&self.path).is_ok_and(|device| device == self.device) {
            // A drop cannot report an error.
            let _ = fs::remove_file(&self.path);
        }
    }
}

/// The lock of a link's server. The file is removed on drop.
#[derive(Debug)]
struct Lock {
    path: PathBuf,
    file: File,
}

impl Lock {
    /// Takes the lock of the link at `path`. Also returns whether a killed server left its file behind.
    fn take(link: &Path) -> io::Result<(Self, bool)> {
        let path = link.with_added_extension("lock");
        loop {
            let left_behind = match fs::symlink_metadata(&path) {
                Ok(there) if there.is_file() && there.len() == 0 => true,
                Ok(_) => {
                    return Err(already_exists(
                        &path,
                        "exists and is not the lock of a server; choose another path",
                    ));
                }
                Err(_) => false,
            };
            let file = File::options().write(true).create(true).truncate(false).open(&path);
            let failed = |error: io::Error| {
                let text = format!("cannot lock {}: {error}", path.display());
                io::Error::new(error.kind(), text)
            };
            let file = file.map_err(failed)?;
            match file.try_lock() {
                Ok(()) if is_at(&file, &path) => return Ok((Self { path, file }, left_behind)),
                // The previous owner removed it before this lock.
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => {
                    let text = "is in use by another server: end that one, or choose another path";
                    return Err(already_exists(link, text));
                }
                Err(TryLockError::Error(error)) => return Err(failed(error)),
            }
        }
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // It is removed while locked: a process that has already opened it notices. Another server's file stays.
        if is_at(&self.file, &self.path) {
            let _ = fs::remove_file(&self.path);
        }
    }
}

fn is_at(file: &File, path: &Path) -> bool {
    let id = |metadata: fs::Metadata| (metadata.dev(), metadata.ino());
    let (here, there) = (file.metadata().map(id), fs::symlink_metadata(path).map(id));
    matches!((here, there), (Ok(here), Ok(there)) if here == there)
}

fn already_exists(path: &Path, what: &str) -> io::Error {
    io::Error::new(ErrorKind::AlreadyExists, format!("{} {what}", path.display()))
}

fn describe_target(target: &Path) -> String {
    let target_name = target.display();
    match is_pty(target) {
        true => format!(
            "points to {target_name}, which is in use: end the server there, remove the link, or choose another path"
        ),
        false => format!("is a symbolic link to {target_name}, which is no pseudo-terminal; choose another path"),
    }
}

/// Returns true if this is the path of a pty: `/dev/pts/3`, or `/dev/ttys003` on macOS.
fn is_pty(device: &Path) -> bool {
    let name = device.as_os_str().as_bytes();
    name.starts_with(b"/dev/pts/") || name.starts_with(b"/dev/ttys")
}

/// Returns true if the target is missing, or a pty without a server. Linux removes its name, macOS may keep it.
fn is_gone(target: &Path) -> bool {
    if fs::metadata(target).is_err_and(|error| error.kind() == ErrorKind::NotFound) {
        return true;
    }
    let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let opened = || rustix::fs::open(target, flags, Mode::empty());
    is_pty(target) && matches!(opened(), Err(Errno::NOENT | Errno::NXIO | Errno::IO))
}
