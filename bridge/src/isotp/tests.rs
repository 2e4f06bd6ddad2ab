//! Behaviour of an endpoint on the bus, byte by byte.

extern crate std;

use std::string::ToString;
use std::vec::Vec;

use crate::time::{Duration, Instant};
use proptest::prelude::*;

use super::{Config, Endpoint, Error, Event, Events, Ignored, Link, MAX_PDU, RefusedPdu, SendError, SeparationTime};
use crate::can::{FD_LENGTHS, Frame, Id};

type Full = Endpoint<MAX_PDU, MAX_PDU>;

const T0: Instant = Instant::from_micros(5_000);
const SECOND: Duration = Duration::from_millis(1_000);

fn config(link: Link) -> Config {
    Config::new(link, Id::new(0x610).unwrap())
}

fn endpoint(link: Link) -> Full {
    Full::new(config(link))
}

/// A PDU whose bytes differ from their neighbours.
fn pdu(len: usize) -> Vec<u8> {
    (0..len).map(|i| (i % 251) as u8).collect()
}

fn events<const N: usize>(expected: [Event; N], got: Events) {
    assert_eq!(got.collect::<Vec<_>>(), expected);
}

/// The instant this many microseconds after [`T0`].
fn after(micros: u64) -> Instant {
    T0 + Duration::from_micros(micros)
}

/// The data of the next due frame.
fn next(endpoint: &mut Full, now: Instant) -> Vec<u8> {
    endpoint.transmit(now).expect("a frame is due").data().to_vec()
}

/// The data of all due frames.
fn all(endpoint: &mut Full, now: Instant) -> Vec<Vec<u8>> {
    core::iter::from_fn(|| Some(endpoint.transmit(now)?.data().to_vec())).collect()
}

/// A sender that has sent the first frame of a PDU of `len` bytes and waits for flow control.
fn waiting(len: usize) -> Full {
    let mut sender = endpoint(Link::Classic);
    sender.send(&pdu(len)).unwrap();
    assert_eq!(next(&mut sender, T0)[0] & 0xF0, 0x10);
    assert_eq!(sender.transmit(T0), None);
    sender
}

/// A receiver that has 6 of 20 bytes and has sent flow control.
fn receiving() -> Full {
    let mut receiver = endpoint(Link::Classic);
    events([], receiver.receive(&[0x10, 20, 0, 1, 2, 3, 4, 5], T0));
    assert_eq!(next(&mut receiver, T0)[..3], [0x30, 0, 0]);
    receiver
}

/// Asserts that both directions are idle and usable.
fn is_usable(endpoint: &mut Full, now: Instant) {
    assert_eq!((endpoint.is_sending(), endpoint.timeout()), (false, None));
    events([Event::Received], endpoint.receive(&[0x02, 0xAB, 0xCD], now));
    assert_eq!(endpoint.received(), Some(&[0xAB, 0xCD][..]));
    endpoint.release();
    endpoint.send(&[7]).unwrap();
    assert_eq!(next(endpoint, now)[..2], [1, 7]);
}

// ---- Sending ----

#[test]
fn up_to_seven_bytes_fit_one_padded_frame() {
    for link in [Link::Classic, Link::Fd] {
        let mut sender = endpoint(link);
        sender.send(&[0xAA, 0x06, 0xFF]).unwrap();
        let frame = sender.transmit(T0).unwrap();
        assert_eq!(frame.data(), [0x03, 0xAA, 0x06, 0xFF, 0xCC, 0xCC, 0xCC, 0xCC]);
        assert_eq!((frame.id().get(), frame.is_fd()), (0x610, link == Link::Fd));
        assert_eq!((sender.is_sending(), sender.transmit(T0)), (false, None));

        sender.send(&[1, 2, 3, 4, 5, 6, 7]).unwrap();
        assert_eq!(next(&mut sender, T0), [0x07, 1, 2, 3, 4, 5, 6, 7]);
    }
}

#[test]
fn longer_single_frame_uses_escape_length_fd_size() {
    for (len, frame_len) in [
        (8, 12),
        (10, 12),
        (11, 16),
        (18, 20),
        (22, 24),
        (30, 32),
        (46, 48),
        (47, 64),
        (62, 64),
    ] {
        let mut sender = endpoint(Link::Fd);
        sender.send(&pdu(len)).unwrap();
        let frame = next(&mut sender, T0);
        assert_eq!(frame.len(), frame_len);
        assert_eq!(frame[..2], [0, len as u8]);
        assert_eq!(frame[2..2 + len], pdu(len));
        assert!(frame[2 + len..].iter().all(|&byte| byte == 0xCC));
        assert!(!sender.is_sending());

        let mut receiver = endpoint(Link::Fd);
        events([Event::Received], receiver.receive(&frame, T0));
        assert_eq!(receiver.received(), Some(&pdu(len)[..]));
    }
}

#[test]
fn twenty_bytes_take_first_and_two_consecutive_frames() {
    let mut sender = endpoint(Link::Classic);
    sender.send(&pdu(20)).unwrap();
    assert_eq!(all(&mut sender, T0), [[0x10, 0x14, 0, 1, 2, 3, 4, 5]]);
    assert_eq!(sender.transmit_at(), None);
    events([], sender.receive(&[0x30, 0, 0], T0));
    assert_eq!(
        all(&mut sender, T0),
        [[0x21, 6, 7, 8, 9, 10, 11, 12], [0x22, 13, 14, 15, 16, 17, 18, 19]]
    );
    assert_eq!((sender.is_sending(), sender.timeout()), (false, None));
}

