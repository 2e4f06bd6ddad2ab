//! The virtual arm in virtual time.

use armwire::decoder::{Decoder, Kind};
use armwire::framing::{Framing, Scan};
use armwire::messages::Messages;
use armwire::time::{Duration, Instant};
use armwire_feetech::register::{self, REGISTERS, Register};
use armwire_feetech::{BROADCAST, Expect, Feetech, MAX_FRAME, Request, Status};
use proptest::collection::vec;
use proptest::prelude::*;

use super::order::tests::any_order;
use super::*;
use crate::faults::{Line, Rates, any_rates};
use crate::serial::SerialDevice;
use crate::wire::{LineEvent, Wire};

type Bus = Wire<Feetech, So101, MAX_FRAME>;

fn bus() -> Bus {
    bus_of(Config::default())
}

fn bus_of(config: Config) -> Bus {
    let latency = Duration::from_millis(1);
    let timing = armwire::Config {
        latency,
        repeats: 0,
        ..armwire::Config::default()
    };
    Wire::new(timing, So101::new(config))
}

fn order(bus: &mut Bus, text: &str) -> Result<Vec<String>, OrderError> {
    let now = bus.elapsed();
    bus.device_mut().order(now, text.parse().unwrap())
}

fn faulty(text: &str) -> Bus {
    let mut bus = bus();
    order(&mut bus, text).unwrap();
    bus
}

fn read(bus: &mut Bus, id: u8, row: Register) -> i32 {
    let (address, len) = (row.address, row.len);
    let status = bus.call(Request::Read { id, address, len }).unwrap().unwrap();
    assert_eq!((status.id, status.data.len()), (id, usize::from(len)));
    row.value([status.data[0], status.data.get(1).copied().unwrap_or(0)])
}

fn write(bus: &mut Bus, id: u8, row: Register, value: i32) -> Option<u8> {
    let (address, data) = (row.address, &row.bytes(value).unwrap()[..row.len.into()]);
    let answer = bus.call(Request::Write { id, address, data });
    answer.ok().flatten().map(|status| status.error)
}

fn ping(bus: &mut Bus, id: u8) -> bool {
    bus.call(Request::Ping { id }).is_ok()
}

fn encoder(bus: &mut Bus, servo: usize) -> f64 {
    let now = bus.elapsed();
    bus.device_mut().servos(now)[servo - 1].encoder()
}

fn wait(bus: &mut Bus, millis: u64) {
    bus.wait(Duration::from_millis(millis));
}

#[test]
fn registers_have_their_factory_settings() {
    let mut bus = bus();
    for row in REGISTERS.iter().filter(|row| row.access != register::Access::ReadOnly) {
        let expected = match *row {
            register::ID => 4,
            register::GOAL_POSITION => 2048,
            _ => row.value(row.factory.to_le_bytes()),
        };
        assert_eq!(read(&mut bus, 4, *row), expected, "{}", row.name);
    }
    assert_eq!(
        [register::MODEL, register::POSITION, register::VOLTAGE].map(|row| read(&mut bus, 4, row)),
        [777, 2048, 74]
    );
}

#[test]
fn read_only_and_invalid_values_are_not_written() {
    let mut bus = bus();
    for row in [register::MODEL, register::POSITION, register::VOLTAGE, register::MOVING] {
        let before = read(&mut bus, 1, row);
        assert_eq!(write(&mut bus, 1, row, 1), Some(0));
        assert_eq!(read(&mut bus, 1, row), before, "{}", row.name);
    }
    // Mode 4 and baud rate 8 do not exist; the delay between them does.
    for (address, data) in [
        (register::MODE.address, &[4][..]),
        (register::BAUD_RATE.address, &[8, 7]),
    ] {
        bus.call(Request::Write { id: 1, address, data }).unwrap();
    }
    let rows = [register::MODE, register::BAUD_RATE, register::RETURN_DELAY];
    assert_eq!(rows.map(|row| read(&mut bus, 1, row)), [0, 0, 7]);
}

#[test]
fn lock_decides_what_survives_power_off() {
    for (lock, kept) in [(1, 32), (0, 16)] {
        let mut bus = bus();
        write(&mut bus, 1, register::LOCK, lock);
        write(&mut bus, 1, register::P, 16);
        assert_eq!(read(&mut bus, 1, register::P), 16);
        bus.call(Request::Reboot { id: 1 }).unwrap();
        assert_eq!(
            (read(&mut bus, 1, register::P), read(&mut bus, 1, register::LOCK)),
            (kept, 1)
        );
    }
}

