//! The ports of the server.

/// A port of the server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Port {
    /// Requests and responses; port 502 on a real arm.
    Control,
    /// Reports; port 30002 on a real arm.
    Report,
}