#[test]
fn longest_pdu_numbers_585_frames_modulo_16() {
    let mut sender = waiting(MAX_PDU);
    events([], sender.receive(&[0x30, 0, 0, 0xAA, 0xAA, 0xAA, 0xAA, 0xAA], T0));
    let frames = all(&mut sender, T0);
    assert_eq!(frames.len(), 585);
    let numbers = frames.iter().map(|frame| frame[0]);
    assert!(numbers.eq((1..=585).map(|n| 0x20 | (n % 16) as u8)));
    assert_eq!(
        frames[584],
        [0x29, pdu(MAX_PDU)[4094], 0xCC, 0xCC, 0xCC, 0xCC, 0xCC, 0xCC]
    );

    let mut first = endpoint(Link::Classic);
    first.send(&pdu(MAX_PDU)).unwrap();
    assert_eq!(next(&mut first, T0), [0x1F, 0xFF, 0, 1, 2, 3, 4, 5]);
}

#[test]
fn fd_frames_are_full_but_the_last() {
    let mut sender = endpoint(Link::Fd);
    sender.send(&pdu(163)).unwrap();
    let first = next(&mut sender, T0);
    assert_eq!((&first[..2], &first[2..]), (&[0x10, 163][..], &pdu(163)[..62]));
    events([], sender.receive(&[0x30, 0, 0], T0));
    let rest = all(&mut sender, T0);
    assert_eq!(rest.iter().map(Vec::len).collect::<Vec<_>>(), [64, 48]);
    assert_eq!((rest[0][0], &rest[0][1..]), (0x21, &pdu(163)[62..125]));
    assert_eq!((rest[1][0], &rest[1][1..39]), (0x22, &pdu(163)[125..]));
    assert_eq!(rest[1][39..], [0xCC; 9]);

    // The shortest PDU that needs two frames: the second has one byte of it and is padded to 8.
    sender.send(&pdu(63)).unwrap();
    assert_eq!(next(&mut sender, T0)[..2], [0x10, 63]);
    events([], sender.receive(&[0x30, 0, 0], T0));
    assert_eq!(next(&mut sender, T0), [0x21, 62, 0xCC, 0xCC, 0xCC, 0xCC, 0xCC, 0xCC]);
}

#[test]
fn block_ends_as_requested_and_awaits_flow_control() {
    // 20 consecutive frames: 1 after each flow control, 8 after each, all after one.
    for (block_size, blocks) in [(1, std::vec![1; 20]), (8, std::vec![8, 8, 4]), (0, std::vec![20])] {
        let mut sender = waiting(6 + 20 * 7);
        for block in blocks {
            assert_eq!(sender.timeout(), Some(T0 + SECOND));
            events([], sender.receive(&[0x30, block_size, 0], T0));
            assert_eq!(all(&mut sender, T0).len(), block);
        }
        assert!(!sender.is_sending());
    }
}

#[test]
fn each_flow_control_sets_block_and_separation_anew() {
    let mut sender = waiting(100);
    events([], sender.receive(&[0x30, 1, 0], T0));
    assert_eq!(all(&mut sender, T0).len(), 1);
    events([], sender.receive(&[0x30, 2, 5], T0));
    assert_eq!(all(&mut sender, T0).len(), 1);
    sender.transmitted(T0);
    assert_eq!(all(&mut sender, after(5_000)).len(), 1);
    assert_eq!(sender.transmit_at(), None);
}

#[test]
fn consecutive_frames_keep_the_separation_time() {
    for (byte, micros) in [
        (0x00, 0),
        (0x01, 1_000),
        (0x7F, 127_000),
        (0xF1, 100),
        (0xF9, 900),
        // Reserved: the maximum.
        (0x80, 127_000),
        (0xF0, 127_000),
        (0xFA, 127_000),
        (0xFF, 127_000),
    ] {
        let mut sender = waiting(20);
        events([], sender.receive(&[0x30, 0, byte], T0));
        assert_eq!(next(&mut sender, T0)[0], 0x21);
        sender.transmitted(T0);
        let due = after(micros);
        assert_eq!(
            (sender.transmit_at(), sender.timeout()),
            (Some(due), Some(due + SECOND))
        );
        if micros > 0 {
            assert_eq!(sender.transmit(due - Duration::from_micros(1)), None);
        }
        assert_eq!(next(&mut sender, due)[0], 0x22);
    }
}

#[test]
fn separation_begins_when_the_frame_has_left() {
    let mut sender = waiting(27);
    sender.transmitted(after(100));
    assert_eq!(sender.timeout(), Some(after(100) + SECOND));
    events([], sender.receive(&[0x30, 0, 1], after(300)));
    assert_eq!(next(&mut sender, after(300))[0], 0x21);
    // Other nodes have the bus for longer than the separation time.
    assert_eq!((sender.transmit_at(), sender.transmit(after(1_900))), (None, None));
    sender.transmitted(after(2_000));
    assert_eq!(sender.transmit_at(), Some(after(3_000)));
    // The first call counts, for each frame.
    sender.transmitted(after(2_500));
    assert_eq!(sender.transmit_at(), Some(after(3_000)));
}

#[test]
fn flow_control_between_frames_keeps_their_separation() {
    let mut both = waiting(27);
    events([], both.receive(&[0x30, 0, 1], T0));
    assert_eq!(next(&mut both, T0)[0], 0x21);
    events([], both.receive(&[0x10, 20, 0, 1, 2, 3, 4, 5], T0));
    assert_eq!(next(&mut both, T0)[0], 0x30);
    assert_eq!(both.transmit_at(), None);
    both.transmitted(after(300));
    assert_eq!(both.transmit_at(), Some(after(1_300)));
    assert_eq!(both.timeout(), Some(after(300) + SECOND));
}

#[test]
fn unexpected_flow_control_does_not_end_transmit_wait() {
    let mut sender = waiting(27);
    events([], sender.receive(&[0x30, 0, 1], T0));
    assert_eq!(next(&mut sender, T0)[0], 0x21);
    let ignored = Event::Ignored(Ignored::UnexpectedFlowControl { got: 0 });
    events([ignored], sender.receive(&[0x30, 0, 0], T0));
    assert_eq!(sender.transmit_at(), None);
    sender.transmitted(after(300));
    assert_eq!(sender.transmit_at(), Some(after(1_300)));
}

