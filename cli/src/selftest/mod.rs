//! `armwire selftest`: an adapter board proves itself, with a jumper in the arm's place.
//!
//! The jumper joins PA2 and PA3, so what the adapter sends to its arm comes back. [`run`] makes the checks over any [`Usb`]:
//! that of this computer, and that of a virtual board, where the tests run it.
//!
//! ```text
//! Usb        a host with one adapter: transfers, halts, resets, a clock
//!  └ Bench   the adapter on it: its control port, and an echo over its serial port
//!     └ one file for each family of checks: fn(&mut Bench, &Plan) -> Result<Passed, Trouble>
//! ```
//!
//! A check has passed, has failed, or was not tried, with the reason. Nothing but requests that read goes out before the
//! [jumper](self#the-arm) was found.
//!
//! # The arm
//!
//! A real arm must not be on the line: it would get what was meant for the jumper. So the line is listened to first, at the
//! rate of each arm, and requests that read follow. If anything but exactly these comes back, nothing more is sent. The bytes
//! of the checks begin no frame of an arm, but for a request for the joints.

mod bench;
mod cancelled;
#[cfg(target_os = "linux")]
pub(crate) mod command;
mod descriptors;
mod echo;
mod endpoints;
mod gaps;
mod jumper;
#[cfg(target_os = "linux")]
mod linux;
mod report;
mod resets;
mod saves;
mod stamps;
mod usb;

use std::time::Duration;

use armwire_bridge::control::{Identity, Reply, Request};
use serde_json::json;

use self::bench::{Bench, odd};
pub use self::report::{Check, Passed, Trouble};
pub use self::usb::{Direction, Payload, Pipe, Request as UsbRequest, Usb, UsbError};
use crate::adapter::describe;

/// How much is checked.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Bytes of each echo.
    pub echo_bytes: usize,
    /// Frames whose stamps are looked at.
    pub stamps: u32,
    /// Requests that are cancelled.
    pub cancels: u32,
    /// Resets of the bus.
    pub resets: u32,
    /// Saves to flash.
    pub saves: u32,
    /// How long the adapter's clock is compared with the host's.
    pub crystal: Duration,
    /// The checks to make, by their names; all where there is none. Those that find the adapter and the jumper are made
    /// in any case.
    pub only: Vec<String>,
}

/// All of it, in about two minutes.
impl Default for Plan {
    fn default() -> Self {
        Self {
            echo_bytes: 4_000,
            stamps: 10_000,
            cancels: 300,
            resets: 10,
            saves: 6,
            crystal: Duration::from_secs(60),
            only: Vec::new(),
        }
    }
}

type Checked = Result<Passed, Trouble>;
type CheckFn = fn(&mut Bench<'_>, &Plan) -> Checked;

/// The checks that need the jumper, in their order.
const CHECKS: [(&str, CheckFn); 10] = [
    ("echo", echo::at_all_rates),
    ("halts", endpoints::halts),
    ("reconfiguration", endpoints::reconfiguration),
    ("cancels", cancelled::requests),
    ("resets", resets::in_full_flow),
    ("stamps", stamps::plausible),
    ("gaps", gaps::sweep),
    ("crystal", stamps::crystal),
    ("saves", saves::under_load),
    ("suspend", resets::suspend),
];

/// The names of the checks that need the jumper, in their order.
pub fn names() -> [&'static str; 10] {
    CHECKS.map(|(name, _)| name)
}

/// Makes the checks, tells of each as it ends, and returns all. Once `stopped` says so, the rest is not tried.
///
/// The adapter has its configuration back at the end, in force and in flash.
pub fn run(usb: &mut dyn Usb, plan: &Plan, stopped: &dyn Fn() -> bool, tell: &mut dyn FnMut(&Check)) -> Vec<Check> {
    let mut checks = Vec::new();
    let mut keep = |name, result| {
        let check = Check { name, result };
        tell(&check);
        checks.push(check);
    };
    let mut bench = Bench::new(usb);
    keep("control port", control_port(&mut bench));
    keep("descriptors", descriptors::all(&mut bench));
    let before = bench.config();
    let found = bench.open().and_then(|()| jumper::find(&mut bench));
    // Why the rest is not tried, once that is so.
    let mut obstacle = found.is_err().then_some("there is no jumper");
    keep("jumper", found);
    for (name, check) in CHECKS {
        if !plan.only.is_empty() && !plan.only.iter().any(|only| only == name) {
            continue;
        }
        if stopped() {
            obstacle = Some("stopped");
        }
        let result = match obstacle {
            Some(reason) => Err(Trouble::NotTried(reason.to_owned())),
            None => bench.open().and_then(|()| check(&mut bench, plan)),
        };
        let is_failed = matches!(result, Err(Trouble::Failed(_)));
        if is_failed && bench.open().and_then(|()| jumper::is_there(&mut bench)).is_err() {
            obstacle = Some("the jumper, or the adapter, is gone");
        }
        keep(name, result);
    }
    if let Ok(config) = before
        && let Err(trouble) = bench.order(Request::SetConfig(config))
    {
        keep("configuration", Err(trouble));
    }
    checks
}

/// The adapter says what it is.
fn control_port(bench: &mut Bench<'_>) -> Checked {
    let identity = identify(bench)?;
    let figures = [
        ("board", json!(identity.board)),
        ("serial", json!(identity.serial)),
        ("firmware", json!(identity.firmware)),
        ("commit", json!(identity.commit)),
    ];
    Ok(Passed::new(describe(&identity), figures))
}

fn identify(bench: &mut Bench<'_>) -> Result<Identity, Trouble> {
    match bench.call(Request::Identify)? {
        Reply::Identity(identity) => Ok(identity),
        reply => Err(odd(&Request::Identify, &reply)),
    }
}
