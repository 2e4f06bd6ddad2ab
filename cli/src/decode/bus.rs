//! The frames of a log of CAN buses, and their sum.

use std::collections::BTreeMap;

use armwire_bridge::can::{Function, Node};
use armwire_host::describe::Protocol;

use super::doubts::{Doubt, Doubts, Place};
use super::log::{Record, Time};
use super::output::{Item, Output};
use super::station::{Entry, Kind, Station};
use crate::printable::{cut, escaped};

/// Maximum number of buses in a log. Each has PDUs in reassembly.
const MAX_BUSES: usize = 32;

/// The buses of a log, and the counts for the sum.
pub(super) struct Buses {
    protocol: Protocol,
    names: Vec<String>,
    /// By the index of the bus's name, and the node.
    stations: BTreeMap<(usize, Node), Station>,
    counts: Counts,
    doubts: Doubts,
}

#[derive(Default)]
struct Counts {
    frames: u64,
    pdus: u64,
    lost: u64,
    cyclic: u64,
    others: u64,
    events: u64,
    /// Frames that the logging program lost.
    dropped: u64,
}

impl Buses {
    /// The buses of adapters of an arm with this protocol.
    pub(super) fn new(protocol: Protocol) -> Self {
        Self {
            protocol,
            names: Vec::new(),
            stations: BTreeMap::new(),
            counts: Counts::default(),
            doubts: Doubts::default(),
        }
    }

    /// Takes the next record of the log, or the reason why it is not understood.
    pub(super) fn take(&mut self, place: Place<'_>, record: Result<Record<'_>, Doubt>, out: &dyn Output) {
        if let Err(reason) = record.and_then(|record| self.take_record(record, out)) {
            self.doubts.add(place, &reason, out);
        }
    }

    fn take_record(&mut self, record: Record<'_>, out: &dyn Output) -> Result<(), Doubt> {
        match record {
            Record::Comment => {}
            Record::Other => self.counts.events += 1,
            Record::Dropped(frames) => self.counts.dropped = self.counts.dropped.saturating_add(frames),
            Record::Frame(logged) => {
                self.counts.frames += 1;
                let ours = logged.frame.and_then(|frame| Some((frame, Function::of(frame.id())?)));
                let Some((frame, (function, node))) = ours else {
                    self.counts.others += 1;
                    return Ok(());
                };
                if !is_isotp(function) {
                    self.counts.cyclic += 1;
                    return Ok(());
                }
                let bus = self.bus(logged.bus)?;
                if logged.lacking > 0 {
                    let len = frame.data().len();
                    return Err(Doubt::short(len, len - logged.lacking));
                }
                let station = self.stations.entry((bus, node));
                let station = station.or_insert_with(|| Station::new(self.protocol));
                let place = place(&logged.time, &self.names[bus], node);
                let (entries, not_kept) = station.receive(&frame, function, &logged.time, &place);
                if not_kept > 0 {
                    self.counts.lost += not_kept;
                    out.remark(format_args!("{place}: an adapter, PDUs lost before: {not_kept}"));
                }
                for entry in entries {
                    self.show(&entry, out);
                }
            }
        }
        Ok(())
    }

    fn show(&mut self, entry: &Entry, out: &dyn Output) {
        match entry.is_pdu {
            true => self.counts.pdus += 1,
            false => self.counts.lost += 1,
        }
        out.item(&Item {
            place: format_args!("{}", entry.place),
            bytes: &entry.bytes,
            text: &entry.text,
            on_line: entry.on_line,
        });
    }

    /// The index of a bus's name.
    fn bus(&mut self, name: &str) -> Result<usize, Doubt> {
        if let Some(bus) = self.names.iter().position(|there| there == name) {
            return Ok(bus);
        }
        if self.names.len() == MAX_BUSES {
            return Err("more than 32 buses".into());
        }
        self.names.push(name.to_owned());
        Ok(self.names.len() - 1)
    }

    /// Prints the sum. Returns the number of records that were not understood.
    pub(super) fn finish(&self, out: &dyn Output) -> u64 {
        let Counts {
            frames,
            pdus,
            lost,
            cyclic,
            others,
            events,
            dropped,
        } = &self.counts;
        let mut others = *others;
        let mut has_adapter = false;
        for ((bus, node), station) in &self.stations {
            let at = station_name(&self.names[*bus], *node);
            match station.kind {
                Kind::Adapter(evidence) => {
                    has_adapter = true;
                    if *lost > 0 {
                        out.remark(format_args!("{at}: an adapter, known by {evidence}"));
                    }
                }
                Kind::Unknown { frames, .. } => {
                    others += frames;
                    out.remark(format_args!(
                        "{at}: frames with identifiers of an adapter, but not its content: {frames}"
                    ));
                }
            }
        }
        let some = |what: &str, count: u64| match count {
            0 => String::new(),
            count => format!(", {what}: {count}"),
        };
        let lost = if has_adapter {
            format!(", lost: {lost}")
        } else {
            String::new()
        };
        out.remark(format_args!(
            "CAN frames: {frames}, PDUs: {pdus}{lost}, cyclic frames: {cyclic}, frames of others: {others}{}{}{}",
            some("other events", *events),
            some("not logged", *dropped),
            self.doubts.sum(),
        ));
        self.doubts.count()
    }
}

/// Time, bus and node of a frame: `1609459200.000000  can0  node 15`. Parts that the log lacks are left out.
fn place(time: &Time<'_>, bus: &str, node: Node) -> String {
    let mut place = String::new();
    if !time.stamp.is_empty() {
        place += &format!("{}{}  ", time.stamp, time.unit);
    }
    place + &station_name(bus, node)
}

/// Bus and node: `can0  node 15`.
fn station_name(bus: &str, node: Node) -> String {
    let bus = match bus.as_bytes() {
        [] => String::new(),
        digits if digits.iter().all(u8::is_ascii_digit) => format!("bus {}  ", cut(bus)),
        _ => format!("{}  ", escaped(&cut(bus))),
    };
    format!("{bus}node {}", node.get())
}

fn is_isotp(function: Function) -> bool {
    use Function::{ArmAnswer, ArmRequest, ControlAnswer, ControlRequest};
    matches!(function, ArmRequest | ArmAnswer | ControlRequest | ControlAnswer)
}