#[test]
fn without_separation_no_frame_waits_for_transmission() {
    let mut sender = waiting(27);
    events([], sender.receive(&[0x30, 0, 0], T0));
    assert_eq!(all(&mut sender, T0).len(), 3);
}

#[test]
fn flow_control_proves_the_previous_frame_was_sent() {
    let mut sender = waiting(27);
    events([], sender.receive(&[0x30, 0, 1], T0));
    sender.transmitted(after(100));
    assert_eq!(sender.transmit_at(), Some(T0));
}

#[test]
fn without_flow_control_sending_ends_after_n_bs() {
    let mut sender = waiting(20);
    sender.transmitted(after(100));
    let deadline = after(100) + SECOND;
    assert_eq!(sender.timeout(), Some(deadline));
    events([], sender.tick(deadline - Duration::from_micros(1)));
    assert!(sender.is_sending());
    events(
        [Event::Failed(Error::NoFlowControl { waited: SECOND })],
        sender.tick(deadline),
    );
    events(
        [Event::Ignored(Ignored::UnexpectedFlowControl { got: 0 })],
        sender.receive(&[0x30, 0, 0], deadline),
    );
    is_usable(&mut sender, deadline);
}

/// Asserts a timeout at `deadline` and no sooner, because a frame did not leave. Frames that leave later belong to no
/// transfer.
fn assert_transmit_timeout(mut sender: Full, handed: usize, deadline: Instant) {
    assert_eq!(sender.timeout(), Some(deadline));
    events([], sender.tick(deadline - Duration::from_micros(1)));
    assert!(sender.is_sending());
    let (waited, len) = (SECOND, 40);
    events(
        [Event::Failed(Error::NotTransmitted { waited, len, handed })],
        sender.tick(deadline),
    );
    assert_eq!((sender.transmit(deadline), sender.transmit_at()), (None, None));
    sender.transmitted(deadline);
    is_usable(&mut sender, deadline);
}

#[test]
fn frame_that_never_leaves_ends_the_pdu() {
    // The first frame.
    assert_transmit_timeout(waiting(40), 6, T0 + SECOND);

    // A consecutive frame, from which the next must keep the separation time.
    let mut sender = waiting(40);
    sender.transmitted(T0);
    events([], sender.receive(&[0x30, 0, 1], T0));
    assert_eq!(all(&mut sender, after(200)).len(), 1);
    assert_transmit_timeout(sender, 13, after(200) + SECOND);

    // The last frame of a block.
    let mut sender = waiting(40);
    events([], sender.receive(&[0x30, 2, 0], T0));
    assert_eq!(all(&mut sender, after(200)).len(), 2);
    assert_transmit_timeout(sender, 20, after(200) + SECOND);

    // One of many frames that are handed over as room allows, and leave.
    let mut sender = waiting(40);
    events([], sender.receive(&[0x30, 0, 0], T0));
    for passed in [0, 700_000, 1_400_000] {
        let now = after(passed);
        events([], sender.tick(now));
        assert!(sender.transmit(now).is_some());
    }
    assert_transmit_timeout(sender, 27, after(1_400_000) + SECOND);
}

#[test]
fn due_frame_without_handover_ends_the_pdu() {
    let mut sender = waiting(40);
    events([], sender.receive(&[0x30, 0, 0], after(300)));
    assert_transmit_timeout(sender, 6, after(300) + SECOND);

    let mut sender = waiting(40);
    events([], sender.receive(&[0x30, 0, 5], T0));
    assert_eq!(all(&mut sender, T0).len(), 1);
    sender.transmitted(after(100));
    assert_transmit_timeout(sender, 13, after(5_100) + SECOND);
}

#[test]
fn first_frame_has_no_timeout_before_handover() {
    let mut sender = endpoint(Link::Classic);
    sender.send(&pdu(20)).unwrap();
    let late = T0 + SECOND + SECOND;
    assert_eq!(sender.timeout(), None);
    events([], sender.tick(late));
    assert_eq!(all(&mut sender, late).len(), 1);
    assert_eq!(sender.timeout(), Some(late + SECOND));
}

#[test]
fn receiver_wait_requests_are_limited() {
    let mut sender = Full::new(Config {
        max_waits: 2,
        ..config(Link::Classic)
    });
    sender.send(&pdu(20)).unwrap();
    assert_eq!(all(&mut sender, T0).len(), 1);

    // Each WAIT restarts the timeout, and each block restarts the count.
    let late = after(900_000);
    events([], sender.receive(&[0x31, 0, 0], late));
    assert_eq!((sender.transmit_at(), sender.timeout()), (None, Some(late + SECOND)));
    events([], sender.receive(&[0x31, 0, 0], late));
    events([], sender.receive(&[0x30, 1, 0], late));
    assert_eq!(all(&mut sender, late).len(), 1);
    events([], sender.receive(&[0x31, 0, 0], late));
    events([], sender.receive(&[0x31, 0, 0], late));
    events(
        [Event::Failed(Error::TooManyWaits { max: 2 })],
        sender.receive(&[0x31, 0, 0], late),
    );
    is_usable(&mut sender, late);
}

#[test]
fn receiver_without_room_ends_the_sending() {
    let mut sender = waiting(20);
    events(
        [Event::Failed(Error::Overflow { len: 20 })],
        sender.receive(&[0x32, 0, 0], T0),
    );
    is_usable(&mut sender, T0);
}

#[test]
fn invalid_flow_status_ends_the_transfer() {
    for status in 3..=15 {
        let mut sender = waiting(20);
        events(
            [Event::Failed(Error::InvalidFlowStatus { got: status })],
            sender.receive(&[0x30 | status, 0, 0], T0),
        );
        is_usable(&mut sender, T0);
    }
}

