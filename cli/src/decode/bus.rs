//! The frames of a log of CAN buses, and their sum.

use std::collections::BTreeMap;

use armwire_bridge::can::{Function, Node};
use armwire_host::describe::Protocol;

use super::doubts::Doubt;
use super::log::{Logged, Time};
use super::output::{Item, Output};
use super::station::{Content, Entry, Kind, Station};
use super::sum::Part;
use crate::args::ArmKind;
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
}

/// The counts of a log.
#[derive(Clone, Default)]
pub(super) struct Counts {
    pub(super) frames: u64,
    pdus: u64,
    lost: u64,
    cyclic: u64,
    others: u64,
    /// Number of PDUs with a frame of the arm, and with something else in its place.
    pub(super) arm_frames: u64,
    damaged: u64,
    has_adapter: bool,
    /// The arm whose frames are there in place of those of the chosen one.
    pub(super) other_arm: Option<ArmKind>,
}

impl Counts {
    /// The counts for the sum.
    pub(super) fn parts(&self) -> Vec<Part> {
        let lost = self.has_adapter.then(|| Part::always("lost", self.lost).flaw());
        let front = [Part::always("CAN frames", self.frames), Part::always("PDUs", self.pdus)];
        let back = [
            Part::always("cyclic frames", self.cyclic),
            Part::always("frames of others", self.others),
            Part::some("PDUs without a frame", self.damaged).flaw(),
        ];
        front.into_iter().chain(lost).chain(back).collect()
    }
}

impl Buses {
    /// The buses of adapters of this arm.
    pub(super) fn new(arm: ArmKind) -> Self {
        Self {
            protocol: match arm {
                ArmKind::Ling => Protocol::Ling,
                ArmKind::LingLegacy => Protocol::LingLegacy,
                ArmKind::Xarm => Protocol::Xarm,
                ArmKind::Alpha1 | ArmKind::Alpha1Servo => Protocol::Alpha1,
            },
            names: Vec::new(),
            stations: BTreeMap::new(),
            counts: Counts::default(),
        }
    }

    /// Takes the next frame of the log. The error is the reason why it is not understood.
    pub(super) fn take(&mut self, logged: &Logged<'_>, out: &dyn Output) -> Result<(), Doubt> {
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
        let bus = self.bus(&logged.bus)?;
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
        Ok(())
    }

    fn show(&mut self, entry: &Entry, out: &dyn Output) {
        match entry.is_pdu {
            true => self.counts.pdus += 1,
            false => self.counts.lost += 1,
        }
        match entry.content {
            Content::Frame(protocol) if protocol == self.protocol => self.counts.arm_frames += 1,
            Content::Frame(protocol) => {
                self.counts.damaged += 1;
                self.counts.other_arm = arm(protocol);
            }
            Content::Nothing if entry.is_pdu => self.counts.damaged += 1,
            Content::Control | Content::Nothing => {}
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

    /// Ends the log. Returns the counts for its sum.
    pub(super) fn finish(&mut self, out: &dyn Output) -> Counts {
        let mut counts = self.counts.clone();
        for ((bus, node), station) in &mut self.stations {
            let at = station_name(&self.names[*bus], *node);
            let unfinished = station.finish();
            if unfinished > 0 && matches!(station.kind, Kind::Adapter(_)) {
                counts.lost += unfinished;
                out.remark(format_args!(
                    "{at}: an adapter, PDUs that the log ends in: {unfinished}"
                ));
            }
            match station.kind {
                Kind::Adapter(evidence) => {
                    counts.has_adapter = true;
                    if counts.lost > 0 {
                        out.remark(format_args!("{at}: an adapter, known by {evidence}"));
                    }
                }
                Kind::Unknown { frames, .. } => {
                    counts.others += frames;
                    out.remark(format_args!(
                        "{at}: frames with identifiers of an adapter, but not its content: {frames}"
                    ));
                }
            }
        }
        if counts.arm_frames > 0 {
            counts.other_arm = None;
        }
        counts
    }
}

/// The arm with this protocol behind an adapter.
fn arm(protocol: Protocol) -> Option<ArmKind> {
    match protocol {
        Protocol::Ling => Some(ArmKind::Ling),
        Protocol::LingLegacy => Some(ArmKind::LingLegacy),
        Protocol::Alpha1 => Some(ArmKind::Alpha1),
        Protocol::Xarm => None,
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
