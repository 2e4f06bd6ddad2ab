//! Properties: written logs are read back as the same frames, and any bytes are read in bounded memory.

use std::io::Write;

use armwire_bridge::can::{FD_LENGTHS, Frame, Id};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;

use crate::ArmKind;
use crate::decode::format::Format;
use crate::decode::input::Head;
use crate::decode::log::record::MAX_EXTENDED;
use crate::decode::log::{csv, gvret};
use crate::decode::output::Entries;
use crate::decode::tests::{Pieces, line};
use crate::decode::unit::Unit;
use crate::decode::{decode_recording, read};

/// Maximum memory of reading a log, in bytes. The input's buffer and the decompressor take a third of it.
const MAX_MEMORY: u64 = 256 * 1024;
const FORMATS: [Format; 8] = [
    Format::Printer,
    Format::Pcap,
    Format::Candump,
    Format::Asc,
    Format::Trc,
    Format::Blf,
    Format::Csv,
    Format::Gvret,
];

/// A record of a bus.
#[derive(Clone, Debug)]
struct Sent {
    micros: u64,
    bus: u8,
    body: Body,
}

#[derive(Clone, Debug)]
enum Body {
    Data(Frame),
    /// A frame with a 29-bit identifier.
    Extended {
        id: u32,
        data: Vec<u8>,
        is_fd: bool,
    },
    Remote {
        id: u16,
        len: u8,
    },
    Error,
}

/// The part read so far.
#[derive(Debug, PartialEq)]
struct ReadBack {
    micros: u64,
    bus: String,
    frame: Option<Frame>,
}

impl Sent {
    fn is_fd(&self) -> bool {
        match &self.body {
            Body::Data(frame) => frame.is_fd(),
            Body::Extended { is_fd, .. } => *is_fd,
            Body::Remote { .. } | Body::Error => false,
        }
    }

    fn is_data(&self) -> bool {
        matches!(self.body, Body::Data(_) | Body::Extended { .. })
    }

    /// The identifier, true if it has 29 bits, and the data.
    fn parts(&self) -> (u32, bool, &[u8]) {
        match &self.body {
            Body::Data(frame) => (frame.id().get().into(), false, frame.data()),
            Body::Extended { id, data, .. } => (*id, true, data),
            Body::Remote { id, .. } => ((*id).into(), false, &[]),
            Body::Error => (0, false, &[]),
        }
    }

    /// The identifier in `digits` digits, or in 8 if it has 29 bits.
    fn id(&self, digits: usize) -> String {
        match self.parts() {
            (id, true, _) => format!("{id:08X}"),
            (id, false, _) => format!("{id:0digits$X}"),
        }
    }

    /// The data as `07 AA`, with this separator.
    fn data(&self, between: &str) -> String {
        let bytes: Vec<_> = self.parts().2.iter().map(|byte| format!("{byte:02X}")).collect();
        bytes.join(between)
    }

    fn len(&self) -> usize {
        self.parts().2.len()
    }

    fn dlc(&self) -> usize {
        FD_LENGTHS
            .iter()
            .position(|&len| usize::from(len) == self.len())
            .unwrap()
    }

    /// The time in seconds, with all digits.
    fn seconds(&self) -> String {
        format!("{}.{:06}", self.micros / 1_000_000, self.micros % 1_000_000)
    }

    fn expected(&self, bus: impl ToString) -> ReadBack {
        let frame = match self.body {
            Body::Data(frame) => Some(frame),
            _ => None,
        };
        let (micros, bus) = (self.micros, bus.to_string());
        ReadBack { micros, bus, frame }
    }

    /// The expected record of a log that shows FD frames by their length only.
    fn expected_by_length(&self, bus: impl ToString) -> ReadBack {
        let mut expected = self.expected(bus);
        if let Some(frame) = expected.frame
            && frame.data().len() <= 8
        {
            expected.frame = Some(Frame::new(frame.id(), frame.data()).unwrap());
        }
        expected
    }
}

