//! The frames in the bytes of a line, each with the time at which its last byte came.

use std::collections::VecDeque;
use std::sync::mpsc::Sender;

use armwire::decoder::{Decoder, Kind};
use armwire::xarm::MAX_FRAME;
use armwire_host::Tap;
use armwire_host::describe::Arm;
use armwire_host::stamps::now;

use super::frame::{Frame, Role};
use crate::args::Speaker;

/// Both directions of a line. Frames that are incomplete at its end are sent unchanged.
pub(crate) struct Capture<P: Arm> {
    to_arm: Side<P>,
    from_arm: Side<P>,
}

impl<P: Arm> Capture<P> {
    /// A recipient of the bytes on the line of this arm.
    pub(crate) fn new(role: Role, frames: Sender<(Role, Frame)>) -> Self {
        Self {
            to_arm: Side::new(role, Speaker::Host, frames.clone()),
            from_arm: Side::new(role, Speaker::Arm, frames),
        }
    }

    /// Takes bytes that were sent or received at this time, in nanoseconds since 1970.
    pub(crate) fn push(&mut self, from: Speaker, bytes: &[u8], now: i64) {
        match from {
            Speaker::Host => self.to_arm.push(bytes, now),
            Speaker::Arm => self.from_arm.push(bytes, now),
        }
    }
}

impl<P> Tap for Capture<P>
where
    P: Arm + Send,
    P::Expect: Send,
{
    fn sent(&mut self, bytes: &[u8]) {
        self.push(Speaker::Host, bytes, now());
    }

    fn received(&mut self, bytes: &[u8]) {
        self.push(Speaker::Arm, bytes, now());
    }
}

/// One direction of a line.
struct Side<P: Arm> {
    role: Role,
    from: Speaker,
    arm: P,
    expect: P::Expect,
    /// The longest frame of every protocol fits.
    decoder: Decoder<P, MAX_FRAME>,
    /// The end of each piece of bytes that is not decoded yet, and the time at which it came.
    pieces: VecDeque<(u64, i64)>,
    /// Adjacent bytes between frames.
    run: Vec<u8>,
    frames: Sender<(Role, Frame)>,
}

impl<P: Arm> Drop for Side<P> {
    fn drop(&mut self) {
        self.decoder.idle();
        self.send_items();
    }
}

impl<P: Arm> Side<P> {
    fn new(role: Role, from: Speaker, frames: Sender<(Role, Frame)>) -> Self {
        let arm = P::default();
        let expect = match from {
            Speaker::Host => arm.requests(),
            Speaker::Arm => arm.unsolicited(),
        };
        Self {
            role,
            from,
            arm,
            expect,
            decoder: Decoder::new(),
            pieces: VecDeque::new(),
            run: Vec::new(),
            frames,
        }
    }

    fn push(&mut self, bytes: &[u8], now: i64) {
        self.pieces
            .push_back((self.decoder.received() + bytes.len() as u64, now));
        let mut rest = bytes;
        while !rest.is_empty() {
            rest = self.decoder.push(rest);
            self.send_items();
        }
    }

    /// Sends the decoded items. Padding is no part of a frame, nor damage, and is left out.
    fn send_items(&mut self) {
        while let Some(item) = self.decoder.next(&self.arm, self.expect) {
            let (start, end) = (item.offset, item.offset + item.bytes.len() as u64);
            match item.kind {
                Kind::Noise(_) | Kind::Broken(_) => self.run.extend(item.bytes),
                Kind::Padding => self.send_run(start),
                Kind::Frame => {
                    let bytes = item.bytes.to_vec();
                    self.send_run(start);
                    self.send(bytes, end);
                }
            }
        }
        self.send_run(self.decoder.offset());
    }

    /// Sends the run of bytes that ends at this offset, if there is one.
    fn send_run(&mut self, end: u64) {
        if !self.run.is_empty() {
            let run = std::mem::take(&mut self.run);
            self.send(run, end);
        }
    }

    /// Sends the bytes that end at this offset.
    fn send(&mut self, bytes: Vec<u8>, end: u64) {
        while self.pieces.len() > 1 && self.pieces.front().is_some_and(|&(piece_end, _)| piece_end < end) {
            self.pieces.pop_front();
        }
        let at = self.pieces.front().map_or(0, |&(_, at)| at);
        // Without a receiver nothing is recorded any more.
        let frame = Frame {
            log_time: at,
            stamp: at,
            protocol: P::PROTOCOL,
            from: self.from,
            bytes,
        };
        let _ = self.frames.send((self.role, frame));
    }
}
