//! Other crates for frames of about the same size, each used as documented.
//!
//! Each module has a frame, decodes a stream of it in chunks, and encodes a given number of frames.

use std::hint::black_box;
use std::io::{self, Read};

use mavlink::dialects::minimal::{HEARTBEAT_DATA, MavMessage};
use mavlink::{MAVLinkV2MessageRaw, MavHeader, MavlinkReader, MavlinkVersion};
use postcard::accumulator::{CobsAccumulator, FeedResult};
use rmodbus::client::ModbusRequest;
use rmodbus::{ModbusProto, guess_response_frame_len};
use serde::{Deserialize, Serialize};
use ublox::nav_status::NavStatus;
use ublox::proto23::{PacketRef, Proto23};
use ublox::{ParserBuilder, UbxPacket, UbxPacketRequest};

/// MAVLink 2: a heartbeat, 21 bytes.
pub(crate) mod mavlink2 {
    use super::*;

    const HEARTBEAT: MavMessage = MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        mavlink_version: 3,
        ..HEARTBEAT_DATA::DEFAULT
    });

    /// Gives no more at a time than a chunk.
    struct Chunks<'a>(&'a [u8], usize);

    impl Read for Chunks<'_> {
        fn read(&mut self, room: &mut [u8]) -> io::Result<usize> {
            let chunk = room.len().min(self.1);
            self.0.read(&mut room[..chunk])
        }
    }

    pub(crate) fn frame() -> Vec<u8> {
        let mut raw = MAVLinkV2MessageRaw::new();
        raw.serialize_message(MavHeader::default(), &HEARTBEAT);
        raw.raw_bytes().to_vec()
    }

    pub(crate) fn decode(stream: &[u8], chunk: usize) -> usize {
        let mut reader = MavlinkReader::new(Chunks(stream, chunk));
        let mut count = 0;
        while let Ok(message) = reader.read_message::<MavMessage>(MavlinkVersion::V2) {
            black_box(&message);
            count += 1;
        }
        count
    }

    pub(crate) fn encode(times: usize) -> usize {
        let mut raw = MAVLinkV2MessageRaw::new();
        for _ in 0..times {
            raw.serialize_message(MavHeader::default(), black_box(&HEARTBEAT));
            black_box(raw.raw_bytes());
        }
        times
    }
}

/// UBX: a navigation status, 24 bytes, of which a field is read; and the request for it.
pub(crate) mod ubx {
    use super::*;

    pub(crate) const FRAME: &[u8] = b"\xB5\x62\x01\x03\x10\0\x01\0\0\0\x03\x01\0\0\x02\0\0\0\x03\0\0\0\x1E\xC8";

    pub(crate) fn decode(stream: &[u8], chunk: usize) -> usize {
        let parser = ParserBuilder::new().with_protocol::<Proto23>();
        let mut parser = parser.with_fixed_buffer::<256>();
        let mut count = 0;
        for bytes in stream.chunks(chunk) {
            let mut packets = parser.consume_ubx(bytes);
            while let Some(packet) = packets.next() {
                if let Ok(UbxPacket::Proto23(PacketRef::NavStatus(status))) = packet {
                    count += usize::from(black_box(status.itow()) == 1);
                }
            }
        }
        count
    }

    pub(crate) fn encode(times: usize) -> usize {
        for _ in 0..times {
            black_box(black_box(UbxPacketRequest::request_for::<NavStatus>()).into_packet_bytes());
        }
        times
    }
}

/// Modbus RTU: eight registers, 21 bytes. The crate gives the length and the meaning of a frame; its caller keeps the
/// bytes.
pub(crate) mod modbus {
    use super::*;

    const REGISTERS: u16 = 8;
    pub(crate) const FRAME: &[u8] = b"\x01\x03\x10\x08\0\x08\0\x08\0\x08\0\x08\0\x08\0\x08\0\x08\0\x8F\x2C";

    fn request(bytes: &mut Vec<u8>) -> ModbusRequest {
        let mut request = ModbusRequest::new(1, ModbusProto::Rtu);
        let written = request.generate_get_holdings(black_box(0), black_box(REGISTERS), bytes);
        written.expect("a vector has room");
        request
    }

    pub(crate) fn decode(stream: &[u8], chunk: usize) -> usize {
        let request = request(&mut Vec::new());
        let (mut buffer, mut registers, mut count) = (Vec::new(), Vec::new(), 0);
        for bytes in stream.chunks(chunk) {
            buffer.extend_from_slice(bytes);
            let mut start = 0;
            while let Ok(len) = guess_response_frame_len(&buffer[start..], ModbusProto::Rtu)
                && let Some(frame) = buffer.get(start..start + usize::from(len))
            {
                registers.clear();
                count += usize::from(request.parse_u16(frame, &mut registers).is_ok());
                black_box(&registers);
                start += usize::from(len);
            }
            buffer.drain(..start);
        }
        count
    }

    pub(crate) fn encode(times: usize) -> usize {
        let mut bytes = Vec::with_capacity(32);
        for _ in 0..times {
            bytes.clear();
            request(&mut bytes);
            black_box(&bytes);
        }
        times
    }
}

/// postcard in COBS frames, without a checksum: the same values as in Ling's answer.
pub(crate) mod postcard_cobs {
    use super::*;

    /// Numbers of fixed length, as on an arm's line.
    #[derive(Clone, Copy, Deserialize, PartialEq, Serialize)]
    struct Joints {
        joints: [[u8; 2]; 6],
        gripper: [u8; 2],
        status: u8,
    }

    const JOINTS: Joints = Joints {
        joints: [[0, 8]; 6],
        gripper: [0xF4, 1],
        status: 2,
    };

    pub(crate) fn frame() -> Vec<u8> {
        let mut room = [0; 64];
        let frame = postcard::to_slice_cobs(&JOINTS, &mut room);
        frame.expect("there is room").to_vec()
    }

    pub(crate) fn decode(stream: &[u8], chunk: usize) -> usize {
        let mut accumulator = CobsAccumulator::<64>::new();
        let mut count = 0;
        for mut bytes in stream.chunks(chunk) {
            while !bytes.is_empty() {
                bytes = match accumulator.feed::<Joints>(bytes) {
                    FeedResult::Consumed => break,
                    FeedResult::OverFull(rest) | FeedResult::DeserError(rest) => rest,
                    FeedResult::Success { data, remaining } => {
                        count += usize::from(*black_box(&data) == JOINTS);
                        remaining
                    }
                };
            }
        }
        count
    }

    pub(crate) fn encode(times: usize) -> usize {
        let mut room = [0; 64];
        let encode = |_: &usize| postcard::to_slice_cobs(black_box(&JOINTS), black_box(&mut room)).is_ok();
        (0..times).filter(encode).count()
    }
}
