//! The motion of an arm in a file.

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::fs::File;
use std::io::{BufReader, IsTerminal as _, Read};
use std::path::Path;

use armwire::ling::{JOINTS, JointState, Ling, Move, Opening, Position, Request, Response, Stroke, TICKS_PER_TURN};
use armwire::messages::Messages;
use armwire::time::Instant;
use armwire_host::Protocol;
use armwire_host::joints_file::Joints;
use armwire_host::replay::Point;

use crate::args::Speaker;
use crate::decode::doubts::Doubt;
use crate::decode::mcap::records::{self, Record, Visitor, damaged_record};
use crate::error::Error;
use crate::output::print_error;
use crate::printable::cut;
use crate::recording::messages::{FRAME, JOINT_STATE, MESSAGE_ENCODING, NamedJoints, parse_frame, parse_joint_state};

/// The first bytes of a file of a LeRobot data set.
const PARQUET: &[u8] = b"PAR1";

/// The kind of the poses in a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Source {
    /// The goals that the arm was sent.
    Goals,
    /// The arm's readings.
    Readings,
    /// Joint states of any program.
    JointStates,
}

/// A motion in a file.
#[derive(Debug)]
pub(super) struct Recorded {
    pub(super) topic: String,
    pub(super) source: Source,
    /// Differences from the recording, in words.
    pub(super) warnings: Vec<String>,
    /// At times that grow, by 1 µs at least.
    poses: Vec<Pose>,
}

/// A pose at a time in nanoseconds since 1970.
#[derive(Debug)]
struct Pose {
    at: i64,
    joints: [Position; JOINTS],
    gripper: Gripper,
}

/// The recorded gripper.
#[derive(Clone, Copy, Debug)]
enum Gripper {
    Unknown,
    Opening(Opening),
    Metres(f64),
}

impl Recorded {
    /// The number of poses.
    pub(super) fn len(&self) -> usize {
        self.poses.len()
    }

    /// Returns true if the gripper's stroke must be known.
    pub(super) fn needs_stroke(&self) -> bool {
        self.poses.iter().any(|pose| matches!(pose.gripper, Gripper::Metres(_)))
    }

    /// The points, for a gripper of this stroke.
    pub(super) fn points(&self, stroke: Option<Stroke>) -> Result<Vec<Point>, String> {
        let first = self.poses.first().map_or(0, |pose| pose.at);
        let point = |pose: &Pose| {
            Ok(Point {
                at: Instant::from_micros(micros(first, pose.at)),
                joints: pose.joints,
                gripper: match (pose.gripper, stroke) {
                    (Gripper::Opening(opening), _) => Some(opening),
                    (Gripper::Metres(metres), Some(stroke)) => {
                        let opening = Opening::from_millimetres((metres * 1_000.0) as f32, stroke);
                        Some(opening.map_err(|error| error.to_string())?)
                    }
                    (Gripper::Metres(_), None) | (Gripper::Unknown, _) => None,
                },
            })
        };
        self.poses.iter().map(point).collect()
    }

    /// Refuses a pose outside of the limits of a file of joints.
    fn check(&self, joints: &Joints) -> Result<(), String> {
        const HALF_A_TICK: f64 = TAU / TICKS_PER_TURN as f64 / 2.0;
        for pose in &self.poses {
            for (joint, position) in joints.all.iter().zip(pose.joints) {
                let value = joint.scale.value(position.radians().into());
                let rounding = joint.scale.length(HALF_A_TICK);
                if !(joint.min - rounding..=joint.max + rounding).contains(&value) {
                    let seconds = micros(self.poses[0].at, pose.at) as f64 / 1e6;
                    return Err(format!(
                        "{} is at {value:.4} at {seconds:.2} s, and its limits are {:.4} to {:.4} (--joints)",
                        joint.name, joint.min, joint.max
                    ));
                }
            }
        }
        Ok(())
    }
}

/// The whole microseconds from one time to a later one.
fn micros(from: i64, to: i64) -> u64 {
    to.abs_diff(from) / 1_000
}

/// The motion to read from a file.
pub(super) struct Wanted<'a> {
    /// The topic of its arm. `None` for the only one.
    pub(super) topic: Option<&'a str>,
    /// Goals are left out.
    pub(super) are_readings: bool,
    /// The joints in a file of joints, with which the names and limits are those of the file.
    pub(super) joints: Option<&'a Joints>,
}

