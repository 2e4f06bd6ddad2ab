//! The programs that have a serial port open, from the files of Linux's `/proc`.

use std::fmt::{self, Display, Formatter};
use std::fs::{self, DirEntry};
use std::path::Path;
use std::process;

/// A process that has a port open.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Holder {
    id: u32,
    /// True for one that has locked it by one of its files.
    has_locked: bool,
    /// True for one that has it open by a file without the lock.
    is_unlocked: bool,
    /// True for the server of a pty. It has its port open, too, and takes no answers there.
    is_server: bool,
}

/// A program with a port, in words.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum User {
    /// The process that asks.
    ThisProcess,
    /// Another process.
    Other { name: String, id: u32 },
}

impl Display for User {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::ThisProcess => f.write_str("this process"),
            Self::Other { name, id } => write!(f, "another program, {name} (process {id})"),
        }
    }
}

/// The user of a port that we cannot open. `None` if it cannot be found, for example because it belongs to another user of
/// the computer.
pub(crate) fn owner(path: &str) -> Option<User> {
    user(owner_of(&holders(path))?)
}

/// Another user of a port that we have open and locked. `None` if there is none, or it cannot be found.
pub(crate) fn other(path: &str) -> Option<User> {
    user(other_of(&holders(path))?)
}

/// The process that has locked the port, or else one that has it open.
fn owner_of(holders: &[Holder]) -> Option<&Holder> {
    let users = holders.iter().filter(|holder| holder.has_locked || !holder.is_server);
    users.max_by_key(|holder| (holder.has_locked, holder.id))
}

/// A process with a file that is not ours. A child that inherited ours has our lock.
fn other_of(holders: &[Holder]) -> Option<&Holder> {
    holders.iter().find(|holder| holder.is_unlocked && !holder.is_server)
}

fn user(holder: &Holder) -> Option<User> {
    let id = holder.id;
    if id == process::id() {
        return Some(User::ThisProcess);
    }
    let name = fs::read_to_string(format!("/proc/{id}/comm")).ok()?;
    let name = name.trim_end().to_owned();
    Some(User::Other { name, id })
}

/// The processes that have this port open.
fn holders(path: &str) -> Vec<Holder> {
    let Ok(device) = fs::canonicalize(path) else {
        return Vec::new();
    };
    let processes = entries(Path::new("/proc"));
    let ids = processes.filter_map(|process| process.file_name().to_str()?.parse().ok());
    ids.filter_map(|id| holder(id, &device)).collect()
}

/// This process, if it has the port open.
fn holder(id: u32, device: &Path) -> Option<Holder> {
    let mut holder = Holder {
        id,
        has_locked: false,
        is_unlocked: false,
        is_server: false,
    };
    for file in entries(Path::new(&format!("/proc/{id}/fd"))) {
        let Ok(path) = fs::read_link(file.path()) else {
            continue;
        };
        let info = || fs::read_to_string(format!("/proc/{id}/fdinfo/{}", file.file_name().display()));
        if path == device {
            let has_locked = info().is_ok_and(|info| info.contains("lock:"));
            holder.has_locked |= has_locked;
            holder.is_unlocked |= !has_locked;
        } else if path.ends_with("ptmx") {
            holder.is_server |= info().is_ok_and(|info| serves(&info, device));
        }
    }
    (holder.has_locked || holder.is_unlocked).then_some(holder)
}

/// Returns true if the server's end of a pty, of which this is the information, is that of the port.
fn serves(info: &str, device: &Path) -> bool {
    let index = info.lines().find_map(|line| line.strip_prefix("tty-index:"));
    let index = index.map(|index| Path::new("/dev/pts").join(index.trim()));
    index.is_some_and(|port| port == device)
}

/// The entries of a folder, or none if it cannot be read.
fn entries(folder: &Path) -> impl Iterator<Item = DirEntry> {
    fs::read_dir(folder).into_iter().flatten().flatten()
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use std::fs::File;

    use armwire_sim::pty::Pty;
    use rustix::fs::{FlockOperation, flock};

    use super::*;

    const USER: Holder = Holder {
        id: 7,
        has_locked: false,
        is_unlocked: true,
        is_server: false,
    };
    const LOCKED: Holder = Holder {
        id: 5,
        has_locked: true,
        is_unlocked: false,
        is_server: false,
    };
    const SERVER: Holder = Holder {
        id: 9,
        is_server: true,
        ..USER
    };

    #[test]
    fn owner_is_who_has_the_lock() {
        assert_eq!(owner_of(&[SERVER, LOCKED, USER]), Some(&LOCKED));
        assert_eq!(owner_of(&[SERVER, USER]), Some(&USER));
        assert_eq!(owner_of(&[SERVER]), None);
        let both = Holder {
            has_locked: true,
            ..SERVER
        };
        assert_eq!(owner_of(&[both]), Some(&both));
    }

    #[test]
    fn other_user_has_a_file_of_its_own() {
        assert_eq!(other_of(&[SERVER, LOCKED, USER]), Some(&USER));
        // Our own process, a child with our file, and the server of the pty.
        assert_eq!(other_of(&[LOCKED, Holder { id: 6, ..LOCKED }, SERVER]), None);
        let twice = Holder {
            is_unlocked: true,
            ..LOCKED
        };
        assert_eq!(other_of(&[twice]), Some(&twice));
    }

    #[test]
    fn second_opening_in_this_process_is_found() {
        let path = std::env::temp_dir().join(format!("armwire-user-{}", process::id()));
        let ours = File::create(&path).unwrap();
        flock(&ours, FlockOperation::NonBlockingLockExclusive).unwrap();
        let name = path.to_str().unwrap();
        assert_eq!(owner(name), Some(User::ThisProcess));
        assert_eq!(other(name), None);
        let second = File::open(&path).unwrap();
        assert_eq!(other(name), Some(User::ThisProcess));
        drop(second);
        assert_eq!(other(name), None);
        fs::remove_file(&path).unwrap();
    }

    #[test]
    fn server_of_a_pty_is_not_its_user() {
        let pty = Pty::open(None).unwrap();
        let name = pty.path().to_str().unwrap();
        assert_eq!((owner(name), other(name)), (None, None));
    }

    #[test]
    fn server_is_that_of_its_own_pty_only() {
        let info = "pos:\t0\nflags:\t02100002\ntty-index:\t12\n";
        assert!(serves(info, Path::new("/dev/pts/12")));
        for other in ["/dev/pts/1", "/dev/pts/2", "/dev/ttyUSB12"] {
            assert!(!serves(info, Path::new(other)), "{other}");
        }
    }
}
