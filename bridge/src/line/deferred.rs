//! Act first, account later: neither a packet for the host on USB nor the next poll waits for the accounting of a frame.

use armwire::time::Instant;

use crate::control::LineState;
use crate::line_coding::LineCoding;

use super::Line;
use super::from_arm::OpenFrame;

/// The line, and the frame that it has not accounted for.
///
/// The last frame of a read stays open if its packet may be [taken](Self::send_packet) first, or the next poll
/// [started](Self::next_poll). Who waited for the frame, and what is delivered, follows with the next access to the
/// [line](Self::settled), which there is no other way to.
pub(crate) struct Deferred {
    line: Line,
    open: Option<OpenFrame>,
}

impl Deferred {
    pub(crate) const fn new(line: Line) -> Self {
        Self { line, open: None }
    }

    /// The line, with all frames accounted for.
    // Every call of the adapter begins with it, and usually no frame is open.
    #[inline]
    pub(crate) fn settled(&mut self) -> &mut Line {
        if self.open.is_some() {
            self.settle();
        }
        &mut self.line
    }

    #[inline(never)]
    fn settle(&mut self) {
        if let Some(frame) = self.open.take() {
            self.line.settle(frame);
        }
    }

    /// Handles bytes from the UART, the last of which arrived at `at`. Returns the number of frames that ended.
    pub(crate) fn received(&mut self, bytes: &[u8], at: Instant) -> usize {
        let (frames, open) = self.settled().received(bytes, at);
        self.open = open;
        frames
    }

    /// Passes the next packet for the host on USB to `send`, and removes it if that returns true.
    pub(crate) fn send_packet(&mut self, send: impl FnOnce(&[u8]) -> bool) -> Option<usize> {
        if self.open.as_ref().is_some_and(|frame| !frame.is_passed) {
            self.settle();
        }
        self.line.send_packet(send)
    }

    /// The poll that [`Line::transmit`] returns next, to be sent at once. `None` if only the accounting of the last
    /// frame can tell.
    pub(crate) fn next_poll(&self) -> Option<&'static [u8]> {
        self.line.poll_after(self.open.as_ref()?)
    }

    // ---- State that no frame of the arm changes ----

    pub(crate) const fn line_coding(&self) -> LineCoding {
        self.line.line_coding()
    }

    /// The state of the line's rate.
    pub(crate) fn state(&self) -> LineState {
        self.line.state()
    }
}
