//! Logs of CAN buses, in every format.

mod properties;

use armwire::ling::{JointState, Ling, MAX_FRAME, MotionStatus, Request, Response};
use armwire::messages::Messages;
use armwire_bridge::Instant;
use armwire_bridge::can::{Frame, Function, Node};
use armwire_bridge::isotp::{Config, Endpoint, Link};

use crate::ArmKind;
use crate::decode::format::Format;
use crate::decode::tests::printed;

const NODE: Node = Node::MAX;

/// Lines of `candump -L`, each 1 ms after the one before.
fn log(lines: &mut Vec<String>, frame: &Frame) {
    let data: String = frame.data().iter().map(|byte| format!("{byte:02X}")).collect();
    let (hash, millis) = (if frame.is_fd() { "##1" } else { "#" }, lines.len());
    lines.push(format!(
        "(1609459200.{millis:03}000) can0 {:03X}{hash}{data}",
        frame.id().get()
    ));
}

/// The frames of a PDU on the bus, flow control included.
fn carry(lines: &mut Vec<String>, link: Link, function: Function, back: Function, pdu: &[u8]) {
    let end = |function: Function| Endpoint::<300, 300>::new(Config::new(link, function.id(NODE)));
    let (mut sender, mut receiver) = (end(function), end(back));
    sender.send(pdu).unwrap();
    while receiver.received().is_none() {
        let frame = sender.transmit(Instant::ZERO).unwrap();
        log(lines, &frame);
        let _ = receiver.receive(frame.data(), Instant::ZERO);
        if let Some(frame) = receiver.transmit(Instant::ZERO) {
            log(lines, &frame);
            let _ = sender.receive(frame.data(), Instant::ZERO);
        }
    }
    assert_eq!(receiver.received(), Some(pdu));
}

/// A request for the joints of a Ling arm with its answer, and a request to the adapter.
fn exchange(link: Link) -> Vec<String> {
    use Function::{ArmAnswer, ArmRequest, ControlAnswer, ControlRequest};
    let mut lines = Vec::new();
    let mut bytes = [0; MAX_FRAME];
    let n = Ling.encode_request(&Request::ReadJoints, &mut bytes).unwrap();
    carry(&mut lines, link, ArmRequest, ArmAnswer, &bytes[..n]);
    let state = JointState {
        joints: [2048; 6],
        gripper: 500,
        status: MotionStatus::Locked,
    };
    let n = Ling
        .encode_response(&Response::Joints(state), None, &mut bytes)
        .unwrap();
    carry(&mut lines, link, ArmAnswer, ArmRequest, &bytes[..n]);
    carry(&mut lines, link, ControlRequest, ControlAnswer, &[7, 2]);
    lines
}

/// The entries of a log.
fn decoded(log: &[u8], format: Option<Format>, arm: ArmKind) -> Vec<String> {
    let (lines, error) = printed(log, format, arm, None);
    assert_eq!(error, None);
    lines
}

/// The sum of a log.
fn output(log: &[u8], format: Option<Format>, arm: ArmKind) -> Vec<String> {
    let meaning = |line: &String| match line.split_once('\n') {
        Some((_, meaning)) => meaning.trim_start().to_owned(),
        None => line.clone(),
    };
    decoded(log, format, arm).iter().map(meaning).collect()
}

/// The entries of lines of candump.
fn meanings(log: &[String], arm: ArmKind) -> Vec<String> {
    output((log.join("\n") + "\n").as_bytes(), Some(Format::Candump), arm)
}

const REQUEST: &str = "to the arm: read joints";
const ANSWER: &str =
    "from the arm: joints: +0.00° +0.00° +0.00° +0.00° +0.00° +0.00°, gripper: 50.0 % open, status: locked";
const READ_JOINTS: [u8; 7] = [0xAA, 6, 0, 1, 0xFE, 0x9A, 0xFF];
/// A frame that shows an adapter.
const ADAPTER: &str = "60F#07AA060001FE9AFF";
const CONTROL: &str = "to the adapter: FromHost { sequence: 7, request: GetConfig }";

#[test]
fn multi_frame_pdus_are_reassembled() {
    let classic = exchange(Link::Classic);
    let sum = format!(
        "CAN frames: {}, PDUs: 3, lost: 0, cyclic frames: 0, frames of others: 0",
        classic.len()
    );
    assert!(classic.len() > 5);
    assert_eq!(meanings(&classic, ArmKind::Ling), [REQUEST, ANSWER, CONTROL, &sum]);
    let sum = "CAN frames: 3, PDUs: 3, lost: 0, cyclic frames: 0, frames of others: 0";
    assert_eq!(
        meanings(&exchange(Link::Fd), ArmKind::Ling),
        [REQUEST, ANSWER, CONTROL, sum]
    );
}

#[test]
fn pdu_has_its_last_frames_time() {
    let lines = decoded(exchange(Link::Classic).join("\n").as_bytes(), None, ArmKind::Ling);
    assert!(
        lines[0].starts_with("1609459200.000000  can0  node 15  AA 06 00 01 FE 9A FF\n"),
        "{}",
        lines[0]
    );
}

