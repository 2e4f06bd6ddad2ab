//! A node of a CAN bus with the ISO-TP identifiers of an adapter: reassembly of its PDUs.
//!
//! Other devices may use the same identifiers. Only the content of PDUs shows an adapter: before that its entries are
//! kept, and without it they are never shown.

use std::collections::{BTreeMap, VecDeque};

use armwire_bridge::can::{Frame, Function, Id};
use armwire_bridge::control::{self, FromAdapter, FromHost, MAX_MESSAGE, Message};
use armwire_bridge::isotp::{Config, Endpoint, Event, Link};
use armwire_host::describe::Protocol;

use super::log::Time;
use super::meaning::frame_meaning;
use super::output::OnLine;
use crate::args::Speaker;

/// The high half of a flow control frame's first byte.
const FLOW_CONTROL: u8 = 3;
/// Maximum number of entries kept.
const MAX_KEPT: usize = 8;

/// An ISO-TP endpoint that only receives.
type Listener = Endpoint<MAX_MESSAGE, 1>;

/// A PDU, or the failure of one.
pub(super) struct Entry {
    /// Time, bus and node.
    pub(super) place: String,
    pub(super) bytes: Vec<u8>,
    pub(super) text: String,
    pub(super) content: Content,
    pub(super) on_line: Option<OnLine>,
    /// False for a failure.
    pub(super) is_pdu: bool,
}

/// A node with the identifiers of an adapter.
pub(super) struct Station {
    protocol: Protocol,
    /// By identifier.
    listeners: BTreeMap<Id, Listener>,
    pub(super) kind: Kind,
}

/// The kind of a node.
pub(super) enum Kind {
    Unknown {
        /// Number of frames.
        frames: u64,
        /// The last entries.
        kept: VecDeque<Entry>,
        /// Number of entries before them.
        dropped: u64,
        /// The entries have a control message, by direction.
        control: [bool; 2],
    },
    /// An adapter, and how it is known in words.
    Adapter(&'static str),
}

/// The content of a PDU.
pub(super) enum Content {
    /// A frame of this protocol's arm.
    Frame(Protocol),
    Control,
    Nothing,
}

impl Station {
    /// A node whose adapter has an arm with this protocol.
    pub(super) fn new(protocol: Protocol) -> Self {
        Self {
            protocol,
            listeners: BTreeMap::new(),
            kind: Kind::Unknown {
                frames: 0,
                kept: VecDeque::new(),
                dropped: 0,
                control: [false; 2],
            },
        }
    }

    /// Takes a frame with this function. Returns the entries to show, and the number of earlier ones that are not kept.
    pub(super) fn receive(
        &mut self,
        frame: &Frame,
        function: Function,
        time: &Time<'_>,
        place: &str,
    ) -> (Vec<Entry>, u64) {
        if let Kind::Unknown { frames, .. } = &mut self.kind {
            *frames += 1;
        }
        let (mut shown, mut lost) = (Vec::new(), 0);
        // Flow control belongs to the PDUs of the other direction.
        if frame.data().first().is_some_and(|byte| byte >> 4 == FLOW_CONTROL) {
            return (shown, lost);
        }
        let link = if frame.is_fd() { Link::Fd } else { Link::Classic };
        let new = || Listener::new(Config::new(link, frame.id()));
        let listener = self.listeners.entry(frame.id()).or_insert_with(new);
        let late = listener.tick(time.at);
        let events = listener.receive(frame.data(), time.at);
        // The receiver on the bus has sent the flow control itself.
        if listener.transmit(time.at).is_some() {
            listener.transmitted(time.at);
        }
        for event in late.chain(events) {
            let is_pdu = event == Event::Received;
            let bytes = match is_pdu {
                true => listener.received().unwrap_or_default(),
                false => frame.data(),
            };
            let (content, text) = match event {
                Event::Received => meaning(self.protocol, function, bytes),
                Event::Failed(error) => (Content::Nothing, error.to_string()),
                Event::Refused(refused) => (Content::Nothing, refused.to_string()),
                Event::Ignored(ignored) => (Content::Nothing, ignored.to_string()),
            };
            let entry = Entry {
                place: place.to_owned(),
                bytes: bytes.to_vec(),
                text,
                content,
                on_line: sender(function).filter(|_| is_pdu).map(|from| OnLine {
                    protocol: self.protocol,
                    from: Some(from),
                    nanos: time.at.as_micros().saturating_mul(1_000),
                }),
                is_pdu,
            };
            lost += self.kind.take(entry, function, &mut shown);
        }
        listener.release();
        (shown, lost)
    }

    /// Ends the log. Returns the number of PDUs that are not complete.
    pub(super) fn finish(&mut self) -> u64 {
        let listeners = self.listeners.values_mut();
        let unfinished = listeners.filter_map(|listener| listener.tick(listener.timeout()?).next());
        unfinished.count() as u64
    }
}

impl Kind {
    /// Takes an entry. Adds those to show to `shown`, and returns the number of earlier ones that are
    /// not kept.
    fn take(&mut self, entry: Entry, function: Function, shown: &mut Vec<Entry>) -> u64 {
        let Self::Unknown {
            kept, dropped, control, ..
        } = self
        else {
            shown.push(entry);
            return 0;
        };
        let evidence = match entry.content {
            Content::Frame(Protocol::Ling) => Some("frames of a Ling arm"),
            Content::Frame(Protocol::LingLegacy) => Some("frames of a Ling arm of the older generation"),
            Content::Frame(Protocol::Xarm) => Some("frames of an xArm"),
            Content::Frame(Protocol::Alpha1) => Some("frames of an Alpha1"),
            Content::Control => {
                // A message of few bytes alone may be anything.
                control[usize::from(function == Function::ControlAnswer)] = true;
                (*control == [true, true]).then_some("control messages in both directions")
            }
            Content::Nothing => None,
        };
        kept.push_back(entry);
        if let Some(evidence) = evidence {
            let dropped = *dropped;
            shown.extend(kept.drain(..));
            *self = Self::Adapter(evidence);
            return dropped;
        }
        if kept.len() > MAX_KEPT {
            kept.pop_front();
            *dropped += 1;
        }
        0
    }
}

/// The sender of PDUs that carry arm frames.
fn sender(function: Function) -> Option<Speaker> {
    match function {
        Function::ArmRequest => Some(Speaker::Host),
        Function::ArmAnswer => Some(Speaker::Arm),
        _ => None,
    }
}

/// The content of a PDU, and its meaning in words.
fn meaning(protocol: Protocol, function: Function, pdu: &[u8]) -> (Content, String) {
    let Some(from) = sender(function) else {
        return match function {
            Function::ControlRequest => message::<FromHost>("to the adapter", pdu),
            _ => message::<FromAdapter>("from the adapter", pdu),
        };
    };
    let meaning = |protocol| frame_meaning(protocol, pdu, Some(from));
    match meaning(protocol) {
        Ok(meaning) => (Content::Frame(protocol), meaning.text),
        Err(reason) => {
            let mut others = [Protocol::Ling, Protocol::LingLegacy, Protocol::Alpha1].into_iter();
            let other = others.find(|other| meaning(*other).is_ok());
            (other.map_or(Content::Nothing, Content::Frame), reason)
        }
    }
}

fn message<T: Message + std::fmt::Debug>(direction: &str, pdu: &[u8]) -> (Content, String) {
    match control::decode::<T>(pdu) {
        Ok(message) => (Content::Control, format!("{direction}: {message:?}")),
        Err(error) => (Content::Nothing, format!("{direction}: no message: {error}")),
    }
}