#[test]
fn unlocking_saves_no_earlier_write() {
    let mut bus = bus();
    write(&mut bus, 1, register::P, 16);
    write(&mut bus, 1, register::LOCK, 0);
    bus.call(Request::Reboot { id: 1 }).unwrap();
    assert_eq!(read(&mut bus, 1, register::P), 32);
}

#[test]
fn motion_has_its_speed_and_acceleration() {
    let mut bus = bus();
    write(&mut bus, 1, register::ACCELERATION, 10);
    write(&mut bus, 1, register::GOAL_SPEED, 500);
    write(&mut bus, 1, register::GOAL_POSITION, 3048);
    assert_eq!(read(&mut bus, 1, register::TORQUE), 1);
    wait(&mut bus, 1000);
    assert_eq!(
        (read(&mut bus, 1, register::SPEED), read(&mut bus, 1, register::MOVING)),
        (500, 1)
    );
    // 0.5 s to 500 steps/s, 1.5 s at it, 0.5 s to rest.
    let position = read(&mut bus, 1, register::POSITION);
    assert!((2415..2435).contains(&position), "{position}");
    wait(&mut bus, 2000);
    let position = read(&mut bus, 1, register::POSITION);
    assert!((3047..=3049).contains(&position), "{position}");
    assert_eq!(
        (read(&mut bus, 1, register::SPEED), read(&mut bus, 1, register::MOVING)),
        (0, 0)
    );
}

#[test]
fn goal_is_limited_to_the_range() {
    let mut bus = bus();
    write(&mut bus, 1, register::MAX_POSITION, 2500);
    write(&mut bus, 1, register::GOAL_POSITION, 4000);
    wait(&mut bus, 2000);
    let position = read(&mut bus, 1, register::POSITION);
    assert!((2499..=2501).contains(&position), "{position}");
    // Without a range the turns count.
    write(&mut bus, 1, register::MAX_POSITION, 0);
    write(&mut bus, 1, register::GOAL_POSITION, 9000);
    wait(&mut bus, 4000);
    assert!((encoder(&mut bus, 1) - 9000.0).abs() < 2.0);
    let position = read(&mut bus, 1, register::POSITION);
    assert!(
        (9000 - 2 * 4096 - 1..=9000 - 2 * 4096 + 1).contains(&position),
        "{position}"
    );
}

#[test]
fn modes_turn_at_a_speed_and_by_steps() {
    let mut bus = bus();
    write(&mut bus, 1, register::MODE, 1);
    write(&mut bus, 1, register::GOAL_SPEED, -1000);
    write(&mut bus, 1, register::TORQUE, 1);
    wait(&mut bus, 1000);
    assert_eq!(read(&mut bus, 1, register::SPEED), -1000);
    assert!((encoder(&mut bus, 1) - 1048.0).abs() < 60.0);
    write(&mut bus, 2, register::MODE, 2);
    write(&mut bus, 2, register::GOAL_TIME, 500);
    write(&mut bus, 2, register::TORQUE, 1);
    wait(&mut bus, 500);
    assert_eq!(read(&mut bus, 2, register::SPEED), 1700);
    write(&mut bus, 3, register::MODE, 3);
    for _ in 0..2 {
        write(&mut bus, 3, register::GOAL_POSITION, -100);
        wait(&mut bus, 500);
    }
    assert!((encoder(&mut bus, 3) - 1848.0).abs() < 4.0);
    // A step is made once.
    for torque in [0, 1] {
        write(&mut bus, 3, register::TORQUE, torque);
    }
    wait(&mut bus, 500);
    assert!((encoder(&mut bus, 3) - 1848.0).abs() < 4.0);
}

#[test]
fn offset_changes_the_reported_position_only() {
    let mut bus = bus();
    order(&mut bus, "hand 2 628").unwrap();
    write(&mut bus, 2, register::OFFSET, 904);
    // As measured on a servo by the authors of feetech-cli.
    assert_eq!(read(&mut bus, 2, register::POSITION), 3820);
    write(&mut bus, 2, register::TORQUE, 128);
    assert_eq!(read(&mut bus, 2, register::POSITION), 2048);
    assert_eq!(
        (read(&mut bus, 2, register::TORQUE), read(&mut bus, 2, register::OFFSET)),
        (0, -1420)
    );
    assert_eq!(encoder(&mut bus, 2), 628.0);
}

