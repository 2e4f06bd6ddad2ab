//! The adapter's identity.

use armwire_bridge::control::{self, Identity};

use crate::board;

/// The version of this package.
const VERSION: &str = env!("CARGO_PKG_VERSION");

/// The commit of the build: see `build.rs`.
const COMMIT: &str = env!("ARMWIRE_COMMIT");

/// This adapter's identity.
pub(crate) fn identity() -> Identity {
    let mut identity = Identity {
        version: control::VERSION,
        can_fd: board::CAN_FD,
        no_can: !board::HAS_CAN,
        chip: board::chip_id(),
        ..Identity::default()
    };
    // Strings that are too long are left out: all but the serial number are known at compile time.
    let _ = identity.firmware.push_str(VERSION);
    let _ = identity.commit.push_str(COMMIT);
    let _ = identity.board.push_str(board::NAME);
    let _ = identity.serial.push_str(board::serial_number());
    identity
}

/// Logs the version and the board.
pub(crate) fn log() {
    info!(
        "armwire {=str}, commit {=str}, board {=str}",
        VERSION,
        COMMIT,
        board::NAME
    );
}

const _: () = assert!(VERSION.len() <= 16 && COMMIT.len() <= 16 && board::NAME.len() <= 16);
