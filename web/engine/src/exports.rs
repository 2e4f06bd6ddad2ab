//! The functions called by the page. Numbers are passed as arguments, bytes and texts through two buffers.
//!
//! Times are microseconds of the page's clock as `f64`, exact for 285 years. An unknown number is NaN. The page owns
//! one [`Engine`], from [`engine_new`], and passes it to every call. It accesses the buffers between two calls.
#![expect(unsafe_code, reason = "an exported name is an unsafe attribute")]

use armwire::ling::{JOINTS, Speed, Torque};
use armwire::time::Instant;
use armwire_sim::faults::Rates;
use armwire_sim::ling::{Plant, PlantError};

use crate::counters;
use crate::jog::Direction;
use crate::log::Record;
use crate::session::Session;
use crate::virtual_arm::{FAULTS, VirtualArm};

/// Size of each buffer in bytes, larger than the longest frame or text.
const BUFFER: usize = 4096;

/// A session, a virtual arm, and the buffers.
pub struct Engine {
    session: Session,
    arm: VirtualArm,
    /// The last record taken from the log.
    record: Option<Record>,
    input: [u8; BUFFER],
    output: [u8; BUFFER],
}

/// Converts a time of the page. Times before its origin become the origin.
fn instant(micros: f64) -> Instant {
    Instant::from_micros(micros as u64)
}

/// Converts a time for the page; infinite for `None`.
fn timeout(instant: Option<Instant>) -> f64 {
    instant.map_or(f64::INFINITY, |instant| instant.as_micros() as f64)
}

fn number(value: Option<impl Into<f64>>) -> f64 {
    value.map_or(f64::NAN, Into::into)
}

/// Writes bytes to the output and returns their number.
fn put(output: &mut [u8], bytes: &[u8]) -> usize {
    match output.get_mut(..bytes.len()) {
        Some(to) => to.copy_from_slice(bytes),
        None => return 0,
    }
    bytes.len()
}

/// Creates an engine, owned by the page.
#[unsafe(no_mangle)]
pub extern "C" fn engine_new() -> Box<Engine> {
    Box::new(Engine {
        session: Session::new(Instant::ZERO),
        arm: VirtualArm::new(0, Plant::DEFAULT),
        record: None,
        input: [0; BUFFER],
        output: [0; BUFFER],
    })
}

/// Returns the buffer that the page writes.
#[unsafe(no_mangle)]
pub extern "C" fn input(engine: &mut Engine) -> *mut u8 {
    engine.input.as_mut_ptr()
}

/// Returns the buffer that the page reads.
#[unsafe(no_mangle)]
pub extern "C" fn output(engine: &Engine) -> *const u8 {
    engine.output.as_ptr()
}

/// Returns the size of each buffer in bytes.
#[unsafe(no_mangle)]
pub extern "C" fn buffer_length() -> usize {
    BUFFER
}

/// Begins a session.
#[unsafe(no_mangle)]
pub extern "C" fn session_start(engine: &mut Engine, now: f64) {
    engine.session = Session::new(instant(now));
}

/// Passes the first `len` bytes of the input from the arm to the session. Returns false if the buffer is shorter.
#[unsafe(no_mangle)]
pub extern "C" fn session_receive(engine: &mut Engine, now: f64, len: usize) -> bool {
    let Engine { session, input, .. } = engine;
    let bytes = input.get(..len);
    bytes.map(|bytes| session.receive(instant(now), bytes)).is_some()
}

/// Writes the next frame for the arm to the output and returns its length; 0 without a frame.
#[unsafe(no_mangle)]
pub extern "C" fn session_transmit(engine: &mut Engine, now: f64) -> usize {
    let Engine { session, output, .. } = engine;
    // The buffer fits every frame.
    session.transmit(instant(now), output).unwrap_or_default()
}

/// Returns the time of the next call of [`session_transmit`]; infinite without a timeout.
#[unsafe(no_mangle)]
pub extern "C" fn session_timeout(engine: &Engine) -> f64 {
    timeout(engine.session.timeout())
}

/// Holds an axis, 0 to 5 for the joints and 6 for the gripper, down (negative) or up (positive), or releases it (0).
/// Returns false for an unknown axis.
#[unsafe(no_mangle)]
pub extern "C" fn session_hold(engine: &mut Engine, now: f64, axis: usize, direction: i32) -> bool {
    let direction = match direction.signum() {
        -1 => Direction::Down,
        0 => Direction::Rest,
        _ => Direction::Up,
    };
    engine.session.hold(instant(now), axis, direction).is_ok()
}

/// Stops the arm, whatever moves it. It keeps its torque.
#[unsafe(no_mangle)]
pub extern "C" fn session_stop(engine: &mut Engine, now: f64) {
    engine.session.stop(instant(now));
}

