//! Hosts on the engine: one answer with [`Client`], several with [`Host`].

use armwire::correlation::{Correlation, Effect};
use armwire::messages::Messages;
use armwire::time::{Duration, Instant};
use armwire::{Client, Config, Device, DeviceEvent, Event as ClientEvent, Output};
use armwire_feetech::{BROADCAST, Event, Feetech, Host, MAX_FRAME, Request, Status, register};

const ALL: [u8; 6] = [1, 2, 3, 4, 5, 6];

fn positions(ids: &[u8]) -> Request<'_> {
    let address = register::POSITION.address;
    Request::SyncRead { address, len: 2, ids }
}

fn answer(id: u8, error: u8, data: &[u8]) -> Vec<u8> {
    let mut out = [0; MAX_FRAME];
    let status = Status { id, error, data };
    let n = Feetech::default().encode_response(&status, None, &mut out).unwrap();
    out[..n].to_vec()
}

/// A host, its time, and what it found.
struct Bus {
    host: Host<16>,
    now: Instant,
}

impl Bus {
    fn new(echoes: bool) -> Self {
        let protocol = Feetech {
            echoes,
            ..Feetech::default()
        };
        let host = Host::new(protocol, Config::default());
        let now = Instant::ZERO;
        Self { host, now }
    }

    fn send(&mut self, request: Request) -> Option<Vec<u8>> {
        let mut out = [0; MAX_FRAME];
        let n = self.host.send(&request, self.now, &mut out).unwrap();
        n.map(|n| out[..n].to_vec())
    }

    /// The events for these bytes, without their data.
    fn receive(&mut self, bytes: &[u8]) -> Vec<String> {
        assert!(self.host.decoder.push(bytes).is_empty());
        let mut events = Vec::new();
        while let Some(event) = self.host.poll(self.now) {
            events.push(match event {
                Event::Answer(status) => format!("answer {}", status.id),
                Event::Missing(id) => format!("missing {id}"),
                Event::Late(status) => format!("late {}", status.id),
                Event::Unsolicited(status) => format!("unsolicited {}", status.id),
                Event::Echo(bytes) => format!("echo {}", bytes.len()),
                Event::Noise(bytes, _) => format!("noise {}", bytes.len()),
            });
        }
        events
    }

    fn wait(&mut self, micros: u64) -> Vec<String> {
        self.now += Duration::from_micros(micros);
        self.receive(&[])
    }
}

#[test]
fn sync_read_has_an_answer_from_each() {
    let mut bus = Bus::new(false);
    assert!(bus.send(positions(&ALL)).is_some());
    let answers: Vec<u8> = ALL.iter().flat_map(|id| answer(*id, 0, &[0, 8])).collect();
    assert_eq!(bus.receive(&answers), ALL.map(|id| format!("answer {id}")));
    assert_eq!(bus.host.exchange.timeout(), None);
}

#[test]
fn silent_servo_is_missing_and_blocks_only_itself() {
    let mut bus = Bus::new(false);
    bus.send(positions(&[1, 2, 3]));
    let bytes = [answer(1, 0, &[0, 8]), answer(3, 0, &[0, 8])].concat();
    assert_eq!(bus.receive(&bytes), ["answer 1", "answer 3"]);
    assert_eq!(bus.wait(20_000), ["missing 2"]);
    assert_eq!(bus.send(positions(&[1, 2, 3])), None);
    assert!(bus.send(positions(&[1, 3])).is_some());
    bus.wait(200_000);
    assert!(bus.send(positions(&[1, 2, 3])).is_some());
}

#[test]
fn late_answer_is_no_answer_to_the_next_request() {
    let mut bus = Bus::new(false);
    bus.send(positions(&[1]));
    assert_eq!(bus.wait(15_000), ["missing 1"]);
    let voltage = Request::Read {
        id: 1,
        address: register::VOLTAGE.address,
        len: 1,
    };
    assert!(bus.send(voltage).is_some());
    assert_eq!(bus.receive(&answer(1, 0, &[0, 8])), ["late 1"]);
    assert_eq!(bus.receive(&answer(1, 0, &[74])), ["answer 1"]);
}