#[test]
fn flow_control_in_midblock_changes_nothing() {
    let mut sender = waiting(27);
    events([], sender.receive(&[0x30, 0, 0], T0));
    assert_eq!(next(&mut sender, T0)[0], 0x21);
    for status in [0, 1, 2, 3] {
        events(
            [Event::Ignored(Ignored::UnexpectedFlowControl { got: status })],
            sender.receive(&[0x30 | status, 1, 1], T0),
        );
    }
    assert_eq!(all(&mut sender, T0).len(), 2);
}

#[test]
fn unsendable_pdu_is_refused_without_effect() {
    let mut sender = Endpoint::<10, 20>::new(config(Link::Classic));
    assert_eq!(sender.send(&[]), Err(SendError::Empty));
    assert_eq!(sender.send(&pdu(21)), Err(SendError::TooLong { max: 20, got: 21 }));
    assert_eq!(sender.transmit(T0), None);
    sender.send(&pdu(20)).unwrap();
    for other in [0, 1, 20, 21] {
        assert_eq!(sender.send(&pdu(other)), Err(SendError::Busy));
    }
    assert_eq!(sender.transmit(T0).unwrap().data(), [0x10, 20, 0, 1, 2, 3, 4, 5]);
    assert_eq!(sender.send(&[1]), Err(SendError::Busy));
}

// ---- Receiving ----

#[test]
fn single_frame_may_be_padded_or_not() {
    for frame in [
        &[0x02, 5, 6][..],
        &[0x02, 5, 6, 0, 0],
        &[0x02, 5, 6, 0xCC, 0xCC, 0xCC, 0xCC, 0xCC],
    ] {
        let mut receiver = endpoint(Link::Classic);
        events([Event::Received], receiver.receive(frame, T0));
        assert_eq!(receiver.received(), Some(&[5, 6][..]));
        assert_eq!((receiver.transmit_at(), receiver.timeout()), (None, None));
    }
}

#[test]
fn last_consecutive_frame_may_be_padded_or_not() {
    for padding in 0..=5 {
        let mut receiver = endpoint(Link::Classic);
        events([], receiver.receive(&[0x10, 8, 0, 1, 2, 3, 4, 5], T0));
        assert_eq!(next(&mut receiver, T0)[0], 0x30);
        let last = [&[0x21, 6, 7][..], &[0x55; 5][..padding]].concat();
        events([Event::Received], receiver.receive(&last, T0));
        assert_eq!(receiver.received(), Some(&pdu(8)[..]));
    }
}

#[test]
fn flow_control_goes_in_frames_of_the_link() {
    for link in [Link::Classic, Link::Fd] {
        let mut receiver = endpoint(link);
        events([], receiver.receive(&[0x10, 20, 0, 1, 2, 3, 4, 5], T0));
        let frame = receiver.transmit(T0).unwrap();
        assert_eq!((frame.id().get(), frame.is_fd()), (0x610, link == Link::Fd));
    }
}

#[test]
fn flow_control_requests_configured_values_after_each_block() {
    let mut receiver = Full::new(Config {
        block_size: 2,
        st_min: SeparationTime::from_hundreds_of_micros(5).unwrap(),
        ..config(Link::Classic)
    });
    let flow_control = [0x30, 2, 0xF5, 0xCC, 0xCC, 0xCC, 0xCC, 0xCC];
    events([], receiver.receive(&[0x10, 34, 0, 1, 2, 3, 4, 5], T0));
    assert_eq!(all(&mut receiver, T0), [flow_control]);
    events([], receiver.receive(&[0x21, 6, 7, 8, 9, 10, 11, 12], T0));
    assert_eq!(receiver.transmit(T0), None);
    events([], receiver.receive(&[0x22, 13, 14, 15, 16, 17, 18, 19], T0));
    assert_eq!(receiver.transmit_at(), Some(Instant::ZERO));
    assert_eq!(all(&mut receiver, T0), [flow_control]);
    events([], receiver.receive(&[0x23, 20, 21, 22, 23, 24, 25, 26], T0));
    // The last block is full too: no flow control follows.
    events(
        [Event::Received],
        receiver.receive(&[0x24, 27, 28, 29, 30, 31, 32, 33], T0),
    );
    assert_eq!(receiver.transmit(T0), None);
    assert_eq!(receiver.received(), Some(&pdu(34)[..]));
}

#[test]
fn sender_keeps_to_any_chosen_frame_length() {
    for frame_len in FD_LENGTHS.into_iter().map(usize::from).filter(|&len| len >= 8) {
        let mut receiver = endpoint(Link::Fd);
        let pdu = pdu(200);
        let mut first = std::vec![0x10, 200];
        first.extend(&pdu[..frame_len - 2]);
        events([], receiver.receive(&first, T0));
        assert_eq!(next(&mut receiver, T0)[0], 0x30);
        let chunks = pdu[frame_len - 2..].chunks(frame_len - 1);
        let last = chunks.len() - 1;
        for (i, chunk) in chunks.enumerate() {
            let mut frame = std::vec![0x20 | (i as u8 + 1) & 0x0F];
            frame.extend(chunk);
            if i < last {
                let short = &frame[..frame_len - 1];
                let (expected, got) = (frame_len, frame_len - 1);
                events(
                    [Event::Ignored(Ignored::Short { expected, got })],
                    receiver.receive(short, T0),
                );
            }
            let long = [&frame[..], &[0; 64]].concat();
            let (expected, got) = (frame_len, long.len());
            events(
                [Event::Ignored(Ignored::Long { expected, got })],
                receiver.receive(&long, T0),
            );
            let whole = receiver.receive(&frame, T0).next();
            assert_eq!(whole, (i == last).then_some(Event::Received));
        }
        assert_eq!(receiver.received(), Some(&pdu[..]));
    }
}

