//! armwire itself.

use std::hint::black_box;

use armwire::{Client, Config, Decoder, Event, Framing, Input, Micros, Protocol};

/// What is known of a protocol to measure it.
pub struct Arm<P: Protocol> {
    /// A request and the answer to it.
    pub request: P::Request,
    /// The answer.
    pub response: P::Response,
}

pub mod ling {
    //! The joints, 21 bytes.
    use armwire::ling::{JointState, Ling, MotionStatus, Request, Response};

    use super::Arm;

    /// Asks for the joints.
    pub fn arm() -> Arm<Ling> {
        Arm {
            request: Request::ReadJoints,
            response: Response::Joints(JointState {
                joints: [2048; 6],
                gripper: 500,
                status: MotionStatus::Idle,
            }),
        }
    }
}

pub mod xarm {
    //! A register of 13 bytes, so that the frame has 21 as well.
    use armwire::xarm::{Command, Header, ProtocolId, Raw, Reply, Request, Response, State, XArm};

    use super::Arm;

    /// Asks for the register.
    pub fn arm() -> Arm<XArm> {
        let header = Header {
            transaction: 1,
            protocol: ProtocolId::Private,
        };
        let raw = |params| Raw::new(42, params).expect("it is of no other type");
        Arm {
            request: Request::Call {
                header,
                command: Command::Raw(raw(&[])),
            },
            response: Response::Reply {
                header,
                state: State::OK,
                reply: Reply::Raw(raw(&[7; 13])),
            },
        }
    }
}

pub mod alpha1 {
    //! The firmware's version, 15 bytes, the longest answer of a fixed length.
    use armwire::alpha1::{Alpha1, FirmwareVersion, Outcome, Request, Response};

    use super::Arm;

    /// Asks for the version.
    pub fn arm() -> Arm<Alpha1> {
        Arm {
            request: Request::ReadFirmwareVersion,
            response: Response::FirmwareVersion(FirmwareVersion {
                outcome: Outcome::Success,
                text: *b"2016010100",
            }),
        }
    }
}

impl<P: Protocol> Arm<P> {
    /// The answer as it is on the line.
    pub fn reply(&self) -> Vec<u8> {
        let mut frame = [0; 300];
        let n = P::encode_response(&self.response, &mut frame).expect("there is room");
        frame[..n].to_vec()
    }

    /// Takes in a stream, down to typed values.
    pub fn decode<const N: usize>(&self, stream: &[u8], chunk: usize) -> usize {
        let expect = P::expect(Some(&self.request));
        each_frame::<P, N>(expect, stream, chunk, |frame| {
            black_box(&P::parse_response(frame, expect)).is_ok()
        })
    }

    /// Takes in a stream, down to frames whose envelope is good.
    pub fn frames<const N: usize>(&self, stream: &[u8], chunk: usize) -> usize {
        each_frame::<P, N>(P::expect(Some(&self.request)), stream, chunk, |frame| {
            black_box(frame);
            true
        })
    }

    /// Writes the request so often.
    pub fn encode(&self, times: usize) -> usize {
        let mut frame = [0; 300];
        let write = |_| P::encode_request(black_box(&self.request), black_box(&mut frame)).is_ok();
        (0..times).map(write).filter(|written| *written).count()
    }

    /// Asks, and hears the answer, so often.
    pub fn call<const N: usize>(&self, reply: &[u8], times: usize) -> usize {
        let mut client = Client::<P, N>::new(Config::DEFAULT);
        let call = |_| {
            client.submit(black_box(self.request)).ok()?;
            let n = black_box(client.poll_transmit(Micros(0))?).len();
            client.transmitted(Micros(0), n).unwrap();
            let event = client.handle(Micros(350), &mut Input::Bytes(black_box(reply)));
            matches!(black_box(&event), Some(Event::Answer(_))).then_some(())
        };
        (0..times).filter_map(call).count()
    }
}

/// How many frames of a stream are found good.
fn each_frame<F: Framing, const N: usize>(
    expect: F::Expect,
    stream: &[u8],
    chunk: usize,
    mut good: impl FnMut(F::Frame<'_>) -> bool,
) -> usize {
    let mut decoder = Decoder::<F, N>::new();
    let mut count = 0;
    for mut bytes in stream.chunks(chunk) {
        while let Some(next) = decoder.decode(&mut bytes, expect) {
            match next {
                Ok(frame) => count += usize::from(good(frame)),
                Err(noise) => drop(black_box(noise)),
            }
        }
    }
    count
}
