//! Captures of USB, of networks, and of what `armwire decode --pcapng` writes.

use std::fs;

use armwire::ling::legacy::{Firmware, JointState, Legacy, Response, SERVOS};
use armwire::messages::Messages;
use proptest::collection::vec;
use proptest::prelude::*;

use crate::decode::decode_recording;
use crate::decode::input::Head;
use crate::decode::pcapng::Packets;
use crate::decode::tests::{Nowhere, line, printed};
use crate::{ArmKind, Speaker};

const REQUEST: [u8; 7] = [0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF];
const ANSWER: [u8; 7] = [0xAA, 0x04, 0x0E, 0x01, 0x01, 0x96, 0xFF];

/// A pcap file of packets at 1.5 s, 2.5 s and so on.
fn pcap(link: u32, is_big_endian: bool, packets: &[Vec<u8>]) -> Vec<u8> {
    let word = |word: u32| {
        if is_big_endian {
            word.to_be_bytes()
        } else {
            word.to_le_bytes()
        }
    };
    let version = if is_big_endian { [0, 2, 0, 4] } else { [2, 0, 4, 0] };
    let mut file = [word(0xA1B2_C3D4), version, word(0), word(0), word(65_535), word(link)].concat();
    for (packet, seconds) in packets.iter().zip(1..) {
        let len = word(packet.len() as u32);
        file.extend([word(seconds), word(500_000), len, len].concat());
        file.extend(packet);
    }
    file
}

/// A block of a pcapng file.
fn block(kind: u32, body: &[u8]) -> Vec<u8> {
    let len = (12 + body.len().next_multiple_of(4)) as u32;
    let mut block = [&kind.to_le_bytes()[..], &len.to_le_bytes(), body].concat();
    block.resize(len as usize - 4, 0);
    block.extend(len.to_le_bytes());
    block
}

/// A pcapng file with an interface of each link type, and of each a packet.
fn pcapng(packets: &[(u16, Vec<u8>)]) -> Vec<u8> {
    let mut file = block(
        0x0A0D_0D0A,
        &[&0x1A2B_3C4D_u32.to_le_bytes()[..], &[1, 0, 0, 0], &[0xFF; 8]].concat(),
    );
    for (link, _) in packets {
        file.extend(block(1, &[&link.to_le_bytes()[..], &[0; 6]].concat()));
    }
    for ((_, packet), interface) in packets.iter().zip(0_u32..) {
        let len = packet.len() as u32;
        let words = [interface, 0, 1_500_000, len, len].map(u32::to_le_bytes).concat();
        file.extend(block(6, &[&words[..], packet].concat()));
    }
    file
}

/// A packet of usbmon.
struct Usbmon {
    event: u8,
    kind: u8,
    endpoint: u8,
    device: u8,
    len: u32,
    data: Vec<u8>,
}

impl Usbmon {
    /// A bulk transfer of bytes.
    fn new(event: u8, endpoint: u8, data: &[u8]) -> Self {
        Self {
            event,
            kind: 3,
            endpoint,
            device: 5,
            len: data.len() as u32,
            data: data.to_vec(),
        }
    }

    fn packet(&self, header: usize, is_big_endian: bool) -> Vec<u8> {
        let mut packet = vec![0; header];
        packet[8..12].copy_from_slice(&[self.event, self.kind, self.endpoint, self.device]);
        let (bus, len) = match is_big_endian {
            true => (2_u16.to_be_bytes(), self.len.to_be_bytes()),
            false => (2_u16.to_le_bytes(), self.len.to_le_bytes()),
        };
        packet[12..14].copy_from_slice(&bus);
        packet[32..36].copy_from_slice(&len);
        [packet, self.data.clone()].concat()
    }
}

