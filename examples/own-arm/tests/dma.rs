//! The receiver behind a DMA, which a loop stands for.

use armwire::decoder::{Item, Kind};
use armwire::framing::Reason;
use armwire::messages::Messages;
use own_arm::dma::Receiver;
use own_arm::sensor::{Angle, MAX_FRAME, Sensor};

/// A DMA that fills a ring of `N` bytes, and its interrupts.
struct Dma<const N: usize> {
    ring: [u8; N],
    next: usize,
    /// The number of bytes that arrive before an interrupt is served.
    delay: usize,
    /// The number of these that are left.
    left: Option<usize>,
    receiver: Receiver<N>,
    angles: Vec<u16>,
    noise: Vec<(u8, Reason)>,
}

impl<const N: usize> Dma<N> {
    fn new(delay: usize) -> Self {
        Self {
            ring: [0; N],
            next: 0,
            delay,
            left: None,
            receiver: Receiver::new(),
            angles: Vec::new(),
            noise: Vec::new(),
        }
    }

    /// Bytes arrive. The interrupts are those of the half and of the whole ring.
    fn receive(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.ring[self.next] = *byte;
            self.next = (self.next + 1) % N;
            if self.next == N / 2 || self.next == 0 {
                self.left = Some(self.delay);
            }
            if self.left == Some(0) {
                self.interrupt(false);
            }
            self.left = self.left.and_then(|left| left.checked_sub(1));
        }
    }

    /// The interrupt of the idle line.
    fn idle(&mut self) {
        self.interrupt(true);
    }

    fn interrupt(&mut self, is_idle: bool) {
        let (angles, noise) = (&mut self.angles, &mut self.noise);
        let mut seen = |item: Item| match item.kind {
            Kind::Frame => angles.push(Sensor.parse_response(item.bytes, ()).unwrap().tenths),
            Kind::Noise(reason) => noise.extend(item.bytes.iter().map(|byte| (*byte, reason))),
            other => panic!("{other:?}"),
        };
        self.receiver.take(&self.ring, self.next, &mut seen).unwrap();
        if is_idle {
            self.receiver.idle(seen);
        }
    }
}

fn encoded(tenths: u16) -> Vec<u8> {
    let mut out = [0; MAX_FRAME];
    let n = Sensor
        .encode_response(&Angle { joint: 1, tenths }, None, &mut out)
        .unwrap();
    out[..n].to_vec()
}

fn every_angle_arrives<const N: usize>(delay: usize) {
    let mut dma = Dma::<N>::new(delay);
    let sent: Vec<u16> = (0..100).collect();
    for (i, tenths) in sent.iter().enumerate() {
        dma.receive(&encoded(*tenths));
        if i % 3 == 0 {
            dma.idle();
        }
    }
    dma.idle();
    assert_eq!(dma.angles, sent, "a ring of {N} bytes, interrupts {delay} bytes late");
    assert_eq!(dma.noise, []);
}

#[test]
fn angles_arrive_through_rings_of_any_size() {
    every_angle_arrives::<2>(0);
    for delay in 0..3 {
        every_angle_arrives::<7>(delay);
        every_angle_arrives::<8>(delay);
        every_angle_arrives::<64>(delay);
        every_angle_arrives::<255>(delay);
    }
}

#[test]
fn damaged_answer_is_noise_with_its_reason() {
    let mut dma = Dma::<16>::new(0);
    let mut damaged = encoded(905);
    damaged[3] ^= 0x10;
    dma.receive(&damaged);
    dma.receive(&encoded(906));
    dma.idle();
    assert_eq!(dma.angles, [906]);
    assert!(matches!(dma.noise[0], (0x5A, Reason::Checksum { .. })));
    assert_eq!(dma.noise.len(), MAX_FRAME);
}

#[test]
fn idle_line_ends_a_cut_answer() {
    let mut dma = Dma::<16>::new(0);
    dma.receive(&encoded(905)[..4]);
    dma.idle();
    assert_eq!(dma.noise[0], (0x5A, Reason::Truncated { missing: 3 }));
    dma.receive(&encoded(906));
    dma.idle();
    assert_eq!(dma.angles, [906]);
}

#[test]
fn index_outside_of_the_ring_is_refused() {
    let mut receiver = Receiver::<16>::new();
    let error = receiver.take(&[0; 16], 17, |_| panic!("an item")).unwrap_err();
    assert_eq!(error.to_string(), "next index is 17, must be 0..=16");
}
