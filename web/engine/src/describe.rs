//! Messages as text, in degrees, percent and °C.

use std::fmt::{self, Display, Formatter, Write};

use armwire::ling::{
    Info, JOINTS, JointState, Kind, Ling, Move, Opening, Position, Request, Response, SelfCheck, TICKS_PER_TURN, Torque,
};
use armwire::messages::Messages;

/// Formats a number of tenths with one decimal. It uses integers: float formatting would be a fifth of the module.
struct Tenths(i32);

impl Display for Tenths {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let sign = if self.0 < 0 { "-" } else { "" };
        let tenths = self.0.unsigned_abs();
        write!(f, "{sign}{}.{}", tenths / 10, tenths % 10)
    }
}

/// Describes a frame from the host.
pub fn request(frame: &[u8]) -> String {
    Ling.parse_request(frame)
        .map_or_else(|error| error.to_string(), request_text)
}

fn request_text(request: Request) -> String {
    let (verb, number) = match request {
        Request::ReadInfo => ("read information", None),
        Request::SetZero => ("set zero position", None),
        Request::SetStroke(stroke) => ("set gripper stroke in mm:", Some(stroke.millimetres())),
        Request::ReadStroke => ("read gripper stroke", None),
        Request::SetTorque(Torque::On) => ("torque on", None),
        Request::SetTorque(Torque::Off) => ("torque off", None),
        Request::ReadJoints => ("read joints", None),
        Request::ReadTemperatures => ("read temperatures", None),
        Request::SetTemperatureLimit(limit) => ("set temperature limit in °C:", Some(limit.celsius())),
        Request::ReadVelocities => ("read velocities", None),
        Request::Move(target) => return motion(&target),
        Request::SelfCheck => ("self-check", None),
        // A request of a later version of the crate.
        _ => ("other request", None),
    };
    match number {
        Some(number) => format!("{verb} {number}"),
        None => verb.into(),
    }
}

/// Describes a frame from the arm.
///
/// # Errors
///
/// The parse error as text, if the frame is not a response. An echoed request is one example.
pub fn response(frame: &[u8]) -> Result<String, String> {
    Ling.parse_response(frame, ())
        .map(|response| response_text(response) + &extra(Ling.extra(frame)))
        .map_err(|error| match Ling.parse_request(frame) {
            Ok(request) => "echo: ".to_owned() + &request_text(request),
            Err(_) => error.to_string(),
        })
}

/// Formats bytes after the documented fields of a response.
fn extra(bytes: &[u8]) -> String {
    let mut text = String::new();
    for (nth, byte) in bytes.iter().enumerate() {
        let label = if nth == 0 { ", extra bytes" } else { "" };
        write(&mut text, format_args!("{label} {byte:02X}"));
    }
    text
}

fn response_text(response: Response) -> String {
    match response {
        Response::Info(info) => info_text(&info),
        Response::Stroke(stroke) => format!("gripper stroke {} mm", stroke.millimetres()),
        Response::Joints(state) => joints(&state),
        Response::Temperatures(celsius) => list("temperatures in °C:", celsius.as_slice().iter().map(|&n| n.into())),
        Response::Velocities(ticks) => list("velocities in ticks/s:", ticks.as_slice().iter().copied()),
        Response::SelfCheck(check) => self_check(check),
        // A response of a later version of the crate.
        _ => "other response".into(),
    }
}

fn info_text(info: &Info) -> String {
    let arm = match info.serial.kind() {
        Some(Kind::Leader) => "leader",
        Some(Kind::Follower) => "follower",
        None => "unknown kind",
    };
    let (serial, hardware, firmware) = (info.serial, info.hardware, info.firmware);
    format!("{arm}, serial {serial}, hardware {hardware}, firmware {firmware}")
}

fn joints(state: &JointState) -> String {
    let mut text = angles("joints", state.joints);
    let out_of_range = match (state.positions(), state.opening()) {
        (Ok(_), Ok(_)) => "",
        _ => " (out of range)",
    };
    let gripper = Tenths(state.gripper.into());
    write(
        &mut text,
        format_args!(", gripper {gripper} %, {}{out_of_range}", state.status),
    );
    text
}

/// Describes targets, and the highest speed of a joint.
fn motion(target: &Move) -> String {
    let mut text = angles("move to", target.joints.map(|(position, _)| position.ticks()));
    let ticks = target.joints.iter().map(|(_, speed)| speed.ticks_per_second()).max();
    let speed = Tenths(tenths_of_degrees(ticks.unwrap_or_default().into()));
    let gripper = Tenths(target.gripper.0.per_mille().into());
    write(&mut text, format_args!(", gripper {gripper} %, at {speed}°/s"));
    text
}