fn body() -> impl Strategy<Value = Body> {
    let id = || (0..=Id::MAX.get()).prop_map(|id| Id::new(id).unwrap());
    let fd_data = || select(&FD_LENGTHS[..]).prop_flat_map(|len| vec(any::<u8>(), usize::from(len)));
    let classic_data = || vec(any::<u8>(), 0..=8);
    let extended = |is_fd| move |(id, data)| Body::Extended { id, data, is_fd };
    prop_oneof![
        4 => (id(), classic_data()).prop_map(|(id, data)| Body::Data(Frame::new(id, &data).unwrap())),
        4 => (id(), fd_data()).prop_map(|(id, data)| Body::Data(Frame::new_fd(id, &data).unwrap())),
        1 => (0..=MAX_EXTENDED, classic_data()).prop_map(extended(false)),
        1 => (0..=MAX_EXTENDED, fd_data()).prop_map(extended(true)),
        1 => (0..=Id::MAX.get(), 0..=8_u8).prop_map(|(id, len)| Body::Remote { id, len }),
        1 => Just(Body::Error),
    ]
}

/// Records in order of time.
fn traffic() -> impl Strategy<Value = Vec<Sent>> {
    let begin = 0..2_000_000_000_000_000_u64;
    let sent = (0..2_000_000_u64, 0..32_u8, body());
    (begin, vec(sent, 0..20)).prop_map(|(mut micros, sent)| {
        let at = |(pause, bus, body)| {
            micros += pause;
            Sent { micros, bus, body }
        };
        sent.into_iter().map(at).collect()
    })
}

/// Reads a log in pieces of this size. The error is that of the first record that is not understood.
fn read_back(log: &[u8], format: Format, piece: usize) -> Result<Vec<ReadBack>, String> {
    let (read_back, unread) = read_all(log, format, piece);
    unread.into_iter().next().map_or(Ok(read_back), Err)
}

/// The frames of a log, and the reasons of what is not understood.
fn read_all(log: &[u8], format: Format, piece: usize) -> (Vec<ReadBack>, Vec<String>) {
    let out = Entries::default();
    let head = Head::new("log".to_owned(), Box::new(Pieces(log, piece)), &out);
    let mut input = head.into_text().unwrap();
    let (mut read_back, mut unread) = (Vec::new(), Vec::new());
    let read = read(&mut input, format, None, &mut |_, unit| match unit {
        Ok(Unit::Can(logged)) => {
            let (micros, bus) = (logged.time.at.as_micros(), logged.bus.into_owned());
            let frame = logged.frame;
            read_back.push(ReadBack { micros, bus, frame });
        }
        Ok(_) => {}
        Err(reason) => unread.push(reason.text),
    });
    read.unwrap();
    (read_back, unread)
}

/// A log with these lines, with line ends of Unix or Windows.
fn text(lines: impl IntoIterator<Item = String>, is_windows: bool) -> Vec<u8> {
    let end = if is_windows { "\r\n" } else { "\n" };
    let lines = lines.into_iter().map(|line| line + end);
    lines.collect::<String>().into_bytes()
}

/// A line of `candump -L`.
fn candump_logged(sent: &Sent) -> String {
    let place = format!("({}) can{}", sent.seconds(), sent.bus);
    match &sent.body {
        Body::Remote { len, .. } => format!("{place} {}#R{len}", sent.id(3)),
        Body::Error => format!("{place} 20000088#0000190000000000"),
        _ if sent.is_fd() => format!("{place} {}##1{}", sent.id(3), sent.data("")),
        _ => format!("{place} {}#{}", sent.id(3), sent.data("")),
    }
}

/// A line of candump's output.
fn candump_printed(sent: &Sent) -> String {
    let place = format!(" ({})  can{}", sent.seconds(), sent.bus);
    let (id, len, data) = (sent.id(3), sent.len(), sent.data(" "));
    match &sent.body {
        Body::Remote { len, .. } => format!("{place}  {id}   [{len}]  remote request"),
        Body::Error => format!("{place}  20000088   [8]  00 00 19 00 00 00 00 00   ERRORFRAME"),
        _ if sent.is_fd() => format!("{place}  {id}  [{len:02}]  {data}"),
        _ => format!("{place}  {id}   [{len}]  {data}"),
    }
}

