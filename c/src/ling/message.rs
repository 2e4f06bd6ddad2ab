//! Requests and responses as flat structures.

use armwire::OutOfRange;
use armwire::ling::{
    ControlMode, ForceFeedback, GripperSpeed, Info, Inhibit, JOINTS, JointForce, JointMask, JointState, ModeReply,
    ModeResult, ModeState, MotionStatus, Move, Opening, PerServo, Position, Request, Response, SelfCheck, SerialNumber,
    Speed, Stroke, TemperatureLimit, Torque, Version,
};

use crate::device::Refusal;
use crate::fault::Refused;
use crate::status::ArmwireStatus;

/// Number of joints, without the gripper.
pub const ARMWIRE_LING_JOINTS: usize = 6;

/// Maximum number of servos of an arm: a follower has 10, a leader 6.
pub const ARMWIRE_LING_MAX_SERVOS: usize = 10;

const _: () = assert!(ARMWIRE_LING_JOINTS == JOINTS);

/// Targets and speeds of a move (section 2.5). A joint has 4096 ticks per turn, 2048 at the centre.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct ArmwireLingMove {
    /// Targets of joints 1 to 6, 0 to 4095.
    pub position_ticks: [u16; ARMWIRE_LING_JOINTS],
    /// Speeds of joints 1 to 6. A client accepts 50 to 5000: an arm may take less for 0. `armwire_ling_client_move_slowly`
    /// accepts 1 to 5000. A device receives 0 to 5000.
    pub speed_ticks_per_s: [u16; ARMWIRE_LING_JOINTS],
    /// Target of the gripper, 0 (closed) to 1000 (open).
    pub opening_per_mille: u16,
    /// Speed of the gripper. The vendor's software sends 5500.
    pub gripper_speed_ticks_per_s: u16,
}

impl ArmwireLingMove {
    pub(super) fn of(target: &Move) -> Self {
        let (opening, speed) = target.gripper;
        Self {
            position_ticks: target.joints.map(|(position, _)| position.ticks()),
            speed_ticks_per_s: target.joints.map(|(_, speed)| speed.ticks_per_second()),
            opening_per_mille: opening.per_mille(),
            gripper_speed_ticks_per_s: speed.0,
        }
    }

    /// The move of an arm with this slowest speed.
    pub(super) fn get(&self, slowest: Speed) -> Result<Move, Refused> {
        let mut joints = [(Position::CENTRE, Speed::MAX); JOINTS];
        let values = self.position_ticks.into_iter().zip(self.speed_ticks_per_s);
        for (index, (joint, (position, speed))) in joints.iter_mut().zip(values).enumerate() {
            let at = Refused::at(index);
            *joint = (
                Position::new(position).map_err(&at)?,
                Speed::from_slowest(slowest, speed).map_err(&at)?,
            );
        }
        let opening = Opening::new(self.opening_per_mille).map_err(Refused::only)?;
        Ok(Move {
            joints,
            gripper: (opening, GripperSpeed(self.gripper_speed_ticks_per_s)),
        })
    }
}

/// A message of the host.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArmwireLingRequestKind {
    /// None.
    None = 0,
    /// Serial number and versions (section 2.1).
    ReadInfo,
    /// Makes the present pose the zero position, and switches the torque off (section 2.2). Not answered.
    SetZero,
    /// Sets the gripper's stroke (section 2.3). Not answered. (`stroke_mm`)
    SetStroke,
    /// Reads the configured stroke of the gripper (section 2.3).
    ReadStroke,
    /// Switches the torque (section 2.4). Not answered. (`torque_on`)
    SetTorque,
    /// Joint positions, gripper and motion status (section 2.5).
    ReadJoints,
    /// Servo temperatures (section 2.5).
    ReadTemperatures,
    /// Sets the temperature limit of the overheat protection (section 2.5). Not answered. (`temperature_limit_celsius`)
    SetTemperatureLimit,
    /// Servo velocities (section 2.5).
    ReadVelocities,
    /// Moves the joints and the gripper (section 2.5). Not answered. (`target`)
    Move,
    /// Runs a self-check of every servo (section 2.6).
    SelfCheck,
    /// Sets the control mode of a force-feedback leader. (`control_mode`)
    SetMode,
    /// The applied mode and the currents of a force-feedback leader.
    ReadMode,
    /// Requests the force feedback of a force-feedback leader, or its end. (`force_feedback_on`)
    SetForceFeedback,
    /// The state of the force feedback.
    ReadForceFeedback,
}