#[test]
fn receiving_ends_after_n_cr_without_next_frame() {
    let mut receiver = receiving();
    receiver.transmitted(after(100));
    let deadline = after(100) + SECOND;
    assert_eq!(receiver.timeout(), Some(deadline));
    let got = after(700_000);
    events([], receiver.receive(&[0x21, 6, 7, 8, 9, 10, 11, 12], got));
    let deadline = got + SECOND;
    assert_eq!(receiver.timeout(), Some(deadline));
    events([], receiver.tick(deadline - Duration::from_micros(1)));
    let error = Error::NoConsecutiveFrame {
        waited: SECOND,
        expected: 20,
        got: 13,
    };
    events([Event::Failed(error)], receiver.tick(deadline));
    assert_eq!(
        error.to_string(),
        "receiving: no consecutive frame in 1000000 µs after 13 of 20 bytes"
    );
    is_usable(&mut receiver, deadline);
}

#[test]
fn receiving_ends_if_flow_control_is_never_sent() {
    let mut receiver = endpoint(Link::Classic);
    events([], receiver.receive(&[0x10, 20, 0, 1, 2, 3, 4, 5], T0));
    let (waited, expected, got) = (SECOND, 20, 6);
    events(
        [Event::Failed(Error::NoConsecutiveFrame { waited, expected, got })],
        receiver.tick(receiver.timeout().unwrap()),
    );
    assert_eq!(receiver.transmit(T0 + SECOND), None);
    is_usable(&mut receiver, T0 + SECOND);
}

#[test]
fn sender_has_full_time_from_flow_control() {
    let mut receiver = endpoint(Link::Classic);
    events([], receiver.receive(&[0x10, 20, 0, 1, 2, 3, 4, 5], T0));
    let handed = after(600_000);
    assert_eq!(next(&mut receiver, handed)[0], 0x30);
    assert_eq!(receiver.timeout(), Some(handed + SECOND));
}

#[test]
fn both_timeouts_are_reported_at_once() {
    let mut both = receiving();
    both.send(&pdu(20)).unwrap();
    assert_eq!(all(&mut both, T0).len(), 1);
    both.transmitted(T0);
    let (waited, expected, got) = (SECOND, 20, 6);
    events(
        [
            Event::Failed(Error::NoConsecutiveFrame { waited, expected, got }),
            Event::Failed(Error::NoFlowControl { waited }),
        ],
        both.tick(T0 + SECOND),
    );
    is_usable(&mut both, T0 + SECOND);
}

#[test]
fn timeouts_are_those_of_the_configuration() {
    let mut both = Full::new(Config {
        n_as: Duration::from_micros(90),
        n_bs: Duration::from_micros(70),
        n_cr: Duration::from_micros(50),
        ..config(Link::Classic)
    });
    both.send(&pdu(20)).unwrap();
    assert_eq!(all(&mut both, T0).len(), 1);
    assert_eq!(both.timeout(), Some(after(90)));
    both.transmitted(T0);
    assert_eq!(both.timeout(), Some(after(70)));
    events([], both.receive(&[0x10, 20, 0, 1, 2, 3, 4, 5], T0));
    assert_eq!(both.timeout(), Some(after(50)));
    let (waited, expected, got) = (Duration::from_micros(50), 20, 6);
    events(
        [Event::Failed(Error::NoConsecutiveFrame { waited, expected, got })],
        both.tick(after(69)),
    );
    assert_eq!(both.timeout(), Some(after(70)));
    events(
        [Event::Failed(Error::NoFlowControl {
            waited: Duration::from_micros(70),
        })],
        both.tick(after(70)),
    );
    both.send(&pdu(20)).unwrap();
    assert_eq!(all(&mut both, T0).len(), 1);
    let error = Error::NotTransmitted {
        waited: Duration::from_micros(90),
        len: 20,
        handed: 6,
    };
    events([Event::Failed(error)], both.tick(after(90)));
    assert_eq!(
        error.to_string(),
        "sending: a frame did not leave in 90 µs, with 6 of 20 bytes handed over"
    );
}

#[test]
fn wrong_sequence_number_ends_the_receiving() {
    for number in (0..16).filter(|&number| number != 1) {
        let mut receiver = receiving();
        events(
            [Event::Failed(Error::WrongSequenceNumber {
                expected: 1,
                got: number,
            })],
            receiver.receive(&[0x20 | number, 6, 7, 8, 9, 10, 11, 12], T0),
        );
        events(
            [Event::Ignored(Ignored::UnexpectedConsecutive { got: 1 })],
            receiver.receive(&[0x21, 6, 7, 8, 9, 10, 11, 12], T0),
        );
        is_usable(&mut receiver, T0);
    }
}

#[test]
fn pdu_beyond_the_buffer_is_refused_with_overflow() {
    let overflow = [0x32, 0, 0, 0xCC, 0xCC, 0xCC, 0xCC, 0xCC];
    let mut receiver = Endpoint::<100, 1>::new(config(Link::Classic));
    for (first, len) in [
        ([0x10, 101, 0, 1, 2, 3, 4, 5], 101),
        ([0x1F, 0xFF, 0, 1, 2, 3, 4, 5], 4_095),
        ([0x10, 0x00, 0x00, 0x00, 0x10, 0x00, 0, 1], 4_096),
        ([0x10, 0x00, 0xFF, 0xFF, 0xFF, 0xFF, 0, 1], u32::MAX),
    ] {
        events(
            [Event::Refused(RefusedPdu::TooLong { max: 100, got: len })],
            receiver.receive(&first, T0),
        );
        assert_eq!(receiver.timeout(), None);
        assert_eq!(receiver.transmit(T0).unwrap().data(), overflow);
        assert_eq!(receiver.transmit(T0), None);
    }
    events([], receiver.receive(&[0x10, 100, 0, 1, 2, 3, 4, 5], T0));

    let mut small = Endpoint::<2, 1>::new(config(Link::Classic));
    events(
        [Event::Refused(RefusedPdu::TooLong { max: 2, got: 3 })],
        small.receive(&[3, 1, 2, 3], T0),
    );
    assert_eq!(small.transmit(T0), None);
}