/// Reads a motion.
pub(super) fn read(path: &Path, wanted: &Wanted<'_>) -> Result<Recorded, Error> {
    let name = path.display().to_string();
    let failed = |error| Error::at(&name, error);
    let refused = |reason: String| Error::at(&name, reason);
    let file = File::open(path).map_err(failed)?;
    if file.is_terminal() {
        return Err(refused(
            "this is a port, not a recording: 'armwire replay FILE PORT'".to_owned(),
        ));
    }
    let is_folder = file.metadata().map_err(failed)?.is_dir();
    let mut file = BufReader::new(file);
    let mut magic = Vec::new();
    if !is_folder {
        file.by_ref()
            .take(mcap::MAGIC.len() as u64)
            .read_to_end(&mut magic)
            .map_err(failed)?;
    }
    if is_folder || magic.starts_with(PARQUET) {
        let reason = "this is no MCAP file: the repository has tools/lerobot_to_mcap.py for a LeRobot data set";
        return Err(refused(reason.to_owned()));
    }
    if magic != mcap::MAGIC {
        return Err(refused("this is no MCAP file".to_owned()));
    }
    let mut file = magic.chain(file);
    let mut tracks = Tracks {
        name: &name,
        schemas: BTreeMap::new(),
        channels: BTreeMap::new(),
    };
    if let Err((place, reason)) = records::read(&mut file, &mut tracks) {
        return Err(refused(format!("byte {place}: {reason}")));
    }
    let tracks = tracks.channels.into_values().collect();
    let track = chosen(tracks, wanted.topic).map_err(refused)?;
    let recorded = track.into_recorded(wanted).map_err(refused)?;
    if let Some(joints) = wanted.joints {
        recorded.check(joints).map_err(refused)?;
    }
    Ok(recorded)
}

/// The track on `topic`. Without it: the arm that was recorded, or the follower of two.
fn chosen(tracks: Vec<Track>, topic: Option<&str>) -> Result<Track, String> {
    let topics: Vec<_> = tracks.iter().map(|track| track.topic.clone()).collect();
    let (frames, states): (Vec<_>, Vec<_>) = tracks.into_iter().partition(|track| track.kind == Kind::Frames);
    if let Some(topic) = topic {
        let mut all = frames.into_iter().chain(states);
        return all.find(|track| track.topic == topic).ok_or_else(|| {
            let topics = topics.join(", ");
            format!("there is no topic '{topic}' of an arm; there are: {}", cut(&topics))
        });
    }
    for mut tracks in [frames, states] {
        tracks.retain(|track| !track.is_empty());
        if tracks.len() > 1
            && let Some(follower) = tracks.iter().position(|track| track.topic.starts_with("/follower/"))
        {
            return Ok(tracks.swap_remove(follower));
        }
        match (tracks.pop(), tracks.is_empty()) {
            (Some(track), true) => return Ok(track),
            (Some(_), false) => return Err(format!("several arms: --topic is one of {}", cut(&topics.join(", ")))),
            (None, _) => {}
        }
    }
    Err(format!(
        "there is no pose of a Ling arm: neither frames of one ('armwire record' records them), nor {} with joint1 to \
         joint{JOINTS}",
        JOINT_STATE.0
    ))
}

/// The type of a topic's messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Frames,
    JointStates,
}

/// A topic.
#[derive(Debug)]
struct Track {
    topic: String,
    kind: Kind,
    readings: Vec<(Times, JointState)>,
    goals: Vec<(Times, Move)>,
    joints: Vec<(Times, NamedJoints)>,
}

/// The times of a message, in nanoseconds since 1970.
#[derive(Clone, Copy, Debug)]
struct Times {
    log: i64,
    /// That in the message; 0 if it has none.
    stamp: i64,
}

impl Track {
    fn new(topic: &str, kind: Kind) -> Self {
        Self {
            topic: topic.to_owned(),
            kind,
            readings: Vec::new(),
            goals: Vec::new(),
            joints: Vec::new(),
        }
    }