/// A request received by a device. Members that its kind does not set are 0.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct ArmwireLingRequest {
    /// The kind: an `ArmwireLingRequestKind`.
    pub kind: u32,
    /// Stroke of the gripper: 50, 75 or 100.
    pub stroke_mm: u8,
    /// Torque: 1 on, the servos hold their positions; 0 off.
    pub torque_on: u8,
    /// Temperature limit of the overheat protection.
    pub temperature_limit_celsius: u8,
    /// Control mode: 0 position, 1 current.
    pub control_mode: u8,
    /// Force feedback: 1 on, 0 off.
    pub force_feedback_on: u8,
    /// Targets and speeds of a move.
    pub target: ArmwireLingMove,
}

impl ArmwireLingRequest {
    /// Sets all members from a request.
    pub(super) fn set(&mut self, request: Option<Request>) {
        *self = Self::default();
        let kind = match request {
            Some(Request::ReadInfo) => ArmwireLingRequestKind::ReadInfo,
            Some(Request::SetZero) => ArmwireLingRequestKind::SetZero,
            Some(Request::SetStroke(stroke)) => {
                self.stroke_mm = stroke.millimetres();
                ArmwireLingRequestKind::SetStroke
            }
            Some(Request::ReadStroke) => ArmwireLingRequestKind::ReadStroke,
            Some(Request::SetTorque(torque)) => {
                self.torque_on = (torque == Torque::On).into();
                ArmwireLingRequestKind::SetTorque
            }
            Some(Request::ReadJoints) => ArmwireLingRequestKind::ReadJoints,
            Some(Request::ReadTemperatures) => ArmwireLingRequestKind::ReadTemperatures,
            Some(Request::SetTemperatureLimit(limit)) => {
                self.temperature_limit_celsius = limit.celsius();
                ArmwireLingRequestKind::SetTemperatureLimit
            }
            Some(Request::ReadVelocities) => ArmwireLingRequestKind::ReadVelocities,
            Some(Request::Move(target)) => {
                self.target = ArmwireLingMove::of(&target);
                ArmwireLingRequestKind::Move
            }
            Some(Request::SelfCheck) => ArmwireLingRequestKind::SelfCheck,
            Some(Request::SetMode(mode)) => {
                self.control_mode = mode as u8;
                ArmwireLingRequestKind::SetMode
            }
            Some(Request::ReadMode) => ArmwireLingRequestKind::ReadMode,
            Some(Request::SetForceFeedback(is_on)) => {
                self.force_feedback_on = is_on.into();
                ArmwireLingRequestKind::SetForceFeedback
            }
            Some(Request::ReadForceFeedback) => ArmwireLingRequestKind::ReadForceFeedback,
            None | Some(_) => ArmwireLingRequestKind::None,
        };
        self.kind = kind as u32;
    }
}

/// A message of the arm.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArmwireLingResponseKind {
    /// None.
    None = 0,
    /// The arm's identity. (`serial_number`, `hardware_version`, `firmware_version`)
    Info,
    /// The configured gripper. (`stroke_mm`)
    Stroke,
    /// Joints, gripper and status. (`position_ticks`, `opening_per_mille`, `motion_status`, `foreign_data_bytes`)
    Joints,
    /// Servo temperatures. (`servos`, `temperature_celsius`)
    Temperatures,
    /// Servo velocities. (`servos`, `velocity_ticks_per_s`)
    Velocities,
    /// The outcome of a self-check. (`normal_servos`)
    SelfCheck,
    /// The verdict on a requested mode, which is not applied yet. (`requested_mode`, `mode_result`)
    ModeReply,
    /// The applied mode and the currents. (`control_mode`, `blocked_joints`, `valid_joints`, `joint_force`)
    Mode,
    /// The state of the force feedback. (`force_feedback`, `requested_mode`)
    ForceFeedback,
}

