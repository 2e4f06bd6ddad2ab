//! The unit of a recording.

use armwire_host::describe::Protocol;

use crate::args::Speaker;

/// The arm that frames are of. It is in the names of their topics.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Role {
    /// The only arm.
    Only,
    /// The arm that another follows.
    Leader,
    /// The arm that follows another.
    Follower,
}

/// A frame on an arm's line, or a run of bytes between frames. Times are in nanoseconds since 1970.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Frame {
    /// The time at which this computer sent or received its last byte.
    pub(crate) log_time: i64,
    /// The time of its last byte by the adapter's clock, if the adapter stamped it. Otherwise the log time.
    pub(crate) stamp: i64,
    pub(crate) protocol: Protocol,
    pub(crate) from: Speaker,
    pub(crate) bytes: Vec<u8>,
}