#[test]
fn damaged_and_second_answers_are_told_apart() {
    let mut bus = Bus::new(false);
    bus.send(positions(&[1, 2]));
    let mut damaged = answer(1, 0, &[0, 8]);
    damaged[5] ^= 4;
    let bytes = [damaged, answer(2, 0, &[0, 8]), answer(2, 0, &[0, 8])].concat();
    let events = bus.receive(&bytes);
    assert!(events.iter().any(|event| event.starts_with("noise")), "{events:?}");
    assert_eq!(events[events.len() - 2..], ["answer 2", "unsolicited 2"]);
    assert_eq!(bus.wait(15_000), ["missing 1"]);
}

#[test]
fn echo_is_no_answer_even_if_it_looks_like_one() {
    // With a voltage error the answer to a ping is the ping.
    for request in [
        Request::Ping { id: 1 },
        Request::Read {
            id: 1,
            address: 56,
            len: 2,
        },
    ] {
        let mut bus = Bus::new(true);
        let echo = bus.send(request).unwrap();
        assert_eq!(bus.receive(&echo), [format!("echo {}", echo.len())]);
        let data: &[u8] = if echo.len() == 6 { &[] } else { &[0, 8] };
        assert_eq!(bus.receive(&answer(1, 1, data)), ["answer 1"]);
    }
}

/// Both are sent before the first byte comes back. A read of two registers is also the answer to itself.
#[test]
fn echo_behind_another_echo_is_no_answer() {
    let mut bus = Bus::new(true);
    let goals = Request::SyncWrite {
        address: register::GOAL_POSITION.address,
        len: 2,
        data: &[1, 0, 8],
    };
    let read = Request::Read {
        id: 1,
        address: register::POSITION.address,
        len: 2,
    };
    let line = [bus.send(goals).unwrap(), bus.send(read).unwrap()].concat();
    let events = bus.receive(&line);
    assert!(events.iter().all(|event| event.starts_with("echo")), "{events:?}");
    assert_eq!(bus.receive(&answer(1, 0, &[0, 8])), ["answer 1"]);
}

#[test]
fn writes_are_acknowledged_unless_stated_or_to_all() {
    let silent = Feetech {
        acknowledges: false,
        ..Feetech::default()
    };
    let write = |id| Request::Write {
        id,
        address: register::P.address,
        data: &[16],
    };
    for (protocol, id, answers) in [
        (Feetech::default(), 1, 1),
        (Feetech::default(), BROADCAST, 0),
        (silent, 1, 0),
    ] {
        let mut out = [0; MAX_FRAME];
        let n = protocol.encode_request(&write(id), &mut out).unwrap();
        assert_eq!(protocol.answers(&out[..n]).count(), answers);
    }
}

#[test]
fn only_a_ping_of_all_is_answered() {
    let bus = Feetech::default();
    let ids = |frame: &[u8]| bus.answers(frame).map(|info| info.key.id).collect::<Vec<_>>();
    assert_eq!(ids(&answer(BROADCAST, 0x01, &[])), [BROADCAST]);
    assert_eq!(ids(&answer(BROADCAST, 0x02, &[56, 2])), [0; 0]);
    // Of another host: its ids are those of no servo, or of all.
    assert_eq!(ids(&answer(BROADCAST, 0x82, &[56, 2, BROADCAST, 1, 0xFF, 2])), [1, 2]);
    assert_eq!(ids(&answer(BROADCAST, 0x82, &[56, 2])), [0; 0]);
}