/// A request and its answer, with what the system captures besides.
fn conversation() -> Vec<Usbmon> {
    let empty = |event, endpoint, len| Usbmon {
        len,
        ..Usbmon::new(event, endpoint, &[])
    };
    let control = Usbmon {
        kind: 2,
        ..Usbmon::new(b'C', 0x80, &[18, 1, 0, 2])
    };
    let mouse = |event, data: &[u8]| Usbmon {
        kind: 1,
        device: 9,
        ..Usbmon::new(event, 0x81, data)
    };
    vec![
        control,
        mouse(b'C', &[0xAA, 1, 2, 3]),
        // The buffer of the answer, and the completion of the request.
        empty(b'S', 0x81, 512),
        Usbmon::new(b'S', 0x02, &REQUEST[..3]),
        Usbmon::new(b'S', 0x02, &REQUEST[3..]),
        empty(b'C', 0x02, 4),
        Usbmon::new(b'C', 0x81, &ANSWER),
        mouse(b'C', &[0xAA, 1, 2, 4]),
    ]
}

fn decoded(capture: &[u8]) -> (Vec<String>, Option<String>) {
    printed(capture, None, ArmKind::Ling, None)
}

#[test]
fn usbmon_captures_are_read_by_endpoint() {
    for (link, header, is_big_endian) in [(189, 48, false), (220, 64, false), (220, 64, true)] {
        let packets: Vec<_> = conversation()
            .iter()
            .map(|packet| packet.packet(header, is_big_endian))
            .collect();
        let (lines, error) = decoded(&pcap(link, is_big_endian, &packets));
        assert_eq!(error, None);
        assert_eq!(
            lines,
            [
                "5.500000000  2.5.2 out  AA 06 00 01 FE 9A FF\n          to the arm: read joints",
                "7.500000000  2.5.1 in   AA 04 0E 01 01 96 FF\n          from the arm: stroke: 75 mm",
                "bytes: 14, frames: 2, noise bytes: 0, bytes of other devices: 8, USB control transfers: 1, USB packets without \
                 data: 2",
            ]
        );
        if !is_big_endian {
            let packets = packets
                .into_iter()
                .map(|packet| (link as u16, packet))
                .collect::<Vec<_>>();
            let (lines, error) = decoded(&pcapng(&packets));
            assert_eq!((lines.len(), error), (3, None));
        }
    }
}

#[test]
fn devices_are_limited() {
    let request = |device| Usbmon {
        device,
        ..Usbmon::new(b'S', 0x02, &REQUEST)
    };
    let packets: Vec<_> = (0..66).map(|device| request(device).packet(64, false)).collect();
    let (lines, error) = decoded(&pcap(220, false, &packets));
    assert_eq!(error, None);
    assert_eq!(
        lines.last().unwrap(),
        "bytes: 448, frames: 64, noise bytes: 0, not understood: 2 (more than 64 USB devices: 2)"
    );
}

#[test]
fn items_have_the_time_of_their_own_bytes() {
    let transfers = |parts: &[&[u8]]| {
        let packet = |bytes: &&[u8]| Usbmon::new(b'S', 0x02, bytes).packet(64, false);
        decoded(&pcap(220, false, &parts.iter().map(packet).collect::<Vec<_>>())).0
    };
    let lines = transfers(&[&REQUEST, &[0x11, 0x22], &REQUEST]);
    assert!(lines[1].starts_with("2.500000000  2.5.2 out  11 22\n"), "{lines:?}");
    let lines = transfers(&[&[0x11, 0x22], &REQUEST]);
    assert!(lines[0].starts_with("1.500000000  2.5.2 out  11 22\n"), "{lines:?}");
    assert!(lines[1].starts_with("2.500000000  2.5.2 out  AA 06 "), "{lines:?}");
    let answers = [
        Usbmon::new(b'S', 0x02, &REQUEST),
        Usbmon::new(b'C', 0x81, &[0x11, 0x22, 0x33]),
    ];
    let packets = answers.map(|transfer| transfer.packet(64, false));
    let lines = decoded(&pcap(220, false, &packets)).0;
    assert!(lines[1].starts_with("2.500000000  2.5.1 in   11 22 33\n"), "{lines:?}");
}

