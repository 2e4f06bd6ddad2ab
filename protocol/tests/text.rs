//! The text of every request and every answer.

use std::fmt::Display;
use std::time::Duration;

use armwire::ling::legacy;
use armwire::{alpha1, ling, xarm};

/// Checks messages and their texts.
fn check<M: Display, const N: usize>(messages: [(M, &str); N]) {
    for (message, text) in messages {
        assert_eq!(message.to_string(), text);
    }
}

#[test]
fn ling_requests_have_their_values_with_units() {
    use ling::{ControlMode, GripperSpeed, Move, Opening, Position, Request, Speed, Stroke, TemperatureLimit, Torque};

    let (position, speed) = (Position::new(3072).unwrap(), Speed::new(1000).unwrap());
    let mut joints = [(Position::CENTRE, Speed::MAX); 6];
    joints[1] = (position, speed);
    let target = Move {
        joints,
        gripper: (Opening::new(505).unwrap(), GripperSpeed(5500)),
    };
    check([
        (Request::ReadInfo, "read information"),
        (Request::SetZero, "set zero position"),
        (Request::SetStroke(Stroke::Mm100), "set gripper stroke 100 mm"),
        (Request::ReadStroke, "read gripper stroke"),
        (Request::SetTorque(Torque::On), "torque on"),
        (Request::SetTorque(Torque::Off), "torque off"),
        (Request::ReadJoints, "read joints"),
        (Request::ReadTemperatures, "read temperatures"),
        (
            Request::SetTemperatureLimit(TemperatureLimit::FACTORY),
            "set temperature limit 85 °C",
        ),
        (Request::ReadVelocities, "read velocities"),
        (
            Request::Move(target),
            "move +0.00° at 439.5°/s +90.00° at 87.9°/s +0.00° at 439.5°/s +0.00° at 439.5°/s +0.00° at 439.5°/s \
             +0.00° at 439.5°/s, gripper 50.5 % at 5500 ticks/s",
        ),
        (Request::SelfCheck, "self-check"),
        (Request::SetMode(ControlMode::Position), "set control mode position"),
        (Request::SetMode(ControlMode::Current), "set control mode current"),
        (Request::ReadMode, "read control mode"),
        (Request::SetForceFeedback(false), "force feedback off"),
        (Request::SetForceFeedback(true), "force feedback on"),
        (Request::ReadForceFeedback, "read force feedback"),
    ]);
}

#[test]
fn answers_of_a_force_feedback_leader_have_units() {
    use ling::{
        ControlMode, ForceFeedback, Inhibit, JointForce, JointMask, ModeReply, ModeResult, ModeState, Response,
    };

    let reply = |requested, result| Response::ModeReply(ModeReply { requested, result });
    let mut joints = [JointForce::default(); 6];
    joints[1] = JointForce {
        residual_torque: -12,
        requested_current: 1250,
        output_current: i16::MIN,
        measured_current: 7,
    };
    let state = ModeState {
        mode: ControlMode::Current,
        blocked: JointMask(0b00_0110),
        valid: JointMask(0),
        joints,
    };
    let inhibit = Inhibit(0x1D);
    let feedback = ForceFeedback {
        is_requested: true,
        inhibit,
        is_torque_enabled: true,
        transition: 3,
        grip: 127,
        requested_mode: 1,
        ..ForceFeedback::default()
    };
    check([
        (
            reply(1, ModeResult::Accepted),
            "requested mode: current, result: accepted",
        ),
        (reply(7, ModeResult::Invalid), "requested mode: 0x07, result: invalid"),
        (
            reply(0, ModeResult::Unsupported),
            "requested mode: position, result: unsupported or not queued",
        ),
        (
            Response::Mode(state),
            "mode: current, blocked: 2 3, valid: none, residual torques: 0.000 -0.012 0.000 0.000 0.000 0.000 Nm, \
             requested currents: 0.000 1.250 0.000 0.000 0.000 0.000 A, \
             output currents: 0.000 -32.768 0.000 0.000 0.000 0.000 A, \
             measured currents: 0.000 0.007 0.000 0.000 0.000 0.000 A",
        ),
        (
            Response::ForceFeedback(feedback),
            "requested: on, effective: off, inhibit: not in teleoperation; link or sample older than 30 ms; hardware \
             fault; unsupported, sync: off, torque: on, requested torque: off, transition: 3, raw grip: 127, \
             requested mode: 1",
        ),
    ]);
}