#[test]
fn stored_writes_wait_for_the_action() {
    let mut bus = bus();
    for id in 1..=2 {
        let (address, data) = (register::GOAL_POSITION.address, &[0, 9][..]);
        bus.call(Request::RegWrite { id, address, data }).unwrap();
        assert_eq!(
            (
                read(&mut bus, id, register::GOAL_POSITION),
                read(&mut bus, id, register::STORED)
            ),
            (2048, 1)
        );
    }
    assert_eq!(bus.call(Request::Action { id: BROADCAST }), Ok(None));
    assert_eq!(
        (
            read(&mut bus, 2, register::GOAL_POSITION),
            read(&mut bus, 2, register::STORED)
        ),
        (2304, 0)
    );
}

#[test]
fn settings_of_a_servo_change_its_answers() {
    let mut bus = bus();
    write(&mut bus, 1, register::STATUS_LEVEL, 0);
    assert_eq!(write(&mut bus, 1, register::RETURN_DELAY, 0), None);
    assert_eq!(read(&mut bus, 1, register::RETURN_DELAY), 0);
    assert_eq!(write(&mut bus, 6, register::ID, 9), Some(0));
    assert!(ping(&mut bus, 9) && !ping(&mut bus, 6));
    assert_eq!(write(&mut bus, 3, register::BAUD_RATE, 1), Some(0));
    assert!(!ping(&mut bus, 3));
    bus.device_mut().set_baud(500_000);
    assert!(ping(&mut bus, 3) && !ping(&mut bus, 2));
}

#[test]
fn servos_with_one_id_collide() {
    let mut bus = bus();
    write(&mut bus, 2, register::ID, 1);
    order(&mut bus, "hand 1 4095").unwrap();
    let (address, len) = (register::POSITION.address, 2);
    // 4095 and 2048 at the same time: the checksum of neither.
    assert!(bus.call(Request::Read { id: 1, address, len }).is_err());
    assert!(ping(&mut bus, 1));
}

#[test]
fn factory_reset_keeps_the_id() {
    let mut bus = bus();
    write(&mut bus, 5, register::LOCK, 0);
    write(&mut bus, 5, register::P, 16);
    bus.call(Request::FactoryReset { id: 5 }).unwrap();
    assert_eq!(
        (read(&mut bus, 5, register::P), read(&mut bus, 5, register::ID)),
        (32, 5)
    );
}

#[test]
fn weight_pulls_off_the_goal_and_down() {
    let mut bus = faulty("sag 30");
    for (p, sag) in [(32, 30), (16, 60)] {
        write(&mut bus, 2, register::P, p);
        write(&mut bus, 2, register::GOAL_POSITION, 2048 + sag);
        wait(&mut bus, 1000);
        let position = read(&mut bus, 2, register::POSITION);
        assert!((2047..=2049).contains(&position), "{p}: {position}");
    }
    assert!(read(&mut bus, 2, register::LOAD) > 100);
    write(&mut bus, 2, register::TORQUE, 0);
    wait(&mut bus, 500);
    let position = read(&mut bus, 2, register::POSITION);
    assert!((1840..1860).contains(&position), "{position}");
    wait(&mut bus, 10_000);
    assert!(read(&mut bus, 2, register::POSITION) > 1024);
    assert_eq!(read(&mut bus, 1, register::POSITION), 2048);
}

#[test]
fn sync_read_is_answered_one_after_the_other() {
    let mut arm = So101::new(Config::default());
    let mut out = [0; MAX_FRAME];
    let request = Request::SyncRead {
        address: 56,
        len: 2,
        ids: &[1, 7, 3],
    };
    let n = Feetech::default().encode_request(&request, &mut out).unwrap();
    out[..n].iter().for_each(|byte| arm.receive(Instant::ZERO, *byte));
    let mut answers = Vec::new();
    for micros in 0..3000 {
        let now = Instant::from_micros(micros);
        let bytes: Vec<u8> = std::iter::from_fn(|| arm.transmit(now)).collect();
        if !bytes.is_empty() {
            answers.push((micros, bytes[2], bytes.len()));
        }
    }
    // A return delay of 500 µs, a turnaround of 20; eight bytes at 1 Mbaud. Servo 7 does not exist.
    assert_eq!(answers, [(520, 1, 8), (1120, 3, 8)]);
}