/// Lines of an ASC log, by base and kind of time.
fn asc(traffic: &[Sent], is_decimal: bool, is_relative: bool) -> Vec<String> {
    let base = if is_decimal { "dec" } else { "hex" };
    let times = if is_relative { "relative" } else { "absolute" };
    let mut lines = vec![
        "date Fri Jan 1 00:00:00.000 2021".to_owned(),
        format!("base {base}  timestamps {times}"),
        "internal events logged".to_owned(),
    ];
    let mut before = 0;
    for sent in traffic {
        let micros = if is_relative { sent.micros - before } else { sent.micros };
        before = sent.micros;
        let time = format!("{:4}.{:06}", micros / 1_000_000, micros % 1_000_000);
        let (id, is_extended, data) = sent.parts();
        let number = |number: u32, digits: usize| match is_decimal {
            true => number.to_string(),
            false => format!("{number:0digits$X}"),
        };
        let id = number(id, 1) + if is_extended { "x" } else { "" };
        let data: String = data
            .iter()
            .map(|&byte| format!(" {}", number(byte.into(), 2)))
            .collect();
        let (bus, dlc, len) = (sent.bus, sent.dlc(), sent.len());
        lines.push(match &sent.body {
            Body::Remote { len, .. } => format!("{time} {bus}  {id}  Rx   r {len}"),
            Body::Error => format!("{time} {bus}  ErrorFrame"),
            _ if sent.is_fd() => format!(
                "{time} CANFD {bus:3} Rx  {id}  {:32} 1 0 {dlc:x} {len}{data} 0 0 3000 0 0 0 0 0",
                ""
            ),
            _ => format!("{time} {bus}  {id}  Rx   d {dlc:x}{data}"),
        });
    }
    lines.push("End TriggerBlock".to_owned());
    lines
}

/// Lines of a TRC log of version 1.1: no FD frames, no buses, times in 0.1 ms.
fn trc_1(traffic: &[Sent]) -> Vec<String> {
    let lines = traffic.iter().enumerate().map(|(i, sent)| {
        let (millis, tenths) = (sent.micros / 1000, sent.micros / 100 % 10);
        let place = format!("{:6}) {millis:9}.{tenths}", i + 1);
        let (id, len) = (sent.id(4), sent.len());
        match &sent.body {
            Body::Remote { len, .. } => format!("{place}  Rx         {id}  {len}  RTR"),
            Body::Error => format!("{place}  Error      0008  4  00 19 08 08"),
            _ => format!("{place}  Tx     {id:>8}  {len}  {}", sent.data(" ")),
        }
    });
    [";$FILEVERSION=1.1".to_owned(), ";".to_owned()]
        .into_iter()
        .chain(lines)
        .collect()
}

/// Lines of a TRC log of version 2.1.
fn trc_2(traffic: &[Sent]) -> Vec<String> {
    let lines = traffic.iter().enumerate().map(|(i, sent)| {
        let time = format!("{:7} {:9}.{:03}", i + 1, sent.micros / 1000, sent.micros % 1000);
        let (bus, id, dlc) = (sent.bus, sent.id(4), sent.dlc());
        match &sent.body {
            Body::Remote { len, .. } => format!("{time} RR {bus} {id:>8} Rx - {len}"),
            Body::Error => format!("{time} ER {bus}        - Rx - 5 00 00 19 00 00"),
            _ if sent.is_fd() => format!("{time} FB {bus} {id:>8} Rx - {dlc:2} {}", sent.data(" ")),
            _ => format!("{time} DT {bus} {id:>8} Rx - {dlc:2} {}", sent.data(" ")),
        }
    });
    let header = [
        ";$FILEVERSION=2.1",
        ";$STARTTIME=44197.0",
        ";$COLUMNS=N,O,T,B,I,d,R,L,D",
    ];
    header.into_iter().map(str::to_owned).chain(lines).collect()
}

/// A line of python-can's CSV.
fn csv_line(sent: &Sent) -> String {
    let (id, is_extended, data) = sent.parts();
    let is_remote = matches!(sent.body, Body::Remote { .. });
    let is_error = matches!(sent.body, Body::Error);
    let flags = [is_extended, is_remote, is_error]
        .map(|flag| u8::from(flag).to_string())
        .join(",");
    let dlc = match sent.body {
        Body::Remote { len, .. } => len.into(),
        _ => data.len(),
    };
    format!("{},0x{id:x},{flags},{dlc},{}", sent.seconds(), STANDARD.encode(data))
}

