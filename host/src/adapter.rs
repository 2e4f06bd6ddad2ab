//! An adapter on the command line: its port, identity and counters.

use armwire_bridge::control::{Histogram, Identity, Latencies, LineState, Reply, Request};
use armwire_bridge::store::Saved;
use serde_json::{Map, Value, json};

use crate::control::ControlLink;
use crate::describe::Fact;
use crate::error::Error;

/// Reads an adapter's identity.
///
/// # Errors
///
/// Errors of the control port.
pub fn identify(control: &mut ControlLink) -> Result<Identity, Error> {
    match control.call(Request::Identify)? {
        Reply::Identity(identity) => Ok(identity),
        reply => Err(unexpected(control, &reply)),
    }
}

/// An adapter's identity, as text and as JSON.
pub fn identity(control: &mut ControlLink) -> Result<Fact, Error> {
    let identity = identify(control)?;
    let values = [
        ("adapter_board", json!(identity.board)),
        ("adapter_serial", json!(identity.serial)),
        ("adapter_firmware", json!(identity.firmware)),
        ("adapter_commit", json!(identity.commit)),
        ("adapter_can_fd", json!(identity.can_fd)),
    ];
    Ok(Fact::of("adapter", describe(&identity), values))
}

/// An adapter's identity as text.
pub fn describe(identity: &Identity) -> String {
    let commit = match identity.commit.as_str() {
        "" => String::new(),
        commit => format!(" ({commit})"),
    };
    let can_fd = if identity.can_fd { ", CAN FD" } else { "" };
    format!(
        "{}, serial number {}, firmware {}{commit}{can_fd}",
        identity.board, identity.serial, identity.firmware
    )
}

/// Reads all counters of an adapter by their names, in the order of their declaration.
///
/// # Errors
///
/// Errors of the control port.
pub fn counters(control: &mut ControlLink) -> Result<Map<String, Value>, Error> {
    match control.call(Request::GetCounters)? {
        Reply::Counters(counters) => match serde_json::to_value(counters) {
            Ok(Value::Object(counters)) => Ok(counters),
            _ => unreachable!("a structure of numbers is a map"),
        },
        reply => Err(unexpected(control, &reply)),
    }
}

/// An adapter's latency histograms.
///
/// # Errors
///
/// Errors of the control port.
pub fn latencies(control: &mut ControlLink) -> Result<Latencies, Error> {
    match control.call(Request::GetLatencies)? {
        Reply::Latencies(latencies) => Ok(latencies),
        reply => Err(unexpected(control, &reply)),
    }
}

/// The line between an adapter and its arm. `None` from an adapter that is older than the question.
pub fn line(control: &mut ControlLink) -> Result<Option<LineState>, Error> {
    match control.call(Request::GetLine) {
        Ok(Reply::Line(line)) => Ok(Some(line)),
        Ok(reply) => Err(unexpected(control, &reply)),
        Err(Error::Unsupported { .. }) => Ok(None),
        Err(error) => Err(error),
    }
}

/// The state of an adapter in recovery, in words.
pub const RECOVERY: &str = "factory settings after crashed starts: CAN is off, and the saved settings are unused and \
                            unchanged until others are saved";

/// Returns true if the adapter is in recovery. An adapter of an older version never is.
///
/// # Errors
///
/// Errors of the control port.
pub fn is_in_recovery(control: &mut ControlLink) -> Result<bool, Error> {
    match control.call(Request::GetRecovery) {
        Ok(Reply::Recovery { active }) => Ok(active),
        Ok(reply) => Err(unexpected(control, &reply)),
        Err(Error::Unsupported { .. }) => Ok(false),
        Err(error) => Err(error),
    }
}

/// The configuration in an adapter's flash.
pub fn saved(control: &mut ControlLink) -> Result<Saved, Error> {
    match control.call(Request::GetSaved)? {
        Reply::Saved(saved) => Ok(saved),
        reply => Err(unexpected(control, &reply)),
    }
}

/// The measured quantities by name.
pub fn histograms(latencies: &Latencies) -> [(&'static str, &'static str, &Histogram); 3] {
    [
        (
            "answer",
            "from a request's last byte to its answer's last byte",
            &latencies.answer,
        ),
        (
            "turn",
            "from a request's arrival at the adapter to its first byte on the line",
            &latencies.turn,
        ),
        (
            "poll",
            "from a poll's slot to its first byte on the line",
            &latencies.poll,
        ),
    ]
}

/// The error for a reply of the wrong type.
pub fn unexpected(control: &ControlLink, reply: &Reply) -> Error {
    let reason = format!("the adapter sent a reply of the wrong type: {reply:?}");
    Error::unacceptable(control.name(), reason)
}

/// Number of durations in a histogram.
pub fn total(histogram: &Histogram) -> u64 {
    histogram.counts.iter().map(|&count| u64::from(count)).sum()
}

/// A percentile in words; `None` without measurements.
pub fn percentile(histogram: &Histogram, percent: u64) -> Option<String> {
    let least = (total(histogram) * percent).div_ceil(100).max(1);
    let mut sum = 0;
    let bucket = histogram.counts.iter().position(|&count| {
        sum += u64::from(count);
        sum >= least
    })?;
    Some(limit(bucket))
}

/// A bucket in words, such as `< 512 µs`.
pub fn limit(bucket: usize) -> String {
    match Histogram::limit(bucket) {
        Some(limit) => format!("< {} µs", limit.as_micros()),
        None => format!("≥ {} µs", Histogram::limit(bucket - 1).unwrap_or_default().as_micros()),
    }
}

/// A histogram as the upper limits of its buckets, in microseconds, with their counts. The last has no limit.
pub fn histogram_json(histogram: &Histogram) -> Value {
    let buckets = histogram.counts.iter().enumerate();
    let buckets = buckets
        .map(|(i, count)| json!({ "below_us": Histogram::limit(i).map(|limit| limit.as_micros()), "count": count }));
    Value::Array(buckets.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn adapter_tells_whether_it_has_can_fd() {
        let mut identity = Identity::default();
        identity.board.push_str("stm32g431").unwrap();
        identity.firmware.push_str("0.1.0").unwrap();
        identity.commit.push_str("1a2b3c4d5e6f").unwrap();
        identity.can_fd = true;
        assert_eq!(
            describe(&identity),
            "stm32g431, serial number , firmware 0.1.0 (1a2b3c4d5e6f), CAN FD"
        );
    }
}