#[test]
fn late_answer_is_held_with_those_behind_it() {
    let mut bus = faulty("late 2");
    assert!(ping(&mut bus, 1));
    assert!(!ping(&mut bus, 2) && !ping(&mut bus, 3));
    wait(&mut bus, 100);
    let events = bus.take_events();
    assert_eq!(
        events
            .iter()
            .filter(|event| matches!(event, LineEvent::Late(_)))
            .count(),
        2
    );
    assert!(ping(&mut bus, 2));
}

#[test]
fn silent_servo_executes_without_an_answer() {
    let mut bus = faulty("silent 3");
    assert_eq!(write(&mut bus, 3, register::TORQUE, 1), None);
    let now = bus.elapsed();
    assert!(bus.device_mut().servos(now)[2].has_torque() && ping(&mut bus, 2));
    order(&mut bus, "clear").unwrap();
    assert!(ping(&mut bus, 3));
}

#[test]
fn unplugged_servo_takes_those_behind_it_along() {
    let mut bus = bus();
    for id in 1..=6 {
        write(&mut bus, id, register::TORQUE, 1);
    }
    order(&mut bus, "unplugged 3").unwrap();
    assert_eq!(
        [1, 2, 3, 4, 5, 6].map(|id| ping(&mut bus, id)),
        [true, true, false, false, false, false]
    );
    order(&mut bus, "clear").unwrap();
    wait(&mut bus, 200);
    assert_eq!(
        [1, 2, 3, 6].map(|id| read(&mut bus, id, register::TORQUE)),
        [1, 1, 0, 0]
    );
}

#[test]
fn errors_are_those_ordered_and_of_the_supply() {
    let mut bus = bus_of(Config::new(&[1, 2], &[777], 3.9).unwrap());
    order(&mut bus, "error 2 32").unwrap();
    let errors = [1, 2].map(|id| bus.call(Request::Ping { id }).unwrap().unwrap().error);
    assert_eq!((errors, read(&mut bus, 2, register::STATUS)), ([1, 33], 1));
}

#[test]
fn brownout_restarts_all_servos() {
    let mut bus = faulty("brownout 3");
    write(&mut bus, 1, register::TORQUE, 1);
    write(&mut bus, 1, register::ACCELERATION, 50);
    assert!(!ping(&mut bus, 1) && !ping(&mut bus, 2));
    wait(&mut bus, 400);
    assert_eq!(
        [register::TORQUE, register::ACCELERATION].map(|row| read(&mut bus, 1, row)),
        [0, 0]
    );
}

#[test]
fn brownout_ends_the_answers_to_a_request() {
    let sync_read = [[register::VOLTAGE.address, 1].as_slice(), &[1, 2, 3, 4]].concat();
    // Both requests are to all servos: a PING, and a SYNC_READ.
    for (code, data) in [(0x01, &[][..]), (0x82, &sync_read[..])] {
        let mut arm = So101::new(Config::default());
        arm.order(Instant::ZERO, "brownout 3".parse().unwrap()).unwrap();
        for byte in encoded(BROADCAST, code, data) {
            arm.receive(Instant::ZERO, byte);
        }
        let answers: Vec<u8> = std::iter::from_fn(|| arm.transmit(Instant::from_millis(100))).collect();
        assert_eq!(
            answers.windows(2).filter(|bytes| **bytes == [0xFF, 0xFF]).count(),
            2,
            "{answers:X?}"
        );
    }
}

#[test]
fn clear_ends_a_delay_and_a_brownout() {
    for fault in ["late 1:60000", "brownout 1:60000"] {
        let mut bus = faulty(fault);
        assert!(!ping(&mut bus, 1), "{fault}");
        order(&mut bus, "clear").unwrap();
        wait(&mut bus, 5);
        assert!(ping(&mut bus, 2), "{fault}");
    }
}

