//! Readings by the polls of an adapter.

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use armwire_bridge::config::Poll;
use armwire_bridge::control::{Event, Stamp, Subscription};

use super::history::History;
use super::pose::Readable;
use super::{End, Stamping};
use crate::arm::shared::Shared;
use crate::error::Error;
use crate::ports::control::Adapter;
use crate::time::rate::Rate;
use crate::time::stamps::{Clock, HostTime};

/// Maximum wait for an event, and the wait after a failed one.
const EVENT_TIMEOUT: Duration = Duration::from_millis(50);
const ERROR_PAUSE: Duration = Duration::from_millis(10);
/// Number of waits without an event after which the subscription is renewed: an adapter that was restarted has none.
const MAX_SILENT_WAITS: u32 = 10;

/// A subscription to an adapter that polls at a rate or faster.
pub(super) struct Polled {
    /// Calls of the arm have their turn between two events.
    adapter: Shared<Adapter>,
    rate: Rate,
    /// The adapter's own setting, if it was changed.
    changed: Option<Poll>,
    clock: Clock,
    gaps: Gaps,
}

impl Polled {
    /// Makes the adapter poll, and subscribes. `None` if the adapter is configured for another kind of arm.
    ///
    /// # Errors
    ///
    /// Errors of the control port.
    pub(super) fn start<A: Readable>(adapter: Adapter, rate: Rate) -> Result<Option<Self>, Error> {
        let name = adapter.name().to_owned();
        let mut polled = Self {
            adapter: Shared::new(&name, adapter),
            rate,
            changed: None,
            clock: Clock::default(),
            gaps: Gaps::new(rate),
        };
        Ok(polled.subscribe::<A>()?.then_some(polled))
    }

    /// The adapter, for calls until the end of the polls.
    pub(super) fn adapter(&self) -> Shared<Adapter> {
        self.adapter.clone()
    }

    /// Adds readings until the stop, or until no later one can succeed.
    pub(super) fn run<A: Readable>(&mut self, history: &History<A::Pose>, stop: &AtomicBool) -> End {
        let mut silent_waits = 0;
        while !stop.load(Ordering::Relaxed) {
            let event = self.adapter.read(|adapter| adapter.next_event(EVENT_TIMEOUT));
            silent_waits = if let Ok(None) = event { silent_waits + 1 } else { 0 };
            let result = match event {
                Ok(Some((stamp, Event::Frame { bytes, .. }))) => {
                    let received = HostTime::now();
                    if let Some(pose) = A::pose(&bytes) {
                        history.add_lost(self.gaps.before(stamp));
                        history.push(pose, self.clock.host_time(stamp, received), Stamping::Adapter);
                    }
                    Ok(())
                }
                Ok(Some(_)) => Ok(()),
                Ok(None) if silent_waits < MAX_SILENT_WAITS => Ok(()),
                Ok(None) => {
                    silent_waits = 0;
                    self.subscribe::<A>().map(drop)
                }
                Err(error) => Err(error),
            };
            if let Err(error) = result {
                match End::by(error) {
                    Some(end) => return end,
                    // Dropped events, or a message that cannot be read.
                    None => thread::park_timeout(ERROR_PAUSE),
                }
            }
        }
        End::Closed
    }

    /// Makes the adapter poll and subscribes, also after its restart. Returns false if it has another kind of arm.
    fn subscribe<A: Readable>(&mut self) -> Result<bool, Error> {
        let mut config = self.adapter.call(Adapter::config)?;
        if A::KIND != Some(config.arm) {
            return Ok(false);
        }
        let is_slower = match config.poll {
            Poll::Off => true,
            Poll::Hertz(hertz) => hertz < self.rate.hertz(),
            Poll::Fastest => false,
        };
        if is_slower {
            self.changed.get_or_insert(config.poll);
            config.poll = Poll::Hertz(self.rate.hertz());
            self.adapter.call(|adapter| adapter.set_config(config))?;
        }
        let (frames, events) = (true, false);
        self.adapter
            .call(|adapter| adapter.subscribe(Subscription { frames, events }))?;
        // The adapter may have been restarted: it counts from zero then.
        self.clock = Clock::default();
        self.gaps = Gaps::new(self.rate);
        Ok(true)
    }

    /// Restores the adapter's setting, unless another program has changed it.
    fn restore(&mut self, poll: Poll) -> Result<(), Error> {
        let mut config = self.adapter.call(Adapter::config)?;
        if config.poll == Poll::Hertz(self.rate.hertz()) {
            config.poll = poll;
            self.adapter.call(|adapter| adapter.set_config(config))?;
        }
        Ok(())
    }
}