#[test]
fn effects_are_those_of_the_registers() {
    let effect = |request: Request| {
        let mut out = [0; MAX_FRAME];
        let n = Feetech::default().encode_request(&request, &mut out).unwrap();
        Feetech::default().request(&out[..n]).unwrap().effect
    };
    let write = |address, data| effect(Request::Write { id: 1, address, data });
    assert_eq!(write(register::GOAL_POSITION.address, &[0, 8]), Effect::Motion);
    assert_eq!(write(register::ACCELERATION.address, &[50, 0, 8]), Effect::Motion);
    assert_eq!(write(register::GOAL_SPEED.address + 1, &[0]), Effect::Motion);
    assert_eq!(write(register::TORQUE.address, &[0]), Effect::Torque);
    assert_eq!(write(register::TORQUE.address, &[128]), Effect::Setting);
    assert_eq!(write(register::TORQUE_LIMIT.address, &[0, 1]), Effect::Setting);
    assert_eq!(write(register::P.address, &[16]), Effect::Setting);
    let (address, len) = (register::TORQUE.address, 1);
    assert_eq!(
        effect(Request::SyncWrite {
            address,
            len,
            data: &[1, 0, 2, 0, 3, 0]
        }),
        Effect::Torque
    );
    assert_eq!(effect(Request::Action { id: 1 }), Effect::Motion);
    assert_eq!(effect(Request::Reboot { id: 1 }), Effect::Torque);
    assert_eq!(effect(Request::Ping { id: 1 }), Effect::Read);
}

#[test]
fn client_calls_a_device_of_the_same_protocol() {
    let mut client = Client::<Feetech, MAX_FRAME>::new(Feetech::default(), Config::default());
    let mut device = Device::<Feetech, MAX_FRAME>::default();
    client.submit(&Request::Ping { id: 6 }).unwrap();
    assert_eq!(client.poll(Instant::ZERO), Output::Receive);
    client.received(Instant::ZERO, 0).unwrap();
    let Output::Transmit(bytes) = client.poll(Instant::ZERO) else {
        panic!("nothing to transmit")
    };
    assert!(device.receive(bytes).is_empty());
    let n = bytes.len();
    client.transmitted(Instant::ZERO, n).unwrap();
    let Some(DeviceEvent::Request { request, key }) = device.poll() else {
        panic!("no request")
    };
    assert_eq!(request, Request::Ping { id: 6 });
    let mut out = [0; MAX_FRAME];
    let (id, error, data) = (6, 0, &[][..]);
    let n = device.respond(&Status { id, error, data }, key, &mut out).unwrap();
    assert!(client.receive(Instant::ZERO, &out[..n]).is_empty());
    let status = Status { id, error, data };
    assert_eq!(client.poll(Instant::ZERO), Output::Event(ClientEvent::Answer(status)));
}

/// A packet ends with a checksum, not with a mark: zeros behind a cut one complete it if the sum before them is FF. They
/// are no void on this bus.
#[test]
fn zeros_complete_a_cut_request_at_one_sum() {
    let mut completed = 0;
    for low in 0..=255 {
        let (address, len) = (register::GOAL_POSITION.address, 2);
        let data = [1, low, 8, 2, 0, 8];
        let mut frame = [0; MAX_FRAME];
        let request = Request::SyncWrite {
            address,
            len,
            data: &data,
        };
        let n = Feetech::default().encode_request(&request, &mut frame).unwrap();
        for cut in 1..n {
            let mut device = Device::<Feetech, 512>::default();
            assert!(device.receive(&frame[..cut]).is_empty() && device.receive(&[0; 261]).is_empty());
            let is_completed = matches!(device.poll(), Some(DeviceEvent::Request { .. }));
            let sum = frame[..cut]
                .iter()
                .skip(2)
                .fold(0, |sum: u8, byte| sum.wrapping_add(*byte));
            assert_eq!(is_completed, cut >= 4 && sum == 0xFF, "cut at {cut}, goal {low}");
            completed += u32::from(is_completed);
        }
    }
    assert!(completed > 0);
}
