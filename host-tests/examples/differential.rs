//! Damaged streams of Ling answers, and the frames that the decoder and the reference find in them, for comparison with
//! the vendor's parser by `host-tests/vendor/differential.py`.
//!
//! Usage: differential SEED
//!
//! Each line is a word and bytes in hex. `row` begins a stream and names it. `sent` is a frame of which bytes are missing
//! or between which others came, `intact` one that arrived whole; `stream` is all that arrived; `ours` and `reference`
//! are frames that were delivered.

use std::collections::VecDeque;
use std::io::{BufWriter, Result, Write, stdout};
use std::{env, iter};

use armwire::decoder::{Decoder, Kind};
use armwire::ling::{JointState, Ling, MAX_FRAME, MotionStatus, PerServo, Response};
use armwire::messages::Messages;
use armwire_bridge::Instant;
use armwire_host_tests::reference::{self, Piece, ling};
use armwire_sim::faults::{Line, Rates};
use armwire_sim::serial::SerialDevice;
use oorandom::Rand32;

/// Frames of each stream.
const FRAMES: usize = 2_000;

/// Bytes after the last frame, more than any parser waits for: no frame is delayed because nothing follows.
const SILENCE: usize = 300;

/// Damage to a stream.
enum Damage {
    /// Random damage to any byte, at these rates.
    Line(Rates),
    /// Truncated frames per million, as by a reset of the arm.
    Cut(u32),
    /// False headers per million frames: a header and three bytes, the last of which is read as a length.
    FalseHeader(u32),
}

/// All kinds of damage, by name.
fn rows() -> Vec<(String, Damage)> {
    let mut rows = vec![("nothing".to_owned(), Damage::Line(Rates::NONE))];
    for ppm in [1_000, 10_000, 50_000] {
        let percent = f64::from(ppm) / 10_000.0;
        let mut row = |name: &str, set: fn(&mut Rates, u32)| {
            let mut rates = Rates::NONE;
            set(&mut rates, ppm);
            rows.push((format!("{name}, {percent} %"), Damage::Line(rates)));
        };
        row("bytes lost", |rates, ppm| rates.drop = ppm);
        row("bits flipped", |rates, ppm| rates.corrupt = ppm);
        row("bytes twice", |rates, ppm| rates.duplicate = ppm);
        row("inserted bytes", |rates, ppm| rates.noise = ppm);
        row("all of these", |rates, ppm| {
            *rates = Rates::each(ppm);
            rates.delay = 0;
        });
    }
    for ppm in [10_000, 50_000, 200_000] {
        let percent = f64::from(ppm) / 10_000.0;
        rows.push((format!("frames cut short, {percent} %"), Damage::Cut(ppm)));
        rows.push((format!("false headers, {percent} %"), Damage::FalseHeader(ppm)));
    }
    rows
}

/// Sends these bytes.
struct Source(VecDeque<u8>);

impl SerialDevice for Source {
    fn receive(&mut self, _now: Instant, _byte: u8) {}

    fn transmit(&mut self, _now: Instant) -> Option<u8> {
        self.0.pop_front()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        None
    }
}

/// The answer of a follower to a host that mostly polls its joints.
fn answer(random: &mut Rand32) -> Vec<u8> {
    let mut word = |end| random.rand_range(0..end) as u16;
    let response = match word(10) {
        0 => Response::Temperatures(PerServo::Follower([0; 10].map(|_: u8| word(0x100) as u8))),
        1 => Response::Velocities(PerServo::Follower([0; 10].map(|_: u16| word(5_001)))),
        _ => Response::Joints(JointState {
            joints: [0; 6].map(|_: u16| word(4_096)),
            gripper: word(1_001),
            status: MotionStatus::from(word(2) as u8),
        }),
    };
    let mut out = [0; MAX_FRAME];
    let n = Ling
        .encode_response(&response, None, &mut out)
        .expect("the longest frame fits");
    out[..n].to_vec()
}

/// The received bytes of a damaged frame.
fn arrives(frame: &[u8], damage: &Damage, line: &mut Line<Source>, random: &mut Rand32) -> Vec<u8> {
    let mut happens = |ppm: &u32| random.rand_range(0..1_000_000) < *ppm;
    match damage {
        Damage::Line(_) => {
            line.device_mut().0.extend(frame);
            iter::from_fn(|| line.transmit(Instant::ZERO)).collect()
        }
        Damage::Cut(ppm) if happens(ppm) => {
            let len = random.rand_range(1..frame.len() as u32) as usize;
            frame[..len].to_vec()
        }
        Damage::FalseHeader(ppm) if happens(ppm) => {
            let [a, b, c, _] = random.rand_u32().to_le_bytes();
            [&[0xAA, a, b, c], frame].concat()
        }
        Damage::Cut(_) | Damage::FalseHeader(_) => frame.to_vec(),
    }
}

/// The frames that the decoder delivers.
fn ours(stream: &[u8]) -> Vec<Vec<u8>> {
    let mut decoder = Decoder::<_, MAX_FRAME>::new();
    let (mut frames, mut rest) = (Vec::new(), stream);
    while !rest.is_empty() {
        rest = decoder.push(rest);
        while let Some(item) = decoder.next(&Ling, ()) {
            if item.kind == Kind::Frame {
                frames.push(item.bytes.to_vec());
            }
        }
    }
    frames
}

/// The frames that the reference delivers.
fn references(stream: &[u8]) -> Vec<Vec<u8>> {
    let items = reference::decode(stream, ling::scan);
    let frames = items.iter().filter_map(Piece::frame);
    frames.map(|at| stream[at].to_vec()).collect()
}

fn main() -> Result<()> {
    let seed = env::args()
        .nth(1)
        .and_then(|seed| seed.parse().ok())
        .expect("usage: differential SEED");
    let mut out = BufWriter::new(stdout().lock());
    for (i, (name, damage)) in rows().into_iter().enumerate() {
        let rates = if let Damage::Line(rates) = damage {
            rates
        } else {
            Rates::NONE
        };
        let mut line = Line::new(Source(VecDeque::new()), Rates::NONE, rates, seed);
        let random = &mut Rand32::new_inc(seed, i as u64);
        let mut stream = Vec::new();
        writeln!(out, "row {name}")?;
        for _ in 0..FRAMES {
            let frame = answer(random);
            let arrived = arrives(&frame, &damage, &mut line, random);
            let intact = arrived.windows(frame.len()).any(|window| window == frame);
            writeln!(out, "{} {}", if intact { "intact" } else { "sent" }, hex(&frame))?;
            stream.extend(arrived);
        }
        stream.extend([0; SILENCE]);
        writeln!(out, "stream {}", hex(&stream))?;
        for frame in ours(&stream) {
            writeln!(out, "ours {}", hex(&frame))?;
        }
        for frame in references(&stream) {
            writeln!(out, "reference {}", hex(&frame))?;
        }
    }
    out.flush()
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
