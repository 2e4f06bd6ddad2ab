//! A line has the same meaning after any earlier input; a line survives a read and a write; and the adapter answers
//! each line once, sends frames only while its channel is open, and reports received frames.
#![no_main]

use armwire_bridge::slcan::{Command, Commands, Malformed, Replies, Reply, Status};
use armwire_bridge::{Duration, Instant};
use armwire_fuzz::{Result, Unstructured};
use armwire_sim::can::{Frame, Id};
use armwire_sim::slcan::Adapter;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| {
    let Some((kind, rest)) = input.split_first() else {
        return;
    };
    match kind % 2 {
        0 => lines(rest),
        _ => {
            // A short input is skipped.
            let _ = adapter(&mut Unstructured::new(rest));
        }
    }
});

fn commands(bytes: &[u8]) -> Vec<core::result::Result<Command, Malformed>> {
    let mut commands = Commands::default();
    bytes.iter().filter_map(|byte| commands.push(*byte)).collect()
}

fn replies(bytes: &[u8]) -> Vec<core::result::Result<Reply, Malformed>> {
    let mut replies = Replies::default();
    bytes.iter().filter_map(|byte| replies.push(*byte)).collect()
}

fn lines(bytes: &[u8]) {
    let lines: Vec<&[u8]> = bytes.split(|byte| *byte == b'\r').collect();
    let all = commands(bytes);
    assert_eq!(all.len(), lines.len() - 1);
    for (command, line) in all.into_iter().zip(lines) {
        let alone = [line, b"\r"].concat();
        assert_eq!(commands(&alone), [command]);
        match command {
            Ok(command) => {
                let mut line = Vec::new();
                command.encode(&mut line);
                assert_eq!(commands(&line), [Ok(command)]);
                assert_eq!(alone[..1], line[..1]);
                assert!(alone.eq_ignore_ascii_case(&line), "{alone:?} is {line:?}");
            }
            Err(error) => assert!(!error.to_string().is_empty()),
        }
    }
    for reply in replies(bytes) {
        match reply {
            Ok(reply) => {
                // A refusal in the middle of a line ends the line.
                let mut line = match reply {
                    Reply::Refused => b"V1013".to_vec(),
                    _ => Vec::new(),
                };
                reply.encode(&mut line);
                assert_eq!(replies(&line), [Ok(reply)]);
            }
            Err(error) => assert!(!error.to_string().is_empty()),
        }
    }
}

const LINES: [&[u8]; 12] = [
    b"\r",
    b"S8\r",
    b"O\r",
    b"L\r",
    b"C\r",
    b"F\r",
    b"V\r",
    b"N\r",
    b"Z1\r",
    b"Z0\r",
    b"t6003010203\r",
    b"b60F811\r",
];

/// Any frame on the bus. `None` if the data has no valid length.
fn any_frame(u: &mut Unstructured<'_>) -> Result<Option<Frame>> {
    let (id, is_extended, data): (u32, bool, &[u8]) = u.arbitrary()?;
    let id = match is_extended {
        true => Id::Extended(id & Id::MAX_EXTENDED),
        false => Id::Standard((id & 0x7FF) as u16),
    };
    // An FD frame may switch the bit rate.
    Ok(match u.arbitrary()? {
        Some(bit_rate_switch) => Frame::fd_frame(id, data, bit_rate_switch),
        None => Frame::data_frame(id, data),
    })
}

fn adapter(u: &mut Unstructured<'_>) -> Result<()> {
    let mut adapter = Adapter::new();
    let mut reader = Replies::default();
    let (mut line_ends, mut answers, mut reported) = (0, 0, 0);
    let (mut room, mut now) = (true, Instant::ZERO);
    let mut received = Vec::new();
    while !u.is_empty() {
        now += Duration::from_micros(1_001);
        match u.int_in_range(0..=5)? {
            0 => line_ends += program(&mut adapter, u.arbitrary()?, room),
            1 => {
                line_ends += program(
                    &mut adapter,
                    LINES[usize::from(u.arbitrary::<u8>()?) % LINES.len()],
                    room,
                )
            }
            2 => {
                let Some(frame) = any_frame(u)? else { continue };
                adapter.on_frame(&frame, now);
                if adapter.bit_rate().is_some() {
                    received.push(frame);
                }
            }
            3 => adapter.report(Status(u.arbitrary()?)),
            4 => room = u.arbitrary()?,
            _ => {
                read(&mut adapter, &mut reader, &received, &mut reported, &mut answers);
                assert_eq!((answers, reported), (line_ends, received.len()));
            }
        }
        assert!(!adapter.is_listening() || adapter.bit_rate().is_some());
    }
    read(&mut adapter, &mut reader, &received, &mut reported, &mut answers);
    assert_eq!((answers, reported), (line_ends, received.len()));
    Ok(())
}

/// Reads the adapter's output: the received frames, in order.
fn read(adapter: &mut Adapter, reader: &mut Replies, received: &[Frame], reported: &mut usize, answers: &mut usize) {
    for byte in adapter.output().drain(..) {
        match reader.push(byte) {
            Some(Ok(Reply::Frame { frame, millis })) => {
                assert_eq!(Some(&frame), received.get(*reported));
                assert!(millis.is_none_or(|millis| millis < 60_000));
                *reported += 1;
            }
            Some(Ok(reply)) => {
                if let Reply::Status(status) = reply {
                    assert!(!status.to_string().is_empty());
                }
                *answers += 1;
            }
            Some(Err(error)) => panic!("invalid bytes from the adapter: {error}"),
            None => {}
        }
    }
}

/// Passes on bytes of a program. Returns the number of completed lines.
fn program(adapter: &mut Adapter, bytes: &[u8], room: bool) -> usize {
    for byte in bytes {
        let open = adapter.bit_rate().is_some() && !adapter.is_listening();
        adapter.receive(*byte, |_| {
            assert!(open, "a frame is sent while the channel is not open");
            room
        });
    }
    bytes.iter().filter(|byte| **byte == b'\r').count()
}
