//! A tour of an arm's functions, with its results.

use std::error::Error;
use std::io::{self, Write, stdout};

use armwire::ling::arrival::{Arrival, Arrived, Tolerances};
use armwire::ling::{
    GripperSpeed, JointState, Kind, Move, Opening, PerServo, Position, Request, Response, Speed, Torque,
};
use armwire::time::Instant;
use armwire_bridge::Counters;
use armwire_bridge::Duration;
use armwire_sim::ling::LingArm;
use armwire_virtual_board::{Nanos, VirtualBoard, usb};

use crate::host::Host;

/// Targets of the joints, in degrees.
const TARGET: [f32; 6] = [30.0, -20.0, 45.0, 0.0, 60.0, -90.0];

/// Number of reads of the joints for the figures.
const READS: u32 = 500;

/// Polling period during a move.
const POLL_PERIOD: Duration = Duration::from_millis(100);

pub(crate) fn run(board: VirtualBoard<LingArm>) -> Result<(), Box<dyn Error>> {
    let mut host = Host::new(board);
    plug_in(&mut host)?;
    let kind = identify(&mut host)?;
    show_joints(&mut host)?;
    gripper_type(&mut host)?;
    travel(&mut host)?;
    temperatures(&mut host)?;
    self_check(&mut host, kind)?;
    torque_off(&mut host)?;
    measure(&mut host)?;
    account(&mut host)
}

fn print_row(label: &str, took: Nanos, text: impl std::fmt::Display) -> io::Result<()> {
    writeln!(stdout(), "{label:<12} {:>9.2} us  {text}", took.0 as f64 / 1_000.0)
}

fn plug_in(host: &mut Host) -> Result<(), Box<dyn Error>> {
    let chip = host.board.chip();
    writeln!(
        stdout(),
        "It is on the UART of a virtual {chip}, which runs the shipped firmware image."
    )?;
    host.open()?;
    let at = host.board.now();
    let usb = host.board.usb();
    let device = usb.device().ok_or("the adapter is gone")?;
    writeln!(
        stdout(),
        "usb          {:04x}:{:04x} {}, serial number {}; open at 1 Mbaud {:.1} ms after power-on",
        device.device.vendor,
        device.device.product,
        device.product.as_deref().unwrap_or("without a name"),
        device.serial.as_deref().unwrap_or("none"),
        at.0 as f64 / 1e6
    )?;
    Ok(())
}

fn identify(host: &mut Host) -> Result<Kind, Box<dyn Error>> {
    let (answer, took) = host.call(Request::ReadInfo)?;
    let Some(Response::Info(info)) = answer else {
        return Err(unexpected(answer));
    };
    let kind = info.serial.kind().ok_or("an arm of unknown kind")?;
    print_row(
        "identify",
        took,
        format_args!(
            "{} ({kind:?}), hardware {}, firmware {}",
            info.serial, info.hardware, info.firmware
        ),
    )?;
    Ok(kind)
}

fn read_joints(host: &mut Host) -> Result<(JointState, Nanos), Box<dyn Error>> {
    match host.call(Request::ReadJoints)? {
        (Some(Response::Joints(state)), took) => Ok((state, took)),
        (answer, _) => Err(unexpected(answer)),
    }
}

fn show_joints(host: &mut Host) -> Result<(), Box<dyn Error>> {
    let (state, took) = read_joints(host)?;
    print_row("joints", took, pose(&state)?)?;
    Ok(())
}

/// The joints in degrees, the gripper in percent, and the status.
fn pose(state: &JointState) -> Result<String, Box<dyn Error>> {
    let joints: Vec<String> = state
        .positions()?
        .iter()
        .map(|position| format!("{:+7.2}", position.radians().to_degrees()))
        .collect();
    let gripper = state.opening()?.fraction() * 100.0;
    Ok(format!(
        "{} deg, gripper {gripper:3.0} %, {}",
        joints.join(" "),
        state.status
    ))
}

fn gripper_type(host: &mut Host) -> Result<(), Box<dyn Error>> {
    let (answer, took) = host.call(Request::ReadStroke)?;
    let Some(Response::Stroke(stroke)) = answer else {
        return Err(unexpected(answer));
    };
    print_row("gripper", took, format_args!("{} mm stroke", stroke.millimetres()))?;
    Ok(())
}