#[test]
fn missing_frame_costs_and_reports_its_pdu() {
    let mut log = exchange(Link::Classic);
    let second = log.iter().position(|line| line.contains(" 61F#21")).unwrap();
    log.remove(second);
    let output = meanings(&log, ArmKind::Ling);
    assert_eq!(output[1], "receiving: expected consecutive frame 1, got 2");
    assert_eq!(output[output.len() - 3], CONTROL);
    assert!(output.last().unwrap().contains("PDUs: 2, lost: "), "{output:?}");
}

#[test]
fn other_bus_frames_are_counted() {
    let log = [
        "(1.000000) can0 20F#0008000800080000",
        "(1.000001) can0 7DF#02010C",
        "(1.000002) can0 1ABCDE00#11 R",
        "(1.000003) can0 60F#R7",
    ];
    let log = log.map(str::to_owned);
    let sum = "CAN frames: 4, PDUs: 0, cyclic frames: 1, frames of others: 3";
    assert_eq!(meanings(&log, ArmKind::Ling), [sum]);
}

#[test]
fn pdu_without_an_arm_frame_is_reported() {
    let output = meanings(&exchange(Link::Fd), ArmKind::Alpha1);
    assert!(output[0].starts_with("no frame of an Alpha1: "), "{output:?}");
    assert_eq!(
        output[output.len() - 2..],
        [
            "CAN frames: 3, PDUs: 3, lost: 0, cyclic frames: 0, frames of others: 0, PDUs without a frame: 2",
            "These are frames of a Ling arm: --arm ling"
        ]
    );
    let surplus = [
        format!("(1.000000) can0 {ADAPTER}"),
        "(1.000000) can0 60F##10008AA060001FE9AFF00CCCC".to_owned(),
    ];
    assert_eq!(
        meanings(&surplus, ArmKind::Ling)[1],
        "not one whole frame of a Ling arm"
    );
}

#[test]
fn bad_candump_line_names_its_reason() {
    for (line, reason) in [
        ("(1.000000) can0", "no identifier"),
        ("(1.000000) can0 603", "no length in brackets"),
        ("(1.0.0) can0 603#00", "'1.0.0' is no time"),
        ("(1.000000) can0 603#0", "'0' is not bytes in hexadecimal"),
        ("(1.000000) can0 6031#00", "'6031' is no identifier of 3 or 8 digits"),
        ("(1.000000) can0 803#00", "identifier 803 is out of range (0 to 7FF)"),
        (
            "(1.000000) can0 603#000000000000000000",
            "9 bytes, an FD frame has 0..=8, 12, 16, 20, 24, 32, 48 or 64",
        ),
        (
            "(1.000000) can0 603##1000000000000000000",
            "9 bytes, an FD frame has 0..=8, 12, 16, 20, 24, 32, 48 or 64",
        ),
        ("can0  603   [2]  00", "2 bytes of data were announced, 1 are there"),
        ("can0  603   [1]  1000", "'1000' is no byte"),
    ] {
        assert_eq!(
            error_of(&format!("(1.000000) can0 603#300000\n\n{line}\n"), Format::Candump),
            error_at(3, line, reason)
        );
    }
}

fn error_at(number: usize, line: &str, reason: &str) -> String {
    format!("not understood: line {number}: '{line}': {reason}")
}

/// The first remark about what is not understood.
fn error_of(log: &str, format: Format) -> String {
    // The last line of a log that is cut has another reason.
    let log = format!("{log}\n");
    let lines = decoded(log.as_bytes(), Some(format), ArmKind::Ling);
    let remark = lines.into_iter().find(|line| line.starts_with("not understood: "));
    remark.expect("a remark")
}

const OTHER: &str = "CAN frames: 1, PDUs: 0, cyclic frames: 0, frames of others: 1";

/// The places of the entries of a log in this format, which all have the same request, and the sum.
fn places(log: &str, format: Format) -> Vec<String> {
    let lines = decoded(log.as_bytes(), None, ArmKind::Ling);
    assert_eq!(decoded(log.as_bytes(), Some(format), ArmKind::Ling), lines, "{log}");
    let (sum, entries) = lines.split_last().unwrap();
    let places = entries.iter().map(|entry| {
        let (place, meaning) = entry.split_once("  AA 06 00 01 FE 9A FF\n").expect(entry);
        assert_eq!(meaning.trim_start(), REQUEST);
        place.to_owned()
    });
    let mut places: Vec<_> = places.collect();
    places.push(sum.clone());
    places
}