/// A line of GVRET's CSV, for data frames only.
fn gvret_line(sent: &Sent) -> String {
    let (id, is_extended, data) = sent.parts();
    let (micros, bus, len) = (sent.micros, sent.bus, data.len());
    format!("{micros},{id:08X},{is_extended},Rx,{bus},{len},{},", sent.data(","))
}

/// The objects of a BLF file. The time of a frame selects one of the possible object types.
fn blf_objects(traffic: &[Sent]) -> Vec<u8> {
    const EXTENDED: u32 = 1 << 31;
    const NANOSECONDS: u32 = 2;
    let mut objects = Vec::new();
    for sent in traffic {
        let (id, is_extended, data) = sent.parts();
        let id = (id | if is_extended { EXTENDED } else { 0 }).to_le_bytes();
        let (bus, dlc, len) = (sent.bus, sent.dlc() as u8, data.len() as u8);
        let is_even = sent.micros % 2 == 0;
        let mut body = Vec::new();
        let kind: u32 = match &sent.body {
            Body::Error => {
                body.extend([bus, 0, 0, 0]);
                if is_even { 2 } else { 73 }
            }
            Body::Remote { len, .. } => {
                body.extend([bus, 0, 0x80, *len]);
                body.extend(id);
                body.extend([0; 8]);
                86
            }
            _ if sent.is_fd() && is_even => {
                body.extend([bus, 0, 0, dlc]);
                body.extend(id);
                body.extend([0, 0, 0, 0, 0, 1, len, 0, 0, 0, 0, 0]);
                body.extend(data);
                body.resize(20 + 64, 0);
                100
            }
            _ if sent.is_fd() => {
                body.extend([bus, dlc, len, 0]);
                body.extend(id);
                body.extend([0; 4]);
                body.extend(0x1000_u32.to_le_bytes());
                body.extend([0; 24]);
                body.extend(data);
                101
            }
            _ => {
                body.extend([bus, 0, 0, dlc]);
                body.extend(id);
                body.extend(data);
                body.resize(16, 0);
                if is_even { 1 } else { 86 }
            }
        };
        objects.extend(b"LOBJ\x20\0\x01\0");
        objects.extend(u32::try_from(32 + body.len()).unwrap().to_le_bytes());
        objects.extend(kind.to_le_bytes());
        objects.extend(NANOSECONDS.to_le_bytes());
        objects.extend([0; 4]);
        objects.extend((sent.micros * 1000).to_le_bytes());
        objects.extend(body);
        // Objects begin at multiples of 4.
        objects.resize(objects.len().next_multiple_of(4), 0);
    }
    objects
}

/// A BLF file whose containers have `container` bytes of objects.
fn blf(traffic: &[Sent], is_compressed: bool, container: usize) -> Vec<u8> {
    let mut file = b"LOGG\x08\0\0\0".to_vec();
    for part in blf_objects(traffic).chunks(container) {
        let data = match is_compressed {
            true => {
                let mut zlib = ZlibEncoder::new(Vec::new(), Compression::fast());
                zlib.write_all(part).unwrap();
                zlib.finish().unwrap()
            }
            false => part.to_vec(),
        };
        file.extend(b"LOBJ\x10\0\x01\0");
        file.extend(u32::try_from(32 + data.len()).unwrap().to_le_bytes());
        file.extend(10_u32.to_le_bytes());
        file.extend([if is_compressed { 2 } else { 0 }, 0, 0, 0, 0, 0, 0, 0]);
        file.extend(u32::try_from(part.len()).unwrap().to_le_bytes());
        file.extend([0; 4]);
        file.extend(data);
    }
    file
}

