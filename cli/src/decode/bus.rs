//! The frames of a CAN bus: reassembly of the ISO-TP PDUs of adapters.

use std::collections::BTreeMap;

use armwire_bridge::can::{Frame, Function, Id, Node};
use armwire_bridge::control::{self, FromAdapter, FromHost, MAX_MESSAGE, Message};
use armwire_bridge::isotp::{Config, Endpoint, Event, Link};
use armwire_host::describe::Protocol;

use super::log::{Logged, Record, Time};
use super::meaning::frame_meaning;
use super::output::{Item, OnLine, Output};
use crate::args::Speaker;
use crate::printable::{cut, escaped};

/// The high half of a flow control frame's first byte.
const FLOW_CONTROL: u8 = 3;
/// Maximum number of buses in a log. Each has PDUs in reassembly.
const MAX_BUSES: usize = 32;

/// An ISO-TP endpoint that only receives.
type Listener = Endpoint<MAX_MESSAGE, 1>;

/// The buses of a log, and the counts for the sum.
pub(super) struct Buses {
    protocol: Protocol,
    names: Vec<String>,
    /// By the index of the bus's name, and by the identifier.
    listeners: BTreeMap<(usize, Id), Listener>,
    counts: Counts,
}

#[derive(Default)]
struct Counts {
    frames: u64,
    pdus: u64,
    lost: u64,
    cyclic: u64,
    others: u64,
    events: u64,
}

impl Buses {
    /// The buses of adapters of an arm with this protocol.
    pub(super) fn new(protocol: Protocol) -> Self {
        Self {
            protocol,
            names: Vec::new(),
            listeners: BTreeMap::new(),
            counts: Counts::default(),
        }
    }

    /// Takes the next record of the log.
    pub(super) fn take(&mut self, record: Record<'_>, out: &dyn Output) -> Result<(), String> {
        match record {
            Record::Comment => {}
            Record::Other => self.counts.events += 1,
            Record::Frame(Logged { time, bus, frame }) => {
                self.counts.frames += 1;
                let ours = frame.and_then(|frame| Some((frame, Function::of(frame.id())?)));
                let Some((frame, (function, node))) = ours else {
                    self.counts.others += 1;
                    return Ok(());
                };
                if !is_isotp(function) {
                    self.counts.cyclic += 1;
                    return Ok(());
                }
                // Flow control belongs to the PDUs of the other direction.
                if frame.data().first().is_some_and(|byte| byte >> 4 == FLOW_CONTROL) {
                    return Ok(());
                }
                let bus = self.bus(bus)?;
                self.receive(&time, bus, &frame, function, node, out);
            }
        }
        Ok(())
    }

    /// The index of a bus's name.
    fn bus(&mut self, name: &str) -> Result<usize, String> {
        if let Some(bus) = self.names.iter().position(|there| there == name) {
            return Ok(bus);
        }
        if self.names.len() == MAX_BUSES {
            return Err(format!("more than {MAX_BUSES} buses"));
        }
        self.names.push(name.to_owned());
        Ok(self.names.len() - 1)
    }

    /// Passes a frame to the endpoint that receives it, and prints the PDU that it ends.
    fn receive(
        &mut self,
        time: &Time<'_>,
        bus: usize,
        frame: &Frame,
        function: Function,
        node: Node,
        out: &dyn Output,
    ) {
        let link = if frame.is_fd() { Link::Fd } else { Link::Classic };
        let new = || Listener::new(Config::new(link, frame.id()));
        let listener = self.listeners.entry((bus, frame.id())).or_insert_with(new);
        let late = listener.tick(time.at);
        let events = listener.receive(frame.data(), time.at);
        // The receiver on the bus has sent the flow control itself.
        if listener.transmit(time.at).is_some() {
            listener.transmitted(time.at);
        }
        let at = place(time, &self.names[bus], node);
        for event in late.chain(events) {
            let (bytes, text) = match event {
                Event::Received => {
                    let pdu = listener.received().unwrap_or_default();
                    self.counts.pdus += 1;
                    (pdu, pdu_meaning(self.protocol, function, pdu))
                }
                Event::Failed(error) => (frame.data(), error.to_string()),
                Event::Refused(refused) => (frame.data(), refused.to_string()),
                Event::Ignored(ignored) => (frame.data(), ignored.to_string()),
            };
            self.counts.lost += u64::from(event != Event::Received);
            let sender = sender(function).filter(|_| event == Event::Received);
            out.item(&Item {
                place: format_args!("{at}"),
                bytes,
                text: &text,
                on_line: sender.map(|from| OnLine {
                    protocol: self.protocol,
                    from: Some(from),
                    nanos: time.at.as_micros().saturating_mul(1_000),
                }),
            });
        }
        listener.release();
    }

    /// Prints the sum.
    pub(super) fn finish(&self, out: &dyn Output) {
        let Counts {
            frames,
            pdus,
            lost,
            cyclic,
            others,
            events,
        } = &self.counts;
        let events = match events {
            0 => String::new(),
            events => format!(", other events: {events}"),
        };
        out.remark(format_args!(
            "CAN frames: {frames}, PDUs: {pdus}, lost: {lost}, cyclic frames: {cyclic}, frames of others: {others}{events}"
        ));
    }
}

/// Time, bus and node of a frame: `1609459200.000000  can0  node 15`. Parts that the log lacks are left out.
fn place(time: &Time<'_>, bus: &str, node: Node) -> String {
    let mut place = String::new();
    if !time.stamp.is_empty() {
        place += &format!("{}{}  ", time.stamp, time.unit);
    }
    match bus.as_bytes() {
        [] => {}
        digits if digits.iter().all(u8::is_ascii_digit) => place += &format!("bus {}  ", cut(bus)),
        _ => place += &format!("{}  ", escaped(&cut(bus))),
    }
    place + &format!("node {}", node.get())
}

fn is_isotp(function: Function) -> bool {
    use Function::{ArmAnswer, ArmRequest, ControlAnswer, ControlRequest};
    matches!(function, ArmRequest | ArmAnswer | ControlRequest | ControlAnswer)
}

/// The sender of PDUs that carry arm frames.
fn sender(function: Function) -> Option<Speaker> {
    match function {
        Function::ArmRequest => Some(Speaker::Host),
        Function::ArmAnswer => Some(Speaker::Arm),
        _ => None,
    }
}

/// The meaning of a PDU.
fn pdu_meaning(protocol: Protocol, function: Function, pdu: &[u8]) -> String {
    match (sender(function), function) {
        (Some(from), _) => frame_meaning(protocol, pdu, from).unwrap_or_else(|reason| reason),
        (None, Function::ControlRequest) => format!("to the adapter: {}", message::<FromHost>(pdu)),
        (None, _) => format!("from the adapter: {}", message::<FromAdapter>(pdu)),
    }
}

fn message<T: Message + std::fmt::Debug>(pdu: &[u8]) -> String {
    match control::decode::<T>(pdu) {
        Ok(message) => format!("{message:?}"),
        Err(error) => format!("no message: {error}"),
    }
}
