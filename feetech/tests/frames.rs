//! Packets: their bytes, their boundaries, and what damage does to them.

use std::slice;

use armwire::decoder::{Decoder, Kind};
use armwire::framing::{Framing, Reason, Scan};
use armwire::messages::Messages;
use armwire_feetech::{BROADCAST, Expect, Feetech, MAX_FRAME, Request, Status};
use proptest::collection::vec;
use proptest::prelude::*;

const SIDES: [Expect; 2] = [Expect::Requests, Expect::Responses];

fn encoded(request: &Request) -> Vec<u8> {
    let mut out = [0; MAX_FRAME];
    let n = Feetech::default().encode_request(request, &mut out).unwrap();
    out[..n].to_vec()
}

fn hex(text: &str) -> Vec<u8> {
    text.split(' ')
        .map(|byte| u8::from_str_radix(byte, 16).unwrap())
        .collect()
}

/// The manual's examples (1.3), and computed ones.
fn requests() -> Vec<(&'static str, Request<'static>)> {
    vec![
        ("FF FF 01 02 01 FB", Request::Ping { id: 1 }),
        (
            "FF FF 01 04 02 38 02 BE",
            Request::Read {
                id: 1,
                address: 56,
                len: 2,
            },
        ),
        (
            "FF FF FE 04 03 05 01 F4",
            Request::Write {
                id: BROADCAST,
                address: 5,
                data: &[1],
            },
        ),
        (
            "FF FF 01 09 03 2A 00 08 00 00 E8 03 D5",
            Request::Write {
                id: 1,
                address: 42,
                data: &[0, 8, 0, 0, 0xE8, 3],
            },
        ),
        (
            "FF FF 01 09 04 2A 00 08 00 00 E8 03 D4",
            Request::RegWrite {
                id: 1,
                address: 42,
                data: &[0, 8, 0, 0, 0xE8, 3],
            },
        ),
        ("FF FF FE 02 05 FA", Request::Action { id: BROADCAST }),
        ("FF FF 00 02 06 F7", Request::FactoryReset { id: 0 }),
        ("FF FF 02 02 08 F3", Request::Reboot { id: 2 }),
        ("FF FF 02 02 0A F1", Request::ResetTurns { id: 2 }),
        (
            "FF FF FE 06 82 1E 02 0B 0C 42",
            Request::SyncRead {
                address: 30,
                len: 2,
                ids: &[11, 12],
            },
        ),
        (
            "FF FF FE 0A 83 1E 02 0B 00 00 0C 0A 14 1F",
            Request::SyncWrite {
                address: 30,
                len: 2,
                data: &[11, 0, 0, 12, 10, 20],
            },
        ),
    ]
}

/// The items of a stream that arrives in chunks of this size, and is idle at its end.
fn items(stream: &[u8], size: usize, expect: Expect) -> Vec<(bool, Vec<u8>)> {
    let (mut decoder, mut items) = (Decoder::<Feetech, MAX_FRAME>::new(), Vec::new());
    let mut take = |decoder: &mut Decoder<Feetech, MAX_FRAME>| {
        while let Some(item) = decoder.next(&Feetech::default(), expect) {
            items.push((item.kind == Kind::Frame, item.bytes.to_vec()));
        }
    };
    for chunk in stream.chunks(size) {
        let mut rest = chunk;
        while !rest.is_empty() {
            rest = decoder.push(rest);
            take(&mut decoder);
        }
    }
    decoder.idle();
    take(&mut decoder);
    items
}

fn frames(stream: &[u8], size: usize, expect: Expect) -> Vec<Vec<u8>> {
    let items = items(stream, size, expect).into_iter();
    items
        .filter(|(is_frame, _)| *is_frame)
        .map(|(_, bytes)| bytes)
        .collect()
}

#[test]
fn requests_have_their_bytes_and_back() {
    for (bytes, request) in requests() {
        assert_eq!(encoded(&request), hex(bytes), "{request}");
        assert_eq!(Feetech::default().parse_request(&hex(bytes)), Ok(request));
    }
}

#[test]
fn requests_and_answers_have_texts() {
    let texts: Vec<_> = requests().iter().map(|(_, request)| request.to_string()).collect();
    let expected = [
        "PING servo 1",
        "READ servo 1, position (56), 2 bytes",
        "WRITE all, id (5): 01",
        "WRITE servo 1, goal-position (42): 00 08 00 00 E8 03",
        "REG_WRITE servo 1, goal-position (42): 00 08 00 00 E8 03",
        "ACTION all",
        "FACTORY_RESET servo 0",
        "REBOOT servo 2",
        "RESET_TURNS servo 2",
        "SYNC_READ all, resolution (30), 2 bytes: 0B 0C",
        "SYNC_WRITE all, resolution (30), 2 bytes: 0B 00 00 0C 0A 14",
    ];
    assert_eq!(texts, expected);
    let status = |error, data| Status { id: 3, error, data }.to_string();
    assert_eq!(status(0, &[0, 8]), "servo 3: 00 08");
    assert_eq!(status(0x21, &[]), "servo 3 with voltage, overload");
    assert_eq!(status(0xFF, &[]).matches(',').count(), 7);
}

