//! A recipient of the bytes on a line.

/// A recipient of the bytes on a line.
pub trait Tap: Send {
    /// Bytes that the line accepted.
    fn sent(&mut self, bytes: &[u8]);

    /// Bytes from the line.
    fn received(&mut self, bytes: &[u8]);
}