#[test]
fn candump_is_read_in_all_its_forms() {
    for (line, place) in [
        ("(1.5) can0 60F#07AA060001FE9AFF", "1.5  can0"),
        ("(1.500000000) can0 60F#07AA060001FE9AFF T", "1.500000000  can0"),
        ("cansend can0 60F#07AA060001FE9AFF", "can0"),
        ("(1.500000) can0 60F#07.AA.06.00.01.FE.9A.FF", "1.500000  can0"),
        ("(1.500000) can0 60F##107AA060001FE9AFF R", "1.500000  can0"),
        ("  can0  60F   [8]  07 AA 06 00 01 FE 9A FF", "can0"),
        ("  can0  60F   [8]  07 AA 06 00 01 FE 9A FF   '........'", "can0"),
        ("  can0  60F  [08]  07 AA 06 00 01 FE 9A FF", "can0"),
        ("  can0  60F   {F}  07 AA 06 00 01 FE 9A FF", "can0"),
        ("  can0  60F   {8}  FF`9A`FE`01`00`06`AA`07", "can0"),
        (
            "  can0  60F   [8]  00000111 10101010 00000110 00000000 00000001 11111110 10011010 11111111",
            "can0",
        ),
        (
            " (2021-02-28 23:59:59.500000)  can0  60F   [8]  07 AA 06 00 01 FE 9A FF",
            "2021-02-28 23:59:59.500000  can0",
        ),
        (
            " (000.000000)  can0  RX - -  60F   [8]  07 AA 06 00 01 FE 9A FF",
            "000.000000  can0",
        ),
    ] {
        let sum = "CAN frames: 1, PDUs: 1, lost: 0, cyclic frames: 0, frames of others: 0";
        assert_eq!(
            places(line, Format::Candump),
            [&format!("{place}  node 15"), sum],
            "{line}"
        );
    }
    for other in [
        "can0  1ABCDE00   [1]  11",
        "can0  60F   [7]  remote request",
        "can0  20000088   [8]  00 00 19 00 00 00 00 00   ERRORFRAME\n\tlost-arbitration{at bit 7}",
    ] {
        assert_eq!(places(other, Format::Candump), [OTHER], "{other}");
    }
}

#[test]
fn log_of_candump_may_begin_with_a_damaged_line() {
    let log = "(1.000000) can0 61\n(1.0) can0 60F#07AA060001FE9AFF\n";
    let lines = decoded(log.as_bytes(), None, ArmKind::Ling);
    assert!(lines[0].starts_with("not understood: line 1: "), "{lines:?}");
    assert!(
        lines[1].starts_with("1.0  can0  node 15  AA 06 00 01 FE 9A FF\n"),
        "{lines:?}"
    );
}

#[test]
fn events_of_candump_are_no_frames() {
    let log = "DROPCOUNT: dropped 3 CAN frames on 'can0' socket (total drops 3)\n\
               (1.000000) can0 242###8100000000AABBCC\n\
               \x20 can0  242   [0003] (00|81:00:00000000)  AA BB CC\n\
               DROPCOUNT: dropped 1 CAN frame on 'can0' socket (total drops 4)\n";
    assert_eq!(
        decoded(log.as_bytes(), Some(Format::Candump), ArmKind::Ling),
        ["CAN frames: 0, PDUs: 0, cyclic frames: 0, frames of others: 0, CAN XL frames: 2, not logged: 4"]
    );
}

#[test]
fn zeros_of_a_power_loss_cost_no_record() {
    let log = [
        b"(1.0) can0 60F#07AA060001FE9AFF\n",
        &[0; 70][..],
        b"(2.0) can0 60F#07AA060001FE9AFF\n",
        &[0; 9],
    ];
    let lines = decoded(&log.concat(), None, ArmKind::Ling);
    assert!(
        lines[1].starts_with("not understood: line 2: ") && lines[1].ends_with(": NUL bytes"),
        "{lines:?}"
    );
    assert_eq!(
        lines[3],
        "CAN frames: 2, PDUs: 2, lost: 0, cyclic frames: 0, frames of others: 0, not understood: 2 (NUL bytes: 2)"
    );
}

#[test]
fn other_devices_with_the_identifiers_lose_no_pdu() {
    // CANopen: requests of SDO and their answers, at a node without an adapter.
    let mut log: Vec<_> = (0..50)
        .map(|i| format!("(1.{i:03}) can0 60{:X}#2{:X}00180100000000", i % 4, i % 16))
        .collect();
    let none = "can0  node 0: frames with identifiers of an adapter, but not its content: 13";
    assert_eq!(meanings(&log, ArmKind::Ling)[0], none);
    let lines = meanings(&log, ArmKind::Ling);
    assert_eq!(
        lines[4],
        "CAN frames: 50, PDUs: 0, cyclic frames: 0, frames of others: 50"
    );

    // An adapter at one of the nodes says for how much of it it stands.
    log.push(format!("(2.0) can0 {}", ADAPTER.replace("60F", "602")));
    log.push("(2.1) can0 602#2100000000000000".to_owned());
    let lines = meanings(&log, ArmKind::Ling);
    assert_eq!(lines[0], "2.0  can0  node 2: an adapter, PDUs lost before: 4");
    assert!(
        lines.contains(&"can0  node 2: an adapter, known by frames of a Ling arm".to_owned()),
        "{lines:?}"
    );
    assert!(lines.last().unwrap().contains(", lost: "), "{lines:?}");
}

