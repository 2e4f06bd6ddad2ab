//! How fast the firmware image and the virtual board are, as `cargo xtask performance` measures it.
//!
//! What is measured in virtual time is the same in each run of the same image.

pub mod latency;
pub mod load;
pub mod profile;
pub mod rates;

use armwire_bridge::config::{self, Config};
use armwire_bridge::control;
use armwire_virtual_board::VirtualBoard;
use armwire_virtual_board::line::Arm;

use super::Control;

/// The arm is polled as fast as the wire allows.
fn fastest() -> Config {
    Config {
        poll: config::Poll::Fastest,
        ..Config::default()
    }
}

/// The host on CAN is told of all that the arm says unasked.
fn unsolicited() -> Config {
    let can = config::Can {
        unsolicited: true,
        ..config::Can::default()
    };
    Config {
        can,
        ..Config::default()
    }
}

/// Sets the adapter's configuration.
fn configure<A: Arm>(board: &mut VirtualBoard<A>, config: Config) {
    Control::open(board).order(board, control::Request::SetConfig(config));
}