/// Torque and currents of a joint of a force-feedback leader.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct ArmwireLingJointForce {
    /// The remote residual torque, in 0.001 Nm.
    pub residual_torque_mnm: i16,
    /// The requested current, in 0.001 A.
    pub requested_current_ma: i16,
    /// The output current, in 0.001 A.
    pub output_current_ma: i16,
    /// The measured current, in 0.001 A.
    pub measured_current_ma: i16,
}

/// The state of the force feedback. Members are 0 or 1, unless they say more.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct ArmwireLingForceFeedback {
    /// It is requested.
    pub requested: u8,
    /// It acts on the joints.
    pub effective: u8,
    /// The reasons why it does not act: bit 0 not in teleoperation, bit 2 link or sample older than 30 ms, bit 3 a
    /// hardware fault, bit 4 unsupported.
    pub inhibit_mask: u8,
    /// The synchronization with another arm is active.
    pub sync_active: u8,
    /// The torque is on.
    pub torque_enabled: u8,
    /// The torque is requested.
    pub torque_requested: u8,
    /// Diagnostic, any value: the state of the transition.
    pub transition: u8,
    /// Diagnostic, any value: the raw value of the grip.
    pub grip_raw: u8,
}

/// A response received by a client or sent by a device. Members that its kind does not set are 0.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct ArmwireLingResponse {
    /// The kind: an `ArmwireLingResponseKind`.
    pub kind: u32,
    /// Serial number, ASCII, padded with NUL. `armwire_printable` converts it to text.
    pub serial_number: [u8; 16],
    /// Hardware version: 610 is 6.10.
    pub hardware_version: u32,
    /// Firmware version: 610 is 6.10.
    pub firmware_version: u32,
    /// Positions of joints 1 to 6, as sent: 4096 ticks per turn, 2048 at the centre.
    pub position_ticks: [u16; ARMWIRE_LING_JOINTS],
    /// Opening of the gripper, as sent: 0 (closed) to 1000 (open). Arms have sent larger values.
    pub opening_per_mille: u16,
    /// Motion status: 0x00 idle, 0x01 locked, 0x10 following, 0x11 following and locked, 0xE1 overheating, 0xE2
    /// stopped by overheat protection.
    pub motion_status: u8,
    /// 0 for an Alicia-D. Otherwise the number of data bytes of an answer with joints that is another robot's: nothing
    /// that moves or holds it is made from it, and `motion_status` is no status. 33 is a Bessica-D.
    pub foreign_data_bytes: u8,
    /// Stroke of the gripper: 50, 75 or 100.
    pub stroke_mm: u8,
    /// The number of servos: 6 (leader) or 10 (follower).
    pub servos: u8,
    /// Temperatures, servo 1 first.
    pub temperature_celsius: [u8; ARMWIRE_LING_MAX_SERVOS],
    /// Velocities, servo 1 first, unsigned.
    pub velocity_ticks_per_s: [u16; ARMWIRE_LING_MAX_SERVOS],
    /// One bit per servo, servo 1 lowest: 1 is normal.
    pub normal_servos: u16,
    /// Requested control mode as sent: 0 position, 1 current.
    pub requested_mode: u8,
    /// Verdict on the requested mode: 0 accepted, 1 invalid, 2 unsupported or not queued.
    pub mode_result: u8,
    /// Applied control mode: 0 position, 1 current.
    pub control_mode: u8,
    /// One bit per joint, joint 1 lowest: 1 is blocked.
    pub blocked_joints: u8,
    /// One bit per joint, joint 1 lowest: 1 has valid values in `joint_force`.
    pub valid_joints: u8,
    /// Torques and currents of joints 1 to 6.
    pub joint_force: [ArmwireLingJointForce; ARMWIRE_LING_JOINTS],
    /// The state of the force feedback.
    pub force_feedback: ArmwireLingForceFeedback,
}

/// Copies readings to the front of an array, and returns their number.
fn put<T: Copy>(to: &mut [T], readings: &[T]) -> u8 {
    for (to, reading) in to.iter_mut().zip(readings) {
        *to = *reading;
    }
    readings.len() as u8
}

/// The stroke of this many millimetres.
pub(super) fn stroke(millimetres: u8) -> Result<Stroke, Refused> {
    let strokes = [Stroke::Mm50, Stroke::Mm75, Stroke::Mm100];
    let known = strokes.into_iter().find(|stroke| stroke.millimetres() == millimetres);
    let error = OutOfRange::new("gripper stroke (50, 75 or 100)", "mm", millimetres, 50, 100);
    known.ok_or(Refused::only(error))
}