/// Moves the joints and opens the gripper, and shows the progress.
fn travel(host: &mut Host) -> Result<(), Box<dyn Error>> {
    let mut joints = [(Position::CENTRE, Speed::new(700)?); 6];
    for (joint, degrees) in joints.iter_mut().zip(TARGET) {
        joint.0 = Position::from_radians(degrees.to_radians())?;
    }
    let target = Move {
        joints,
        gripper: (Opening::OPEN, GripperSpeed(700)),
    };
    let (_, took) = host.call(Request::SetTorque(Torque::On))?;
    print_row("torque on", took, "delivered, no answer expected")?;
    let (_, took) = host.call(Request::Move(target))?;
    print_row("move", took, "delivered, no answer expected")?;

    let start = host.board.now();
    let mut arrival = Arrival::new(target, Tolerances::MOVE);
    loop {
        let (state, took) = read_joints(host)?;
        let passed = host.board.now().since(start);
        let seconds = passed.0 as f64 / 1e9;
        print_row("", took, format_args!("{seconds:4.1} s {}", pose(&state)?))?;
        match arrival.on_joints(Instant::from_micros(passed.0 / 1_000), &state) {
            Arrived::AtTarget(deviations) if deviations.are_small() => return Ok(()),
            // A servo holds a load by its error.
            Arrived::AtTarget(deviations) => return Ok(print_row("at rest", took, deviations)?),
            Arrived::NotYet(_) if seconds <= 10.0 => host.board.run_for(POLL_PERIOD)?,
            _ => return Err("the arm did not arrive".into()),
        }
    }
}

fn temperatures(host: &mut Host) -> Result<(), Box<dyn Error>> {
    let (answer, took) = host.call(Request::ReadTemperatures)?;
    let Some(Response::Temperatures(celsius)) = answer else {
        return Err(unexpected(answer));
    };
    print_row("temperature", took, format_args!("{} deg C", list(&celsius)))?;
    let (answer, took) = host.call(Request::ReadVelocities)?;
    let Some(Response::Velocities(ticks)) = answer else {
        return Err(unexpected(answer));
    };
    print_row("velocity", took, format_args!("{} ticks/s", list(&ticks)))?;
    Ok(())
}

fn list<T: ToString>(readings: &PerServo<T>) -> String {
    let readings: Vec<String> = readings.as_slice().iter().map(T::to_string).collect();
    readings.join(" ")
}

fn self_check(host: &mut Host, kind: Kind) -> Result<(), Box<dyn Error>> {
    let (answer, took) = host.call(Request::SelfCheck)?;
    let Some(Response::SelfCheck(check)) = answer else {
        return Err(unexpected(answer));
    };
    if !check.all_normal(kind) {
        return Err(format!("faulty servos: {:?}", check.faulty(kind).collect::<Vec<_>>()).into());
    }
    print_row("self-check", took, format_args!("all {} servos normal", kind.servos()))?;
    Ok(())
}

fn torque_off(host: &mut Host) -> Result<(), Box<dyn Error>> {
    let (_, took) = host.call(Request::SetTorque(Torque::Off))?;
    print_row("torque off", took, "delivered, no answer expected")?;
    Ok(())
}

/// Reads the joints repeatedly, at every phase of the USB frame.
fn measure(host: &mut Host) -> Result<(), Box<dyn Error>> {
    host.figures = Default::default();
    for nth in 0..READS {
        host.board.run_for(Duration::from_micros(u64::from(nth % 7)))?;
        read_joints(host)?;
    }
    writeln!(stdout())?;
    writeln!(stdout(), "{}", host.figures)?;
    Ok(())
}

/// The counters, and the check of the firmware's behaviour.
fn account(host: &mut Host) -> Result<(), Box<dyn Error>> {
    let (kind, request) = Counters::READ_REQUEST;
    let request = usb::host::Request::read(kind, request, 0, 0, Counters::MAX_LEN as u16);
    let counters = Counters::from_bytes(&host.board.usb().control(request)?)?;
    let counters = format!("{counters:#?}");
    let counters = counters.lines().filter_map(|line| line.trim().strip_suffix(','));
    let seen: Vec<_> = counters.filter(|count| !count.ends_with(": 0")).collect();
    let arm = host.board.with_arm(|arm| arm.counters());
    writeln!(stdout())?;
    writeln!(stdout(), "the adapter counted {}", seen.join(", "))?;
    writeln!(
        stdout(),
        "the arm received {} bytes, {} requests; {} unknown, {} bytes of noise",
        arm.bytes,
        arm.requests,
        arm.unknown,
        arm.noise_bytes
    )?;
    host.board.check()?;
    writeln!(
        stdout(),
        "the firmware used modelled features only; {:.3} s of virtual time, trace {:016x}",
        host.board.now().0 as f64 / 1e9,
        host.board.trace_hash()
    )?;
    Ok(())
}

fn unexpected(answer: Option<Response>) -> Box<dyn Error> {
    format!("unexpected answer: {answer:?}").into()
}