#[test]
fn ling_answers_have_names_and_values_with_units() {
    use ling::{Info, JointState, MotionStatus, PerServo, Response, SelfCheck, SerialNumber, Stroke, Version};

    let info = |serial: &[u8; 16]| {
        Response::Info(Info {
            serial: SerialNumber(*serial),
            hardware: Version(610),
            firmware: Version(603),
        })
    };
    let joints = |joints, gripper, status| {
        Response::Joints(JointState {
            joints,
            gripper,
            status,
        })
    };
    check([
        (
            info(b"ADFS251205123456"),
            "arm: Ling follower, serial: ADFS251205123456, hardware: v6.10, firmware: v6.03",
        ),
        (
            info(b"ADL\x1b[2J\0\0\0\0\0\0\0\0\0"),
            "arm: Ling leader, serial: ADL\\x1b[2J, hardware: v6.10, firmware: v6.03",
        ),
        (
            info(b"XYZ\0\0\0\0\0\0\0\0\0\0\0\0\0"),
            "arm: Ling, of unknown kind, serial: XYZ, hardware: v6.10, firmware: v6.03",
        ),
        (Response::Stroke(Stroke::Mm75), "stroke: 75 mm"),
        (
            joints([2048, 2047, 2049, 0, 4095, 4096], 500, MotionStatus::Locked),
            "joints: +0.00° -0.09° +0.09° -180.00° +179.91° +180.00° (out of range), gripper: 50.0 % open, \
             status: locked",
        ),
        (
            joints([2048; 6], 2051, MotionStatus::Other(2)),
            "joints: +0.00° +0.00° +0.00° +0.00° +0.00° +0.00°, gripper: 205.1 % (out of range), \
             status: unknown status 0x02",
        ),
        (
            Response::Temperatures(PerServo::Leader([35, 36, 0, 255, 35, 38])),
            "temperatures: 35 36 0 255 35 38 °C",
        ),
        (
            Response::Velocities(PerServo::Follower([0, 1, 10, 100, 1000, 5000, 5500, 65535, 0, 0])),
            "velocities: 0.0 0.1 0.9 8.8 87.9 439.5 483.4 5759.9 0.0 0.0 °/s",
        ),
        (
            Response::SelfCheck(SelfCheck(0x03FF)),
            "self-check: all 10 servos normal",
        ),
        (
            Response::SelfCheck(SelfCheck(0x03FA)),
            "self-check: servos not normal: 1, 3",
        ),
        (
            Response::SelfCheck(SelfCheck(0x003E)),
            "self-check: servos not normal: 1, 7, 8, 9, 10 (a leader has none of 7 to 10)",
        ),
    ]);
}

#[test]
fn older_ling_answers_have_names_and_values() {
    use legacy::{Firmware, GripperState, JointState, Response};

    let firmware = Firmware::V6_0;
    let mut servos = [2048; legacy::SERVOS];
    servos[2] = 1024;
    let state = GripperState {
        firmware,
        id: 1,
        servo: 2051,
        potentiometer: 2300,
        sync_button: 0,
        attitude_button: 1,
    };
    check([
        (
            Response::Joints(JointState { firmware, servos }),
            "joints: +0.00° -90.00° +0.00° +0.00° +0.00° +0.00°",
        ),
        (
            Response::Gripper(state),
            "gripper: 2051, potentiometer: 2300, sync button: 0, attitude button: 1",
        ),
    ]);
}

#[test]
fn xarm_requests_have_their_values() {
    use xarm::{Joint, Raw, Request};

    check([
        (Request::Heartbeat, "heartbeat"),
        (Request::ReadVersion, "read version"),
        (Request::ReadSerials, "read serial numbers"),
        (Request::ReloadDynamics, "reload dynamics"),
        (Request::ReadTorqueSource, "read torque source"),
        (
            Request::ReadRotationRadius(Joint::new(6).unwrap()),
            "read rotation radius of joint 6",
        ),
        (Request::Shutdown, "shut down"),
        (Request::Reboot, "reboot"),
        (Request::Raw(Raw::new(19, &[0xAA, 1]).unwrap()), "register 19, AA 01"),
        (Request::Raw(Raw::new(42, &[]).unwrap()), "register 42, no value"),
    ]);
}