impl Drop for Polled {
    fn drop(&mut self) {
        if let Some(poll) = self.changed {
            // An error has no recipient, and the setting ends with the adapter's next start.
            let _ = self.restore(poll);
        }
        // Calls by the arm open its control port anew.
        drop(self.adapter.take());
    }
}

/// The polls that are missing between two readings.
struct Gaps {
    /// In microseconds.
    period: u64,
    last: Option<Stamp>,
}

impl Gaps {
    const fn new(rate: Rate) -> Self {
        Self {
            period: rate.micros().as_micros(),
            last: None,
        }
    }

    /// The number of polls between the reading before and that of this stamp. The adapter may poll faster than the rate,
    /// and hosts may read in between.
    fn before(&mut self, stamp: Stamp) -> u64 {
        let last = self.last.replace(stamp);
        let gap = last.map_or(0, |last| stamp.0.saturating_sub(last.0));
        ((gap + self.period / 2) / self.period).saturating_sub(1)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use armwire::ling::{Response, Stroke};
    use armwire_bridge::config::{ArmKind, Config};

    use super::super::fake::{adapter, frame, state};
    use super::*;
    use crate::arm::ling::Ling;

    #[test]
    fn readings_have_the_stamps_of_the_adapter() {
        let config = Arc::default();
        let events = vec![
            frame(900_000, &Response::Joints(state(1))),
            frame(902_000, &Response::Stroke(Stroke::Mm50)),
            frame(905_000, &Response::Joints(state(2))),
            frame(915_000, &Response::Joints(state(3))),
        ];
        let rate = Rate::new(200).unwrap();
        let mut polled = Polled::start::<Ling>(adapter(&config, [events]), rate)
            .unwrap()
            .unwrap();
        assert_eq!(config.lock().unwrap().poll, Poll::Hertz(200));
        let history = History::new();
        let end = polled.run::<Ling>(&history, &AtomicBool::new(false));
        assert_eq!(end, End::Lost("gone".into()));
        let readings = [1, 2, 3].map(|number| history.next_after(number - 1, Duration::ZERO).unwrap().unwrap());
        assert_eq!(readings.map(|reading| reading.pose), [1, 2, 3].map(state));
        assert!(readings.iter().all(|reading| reading.stamping == Stamping::Adapter));
        assert_eq!((history.counts().samples, history.counts().lost), (3, 1));
        drop(polled);
        assert_eq!(config.lock().unwrap().poll, Poll::Off, "as it was");
    }

    #[test]
    fn restarted_adapter_is_subscribed_to_again() {
        let config = Arc::default();
        let before = vec![frame(900_000, &Response::Joints(state(1)))];
        let after = vec![
            frame(1_000, &Response::Joints(state(2))),
            frame(6_000, &Response::Joints(state(3))),
        ];
        let rate = Rate::new(200).unwrap();
        let mut polled = Polled::start::<Ling>(adapter(&config, [before, after]), rate)
            .unwrap()
            .unwrap();
        // It polls by its saved setting again.
        *config.lock().unwrap() = Config::default();
        let history = History::new();
        polled.run::<Ling>(&history, &AtomicBool::new(false));
        assert_eq!(config.lock().unwrap().poll, Poll::Hertz(200));
        assert_eq!((history.counts().samples, history.counts().lost), (3, 0));
        let readings = [1, 2, 3].map(|number| history.next_after(number - 1, Duration::ZERO).unwrap().unwrap());
        let times = readings.map(|reading| reading.time.monotonic_ns);
        assert!(times.is_sorted(), "{times:?}");
        assert_eq!(readings[2].pose, state(3));
    }

    #[test]
    fn faster_polls_are_left_alone() {
        let fast = Config {
            poll: Poll::Hertz(500),
            ..Config::default()
        };
        let config = Arc::new(Mutex::new(fast));
        let polled = Polled::start::<Ling>(adapter(&config, []), Rate::new(200).unwrap());
        drop(polled.unwrap().unwrap());
        assert_eq!(*config.lock().unwrap(), fast);
    }

    #[test]
    fn adapter_of_another_arm_is_not_used() {
        let config = Arc::new(Mutex::new(Config {
            arm: ArmKind::Alpha1,
            ..Config::default()
        }));
        let polled = Polled::start::<Ling>(adapter(&config, []), Rate::new(200).unwrap());
        assert!(polled.unwrap().is_none());
    }

    #[test]
    fn missing_polls_are_counted_by_the_stamps() {
        let mut gaps = Gaps::new(Rate::new(200).unwrap());
        let lost = |micros| gaps.before(Stamp(micros));
        // The last is by a restarted adapter.
        let stamps = [900_000, 905_100, 909_900, 920_000, 921_000, 950_000, 1_000];
        assert_eq!(stamps.map(lost), [0, 0, 0, 1, 0, 5, 0]);
    }
}