#[test]
fn buses_of_one_log_are_kept_apart() {
    let [first, second] = ["10082A0000000000", "2100000000000000"];
    let log = format!(
        "(0.0) can0 {ADAPTER}\n(0.1) can1 {ADAPTER}\n\
         (1.0) can0 61F#{first}\n(1.1) can1 61F#{first}\n(1.2) can0 61F#{second}\n(1.3) can1 61F#{second}\n"
    );
    let lines = decoded(log.as_bytes(), None, ArmKind::Ling);
    assert!(lines[2].starts_with("1.2  can0  node 15  2A ") && lines[3].starts_with("1.3  can1  node 15  2A "));
    assert_eq!(
        lines[4],
        "CAN frames: 6, PDUs: 4, lost: 0, cyclic frames: 0, frames of others: 0, PDUs without a frame: 2"
    );
    let many: Vec<_> = (0..=32).map(|bus| format!("(1.0) can{bus} 61F#07")).collect();
    assert_eq!(
        error_of(&many.join("\n"), Format::Candump),
        error_at(33, "(1.0) can32 61F#07", "more than 32 buses")
    );
}

#[test]
fn gap_across_a_month_is_short() {
    let log = "(2024-02-28 23:59:59.800000)  can0  60F   [8]  07 AA 06 00 01 FE 9A FF\n\
               (2024-02-28 23:59:59.900000)  can0  61F   [8]  10 08 2A 00 00 00 00 00\n\
               (2024-02-29 00:00:00.100000)  can0  61F   [8]  21 00 00 00 00 00 00 00\n\
               (2024-02-29 23:59:59.900000)  can0  61F   [8]  10 08 2A 00 00 00 00 00\n\
               (2024-03-01 00:00:00.100000)  can0  61F   [8]  21 00 00 00 00 00 00 00\n\
               (2024-12-31 23:59:59.900000)  can0  61F   [8]  10 08 2A 00 00 00 00 00\n\
               (2025-01-01 00:00:00.100000)  can0  61F   [8]  21 00 00 00 00 00 00 00\n";
    let lines = decoded(log.as_bytes(), None, ArmKind::Ling);
    assert!(lines.last().unwrap().contains("PDUs: 4, lost: 0,"), "{lines:?}");
}

#[test]
fn asc_logs_are_read_in_either_base() {
    let log = "date Mit Mär 3 10:00:00.000 am 2021
base dec  timestamps relative
no internal events logged
// version 8.0.0
Begin Triggerblock Mit Mär 3 10:00:00.000 am 2021
   0.500000 1  1551            Rx   d 8 7 170 6 0 1 254 154 255  Length = 236000 BitCount = 124 ID = 1551
   0.250000 CANFD   2 Tx        1551  Read_joints  1 0 8  8 7 170 6 0 1 254 154 255  100000  120 303000 0 0 0 0 0
   0.250000 CANFD   2 TxRq      1551  1 0 8  8 7 170 6 0 1 254 154 255  100000  120 303000 0 0 0 0 0
   0.100000 1  Statistic: D 1 R 0 XD 0 XR 0 E 0 O 0 B 1.5%
   0.100000 2  ErrorFrame
   0.100000 1  305419896x      Rx   d 0
   0.100000 SV: 3 0 1 ::Sys::Var = 1
End TriggerBlock
";
    assert_eq!(
        places(log, Format::Asc),
        [
            "0.500000  bus 1  node 15",
            "0.250000  bus 2  node 15",
            "CAN frames: 4, PDUs: 2, lost: 0, cyclic frames: 0, frames of others: 2, other events: 3"
        ]
    );
    for (line, reason) in [
        ("0.1 1 60F Rx d 8 07", "8 bytes of data were announced, 1 are there"),
        ("0.1 1 60G Rx d 8 07", "'60G' is no identifier"),
        ("0.1 1 60F Rx q 8 07", "neither data (d) nor a remote frame (r)"),
        (
            "0.1 CANFD 1 Rx 60F 0 0 9 12 07",
            "12 bytes of data were announced, 1 are there",
        ),
        ("0.1 1 60F Qx d 8 07", "neither received (Rx) nor sent (Tx)"),
        ("0.1 x1 60F Rx d 8 07", "no known event"),
        ("no 0.1 1 60F Rx d 8 07", "no time"),
        ("begin 0.1 1 60F Rx d 8 07", "no time"),
        ("what", "no time"),
        ("base oct", "the base is neither hex nor dec"),
    ] {
        assert_eq!(
            error_of(&format!("base hex\n{line}\n"), Format::Asc),
            error_at(2, line, reason)
        );
    }
}

#[test]
fn candump_behind_its_command_is_read() {
    for line in [
        "(1.5) can0 60F#07AA060001FE9AFF",
        " can0  60F   [8]  07 AA 06 00 01 FE 9A FF",
    ] {
        let (lines, error) = printed(
            format!("$ candump can0\n{line}\n").as_bytes(),
            None,
            ArmKind::Ling,
            None,
        );
        assert_eq!(error, None);
        let sum = lines.last().unwrap();
        assert!(sum.starts_with("CAN frames: 1, PDUs: 1, "), "{lines:?}");
        assert!(sum.contains(", not understood: 1 ("), "{lines:?}");
    }
}

