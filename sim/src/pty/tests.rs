//! Ptys and their links.

use std::fs::{self, File, OpenOptions};
use std::io::{Read, Write};
use std::os::unix::fs::symlink;
use std::path::PathBuf;

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
    assert_eq!(fs::read_link(&link).unwrap(), pty.0.device);
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
        assert_eq!(fs::read_link(&link).unwrap(), second.0.device);
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
    assert_eq!(fs::read_link(&link).unwrap(), first.0.device);
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
