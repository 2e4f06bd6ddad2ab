//! Readings from an adapter's events: the frames of the arm with the adapter's stamps, for requests of any host. The arm's
//! port stays free.

use std::marker::PhantomData;
use std::time::Duration;

use armwire::alpha1::Alpha1;
use armwire::ling::Ling;
use armwire_bridge::config::{ArmKind, Poll};
use armwire_bridge::control::{self, Event, Subscription};
use armwire_host::{Adapter, LineErrors, RECOVERY, adapter};

use super::polled::{Readable, news};
use super::reading::{News, OnFrame, Source};
use super::recorder::Recorder;
use crate::error::Error;

/// Maximum wait for an event. Keys are read between waits.
const EVENT_TIMEOUT: Duration = Duration::from_millis(50);

/// A subscription to the adapter of an arm with this protocol.
struct Subscribed<P> {
    control: Adapter,
    /// A first notice for the user.
    hint: Option<String>,
    on_frame: Option<OnFrame>,
    arm: PhantomData<P>,
}

/// Subscribes to all events of the adapter.
pub(super) fn open(mut control: Adapter, recorder: &Recorder) -> Result<Box<dyn Source>, Error> {
    let config = control.config()?;
    let source = match config.arm {
        ArmKind::Ling => Subscribed::<Ling>::open,
        ArmKind::Alpha1 => Subscribed::<Alpha1>::open,
        arm => {
            let reason = format!("the adapter is configured for arm '{arm}', which has no readings");
            return Err(Error::at(control.name(), reason));
        }
    };
    let all = Subscription {
        frames: true,
        events: true,
    };
    control.call(control::Request::Subscribe(all))?;
    let hint = (config.poll == Poll::Off).then(|| {
        "the adapter does not poll: only answers to other hosts are shown ('armwire config PORT set poll=200' starts \
         polling)"
            .to_owned()
    });
    Ok(source(control, hint, recorder))
}

impl<P: Readable + 'static> Subscribed<P> {
    fn open(control: Adapter, hint: Option<String>, recorder: &Recorder) -> Box<dyn Source> {
        Box::new(Self {
            control,
            hint,
            on_frame: recorder.on_frame(P::PROTOCOL),
            arm: PhantomData,
        })
    }
}

impl<P: Readable> Source for Subscribed<P> {
    fn arm(&self) -> &'static str {
        P::NAME
    }

    fn servos(&self) -> usize {
        P::SERVOS
    }

    fn is_polled(&self) -> bool {
        false
    }

    fn is_paced(&self) -> bool {
        false
    }

    fn read(&mut self) -> Result<News, Error> {
        if let Some(hint) = self.hint.take() {
            return Ok(News::Notice(hint));
        }
        Ok(match self.control.next_event(EVENT_TIMEOUT)? {
            None => News::Nothing,
            Some((at, Event::Frame { bytes, .. })) => {
                if let Some(on_frame) = &mut self.on_frame {
                    on_frame(at, &bytes);
                }
                match news::<P>(&bytes) {
                    News::Reading(facts, _) => News::Reading(facts, Some(at)),
                    other => other,
                }
            }
            Some((_, event)) => News::Notice(describe(&event)),
        })
    }

    /// The adapter has counters of its own.
    fn line_errors(&self) -> LineErrors {
        LineErrors::default()
    }

    fn adapter(&mut self) -> Option<&mut Adapter> {
        Some(&mut self.control)
    }
}

/// An event in words. Recovery has its remedy, too.
fn describe(event: &Event) -> String {
    match event {
        Event::Recovery { active: true } => format!("the adapter has {RECOVERY}"),
        event => adapter::describe_event(event),
    }
}
