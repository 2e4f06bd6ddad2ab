//! SLCAN, and any frame on a CAN bus.

use core::hint::black_box;

use armwire_bridge::can::Id as AdapterId;
use armwire_bridge::can::bus::{FdFlags, Frame, Id};
use armwire_bridge::slcan::{BitRate, Commands, DataBitRate, Replies};

use crate::bytes::bytes;

/// Takes bytes without keeping them.
struct Sink;

impl Extend<u8> for Sink {
    fn extend<T: IntoIterator<Item = u8>>(&mut self, bytes: T) {
        bytes.into_iter().for_each(|byte| {
            black_box(byte);
        });
    }
}

pub(crate) fn call_all() {
    let id = black_box(Id::Extended(black_box(0)));
    black_box((id.value(), Frame::data_frame(id, bytes(&mut [0; 100]))));
    black_box(Frame::remote_frame(id, black_box(0)));
    black_box(Frame::fd_frame(id, bytes(&mut [0; 100]), black_box(true)));
    let frame = black_box(Frame::fd(id, FdFlags::default(), black_box(0), bytes(&mut [0; 100])));
    black_box((frame.payload(), frame.switches_bit_rate(), frame.to_adapter()));
    let adapter_id = black_box(AdapterId::new(black_box(0))).unwrap_or(AdapterId::MAX);
    if let Ok(frame) = armwire_bridge::can::Frame::new_fd(adapter_id, bytes(&mut [0; 100])) {
        black_box(Frame::from(frame));
    }

    black_box(BitRate::new(black_box(0)).map(BitRate::bits_per_second));
    black_box(DataBitRate::new(black_box(0)).map(DataBitRate::bits_per_second));
    let (mut commands, mut replies) = (Commands::default(), Replies::default());
    let (commands, replies) = (black_box(&mut commands), black_box(&mut replies));
    for &byte in &*bytes(&mut [0; 300]) {
        if let Some(Ok(command)) = commands.push(byte) {
            command.encode(&mut Sink);
        }
        if let Some(Ok(reply)) = replies.push(byte) {
            reply.encode(&mut Sink);
        }
    }
}
