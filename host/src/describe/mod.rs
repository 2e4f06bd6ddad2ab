//! Arms and their messages, for people and for programs: one file for each protocol.

mod alpha1;
mod arm;
mod fact;
pub mod legacy;
mod ling;
mod printable;
pub mod xarm;

pub use arm::{Arm, Protocol};
pub use fact::{Fact, Item, line, number, object};
pub use printable::{escaped, hex};

#[cfg(test)]
mod tests {
    use armwire::alpha1::{self, Alpha1, FirmwareVersion, Outcome, ServoId, ServoResponse, ServoStates, Text};
    use armwire::ling::legacy::{self, Firmware, GripperState, Legacy};
    use armwire::ling::{
        self, ControlMode, ForceFeedback, Info, Inhibit, JointForce, JointMask, JointState, Ling, ModeReply,
        ModeResult, ModeState, MotionStatus, PerServo, SelfCheck, SerialNumber, Stroke, Version,
    };
    use armwire::xarm::{
        self, ModbusFunction, Raw, Register, Reply, RotationRadius, SerialsText, State, TorqueSource, VersionText, XArm,
    };

    use super::*;

    /// Checks that the facts of these responses have the words of their texts.
    fn check<P: Arm>(responses: impl IntoIterator<Item = P::Response<'static>>) {
        for response in responses {
            assert_eq!(line(&P::facts(&response)), response.to_string());
        }
    }

    #[test]
    fn facts_of_a_ling_have_its_words() {
        let info = |serial: &[u8; 16]| Info {
            serial: SerialNumber(*serial),
            hardware: Version(610),
            firmware: Version(603),
        };
        let joints = |ticks, gripper| JointState {
            joints: [ticks; 6],
            gripper,
            status: MotionStatus::Locked,
        };
        check::<Ling>([
            ling::Response::Info(info(b"ADFS251205123456")),
            ling::Response::Info(info(b"X\x1b[2J\0\0\0\0\0\0\0\0\0\0\0")),
            ling::Response::Info(info(b"\0DLS251205123456")),
            ling::Response::Stroke(Stroke::Mm75),
            ling::Response::Joints(joints(2112, 500)),
            ling::Response::Joints(joints(4096, 1001)),
            ling::Response::Temperatures(PerServo::Leader([35, 36, 37, 38, 39, 255])),
            ling::Response::Velocities(PerServo::Follower([1, 2, 3, 4, 5, 6, 7, 8, 5000, 65535])),
            ling::Response::SelfCheck(SelfCheck(0x03FF)),
            ling::Response::SelfCheck(SelfCheck(0x003E)),
            ling::Response::ModeReply(ModeReply {
                requested: 1,
                result: ModeResult::Unsupported,
            }),
            ling::Response::ModeReply(ModeReply {
                requested: 9,
                result: ModeResult::Invalid,
            }),
            ling::Response::Mode(leader()),
            ling::Response::ForceFeedback(ForceFeedback {
                is_requested: true,
                inhibit: Inhibit(0xFF),
                is_torque_requested: true,
                ..ForceFeedback::default()
            }),
        ]);
        let firmware = Firmware::V5;
        check::<Legacy>([
            legacy::Response::Joints(legacy::JointState {
                firmware,
                servos: [1000; legacy::SERVOS],
            }),
            legacy::Response::Gripper(GripperState {
                firmware,
                id: 1,
                servo: 2051,
                potentiometer: 2300,
                sync_button: 0,
                attitude_button: 1,
            }),
        ]);
    }

    /// The state of a force-feedback leader, with a value of joint 2.
    fn leader() -> ModeState {
        let mut joints = [JointForce::default(); 6];
        joints[1] = JointForce {
            residual_torque: -12,
            requested_current: 1_250,
            output_current: i16::MIN,
            measured_current: 7,
        };
        ModeState {
            mode: ControlMode::Current,
            blocked: JointMask(0b00_0110),
            valid: JointMask(0b11_1111),
            joints,
        }
    }

    #[test]
    fn currents_of_a_leader_are_in_units() {
        let facts = object(&Ling::facts(&ling::Response::Mode(leader())));
        assert_eq!(facts["mode"], "current");
        assert_eq!((&facts["blocked_mask"], &facts["valid_mask"]), (&6.into(), &63.into()));
        assert_eq!(facts["residual_torque_2_nm"], -0.012);
        assert_eq!(facts["requested_current_2_a"], 1.25);
        assert_eq!(facts["output_current_2_a"], -32.768);
        assert_eq!(facts["measured_current_2_a"], 0.007);
        assert_eq!(facts["measured_current_6_a"], 0.0);
        let state = ForceFeedback {
            is_requested: true,
            inhibit: Inhibit(0x0D),
            grip: 127,
            ..ForceFeedback::default()
        };
        let facts = object(&Ling::facts(&ling::Response::ForceFeedback(state)));
        assert_eq!(
            (&facts["is_requested"], &facts["is_effective"]),
            (&true.into(), &false.into())
        );
        assert_eq!((&facts["inhibit_mask"], &facts["grip_raw"]), (&13.into(), &127.into()));
    }

