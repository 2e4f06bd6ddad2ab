//! The measures of a run: its conditions, times on the line, and the initiators of bursts.

use armwire_bridge::Counters;
use armwire_bridge::control::Initiator;

/// Conditions, by name, each required in at least one of twenty runs, and true for those met in this run.
pub type Conditions = [(&'static str, bool); 15];

/// Duration of `bytes` bytes at 1 Mbaud, in µs.
pub(super) const fn byte_times(bytes: usize) -> u64 {
    10 * bytes as u64
}

/// The initiator of a burst for the arm, by the counters before and after it.
///
/// # Panics
///
/// If the burst has requests of several initiators.
pub fn initiator(before: &Counters, after: &Counters) -> Initiator {
    let others = [
        (Initiator::Can, after.requests_can - before.requests_can),
        (Initiator::Poll, after.requests_poll - before.requests_poll),
        (Initiator::Command, after.requests_command - before.requests_command),
        (Initiator::Adapter, after.requests_adapter - before.requests_adapter),
    ];
    let Some(&(initiator, _)) = others.iter().find(|(_, requests)| *requests > 0) else {
        return Initiator::Usb;
    };
    let requests: u32 = others.iter().map(|(_, requests)| requests).sum();
    assert_eq!((requests, after.requests_usb), (1, before.requests_usb));
    initiator
}