#[test]
fn xarm_answers_have_values_and_the_state() {
    use xarm::{
        ModbusFunction, Raw, Register, Reply, Response, RotationRadius, SerialsText, State, TorqueSource, VersionText,
    };

    let answer = |state, reply| Response::Reply { state, reply };
    let ok = |reply| answer(State::OK, reply);
    let serials = SerialsText::encode("XI120204201B02", "AC130202B02L02").unwrap();
    let radius = |millimetres| ok(Reply::RotationRadius(RotationRadius { millimetres }));
    check([
        (Response::Heartbeat, "heartbeat"),
        (
            Response::ModbusRefused {
                unit: 1,
                function: ModbusFunction::new(3).unwrap(),
            },
            "refused: no standard Modbus function 3, unit 1",
        ),
        (
            ok(Reply::Empty(Register::ReloadDynamics)),
            "reload dynamics: done, state: ok",
        ),
        (
            ok(Reply::Empty(Register::SystemControl)),
            "system control: done, state: ok",
        ),
        (ok(Reply::Empty(Register::Serials)), "serial: no value, state: ok"),
        (
            answer(State::INVALID | State::ERROR, Reply::Empty(Register::RotationRadius)),
            "rotation radius: not reported (state invalid, error)",
        ),
        (
            ok(Reply::Version(VersionText(b"6,9,XI1202,AC1302,v1.12.10\0"))),
            "arm: xArm, 6 axes, type 9, hardware: XI1202, control box: AC1302, firmware: v1.12.10, state: ok",
        ),
        (
            ok(Reply::Version(VersionText(b"v1\x1b"))),
            "arm: xArm, version: v1\\x1b (the version is not printable ASCII), state: ok",
        ),
        (
            ok(Reply::Serials(SerialsText(&serials))),
            "serial: XI120204201B02, control box AC130202B02L02, state: ok",
        ),
        (
            answer(
                State::NOT_READY | State::WARNING,
                Reply::TorqueSource(TorqueSource::Torque),
            ),
            "torque: the joints' torque, computed, state: not ready to move, warning",
        ),
        (
            ok(Reply::TorqueSource(TorqueSource::Current)),
            "torque: the servos' current, measured, state: ok",
        ),
        (radius(76.0), "rotation radius: 0.076 m, state: ok"),
        (radius(258.60006), "rotation radius: 0.2586 m, state: ok"),
        (
            radius(-1.0),
            "rotation radius: rotation radius is -0.001 m, must be 0..=100, state: ok",
        ),
        (ok(Reply::SystemControl(258)), "system control: value 258, state: ok"),
        (
            ok(Reply::Raw(Raw::new(15, &[31, 99]).unwrap())),
            "register 15: 1F 63 (error: 31 (abnormal current, caused by a collision), warning: 99), state: ok",
        ),
        (
            ok(Reply::Raw(Raw::new(19, &[1, 0xFE]).unwrap())),
            "register 19: 01 FE, state: ok",
        ),
        (
            answer(State::INVALID, Reply::empty(250)),
            "register 250: no value, state: invalid",
        ),
        (
            answer(
                State::INVALID,
                Reply::RotationRadius(RotationRadius { millimetres: 0.0 }),
            ),
            "rotation radius: not reported (state invalid)",
        ),
        (
            answer(State::INVALID, Reply::Raw(Raw::new(43, &[0, 0]).unwrap())),
            "register 43: 00 00, state: invalid",
        ),
    ]);
}