#[test]
fn pending_overflow_is_dropped_after_sender_continued() {
    let mut receiver = Endpoint::<20, 1>::new(config(Link::Classic));
    for next in [&[0x01, 9][..], &[0x10, 20, 0, 1, 2, 3, 4, 5]] {
        events(
            [Event::Refused(RefusedPdu::TooLong { max: 20, got: 21 })],
            receiver.receive(&[0x10, 21, 0, 1, 2, 3, 4, 5], T0),
        );
        receiver.receive(next, T0).for_each(drop);
        receiver.release();
        let answer = receiver.transmit(T0).map(|frame| frame.data()[0]);
        assert_eq!(answer, (next.len() == 8).then_some(0x30));
    }
}

#[test]
fn further_pdus_are_refused_until_one_is_taken() {
    let mut receiver = endpoint(Link::Classic);
    events([Event::Received], receiver.receive(&[0x01, 9], T0));
    events(
        [Event::Refused(RefusedPdu::Occupied { got: 2 })],
        receiver.receive(&[0x02, 1, 2], T0),
    );
    assert_eq!(receiver.transmit(T0), None);
    events(
        [Event::Refused(RefusedPdu::Occupied { got: 20 })],
        receiver.receive(&[0x10, 20, 0, 1, 2, 3, 4, 5], T0),
    );
    assert_eq!(next(&mut receiver, T0)[0], 0x32);
    receiver.abort();
    assert_eq!(receiver.received(), Some(&[9][..]));
    receiver.release();
    assert_eq!(receiver.received(), None);
    is_usable(&mut receiver, T0);
}

// ---- Unexpected frames ----

#[test]
fn single_frame_in_midpdu_replaces_the_pdu() {
    let mut receiver = receiving();
    events(
        [
            Event::Failed(Error::Interrupted { expected: 20, got: 6 }),
            Event::Received,
        ],
        receiver.receive(&[0x01, 9], T0),
    );
    assert_eq!(receiver.received(), Some(&[9][..]));
    receiver.release();
    is_usable(&mut receiver, T0);
}

#[test]
fn first_frame_in_midpdu_starts_anew() {
    let mut receiver = receiving();
    events([], receiver.receive(&[0x21, 6, 7, 8, 9, 10, 11, 12], T0));
    events(
        [Event::Failed(Error::Interrupted { expected: 20, got: 13 })],
        receiver.receive(&[0x10, 8, 0, 1, 2, 3, 4, 5], T0),
    );
    assert_eq!(next(&mut receiver, T0)[0], 0x30);
    events([Event::Received], receiver.receive(&[0x21, 6, 7], T0));
    assert_eq!(receiver.received(), Some(&pdu(8)[..]));
}

#[test]
fn oversized_first_frame_ends_pdu_and_is_refused() {
    let mut receiver = Endpoint::<20, 1>::new(config(Link::Classic));
    events([], receiver.receive(&[0x10, 20, 0, 1, 2, 3, 4, 5], T0));
    events(
        [
            Event::Failed(Error::Interrupted { expected: 20, got: 6 }),
            Event::Refused(RefusedPdu::TooLong { max: 20, got: 21 }),
        ],
        receiver.receive(&[0x10, 21, 0, 1, 2, 3, 4, 5], T0),
    );
    // One flow control frame: for the second PDU.
    assert_eq!(receiver.transmit(T0).unwrap().data()[0], 0x32);
    assert_eq!((receiver.transmit(T0), receiver.timeout()), (None, None));
}

#[test]
fn consecutive_frame_before_flow_control_is_ignored() {
    let unexpected = Event::Ignored(Ignored::UnexpectedConsecutive { got: 1 });
    let consecutive = [0x21, 6, 7, 8, 9, 10, 11, 12];
    let mut receiver = endpoint(Link::Classic);
    events([unexpected], receiver.receive(&consecutive, T0));
    events([], receiver.receive(&[0x10, 20, 0, 1, 2, 3, 4, 5], T0));
    events([unexpected], receiver.receive(&consecutive, T0));
    assert_eq!(next(&mut receiver, T0)[0], 0x30);
    events([], receiver.receive(&consecutive, T0));
    events(
        [Event::Received],
        receiver.receive(&[0x22, 13, 14, 15, 16, 17, 18, 19], T0),
    );
    events([unexpected], receiver.receive(&consecutive, T0));
    assert_eq!(receiver.received(), Some(&pdu(20)[..]));
}

#[test]
fn flow_control_while_nothing_is_sent_is_ignored() {
    for mut receiver in [endpoint(Link::Classic), receiving()] {
        let timeout = receiver.timeout();
        events(
            [Event::Ignored(Ignored::UnexpectedFlowControl { got: 2 })],
            receiver.receive(&[0x32, 0, 0], T0),
        );
        assert_eq!(receiver.timeout(), timeout);
    }
}

