use armwire::time::Instant;

use super::*;

/// Refusal.
const BELL: u8 = 0x07;

/// An adapter, with its output and the frames that it sent.
#[derive(Default)]
struct Desk {
    adapter: Adapter,
    bus: Vec<Frame>,
    is_full: bool,
}

impl Desk {
    /// Passes bytes to the adapter and returns its output.
    fn send(&mut self, bytes: &[u8]) -> Vec<u8> {
        for &byte in bytes {
            self.adapter.receive(byte, |frame| {
                self.bus.push(frame);
                !self.is_full
            });
        }
        std::mem::take(self.adapter.output())
    }
}

#[test]
fn channel_needs_bit_rate_to_open_and_closes() {
    let mut desk = Desk::default();
    assert_eq!(desk.send(b"C\rO\rL\rF\rt1230\r"), [BELL; 5]);
    assert_eq!(desk.send(b"S6\rZ1\rO\r"), b"\r\r\r");
    assert_eq!(desk.adapter.bit_rate(), Some(500_000));
    assert_eq!(desk.send(b"O\rS8\rZ0\r"), [BELL; 3]);
    assert_eq!(desk.send(b"C\r"), b"\r");
    assert_eq!((desk.adapter.bit_rate(), desk.bus.len()), (None, 0));
    assert!(!desk.adapter.is_listening());
    assert_eq!(desk.send(b"L\rt1230\r"), b"\r\x07");
    assert!(desk.adapter.is_listening());
}

#[test]
fn open_channel_passes_frames_with_optional_stamps() {
    let mut desk = Desk::default();
    let frame = Frame::data_frame(Id::Standard(0x612), &[0x30, 0, 0xA5]).unwrap();
    desk.adapter.on_frame(&frame, Instant::ZERO);
    assert_eq!(desk.send(b"S8\rZ1\rO\rt61233000a5\r"), b"\r\r\rz\r");
    assert_eq!(desk.bus, [frame]);
    desk.adapter.on_frame(&frame, Instant::from_millis(60_000 + 0x1234));
    assert_eq!(desk.send(b""), b"t61233000A51234\r");
}

#[test]
fn status_shows_refused_and_lost_until_read() {
    let mut desk = Desk {
        is_full: true,
        ..Desk::default()
    };
    assert_eq!(desk.send(b"S8\rO\rt1230\rF\rF\r"), b"\r\r\x07F02\rF00\r");
    let frame = Frame::data_frame(Id::Standard(0), &[0; 8]).unwrap();
    for _ in 0..10_000 {
        desk.adapter.on_frame(&frame, Instant::ZERO);
    }
    let kept = desk.send(b"").len();
    assert!((65_536..65_600).contains(&kept), "{kept}");
    desk.adapter.report(Status::BUS_ERROR);
    assert_eq!(desk.send(b"F\r"), b"F81\r");
}

#[test]
fn python_can_sequence_opens_fd_channel() {
    // slcanBus with BitTimingFd: close, both rates, open, and open again.
    let mut desk = Desk::default();
    assert_eq!(desk.adapter.data_bit_rate(), 2_000_000);
    assert_eq!(desk.send(b"C\rS8\rY5\rO\rO\r"), b"\x07\r\r\r\x07");
    assert_eq!(
        (desk.adapter.bit_rate(), desk.adapter.data_bit_rate()),
        (Some(1_000_000), 5_000_000)
    );
    assert_eq!(desk.send(b"Y2\r"), [BELL], "not while the channel is open");
    assert_eq!(desk.send(b"B1FFFFFFF1AB\rb7FF0\rd7FF0\r"), b"Z\rz\rz\r");
    assert_eq!(
        desk.bus[0],
        Frame::fd_frame(Id::Extended(0x1FFF_FFFF), &[0xAB], true).unwrap()
    );
    assert!(desk.bus[1].switches_bit_rate() && !desk.bus[2].switches_bit_rate());
    // Without a data rate it sends an empty line.
    assert_eq!(desk.send(b"C\rS8\r\rO\r"), b"\r\r\r\r");
}
