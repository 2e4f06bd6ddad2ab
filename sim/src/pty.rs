//! A pseudo-terminal in place of a serial port.
//!
//! Any serial program can open it. A pty has no UART: the ioctls for DTR and RTS fail, and bytes take no time. The
//! server is responsible for baud rate and pacing.

mod link;

use std::ffi::OsStr;
use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags, fcntl_getfl, fcntl_setfl};
use rustix::io::{Errno, FdFlags, fcntl_setfd};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, Termios, ioctl_tiocnxcl, tcgetattr, tcsetattr};

use link::Link;

/// Both ends of a pty in raw mode. The server's end is non-blocking.
///
/// Clients may open and close the pty at any time; only their bytes are visible to the server. Unread bytes of one
/// client remain for the next, unless it empties its input buffer, as serial libraries can. Dropping this removes
/// its symbolic link and closes the pty.
///
/// ```
/// use std::io::{Read, Write};
/// use armwire_sim::pty::Pty;
///
/// let pty = Pty::open(None)?;
/// let mut client = std::fs::OpenOptions::new().read(true).write(true).open(pty.path())?;
/// client.write_all(&[0xAA, 0x0A, 0x0D])?;
///
/// let mut bytes = [0; 64];
/// pty.wait(None)?;
/// assert_eq!(pty.read(&mut bytes)?, 3);
/// assert_eq!(pty.read(&mut bytes)?, 0);
/// assert_eq!(pty.write(&[0x03])?, 1);
/// client.read_exact(&mut bytes[..1])?;
/// assert_eq!(bytes[0], 0x03);
/// # Ok::<(), std::io::Error>(())
/// ```
#[derive(Debug)]
pub struct Pty {
    /// Dropped first: the system may give the number of a closed pty to another one, and this would link to that.
    link: Option<Link>,
    /// The server's end.
    controller: OwnedFd,
    /// The clients' end, kept open to avoid a hang-up when the last client closes it.
    user: OwnedFd,
    device: PathBuf,
}

impl Pty {
    /// Creates a pty and, if `link` is given, a symbolic link to it.
    ///
    /// # Errors
    ///
    /// If the system has no free pty, or the link cannot be created. The link of a killed server is replaced. Anything
    /// else at that path, the link of a running server included, is [`io::ErrorKind::AlreadyExists`].
    ///
    /// A running server holds a lock on the empty file `LINK.lock`.
    pub fn open(link: Option<&Path>) -> io::Result<Self> {
        let controller = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
        // A child process must not keep the pty open.
        fcntl_setfd(&controller, FdFlags::CLOEXEC)?;
        grantpt(&controller)?;
        unlockpt(&controller)?;
        let device = PathBuf::from(OsStr::from_bytes(ptsname(&controller, Vec::new())?.as_bytes()));
        let user = rustix::fs::open(&device, OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC, Mode::empty())?;

        let mut attributes: Termios = tcgetattr(&user)?;
        attributes.make_raw();
        tcsetattr(&user, OptionalActions::Now, &attributes)?;
        fcntl_setfl(&controller, fcntl_getfl(&controller)? | OFlags::NONBLOCK)?;

        let link = link.map(|path| Link::place(path, &device)).transpose()?;
        Ok(Self {
            link,
            controller,
            user,
            device,
        })
    }

    /// Returns the path for clients: the symbolic link if there is one, else the device.
    pub fn path(&self) -> &Path {
        self.link.as_ref().map_or(&self.device, Link::path)
    }

    /// Returns the baud rate set by the last client.
    ///
    /// # Errors
    ///
    /// If the system call fails.
    pub fn baud(&self) -> io::Result<u32> {
        Ok(tcgetattr(&self.user)?.output_speed())
    }

