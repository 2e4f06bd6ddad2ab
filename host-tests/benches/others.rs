//! What others have for frames of about the same size, each as its documentation says to use it.

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

/// Gives no more at a time than a chunk.
struct Chunks<'a> {
    rest: &'a [u8],
    chunk: usize,
}

impl Read for Chunks<'_> {
    fn read(&mut self, room: &mut [u8]) -> io::Result<usize> {
        let n = room.len().min(self.chunk).min(self.rest.len());
        let (now, later) = self.rest.split_at(n);
        room[..n].copy_from_slice(now);
        self.rest = later;
        Ok(n)
    }
}

/// MAVLink 2: a heartbeat, 21 bytes.
pub mod mavlink2 {
    use super::*;

    fn heartbeat() -> MavMessage {
        MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            mavlink_version: 3,
            ..HEARTBEAT_DATA::DEFAULT
        })
    }

    /// It on the line.
    pub fn frame() -> Vec<u8> {
        let mut raw = MAVLinkV2MessageRaw::new();
        raw.serialize_message(MavHeader::default(), &heartbeat());
        raw.raw_bytes().to_vec()
    }

    /// Takes in a stream.
    pub fn decode(stream: &[u8], chunk: usize) -> usize {
        let mut reader = MavlinkReader::new(Chunks { rest: stream, chunk });
        let mut count = 0;
        while let Ok(message) = reader.read_message::<MavMessage>(MavlinkVersion::V2) {
            black_box(&message);
            count += 1;
        }
        count
    }

    /// Writes it so often.
    pub fn encode(times: usize) -> usize {
        let message = heartbeat();
        let mut raw = MAVLinkV2MessageRaw::new();
        for _ in 0..times {
            raw.serialize_message(MavHeader::default(), black_box(&message));
            black_box(raw.raw_bytes());
        }
        times
    }
}

/// UBX: a navigation status, 24 bytes.
pub mod ubx {
    use super::*;

    /// It on the line.
    pub fn frame() -> Vec<u8> {
        let body = [
            &[0x01, 0x03, 16, 0][..],
            &[1, 0, 0, 0, 3, 1, 0, 0, 2, 0, 0, 0, 3, 0, 0, 0],
        ]
        .concat();
        let (mut a, mut b) = (0_u8, 0_u8);
        for byte in &body {
            a = a.wrapping_add(*byte);
            b = b.wrapping_add(a);
        }
        [&[0xB5, 0x62][..], &body, &[a, b]].concat()
    }

    /// Takes in a stream. What comes out is a view, of which a field is read.
    pub fn decode(stream: &[u8], chunk: usize) -> usize {
        let mut parser = ParserBuilder::new()
            .with_protocol::<Proto23>()
            .with_fixed_buffer::<256>();
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

    /// Writes a request for it so often.
    pub fn encode(times: usize) -> usize {
        for _ in 0..times {
            black_box(black_box(UbxPacketRequest::request_for::<NavStatus>()).into_packet_bytes());
        }
        times
    }
}

/// Modbus RTU: eight registers, 21 bytes.
pub mod modbus {
    use super::*;

    const REGISTERS: u16 = 8;

    /// The request, which says how its answer is to be read.
    fn request() -> (ModbusRequest, Vec<u8>) {
        let mut request = ModbusRequest::new(1, ModbusProto::Rtu);
        let mut bytes = Vec::new();
        request
            .generate_get_holdings(0, REGISTERS, &mut bytes)
            .expect("there is room");
        (request, bytes)
    }

    /// The answer on the line.
    pub fn frame() -> Vec<u8> {
        let mut frame = vec![1, 3, 2 * REGISTERS as u8];
        frame.extend([8, 0].repeat(REGISTERS.into()));
        let crc = frame.iter().fold(u16::MAX, |crc, byte| {
            (0..8).fold(crc ^ u16::from(*byte), |crc, _| (crc >> 1) ^ (0xA001 * (crc & 1)))
        });
        frame.extend(crc.to_le_bytes());
        frame
    }

    /// Takes in a stream. The crate says how long a frame is and what it means; to keep its bytes is the caller's.
    pub fn decode(stream: &[u8], chunk: usize) -> usize {
        let (request, _) = request();
        let (mut buffer, mut count) = (Vec::with_capacity(512), 0);
        let mut registers = Vec::with_capacity(REGISTERS.into());
        for bytes in stream.chunks(chunk) {
            buffer.extend_from_slice(bytes);
            let mut start = 0;
            while let Ok(len) = guess_response_frame_len(&buffer[start..], ModbusProto::Rtu) {
                let Some(frame) = buffer.get(start..start + usize::from(len)) else {
                    break;
                };
                registers.clear();
                count += usize::from(request.parse_u16(frame, &mut registers).is_ok());
                black_box(&registers);
                start += usize::from(len);
            }
            buffer.drain(..start);
        }
        count
    }

    /// Writes the request so often.
    pub fn encode(times: usize) -> usize {
        let mut bytes = Vec::with_capacity(32);
        let write = |_| {
            bytes.clear();
            let mut request = ModbusRequest::new(1, ModbusProto::Rtu);
            let written = request.generate_get_holdings(black_box(0), black_box(REGISTERS), &mut bytes);
            black_box(&bytes);
            written.is_ok()
        };
        (0..times).map(write).filter(|written| *written).count()
    }

    /// Asks, and hears the answer, so often.
    pub fn call(reply: &[u8], times: usize) -> usize {
        let mut bytes = Vec::with_capacity(32);
        let mut registers = Vec::with_capacity(REGISTERS.into());
        let call = |_| {
            bytes.clear();
            registers.clear();
            let mut request = ModbusRequest::new(1, ModbusProto::Rtu);
            let written = request.generate_get_holdings(black_box(0), black_box(REGISTERS), &mut bytes);
            black_box(&bytes);
            let reply = black_box(reply);
            let whole = guess_response_frame_len(reply, ModbusProto::Rtu).is_ok_and(|n| usize::from(n) == reply.len());
            let read = request.parse_u16(reply, &mut registers);
            black_box(&registers);
            written.is_ok() && whole && read.is_ok()
        };
        (0..times).map(call).filter(|done| *done).count()
    }
}

/// postcard in COBS frames, without a checksum: the same values as Ling's answer has.
pub mod postcard_cobs {
    use super::*;

    /// Numbers of fixed length, as on an arm's line.
    #[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
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

    /// It on the line.
    pub fn frame() -> Vec<u8> {
        let mut room = [0; 64];
        postcard::to_slice_cobs(&JOINTS, &mut room)
            .expect("there is room")
            .to_vec()
    }

    /// Takes in a stream.
    pub fn decode(stream: &[u8], chunk: usize) -> usize {
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

    /// Writes it so often.
    pub fn encode(times: usize) -> usize {
        let mut room = [0; 64];
        let write = |_| postcard::to_slice_cobs(black_box(&JOINTS), black_box(&mut room)).is_ok();
        (0..times).map(write).filter(|written| *written).count()
    }
}
