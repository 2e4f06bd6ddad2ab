extern crate std;

use std::borrow::ToOwned;
use std::format;
use std::string::{String, ToString};
use std::vec;
use std::vec::Vec;

use proptest::prelude::*;

use super::*;

fn ids() -> impl Strategy<Value = Id> {
    prop_oneof![
        (0..=0x7FF_u16).prop_map(Id::Standard),
        (0..=Id::MAX_EXTENDED).prop_map(Id::Extended),
    ]
}

/// Generates every frame that a line can carry.
fn frames() -> impl Strategy<Value = Frame> {
    let classic = (ids(), prop::collection::vec(any::<u8>(), 0..=8));
    let fd = (ids(), any::<bool>(), 0..16_u8, any::<[u8; 64]>());
    prop_oneof![
        classic.prop_map(|(id, data)| Frame::data_frame(id, &data).unwrap()),
        (ids(), 0..=8_u8).prop_map(|(id, dlc)| Frame::remote_frame(id, dlc)),
        fd.prop_map(|(id, bit_rate_switch, dlc, data)| {
            let flags = FdFlags {
                bit_rate_switch,
                error_passive: false,
            };
            Frame::fd(id, flags, dlc, &data)
        }),
    ]
}

fn all_commands() -> impl Strategy<Value = Command> {
    let rate = |digit: usize| Command::BitRate(BitRate::new(BIT_RATES[digit]).unwrap());
    prop_oneof![
        Just(Command::Nothing),
        (0..BIT_RATES.len()).prop_map(rate),
        prop::sample::select(&DATA_BIT_RATES[..])
            .prop_map(|rate| Command::DataBitRate(DataBitRate::new(rate).unwrap())),
        Just(Command::Open),
        Just(Command::Listen),
        Just(Command::Close),
        frames().prop_map(Command::Transmit),
        Just(Command::Status),
        Just(Command::Version),
        Just(Command::SerialNumber),
        any::<bool>().prop_map(Command::TimeStamps),
    ]
}

fn all_replies() -> impl Strategy<Value = Reply> {
    let frame = (frames(), prop::option::of(0..MINUTE));
    prop_oneof![
        Just(Reply::Done),
        Just(Reply::Refused),
        any::<bool>().prop_map(|is_extended| Reply::Sent { is_extended }),
        frame.prop_map(|(frame, millis)| Reply::Frame { frame, millis }),
        any::<u8>().prop_map(|bits| Reply::Status(Status(bits))),
        any::<(u8, u8)>().prop_map(|(hardware, software)| Reply::Version { hardware, software }),
        "[A-Za-z0-9]{4}".prop_map(|text| Reply::SerialNumber(text.as_bytes().try_into().unwrap())),
    ]
}

fn read_commands(bytes: &[u8]) -> Vec<Result<Command, Malformed>> {
    let mut commands = Commands::default();
    bytes.iter().filter_map(|&byte| commands.push(byte)).collect()
}

fn read_replies(bytes: &[u8]) -> Vec<Result<Reply, Malformed>> {
    let mut replies = Replies::default();
    bytes.iter().filter_map(|&byte| replies.push(byte)).collect()
}

proptest! {
    #[test]
    fn commands_round_trip_after_any_line(
        garbage in prop::collection::vec(any::<u8>(), 0..300),
        written in prop::collection::vec(all_commands(), 0..5),
    ) {
        let mut bytes = garbage;
        bytes.push(CR);
        let before = bytes.iter().filter(|&&byte| byte == CR).count();
        for command in &written {
            command.encode(&mut bytes);
        }
        let written: Vec<_> = written.into_iter().map(Ok).collect();
        prop_assert_eq!(&read_commands(&bytes)[before..], written);
    }

    #[test]
    fn replies_round_trip_after_any_line(
        garbage in prop::collection::vec(any::<u8>(), 0..300),
        written in prop::collection::vec(all_replies(), 0..5),
    ) {
        let mut bytes = garbage;
        bytes.push(CR);
        let before = bytes.iter().filter(|byte| [CR, BELL].contains(byte)).count();
        for reply in &written {
            reply.encode(&mut bytes);
        }
        let written: Vec<_> = written.into_iter().map(Ok).collect();
        prop_assert_eq!(&read_replies(&bytes)[before..], written);
    }
}

