//! The bit counts come from a separate program, which writes out each frame with its CRC and stuff bits.

use std::cmp::Ordering;

use armwire_bridge::can::FD_LENGTHS;
use proptest::prelude::*;

use super::*;

const ID: Id = Id::Standard(0x123);
const ARBITRATION_RATE: u32 = 1_000_000;

fn counting(len: u8) -> Vec<u8> {
    (0..len).collect()
}

/// An FD frame with bit rate switching.
fn fast(id: Id, data: &[u8]) -> Frame {
    Frame::fd_frame(id, data, true).unwrap()
}

/// Returns the bits outside the data phase, and those in it.
fn phases(frame: &Frame) -> (u32, u32) {
    let [slow, fast] = [(1, 0), (0, 1)].map(|(nominal, data)| {
        let times = BitTimes { nominal, data };
        frame.picoseconds(frame.bits_on_the_wire(), times) as u32
    });
    (slow, fast)
}

#[test]
fn empty_fd_frame_matches_hand_counted_bits() {
    // 0 00100100011 0 0 1 0 1 is start of frame to BRS, without five equal bits; 9 follow the CRC delimiter: 17 + 9.
    // ESI and DLC are 0 0000: five equal bits, but the fixed stuff bit is the only one. 5 + 1 + 4 + 17 + 5 + 1.
    assert_eq!(phases(&fast(ID, &[])), (17 + 9, 33));
}

#[test]
fn fd_frames_of_every_length_have_exact_bits() {
    let counts = [
        (0, 33),
        (8, 106),
        (12, 140),
        (16, 174),
        (20, 213),
        (24, 246),
        (32, 312),
        (48, 443),
        (64, 575),
    ];
    for (len, data_phase) in counts {
        assert_eq!(phases(&fast(ID, &counting(len))), (26, data_phase), "{len} bytes");
    }
}

#[test]
fn fd_stuff_bits_match_the_real_bits() {
    for (id, data, expected) in [
        (ID, vec![0; 64], (26, 652)),
        (Id::Standard(0x555), vec![0x55; 64], (26, 550)),
        (Id::Standard(0x7FF), vec![0xFF; 64], (28, 653)),
        (Id::Extended(0x18F3_A5C1), counting(64), (47, 575)),
        (Id::Standard(0x610), counting(24), (27, 246)),
    ] {
        assert_eq!(phases(&fast(id, &data)), expected, "{id:?}");
    }
}

#[test]
fn five_equal_bits_before_crc_get_one_stuff() {
    // The first frame ends with five equal bits, the second with four. Neither has five elsewhere.
    assert_eq!(phases(&fast(ID, &[0x1F])), phases(&fast(ID, &[0x2F])));
}

#[test]
fn frame_duration_is_exact_at_every_data_rate() {
    // 27 bits at 1 Mbit/s and 246 at the data rate.
    let frame = fast(Id::Standard(0x610), &counting(24));
    for (data_rate, nanos) in [
        (1_000_000, 273_000),
        (2_000_000, 150_000),
        (4_000_000, 88_500),
        (5_000_000, 76_200),
    ] {
        let times = BitTimes::new(ARBITRATION_RATE, data_rate);
        assert_eq!(frame.picoseconds(frame.bits_on_the_wire(), times), nanos * 1_000);
    }
    let slow = Frame::fd_frame(frame.id, frame.payload(), false).unwrap();
    let times = BitTimes::new(ARBITRATION_RATE, 5_000_000);
    assert_eq!(slow.picoseconds(slow.bits_on_the_wire(), times), 273_000_000);
}

#[test]
fn frame_phases_use_nominal_data_nominal_bit_times() {
    let frame = fast(ID, &[]);
    let times = BitTimes { nominal: 10, data: 1 };
    let at = |bits| frame.picoseconds(bits, times);
    assert_eq!([0, 1, 17, 18].map(at), [0, 10, 170, 171]);
    assert_eq!(at(frame.bits_before_crc_delimiter()), 170 + 32);
    assert_eq!(at(frame.bits_through_acknowledge()), 170 + 33 + 10);
    assert_eq!(at(frame.bits_until_valid()), 170 + 33 + 80);
}

#[test]
fn classic_frames_have_their_bits_with_stuff_bits() {
    for (frame, bits) in [
        (Frame::data_frame(ID, b"joints").unwrap(), 92),
        (Frame::data_frame(Id::Standard(0), &[0; 8]).unwrap(), 124),
        (Frame::data_frame(Id::Standard(0x7FF), &[]).unwrap(), 47),
        (Frame::data_frame(Id::Extended(0x1456_7890), &[1, 2]).unwrap(), 84),
        (Frame::remote_frame(Id::Standard(0x555), 4), 44),
    ] {
        assert_eq!(frame.bits_on_the_wire(), bits, "{frame:?}");
        assert_eq!(phases(&frame), (bits, 0));
    }
}

#[test]
fn classic_frame_wins_over_fd_frame_of_identifier() {
    for id in [ID, Id::Extended(0x123)] {
        let (classic, fd) = (Frame::data_frame(id, &[]).unwrap(), fast(id, &[]));
        assert_eq!(classic.arbitrates(&fd), Ordering::Less);
        assert_eq!(fd.arbitrates(&classic), Ordering::Greater);
        assert_eq!(
            fd.arbitrates(&Frame::remote_frame(id, 0)),
            Ordering::Less,
            "RRS is dominant"
        );
        assert_eq!(fd.arbitrates(&fd), Ordering::Equal);
    }
    let base = Frame::remote_frame(ID, 0);
    assert_eq!(base.arbitrates(&fast(Id::Extended(0x123 << 18), &[])), Ordering::Less);
    assert_eq!(
        fast(Id::Standard(0x122), &[]).arbitrates(&Frame::data_frame(ID, &[]).unwrap()),
        Ordering::Less
    );
}

#[test]
fn adapter_frames_are_only_those_it_supports() {
    let id = armwire_bridge::can::Id::new(0x123).unwrap();
    let classic = armwire_bridge::can::Frame::new(id, &[1, 2]).unwrap();
    let fd = armwire_bridge::can::Frame::new_fd(id, &[3; 48]).unwrap();
    for frame in [classic, fd] {
        assert_eq!(Frame::from(frame).to_adapter(), Some(frame));
    }
    assert!(Frame::from(fd).switches_bit_rate());
    assert_eq!(Frame::data_frame(Id::Extended(0x123), &[]).unwrap().to_adapter(), None);
    assert_eq!(Frame::remote_frame(ID, 0).to_adapter(), None);
    let long = Frame::classic(ID, false, 15, &[9; 64]);
    assert_eq!(long.payload(), [9; 8], "a DLC above eight is eight bytes");
}

proptest! {
    #[test]
    fn time_on_the_wire_grows_with_length(
        id in 0..=0x7FF_u16,
        data in any::<[u8; 64]>(),
        rates in (1..=1_000_000_u32, 1..=8_000_000_u32),
        bit_rate_switch in any::<bool>(),
    ) {
        let times = BitTimes::new(rates.0, rates.1);
        let time = |len: u8| {
            let frame = Frame::fd_frame(Id::Standard(id), &data[..usize::from(len)], bit_rate_switch).unwrap();
            frame.picoseconds(frame.bits_on_the_wire(), times)
        };
        prop_assert!(FD_LENGTHS.map(time).is_sorted_by(|shorter, longer| shorter < longer));
    }
}