#[test]
fn asc_events_of_the_specification_are_no_frames() {
    let events = ";  time  can ident  attr dlc data
   0.0 Start der Messung
   0.1 log trigger event
   0.1 log direct start (0ms)
   0.1 CAN 1 Status:chip status error active - TxErr: 8 RxErr: 0
   0.1 CANFD 1 Status:chip status warning level
   0.1 CANFD 1 Statistic: D 1 R 0 XD 0 XR 0 E 0 O 0 B 1.5%
   0.1 1 OverloadFrame
   0.1 EnvSpeed := 12
   0.1 SV: 2 0 1 ::Engine::Speed = 7.5
   0.1 LIN 1 Motor::Status::Speed = 3
   0.1 GPS device: 1 La:48.8 Lo: 9.1 Alt: 300 Sp: 0 Co: 0
   0.1 Comment: 0 begin
   0.1 0 ffffff 0 GMGroup: Faults GMMarker: First GMDescription: none
   0.1 TFS: [00000003,00000000] Failed: Test module
   0.1 Li 3C Rx 2 01 02
";
    let count = events.lines().count() - 1;
    let (lines, error) = printed(format!("base hex\n{events}").as_bytes(), None, ArmKind::Ling, None);
    assert_eq!(error, None);
    assert_eq!(
        *lines.last().unwrap(),
        format!("CAN frames: 0, PDUs: 0, cyclic frames: 0, frames of others: 0, other events: {count}"),
        "{lines:?}"
    );
}

#[test]
fn trc_is_read_in_every_version() {
    let sum = "CAN frames: 3, PDUs: 1, lost: 0, cyclic frames: 0, frames of others: 2, other events: 2";
    for (log, place) in [
        (
            ";##########
     1)      1841 060F 8 07 AA 06 00 01 FE 9A FF
     2)      1842 0008 4 ERROR 00 19 08 08
     3)      1843 FFFFFFFF 4 00 00 00 04 BUSLIGHT
     4)      1844 0100 3 RTR
     5)      1845 12345678 0
",
            "1841 ms",
        ),
        (
            ";$FILEVERSION=1.1
     1)      1841.5  Rx         060F  8  07 AA 06 00 01 FE 9A FF
     2)      1842.5  Warng  FFFFFFFF  4  00 00 00 08  BUSHEAVY
     3)      1843.5  Error      0008  4  00 19 08 08
     4)      1844.5  Tx         0100  3  RTR
     5)      1845.5  Rx     12345678  0
",
            "1841.5 ms",
        ),
        (
            ";$FILEVERSION=1.3
     1)      1841.5 1  Rx         060F -  8    07 AA 06 00 01 FE 9A FF
     2)      1842.5 1  Warng  FFFFFFFF -  4    00 00 00 08  BUSHEAVY
     3)      1843.5 1  Error      0008 -  4    00 19 08 08
     4)      1844.5 2  Tx         0100 -  3    RTR
     5)      1845.5 2  Rx     12345678 -  0
",
            "1841.5 ms  bus 1",
        ),
        (
            ";$FILEVERSION=2.0
;$COLUMNS=N,O,T,I,d,l,D
      1      1841.500 FB     060F Rx  8  07 AA 06 00 01 FE 9A FF
      2      1842.500 ST          Rx     00 00 00 08
      3      1843.500 EC          Rx     00 19
      4      1844.500 RR     0100 Rx  3
      5      1845.500 DT 12345678 Rx  0
",
            "1841.500 ms",
        ),
    ] {
        assert_eq!(places(log, Format::Trc), [&format!("{place}  node 15"), sum], "{log}");
    }
    for (log, number, line, reason) in [
        (
            ";$FILEVERSION=3.0",
            1,
            ";$FILEVERSION=3.0",
            "unsupported version: expected 1.0 to 1.3, 2.0 or 2.1",
        ),
        (";$COLUMNS=N,Oh", 1, ";$COLUMNS=N,Oh", "a column is not one letter"),
        (
            ";$FILEVERSION=2.0\n1 1.0 DT 060F",
            2,
            "1 1.0 DT 060F",
            "no $COLUMNS before the first message",
        ),
        (
            ";$FILEVERSION=2.0\n;$COLUMNS=N,O,T,I,d,l,D\n1 1.0 DT 060F Rx 8 07",
            3,
            "1 1.0 DT 060F Rx 8 07",
            "8 bytes of data were announced, 1 are there",
        ),
        (";##\n1 1.0 060F 0", 2, "1 1.0 060F 0", "no number with a parenthesis"),
    ] {
        assert_eq!(error_of(log, Format::Trc), error_at(number, line, reason));
    }
}