#[test]
fn alpha1_requests_have_their_values_with_units() {
    use alpha1::{
        Action, Address, Angle, Interval, Led, MoveTime, Offset, OffsetTool, Request, ServoId, ServoRequest, Text,
        UsbType,
    };

    let servo = ServoId::new(3).unwrap();
    let mut angles = [None; alpha1::SERVOS];
    angles[..2].fill(Some(Angle::new(90).unwrap()));
    let action = Action {
        angles,
        time: MoveTime::from_duration(Duration::from_millis(500)).unwrap(),
        interval: Interval::from_duration(Duration::from_millis(1_020)).unwrap(),
    };
    let motion = ServoRequest::Move {
        to: Address::One(servo),
        angle: Angle::MAX,
        time: MoveTime::MAX,
        lock: Interval::MAX,
    };
    check([
        (Request::ReadHardwareVersion, "read hardware version"),
        (Request::ReadServoStates, "read servo states"),
        (Request::Stop, "stop"),
        (Request::ReadFirmwareVersion, "read firmware version"),
        (
            Request::Act(action),
            "act 90° 90° - - - - - - - - - - - - - - - - - - in 0.5 s, next after 1.02 s",
        ),
        (Request::SetOffsetTool(OffsetTool::Connect), "connect the offset tool"),
        (
            Request::SetOffsetTool(OffsetTool::Disconnect),
            "disconnect the offset tool",
        ),
        (Request::SetUsbType(UsbType::Disk), "be a disk on USB"),
        (Request::SetUsbType(UsbType::SerialPort), "be a serial port on USB"),
        (Request::SetUsbType(UsbType::Hid), "be a HID device on USB"),
        (Request::Play(Text::new(b"\x1b[2J").unwrap()), "play '\\x1b[2J'"),
        (
            Request::Servo(motion),
            "move servo 3 to 240° in 5.1 s, completion time 1310.7 s",
        ),
        (
            Request::Servo(ServoRequest::Release(Address::All)),
            "release all servos",
        ),
        (
            Request::Servo(ServoRequest::SetLed {
                to: Address::One(servo),
                led: Led(1),
            }),
            "light of servo 3 to 1",
        ),
        (
            Request::Servo(ServoRequest::ReadAngles(servo)),
            "read angles of servo 3, and release it",
        ),
        (
            Request::Servo(ServoRequest::ChangeId {
                from: servo,
                to: ServoId::MAX,
            }),
            "change id of servo 3 to 240",
        ),
        (
            Request::Servo(ServoRequest::SetOffset(servo, Offset::new(-1).unwrap())),
            "set offset of servo 3 to -0.33°",
        ),
        (
            Request::Servo(ServoRequest::ReadOffset(servo)),
            "read offset of servo 3",
        ),
        (
            Request::Servo(ServoRequest::ReadVersion(servo)),
            "read version of servo 3",
        ),
    ]);
}

#[test]
fn alpha1_answers_have_names_and_values_with_units() {
    use alpha1::{FirmwareVersion, Outcome, Response, ServoId, ServoResponse, ServoStates, Text};

    let servo = ServoId::new(3).unwrap();
    let outcome = Outcome::Success;
    let firmware = |outcome, text: &[u8; 10]| Response::FirmwareVersion(FirmwareVersion { outcome, text: *text });
    let offset = |outcome, thirds| Response::Servo(ServoResponse::Offset { servo, outcome, thirds });
    check([
        (
            Response::HardwareVersion(Text::new(b"Alpha1_V2.0\x07").unwrap()),
            "arm: Alpha1, hardware: Alpha1_V2.0\\x07",
        ),
        (
            Response::ServoStates(ServoStates::from_bits(0x8005)),
            "servos that run: 1 3 16",
        ),
        (
            Response::ServoStates(ServoStates::from_bits(0)),
            "servos that run: none",
        ),
        (Response::Stopped(Outcome::Success), "stop: done"),
        (firmware(Outcome::Success, b"2016010100"), "firmware: 2016010100"),
        (
            firmware(Outcome::Success, b"201501010\n"),
            "firmware: 201501010\\n, before 2015121519, the first for this protocol",
        ),
        (
            firmware(Outcome::Failure, b"2016010100"),
            "firmware: not reported, the robot failed",
        ),
        (Response::Acted(Outcome::Failure), "act: failed"),
        (Response::OffsetTool(Outcome::Success), "offset tool: done"),
        (Response::UsbType(Outcome::Success), "USB type: done"),
        (Response::Playing(Outcome::Failure), "play: failed"),
        (
            Response::Servo(ServoResponse::Acknowledged(servo)),
            "servo 3: understood",
        ),
        (
            Response::Servo(ServoResponse::Angles {
                servo,
                outcome,
                target: 91,
                actual: 90,
            }),
            "servo 3: released, at 90°, sent to 91°",
        ),
        (
            Response::Servo(ServoResponse::IdChanged { servo, outcome, was: 7 }),
            "servo 3: was 7",
        ),
        (
            Response::Servo(ServoResponse::OffsetSet { servo, outcome }),
            "servo 3: offset set",
        ),
        (offset(Outcome::Success, -10), "servo 3: offset -3.33°"),
        (offset(Outcome::Success, i16::MAX), "servo 3: offset +10922.33°"),
        (offset(Outcome::Failure, 1), "servo 3: failed"),
        (
            Response::Servo(ServoResponse::Version {
                servo,
                outcome,
                version: [0, 1, 0xAA, 0xFF],
            }),
            "servo 3: version 00 01 AA FF",
        ),
    ]);
}

#[test]
fn alpha1_times_are_in_seconds() {
    use alpha1::{Interval, MoveTime};

    for units in 0..=u16::MAX {
        let seconds = f64::from(units) / 50.0;
        assert_eq!(Interval::new(units).to_string(), format!("{seconds} s"));
    }
    assert_eq!(MoveTime::new(25).to_string(), "0.5 s");
}
