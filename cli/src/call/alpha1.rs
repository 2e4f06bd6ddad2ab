//! The requests of an Alpha1 and of its servos.

use armwire::OutOfRange;
use armwire::alpha1::{
    Action, Address, Angle, INSTALLED, Interval, Led, MoveTime, Offset, OffsetTool, Request, SERVOS, ServoId,
    ServoRequest, Text, UsbType,
};
use clap::{Args, Subcommand};

use super::values::{made, one_of, parse, seconds, whole};

/// One request.
#[derive(Subcommand)]
pub(crate) enum Command {
    /// Read the robot's hardware version.
    HardwareVersion,
    /// Read the states of the servos: running or powered off. An Alpha1 has servos 1 to 16 of the 32.
    ServoStates,
    /// Stop the action that is played.
    Stop,
    /// Read the robot's firmware version.
    FirmwareVersion,
    /// Move all servos.
    #[command(
        override_usage = "armwire call alpha1 <PORT> act --angles <DEGREES> --time <SECONDS>\n       --interval <SECONDS>"
    )]
    Act(Act),
    /// Connect or disconnect the servo offset tool. While it is connected, Bluetooth may not be used.
    OffsetTool {
        /// New state of the tool.
        #[arg(value_parser = one_of([("connect", OffsetTool::Connect), ("disconnect", OffsetTool::Disconnect)]))]
        tool: OffsetTool,
    },
    /// Set the robot's USB device type.
    UsbType {
        /// USB device type: disk (this protocol is then unavailable), vcp (serial port) or hid.
        #[arg(value_parser = one_of([("disk", UsbType::Disk), ("vcp", UsbType::SerialPort), ("hid", UsbType::Hid)]))]
        kind: UsbType,
    },
    /// Play an action.
    Play {
        /// Name of the action, at most 254 bytes.
        #[arg(value_parser = text)]
        name: Name,
    },
    /// Command a single servo, through the robot or on the servos' own bus.
    #[command(subcommand)]
    Servo(Servo),
}

/// One frame of an action.
#[derive(Args)]
pub(crate) struct Act {
    /// Targets of servos 1 to 16, or 1 to 20, in degrees, 0 to 240, with commas between. 'release' instead of a target
    /// may switch a motor off: a load that it holds falls. An Alpha1 has no servos 17 to 20.
    #[arg(long, value_name = "DEGREES", allow_hyphen_values = true, value_parser = angles)]
    angles: Angles,
    /// Duration of the motion, in seconds, 0 to 5.1.
    #[arg(long, value_name = "SECONDS", allow_hyphen_values = true, value_parser = time)]
    time: MoveTime,
    /// Time until the robot accepts the next frame, in seconds, 0 to 1310.7.
    #[arg(long, value_name = "SECONDS", allow_hyphen_values = true, value_parser = interval)]
    interval: Interval,
}

/// A target for each servo, or none for a release.
type Angles = [Option<Angle>; SERVOS];

/// The name of an action, which is a [`Text`].
#[derive(Clone)]
pub(crate) struct Name(Box<[u8]>);

impl Name {
    fn text(&self) -> Text<'_> {
        Text::new(&self.0).expect("it was checked when it was parsed")
    }
}

/// The servo that receives the request.
#[derive(Args, Clone, Copy)]
pub(crate) struct One {
    /// Its id, 1 to 240.
    #[arg(allow_negative_numbers = true, value_parser = id)]
    id: ServoId,
}

/// The servos that receive the request.
#[derive(Args, Clone, Copy)]
pub(crate) struct To {
    /// Its id, 1 to 240, or all.
    #[arg(value_name = "ID", allow_negative_numbers = true, value_parser = address)]
    to: Address,
}

/// One request to a servo.
#[derive(Subcommand)]
pub(crate) enum Servo {
    /// Move a servo.
    #[command(
        override_usage = "armwire call alpha1 <PORT> servo move --time <SECONDS>\n       --lock <SECONDS> <ID> <DEGREES>"
    )]
    Move {
        #[command(flatten)]
        to: To,
        /// Target in degrees, 0 to 240.
        #[arg(value_name = "DEGREES", allow_negative_numbers = true, value_parser = angle)]
        angle: Angle,
        /// Duration of the motion, in seconds, 0 to 5.1.
        #[arg(long, value_name = "SECONDS", allow_hyphen_values = true, value_parser = time)]
        time: MoveTime,
        /// Completion time, also called lock time, in seconds, 0 to 1310.7.
        #[arg(long, value_name = "SECONDS", allow_hyphen_values = true, value_parser = completion_time)]
        lock: Interval,
    },
    /// Switch the motor off. A load that it holds falls.
    Release(To),
    /// Set the LED.
    Led {
        #[command(flatten)]
        to: To,
        /// Raw value, 0 to 255. The sources disagree whether 0 or 1 is on.
        #[arg(allow_negative_numbers = true, value_parser = whole::<u8>(0..=u8::MAX.into()))]
        value: u8,
    },
    /// Read the target and actual angle. The read switches the motor off: a load that it holds falls.
    ReadAngles(One),
    /// Give a servo another id.
    ChangeId {
        /// Current id, 1 to 240.
        #[arg(allow_negative_numbers = true, value_parser = id)]
        from: ServoId,
        /// New id, 1 to 240.
        #[arg(allow_negative_numbers = true, value_parser = id)]
        to: ServoId,
    },
    /// Set the servo's zero offset.
    SetOffset {
        #[command(flatten)]
        servo: One,
        /// In degrees, -30 to 30, in steps of a third.
        #[arg(value_name = "DEGREES", allow_hyphen_values = true, value_parser = offset)]
        offset: Offset,
    },
    /// Read the servo's zero offset.
    ReadOffset(One),
    /// Read the version of the servo's firmware.
    Version(One),
}