#[test]
fn sync_read_of_the_id_of_all_has_no_answer() {
    let mut arm = So101::new(Config::default());
    for byte in encoded(BROADCAST, 0x82, &[register::VOLTAGE.address, 1, BROADCAST]) {
        arm.receive(Instant::ZERO, byte);
    }
    assert_eq!(arm.transmit(Instant::from_millis(100)), None);
}

#[test]
fn damaged_and_double_answers_are_noise_and_unsolicited() {
    let mut bus = faulty("damaged");
    assert!(!ping(&mut bus, 1));
    assert!(
        bus.take_events()
            .iter()
            .any(|event| matches!(event, LineEvent::Noise { .. }))
    );
    order(&mut bus, "twice").unwrap();
    assert_eq!(read(&mut bus, 2, register::VOLTAGE), 74);
    wait(&mut bus, 5);
    assert!(
        bus.take_events()
            .iter()
            .any(|event| matches!(event, LineEvent::Unsolicited(_)))
    );
}

#[test]
fn echo_returns_the_host_its_bytes() {
    let mut arm = So101::new(Config::default());
    arm.order(Instant::ZERO, Order::Echo).unwrap();
    arm.receive(Instant::ZERO, 0x55);
    assert_eq!(
        (arm.poll_timeout(), arm.transmit(Instant::ZERO)),
        (Some(Instant::ZERO), Some(0x55))
    );
    assert_eq!((arm.poll_timeout(), arm.transmit(Instant::ZERO)), (None, None));
}

#[test]
fn hand_moves_a_servo_without_torque() {
    let mut bus = faulty("hand 2 1500");
    assert_eq!(read(&mut bus, 2, register::POSITION), 1500);
    write(&mut bus, 2, register::TORQUE, 1);
    assert_eq!(order(&mut bus, "hand 2 1000"), Err(OrderError::Holds(2)));
    for wrong in ["hand 7 1000", "silent 7", "unplugged 7", "error 7 1"] {
        assert_eq!(order(&mut bus, wrong), Err(OrderError::NoServo(7)), "{wrong}");
    }
}

#[test]
fn hand_moves_to_positions_that_are_reported() {
    let mut bus = bus();
    write(&mut bus, 3, register::PHASE, 12 + 16);
    for (line, error) in [
        ("hand 2 -1", "servo 2: position is -1 steps, must be 0..=4095"),
        ("hand 2 4096", "servo 2: position is 4096 steps, must be 0..=4095"),
        (
            "hand 3 -32768",
            "servo 3: position is -32768 steps, must be -32767..=32767",
        ),
    ] {
        let state = order(&mut bus, "state");
        assert_eq!(order(&mut bus, line).unwrap_err().to_string(), error);
        assert_eq!(order(&mut bus, "state"), state);
    }
    for (id, position) in [(2, 0), (2, 4095), (3, -5000), (3, 32767)] {
        order(&mut bus, &format!("hand {id} {position}")).unwrap();
        assert_eq!(read(&mut bus, id, register::POSITION), position);
    }
}

#[test]
fn hand_stays_in_the_turn_that_is_reported() {
    let mut bus = faulty("sag 30");
    order(&mut bus, "hand 2 1500").unwrap();
    wait(&mut bus, 2_000);
    let here = encoder(&mut bus, 2);
    let zero = here.round();
    assert!(here < zero, "it sinks to {here}");
    write(&mut bus, 2, register::OFFSET, zero as i32);
    assert_eq!(read(&mut bus, 2, register::POSITION), 0);
    order(&mut bus, "hand 2 0").unwrap();
    assert_eq!(encoder(&mut bus, 2), zero);
}

#[test]
fn state_has_a_line_for_each_servo() {
    let mut bus = faulty("hand 2 1500");
    let state = order(&mut bus, "state").unwrap();
    assert_eq!(state.len(), 6);
    assert_eq!(state[1], "servo 2: position 1500, encoder 1500, torque off");
}

#[test]
fn wrong_servos_are_refused() {
    let error = |ids: &[u8], models: &[u16], volts| Config::new(ids, models, volts).unwrap_err().to_string();
    assert_eq!(error(&[], &[777], 7.4), "an arm has at least one servo");
    assert_eq!(error(&[254], &[777], 7.4), "servo id is 254, must be 0..=253");
    assert_eq!(error(&[1, 2, 1], &[777], 7.4), "two servos have id 1");
    assert_eq!(
        error(&[1, 2, 3], &[777, 777], 7.4),
        "there are 2 models for 3 servos: expected one, or one for each"
    );
    assert_eq!(error(&[1], &[777], f64::NAN), "supply is NaN V, must be 0..=25.4");
    assert!(Config::new(&[1], &[777], -0.1).is_err() && Config::new(&[1], &[777], 25.5).is_err());
}