#[test]
fn malformed_frames_change_nothing() {
    let short = |expected, got| Ignored::Short { expected, got };
    let length = |min, max, got| Ignored::PduLength { min, max, got };
    let fd = |start: &[u8], len: usize| {
        let mut frame = start.to_vec();
        frame.resize(len, 0);
        frame
    };
    let malformed = [
        (std::vec![], short(1, 0)),
        // Single frames: empty, longer than the frame, and with an unnecessary escape.
        (std::vec![0x00], short(2, 1)),
        (fd(&[0x00], 8), length(1, 7, 0)),
        (fd(&[0x08], 8), length(1, 7, 8)),
        (fd(&[0x03], 3), length(1, 2, 3)),
        (fd(&[0x00, 5], 8), length(1, 7, 0)),
        (fd(&[0x00, 0], 12), length(1, 10, 0)),
        (fd(&[0x00, 11], 12), length(1, 10, 11)),
        (fd(&[0x05], 12), Ignored::NotEscaped { got: 5 }),
        // First frames: truncated, and of PDUs that fit a single frame.
        (std::vec![0x10], short(8, 1)),
        (fd(&[0x10, 20], 7), short(8, 7)),
        (fd(&[0x10, 7], 8), length(8, 4_095, 7)),
        (fd(&[0x10, 62], 64), length(63, 4_095, 62)),
        (fd(&[0x10, 0], 8), length(4_096, u32::MAX, 0)),
        (fd(&[0x10, 0, 0, 0, 0x0F, 0xFF], 8), length(4_096, u32::MAX, 4_095)),
        // Flow control: truncated.
        (std::vec![0x30, 0], short(3, 2)),
        // Invalid types.
        (fd(&[0x40], 8), Ignored::UnknownType { got: 4 }),
        (fd(&[0xFF], 8), Ignored::UnknownType { got: 15 }),
    ];
    for (frame, reason) in malformed {
        let mut both = receiving();
        both.send(&pdu(20)).unwrap();
        assert_eq!(all(&mut both, T0).len(), 1);
        events([Event::Ignored(reason)], both.receive(&frame, after(1)));
        assert_eq!(both.timeout(), Some(T0 + SECOND));
        // Both transfers continue.
        events([], both.receive(&[0x21, 6, 7, 8, 9, 10, 11, 12], T0));
        events([Event::Received], both.receive(&[0x22, 13, 14, 15, 16, 17, 18, 19], T0));
        events([], both.receive(&[0x30, 0, 0], T0));
        assert_eq!(all(&mut both, T0).len(), 2);
    }
}

#[test]
fn after_abort_both_halves_are_idle() {
    let mut both = receiving();
    both.send(&pdu(20)).unwrap();
    assert_eq!((both.abort(), both.abort()), (2, 0));
    assert_eq!(both.transmit(T0), None);
    is_usable(&mut both, T0);

    // A frame that leaves only now belongs to the aborted transfer.
    let mut receiver = receiving();
    receiver.abort();
    events([], receiver.receive(&[0x10, 20, 0, 1, 2, 3, 4, 5], T0));
    receiver.transmitted(after(100));
    assert_eq!(receiver.timeout(), Some(T0 + SECOND));

    // A pending flow control frame is not sent either.
    let mut receiver = endpoint(Link::Classic);
    events([], receiver.receive(&[0x10, 20, 0, 1, 2, 3, 4, 5], T0));
    receiver.abort();
    assert_eq!(receiver.transmit(T0), None);
    is_usable(&mut receiver, T0);
}

#[test]
fn maximum_time_is_handled_like_any_other() {
    let end = Instant::from_micros(u64::MAX);
    let mut both = endpoint(Link::Classic);
    events([], both.tick(end));
    assert_eq!(
        (both.transmit(end), both.transmit_at(), both.timeout()),
        (None, None, None)
    );
    both.send(&pdu(20)).unwrap();
    assert_eq!(all(&mut both, end).len(), 1);
    events([], both.receive(&[0x30, 0, 0x7F], end));
    assert_eq!(all(&mut both, end).len(), 2);
    is_usable(&mut both, end);
}

// ---- Two endpoints on a bus ----

/// Two endpoints, a bus that carries one frame at a time, and their results.
struct Bus {
    ends: [Full; 2],
    events: [Vec<Event>; 2],
    received: [Vec<Vec<u8>>; 2],
    now: Instant,
    /// Loss of each frame, in the order of sending. Later frames are not lost.
    lost: std::vec::IntoIter<bool>,
    /// Every frame, lost or not: sender, start, end.
    log: Vec<(usize, Instant, Instant, Frame)>,
}

/// Approximate duration of a frame on the bus.
const FRAME_TIME: Duration = Duration::from_micros(130);

impl Bus {
    fn new(configs: [Config; 2], lost: Vec<bool>) -> Self {
        Self {
            ends: configs.map(Full::new),
            events: Default::default(),
            received: Default::default(),
            now: T0,
            lost: lost.into_iter(),
            log: Vec::new(),
        }
    }

    /// Runs until neither end has a frame or a timeout.
    fn run(&mut self) {
        // The end that sent last goes second: neither monopolises the bus.
        let mut turn = [0, 1];
        loop {
            let now = self.now;
            if let Some((from, frame)) = turn.into_iter().find_map(|i| Some((i, self.ends[i].transmit(now)?))) {
                self.now = now + FRAME_TIME;
                self.log.push((from, now, self.now, frame));
                self.ends[from].transmitted(self.now);
                if !self.lost.next().unwrap_or(false) {
                    let events = self.ends[1 - from].receive(frame.data(), self.now);
                    self.note(1 - from, events);
                }
                turn = [1 - from, from];
                continue;
            }
            for i in 0..2 {
                let events = self.ends[i].tick(now);
                self.note(i, events);
            }
            let times = self.ends.iter().flat_map(|end| [end.transmit_at(), end.timeout()]);
            match times.flatten().min() {
                Some(next) => self.now = self.now.max(next),
                None => return,
            }
        }
    }

    fn note(&mut self, end: usize, events: Events) {
        self.events[end].extend(events);
        if let Some(pdu) = self.ends[end].received() {
            self.received[end].push(pdu.to_vec());
            self.ends[end].release();
        }
    }

    /// The number of aborted transfers, at either end.
    fn failures(&self) -> usize {
        let events = self.events.iter().flatten();
        events.filter(|event| matches!(event, Event::Failed(_))).count()
    }

    /// Returns true if end `from` respected the other end's configuration.
    fn respected(&self, from: usize, requested: &Config) -> bool {
        let mut in_block = 0_u16;
        let mut left: Option<Instant> = None;
        for (end, began, ended, frame) in &self.log {
            match frame.data()[0] >> 4 {
                2 if *end == from => {
                    in_block += 1;
                    let kept = left.is_none_or(|left| began.since(left) >= requested.st_min.duration());
                    if !kept || requested.block_size > 0 && in_block > u16::from(requested.block_size) {
                        return false;
                    }
                    left = Some(*ended);
                }
                3 if *end != from => (in_block, left) = (0, None),
                _ => {}
            }
        }
        true
    }
}