#[test]
fn malformed_line_reports_its_error() {
    for (line, error) in [
        ("X", "'X': unknown first character"),
        ("t12", "'t': 3 characters, must be 4"),
        ("t1x0", "'t': 'x' at 2 is not a valid digit"),
        ("t1239", "'t': length of a frame is 9, must be 0..=8"),
        ("t123201", "'t': 7 characters, must be 9"),
        ("t123001", "'t': 7 characters, must be 5"),
        ("S9", "'S': bit rate is 9, must be 0..=8"),
        ("Z2", "'Z': time stamps is 2, must be 0..=1"),
        (
            "T200000000",
            "'T': CAN identifier is 0x20000000, must be up to 0x1FFFFFFF",
        ),
        ("r12309", "'r': 6 characters, must be 5"),
        ("b123900", "'b': 7 characters, must be 9"),
        ("b123G", "'b': 'G' at 4 is not a valid digit"),
        ("Y3", "'Y': data bit rate is 3 Mbit/s, must be 1, 2, 4 or 5 Mbit/s"),
        ("\u{7}", "'\\x07': unknown first character"),
    ] {
        let read = read_commands(&[line.as_bytes(), b"\r"].concat());
        let errors: Vec<_> = read.into_iter().map(|read| read.unwrap_err().to_string()).collect();
        assert_eq!(errors, [error], "{line}");
    }
    let error = read_replies(b"t1230EA60\r")[0].unwrap_err();
    assert_eq!(error.to_string(), "'t': time stamp is 60000 ms, must be 0..=59999");
}

#[test]
fn each_kind_of_frame_has_its_line() {
    let twelve = [0x5A; 12];
    let (short, long) = (Id::Standard(0x123), Id::Extended(0x123));
    let fd = |id, bit_rate_switch| Frame::fd_frame(id, &twelve, bit_rate_switch).unwrap();
    let hex = "5A".repeat(12);
    for (frame, line) in [
        (Frame::data_frame(short, &[1, 2]).unwrap(), "t12320102".to_owned()),
        (Frame::data_frame(long, &[1, 2]).unwrap(), "T0000012320102".to_owned()),
        (Frame::remote_frame(short, 8), "r1238".to_owned()),
        (Frame::remote_frame(long, 0), "R000001230".to_owned()),
        (fd(short, false), format!("d1239{hex}")),
        (fd(long, false), format!("D000001239{hex}")),
        (fd(short, true), format!("b1239{hex}")),
        (fd(long, true), format!("B000001239{hex}")),
        (
            Frame::classic(short, false, 15, &[7; 8]),
            format!("t1238{}", "07".repeat(8)),
        ),
    ] {
        let mut written = Vec::new();
        Command::Transmit(frame).encode(&mut written);
        assert_eq!(String::from_utf8(written.clone()).unwrap(), line + "\r");
        let Ok(Command::Transmit(read)) = read_commands(&written)[0] else {
            panic!("{written:?}");
        };
        assert_eq!(
            (read.id, read.fd, read.payload()),
            (frame.id, frame.fd, frame.payload())
        );
    }
    let mut lower = Vec::new();
    Command::Transmit(Frame::fd_frame(short, &[0xAB; 64], true).unwrap()).encode(&mut lower);
    let lower = [&lower[..1], &lower[1..].to_ascii_lowercase()].concat();
    assert!(lower.starts_with(b"b123fab"));
    assert!(read_commands(&lower)[0].is_ok(), "digits of either case are read");
}

#[test]
fn status_names_the_set_bits() {
    assert_eq!(Status(0x81).to_string(), "receive queue full, bus error");
    assert_eq!(Status::default().to_string(), "in order");
}
