//! The frames of the documents, as bytes. Their meaning is in `protocol/src/*/tests.rs`.

extern crate std;

use std::vec::Vec;

/// A frame and the request that it answers.
#[derive(Clone, Debug)]
pub struct Vector {
    /// Its name.
    pub name: &'static str,
    /// The request that it answers; none for a request, or for an unsolicited frame.
    pub request: Option<Vec<u8>>,
    /// The frame.
    pub bytes: Vec<u8>,
}

/// The bytes of `text`, in hex.
pub fn hex(text: &str) -> Vec<u8> {
    let bytes = text.split_whitespace().map(|byte| u8::from_str_radix(byte, 16));
    bytes.collect::<Result<_, _>>().expect("hex")
}

/// The name, the bytes and the meaning of each frame. The meanings have the names and the order of the frames.
///
/// # Panics
///
/// The names or their order differ.
pub fn with_meanings<T, const N: usize>(
    vectors: Vec<Vector>,
    meanings: [(&'static str, T); N],
) -> Vec<(&'static str, Vec<u8>, T)> {
    assert_eq!(vectors.len(), N);
    let rows = vectors.into_iter().zip(meanings).map(|(vector, (name, meaning))| {
        assert_eq!(vector.name, name);
        (name, vector.bytes, meaning)
    });
    rows.collect()
}

/// Frames without a request.
fn alone(frames: &[(&'static str, &str)]) -> Vec<Vector> {
    frames
        .iter()
        .map(|(name, bytes)| Vector {
            name,
            request: None,
            bytes: hex(bytes),
        })
        .collect()
}

/// Answers with their requests.
fn answers(frames: &[(&'static str, &str, &str)]) -> Vec<Vector> {
    frames
        .iter()
        .map(|(name, request, bytes)| Vector {
            name,
            request: Some(hex(request)),
            bytes: hex(bytes),
        })
        .collect()
}

/// Requests of a host to a Ling arm.
pub fn ling_requests() -> Vec<Vector> {
    alone(&[
        ("read information", "AA 01 00 01 FE 23 FF"),
        ("set zero", "AA 03 00 01 FE A8 FF"),
        ("set stroke 100 mm", "AA 04 02 01 FE 7F FF"),
        ("set stroke 50 mm", "AA 04 00 01 FE 11 FF"),
        ("set stroke 75 mm", "AA 04 01 01 FE 26 FF"),
        ("read stroke", "AA 04 0E 01 FE 1B FF"),
        ("torque off", "AA 05 00 01 00 6F FF"),
        ("torque on", "AA 05 00 01 01 F9 FF"),
        ("read joints", "AA 06 00 01 FE 9A FF"),
        ("read temperatures", "AA 06 01 01 FE AD FF"),
        ("set temperature limit", "AA 06 01 01 64 F7 FF"),
        ("read velocities", "AA 06 02 01 FE F4 FF"),
        (
            "move, gripper half open",
            "AA 06 03 1C 00 08 E8 03 00 08 E8 03 00 08 E8 03 00 08 E8 03 00 08 E8 03 00 08 E8 03 F4 01 E8 03 6A FF",
        ),
        (
            "move, gripper open",
            "AA 06 03 1C 00 08 E8 03 00 08 E8 03 00 08 E8 03 00 08 E8 03 00 08 E8 03 00 08 E8 03 E8 03 E8 03 23 FF",
        ),
        ("self-check", "AA FE 00 00 FE 93 FF"),
        ("set position mode", "AA 05 01 01 00 58 FF"),
        ("set current mode", "AA 05 01 01 01 CE FF"),
        ("read mode", "AA 06 24 01 FE A6 FF"),
        ("force feedback off", "AA 06 20 01 00 61 FF"),
        ("force feedback on", "AA 06 20 01 01 F7 FF"),
        ("read force feedback", "AA 06 20 01 FE 7A FF"),
    ])
}

/// Answers of a Ling arm.
pub fn ling_answers() -> Vec<Vector> {
    let (stroke, check) = ("AA 04 0E 01 FE 1B FF", "AA FE 00 00 FE 93 FF");
    answers(&[
        (
            "information",
            "AA 01 00 01 FE 23 FF",
            "AA 01 00 18 41 44 4C 53 32 35 31 32 30 35 31 32 33 34 35 36 6E 00 00 00 62 02 00 00 92 FF",
        ),
        ("stroke 75 mm", stroke, "AA 04 0E 01 01 96 FF"),
        ("stroke 50 mm", stroke, "AA 04 0E 01 00 00 FF"),
        ("stroke 100 mm", stroke, "AA 04 0E 01 02 2C FF"),
        (
            "joints",
            "AA 06 00 01 FE 9A FF",
            "AA 06 00 0F 02 08 FB 07 FB 07 02 08 FA 07 01 08 03 08 00 A9 FF",
        ),
        (
            "temperatures",
            "AA 06 01 01 FE AD FF",
            "AA 06 01 0A 23 24 23 26 23 26 23 25 24 24 4B FF",
        ),
        (
            "velocities",
            "AA 06 02 01 FE F4 FF",
            "AA 06 02 14 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 E9 FF",
        ),
        ("self-check, follower", check, "AA FE 00 02 FF 03 87 FF"),
        ("self-check, leader", check, "AA FE 00 02 3F 00 73 FF"),
        (
            "current mode accepted",
            "AA 05 01 01 01 CE FF",
            "AA 05 01 03 01 01 00 38 FF",
        ),
        (
            "current mode unsupported",
            "AA 05 01 01 01 CE FF",
            "AA 05 01 03 01 01 02 14 FF",
        ),
        (
            "mode and currents",
            "AA 06 24 01 FE A6 FF",
            "AA 06 24 34 01 01 06 3F 00 00 00 00 00 00 00 00 0C 00 A2 FE AC FE 1E FB F4 FF 5E 01 54 01 4D 01 \
             01 00 02 00 03 00 04 00 00 80 FF 7F FF FF 00 00 00 00 00 00 00 00 FA 00 6A FF",
        ),
        (
            "force feedback inhibited",
            "AA 06 20 01 01 F7 FF",
            "AA 06 20 0A 02 01 00 05 00 01 01 03 7F 01 D9 FF",
        ),
        (
            "force feedback idle",
            "AA 06 20 01 FE 7A FF",
            "AA 06 20 0A 02 00 00 00 00 00 00 00 00 00 1E FF",
        ),
    ])
}

/// Frames of a Ling arm of the older generation.
pub fn legacy() -> Vec<Vector> {
    alone(&[
        (
            "joints, issue 12",
            "AA 14 12 A9 07 A9 07 E6 0C 19 03 6D 06 92 09 2F 07 ED 04 81 08 00 FF",
        ),
        (
            "joints, issue 11",
            "AA 14 12 18 0C 13 0C B0 0C 4E 03 8F 06 6A 09 92 07 58 05 49 06 01 FF",
        ),
        (
            "joints, firmware 5",
            "AA 04 12 A9 07 A9 07 E6 0C 19 03 6D 06 92 09 2F 07 ED 04 81 08 00 FF",
        ),
        ("gripper", "AA 12 07 01 03 08 FF 08 00 01 00 FF"),
        ("gripper, firmware 5", "AA 02 07 01 03 08 FF 08 00 01 00 FF"),
    ])
}

/// Requests of a host to an xArm.
pub fn xarm_requests() -> Vec<Vector> {
    alone(&[
        ("register 1", "00 01 00 02 00 01 01"),
        ("register 2", "00 01 00 02 00 01 02"),
        ("register 4", "00 01 00 02 00 01 04"),
        ("register 5", "00 01 00 02 00 01 05"),
        ("register 6", "00 01 00 02 00 02 06 06"),
        ("register 10, shut down", "00 01 00 02 00 02 0A 01"),
        ("register 10, reboot", "00 01 00 02 00 02 0A 02"),
        ("register 1, protocol 3", "00 01 00 03 00 01 01"),
        ("register 19", "00 01 00 02 00 02 13 01"),
        ("heartbeat", "00 00 00 01 00 02 00 00"),
    ])
}

/// Answers of an xArm, and its heartbeat.
pub fn xarm_answers() -> Vec<Vector> {
    let mut vectors = answers(&[
        (
            "register 1",
            "00 01 00 02 00 01 01",
            "00 01 00 02 00 2A 01 00 36 2C 36 2C 58 49 31 32 30 32 2C 41 43 31 33 30 32 2C 76 31 2E 31 32 2E 31 30 \
             00 00 00 00 00 00 00 00 00 00 00 00 00 00",
        ),
        (
            "register 2",
            "00 01 00 02 00 01 02",
            "00 01 00 02 00 2A 02 00 58 49 31 32 30 32 30 34 32 30 31 42 30 32 00 41 43 31 33 30 32 30 32 42 30 32 \
             4C 30 32 0A 00 00 00 00 00 00 00 00 00 00",
        ),
        ("register 4", "00 01 00 02 00 01 04", "00 01 00 02 00 02 04 10"),
        (
            "register 5, torque",
            "00 01 00 02 00 01 05",
            "00 01 00 02 00 03 05 00 00",
        ),
        (
            "register 5, current",
            "00 01 00 02 00 01 05",
            "00 01 00 02 00 03 05 00 01",
        ),
        (
            "register 6, 0 mm",
            "00 01 00 02 00 02 06 06",
            "00 01 00 02 00 06 06 10 00 00 00 00",
        ),
        (
            "register 6, 76 mm",
            "00 01 00 02 00 02 06 06",
            "00 01 00 02 00 06 06 00 00 00 98 42",
        ),
        ("register 10", "00 01 00 02 00 02 0A 01", "00 01 00 02 00 02 0A 00"),
        (
            "register 10, length 4",
            "00 01 00 02 00 02 0A 01",
            "00 01 00 02 00 04 0A 00 00 01",
        ),
        ("register 1 refused", "00 01 00 03 00 01 01", "00 01 00 03 00 02 01 08"),
        ("register 13", "00 01 00 02 00 01 0D", "00 01 00 02 00 03 0D 70 02"),
    ]);
    vectors.extend(alone(&[
        ("heartbeat", "00 00 00 01 00 02 00 00"),
        ("Modbus function 3 refused", "00 07 00 00 00 03 01 83 01"),
    ]));
    vectors
}

/// Requests of the PC to an Alpha1 and its servos.
pub fn alpha1_requests() -> Vec<Vector> {
    alone(&[
        ("F1 hardware version", "F1 1F 00 00 00 00 00 00 00 ED"),
        ("EF servo states", "EF FE 00 00 00 00 00 00 00 ED"),
        ("F2 stop", "F2 2F 00 00 00 00 00 00 00 ED"),
        ("F5 firmware version", "F5 5F 01 00 00 00 00 00 01 ED"),
        (
            "FB act",
            "FB BF 01 00 00 00 00 00 5A 5A 5A 5A 5A 5A 5A 5A 5A 5A 5A 5A 5A 5A 5A 5A FF FF FF FF 19 00 1E D4 ED",
        ),
        ("F4 connect", "F4 4F 01 01 00 00 00 00 02 ED"),
        ("F4 disconnect", "F4 4F 01 00 00 00 00 00 01 ED"),
        ("F9 disk", "F9 9F 01 00 00 00 00 00 01 ED"),
        ("F9 serial port", "F9 9F 02 00 00 00 00 00 02 ED"),
        ("F9 HID", "F9 9F 03 00 00 00 00 00 03 ED"),
        ("F3 play", "F3 3F 06 64 61 6E 63 65 01 ED"),
        ("F3 play nothing", "F3 3F 01 01 ED"),
        ("FA 01 move", "FA AF 01 01 5A 32 00 32 C0 ED"),
        ("FA 01 move all", "FA AF 00 01 5A 32 00 32 BF ED"),
        ("FA 01 release", "FA AF 01 01 FF 00 00 00 01 ED"),
        ("FA 04 LED 1", "FA AF 01 04 01 00 00 00 06 ED"),
        ("FA 04 LED 0", "FA AF 01 04 00 00 00 00 05 ED"),
        ("FA 02 read angles", "FA AF 01 02 00 00 00 00 03 ED"),
        ("FA CD change id", "FA AF 01 CD 00 02 00 00 D0 ED"),
        ("FA D2 set offset", "FA AF 01 D2 00 00 FF A6 78 ED"),
        ("FA D4 read offset", "FA AF 01 D4 00 00 00 00 D5 ED"),
        ("FC 01 version", "FC CF 01 01 00 00 00 00 02 ED"),
    ])
}

/// Answers of an Alpha1.
pub fn alpha1_answers() -> Vec<Vector> {
    let (version, firmware) = ("F1 1F 00 00 00 00 00 00 00 ED", "F5 5F 01 00 00 00 00 00 01 ED");
    let (states, stop) = ("EF FE 00 00 00 00 00 00 00 ED", "F2 2F 00 00 00 00 00 00 00 ED");
    let act = "FB BF 01 00 00 00 00 00 5A 5A 5A 5A 5A 5A 5A 5A 5A 5A 5A 5A 5A 5A 5A 5A FF FF FF FF 19 00 1E D4 ED";
    let (connect, usb) = ("F4 4F 01 01 00 00 00 00 02 ED", "F9 9F 01 00 00 00 00 00 01 ED");
    let play = "F3 3F 06 64 61 6E 63 65 01 ED";
    let longest = std::format!("F1 1F 3C {}6E ED", "76 ".repeat(59));
    answers(&[
        (
            "F1 hardware version",
            version,
            "F1 1F 0C 41 6C 70 68 61 31 5F 56 32 2E 30 68 ED",
        ),
        ("F1 empty", version, "F1 1F 01 01 ED"),
        ("F1 longest", version, &longest),
        ("EF servos 1, 3 and 16", states, "EF FE 00 00 80 05 85 ED"),
        ("EF data and CHECK like a terminator", states, "EF FE 00 00 00 ED ED ED"),
        ("F2 stopped", stop, "F2 2F AA ED"),
        ("F2 not stopped", stop, "F2 2F EE ED"),
        (
            "F5 firmware version",
            firmware,
            "F5 5F AA 32 30 31 35 31 32 31 35 31 39 A5 ED",
        ),
        ("F5 failure", firmware, "F5 5F EE 00 00 00 00 00 00 00 00 00 00 EE ED"),
        ("FB acted", act, "FB BF 01 AA 00 00 00 00 AB ED"),
        ("FB failure", act, "FB BF 01 EE 00 00 00 00 EF ED"),
        ("F4 done", connect, "F4 4F AA ED"),
        ("F4 failure", connect, "F4 4F EE ED"),
        ("F9 done", usb, "F9 9F AA ED"),
        ("F9 failure", usb, "F9 9F EE ED"),
        ("F3 playing", play, "F3 3F AA ED"),
        ("F3 failure", play, "F3 3F EE ED"),
    ])
}

/// Answers of the servos of an Alpha1.
pub fn alpha1_servo_answers() -> Vec<Vector> {
    let offset = "FA AF 01 D2 00 00 FF A6 78 ED";
    answers(&[
        ("FA 01 moved", "FA AF 01 01 5A 32 00 32 C0 ED", "AB"),
        (
            "FA 02 angles",
            "FA AF 01 02 00 00 00 00 03 ED",
            "FA AF 01 AA 00 5A 00 5A 5F ED",
        ),
        (
            "FA CD id changed",
            "FA AF 01 CD 00 02 00 00 D0 ED",
            "FA AF 02 AA 00 01 00 00 AD ED",
        ),
        ("FA D2 offset set", offset, "FA AF 01 AA 00 00 00 00 AB ED"),
        ("FA D2 failure", offset, "FA AF 01 EE 00 00 00 00 EF ED"),
        (
            "FA D4 offset",
            "FA AF 01 D4 00 00 00 00 D5 ED",
            "FA AF 01 AA 00 00 FF A6 50 ED",
        ),
        (
            "FC 01 version",
            "FC CF 01 01 00 00 00 00 02 ED",
            "FC CF 01 AA 41 16 51 01 54 ED",
        ),
    ])
}
