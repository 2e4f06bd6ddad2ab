//! A pseudo-terminal that stands in for a serial port.
//!
//! Any serial program can open it. What a pty lacks is a UART: it has no modem lines (the ioctls for DTR and RTS fail),
//! and its bytes take no time; baud rate and pacing are up to the one who serves it.

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

/// A pty in raw mode, both ends of it, with our end non-blocking.
///
/// Clients may open and close it at will, which shows on our side only by what they write; what one leaves unread, the
/// next one reads unless it empties its input buffer first, as serial libraries can. The pty is gone, and so is its
/// symbolic link, when this is dropped.
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
    /// Our end.
    controller: OwnedFd,
    /// The clients' end, kept open so that the last client to close it does not hang it up.
    user: OwnedFd,
    device: PathBuf,
    link: Option<Link>,
}

impl Pty {
    /// Makes a pty and, if `link` is given, a symbolic link there that points to it.
    ///
    /// # Errors
    ///
    /// When the system has no pty to give, or the link cannot be made. A link that a killed server left behind is
    /// replaced; [`io::ErrorKind::AlreadyExists`] when there is anything else, also the link of a server that runs.
    ///
    /// A server holds the empty file `LINK.lock` locked, by which others know that it runs.
    pub fn open(link: Option<&Path>) -> io::Result<Self> {
        let controller = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
        // A program that we start must not keep the pty alive.
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
            controller,
            user,
            device,
            link,
        })
    }

    /// What clients open: the symbolic link if there is one, else the device.
    pub fn path(&self) -> &Path {
        self.link.as_ref().map_or(&self.device, Link::path)
    }

    /// The baud rate that the last client set.
    ///
    /// # Errors
    ///
    /// When the system does not tell.
    pub fn baud(&self) -> io::Result<u32> {
        Ok(tcgetattr(&self.user)?.output_speed())
    }

    /// Sets the baud rate, as a client would.
    ///
    /// # Errors
    ///
    /// When the system refuses.
    pub fn set_baud(&self, baud: u32) -> io::Result<()> {
        let mut attributes = tcgetattr(&self.user)?;
        attributes.set_speed(baud)?;
        Ok(tcsetattr(&self.user, OptionalActions::Now, &attributes)?)
    }

    /// Takes what clients have written: as many bytes as there are and fit, which may be none. Does not wait.
    ///
    /// Call it a few times a second even when nothing is expected. A client's exclusive use of a terminal (`TIOCEXCL`)
    /// ends when the terminal is closed, but this one never is, so reading ends it. A lock on the file, which serial
    /// libraries take besides, holds until its owner closes the port or dies.
    ///
    /// # Errors
    ///
    /// When the system refuses.
    pub fn read(&self, bytes: &mut [u8]) -> io::Result<usize> {
        ioctl_tiocnxcl(&self.user)?;
        none_if_blocked(rustix::io::read(&self.controller, bytes))
    }

    /// Gives bytes to the clients: as many as there is room for, which may be none. Does not wait.
    ///
    /// # Errors
    ///
    /// When the system refuses.
    pub fn write(&self, bytes: &[u8]) -> io::Result<usize> {
        none_if_blocked(rustix::io::write(&self.controller, bytes))
    }

    /// Waits until there is something to [`read`](Self::read), for ever or for a time. Returns whether there is.
    ///
    /// A signal ends the wait early.
    ///
    /// # Errors
    ///
    /// When the system refuses.
    pub fn wait(&self, timeout: Option<Duration>) -> io::Result<bool> {
        wait_for_any(&[self], timeout)
    }
}

/// Waits until there is something to [`read`](Pty::read) at one of these at least, for ever or for a time. Returns
/// whether there is.
///
/// A signal ends the wait early.
///
/// # Errors
///
/// When the system refuses.
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

    /// A path of this test's own where nothing is.
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
    fn a_client_that_does_not_read_blocks_nobody() {
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
    fn a_link_to_anything_else_is_not_replaced() {
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