/// The number of the [`StopState`](crate::session::StopState).
#[unsafe(no_mangle)]
pub extern "C" fn session_stop_state(engine: &Engine) -> u8 {
    engine.session.stop_state() as u8
}

/// Releases all axes and ends their motion.
#[unsafe(no_mangle)]
pub extern "C" fn session_release(engine: &mut Engine, now: f64) {
    engine.session.release(instant(now));
}

/// Enables or disables motion of held axes.
#[unsafe(no_mangle)]
pub extern "C" fn session_enable_motion(engine: &mut Engine, now: f64, enabled: bool) {
    engine.session.enable_motion(instant(now), enabled);
}

/// Sets the speed of held joints in rad/s. Returns false if an arm may not move at it.
#[unsafe(no_mangle)]
pub extern "C" fn session_set_speed(engine: &mut Engine, speed: f32) -> bool {
    let speed = Speed::for_move_radians_per_second(speed);
    speed.map(|speed| engine.session.set_speed(speed)).is_ok()
}

/// Switches the torque and reads it back. With torque off the arm can fall.
#[unsafe(no_mangle)]
pub extern "C" fn session_set_torque(engine: &mut Engine, now: f64, on: bool) {
    let torque = if on { Torque::On } else { Torque::Off };
    engine.session.set_torque(instant(now), torque);
}

/// The number of the [`TorqueState`](crate::session::TorqueState).
#[unsafe(no_mangle)]
pub extern "C" fn session_torque_state(engine: &Engine) -> u8 {
    engine.session.torque_state() as u8
}

/// The number of the [`State`](crate::session::State).
#[unsafe(no_mangle)]
pub extern "C" fn session_state(engine: &Engine) -> u8 {
    engine.session.state() as u8
}

/// The number of the [`Block`](crate::session::Block) of motion; 0 without a block.
#[unsafe(no_mangle)]
pub extern "C" fn session_block(engine: &Engine, now: f64) -> u8 {
    engine.session.block(instant(now)).map_or(0, |block| block as u8)
}

/// The position of an axis: joints 0 to 5 in radians, the gripper, 6, as a fraction of its stroke.
#[unsafe(no_mangle)]
pub extern "C" fn arm_position(engine: &Engine, axis: usize) -> f64 {
    let Some((_, reading)) = engine.session.arm().joints else {
        return f64::NAN;
    };
    number(match axis {
        JOINTS => reading.opening().map(|opening| opening.fraction()).ok(),
        axis => reading
            .positions()
            .ok()
            .and_then(|joints| Some(joints.get(axis)?.radians())),
    })
}

/// The time of the newest reading of the joints.
#[unsafe(no_mangle)]
pub extern "C" fn arm_read_at(engine: &Engine) -> f64 {
    number(engine.session.arm().joints.map(|(at, _)| at.as_micros() as f64))
}

/// The temperature of a servo, 0 to 9, in °C.
#[unsafe(no_mangle)]
pub extern "C" fn arm_temperature(engine: &Engine, servo: usize) -> f64 {
    let celsius = engine.session.arm().temperatures;
    number(celsius.and_then(|celsius| celsius.as_slice().get(servo).copied()))
}

/// The gripper's stroke in millimetres.
#[unsafe(no_mangle)]
pub extern "C" fn arm_stroke(engine: &Engine) -> f64 {
    number(engine.session.arm().stroke.map(|stroke| stroke.millimetres()))
}

/// The mask of the last self-check: bit 0 is servo 1, 1 is normal.
#[unsafe(no_mangle)]
pub extern "C" fn arm_self_check(engine: &Engine) -> f64 {
    number(engine.session.arm().check.map(|check| check.0))
}

/// Writes a text of the arm to the output and returns its length; 0 if the text is unknown. Text 0 is the status, 1 the
/// serial number, escaped, and 2 the version of the firmware.
#[unsafe(no_mangle)]
pub extern "C" fn arm_text(engine: &mut Engine, which: usize) -> usize {
    let Engine { session, output, .. } = engine;
    let arm = session.arm();
    let text = match which {
        0 => arm.joints.map(|(_, reading)| reading.status.to_string()),
        1 => arm.info.map(|info| info.serial.to_string()),
        2 => arm.info.map(|info| info.firmware.to_string()),
        _ => None,
    };
    put(output, text.unwrap_or_default().as_bytes())
}

/// Writes the label of a counter of the line to the output and returns its length; 0 after the last.
#[unsafe(no_mangle)]
pub extern "C" fn counter_label(engine: &mut Engine, nth: usize) -> usize {
    put(
        &mut engine.output,
        counters::LABELS.get(nth).map_or("", |label| label).as_bytes(),
    )
}