    fn is_empty(&self) -> bool {
        self.readings.is_empty() && self.goals.is_empty() && self.joints.is_empty()
    }

    /// Takes a message.
    fn push(&mut self, log_time: i64, data: &[u8]) -> Result<(), String> {
        match self.kind {
            Kind::Frames => self.push_frame(log_time, data),
            Kind::JointStates => {
                let joints = parse_joint_state(data)?;
                let times = Times {
                    log: log_time,
                    stamp: joints.stamp,
                };
                self.joints.push((times, joints));
                Ok(())
            }
        }
    }

    fn push_frame(&mut self, log_time: i64, data: &[u8]) -> Result<(), String> {
        let frame = parse_frame(log_time, data)?;
        let times = Times {
            log: log_time,
            stamp: frame.stamp,
        };
        match (frame.protocol, frame.from) {
            (Protocol::Ling, Speaker::Arm) => {
                if let Ok(Response::Joints(state)) = Messages::parse_response(&Ling, &frame.bytes, ()) {
                    self.readings.push((times, state));
                }
            }
            (Protocol::Ling, Speaker::Host) => {
                if let Ok(Request::Move(target)) = Messages::parse_request(&Ling, &frame.bytes) {
                    self.goals.push((times, target));
                }
            }
            // Only Ling arms are moved.
            _ => {}
        }
        Ok(())
    }

    /// The motion: its goals if there are any, else the readings.
    fn into_recorded(self, wanted: &Wanted<'_>) -> Result<Recorded, String> {
        let (source, poses) = if self.kind == Kind::JointStates {
            let names = Names::new(wanted.joints);
            let poses = timed(&self.joints)?.map(|(at, named)| names.pose(at, named));
            (Source::JointStates, poses.collect::<Result<Vec<_>, _>>()?)
        } else if self.goals.len() > 1 && !wanted.are_readings {
            let pose = |(at, target): (i64, &Move)| Pose {
                at,
                joints: target.joints.map(|(position, _)| position),
                gripper: Gripper::Opening(target.gripper.0),
            };
            (Source::Goals, timed(&self.goals)?.map(pose).collect())
        } else {
            // A reading out of range is a pose that no move can express.
            let pose = |(at, state): (i64, &JointState)| {
                let joints = state.positions().ok()?;
                let gripper = state.opening().map_or(Gripper::Unknown, Gripper::Opening);
                Some(Pose { at, joints, gripper })
            };
            (Source::Readings, timed(&self.readings)?.filter_map(pose).collect())
        };
        if poses.is_empty() {
            return Err(format!("there is no pose of a Ling arm on {}", cut(&self.topic)));
        }
        let (poses, warnings) = in_order(poses);
        Ok(Recorded {
            topic: self.topic,
            source,
            warnings,
            poses,
        })
    }
}

/// Messages with one time each: their stamps, or without any the times of their log.
fn timed<T>(messages: &[(Times, T)]) -> Result<impl Iterator<Item = (i64, &T)>, String> {
    let all = messages.len();
    let unstamped = messages.iter().position(|(times, _)| times.stamp == 0);
    let is_stamped = messages.iter().any(|(times, _)| times.stamp != 0);
    match unstamped {
        Some(nth) if is_stamped => {
            return Err(format!("message {} of {all} has no time, and others have one", nth + 1));
        }
        Some(_) if all > 1 && messages.iter().all(|(times, _)| times.log == 0) => {
            return Err(format!("none of the {all} messages has a time"));
        }
        _ => {}
    }
    let time = move |times: &Times| if is_stamped { times.stamp } else { times.log };
    Ok(messages.iter().map(move |(times, message)| (time(times), message)))
}