impl Command {
    pub(super) fn request(&self) -> Request<'_> {
        match self {
            Self::HardwareVersion => Request::ReadHardwareVersion,
            Self::ServoStates => Request::ReadServoStates,
            Self::Stop => Request::Stop,
            Self::FirmwareVersion => Request::ReadFirmwareVersion,
            &Self::Act(Act { angles, time, interval }) => Request::Act(Action { angles, time, interval }),
            Self::OffsetTool { tool } => Request::SetOffsetTool(*tool),
            Self::UsbType { kind } => Request::SetUsbType(*kind),
            Self::Play { name } => Request::Play(name.text()),
            Self::Servo(servo) => Request::Servo(servo.request()),
        }
    }
}

impl Servo {
    fn request(&self) -> ServoRequest {
        match *self {
            Self::Move {
                to: To { to },
                angle,
                time,
                lock,
            } => ServoRequest::Move { to, angle, time, lock },
            Self::Release(To { to }) => ServoRequest::Release(to),
            Self::Led { to: To { to }, value } => ServoRequest::SetLed { to, led: Led(value) },
            Self::ReadAngles(One { id }) => ServoRequest::ReadAngles(id),
            Self::ChangeId { from, to } => ServoRequest::ChangeId { from, to },
            Self::SetOffset { servo, offset } => ServoRequest::SetOffset(servo.id, offset),
            Self::ReadOffset(One { id }) => ServoRequest::ReadOffset(id),
            Self::Version(One { id }) => ServoRequest::ReadVersion(id),
        }
    }
}

fn angle(text: &str) -> Result<Angle, String> {
    made(text, "a whole number of degrees from 0 to 240", Angle::new)
}

fn angles(text: &str) -> Result<Angles, String> {
    let mut angles = [None; SERVOS];
    let texts: Vec<_> = text.split(',').collect();
    if ![INSTALLED, SERVOS].contains(&texts.len()) {
        return Err(format!(
            "an action has {INSTALLED} or {SERVOS} targets, not {}: no document says what a servo without one does",
            texts.len()
        ));
    }
    for (target, text) in angles.iter_mut().zip(texts) {
        *target = match text.trim() {
            "release" => None,
            text => Some(angle(text).map_err(|error| format!("{error} ('release' has no target)"))?),
        };
    }
    Ok(angles)
}

fn time(text: &str) -> Result<MoveTime, String> {
    MoveTime::from_duration(seconds(text)?).map_err(|error| error.to_string())
}

fn interval(text: &str) -> Result<Interval, String> {
    Interval::from_duration(seconds(text)?).map_err(|error| error.to_string())
}

fn completion_time(text: &str) -> Result<Interval, String> {
    Interval::from_duration(seconds(text)?).map_err(|error| {
        let what = "completion time";
        OutOfRange { what, ..error }.to_string()
    })
}

fn text(text: &str) -> Result<Name, String> {
    match Text::new(text.as_bytes()) {
        Ok(_) => Ok(Name(text.as_bytes().into())),
        Err(error) => Err(error.to_string()),
    }
}

fn id(text: &str) -> Result<ServoId, String> {
    made(text, "an id from 1 to 240", ServoId::new)
}

fn address(text: &str) -> Result<Address, String> {
    match text {
        "all" => Ok(Address::All),
        text => id(text).map(Address::One),
    }
}

fn offset(text: &str) -> Result<Offset, String> {
    /// Half of a hundredth of a degree, in thirds of a degree: a third is typed with two decimals.
    const ROUNDING: f32 = 0.015;
    let degrees: f32 = parse(text, "a number")?;
    let (min, max) = (Offset::MIN.degrees(), Offset::MAX.degrees());
    if !(min..=max).contains(&degrees) {
        return Err(OutOfRange::new("servo offset", "degrees", degrees, min, max).to_string());
    }
    let thirds = degrees * 3.0;
    if (thirds - thirds.round()).abs() > ROUNDING {
        let [below, above] = [thirds.floor(), thirds.ceil()].map(|thirds| thirds / 3.0);
        return Err(format!(
            "a servo's offset has steps of a third of a degree: {below:.2} or {above:.2}, not {degrees}"
        ));
    }
    Offset::new(thirds.round() as i16).map_err(|error| error.to_string())
}
