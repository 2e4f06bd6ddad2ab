//! `armwire selftest`: hardware checks of an adapter board, with a jumper in place of the arm.
//!
//! The jumper joins the pins to and from the arm, TX and RX: bytes for the arm come back. [`run`] makes the checks over
//! any [`Usb`]: that of this computer, or that of a virtual board in the tests.
//!
//! ```text
//! Usb        a host with one adapter: transfers, halts, resets, a clock
//!  └ Bench   the adapter on it: its control port, and an echo over its serial port
//!     └ one file for each family of checks: fn(&mut Bench, &Plan) -> Result<Passed, Trouble>
//! ```
//!
//! A check passes, fails or is not tried; the last two have a reason. Only read requests go out before the
//! [jumper](self#the-arm) is detected.
//!
//! # The arm
//!
//! A real arm must not be on the line: it would receive the test bytes. The first check therefore listens at the rate
//! of each arm and then sends read requests. Nothing more is sent unless exactly the same bytes come back. The test
//! bytes contain no start of an arm's frame, except in a request for the joints. The adapter's configuration, the
//! dead-man timer in it, does not change before the jumper is detected.

mod bench;
mod cancelled;
pub(crate) mod command;
mod descriptors;
mod echo;
mod endpoints;
mod gaps;
mod jumper;
mod linux;
mod plan;
mod report;
mod resets;
mod saves;
mod stamps;
mod usb;

use armwire_bridge::Counters;
use armwire_bridge::control::Request;
use armwire_host::adapter::chip;
use serde_json::json;

use self::bench::{Bench, identify};
pub use self::plan::Plan;
use self::plan::planned;
use self::report::Checked;
pub use self::report::{Check, Passed, Trouble, report};
pub use self::usb::{Direction, Payload, Pipe, Request as UsbRequest, Usb, UsbError};
use crate::adapter::describe;

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

/// Makes the checks, reports each as it ends, and returns all. Once `stopped` returns true, a long check ends within a
/// second, and the remaining checks are not tried.
///
/// The adapter's configuration is restored at the end, in RAM and in flash.
pub fn run(usb: &mut dyn Usb, plan: &Plan, stopped: &dyn Fn() -> bool, report: &mut dyn FnMut(&Check)) -> Vec<Check> {
    let mut checks = Vec::new();
    let mut keep = |name, result| {
        let check = Check { name, result };
        report(&check);
        checks.push(check);
    };
    let mut bench = Bench::new(usb, stopped);
    keep("control port", control_port(&mut bench));
    keep("descriptors", descriptors::all(&mut bench));
    let before = bench.config();
    let found = bench.with_reserved_line(jumper::find);
    // Reason to skip the remaining checks.
    let mut obstacle = match &before {
        Err(_) => Some("the configuration could not be read, to be restored"),
        Ok(_) => found.is_err().then_some("there is no jumper"),
    };
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

/// The adapter's counters, if it answers.
pub fn counters(usb: &mut dyn Usb) -> Option<Counters> {
    Bench::new(usb, &|| false).counters().ok()
}

/// Reads the adapter's identity.
fn control_port(bench: &mut Bench<'_>) -> Checked {
    let identity = identify(bench)?;
    let figures = [
        ("board", json!(identity.board)),
        ("serial", json!(identity.serial)),
        ("firmware", json!(identity.firmware)),
        ("commit", json!(identity.commit)),
        ("chip", json!(chip(&identity))),
    ];
    Ok(Passed::new(describe(&identity).to_string(), figures))
}
