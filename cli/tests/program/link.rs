//! The symbolic link to a program's pseudo-terminal, after an earlier program was killed.

use std::fs;
use std::path::{Path, PathBuf};

use armwire_sim::pty::Pty;
use rustix::process::Signal;

use crate::common::{Arm, failure, free_path, run, success};

/// The target of a link.
fn target(link: &str) -> PathBuf {
    fs::read_link(link).unwrap()
}

#[test]
fn link_of_a_killed_arm_is_replaced() {
    let link = free_path("killed");
    for _ in 0..7 {
        let arm = Arm::start_at("ling", &link, &[]);
        success(&["info", &arm.port]);
        arm.kill();
        assert!(fs::symlink_metadata(&link).is_ok(), "a killed arm leaves its link");
    }
    Arm::start_at("ling", &link, &[]).stop(Signal::TERM);
    assert!(fs::symlink_metadata(&link).is_err(), "the link is left behind");
    assert!(fs::symlink_metadata(lock(&link)).is_err(), "the lock is left behind");
}

#[test]
fn reused_pty_of_killed_arm_does_not_block() {
    let link = free_path("reused");
    let arm = Arm::start_at("ling", &link, &[]);
    let stale = target(&arm.port);
    arm.kill();
    // One of these has the number in the stale link, unless another program has it.
    let others: Vec<_> = (0..64).map(|_| Pty::open(None).unwrap()).collect();
    assert!(others.iter().any(|pty| pty.path() == stale) || stale.exists());
    let arm = Arm::start_at("ling", &link, &[]);
    assert_ne!(target(&arm.port), stale);
}

#[test]
fn link_of_a_running_arm_is_kept() {
    let arm = Arm::start("ling", "running", &[]);
    let device = target(&arm.port);
    let line = failure(&run(&["sim", "ling", "--pty", &arm.port]));
    assert!(line.contains("in use by another server"), "{line}");
    assert_eq!(target(&arm.port), device);
    success(&["info", &arm.port]);
}

#[test]
fn link_to_another_programs_pty_is_kept() {
    let link = free_path("foreign");
    let foreign = Pty::open(None).unwrap();
    std::os::unix::fs::symlink(foreign.path(), &link).unwrap();
    let line = failure(&run(&["sim", "ling", "--pty", link.to_str().unwrap()]));
    assert!(line.contains("which is in use"), "{line}");
    assert_eq!(fs::read_link(&link).unwrap(), foreign.path());
    assert!(!lock(&link).exists(), "the lock is left behind");
    fs::remove_file(link).unwrap();
}

#[test]
fn file_in_place_of_the_lock_is_kept() {
    let link = free_path("precious");
    fs::write(lock(&link), "precious").unwrap();
    let line = failure(&run(&["sim", "ling", "--pty", link.to_str().unwrap()]));
    assert!(line.contains(".lock exists and is not the lock of a server"), "{line}");
    assert_eq!(fs::read_to_string(lock(&link)).unwrap(), "precious");
    assert!(fs::symlink_metadata(&link).is_err());
    fs::remove_file(lock(&link)).unwrap();
}

/// The lock file of a link's server.
fn lock(link: &Path) -> PathBuf {
    link.with_added_extension("lock")
}