/// The bits of an error byte that a servo sets by itself.
const VOLTAGE: u8 = 1;
const TEMPERATURE: u8 = 4;

/// What a host does in a random run.
#[derive(Clone, Debug)]
enum Act {
    Send(Vec<u8>),
    Order(Order),
    Wait(u64),
    Baud(u32),
}

fn encoded(id: u8, code: u8, data: &[u8]) -> Vec<u8> {
    let mut out = [0; MAX_FRAME];
    // A packet is the same in both directions.
    let status = Status { id, error: code, data };
    let n = Feetech::default().encode_response(&status, None, &mut out).unwrap();
    out[..n].to_vec()
}

fn any_act() -> impl Strategy<Value = Act> {
    let id = prop_oneof![8 => 1..=6_u8, 1 => Just(BROADCAST), 1 => any::<u8>()];
    let code = prop_oneof![8 => 1..=8_u8, 4 => Just(2), 6 => Just(3), 1 => any::<u8>()];
    let packet = (id, code, vec(any::<u8>(), 0..12)).prop_map(|(id, code, data)| encoded(id, code, &data));
    let read = (1..=6_u8, any::<u8>(), any::<u8>()).prop_map(|(id, address, len)| encoded(id, 2, &[address, len]));
    let row = proptest::sample::select(REGISTERS);
    let write = (1..=6_u8, row, any::<[u8; 2]>()).prop_map(|(id, row, data)| {
        let data = [&[row.address][..], &data[..row.len.into()]].concat();
        encoded(id, 3, &data)
    });
    let sync = (any::<u8>(), 0..9_u8, vec(0..9_u8, 0..12))
        .prop_map(|(address, len, ids)| encoded(BROADCAST, 0x82, &[&[address, len][..], &ids].concat()));
    let sync_write = (any::<u8>(), 0..4_u8, vec(any::<u8>(), 0..20))
        .prop_map(|(address, len, data)| encoded(BROADCAST, 0x83, &[&[address, len][..], &data].concat()));
    prop_oneof![
        6 => prop_oneof![packet, read, write, sync, sync_write].prop_map(Act::Send),
        1 => vec(any::<u8>(), 0..20).prop_map(Act::Send),
        2 => any_order().prop_map(Act::Order),
        3 => (0..100_000_u64).prop_map(Act::Wait),
        1 => proptest::sample::select(&register::BAUD_RATES[..2]).prop_map(Act::Baud),
    ]
}

/// An arm, and the packets among the bytes that reach it.
struct Heard {
    arm: So101,
    bytes: Vec<u8>,
    packets: Vec<Vec<u8>>,
}

impl SerialDevice for Heard {
    fn receive(&mut self, now: Instant, byte: u8) {
        self.bytes.push(byte);
        let last = self.bytes.len().min(MAX_FRAME);
        for n in 6..=last {
            let window = &self.bytes[self.bytes.len() - n..];
            if Feetech::default().scan(window, Expect::Requests) == Scan::Frame(n) {
                self.packets.push(window.to_vec());
            }
        }
        self.arm.receive(now, byte);
    }

    fn transmit(&mut self, now: Instant) -> Option<u8> {
        self.arm.transmit(now)
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.arm.poll_timeout()
    }

    fn set_baud(&mut self, baud: u32) {
        self.arm.set_baud(baud);
    }
}

/// Returns true if a servo can answer a packet with this one: its id, its length, its values.
fn can_answer(packet: &[u8], status: &Status) -> bool {
    let (id, len) = (status.id, status.data.len());
    match Feetech::default().parse_request(packet) {
        Ok(Request::Ping { id: to }) => len == 0 && (to == id || to == BROADCAST),
        Ok(Request::Read {
            id: to,
            address,
            len: n,
        }) => to == id && len == n.into() && have_ranges(address, status.data),
        Ok(Request::SyncRead { address, len: n, ids }) => {
            ids.contains(&id) && len == n.into() && have_ranges(address, status.data)
        }
        Ok(Request::Reboot { .. } | Request::SyncWrite { .. }) | Err(_) => false,
        // An acknowledgement.
        Ok(_) => len == 0 && packet[2] == id,
    }
}