#[test]
fn break_of_a_stream_is_not_that_of_others() {
    let wrong = [0, 1, 0, 9, 0, 1, 0x0D];
    let request = [0, 1, 0, 2, 0, 1, 0x0D];
    let transfers = |parts: &[(u8, [u8; 7])]| {
        let packets: Vec<_> = parts
            .iter()
            .map(|(device, bytes)| {
                let transfer = Usbmon {
                    device: *device,
                    ..Usbmon::new(b'S', 0x02, bytes)
                };
                transfer.packet(64, false)
            })
            .collect();
        let (mut lines, error) = printed(&pcap(220, false, &packets), None, ArmKind::Xarm, None);
        assert_eq!(error, None);
        lines.pop().unwrap()
    };
    let requests = [(6, request), (6, request)];
    let sum = "bytes: 14, frames: 2, noise bytes: 0, bytes of other devices: 14, broken streams: 1";
    assert_eq!(transfers(&[&[(5, wrong), (5, request)], &requests[..]].concat()), sum);
    let sum = "bytes: 25, frames: 3, noise bytes: 4, bytes behind a break: 10";
    let broken = [(5, request), (5, wrong), (5, request)];
    assert_eq!(transfers(&[&broken, &requests[..]].concat()), sum);
}

#[test]
fn broken_stream_of_usb_has_its_place() {
    let packet = Usbmon::new(b'S', 0x02, &[0, 1, 0, 9, 0, 1, 0x0D]).packet(64, false);
    let (lines, error) = printed(&pcap(220, false, &[packet]), None, ArmKind::Xarm, None);
    assert_eq!(error, None);
    assert_eq!(
        lines,
        [
            "broken stream: USB device 2.5, byte 0: byte 3 is 0x09, expected 0x00 or 0x01 or 0x02 or 0x03",
            "bytes: 0, frames: 0, noise bytes: 0, bytes of other devices: 7, broken streams: 1",
        ]
    );
}

#[test]
fn devices_with_another_arm_are_named() {
    let packet = |device, endpoint, bytes: &[u8]| {
        let event = if endpoint < 0x80 { b'S' } else { b'C' };
        let transfer = Usbmon {
            device,
            ..Usbmon::new(event, endpoint, bytes)
        };
        transfer.packet(64, false)
    };
    let (request, answer) = ([0xF2, 0x2F, 0xAA, 0xED], [0xF2, 0x2F, 0, 0, 0, 0, 0, 0, 0, 0xED]);
    // A device that is no arm has filled the first 4 KiB of the capture.
    let mut packets: Vec<_> = (0..100).map(|_| packet(9, 0x81, &[0x55; 64])).collect();
    packets.extend([packet(5, 0x02, &REQUEST), packet(5, 0x81, &ANSWER)]);
    packets.extend([packet(6, 0x02, &request), packet(6, 0x81, &answer)]);
    let capture = pcap(220, false, &packets);
    let (lines, _) = decoded(&capture);
    assert_eq!(
        lines.last().unwrap(),
        "USB device 2.6 has frames of an Alpha1: --arm alpha1"
    );
    let (lines, _) = printed(&capture, None, ArmKind::Alpha1, None);
    assert_eq!(
        lines.last().unwrap(),
        "USB device 2.5 has frames of a Ling arm: --arm ling"
    );
}

#[test]
fn unknown_blocks_are_not_understood() {
    let request = Usbmon::new(b'S', 0x02, &REQUEST).packet(64, false);
    let file = pcapng(&[(220, request)]);
    for (kind, end) in [
        (2, "not understood: 1 (unknown blocks: 1)"),
        (7, "not understood: 1 (unknown blocks: 1)"),
        (0x0BAD, "other blocks: 1"),
    ] {
        let (lines, error) = decoded(&[&file[..], &block(kind, &[0; 40])].concat());
        assert_eq!(error, None);
        let sum = format!("bytes: 7, frames: 1, noise bytes: 0, {end}");
        assert_eq!(*lines.last().unwrap(), sum, "{kind}");
    }
}