#[test]
fn wrong_requests_are_refused_with_their_cause() {
    let refusal = |text| Feetech::default().parse_request(&hex(text)).unwrap_err().to_string();
    assert_eq!(refusal("FF FF 01 03 02 38 C1"), "command 02: 1 data bytes, expected 2");
    assert_eq!(refusal("FF FF 01 03 01 00 FA"), "command 01: 1 data bytes, expected 0");
    // To one servo; not an id and two bytes for each.
    assert_eq!(refusal("FF FF 01 05 82 38 02 01 3C"), "command 82: unknown");
    assert_eq!(refusal("FF FF FE 06 83 2A 02 01 00 4B"), "command 83: unknown");
    for (text, cause) in [
        ("FF FF 01 02 07 F5", "command 07: unknown"),
        ("FF FF 01 02 55 A7", "command 55: unknown"),
    ] {
        assert_eq!(refusal(text), cause);
    }
    assert!(Feetech::default().parse_request(&[0xFF]).is_err());
}

#[test]
fn packet_that_no_byte_can_state_is_not_written() {
    let data = [0; 300];
    for (len, fits) in [(MAX_FRAME - 7, true), (MAX_FRAME - 6, false), (260, false)] {
        let (id, address, data) = (1, 0, &data[..len]);
        let mut out = [0xEE; 400];
        let written = Feetech::default().encode_request(&Request::Write { id, address, data }, &mut out);
        assert_eq!(written.is_ok(), fits, "{len}");
        assert_eq!(out[0] != 0xEE, fits);
        if len == 260 {
            let text = "data is 261 bytes, must be 0..=244";
            assert_eq!(written.unwrap_err().to_string(), text);
        }
    }
    let error = Feetech::default().encode_request(&Request::Ping { id: 255 }, &mut [0; 9]);
    assert_eq!(error.unwrap_err().to_string(), "id is 255, must be 0..=254");
    for len in [245, 254, 255, 300] {
        let (id, error, data) = (1, 0, &data[..len]);
        let written = Feetech::default().encode_response(&Status { id, error, data }, None, &mut [0; 400]);
        assert!(written.is_err(), "{len}");
    }
    let error = Feetech::default().encode_request(&Request::Ping { id: 1 }, &mut [0; 5]);
    assert_eq!(
        error.unwrap_err().to_string(),
        "the message takes 6 bytes, the buffer has 5"
    );
}

#[test]
fn servos_of_a_request_to_several_are_checked() {
    let refusal = |request: Request| {
        let mut out = [0xEE; MAX_FRAME];
        let error = Feetech::default().encode_request(&request, &mut out).unwrap_err();
        assert_eq!(out, [0xEE; MAX_FRAME]);
        error.to_string()
    };
    let (address, len) = (42, 2);
    for (ids, text) in [
        (&[1, BROADCAST][..], "id is 254, must be 0..=253"),
        (&[255][..], "id is 255, must be 0..=253"),
        (&[3, 1, 2, 1][..], "count of one id is 2, must be 1..=1"),
        (&[][..], "count of ids is 0, must be 1..=242"),
    ] {
        assert_eq!(refusal(Request::SyncRead { address, len, ids }), text);
        let data: Vec<u8> = ids.iter().flat_map(|id| [*id, 0, 8]).collect();
        let data = &data[..];
        assert_eq!(refusal(Request::SyncWrite { address, len, data }), text);
    }
    for (data, text) in [
        (&[1, 0, 8, 2, 0][..], "data of the last servo is 1 bytes, must be 2..=2"),
        (&[1, 0, 8, 2][..], "data of the last servo is 0 bytes, must be 2..=2"),
    ] {
        assert_eq!(refusal(Request::SyncWrite { address, len, data }), text);
    }
    // A value may equal an id.
    let data = &[1, 2, 1, 2, 1, 2];
    assert_eq!(encoded(&Request::SyncWrite { address, len, data }).len(), 14);
}

#[test]
fn chunks_of_any_size_give_the_same_frames() {
    let stream: Vec<u8> = requests().iter().flat_map(|(bytes, _)| hex(bytes)).collect();
    for size in 1..=stream.len() {
        let expected: Vec<_> = requests().iter().map(|(bytes, _)| hex(bytes)).collect();
        assert_eq!(frames(&stream, size, Expect::Requests), expected, "{size}");
    }
}