#[test]
fn csv_of_python_can_is_read() {
    let log = "timestamp,arbitration_id,extended,remote,error,dlc,data\r\n\
               1e-05,0x60f,0,0,0,8,B6oGAAH+mv8=\r\n\
               0.5,0x0,0,0,1,0,\r\n";
    assert_eq!(
        places(log, Format::Csv),
        [
            "1e-05  node 15",
            "CAN frames: 2, PDUs: 1, lost: 0, cyclic frames: 0, frames of others: 1"
        ]
    );
    for (line, reason) in [
        ("0.5,0x60f,0,0,0,8,B6oG", "8 bytes of data were announced, 3 are there"),
        ("0.5,0x60f,0,0,0,3,B6o", "data in base64: Invalid padding"),
        ("0.5,0x60f,2,0,0,0,", "'2' is neither 0 nor 1"),
        ("inf,0x60f,0,0,0,0,", "'inf' is no time"),
        ("0.5,0x60f,0,0,0", "no dlc"),
    ] {
        assert_eq!(error_of(line, Format::Csv), error_at(1, line, reason));
    }
}

#[test]
fn gvret_csv_is_read_with_or_without_direction() {
    let sum = "CAN frames: 1, PDUs: 1, lost: 0, cyclic frames: 0, frames of others: 0";
    for log in [
        "Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8\n\
         166064000,0000060F,false,Rx,0,8,07,AA,06,00,01,FE,9A,FF,",
        "Time Stamp,ID,Extended,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8\n\
         166064000,0000060F,false,0,8,07,AA,06,00,01,FE,9A,FF,",
    ] {
        assert_eq!(places(log, Format::Gvret), ["166064000 µs  bus 0  node 15", sum]);
    }
    // SavvyCAN writes 8 bytes of each frame.
    let short = "1,123,false,Tx,0,12,00,01,02,03,04,05,06,07,";
    assert_eq!(decoded(short.as_bytes(), Some(Format::Gvret), ArmKind::Ling), [OTHER]);
    for (line, reason) in [
        (
            "1,60F,false,Tx,0,12,00,01,02,03,04,05,06,07,",
            "12 bytes of data were announced, 8 are there",
        ),
        ("1,60F,false,Rx,0,65", "'65' is no length from 0 to 64"),
        ("1,60F,maybe,Rx,0,0", "'maybe' is neither true nor false"),
        ("1,60F,false,Rx,0,2,00", "2 bytes of data were announced, 1 are there"),
    ] {
        assert_eq!(error_of(line, Format::Gvret), error_at(1, line, reason));
    }
}

/// Logs of python-can with the same frames: an exchange, the same exchange with FD frames, and frames of others.
const FIXTURES: [(&str, &[u8]); 7] = [
    ("log", include_bytes!("../../../tests/logs/python-can.log")),
    ("asc", include_bytes!("../../../tests/logs/python-can.asc")),
    ("blf", include_bytes!("../../../tests/logs/python-can.blf")),
    ("blf", include_bytes!("../../../tests/logs/python-can-uncompressed.blf")),
    ("trc", include_bytes!("../../../tests/logs/python-can-1.0.trc")),
    ("trc", include_bytes!("../../../tests/logs/python-can-2.1.trc")),
    ("csv", include_bytes!("../../../tests/logs/python-can.csv")),
];

#[test]
fn python_can_logs_are_distinguished_and_read() {
    for (kind, log) in FIXTURES {
        let lines = output(log, None, ArmKind::Ling);
        // Traces of python-can have no FD frames, and its CSV has no short ones.
        let expected = match kind {
            "trc" => vec![REQUEST, ANSWER],
            "csv" => vec![REQUEST, ANSWER, ANSWER],
            _ => vec![REQUEST, ANSWER, REQUEST, ANSWER],
        };
        assert_eq!(lines[..lines.len() - 1], expected, "{kind}");
        assert!(lines.last().unwrap().contains("lost: 0, cyclic frames: 1"), "{lines:?}");
    }
}

/// The shortest header of a BLF file.
const BLF: [u8; 8] = *b"LOGG\x08\0\0\0";

/// An object with a header of the first version, at 1.5 s.
fn object(kind: u32, data: &[u8]) -> Vec<u8> {
    let mut object = b"LOBJ\x20\0\x01\0".to_vec();
    object.extend(u32::try_from(32 + data.len()).unwrap().to_le_bytes());
    object.extend(kind.to_le_bytes());
    object.extend(2_u32.to_le_bytes());
    object.extend([0; 4]);
    object.extend(1_500_000_000_u64.to_le_bytes());
    object.extend(data);
    object
}

/// The data of the object of a classic frame on bus 3.
fn classic(flags: u8) -> Vec<u8> {
    [
        &[3, 0, flags, 8, 0x0F, 0x06, 0, 0][..],
        &[7, 0xAA, 6, 0, 1, 0xFE, 0x9A, 0xFF],
    ]
    .concat()
}

/// A container of these bytes without compression, and with this size in its header.
fn container(size: u32, data: &[u8]) -> Vec<u8> {
    let mut container = b"LOBJ\x10\0\x01\0".to_vec();
    container.extend(size.to_le_bytes());
    container.extend(10_u32.to_le_bytes());
    container.extend([0; 16]);
    container.extend(data);
    container
}

