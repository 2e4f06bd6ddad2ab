//! The ends of a pty of the system.

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

use super::link::Link;

#[derive(Debug)]
pub(super) struct Ends {
    /// Dropped first: the system may give the number of a closed pty to another one, and this would link to that.
    link: Option<Link>,
    /// The server's end.
    controller: OwnedFd,
    /// The clients' end, kept open to avoid a hang-up when the last client closes it.
    user: OwnedFd,
    pub(super) device: PathBuf,
}

impl Ends {
    pub(super) fn open(link: Option<&Path>) -> io::Result<Self> {
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

    pub(super) fn path(&self) -> &Path {
        self.link.as_ref().map_or(&self.device, Link::path)
    }

    pub(super) fn baud(&self) -> io::Result<u32> {
        Ok(tcgetattr(&self.user)?.output_speed())
    }

    pub(super) fn set_baud(&self, baud: u32) -> io::Result<()> {
        let mut attributes = tcgetattr(&self.user)?;
        attributes.set_speed(baud)?;
        Ok(tcsetattr(&self.user, OptionalActions::Now, &attributes)?)
    }

    pub(super) fn read(&self, bytes: &mut [u8]) -> io::Result<usize> {
        ioctl_tiocnxcl(&self.user)?;
        none_if_blocked(rustix::io::read(&self.controller, bytes))
    }

    pub(super) fn write(&self, bytes: &[u8]) -> io::Result<usize> {
        none_if_blocked(rustix::io::write(&self.controller, bytes))
    }

    pub(super) fn wait_for_any<'a>(
        ends: impl Iterator<Item = &'a Self>,
        timeout: Option<Duration>,
    ) -> io::Result<bool> {
        let timeout = timeout.map(|timeout| Timespec {
            tv_sec: timeout.as_secs().try_into().unwrap_or(i64::MAX),
            tv_nsec: timeout.subsec_nanos().into(),
        });
        let fds = ends.map(|ends| PollFd::from_borrowed_fd(ends.controller.as_fd(), PollFlags::IN));
        let mut fds: Vec<_> = fds.collect();
        match poll(&mut fds, timeout.as_ref()) {
            Ok(ready) => Ok(ready > 0),
            Err(Errno::INTR) => Ok(false),
            Err(error) => Err(error.into()),
        }
    }
}

fn none_if_blocked(result: rustix::io::Result<usize>) -> io::Result<usize> {
    match result {
        Err(Errno::AGAIN | Errno::INTR) => Ok(0),
        other => Ok(other?),
    }
}
