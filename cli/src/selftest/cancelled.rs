//! Cancelled control transfers: the adapter answers the next transfer after a cancel in any stage.

use std::time::Duration;

use armwire_bridge::LineCoding;
use serde_json::json;

use super::bench::{Bench, at, get_line_coding, payload, read_counters, set_line_coding};
use super::report::{Passed, Trouble, ensure};
use super::{Checked, Plan, planned};

/// Timeout of the next transfer after a cancel.
const READY_TIMEOUT: Duration = Duration::from_millis(100);
/// Latest moment of a cancel, in microseconds. Later the transfer is complete.
const LATEST_US: u32 = 400;
/// Number of requests between two echoes.
const BETWEEN_ECHOES: u32 = 10;

/// Cancels reads and writes at many different moments.
pub(super) fn requests(bench: &mut Bench<'_>, plan: &Plan) -> Checked {
    planned(plan.cancels)?;
    let coding = LineCoding::LING.to_cdc();
    let mut cancelled = 0_u32;
    for nth in 0..plan.cancels {
        bench.check_stop()?;
        let after = Duration::from_micros((nth * LATEST_US / plan.cancels).into());
        let request = match nth % 3 {
            0 => get_line_coding(),
            1 => set_line_coding(&coding),
            _ => read_counters(),
        };
        let name = ["GET_LINE_CODING", "SET_LINE_CODING", "a read of the counters"][nth as usize % 3];
        let was_over = bench.usb.cancel(&request, after)?;
        cancelled += u32::from(!was_over);
        answers(bench, nth).map_err(at(format_args!("{name} cancelled after {} µs", after.as_micros())))?;
    }
    if cancelled == 0 {
        return Err(Trouble::NotTried(format!(
            "each of {} transfers was over before this host cancelled it",
            plan.cancels
        )));
    }
    let text = format!("{cancelled} cancelled, the next one answered each time");
    let figures = [("requests", json!(plan.cancels)), ("cancelled", json!(cancelled))];
    Ok(Passed::new(text, figures))
}

fn answers(bench: &mut Bench<'_>, nth: u32) -> Result<(), Trouble> {
    let begun = bench.usb.now();
    let coding = bench.line_coding()?;
    let took = bench.usb.now() - begun;
    ensure(
        coding == LineCoding::LING,
        format_args!("the line coding is {coding:?}"),
    )?;
    let reason = format_args!("the next request was answered after {} ms", took.as_millis());
    ensure(took <= READY_TIMEOUT, reason)?;
    if nth.is_multiple_of(BETWEEN_ECHOES) {
        bench.echo(&payload(nth.into(), 100))?;
    }
    Ok(())
}