/// A line that python-can prints.
fn printer_line(sent: &Sent) -> String {
    let kind = if sent.parts().1 { 'X' } else { 'S' };
    let is = |flag: char, is: bool| if is { flag } else { ' ' };
    let (is_error, is_remote) = (
        matches!(sent.body, Body::Error),
        matches!(sent.body, Body::Remote { .. }),
    );
    let len = match &sent.body {
        Body::Remote { len, .. } => usize::from(*len),
        _ => sent.len(),
    };
    let (error, remote, fd) = (is('E', is_error), is('R', is_remote), is('F', sent.is_fd()));
    format!(
        "Timestamp: {:>15}    ID: {:>8}    {kind} Rx {error} {remote} {fd}          DL: {len:2}    {:24}    Channel: can{}",
        sent.seconds(),
        sent.id(4).to_lowercase(),
        sent.data(" ").to_lowercase(),
        sent.bus
    )
}

/// A packet of SocketCAN.
fn packet(sent: &Sent) -> Vec<u8> {
    let (id, is_extended, data) = sent.parts();
    let (flags, len) = match &sent.body {
        Body::Remote { len, .. } => (1 << 30, *len),
        Body::Error => (1 << 29, 0),
        _ => (u32::from(is_extended) << 31, data.len() as u8),
    };
    let fd = if sent.is_fd() { 4 } else { 0 };
    [&(id | flags).to_be_bytes()[..], &[len, fd, 0, 0], data].concat()
}

/// A pcap file.
fn pcap(traffic: &[Sent], is_big_endian: bool, has_nanos: bool) -> Vec<u8> {
    let word = |word: u32| {
        if is_big_endian {
            word.to_be_bytes()
        } else {
            word.to_le_bytes()
        }
    };
    let magic = if has_nanos { 0xA1B2_3C4D } else { 0xA1B2_C3D4 };
    let version = if is_big_endian { [0, 2, 0, 4] } else { [2, 0, 4, 0] };
    let mut file = [word(magic), version, word(0), word(0), word(65_535), word(227)].concat();
    for sent in traffic {
        let packet = packet(sent);
        let fraction = (sent.micros % 1_000_000) as u32 * if has_nanos { 1_000 } else { 1 };
        let len = word(packet.len() as u32);
        file.extend([word((sent.micros / 1_000_000) as u32), word(fraction), len, len].concat());
        file.extend(packet);
    }
    file
}

/// A pcapng file with an interface for each bus.
fn pcapng(traffic: &[Sent]) -> Vec<u8> {
    let block = |kind: u32, body: &[u8]| {
        let len = (12 + body.len().next_multiple_of(4)) as u32;
        let mut block = [&kind.to_le_bytes()[..], &len.to_le_bytes(), body].concat();
        block.resize(block.len().next_multiple_of(4), 0);
        block.extend(len.to_le_bytes());
        block
    };
    let section = [&0x1A2B_3C4D_u32.to_le_bytes()[..], &[1, 0, 0, 0], &[0xFF; 8]].concat();
    let mut file = block(0x0A0D_0D0A, &section);
    for bus in 0..32 {
        let name = format!("can{bus:02}");
        let options = [&[2, 0, 5, 0][..], name.as_bytes(), &[0; 3], &[0; 4]].concat();
        file.extend(block(1, &[&[227, 0, 0, 0, 0, 0, 0, 0][..], &options].concat()));
    }
    for sent in traffic {
        let packet = packet(sent);
        let words = [
            sent.bus.into(),
            (sent.micros >> 32) as u32,
            sent.micros as u32,
            packet.len() as u32,
            packet.len() as u32,
        ];
        let mut body = words.map(u32::to_le_bytes).concat();
        body.extend(packet);
        file.extend(block(6, &body));
    }
    file
}

/// The records as logs in all formats that can express them.
fn written(traffic: &[Sent], is_windows: bool) -> Vec<(Format, Vec<u8>)> {
    let text = |lines: Vec<String>| text(lines, is_windows);
    let classic: Vec<_> = traffic.iter().filter(|sent| !sent.is_fd()).cloned().collect();
    let with_header = |header: &str, lines: Vec<String>| text([vec![header.to_owned()], lines].concat());
    let data = traffic.iter().filter(|sent| sent.is_data());
    vec![
        (Format::Candump, text(traffic.iter().map(candump_logged).collect())),
        (Format::Candump, text(traffic.iter().map(candump_printed).collect())),
        (Format::Printer, text(traffic.iter().map(printer_line).collect())),
        (Format::Pcap, pcap(traffic, true, false)),
        (Format::Pcap, pcapng(traffic)),
        (Format::Asc, text(asc(traffic, false, false))),
        (Format::Trc, text(trc_1(&classic))),
        (Format::Trc, text(trc_2(traffic))),
        (
            Format::Csv,
            with_header(csv::HEADER, traffic.iter().map(csv_line).collect()),
        ),
        (Format::Gvret, with_header(GVRET, data.map(gvret_line).collect())),
        (Format::Blf, blf(traffic, true, 1000)),
        (Format::Blf, blf(traffic, false, 1000)),
    ]
}