    /// Sets the baud rate, as a client would.
    ///
    /// # Errors
    ///
    /// If the system call fails.
    pub fn set_baud(&self, baud: u32) -> io::Result<()> {
        let mut attributes = tcgetattr(&self.user)?;
        attributes.set_speed(baud)?;
        Ok(tcsetattr(&self.user, OptionalActions::Now, &attributes)?)
    }

    /// Reads the clients' bytes, as many as are available and fit, perhaps none. Does not block.
    ///
    /// Call it a few times a second even when no bytes are expected. A client's exclusive use of a terminal
    /// (`TIOCEXCL`) ends when the last descriptor is closed; the server keeps one open, so reading ends it instead. A
    /// file lock, which serial libraries also take, lasts until its owner closes the port or dies.
    ///
    /// # Errors
    ///
    /// If the system call fails.
    pub fn read(&self, bytes: &mut [u8]) -> io::Result<usize> {
        ioctl_tiocnxcl(&self.user)?;
        none_if_blocked(rustix::io::read(&self.controller, bytes))
    }

    /// Writes bytes to the clients, as many as there is room for, perhaps none. Does not block.
    ///
    /// # Errors
    ///
    /// If the system call fails.
    pub fn write(&self, bytes: &[u8]) -> io::Result<usize> {
        none_if_blocked(rustix::io::write(&self.controller, bytes))
    }

    /// Waits for bytes to [`read`](Self::read), without limit or up to a timeout. Returns true if there are any.
    ///
    /// A signal ends the wait early.
    ///
    /// # Errors
    ///
    /// If the system call fails.
    pub fn wait(&self, timeout: Option<Duration>) -> io::Result<bool> {
        wait_for_any(&[self], timeout)
    }
}

/// Waits for bytes to [`read`](Pty::read) at any of these, without limit or up to a timeout. Returns true if there are
/// any.
///
/// A signal ends the wait early.
///
/// # Errors
///
/// If the system call fails.
pub fn wait_for_any(ptys: &[&Pty], timeout: Option<Duration>) -> io::Result<bool> {
    let timeout = timeout.map(|timeout| Timespec {
        tv_sec: timeout.as_secs().try_into().unwrap_or(i64::MAX),
        tv_nsec: timeout.subsec_nanos().into(),
    });
    let fds = ptys
        .iter()
        .map(|pty| PollFd::from_borrowed_fd(pty.controller.as_fd(), PollFlags::IN));
    let mut fds: Vec<_> = fds.collect();
    match poll(&mut fds, timeout.as_ref()) {
        Ok(ready) => Ok(ready > 0),
        Err(Errno::INTR) => Ok(false),
        Err(error) => Err(error.into()),
    }
}

fn none_if_blocked(result: rustix::io::Result<usize>) -> io::Result<usize> {
    match result {
        Err(Errno::AGAIN | Errno::INTR) => Ok(0),
        other => Ok(other?),
    }
}

#[cfg(test)]
mod tests {
    use std::fs::{self, File, OpenOptions};
    use std::io::{Read, Write};
    use std::os::unix::fs::symlink;

    use super::*;

    fn client(pty: &Pty) -> File {
        OpenOptions::new().read(true).write(true).open(pty.path()).unwrap()
    }

    /// Returns an unused path for this test.
    fn free_path(name: &str) -> PathBuf {
        let path = std::env::temp_dir().join(format!("armwire-{name}-{}", std::process::id()));
        let _ = fs::remove_file(&path);
        path
    }

    #[test]
    fn every_byte_passes_untouched_both_ways() {
        let pty = Pty::open(None).unwrap();
        let mut client = client(&pty);
        let sent: Vec<u8> = (0..=255).collect();
        let mut got = [0; 256];

        client.write_all(&sent).unwrap();
        assert_eq!(pty.read(&mut got).unwrap(), 256);
        assert_eq!(got[..], sent);

        got.fill(0);
        assert_eq!(pty.write(&sent).unwrap(), 256);
        client.read_exact(&mut got).unwrap();
        assert_eq!(got[..], sent);
    }

