//! Requests to an adapter, and its identity, events and latencies in words.

use armwire_bridge::Counters;
use armwire_bridge::config::Config;
use armwire_bridge::control::{
    Event, Histogram, Identity, Latencies, LineState, Reply, Request, StopInForce, Subscription,
};
use armwire_bridge::store::Saved;
use serde_json::{Value, json};

use crate::describe::Fact;
use crate::error::Error;
use crate::error::outside::Outside;
use crate::ports::control::Adapter;
use crate::ports::settings::Setting;

impl Adapter {
    /// Reads an adapter's identity.
    ///
    /// # Errors
    ///
    /// Errors of the control port.
    pub fn identify(&mut self) -> Result<Identity, Error> {
        match self.call(Request::Identify)? {
            Reply::Identity(identity) => Ok(identity),
            reply => Err(self.unexpected(&reply)),
        }
    }

    /// Reads the counters of an adapter. [`Counters::iter`] has their names.
    ///
    /// # Errors
    ///
    /// Errors of the control port.
    pub fn counters(&mut self) -> Result<Counters, Error> {
        match self.call(Request::GetCounters)? {
            Reply::Counters(counters) => Ok(counters),
            reply => Err(self.unexpected(&reply)),
        }
    }

    /// An adapter's latency histograms.
    ///
    /// # Errors
    ///
    /// Errors of the control port.
    pub fn latencies(&mut self) -> Result<Latencies, Error> {
        match self.call(Request::GetLatencies)? {
            Reply::Latencies(latencies) => Ok(latencies),
            reply => Err(self.unexpected(&reply)),
        }
    }