/// The first line of GVRET's CSV.
const GVRET: &str = "Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8";

proptest! {
    #[test]
    fn candump_reads_back(traffic in traffic(), piece in 1..200_usize, is_windows: bool) {
        let expected: Vec<_> = traffic.iter().map(|sent| sent.expected(format!("can{}", sent.bus))).collect();
        for line in [candump_logged, candump_printed] {
            let log = text(traffic.iter().map(line), is_windows);
            let read_back = read_back(&log, Format::Candump, piece);
            prop_assert_eq!(read_back.as_ref(), Ok(&expected));
        }
    }

    #[test]
    fn asc_reads_back(
        traffic in traffic(), piece in 1..200_usize, is_windows: bool, is_decimal: bool, is_relative: bool
    ) {
        let expected: Vec<_> = traffic.iter().map(|sent| sent.expected(sent.bus)).collect();
        let log = text(asc(&traffic, is_decimal, is_relative), is_windows);
        prop_assert_eq!(read_back(&log, Format::Asc, piece), Ok(expected));
    }

    #[test]
    fn trc_reads_back(mut traffic in traffic(), piece in 1..200_usize, is_windows: bool) {
        // An error is an event in a trace, not a frame.
        let frames = |traffic: &[Sent]| -> Vec<Sent> {
            traffic.iter().filter(|sent| !matches!(sent.body, Body::Error)).cloned().collect()
        };
        let expected: Vec<_> = frames(&traffic).iter().map(|sent| sent.expected(sent.bus)).collect();
        let log = text(trc_2(&traffic), is_windows);
        prop_assert_eq!(read_back(&log, Format::Trc, piece), Ok(expected));

        traffic.retain(|sent| !sent.is_fd());
        let rounded = |sent: &Sent| Sent { micros: sent.micros / 100 * 100, ..sent.clone() }.expected("");
        let expected: Vec<_> = frames(&traffic).iter().map(rounded).collect();
        let log = text(trc_1(&traffic), is_windows);
        prop_assert_eq!(read_back(&log, Format::Trc, piece), Ok(expected));
    }

    #[test]
    fn csv_of_python_can_reads_back(traffic in traffic(), piece in 1..200_usize, is_windows: bool) {
        let expected: Vec<_> = traffic.iter().map(|sent| sent.expected_by_length("")).collect();
        let lines = traffic.iter().map(csv_line);
        let log = text([csv::HEADER.to_owned()].into_iter().chain(lines), is_windows);
        prop_assert_eq!(read_back(&log, Format::Csv, piece), Ok(expected));
    }

    #[test]
    fn text_of_python_can_reads_back(traffic in traffic(), piece in 1..200_usize, is_windows: bool) {
        let expected: Vec<_> = traffic.iter().map(|sent| sent.expected(format!("can{}", sent.bus))).collect();
        let log = text(traffic.iter().map(printer_line), is_windows);
        prop_assert_eq!(read_back(&log, Format::Printer, piece), Ok(expected));
    }

    #[test]
    fn captures_read_back(traffic in traffic(), piece in 1..200_usize, is_big_endian: bool, has_nanos: bool) {
        let expected: Vec<_> = traffic.iter().map(|sent| sent.expected("")).collect();
        let log = pcap(&traffic, is_big_endian, has_nanos);
        prop_assert_eq!(read_back(&log, Format::Pcap, piece), Ok(expected));
        let expected: Vec<_> = traffic.iter().map(|sent| sent.expected(format!("can{:02}", sent.bus))).collect();
        prop_assert_eq!(read_back(&pcapng(&traffic), Format::Pcap, piece), Ok(expected));
    }

    #[test]
    fn csv_of_gvret_reads_back(mut traffic in traffic(), piece in 1..200_usize, is_windows: bool) {
        traffic.retain(Sent::is_data);
        let expected: Vec<_> = traffic.iter().map(|sent| sent.expected_by_length(sent.bus)).collect();
        let lines = traffic.iter().map(gvret_line);
        let log = text([GVRET.to_owned()].into_iter().chain(lines), is_windows);
        prop_assert!(log.starts_with(gvret::HEADER.as_bytes()));
        prop_assert_eq!(read_back(&log, Format::Gvret, piece), Ok(expected));
    }

    #[test]
    fn blf_reads_back(
        traffic in traffic(), piece in 1..200_usize, is_compressed: bool, container in 1..500_usize
    ) {
        let expected: Vec<_> = traffic.iter().map(|sent| sent.expected(sent.bus)).collect();
        let log = blf(&traffic, is_compressed, container);
        prop_assert_eq!(read_back(&log, Format::Blf, piece), Ok(expected));
    }

    #[test]
    fn any_bytes_end_with_a_sum(bytes in vec(any::<u8>(), 0..2000)) {
        for format in FORMATS {
            prop_assert!(has_sum(&bytes, format));
            // After the first bytes of such a file.
            prop_assert!(has_sum(&[b"LOGG\x08\0\0\0LOBJ", &bytes[..]].concat(), format));
        }
    }

    #[test]
    fn damaged_logs_end_with_a_sum(
        traffic in traffic(), damage in vec((any::<prop::sample::Index>(), any::<u8>()), 1..4), end: prop::sample::Index
    ) {
        for (format, mut log) in written(&traffic, false) {
            if log.is_empty() {
                continue;
            }
            for (at, byte) in &damage {
                let at = at.index(log.len());
                log[at] = *byte;
            }
            log.truncate(end.index(log.len()) + 1);
            prop_assert!(has_sum(&log, format), "{format:?}");
        }
    }

    #[test]
    fn foreign_line_costs_only_itself(traffic in traffic(), at: prop::sample::Index) {
        for (format, log) in written(&traffic, false) {
            if matches!(format, Format::Blf | Format::Pcap) {
                continue;
            }
            let whole = read_back(&log, format, usize::MAX).unwrap();
            let ends: Vec<_> = log.iter().enumerate().filter(|(_, byte)| **byte == b'\n').map(|(end, _)| end + 1).collect();
            let Some(&end) = ends.get(at.index(ends.len().max(1))) else { continue };
            let (front, back) = log.split_at(end);
            let (frames, unread) = read_all(&[front, b"???\n", back].concat(), format, usize::MAX);
            prop_assert_eq!(frames, whole);
            prop_assert_eq!(unread.len(), 1, "{:?}", unread);
        }
    }

    #[test]
    fn damaged_length_in_a_capture_costs_one_packet(
        traffic in traffic().prop_filter("packets on both sides", |traffic| traffic.len() > 2),
        at: prop::sample::Index, len in prop_oneof![Just(5_000_u32), Just(u32::MAX - 15)], is_pcapng: bool
    ) {
        let at = 1 + at.index(traffic.len() - 2);
        let write = |traffic: &[Sent]| match is_pcapng {
            true => pcapng(traffic),
            false => pcap(traffic, false, false),
        };
        let mut log = write(&traffic);
        let field = write(&traffic[..at]).len() + if is_pcapng { 4 } else { 8 };
        log[field..field + 4].copy_from_slice(&len.to_le_bytes());
        let bus = |sent: &Sent| if is_pcapng { format!("can{:02}", sent.bus) } else { String::new() };
        let mut expected: Vec<_> = traffic.iter().map(|sent| sent.expected(bus(sent))).collect();
        expected.remove(at);
        let (frames, doubts) = read_all(&log, Format::Pcap, 1000);
        prop_assert_eq!(frames, expected);
        prop_assert_eq!(doubts, ["damaged block"]);
    }

    #[test]
    fn foreign_bytes_of_blf_cost_no_object(
        traffic in traffic(), bytes in vec(any::<u8>().prop_filter("a signature", |byte| *byte != b'L'), 8..100),
        at: prop::sample::Index
    ) {
        let objects: Vec<_> = traffic.iter().map(|sent| blf_objects(std::slice::from_ref(sent))).collect();
        let at = at.index(objects.len() + 1);
        let (front, back) = objects.split_at(at);
        let log = [b"LOGG\x08\0\0\0", &front.concat()[..], &bytes, &back.concat()].concat();
        let expected: Vec<_> = traffic.iter().map(|sent| sent.expected(sent.bus)).collect();
        let (frames, unread) = read_all(&log, Format::Blf, usize::MAX);
        prop_assert_eq!(frames, expected);
        prop_assert_eq!(unread, ["no object starts here"]);
    }

    #[test]
    fn damaged_container_of_blf_costs_only_its_objects(
        traffic in traffic().prop_filter("empty", |traffic| !traffic.is_empty()), lost: prop::sample::Index
    ) {
        let lost = lost.index(traffic.len());
        let files = traffic.iter().enumerate().map(|(i, sent)| {
            let mut container = blf(std::slice::from_ref(sent), true, usize::MAX).split_off(8);
            if i == lost {
                container[32..40].fill(0xFF);
            }
            container.resize(container.len().next_multiple_of(4), 0);
            container
        });
        let log = [b"LOGG\x08\0\0\0".to_vec(), files.collect::<Vec<_>>().concat()].concat();
        let mut expected: Vec<_> = traffic.iter().map(|sent| sent.expected(sent.bus)).collect();
        expected.remove(lost);
        let (frames, unread) = read_all(&log, Format::Blf, usize::MAX);
        prop_assert_eq!(frames, expected);
        prop_assert!(unread.len() == 1 && unread[0].starts_with("this container cannot be decompressed: "), "{unread:?}");
    }
}