    #[test]
    fn clients_may_close_it_and_open_it_again() {
        let pty = Pty::open(None).unwrap();
        for byte in 0..3 {
            client(&pty).write_all(&[byte]).unwrap();
            let mut got = [0xFF; 8];
            assert_eq!(pty.read(&mut got).unwrap(), 1);
            assert_eq!(got[0], byte);
        }
    }

    #[test]
    fn last_baud_rate_set_is_reported() {
        let pty = Pty::open(None).unwrap();
        for baud in [1_000_000, 115_200] {
            pty.set_baud(baud).unwrap();
            assert_eq!(pty.baud().unwrap(), baud);
        }
    }

    #[test]
    fn client_that_does_not_read_blocks_nobody() {
        let pty = Pty::open(None).unwrap();
        let _client = client(&pty);
        let written: usize = (0..1_000).map(|_| pty.write(&[0; 1024]).unwrap()).sum();
        assert!(written < 1_000 * 1024);
    }

    #[test]
    fn link_points_to_pty_and_vanishes_with_it() {
        let link = free_path("link");
        let pty = Pty::open(Some(&link)).unwrap();
        assert_eq!(pty.path(), link);
        assert_eq!(fs::read_link(&link).unwrap(), pty.device);
        drop(pty);
        assert!(fs::symlink_metadata(&link).is_err());
    }

    #[test]
    fn link_is_removed_before_its_pty_is() {
        let link = free_path("order");
        for _ in 0..200 {
            let pty = Pty::open(Some(&link)).unwrap();
            let is_there = || fs::symlink_metadata(&link).is_ok();
            std::thread::scope(|scope| {
                let dangles = scope.spawn(|| {
                    while is_there() {
                        if fs::metadata(&link).is_err() && is_there() {
                            return true;
                        }
                    }
                    false
                });
                drop(pty);
                assert!(!dangles.join().unwrap());
            });
        }
    }

    #[test]
    fn stale_link_is_replaced_but_not_successors_link() {
        let link = free_path("stale");
        for stale in ["/nowhere", "/dev/pts/no-more"] {
            symlink(stale, &link).unwrap();
            let first = Pty::open(Some(&link)).unwrap();
            fs::remove_file(&link).unwrap();
            fs::remove_file(link.with_added_extension("lock")).unwrap();
            let second = Pty::open(Some(&link)).unwrap();
            drop(first);
            assert_eq!(fs::read_link(&link).unwrap(), second.device);
            let error = Pty::open(Some(&link)).unwrap_err();
            assert_eq!(error.kind(), io::ErrorKind::AlreadyExists);
        }
    }

    #[test]
    fn link_of_running_server_is_not_replaced() {
        let link = free_path("running");
        let first = Pty::open(Some(&link)).unwrap();
        let error = Pty::open(Some(&link)).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::AlreadyExists);
        assert!(error.to_string().contains("is in use by another server"), "{error}");
        assert_eq!(fs::read_link(&link).unwrap(), first.device);
    }

    #[test]
    fn link_to_anything_else_is_not_replaced() {
        let link = free_path("else");
        for target in ["/dev/null", "/tmp"] {
            symlink(target, &link).unwrap();
            let error = Pty::open(Some(&link)).unwrap_err();
            assert_eq!(error.kind(), io::ErrorKind::AlreadyExists);
            assert!(error.to_string().contains("no pseudo-terminal"), "{error}");
            assert_eq!(fs::read_link(&link).unwrap(), Path::new(target));
            fs::remove_file(&link).unwrap();
        }
    }

    #[test]
    fn file_in_place_of_link_is_kept() {
        let path = free_path("file");
        fs::write(&path, "precious").unwrap();
        let error = Pty::open(Some(&path)).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::AlreadyExists);
        assert_eq!(fs::read_to_string(&path).unwrap(), "precious");
        fs::remove_file(&path).unwrap();
    }
}
