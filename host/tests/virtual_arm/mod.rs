//! A virtual Ling arm on a pseudo-terminal, for the tests of the library.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread;

use armwire::time::Instant;
use armwire_host::{Error, Ling};
use armwire_sim::ling::{Config, LingArm};
use armwire_sim::pty::Pty;
use armwire_sim::serial::SerialDevice;
use armwire_sim::serve::serve;

/// Length of an answer with the joints, in bytes.
pub(crate) const JOINTS_ANSWER: usize = 21;

/// An arm that receives everything, behind a line that loses the next bytes of its answers: this many.
struct Losing {
    arm: LingArm,
    lost: Arc<AtomicUsize>,
}

impl SerialDevice for Losing {
    fn receive(&mut self, now: Instant, byte: u8) {
        self.arm.receive(now, byte);
    }

    fn transmit(&mut self, now: Instant) -> Option<u8> {
        while let Some(byte) = self.arm.transmit(now) {
            let lost = |left: usize| left.checked_sub(1);
            if self
                .lost
                .fetch_update(Ordering::Relaxed, Ordering::Relaxed, lost)
                .is_err()
            {
                return Some(byte);
            }
        }
        None
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.arm.poll_timeout()
    }
}

/// Gives `test` an arm, and the number of bytes that its answers lose.
pub(crate) fn with_own_arm(test: impl FnOnce(Ling, &Arc<AtomicUsize>) + Send) {
    let (pty, stop) = (Pty::open(None).unwrap(), AtomicBool::new(false));
    let lost = Arc::new(AtomicUsize::new(0));
    let mut virtual_arm = Losing {
        arm: LingArm::new(Config::follower()),
        lost: Arc::clone(&lost),
    };
    thread::scope(|scope| {
        scope.spawn(|| serve(&mut virtual_arm, &pty, &stop));
        let path = pty.path().to_str().unwrap();
        let tested = thread::scope(|scope| {
            let test = || test(armwire_host::open(path).unwrap().ling().unwrap(), &lost);
            scope.spawn(test).join()
        });
        stop.store(true, Ordering::Relaxed);
        if let Err(panic) = tested {
            std::panic::resume_unwind(panic);
        }
    });
}

/// A busy system may answer late: the call is repeated.
pub(crate) fn patient<T>(mut call: impl FnMut() -> Result<T, Error>) -> Result<T, Error> {
    loop {
        match call() {
            Err(Error::NoAnswer { .. }) => {}
            other => return other,
        }
    }
}
