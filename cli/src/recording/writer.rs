//! The MCAP file: its channels, and messages in chunks.

use std::collections::BTreeMap;
use std::io::{BufWriter, Write};

use mcap::records::MessageHeader;
use mcap::write::NoSeek;
use mcap::{McapError, McapResult, WriteOptions};

use super::Sink;
use super::frame::{Frame, Role};
use super::joint_states::Joints;
use super::messages::{self, FRAME, JOINT_STATE, MESSAGE_ENCODING, SCHEMA_ENCODING};

pub(super) const FRAMES: &str = "/frames";
pub(super) const JOINT_STATES: &str = "/joint_states";

/// The name of an arm's topic.
fn topic(role: Role, name: &str) -> String {
    match role {
        Role::Only => name.to_owned(),
        Role::Leader => format!("/leader{name}"),
        Role::Follower => format!("/follower{name}"),
    }
}

/// The size of a chunk that is full, in bytes. A reader keeps a chunk in memory.
const CHUNK: u64 = 64 * 1024;

/// An MCAP file that is being written. The writer never seeks: a truncated file has complete chunks before the cut.
pub(super) struct Writer<W: Write> {
    mcap: mcap::Writer<NoSeek<BufWriter<W>>>,
    arms: BTreeMap<Role, Arm>,
}

/// The channels of an arm.
struct Arm {
    joints: Joints,
    frames: Channel,
    /// `None` before the first joint positions: some arms have none.
    joint_states: Option<Channel>,
}

/// A channel, and the number of its next message.
struct Channel {
    id: u16,
    sequence: u32,
}

impl Channel {
    fn add<W: Write>(
        mcap: &mut mcap::Writer<NoSeek<BufWriter<W>>>,
        topic: &str,
        (name, definition): (&str, &str),
    ) -> McapResult<Self> {
        let schema = mcap.add_schema(name, SCHEMA_ENCODING, definition.as_bytes())?;
        let id = mcap.add_channel(schema, topic, MESSAGE_ENCODING, &BTreeMap::new())?;
        Ok(Self { id, sequence: 0 })
    }

    /// The header of the next message.
    fn next(&mut self, frame: &Frame) -> MessageHeader {
        let sequence = self.sequence;
        self.sequence = sequence.wrapping_add(1);
        MessageHeader {
            channel_id: self.id,
            sequence,
            log_time: frame.log_time.cast_unsigned(),
            publish_time: frame.stamp.cast_unsigned(),
        }
    }
}

impl<W: Write> Writer<W> {
    pub(super) fn new(out: W, roles: &[Role]) -> McapResult<Self> {
        let options = WriteOptions::new()
            .compression(None)
            .profile("ros2")
            .library(concat!("armwire ", env!("CARGO_PKG_VERSION")))
            .chunk_size(Some(CHUNK))
            .disable_seeking(true);
        let mut mcap = options.create(NoSeek::new(BufWriter::new(out)))?;
        let mut arms = BTreeMap::new();
        for &role in roles {
            let arm = Arm {
                joints: Joints::default(),
                frames: Channel::add(&mut mcap, &topic(role, FRAMES), FRAME)?,
                joint_states: None,
            };
            arms.insert(role, arm);
        }
        Ok(Self { mcap, arms })
    }

    fn write_frame(&mut self, role: Role, frame: &Frame) -> McapResult<()> {
        let arm = self.arms.get_mut(&role).expect("the file is of this arm");
        let header = arm.frames.next(frame);
        self.mcap.write_to_known_channel(&header, &messages::frame(frame))?;
        let Some(joints) = arm.joints.read(frame) else {
            return Ok(());
        };
        let channel = match &mut arm.joint_states {
            Some(channel) => channel,
            None => {
                let topic = topic(role, JOINT_STATES);
                arm.joint_states
                    .insert(Channel::add(&mut self.mcap, &topic, JOINT_STATE)?)
            }
        };
        let (names, positions): (Vec<_>, Vec<_>) = joints.into_iter().unzip();
        let header = channel.next(frame);
        self.mcap
            .write_to_known_channel(&header, &messages::joint_state(frame.stamp, &names, &positions))
    }

    fn end(mut self) -> McapResult<()> {
        self.mcap.finish()?;
        Ok(self.mcap.into_inner().into_inner().flush()?)
    }
}

impl<W: Write> Sink for Writer<W> {
    fn frame(&mut self, role: Role, frame: &Frame) -> Result<(), String> {
        self.write_frame(role, frame).map_err(describe)
    }

    /// Ends the chunk, too.
    fn flush(&mut self) -> Result<(), String> {
        self.mcap.flush().map_err(describe)
    }

    fn finish(self: Box<Self>) -> Result<(), String> {
        self.end().map_err(describe)
    }
}

/// An error of a file, in words.
pub(super) fn describe(error: McapError) -> String {
    match error {
        McapError::Io(error) => error.to_string(),
        other => other.to_string(),
    }
}
