//! The gate for bytes of the host on USB while motion is refused.

use armwire::correlation::{Correlation, Effect};
use armwire::decoder::{Decoder, Kind};
use armwire::framing::Framing;

use crate::config::ArmKind;
use crate::control::MAX_FRAME;

use super::from_host::FromHost;

/// Passes whole requests that are no motion, and bytes outside of requests. The rest of a request is waited for.
pub(super) struct Gate {
    decoder: Decoder<ArmKind, MAX_FRAME>,
    /// A request that began before this offset went out in part.
    cut: u64,
    /// A refusal was reported.
    is_reported: bool,
}

impl Gate {
    /// A gate behind the first bytes of a request, which went out.
    pub(super) fn new(begun: &[u8]) -> Self {
        let mut decoder = Decoder::new();
        // They come from a decoder of the same size.
        let _ = decoder.push(begun);
        let cut = decoder.received();
        Self {
            decoder,
            cut,
            is_reported: false,
        }
    }

    /// Records that a refusal is reported. Returns true for the first.
    pub(super) const fn report(&mut self) -> bool {
        !core::mem::replace(&mut self.is_reported, true)
    }

    /// Number of bytes that wait for the rest of their request.
    pub(super) const fn len(&self) -> usize {
        self.decoder.pending()
    }

    /// Passes these bytes on. Returns the number of refused requests.
    pub(super) fn pass(&mut self, kind: ArmKind, bytes: &[u8], to: &mut FromHost) -> usize {
        let mut refused: usize = 0;
        let mut rest = bytes;
        while !rest.is_empty() {
            rest = self.decoder.push(rest);
            while let Some(span) = self.decoder.advance(&kind, kind.requests()) {
                let item = self.decoder.item(span);
                let sent = self.cut.saturating_sub(item.offset) as usize;
                let is_motion = || {
                    kind.request(item.bytes)
                        .is_some_and(|info| info.effect == Effect::Motion)
                };
                if item.kind == Kind::Frame && (sent > 0 || is_motion()) {
                    refused = refused.saturating_add(1);
                } else {
                    to.admit(item.bytes.get(sent..).unwrap_or_default());
                }
            }
        }
        refused
    }

    /// Drops the bytes that wait, and returns their number.
    pub(super) fn clear(&mut self) -> usize {
        let sent = self.cut.saturating_sub(self.decoder.offset()) as usize;
        let waiting = self.decoder.pending().saturating_sub(sent);
        self.decoder.clear();
        waiting
    }

    /// Opens the gate: an incomplete request passes. Returns the number of refused requests: one that went out in part
    /// ends here.
    pub(super) fn open(&mut self, to: &mut FromHost) -> usize {
        let is_cut = self.cut > self.decoder.offset();
        if !is_cut {
            to.admit(self.decoder.window());
        }
        self.decoder.clear();
        is_cut.into()
    }
}
