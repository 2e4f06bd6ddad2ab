//! Bus resets during traffic, and suspend: the adapter re-enumerates, and later bytes are intact.

use std::time::Duration;

use serde_json::json;

use super::bench::{Bench, STALL_TIMEOUT, at, compare, payload};
use super::report::{Passed, Trouble, ensure};
use super::usb::Pipe;
use super::{Checked, Plan, planned};

/// Bytes sent before a reset, and the number of them that must have come back by then.
const FLOW: usize = 3_000;
const RECEIVED: usize = 400;
/// Bytes echoed afterwards.
const AFTER: usize = 600;
/// Duration of the suspend. A device detects it after 3 ms.
const SUSPEND_TIME: Duration = Duration::from_millis(100);

/// Resets the bus while bytes flow in both directions.
pub(super) fn in_full_flow(bench: &mut Bench<'_>, plan: &Plan) -> Checked {
    planned(plan.resets)?;
    let before = bench.counters()?.usb_resets;
    for nth in 0..plan.resets {
        bench.check_stop()?;
        reset(bench, nth.into()).map_err(at(format_args!("reset {nth}")))?;
    }
    let counted = bench.counters()?.usb_resets.wrapping_sub(before);
    let reason = format_args!("{} resets, {counted} seen by the adapter", plan.resets);
    ensure(counted >= plan.resets, reason)?;
    let text = format!("{} under full traffic, no byte lost or changed afterwards", plan.resets);
    Ok(Passed::new(text, [("resets", json!(plan.resets))]))
}

fn reset(bench: &mut Bench<'_>, nth: u64) -> Result<(), Trouble> {
    let sent = payload(nth, FLOW);
    bench.usb.send(Pipe::Port, &sent)?;
    let mut received = 0;
    // A later moment each time, to hit a different byte.
    while received < RECEIVED + 13 * nth as usize {
        let more = bench.usb.receive(Pipe::Port, STALL_TIMEOUT)?;
        compare(&sent, received, &more)?;
        received += more.len();
        ensure(
            !more.is_empty(),
            format_args!("{received} of {FLOW} bytes came back before it"),
        )?;
    }
    bench.usb.reset()?;
    bench.forget_session();
    bench.open()?;
    bench.echo(&payload(!nth, AFTER))?;
    Ok(())
}

/// Suspends the bus, and resumes it.
pub(super) fn suspend(bench: &mut Bench<'_>, _: &Plan) -> Checked {
    let before = bench.counters()?.usb_suspends;
    bench.usb.suspend(SUSPEND_TIME)?;
    let counted = bench.counters()?.usb_suspends.wrapping_sub(before);
    ensure(counted > 0, "the adapter did not see that the bus was suspended")?;
    bench.open()?;
    bench.echo(&payload(3, AFTER))?;
    let text = format!("{} ms, no byte lost or changed afterwards", SUSPEND_TIME.as_millis());
    Ok(Passed::new(text, []))
}