/// Returns true if decoding ends with a sum. A capture may have another link type by its damage.
fn has_sum(log: &[u8], format: Format) -> bool {
    let out = Entries::default();
    let head = Head::new("log".to_owned(), Box::new(log), &out);
    let decoded = decode_recording(head, &out, Some(format), line(ArmKind::Ling, None));
    match decoded {
        Err(error) => error.to_string().starts_with("log: a capture of "),
        Ok(_) => out.into_lines().last().is_some_and(|sum| {
            let beginnings = ["CAN frames: ", "bytes: ", "frames: ", "packets read: 0"];
            beginnings.iter().any(|beginning| sum.starts_with(beginning))
        }),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4))]

    #[test]
    fn memory_does_not_grow_with_a_log(traffic in traffic().prop_filter("empty", |traffic| traffic.len() > 4)) {
        let many: Vec<_> = traffic.iter().cycle().take(10_000).cloned().collect();
        let logs = written(&many, false);
        prop_assert!(logs[0].1.len() as u64 > MAX_MEMORY);
        for (format, log) in logs {
            let memory = memory_of(&log, format);
            prop_assert!(memory < MAX_MEMORY, "{format:?} takes {memory} bytes");
        }
    }

    #[test]
    fn memory_does_not_grow_with_any_bytes(bytes in vec(any::<u8>(), 1..100), beginning in select(BEGINNINGS)) {
        let log = [beginning, &bytes.repeat(1_000_000 / bytes.len())].concat();
        for format in FORMATS {
            let memory = memory_of(&log, format);
            prop_assert!(memory < MAX_MEMORY, "{format:?} takes {memory} bytes");
        }
    }
}

/// A point at which a reader waits for input.
const BEGINNINGS: &[&[u8]] = &[
    b"",
    b"(",
    b"(1.0) can0 60F#",
    b";",
    b"base ",
    b"LOGG\x00\0\0\x80",
    b"LOGG\x08\0\0\0LOBJ",
];

/// Peak memory of reading a log, in bytes.
fn memory_of(log: &[u8], format: Format) -> u64 {
    let measured = allocation_counter::measure(|| {
        let out = Entries::default();
        let head = Head::new("log".to_owned(), Box::new(Pieces(log, usize::MAX)), &out);
        let mut input = head.into_text().unwrap();
        let _ = read(&mut input, format, None, &mut |_, _| {});
    });
    measured.bytes_max
}