    /// The line between an adapter and its arm. `None` from an adapter that is older than the question.
    pub fn line(&mut self) -> Result<Option<LineState>, Error> {
        match self.call(Request::GetLine) {
            Ok(Reply::Line(line)) => Ok(Some(line)),
            Ok(reply) => Err(self.unexpected(&reply)),
            Err(Error::Unsupported { .. }) => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Returns true if the adapter is in recovery. An adapter of an older version never is.
    ///
    /// # Errors
    ///
    /// Errors of the control port.
    pub fn is_in_recovery(&mut self) -> Result<bool, Error> {
        match self.call(Request::GetRecovery) {
            Ok(Reply::Recovery { active }) => Ok(active),
            Ok(reply) => Err(self.unexpected(&reply)),
            Err(Error::Unsupported { .. }) => Ok(false),
            Err(error) => Err(error),
        }
    }

    /// The stop for which the adapter refuses motion.
    ///
    /// # Errors
    ///
    /// [`Error::Unsupported`] from an adapter that is older than the question. Errors of the control port.
    pub fn stop_in_force(&mut self) -> Result<Option<StopInForce>, Error> {
        match self.call(Request::GetStop)? {
            Reply::Stop(stop) => Ok(stop),
            reply => Err(self.unexpected(&reply)),
        }
    }

    /// The configuration in an adapter's flash.
    pub fn saved(&mut self) -> Result<Saved, Error> {
        match self.call(Request::GetSaved)? {
            Reply::Saved(saved) => Ok(saved),
            reply => Err(self.unexpected(&reply)),
        }
    }

    /// The configuration in force.
    ///
    /// # Errors
    ///
    /// Errors of the control port.
    pub fn config(&mut self) -> Result<Config, Error> {
        match self.call(Request::GetConfig)? {
            Reply::Config(config) => Ok(config),
            reply => Err(self.unexpected(&reply)),
        }
    }

    /// Sets the configuration. It lasts until the next start of the adapter, unless it is [saved](Self::save_config).
    ///
    /// # Errors
    ///
    /// [`Error::Refused`] for a configuration that the adapter rejects, and errors of the control port.
    pub fn set_config(&mut self, config: Config) -> Result<(), Error> {
        self.call(Request::SetConfig(config)).map(drop)
    }

    /// Changes these settings as [`set_config`](Self::set_config) does, and returns the configuration.
    ///
    /// # Errors
    ///
    /// [`Error::Refused`] for a setting that the adapter does not have, and as of [`set_config`](Self::set_config).
    pub fn change_config(&mut self, settings: &[Setting]) -> Result<Config, Error> {
        let identity = self.identify()?;
        if let Some(Setting { key, .. }) = settings.iter().find(|setting| !setting.key.is_of(&identity)) {
            let reason = format_args!("the adapter has no CAN, and no setting '{}'", key.name);
            return Err(Error::refused(self.name(), reason));
        }
        let mut config = self.config()?;
        for setting in settings {
            setting
                .apply(&mut config)
                .map_err(|error| Error::Port(error.to_string().into()))?;
        }
        self.set_config(config)?;
        Ok(config)
    }

    /// Saves the configuration in force for later starts.
    ///
    /// # Errors
    ///
    /// [`Error::Refused`] if it is not saved, and errors of the control port.
    pub fn save_config(&mut self) -> Result<(), Error> {
        self.call(Request::SaveConfig).map(drop)
    }

    /// Erases the saved configuration, and restores the factory settings.
    ///
    /// # Errors
    ///
    /// As of [`save_config`](Self::save_config).
    pub fn reset_config(&mut self) -> Result<(), Error> {
        self.call(Request::ResetConfig).map(drop)
    }

    /// Subscribes to the arm's frames and to the adapter's events, which [`next_event`](Self::next_event) returns.
    ///
    /// # Errors
    ///
    /// Errors of the control port.
    pub fn subscribe(&mut self, to: Subscription) -> Result<(), Error> {
        self.call(Request::Subscribe(to)).map(drop)
    }

    /// The error for a reply of the wrong type.
    fn unexpected(&self, reply: &Reply) -> Error {
        let reason = format!("the adapter sent a reply of the wrong type: {reply:?}");
        Error::unacceptable(self.name(), reason)
    }
}

/// An adapter's identity, as text and as JSON.
pub fn identity(identity: &Identity) -> Fact {
    let values = [
        ("adapter_board", json!(identity.board)),
        ("adapter_serial", json!(identity.serial)),
        ("adapter_firmware", json!(identity.firmware)),
        ("adapter_commit", json!(identity.commit)),
    ];
    let can_fd = (!identity.no_can).then(|| ("adapter_can_fd", json!(identity.can_fd)));
    let chip = chip(identity).map(|chip| ("adapter_chip", json!(chip)));
    Fact::of(
        "adapter",
        describe(identity),
        values.into_iter().chain(can_fd).chain(chip),
    )
}

/// The chip's kind and revision, as its register has them. `None` if the adapter does not tell.
pub fn chip(identity: &Identity) -> Option<String> {
    (identity.chip != 0).then(|| format!("{:#010x}", identity.chip))
}

/// An adapter's identity as text.
pub fn describe(identity: &Identity) -> Outside {
    let commit = match identity.commit.as_str() {
        "" => String::new(),
        commit => format!(" ({commit})"),
    };
    let can_fd = if identity.can_fd { ", CAN FD" } else { "" };
    let chip = chip(identity).map_or_else(String::new, |chip| format!(", chip {chip}"));
    let text = format!(
        "{}, serial number {}, firmware {}{commit}{can_fd}{chip}",
        identity.board, identity.serial, identity.firmware
    );
    text.into()
}

/// The state of an adapter in recovery, in words.
pub const RECOVERY: &str = "factory settings after crashed starts, without CAN: the saved settings are unused and unchanged \
                            until others are saved";

/// An event in words.
pub fn describe_event(event: &Event) -> String {
    match event {
        Event::HostSilent {
            initiator,
            dropped,
            torque_off,
        } => {
            let torque = if *torque_off { ", torque switched off" } else { "" };
            format!("host timeout on {initiator}: {dropped} bytes dropped{torque}")
        }
        Event::Refused { initiator, reason } => format!("a request of {initiator} was refused: {reason}"),
        Event::BusOff { off: true } => "CAN bus-off: too many errors".to_owned(),
        Event::BusOff { off: false } => "recovered from CAN bus-off".to_owned(),
        Event::Recovery { active: true } => format!("the adapter has {RECOVERY}"),
        Event::Recovery { active: false } => "the adapter has saved settings again".to_owned(),
        other => format!("{other:?}"),
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
    use armwire_bridge::control::Initiator;

    use super::*;

    #[test]
    fn identity_is_escaped_and_tells_can_fd() {
        let mut identity = Identity::default();
        identity.board.push_str("stm32g431\x1B").unwrap();
        identity.firmware.push_str("0.1.0").unwrap();
        identity.commit.push_str("1a2b3c4d5e6f").unwrap();
        identity.can_fd = true;
        assert_eq!(
            describe(&identity).to_string(),
            r"stm32g431\u{1b}, serial number , firmware 0.1.0 (1a2b3c4d5e6f), CAN FD"
        );
    }

    #[test]
    fn events_of_an_adapter_are_told_in_words() {
        let recovery = describe_event(&Event::Recovery { active: true });
        assert!(
            recovery.starts_with("the adapter has factory settings after crashed starts, without CAN"),
            "{recovery}"
        );
        let silent = Event::HostSilent {
            initiator: Initiator::Usb,
            dropped: 5,
            torque_off: true,
        };
        assert_eq!(
            describe_event(&silent),
            "host timeout on usb: 5 bytes dropped, torque switched off"
        );
    }
}