/// The value of a counter of the line.
#[unsafe(no_mangle)]
pub extern "C" fn counter_value(engine: &Engine, nth: usize) -> f64 {
    number(engine.session.counters().values().get(nth).map(|value| *value as f64))
}

/// An answer time in microseconds: 0 is that of the newest answer, 1 the shortest, 2 the longest.
#[unsafe(no_mangle)]
pub extern "C" fn answer_time(engine: &Engine, which: usize) -> f64 {
    let times = engine.session.answer_times();
    let times = [times.last, times.shortest, times.longest];
    number(times.get(which).map(|time| time.as_micros() as f64))
}

/// Takes the next record and returns the number of its [`Event`](crate::log::Event); 0 without a record.
#[unsafe(no_mangle)]
pub extern "C" fn record_take(engine: &mut Engine) -> u8 {
    let Engine { session, record, .. } = engine;
    *record = session.take_record();
    record.as_ref().map_or(0, |record| record.event as u8)
}

/// The time of the record.
#[unsafe(no_mangle)]
pub extern "C" fn record_at(engine: &Engine) -> f64 {
    number(engine.record.as_ref().map(|record| record.at.as_micros() as f64))
}

/// Writes the record's bytes to the output and returns their number.
#[unsafe(no_mangle)]
pub extern "C" fn record_bytes(engine: &mut Engine) -> usize {
    let Engine { record, output, .. } = engine;
    record.as_ref().map_or(0, |record| put(output, &record.bytes))
}

/// Writes the record's text to the output and returns its length in bytes.
#[unsafe(no_mangle)]
pub extern "C" fn record_text(engine: &mut Engine) -> usize {
    let Engine { record, output, .. } = engine;
    record.as_ref().map_or(0, |record| put(output, record.text.as_bytes()))
}

/// Replaces the virtual arm by a new one. The seed determines the faults of its line. Its plant is the text in the first
/// `len` bytes of the input, or the default for an empty text.
///
/// Returns 0, or writes the reason why the text is wrong to the output and returns its length. The arm is then unchanged.
#[unsafe(no_mangle)]
pub extern "C" fn virtual_start(engine: &mut Engine, seed: u32, len: usize) -> usize {
    let Engine { input, output, arm, .. } = engine;
    match plant(&input[..len.min(BUFFER)]) {
        Ok(plant) => {
            *arm = VirtualArm::new(seed.into(), plant);
            0
        }
        Err(reason) => put(output, reason.as_bytes()),
    }
}

fn plant(text: &[u8]) -> Result<Plant, String> {
    match str::from_utf8(text) {
        Ok("") => Ok(Plant::DEFAULT),
        Ok(text) => text.parse().map_err(|error: PlantError| error.to_string()),
        Err(error) => Err(error.to_string()),
    }
}

/// Passes the first `len` bytes of the input to the virtual arm. Returns false if the buffer is shorter.
#[unsafe(no_mangle)]
pub extern "C" fn virtual_receive(engine: &mut Engine, now: f64, len: usize) -> bool {
    let Engine { arm, input, .. } = engine;
    let bytes = input.get(..len);
    bytes.map(|bytes| arm.receive(instant(now), bytes)).is_some()
}

/// Writes the bytes from the virtual arm to the output and returns their number.
#[unsafe(no_mangle)]
pub extern "C" fn virtual_transmit(engine: &mut Engine, now: f64) -> usize {
    let Engine { arm, output, .. } = engine;
    arm.transmit(instant(now), output)
}

/// Returns the time of the next call of [`virtual_transmit`]; infinite without a timeout.
#[unsafe(no_mangle)]
pub extern "C" fn virtual_timeout(engine: &Engine) -> f64 {
    timeout(engine.arm.timeout())
}

/// Sets the faults of the virtual arm's line, in parts per million of the bytes of each direction.
#[unsafe(no_mangle)]
pub extern "C" fn virtual_set_faults(
    engine: &mut Engine,
    drop: u32,
    corrupt: u32,
    duplicate: u32,
    delay: u32,
    noise: u32,
) {
    let rates = Rates {
        drop,
        corrupt,
        duplicate,
        delay,
        noise,
        ..Rates::NONE
    };
    engine.arm.set_faults(rates);
}

/// Writes the label of a counter of faults to the output and returns its length; 0 after the last.
#[unsafe(no_mangle)]
pub extern "C" fn virtual_fault_label(engine: &mut Engine, nth: usize) -> usize {
    put(&mut engine.output, FAULTS.get(nth).map_or("", |label| label).as_bytes())
}

/// Returns the number of faults of a kind so far.
#[unsafe(no_mangle)]
pub extern "C" fn virtual_fault_count(engine: &Engine, nth: usize) -> f64 {
    number(engine.arm.injected().get(nth).map(|count| *count as f64))
}