#[test]
fn interfaces_are_limited() {
    let request = Usbmon::new(b'S', 0x02, &REQUEST).packet(64, false);
    let name = [&[2, 0, 0x88, 0x13][..], &[b'x'; 5_000], &[0; 4]].concat();
    let interface = block(1, &[&[220, 0, 0, 0, 0, 0, 0, 0][..], &name].concat());
    let file = [pcapng(&[(220, request)]), interface.repeat(300)].concat();
    let (lines, error) = decoded(&file);
    assert_eq!(error, None);
    let sum = "bytes: 7, frames: 1, noise bytes: 0, not understood: 45 (more than 256 interfaces: 45)";
    assert_eq!(lines.last().unwrap(), sum);
    let measured = allocation_counter::measure(|| {
        let head = Head::new("log".to_owned(), Box::new(&file[..]), &Nowhere);
        decode_recording(head, &Nowhere, None, line(ArmKind::Ling, None)).unwrap();
    });
    assert!(measured.bytes_max < 1024 * 1024, "{} bytes", measured.bytes_max);
}

#[test]
fn usbpcap_capture_is_read() {
    let (lines, error) = decoded(include_bytes!("../../../tests/logs/usbpcap.pcap"));
    assert_eq!(error, None);
    assert!(
        lines[1].starts_with("1783000000.000620000  1.5.1 in   AA 06 00 0F 00 08"),
        "{lines:?}"
    );
    assert_eq!(
        lines.last().unwrap(),
        "bytes: 79, frames: 6, noise bytes: 0, USB packets without data: 6"
    );
}

#[test]
fn cut_transfers_are_not_understood() {
    let cut = Usbmon {
        len: 7,
        ..Usbmon::new(b'S', 0x02, &REQUEST[..3])
    };
    let (lines, _) = decoded(&pcap(220, false, &[cut.packet(64, false), vec![0; 20]]));
    assert_eq!(
        lines.last().unwrap(),
        "packets read: 0, not understood: 2 (cut data: 1, a packet that is shorter than its header: 1)"
    );
}

#[test]
fn captures_of_other_links_are_refused_by_name() {
    let ethernet = vec![0xFF; 60];
    for (link, reason) in [
        (
            1,
            "a capture of a network, such as Ethernet: 'tshark -X lua_script:tools/wireshark/armwire.lua -r FILE'",
        ),
        (113, "a capture of a network, such as Ethernet: "),
        (266, "a capture of USB by macOS"),
        (195, "a capture of link type 195: "),
    ] {
        for capture in [
            pcap(link, false, std::slice::from_ref(&ethernet)),
            pcapng(&[(link as u16, ethernet.clone())]),
        ] {
            let (lines, error) = decoded(&capture);
            assert_eq!(lines, [""; 0]);
            let error = error.unwrap();
            assert!(error.starts_with(&format!("log: {reason}")), "{error}");
        }
    }
}

#[test]
fn links_beside_a_bus_are_counted() {
    let can = [&[0, 0, 0x06, 0x0F, 8, 0, 0, 0][..], &[7], &REQUEST].concat();
    let (lines, error) = decoded(&pcapng(&[(1, vec![0xFF; 60]), (227, can), (195, vec![1])]));
    assert_eq!(error, None);
    assert_eq!(
        lines.last().unwrap(),
        "CAN frames: 1, PDUs: 1, lost: 0, cyclic frames: 0, frames of others: 0, packets of a network: 1, packets of unknown \
         links: 1"
    );
}

#[test]
fn cooked_capture_may_have_a_network_beside_a_bus() {
    let cooked = |protocol: u8, packet: &[u8]| [&[0; 15][..], &[protocol], packet].concat();
    let can = cooked(0x0C, &[&[0, 0, 0x06, 0x0F, 8, 0, 0, 0][..], &[7], &REQUEST].concat());
    let (lines, error) = decoded(&pcap(
        113,
        false,
        &[cooked(8, &[0x45; 20]), can.clone(), cooked(8, &[0x45; 20]), can],
    ));
    assert_eq!(error, None);
    assert!(
        lines.last().unwrap().starts_with("CAN frames: 2, PDUs: 2, "),
        "{lines:?}"
    );
    assert!(
        lines.last().unwrap().ends_with(", packets of a network: 2"),
        "{lines:?}"
    );
}