fn whole_container(data: &[u8]) -> Vec<u8> {
    container(32 + u32::try_from(data.len()).unwrap(), data)
}

#[test]
fn blf_objects_are_read_across_containers() {
    let frame = object(86, &classic(0));
    let (front, back) = frame.split_at(41);
    let long = object(65, &[0x4C; 70_001]);
    let log = [
        &BLF[..],
        &object(1, &classic(1)),
        &object(1, &classic(0x80)),
        &object(1, &classic(2)),
        &object(2, &[3, 0, 0, 0]),
        &long,
        &[0; 3],
        &whole_container(front),
        &[0; 1],
        &whole_container(&[back, &long].concat()),
    ];
    let lines = decoded(&log.concat(), None, ArmKind::Ling);
    for line in &lines[..2] {
        assert!(
            line.starts_with("1.500000000  bus 3  node 15  AA 06 00 01 FE 9A FF\n"),
            "{lines:?}"
        );
    }
    assert_eq!(
        lines[2],
        "CAN frames: 4, PDUs: 2, lost: 0, cyclic frames: 0, frames of others: 2, other events: 3"
    );
}

#[test]
fn short_fd_object_of_blf_ends_in_zeros() {
    let data = [
        &[3, 0, 0, 9, 0x0F, 0x06, 0, 0][..],
        &[0; 5],
        &[1, 12, 0, 0, 0, 0, 0],
        &[0, 7],
        &READ_JOINTS,
    ]
    .concat();
    let lines = decoded(&[&BLF[..], &object(100, &data)].concat(), None, ArmKind::Ling);
    assert!(
        lines[0].starts_with("1.500000000  bus 3  node 15  AA 06 00 01 FE 9A FF\n"),
        "{lines:?}"
    );
}

#[test]
fn asc_of_fd_frames_without_their_flag_is_read() {
    let data = "00 07 AA 06 00 01 FE 9A FF 00 00 00";
    for line in [
        &format!("0.5 CANFD 1 Rx 60F  0 0 9 12 {data} 64 1331984 11 0 46500250 460a0250"),
        &format!("0.5 1  60F  Rx  d 12 {data} Length = 0"),
        &format!("0.5 1  60F  Rx  d 9 {data} Length = 0"),
        "0.5 1  60F  Rx  d 16 07 AA 06 00 01 FE 9A FF",
    ] {
        let lines = decoded(line.as_bytes(), Some(Format::Asc), ArmKind::Ling);
        assert!(
            lines[0].starts_with("0.5  bus 1  node 15  AA 06 00 01 FE 9A FF\n"),
            "{line}: {lines:?}"
        );
    }
}

#[test]
fn blf_errors_name_their_offset() {
    let sized = |size: u32| {
        let mut object = object(86, &classic(0));
        object[8..12].copy_from_slice(&size.to_le_bytes());
        object
    };
    let mut zlib = whole_container(b"junk");
    zlib[16] = 2;
    let mut unknown = whole_container(b"");
    unknown[16] = 1;
    let mut wrong = object(86, &classic(0));
    wrong[36..38].copy_from_slice(&[0x08, 0x08]);
    for (rest, output) in [
        (&b"LOBS0123456789ab"[..], "byte 8: no object starts here"),
        (&[0; 9], "byte 8: no object starts here"),
        (b"LOBJ", "byte 8: the log ends inside this record"),
        (&sized(15), "byte 8: an object that is shorter than its header"),
        (&sized(40), "byte 8: a CAN frame that is longer than its object"),
        (&sized(4_000_000_000), "byte 8: an object of 4000000000 bytes"),
        (&container(31, b""), "byte 8: a container without room for its header"),
        (&container(100, b""), "byte 8: the log ends inside this record"),
        (
            &container(u32::MAX, &object(65, &[])),
            "byte 8: an object of 4294967295 bytes",
        ),
        (
            &whole_container(&sized(48)[..20]),
            "byte 60: the log ends inside this record",
        ),
        (
            &whole_container(&whole_container(b"")),
            "byte 8: a container in a container",
        ),
        (&unknown, "byte 8: compression method 1, must be 0 or 2"),
        (&zlib, "byte 8: this container cannot be decompressed: "),
        (&wrong, "byte 8: identifier 808 is out of range (0 to 7FF)"),
    ] {
        let (lines, error) = printed(&[&BLF[..], rest].concat(), Some(Format::Blf), ArmKind::Ling, None);
        assert_eq!(error, None);
        assert!(
            lines[0].starts_with(&format!("not understood: {output}")),
            "'{}' is not '{output}'",
            lines[0]
        );
        assert!(lines.last().unwrap().starts_with("CAN frames: 0, "), "{lines:?}");
    }
    let (lines, _) = printed(b"LOGG\xFF\xFF\xFF\xFF", None, ArmKind::Ling, None);
    assert_eq!(lines[0], "not understood: byte 0: no header of a BLF file");
}