/// The torque switched off (0) or on (1).
pub(super) fn torque(on: u8) -> Result<Torque, Refused> {
    match on {
        0 => Ok(Torque::Off),
        1 => Ok(Torque::On),
        _ => Err(Refused::only(OutOfRange::new("torque switch", "", on, 0, 1))),
    }
}

/// A limit in °C.
pub(super) fn temperature_limit(celsius: u8) -> Result<TemperatureLimit, Refused> {
    TemperatureLimit::new(celsius).map_err(Refused::only)
}

/// The control mode position (0) or current (1).
pub(super) fn control_mode(code: u8) -> Result<ControlMode, Refused> {
    match code {
        0 => Ok(ControlMode::Position),
        1 => Ok(ControlMode::Current),
        _ => Err(Refused::only(OutOfRange::new("control mode", "", code, 0, 1))),
    }
}

/// A switch off (0) or on (1).
pub(super) fn switch(on: u8) -> Result<bool, Refused> {
    match on {
        0 => Ok(false),
        1 => Ok(true),
        _ => Err(Refused::only(OutOfRange::new("force feedback switch", "", on, 0, 1))),
    }
}

impl ArmwireLingJointForce {
    const fn of(force: &JointForce) -> Self {
        Self {
            residual_torque_mnm: force.residual_torque,
            requested_current_ma: force.requested_current,
            output_current_ma: force.output_current,
            measured_current_ma: force.measured_current,
        }
    }

    const fn get(self) -> JointForce {
        JointForce {
            residual_torque: self.residual_torque_mnm,
            requested_current: self.requested_current_ma,
            output_current: self.output_current_ma,
            measured_current: self.measured_current_ma,
        }
    }
}

impl ArmwireLingForceFeedback {
    fn of(state: &ForceFeedback) -> Self {
        Self {
            requested: state.is_requested.into(),
            effective: state.is_effective.into(),
            inhibit_mask: state.inhibit.0,
            sync_active: state.is_sync_active.into(),
            torque_enabled: state.is_torque_enabled.into(),
            torque_requested: state.is_torque_requested.into(),
            transition: state.transition,
            grip_raw: state.grip,
        }
    }

    fn get(&self, requested_mode: u8) -> Result<ForceFeedback, Refused> {
        Ok(ForceFeedback {
            is_requested: switch(self.requested)?,
            is_effective: switch(self.effective)?,
            inhibit: Inhibit(self.inhibit_mask),
            is_sync_active: switch(self.sync_active)?,
            is_torque_enabled: switch(self.torque_enabled)?,
            is_torque_requested: switch(self.torque_requested)?,
            transition: self.transition,
            grip: self.grip_raw,
            requested_mode,
        })
    }
}

impl ArmwireLingResponse {
    /// Sets all members from a response.
    pub(super) fn set(&mut self, response: Option<Response>) {
        *self = Self::default();
        let kind = match response {
            Some(Response::Info(info)) => {
                self.serial_number = info.serial.0;
                (self.hardware_version, self.firmware_version) = (info.hardware.0, info.firmware.0);
                ArmwireLingResponseKind::Info
            }
            Some(Response::Stroke(stroke)) => {
                self.stroke_mm = stroke.millimetres();
                ArmwireLingResponseKind::Stroke
            }
            Some(Response::Joints(state)) => {
                self.position_ticks = state.joints;
                self.opening_per_mille = state.gripper;
                self.motion_status = state.status.into();
                if let MotionStatus::Foreign(foreign) = state.status {
                    self.foreign_data_bytes = foreign.data_bytes;
                }
                ArmwireLingResponseKind::Joints
            }
            Some(Response::Temperatures(celsius)) => {
                self.servos = put(&mut self.temperature_celsius, celsius.as_slice());
                ArmwireLingResponseKind::Temperatures
            }
            Some(Response::Velocities(ticks)) => {
                self.servos = put(&mut self.velocity_ticks_per_s, ticks.as_slice());
                ArmwireLingResponseKind::Velocities
            }
            Some(Response::SelfCheck(check)) => {
                self.normal_servos = check.0;
                ArmwireLingResponseKind::SelfCheck
            }
            Some(Response::ModeReply(reply)) => {
                (self.requested_mode, self.mode_result) = (reply.requested, reply.result as u8);
                ArmwireLingResponseKind::ModeReply
            }
            Some(Response::Mode(state)) => {
                self.control_mode = state.mode as u8;
                (self.blocked_joints, self.valid_joints) = (state.blocked.0, state.valid.0);
                self.joint_force = state.joints.each_ref().map(ArmwireLingJointForce::of);
                ArmwireLingResponseKind::Mode
            }
            Some(Response::ForceFeedback(state)) => {
                self.force_feedback = ArmwireLingForceFeedback::of(&state);
                self.requested_mode = state.requested_mode;
                ArmwireLingResponseKind::ForceFeedback
            }
            None | Some(_) => ArmwireLingResponseKind::None,
        };
        self.kind = kind as u32;
    }

