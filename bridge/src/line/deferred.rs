//! Act first, account later: a packet for the host on USB does not wait for the accounting of its frame.

use armwire::time::Instant;

use crate::control::LineState;
use crate::line_coding::LineCoding;

use super::Line;
use super::from_arm::OpenFrame;

/// The line, and the frame that it has not accounted for.
///
/// The last frame of a read stays open: its bytes are passed to the host on USB, and its packet may be
/// [taken](Self::send_packet). Who waited for the frame, what is delivered and what may be sent next follows with the next
/// access to the [line](Self::settled), which there is no other way to.
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
        self.line.send_packet(send)
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
