//! Frames as text: their messages, or the reason why they are none.

use std::fmt::Write;

use armwire::ling::Ling;
use armwire::messages::Messages;

/// Describes a frame from the host.
pub fn request(frame: &[u8]) -> String {
    match Ling.parse_request(frame) {
        Ok(request) => request.to_string(),
        Err(error) => error.to_string(),
    }
}

/// Describes a frame from the arm.
///
/// # Errors
///
/// The parse error as text, if the frame is not a response. An echoed request is one example.
pub fn response(frame: &[u8]) -> Result<String, String> {
    match (Ling.parse_response(frame, ()), Ling.parse_request(frame)) {
        (Ok(response), _) => Ok(response.to_string() + &extra(Ling.extra(frame))),
        (Err(_), Ok(request)) => Err(format!("echo: {request}")),
        (Err(error), Err(_)) => Err(error.to_string()),
    }
}

/// Formats bytes after the documented fields of a response.
fn extra(bytes: &[u8]) -> String {
    let mut text = String::new();
    for (nth, byte) in bytes.iter().enumerate() {
        let label = if nth == 0 { ", extra:" } else { "" };
        // Writing to a `String` never fails.
        let _ = write!(text, "{label} {byte:02X}");
    }
    text
}

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
            "move +0.00° at 87.9°/s +90.00° at 87.9°/s +0.00° at 87.9°/s +0.00° at 87.9°/s +0.00° at 87.9°/s +0.00° at \
             87.9°/s, gripper 50.0 % at 1000 ticks/s"
        );
    }

    #[test]
    fn joints_are_described_in_degrees_and_percent() {
        let text = "joints: -90.00° -0.44° -0.44° +0.18° -0.53° +0.09°, gripper: 50.0 % open, status: locked";
        assert_eq!(response(&READING).as_deref(), Ok(text));
    }

    #[test]
    fn serial_number_is_escaped() {
        let mut frame = [0; 30];
        frame[..4].copy_from_slice(&[0xAA, 0x01, 0x00, 0x18]);
        frame[4..9].copy_from_slice(b"A\x1b<b>");
        let text = response(&frame).unwrap();
        assert!(text.contains("serial: A\\x1b<b>,"), "{text}");
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
    fn bytes_after_the_fields_are_shown() {
        let frame = [0xAA, 0x04, 0x0E, 0x03, 0x02, 0x07, 0x08, 0xA1, 0xFF];
        assert_eq!(response(&frame).as_deref(), Ok("stroke: 100 mm, extra: 07 08"));
    }
}