fn self_check(check: SelfCheck) -> String {
    if check.all_normal(Kind::Follower) {
        return "all servos normal".into();
    }
    let mut text = list("servos not normal:", check.faulty(Kind::Follower).map(u16::from));
    if check.0 & 0b11_1100_0000 == 0 {
        text += " (a leader has none of 7 to 10)";
    }
    text
}

fn list(label: &str, values: impl Iterator<Item = u16>) -> String {
    let mut text = label.to_owned();
    values.for_each(|value| write(&mut text, format_args!(" {value}")));
    text
}

/// Formats joint positions in ticks as angles.
fn angles(label: &str, ticks: [u16; JOINTS]) -> String {
    let mut text = label.to_owned();
    for ticks in ticks {
        let centred = i32::from(ticks) - i32::from(Position::CENTRE.ticks());
        write(&mut text, format_args!(" {}°", Tenths(tenths_of_degrees(centred))));
    }
    text
}

/// Rounds to the nearest tenth of a degree.
fn tenths_of_degrees(ticks: i32) -> i32 {
    let turn = i32::from(TICKS_PER_TURN);
    (ticks * 3600 + turn / 2 * ticks.signum()) / turn
}

fn write(text: &mut String, arguments: fmt::Arguments<'_>) {
    // Writing to a `String` never fails.
    let _ = text.write_fmt(arguments);
}

const _: () = assert!(Opening::OPEN.per_mille() == 1000, "tenths of a percent are per mille");

#[cfg(test)]
mod tests {
    use super::*;

    // Frames of the document, and checksums of the crate.
    const READING: [u8; 21] = [
        0xAA, 0x06, 0x00, 0x0F, 0x00, 0x04, 0xFB, 0x07, 0xFB, 0x07, 0x02, 0x08, 0xFA, 0x07, 0x01, 0x08, 0xF4, 0x01,
        0x01, 0x00, 0xFF,
    ];

    #[test]
    fn request_is_described_by_verb_and_values() {
        assert_eq!(request(&armwire::ling::TORQUE_OFF), "torque off");
        let target = [
            0xAA, 0x06, 0x03, 0x1C, 0x00, 0x08, 0xE8, 0x03, 0x00, 0x0C, 0xE8, 0x03, 0x00, 0x08, 0xE8, 0x03, 0x00, 0x08,
            0xE8, 0x03, 0x00, 0x08, 0xE8, 0x03, 0x00, 0x08, 0xE8, 0x03, 0xF4, 0x01, 0xE8, 0x03, 0x6A, 0xFF,
        ];
        assert_eq!(
            request(&target),
            "move to 0.0° 90.0° 0.0° 0.0° 0.0° 0.0°, gripper 50.0 %, at 87.9°/s"
        );
    }

    #[test]
    fn joints_are_described_in_degrees_and_percent() {
        let text = "joints -90.0° -0.4° -0.4° 0.2° -0.5° 0.1°, gripper 50.0 %, locked";
        assert_eq!(response(&READING).as_deref(), Ok(text));
    }

    #[test]
    fn gripper_beyond_its_stroke_is_out_of_range() {
        let mut frame = READING;
        frame[16..18].copy_from_slice(&2051_u16.to_le_bytes());
        assert!(
            response(&frame)
                .unwrap()
                .ends_with("gripper 205.1 %, locked (out of range)")
        );
    }

    #[test]
    fn serial_number_is_escaped() {
        let mut frame = [0; 30];
        frame[..4].copy_from_slice(&[0xAA, 0x01, 0x00, 0x18]);
        frame[4..9].copy_from_slice(b"A\x1b<b>");
        let text = response(&frame).unwrap();
        assert!(text.contains("serial A\\x1b<b>,"), "{text}");
    }

    #[test]
    fn request_from_the_arm_is_an_echo() {
        let text = "echo: read joints".to_owned();
        assert_eq!(response(&armwire::ling::READ_JOINTS), Err(text));
    }

    #[test]
    fn frame_of_wrong_length_is_described_by_error() {
        let text = "command 06 function 00: 3 data bytes, expected 15".to_owned();
        assert_eq!(
            response(&[0xAA, 0x06, 0x00, 0x03, 0x00, 0x00, 0x00, 0x5F, 0xFF]),
            Err(text)
        );
    }

    #[test]
    fn self_check_names_the_faulty_servos() {
        let leader = "servos not normal: 7 8 9 10 (a leader has none of 7 to 10)";
        assert_eq!(self_check(SelfCheck(0x003F)), leader);
        assert_eq!(self_check(SelfCheck(0x03FF)), "all servos normal");
        assert_eq!(self_check(SelfCheck(0x03FB)), "servos not normal: 3");
    }
}
