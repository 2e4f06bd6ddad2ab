//! Bytes pass the firmware image unchanged: at the full rate of the line, in chunks of any size, in both directions.

use std::time::Instant;

use armwire_host_tests::image::{
    MEGABAUD, RawArm, board_config, byte_time, chip, counters, exchange, facts, noise, on_board, on_board_with,
    plug_in, same_bytes,
};
use armwire_virtual_board::Nanos;
use armwire_virtual_board::usb::Direction;

/// Chunk sizes around those of a byte, a packet, two packets, ten packets, the queues and the receive ring.
const SIZES: [usize; 23] = [
    1, 2, 3, 7, 62, 63, 64, 65, 66, 127, 128, 129, 191, 192, 193, 255, 256, 257, 511, 512, 640, 1024, 1025,
];

/// Exchanges `count` bytes in both directions at once, and prints the throughput.
fn saturate(baud: u32, count: usize) {
    let mut config = board_config(RawArm::default());
    config.arm_baud = baud;
    on_board_with(config, |board| {
        plug_in(board, baud);
        let start = Instant::now();
        let before = board.now();
        exchange(board, &noise(1, count), &noise(2, count));

        let line = board.uart().bytes();
        let ended = line.last().unwrap().at;
        let virtually = ended.since(before).0 as f64 / 1e9;
        println!(
            "{count} bytes each way at {baud} baud: {virtually:.3} s of virtual time, {:.1} s of real time",
            start.elapsed().as_secs_f64()
        );
        let least = byte_time(baud).0 as f64 / 1e9 * count as f64;
        assert!(
            virtually < least * (facts(chip()).duplex)(baud) + 0.002,
            "{virtually} s for bytes that take {least} s on a busy line"
        );

        let counters = counters(board);
        assert_eq!(counters.arm_to_host_bytes, count as u32);
        assert_eq!(counters.host_to_arm_bytes, count as u32);
        assert_eq!(
            (
                counters.dropped_bytes,
                counters.undelivered_bytes,
                counters.refused_bytes
            ),
            (0, 0, 0)
        );
        assert_eq!((counters.overrun_errors, counters.ring_overruns), (0, 0));
    });
}

#[test]
fn bytes_pass_each_way_at_megabaud() {
    saturate(MEGABAUD, 100_000);
}

#[test]
fn bytes_pass_each_way_at_two_megabaud() {
    saturate(2_000_000, 100_000);
}

#[test]
fn bytes_pass_each_way_at_115200_baud() {
    saturate(115_200, 100_000);
}

#[test]
fn chunks_of_any_size_pass_both_ways() {
    on_board(RawArm::default(), |board| {
        plug_in(board, MEGABAUD);
        for (nth, size) in SIZES.into_iter().enumerate() {
            exchange(board, &noise(nth as u64, size), &noise(1_000 + nth as u64, size));
        }
    });
}

#[test]
fn host_packets_of_any_size_keep_order() {
    on_board(RawArm::default(), |board| {
        plug_in(board, MEGABAUD);
        let chunks = noise(5, 20_000);
        let mut left = &chunks[..];
        for size in SIZES.iter().cycle() {
            let (chunk, rest) = left.split_at((*size).min(left.len()));
            board.usb().write(chunk).unwrap();
            left = rest;
            if left.is_empty() {
                break;
            }
        }
        board.run_for(Nanos::from_millis(250)).unwrap();
        same_bytes("the arm", &board.with_arm(RawArm::take_received), &chunks);
    });
}

#[test]
fn final_full_packet_is_followed_by_empty() {
    on_board(RawArm::default(), |board| {
        plug_in(board, MEGABAUD);
        for packets in [1, 2, 3, 10] {
            board.usb().forget_packets();
            exchange(board, &[], &noise(packets, 64 * packets as usize));
            let lengths: Vec<usize> = board
                .usb()
                .packets()
                .iter()
                .filter(|packet| packet.direction == Direction::In)
                .map(|packet| packet.data.len())
                .collect();
            assert_eq!(lengths.iter().sum::<usize>(), 64 * packets as usize);
            assert!(lengths.last().is_some_and(|&last| last < 64), "{lengths:?}");
        }
    });
}