#[test]
fn endless_line_is_refused_at_its_start() {
    let long = "x".repeat(100_000);
    for (beginning, format) in [("(1.0) can0 603#", Format::Candump), ("1.0 1 60F Rx d 8 ", Format::Asc)] {
        let error = error_of(&format!("\n{beginning}{long}"), format);
        assert!(
            error.starts_with(&format!("not understood: line 2: '{beginning}x"))
                && error.ends_with("x…': the line is too long"),
            "{error}"
        );
        assert!(error.len() < 250, "{error}");
    }
    let error = error_of(&format!("(1.0) can0 {}", "\u{1b}".repeat(4000)), Format::Candump);
    assert!(error.chars().count() < 2_000 && !error.contains('\u{1b}'), "{error}");
    // Comments have no maximum length.
    let log = format!(";##{long}\n 1) 1 060F 8 07 AA 06 00 01 FE 9A FF\n");
    assert_eq!(places(&log, Format::Trc)[0], "1 ms  node 15");
}

#[test]
fn recording_in_no_known_format_is_refused() {
    for (text, line) in [("\n what is this?\n", 2), ("timestamp;id\n", 1)] {
        let (_, error) = printed(text.as_bytes(), None, ArmKind::Ling, None);
        assert_eq!(
            error.unwrap(),
            format!(
                "log: line {line}: '{}': no format that can be decoded, see --format",
                text.trim()
            )
        );
    }
}

#[test]
fn carriage_return_ends_a_record() {
    let record = "(1.0) can0 600#07AA060001FE9AFF";
    for text in [
        format!("{record}\r{record}\r{record}\r"),
        format!("{record}\n{record}\r{record}\r\n"),
    ] {
        let sum = output(text.as_bytes(), None, ArmKind::Ling).pop().unwrap();
        assert!(sum.starts_with("CAN frames: 3, PDUs: 3, "), "{text:?}: {sum}");
    }
    let row = "1,600,false,Rx,0,8,07,AA,06,00,01,FE,9A,FF,";
    let text = format!("Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8\r\n{row}\r{row}\r\n");
    let sum = output(text.as_bytes(), None, ArmKind::Ling).pop().unwrap();
    assert!(sum.starts_with("CAN frames: 2, PDUs: 2, "), "{sum}");
}

#[test]
fn pdu_that_the_log_ends_in_is_lost() {
    let log = "(1.0) can0 60F#07AA060001FE9AFF\n(1.1) can0 61F#1015AA06000F0008\n";
    let lines = decoded(log.as_bytes(), None, ArmKind::Ling);
    assert!(
        lines.last().unwrap().starts_with("CAN frames: 2, PDUs: 1, lost: 1, "),
        "{lines:?}"
    );
}

#[test]
fn record_without_its_end_is_cut_if_it_may_go_on() {
    for (record, is_cut) in [
        ("(1.2) can0 20F#0102", true),
        ("(1.2) can0 20F##10102030405060708", true),
        ("(1.2) can0 20F#0102030405060708", false),
        ("(1.2) can0 20F [2] 01 02", false),
    ] {
        let log = format!("(1.0) can0 60F#07AA060001FE9AFF\n{record}");
        let lines = decoded(log.as_bytes(), None, ArmKind::Ling);
        let end = "not understood: 1 (ends inside a record: 1)";
        assert_eq!(lines.last().unwrap().ends_with(end), is_cut, "{lines:?}");
    }
}

#[test]
fn details_of_error_frames_are_comments() {
    for (detail, is_comment) in [
        ("\tcontroller-problem{rx-error-warning}", true),
        ("\tbus-error", true),
        ("\tAA 06 00 01", false),
        ("\tbus-errors", false),
    ] {
        let log = format!("(1.0) can0 60F#07AA060001FE9AFF\n{detail}\n");
        let lines = decoded(log.as_bytes(), None, ArmKind::Ling);
        assert_eq!(
            !lines.last().unwrap().contains("not understood: 1"),
            is_comment,
            "{lines:?}"
        );
    }
    let log = "(1.0) can0 60F#07AA060001FE9AFF\n\t(1.0) can0 60F#07AA060001FE9AFF\n";
    let lines = decoded(log.as_bytes(), None, ArmKind::Ling);
    assert!(
        lines.last().unwrap().starts_with("CAN frames: 2, PDUs: 2, "),
        "{lines:?}"
    );
}

#[test]
fn trc_type_that_is_not_known_is_not_understood() {
    for (log, line) in [
        (";$FILEVERSION=1.1", "1) 1.0 rx 060F 8 07 AA 06 00 01 FE 9A FF"),
        (
            ";$FILEVERSION=2.0\n;$COLUMNS=N,O,T,I,d,l,D",
            "1 1.0 XX 060F Rx 8 07 AA 06 00 01 FE 9A FF",
        ),
    ] {
        let lines = decoded(format!("{log}\n{line}\n").as_bytes(), Some(Format::Trc), ArmKind::Ling);
        let sum = lines.last().unwrap();
        assert!(
            sum.ends_with("not understood: 1 (no type of a message: 1)"),
            "{lines:?}"
        );
    }
}