    #[test]
    fn facts_of_an_xarm_have_its_words() {
        let replies = [
            Reply::Empty(Register::Version),
            Reply::Empty(Register::ReloadDynamics),
            Reply::Version(VersionText(b"6,9,XI1202,AC1302,v1.12.10")),
            Reply::Version(VersionText(b"v1\x1b")),
            Reply::Version(VersionText(b"6,9,,,v1.12.10")),
            Reply::Serials(SerialsText(b"XI1\0AC1\n")),
            Reply::TorqueSource(TorqueSource::Current),
            Reply::RotationRadius(RotationRadius { millimetres: 76.0 }),
            Reply::RotationRadius(RotationRadius { millimetres: f32::NAN }),
            Reply::SystemControl(1),
            Reply::Raw(Raw::new(15, &[31, 77]).unwrap()),
            Reply::Raw(Raw::new(19, &[1, 2]).unwrap()),
        ];
        for state in [State::OK, State::WARNING, State::INVALID] {
            check::<XArm>(replies.map(|reply| xarm::Response::Reply { state, reply }));
        }
        let function = ModbusFunction::new(3).unwrap();
        check::<XArm>([
            xarm::Response::Heartbeat,
            xarm::Response::ModbusRefused { unit: 1, function },
        ]);
    }

    #[test]
    fn angles_are_in_degrees_as_in_the_words() {
        let state = JointState {
            joints: [3072, 1024, 2048, 2049, 0, 4096],
            gripper: 0,
            status: MotionStatus::Locked,
        };
        let facts = object(&Ling::facts(&ling::Response::Joints(state)));
        let joints = [
            90.0.into(),
            (-90.0).into(),
            0.0.into(),
            0.087_891.into(),
            (-180.0).into(),
            serde_json::Value::Null,
        ];
        for (n, degrees) in (1..).zip(joints) {
            assert_eq!(facts[&format!("joint_{n}_deg")], degrees);
        }
        let speeds = ling::Response::Velocities(PerServo::Leader([1024; 6]));
        let facts = object(&Ling::facts(&speeds));
        assert_eq!(facts["velocity_6_deg_per_s"], 90.0);
        let half = [0.5_f32; super::xarm::JOINTS].map(f32::to_le_bytes);
        let facts = object(&super::xarm::positions(State::OK, half.as_flattened(), Some(6)));
        assert_eq!(facts["joint_6_deg"], 28.647_89);
    }

    #[test]
    fn facts_of_an_alpha1_have_its_words() {
        let servo = ServoId::new(3).unwrap();
        for outcome in [Outcome::Success, Outcome::Failure] {
            check::<Alpha1>([
                alpha1::Response::HardwareVersion(Text::new(b"Alpha1\x07").unwrap()),
                alpha1::Response::HardwareVersion(Text::new(b"").unwrap()),
                alpha1::Response::ServoStates(ServoStates::from_bits(0x8005)),
                alpha1::Response::ServoStates(ServoStates::from_bits(0)),
                alpha1::Response::Stopped(outcome),
                alpha1::Response::FirmwareVersion(FirmwareVersion {
                    outcome,
                    text: *b"2015010100",
                }),
                alpha1::Response::Acted(outcome),
                alpha1::Response::OffsetTool(outcome),
                alpha1::Response::UsbType(outcome),
                alpha1::Response::Playing(outcome),
            ]);
            let answers = [
                ServoResponse::Acknowledged(servo),
                ServoResponse::Angles {
                    servo,
                    outcome,
                    target: 91,
                    actual: 90,
                },
                ServoResponse::IdChanged { servo, outcome, was: 7 },
                ServoResponse::OffsetSet { servo, outcome },
                ServoResponse::Offset {
                    servo,
                    outcome,
                    thirds: -10,
                },
                ServoResponse::Version {
                    servo,
                    outcome,
                    version: [0, 1, 2, 0xFF],
                },
            ];
            check::<Alpha1>(answers.map(alpha1::Response::Servo));
        }
    }
}