    pub(super) fn get(&self) -> Result<Response, Refusal> {
        let kind = |kind: ArmwireLingResponseKind| self.kind == kind as u32;
        if kind(ArmwireLingResponseKind::Info) {
            return Ok(Response::Info(Info {
                serial: SerialNumber(self.serial_number),
                hardware: Version(self.hardware_version),
                firmware: Version(self.firmware_version),
            }));
        }
        if kind(ArmwireLingResponseKind::Stroke) {
            return Ok(Response::Stroke(stroke(self.stroke_mm)?));
        }
        if kind(ArmwireLingResponseKind::Joints) {
            return Ok(Response::Joints(JointState {
                joints: self.position_ticks,
                gripper: self.opening_per_mille,
                status: match self.foreign_data_bytes {
                    0 => self.motion_status.into(),
                    data_bytes => MotionStatus::of_answer(self.motion_status, data_bytes),
                },
            }));
        }
        if kind(ArmwireLingResponseKind::Temperatures) {
            return Ok(Response::Temperatures(self.per_servo(self.temperature_celsius)?));
        }
        if kind(ArmwireLingResponseKind::Velocities) {
            return Ok(Response::Velocities(self.per_servo(self.velocity_ticks_per_s)?));
        }
        if kind(ArmwireLingResponseKind::SelfCheck) {
            return Ok(Response::SelfCheck(SelfCheck(self.normal_servos)));
        }
        if kind(ArmwireLingResponseKind::ModeReply) {
            let (requested, result) = (self.requested_mode, self.result()?);
            return Ok(Response::ModeReply(ModeReply { requested, result }));
        }
        if kind(ArmwireLingResponseKind::Mode) {
            return Ok(Response::Mode(ModeState {
                mode: control_mode(self.control_mode)?,
                blocked: JointMask(self.blocked_joints),
                valid: JointMask(self.valid_joints),
                joints: self.joint_force.map(ArmwireLingJointForce::get),
            }));
        }
        if kind(ArmwireLingResponseKind::ForceFeedback) {
            return Ok(Response::ForceFeedback(self.force_feedback.get(self.requested_mode)?));
        }
        Err(Refusal::Status(ArmwireStatus::UnknownKind))
    }

    fn result(&self) -> Result<ModeResult, Refused> {
        match self.mode_result {
            0 => Ok(ModeResult::Accepted),
            1 => Ok(ModeResult::Invalid),
            2 => Ok(ModeResult::Unsupported),
            got => Err(Refused::only(OutOfRange::new("result of a mode", "", got, 0, 2))),
        }
    }

    /// The slowest speed that this answer of an arm permits.
    pub(super) fn slowest(&self) -> Speed {
        match self.kind == ArmwireLingResponseKind::Mode as u32 {
            true => Speed::SLOWEST_OF_FORCE_FEEDBACK,
            false => Speed::SLOWEST,
        }
    }

    fn per_servo<T>(&self, readings: [T; ARMWIRE_LING_MAX_SERVOS]) -> Result<PerServo<T>, Refused> {
        match self.servos {
            6 => {
                let [a, b, c, d, e, f, ..] = readings;
                Ok(PerServo::Leader([a, b, c, d, e, f]))
            }
            10 => Ok(PerServo::Follower(readings)),
            got => {
                let error = OutOfRange::new("number of servos (6 or 10)", "", got, 6, 10);
                Err(Refused::only(error))
            }
        }
    }
}