#[test]
fn noise_before_a_packet_costs_no_packet() {
    let answer = hex("FF FF 01 04 00 00 08 F2");
    for noise in [
        "FF",
        "00",
        "FF FF",
        "FF FF FF",
        "FF 00",
        "FF FF 01 00",
        "FF FF FE 04",
        "FF FF 01 FF",
    ] {
        let stream = [hex(noise), answer.clone()].concat();
        for size in 1..=stream.len() {
            assert_eq!(
                frames(&stream, size, Expect::Responses),
                slice::from_ref(&answer),
                "{noise}"
            );
        }
    }
}

#[test]
fn packet_to_all_is_no_answer() {
    let sync = hex("FF FF FE 06 82 1E 02 0B 0C 42");
    assert_eq!(frames(&sync, 1, Expect::Requests), slice::from_ref(&sync));
    assert_eq!(frames(&sync, 1, Expect::Responses), [[]; 0]);
}

#[test]
fn wrong_length_byte_waits_for_silence() {
    let answer = hex("FF FF 02 02 00 FB");
    let stream = [hex("FF FF 01 F4 00 00 08 F2"), answer.clone()].concat();
    let mut decoder = Decoder::<Feetech, MAX_FRAME>::new();
    assert!(decoder.push(&stream).is_empty());
    assert_eq!(decoder.next(&Feetech::default(), Expect::Responses), None);
    decoder.idle();
    let item = decoder.next(&Feetech::default(), Expect::Responses).unwrap();
    let missing = 0xF4 + 4 - stream.len();
    assert_eq!(item.kind, Kind::Noise(Reason::Truncated { missing }));
    assert_eq!(frames(&stream, 1, Expect::Responses), [answer]);
}

#[test]
fn every_flipped_bit_is_found() {
    for (bytes, _) in requests() {
        for bit in 0..hex(bytes).len() * 8 {
            let mut damaged = hex(bytes);
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert_ne!(
                frames(&damaged, 99, Expect::Requests),
                [damaged.clone()],
                "{bytes} bit {bit}"
            );
        }
    }
}

fn any_byte() -> impl Strategy<Value = u8> {
    prop_oneof![3 => Just(0xFF), 3 => 0..9_u8, 1 => Just(0x82), 1 => any::<u8>()]
}

proptest! {
    #[test]
    fn every_byte_of_a_random_stream_comes_out(stream in vec(any_byte(), 0..300), size in 1..40_usize) {
        for expect in SIDES {
            let items = items(&stream, size, expect);
            prop_assert_eq!(items.iter().flat_map(|(_, bytes)| bytes).copied().collect::<Vec<_>>(), &stream[..]);
        }
    }

    #[test]
    fn verdict_does_not_change_with_more_bytes(stream in vec(any_byte(), 0..40)) {
        for (expect, cut) in SIDES.into_iter().flat_map(|side| (0..stream.len()).map(move |cut| (side, cut))) {
            let (early, late) = (Feetech::default().scan(&stream[..cut], expect), Feetech::default().scan(&stream, expect));
            match (early, late) {
                (Scan::Need(n), Scan::Frame(total)) => prop_assert!(n >= 1 && cut + n <= total),
                (Scan::Need(n), _) => prop_assert!(n >= 1),
                (Scan::Noise(short, Reason::Stray), Scan::Noise(long, Reason::Stray)) => prop_assert!(short <= long),
                _ => prop_assert_eq!(early, late),
            }
        }
    }

    #[test]
    fn every_frame_is_parsed_or_refused(id in 0..=BROADCAST, code in any::<u8>(), data in vec(any::<u8>(), 0..244)) {
        let mut out = [0; MAX_FRAME];
        let n = Feetech::default().encode_response(&Status { id, error: code, data: &data }, None, &mut out).unwrap();
        let status = Feetech::default().parse_response(&out[..n], Expect::Responses).unwrap();
        prop_assert_eq!((status.id, status.error, status.data), (id, code, &data[..]));
        if let Ok(request) = Feetech::default().parse_request(&out[..n]) {
            let mut again = [0; MAX_FRAME];
            // Another host may name no servo, or one twice.
            let is_to_several = matches!(request, Request::SyncRead { .. } | Request::SyncWrite { .. });
            match Feetech::default().encode_request(&request, &mut again) {
                Ok(_) => prop_assert_eq!(&again[..n], &out[..n]),
                Err(_) => prop_assert!(is_to_several),
            }
        }
    }
}