/// The file that `decode --pcapng` writes for a recording.
fn written(recording: &[u8], arm: ArmKind, from: Option<Speaker>) -> Vec<u8> {
    let path = std::env::temp_dir().join(format!(
        "armwire-written-{}-{:?}",
        std::process::id(),
        std::thread::current().id()
    ));
    let out = Packets::create(&path).unwrap();
    let head = Head::new("log".to_owned(), Box::new(recording), &out);
    let _ = decode_recording(head, &out, None, line(arm, from));
    crate::decode::output::Output::finish(&out).unwrap();
    let file = fs::read(&path).unwrap();
    fs::remove_file(path).unwrap();
    file
}

#[test]
fn written_packets_are_read_back() {
    let log = "(1.5) can0 60F#07AA060001FE9AFF\n(2.5) can0 61F#07AA040E010196FF\n";
    let (lines, error) = decoded(&written(log.as_bytes(), ArmKind::Ling, None));
    assert_eq!(error, None);
    assert_eq!(
        lines,
        [
            "1.500000000  to arm    AA 06 00 01 FE 9A FF\n          to the arm: read joints",
            "2.500000000  from arm  AA 04 0E 01 01 96 FF\n          from the arm: stroke: 75 mm",
            "frames: 2, noise bytes: 0",
        ]
    );
    // The file names the protocol.
    let stop = [0xF2, 0x2F, 0xAA, 0xED];
    let (lines, _) = decoded(&written(&stop, ArmKind::Alpha1, Some(Speaker::Arm)));
    assert_eq!(lines.last().unwrap(), "frames: 1, noise bytes: 0");
}

#[test]
fn times_of_a_text_are_those_of_its_packets() {
    let log = "2024-06-12 12:00:00.250 TX: AA 06 00 01\n2024-06-12 12:00:00.251 TX: FE 9A FF\n\
               2024-06-12 12:00:00.260 RX:\n  AA 04 0E 01 01 96 FF\n";
    let (lines, error) = decoded(&written(log.as_bytes(), ArmKind::Ling, None));
    assert_eq!(error, None);
    for (line, place) in lines
        .iter()
        .zip(["1718193600.251000000  to arm", "1718193600.260000000  from arm"])
    {
        assert!(line.starts_with(place), "{lines:?}");
    }
    let table = "Time [s],Value,Parity Error,Framing Error\n0.5,0xAA,,\n0.6,0x06,,\n0.7,0x00,,\n0.8,0x01,,\n\
                 0.9,0xFE,,\n1.0,0x9A,,\n1.000000001,0xFF,,\n";
    let (lines, _) = decoded(&written(table.as_bytes(), ArmKind::Ling, None));
    assert!(lines[0].starts_with("1.000000001  to arm"), "{lines:?}");
}

#[test]
fn older_generation_is_read_back() {
    let state = JointState {
        firmware: Firmware::V6_0,
        servos: [2048; SERVOS],
    };
    let mut frame = [0; 64];
    let len = Legacy
        .encode_response(&Response::Joints(state), None, &mut frame)
        .unwrap();
    let (lines, error) = decoded(&written(&frame[..len].repeat(3), ArmKind::LingLegacy, None));
    assert_eq!(error, None);
    assert_eq!(lines.last().unwrap(), "frames: 3, noise bytes: 0", "{lines:?}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn frames_between_noise_are_read_back(parts in vec(prop_oneof![
        Just(REQUEST.to_vec()), Just(ANSWER.to_vec()), vec(0..0xAA_u8, 1..9)
    ], 1..20)) {
        let recording = [&REQUEST[..], &parts.concat()].concat();
        let meanings = |lines: Vec<String>| -> Vec<String> {
            let meaning = |line: &String| line.split_once("\n          ").map(|(_, meaning)| meaning.to_owned());
            let meanings = lines.iter().filter_map(meaning);
            meanings.filter(|meaning| meaning.contains(" the arm: ")).collect()
        };
        let (direct, _) = decoded(&recording);
        let (back, error) = decoded(&written(&recording, ArmKind::Ling, None));
        prop_assert_eq!(error, None);
        prop_assert_eq!(meanings(back), meanings(direct));
    }
}