fn link() -> impl Strategy<Value = Link> {
    prop_oneof![Just(Link::Classic), Just(Link::Fd)]
}

prop_compose! {
    fn any_config(id: u16)(link in link(), block_size: u8, small in 0..4_u8, st_min: u8) -> Config {
        // Half of the blocks are small, because most PDUs end within a large one.
        let block_size = if st_min.is_multiple_of(2) { small } else { block_size };
        let st_min = SeparationTime::from_byte(st_min);
        Config { block_size, st_min, ..Config::new(link, Id::new(id).unwrap()) }
    }
}

/// Lengths near a change of the number of frames, and arbitrary ones.
fn any_pdu() -> impl Strategy<Value = Vec<u8>> {
    let len = prop_oneof![1..=80_usize, 1..=MAX_PDU];
    len.prop_flat_map(|len| prop::collection::vec(any::<u8>(), len))
}

proptest! {
    #[test]
    fn any_pdu_arrives_within_requested_flow_control(
        a in any_config(0x600),
        b in any_config(0x610),
        pdus in prop::collection::vec(any_pdu(), 1..3),
    ) {
        let mut bus = Bus::new([a, b], Vec::new());
        for pdu in &pdus {
            bus.ends[0].send(pdu).unwrap();
            bus.run();
        }
        prop_assert_eq!(&bus.received, &[Vec::new(), pdus.clone()]);
        prop_assert_eq!(&bus.events, &[Vec::new(), std::vec![Event::Received; pdus.len()]]);
        prop_assert!(bus.respected(0, &b));
    }

    #[test]
    fn pdus_pass_both_ways_at_once(
        a in any_config(0x600),
        b in any_config(0x610),
        pdus in [any_pdu(), any_pdu()],
    ) {
        let mut bus = Bus::new([a, b], Vec::new());
        for (end, pdu) in bus.ends.iter_mut().zip(&pdus) {
            end.send(pdu).unwrap();
        }
        bus.run();
        let [from_a, from_b] = pdus;
        prop_assert_eq!(&bus.received, &[std::vec![from_b], std::vec![from_a]]);
        prop_assert_eq!(&bus.events, &[[Event::Received], [Event::Received]]);
        prop_assert!(bus.respected(0, &b) && bus.respected(1, &a));
    }

    #[test]
    fn lost_frames_give_whole_pdu_or_failure(
        a in any_config(0x600),
        b in any_config(0x610),
        pdu in any_pdu(),
        lost in prop::collection::vec(prop::bool::weighted(0.05), 0..700),
    ) {
        let mut bus = Bus::new([a, b], lost);
        bus.ends[0].send(&pdu).unwrap();
        bus.run();
        let arrived = !bus.received[1].is_empty();
        if arrived {
            prop_assert_eq!(&bus.received[1], std::slice::from_ref(&pdu));
        }
        // The loss of a single frame cannot be detected.
        if bus.log.len() > 1 || arrived {
            prop_assert_eq!(arrived, bus.failures() == 0);
        }
        bus.lost = Vec::new().into_iter();
        for from in [0, 1] {
            bus.received = Default::default();
            bus.ends[from].send(&pdu).unwrap();
            bus.run();
            prop_assert_eq!(&bus.received[1 - from], std::slice::from_ref(&pdu));
        }
    }

    #[test]
    fn with_frames_lost_both_ways_nothing_wrong_arrives(
        a in any_config(0x600),
        b in any_config(0x610),
        pdus in [prop::collection::vec(any_pdu(), 1..4), prop::collection::vec(any_pdu(), 1..4)],
        lost in prop::collection::vec(prop::bool::weighted(0.1), 0..700),
    ) {
        let mut bus = Bus::new([a, b], lost);
        for i in 0..3 {
            for (end, pdus) in bus.ends.iter_mut().zip(&pdus) {
                if let Some(pdu) = pdus.get(i) {
                    end.send(pdu).unwrap();
                }
            }
            bus.run();
        }
        for (received, sent) in bus.received.iter().zip(pdus.iter().rev()) {
            // In order, without duplicates, and only sent PDUs.
            let mut sent = sent.iter();
            prop_assert!(received.iter().all(|pdu| sent.any(|sent| sent == pdu)));
        }
        for end in &mut bus.ends {
            is_usable(end, bus.now);
        }
    }

    #[test]
    fn endpoint_recovers_to_idle_after_any_input(
        config in any_config(0x610),
        steps in prop::collection::vec((prop::collection::vec(any::<u8>(), 0..=70), 0..5_u8, 0..600_000_u64), 0..60),
    ) {
        let mut end = Full::new(config);
        let mut now = T0;
        for (mut frame, kind, passed) in steps {
            now += Duration::from_micros(passed);
            if let Some(first) = frame.first_mut().filter(|_| kind < 4) {
                *first = kind << 4 | *first & 0x0F;
            }
            let _ = end.send(&frame);
            let before = end.timeout();
            let events: Vec<_> = end.receive(&frame, now).collect();
            if events.iter().any(|event| matches!(event, Event::Ignored(_))) {
                prop_assert_eq!((events.len(), end.timeout()), (1, before));
            }
            prop_assert_eq!(end.received().is_some(), events.contains(&Event::Received));
            end.release();
            while end.transmit(now).is_some() {}
            // They leave now, or some time later.
            if passed % 2 == 0 {
                end.transmitted(now);
            }
            end.tick(now).for_each(drop);
        }
        end.transmitted(now);
        while let Some(next) = end.transmit_at().into_iter().chain(end.timeout()).min() {
            now = now.max(next);
            while end.transmit(now).is_some() {
                end.transmitted(now);
            }
            end.tick(now).for_each(drop);
        }
        is_usable(&mut end, now);
    }
}