/// The poses in the order of their times, the last one of each time, and warnings if they were not so before.
fn in_order(mut poses: Vec<Pose>) -> (Vec<Pose>, Vec<String>) {
    let all = poses.len();
    let mut warnings = Vec::new();
    let (mut late, mut by, mut newest) = (0, 0, i64::MIN);
    for pose in &poses {
        if pose.at < newest {
            (late, by) = (late + 1, by.max(micros(pose.at, newest)));
        }
        newest = newest.max(pose.at);
    }
    if late > 0 {
        let seconds = by as f64 / 1e6;
        warnings.push(format!(
            "{late} of {all} poses are recorded behind a later one, by up to {seconds:.2} s: they are sorted by their \
             times"
        ));
        poses.sort_by_key(|pose| pose.at);
    }
    let mut kept: Vec<Pose> = Vec::new();
    let first = poses.first().map_or(0, |pose| pose.at);
    for pose in poses {
        match kept.last_mut() {
            Some(last) if micros(first, last.at) == micros(first, pose.at) => *last = pose,
            _ => kept.push(pose),
        }
    }
    let left_out = all - kept.len();
    if left_out > 0 {
        warnings.push(format!(
            "{left_out} of {all} poses have the time of another, and are left out"
        ));
    }
    (kept, warnings)
}

/// The names and units in joint states.
struct Names {
    joints: Joints,
    /// They are those of a file of joints, and not those of this project.
    are_stated: bool,
}

impl Names {
    fn new(stated: Option<&Joints>) -> Self {
        Self {
            joints: stated.cloned().unwrap_or_default(),
            are_stated: stated.is_some(),
        }
    }

    /// The pose in joint states, which name all joints, and perhaps the gripper.
    fn pose(&self, at: i64, named: &NamedJoints) -> Result<Pose, String> {
        let mut positions = [None; JOINTS];
        let mut gripper = None;
        for (name, value) in &named.positions {
            let axis = self.joints.axis(name).ok_or_else(|| self.unknown(name))?;
            let arm = self.joints.all[axis].scale.arm(*value);
            let is_repeated = match positions.get_mut(axis) {
                Some(position) => {
                    let new = Position::from_radians(arm as f32).map_err(|error| format!("{name}: {error}"))?;
                    position.replace(new).is_some()
                }
                None => gripper.replace(Gripper::Metres(arm)).is_some(),
            };
            if is_repeated {
                return Err(format!("{name} is there twice"));
            }
        }
        match positions.iter().position(Option::is_none) {
            Some(missing) => Err(format!("{} is missing", self.joints.all[missing].name)),
            None => Ok(Pose {
                at,
                joints: positions.map(|position| position.unwrap_or(Position::CENTRE)),
                gripper: gripper.unwrap_or(Gripper::Unknown),
            }),
        }
    }

    fn unknown(&self, name: &str) -> String {
        let name = cut(name);
        match self.are_stated {
            true => format!("the joint '{name}' is none of {} (--joints)", self.joints.names()),
            false => format!(
                "the unit of '{name}' is not known: replayed are joint1 to joint{JOINTS} in rad, and gripper in m \
                 (--joints FILE names others)"
            ),
        }
    }
}

/// The tracks of a file so far.
struct Tracks<'a> {
    name: &'a str,
    schemas: BTreeMap<u16, Kind>,
    channels: BTreeMap<u16, Track>,
}

impl Visitor for Tracks<'_> {
    fn unit(&mut self, place: u64, record: Result<Record<'_>, Doubt>) {
        if let Err(reason) = record.and_then(|record| self.record(record)) {
            print_error(&format_args!("{}: byte {place}: left out: {}", self.name, reason.text));
        }
    }
}

impl Tracks<'_> {
    fn record(&mut self, record: Record<'_>) -> Result<(), Doubt> {
        match record {
            Record::Other(_) => {}
            Record::Schema { id, name } => {
                let kinds = [(FRAME.0, Kind::Frames), (JOINT_STATE.0, Kind::JointStates)];
                let kind = kinds.into_iter().find(|(known, _)| *known == name);
                self.schemas.extend(kind.map(|(_, kind)| (id, kind)));
            }
            Record::Channel {
                id,
                schema,
                topic,
                encoding,
            } => {
                if let Some(kind) = self.schemas.get(&schema)
                    && encoding == MESSAGE_ENCODING
                {
                    self.channels.entry(id).or_insert_with(|| Track::new(topic, *kind));
                }
            }
            Record::Message {
                channel,
                sequence,
                log_time,
                data,
            } => {
                if let Some(track) = self.channels.get_mut(&channel) {
                    let pushed = track.push(log_time.cast_signed(), data);
                    return pushed.map_err(|reason| damaged_record(format!("message {sequence}: {reason}")));
                }
            }
        }
        Ok(())
    }
}