/// Returns true if each whole register among the data of a read has a value of its range.
fn have_ranges(address: u8, data: &[u8]) -> bool {
    REGISTERS.iter().all(|row| {
        let at = usize::from(row.address).checked_sub(address.into());
        let bytes = at.and_then(|at| data.get(at..at + usize::from(row.len)));
        bytes.is_none_or(|bytes| {
            let value = row.value([bytes[0], bytes.get(1).copied().unwrap_or(0)]);
            (row.min..=row.max).contains(&value)
        })
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2_000))]

    /// No run panics. A real servo could give each answer: to a request that reached the arm, in the order of requests, with
    /// the errors of its supply and those ordered. Each register has a value of its range.
    #[test]
    fn answers_of_random_runs_are_possible(acts in vec(any_act(), 1..20), rates in prop_oneof![Just(Rates::NONE), any_rates()], seed: u64) {
        let arm = So101::new(Config::default());
        let mut line = Line::new(Heard { arm, bytes: Vec::new(), packets: Vec::new() }, rates, Rates::NONE, seed);
        let (mut now, mut decoder) = (Instant::ZERO, Decoder::<Feetech, MAX_FRAME>::new());
        // Answers are damaged on order. Those of two servos at once are any bytes.
        let (mut is_damaged, mut is_any, mut errors) = (false, false, VOLTAGE | TEMPERATURE);
        // The request of the last answer.
        let mut answered = 0;
        for act in acts {
            let end = match act {
                Act::Send(bytes) => {
                    for byte in bytes {
                        now += Duration::from_micros(10);
                        line.receive(now, byte);
                    }
                    now
                }
                Act::Order(order) => {
                    is_damaged |= matches!(order, Order::Damaged { .. });
                    if let Order::Error { bits, .. } = order {
                        errors |= bits;
                    }
                    let result = line.device_mut().arm.order(now, order);
                    let is_refused = matches!(result, Err(OrderError::NoServo(_) | OrderError::Holds(_) | OrderError::Position { .. }));
                    prop_assert!(result.is_ok() || is_refused);
                    now
                }
                Act::Wait(micros) => now + Duration::from_micros(micros),
                Act::Baud(baud) => {
                    line.set_baud(baud);
                    now
                }
            };
            while let Some(due) = line.poll_timeout().filter(|due| *due <= end) {
                now = now.max(due);
                while let Some(byte) = line.transmit(now) {
                    prop_assert!(decoder.push(&[byte]).is_empty());
                    while let Some(item) = decoder.next(&Feetech::default(), Expect::Responses) {
                        if is_any || is_damaged && item.kind != Kind::Frame {
                            continue;
                        }
                        prop_assert_eq!(item.kind, Kind::Frame);
                        let status = Feetech::default().parse_response(item.bytes, Expect::Responses).unwrap();
                        prop_assert_eq!(status.error & !errors, 0, "{}", status);
                        let packets = &line.device().packets[answered..];
                        let request = packets.iter().position(|packet| can_answer(packet, &status));
                        prop_assert!(request.is_some(), "{status} to one of {packets:02X?}");
                        answered += request.unwrap_or_default();
                    }
                }
            }
            now = now.max(end);
            let servos = line.device_mut().arm.servos(now);
            is_any |= has_twins(servos);
            for servo in servos {
                for row in REGISTERS {
                    let value = servo.get(*row);
                    prop_assert!((row.min..=row.max).contains(&value), "{} is {value}", row.name);
                }
                let is_in_turn = (0..4096).contains(&servo.get(register::POSITION));
                prop_assert!(is_in_turn || servo.get(register::PHASE) & 16 != 0);
                prop_assert!(servo.encoder().is_finite());
            }
        }
    }
}

/// Returns true if two servos have the same id, and collide.
fn has_twins(servos: &[Servo]) -> bool {
    let mut ids: Vec<_> = servos.iter().map(Servo::id).collect();
    ids.sort_unstable();
    ids.windows(2).any(|pair| pair[0] == pair[1])
}
