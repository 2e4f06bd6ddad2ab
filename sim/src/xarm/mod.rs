//! A virtual xArm.
//!
//! [`VirtualXArm`] is the control box: it answers the requests of any number of clients and creates reports. `body.rs`
//! has joint motion. `Server` serves it on TCP ports, where there are any.
//!
//! Besides the registers of the document it has those that the vendor's Python SDK needs to connect, to stay connected
//! and to move joints:
//!
//! | Register | Request | Answer |
//! |---|---|---|
//! | 3 | | 0: verified |
//! | 7, 66 | 66: 0 or 1 | 7: 1 if motion may be approximate; without effect here |
//! | 11 | joint from 1, or 8 for all; 0 or 1 | switches motors |
//! | 12 | 0 ready, 3 paused, 4 stopped | |
//! | 13 | | 1 moving, 2 at rest, 3 paused, 4 stopped, 5 stopped by a setting |
//! | 14 | | moves queued or in progress, `u16` |
//! | 15 | | error, warning |
//! | 16, 17 | | clear the error, the warning |
//! | 19 | mode 0, queued moves, or 1, servo; optionally 0 or 1 | |
//! | 23 | ten `f32`: seven joints in rad, speed in rad/s, acceleration in rad/s², an ignored time | |
//! | 24 | as 23, with a blending radius in place of the time: the arm does not blend | |
//! | 25 | three `f32`: speed, acceleration and an ignored time of a move to zero | |
//! | 29 | ten `f32`: seven joints in rad, and three ignored | |
//! | 41, 91 | | six `f32`: x, y, z in mm; 41: roll, pitch, yaw in rad; 91: the same as a rotation vector |
//! | 42 | optionally 1, 2 or 3 | seven `f32`: joints in rad; from 2 also rad/s; with 3 also torques |
//! | 55 | | seven `f32`: torques |
//! | 70 | 0 or 1 | selects the source of the reported torque; register 5 returns it |
//!
//! Registers 23 to 25 are those of mode 0, and 29 is that of mode 1.
//!
//! Any other register, and invalid parameters, get an answer with the state bit "invalid" and have no other effect. Its
//! parameters are [`PADDING`] zeros: the SDK decodes the numbers of an answer before it looks at the state, and raises
//! an exception if there are none.

mod body;
mod geometry;
mod profile;
mod report;
#[cfg(any(unix, windows))]
mod server;
#[cfg(test)]
mod tests;

use armwire::ParseError;
use armwire::time::Instant;
use armwire::xarm::{
    Raw, Register, Reply, Request, Response, RotationRadius, SerialsText, State, TEXT, TorqueSource, VersionText,
};

use body::{Body, Refused, Target};
use geometry::Frame;
pub use geometry::Model;
pub use report::REPORT;
#[cfg(any(unix, windows))]
pub use server::{BindError, Notice, Port, Served, Server};

/// Number of parameters of a refused register that is not in the document, all zero. The SDK's longest list of numbers,
/// of register 67, has 28 `f32`.
pub const PADDING: usize = 28 * 4;

/// Registers that are not in the document.
mod register {
    pub(super) const READ_VERIFICATION: u8 = 3;
    pub(super) const READ_APPROXIMATION: u8 = 7;
    pub(super) const SET_MOTOR: u8 = 11;
    pub(super) const SET_STATE: u8 = 12;
    pub(super) const READ_STATE: u8 = 13;
    pub(super) const READ_MOVES: u8 = 14;
    pub(super) const READ_CODES: u8 = 15;
    pub(super) const CLEAR_ERROR: u8 = 16;
    pub(super) const CLEAR_WARNING: u8 = 17;
    pub(super) const SET_MODE: u8 = 19;
    pub(super) const MOVE_JOINTS: u8 = 23;
    pub(super) const MOVE_JOINTS_BLENDED: u8 = 24;
    pub(super) const MOVE_HOME: u8 = 25;
    pub(super) const SERVO_JOINTS: u8 = 29;
    pub(super) const READ_POSE: u8 = 41;
    pub(super) const READ_JOINTS: u8 = 42;
    pub(super) const READ_TORQUES: u8 = 55;
    pub(super) const SET_APPROXIMATION: u8 = 66;
    pub(super) const SET_TORQUE_SOURCE: u8 = 70;
    pub(super) const READ_POSE_VECTOR: u8 = 91;
}

/// Identity of a virtual arm.
///
/// ```
/// use armwire::xarm::SerialsText;
/// use armwire_sim::xarm::{Config, Model};
///
/// let config = Config {
///     serials: SerialsText::encode("XS130000000B00", "AC130000000L00")?,
///     ..Config::new(Model::XArm7)
/// };
/// # Ok::<(), armwire::OutOfRange>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// Model.
    pub model: Model,
    /// Versions, in the format of [`VersionText`]. Axes and type should match `model`. With later firmware the SDK uses
    /// registers that this arm does not have.
    pub version: [u8; TEXT],
    /// Serial numbers of arm and control box, in the format of [`SerialsText`].
    pub serials: [u8; TEXT],
}

impl Config {
    /// Returns the versions and serial numbers of the document's examples, which are an xArm 6's.
    ///
    /// # Panics
    ///
    /// Never: the texts fit.
    pub fn new(model: Model) -> Self {
        // The second letter of the hardware version and the serial number is the vendor's code of the model.
        let (kind, letter) = match model {
            Model::XArm5 => (5, 'F'),
            Model::XArm6 => (6, 'I'),
            Model::XArm7 => (7, 'S'),
        };
        let version = format!("{kind},{kind},X{letter}1202,AC1302,v1.12.10");
        let serial = format!("X{letter}120204201B02");
        Self {
            model,
            version: VersionText::encode(&version).expect("it fits"),
            serials: SerialsText::encode(&serial, "AC130202B02L02").expect("they fit"),
        }
    }
}

/// A virtual xArm, switched on at time zero, its joints at zero and its motors off.
///
/// The arm is deterministic: its behaviour depends on the requests and their times, not on the polling rate.
///
/// ```
/// use armwire::time::Instant;
/// use armwire::xarm::{Reply, Request, Response, State, TorqueSource};
/// use armwire_sim::xarm::{Config, Model, VirtualXArm};
///
/// let mut arm = VirtualXArm::new(Config::new(Model::XArm6));
/// let reply = Reply::TorqueSource(TorqueSource::Torque);
/// let answer = Response::Reply { state: State::NOT_READY, reply };
/// assert_eq!(arm.answer(Instant::ZERO, &Request::ReadTorqueSource), Some(answer));
/// ```
#[derive(Clone, Debug)]
pub struct VirtualXArm {
    config: Config,
    body: Body,
    torque_source: TorqueSource,
    /// True if motion may be approximate.
    approximates: bool,
    /// The parameters of the last answer.
    params: Vec<u8>,
}

impl VirtualXArm {
    /// Creates an arm in its power-on state.
    pub fn new(config: Config) -> Self {
        Self {
            config,
            body: Body::new(config.model),
            torque_source: TorqueSource::Torque,
            approximates: false,
            params: Vec::new(),
        }
    }

    /// Advances time, as [`answer`](Self::answer) and [`report`](Self::report) do. The methods below return the state
    /// at the last given time.
    pub fn advance(&mut self, now: Instant) {
        self.body.advance(now);
    }

    /// Returns the joint angles, in radians, 0 for joints that the model does not have.
    pub fn joints(&self) -> [f64; 7] {
        *self.body.joints()
    }

    /// Returns the joint velocities, in radians per second.
    pub fn velocities(&self) -> [f64; 7] {
        *self.body.velocities()
    }

    /// Returns the state byte of every answer.
    pub fn state(&self) -> State {
        let bit = |set, bit| if set { bit } else { State::OK };
        bit(!self.body.can_move(), State::NOT_READY)
            | bit(self.body.warning() != 0, State::WARNING)
            | bit(self.body.error() != 0, State::ERROR)
    }

    /// Sets the error, a number in the vendor's list, which stops the arm; 0 clears it.
    pub fn set_error(&mut self, code: u8) {
        self.body.set_error(code);
    }

    /// Sets the warning, a number in the vendor's list; 0 clears it.
    pub fn set_warning(&mut self, code: u8) {
        self.body.set_warning(code);
    }

    /// Executes a request and returns the answer, if it has one.
    ///
    /// Shutdown and reboot restore the power-on state at the current joint position. The server decides about
    /// connections.
    pub fn answer(&mut self, now: Instant, request: &Request<'_>) -> Option<Response<'_>> {
        self.advance(now);
        let register = request.register()?; // A heartbeat has none.
        // The answer to a restart has the state before it.
        let before = self.state();
        let radius = match request {
            Request::ReadRotationRadius(joint) => self.radius(joint.number()),
            _ => Err(Refused),
        };
        let raw = match request {
            Request::Raw(raw) => self.execute(raw),
            Request::Shutdown | Request::Reboot => {
                self.restart();
                Ok(())
            }
            _ => Ok(()),
        };
        let reply = match request {
            Request::ReadVersion => Ok(Reply::Version(VersionText(&self.config.version))),
            Request::ReadSerials => Ok(Reply::Serials(SerialsText(&self.config.serials))),
            Request::ReadTorqueSource => Ok(Reply::TorqueSource(self.torque_source)),
            Request::ReadRotationRadius(_) => radius.map(Reply::RotationRadius),
            Request::ReloadDynamics | Request::Shutdown | Request::Reboot => Ok(Reply::empty(register)),
            Request::Raw(_) => raw.and_then(|()| Raw::new(register, &self.params).map(Reply::Raw).map_err(|_| Refused)),
            // A request of a later version of the document.
            _ => Err(Refused),
        };
        Some(match (request, reply) {
            (Request::Shutdown | Request::Reboot, Ok(reply)) => Response::Reply { state: before, reply },
            (_, Ok(reply)) => Response::Reply {
                state: self.state(),
                reply,
            },
            (_, Err(Refused)) => self.refused(register),
        })
    }

    /// Returns the refusal of a request of this register.
    fn refused(&self, register: u8) -> Response<'static> {
        let reply = match Reply::empty(register) {
            Reply::Empty(Register::RotationRadius) => Reply::RotationRadius(RotationRadius { millimetres: 0.0 }),
            Reply::Empty(register) => Reply::Empty(register),
            _ => Raw::new(register, &[0; PADDING]).map_or(Reply::empty(register), Reply::Raw),
        };
        Response::Reply {
            state: self.state() | State::INVALID,
            reply,
        }
    }

    /// Returns the answer to a valid frame that is no request. `None` if the frame has no register.
    pub fn refuse(&mut self, now: Instant, error: &ParseError) -> Option<Response<'static>> {
        self.advance(now);
        Some(match Response::refusal(error)? {
            Response::Reply { reply, .. } => self.refused(reply.register()),
            other => other,
        })
    }

    fn restart(&mut self) {
        let mut body = self.body.clone();
        body.restart();
        *self = Self {
            body,
            ..Self::new(self.config)
        };
    }

    /// Returns the distance of the flange from the axis of a joint, from 1.
    ///
    /// The document does not define the radius. This is the literal meaning. It is 0 for joint 6, as in the document's
    /// example.
    fn radius(&self, joint: u8) -> Result<RotationRadius, Refused> {
        let joint = usize::from(joint) - 1;
        let millimetres = self.body.placed().radius(joint).ok_or(Refused)? as f32;
        Ok(RotationRadius { millimetres })
    }

    /// Executes a request that is not in the document, and stores the parameters of the answer.
    fn execute(&mut self, raw: &Raw<'_>) -> Result<(), Refused> {
        let body = &mut self.body;
        let done = Vec::new();
        self.params = match (raw.register(), raw.params()) {
            (register::READ_VERIFICATION, []) => vec![0],
            (register::READ_APPROXIMATION, []) => vec![self.approximates.into()],
            (register::READ_STATE, []) => vec![body.state()],
            (register::READ_MOVES, []) => (body.moves() as u16).to_be_bytes().to_vec(),
            (register::READ_CODES, []) => vec![body.error(), body.warning()],
            (register::READ_POSE, []) => pose(body, Frame::roll_pitch_yaw),
            (register::READ_POSE_VECTOR, []) => pose(body, Frame::rotation_vector),
            (register::READ_JOINTS, [] | [1]) => floats(body.joints()),
            (register::READ_JOINTS, [2]) => [floats(body.joints()), floats(body.velocities())].concat(),
            (register::READ_JOINTS, [3]) => {
                [floats(body.joints()), floats(body.velocities()), floats(&[0.0; 7])].concat()
            }
            (register::READ_TORQUES, []) => floats(&[0.0; 7]),
            (register::SET_MOTOR, &[joint, on @ (0 | 1)]) => body.set_motor(joint, on == 1).map(|()| done)?,
            (register::SET_STATE, &[state]) => body.set_state(state).map(|()| done)?,
            (register::SET_MODE, &[mode] | &[mode, 0 | 1]) => body.set_mode(mode).map(|()| done)?,
            (register::MOVE_JOINTS, params) => {
                let [joints @ .., speed, acceleration, _time] = numbers::<10>(params)?;
                body.go(Target {
                    joints,
                    speed,
                    acceleration,
                })
                .map(|()| done)?
            }
            (register::MOVE_JOINTS_BLENDED, params) => {
                let [joints @ .., speed, acceleration, radius] = numbers::<10>(params)?;
                if !(radius.is_finite() && radius >= 0.0) {
                    return Err(Refused);
                }
                body.go(Target {
                    joints,
                    speed,
                    acceleration,
                })
                .map(|()| done)?
            }
            (register::MOVE_HOME, params) => {
                let [speed, acceleration, _time] = numbers(params)?;
                let joints = [0.0; 7];
                body.go(Target {
                    joints,
                    speed,
                    acceleration,
                })
                .map(|()| done)?
            }
            (register::SERVO_JOINTS, params) => {
                let [joints @ .., _speed, _acceleration, _time] = numbers::<10>(params)?;
                body.follow(joints).map(|()| done)?
            }
            (register::CLEAR_ERROR, []) => {
                body.set_error(0);
                done
            }
            (register::CLEAR_WARNING, []) => {
                body.set_warning(0);
                done
            }
            (register::SET_APPROXIMATION, &[on @ (0 | 1)]) => {
                self.approximates = on == 1;
                done
            }
            (register::SET_TORQUE_SOURCE, &[source @ (0 | 1)]) => {
                self.torque_source = match source {
                    0 => TorqueSource::Torque,
                    _ => TorqueSource::Current,
                };
                done
            }
            _ => return Err(Refused),
        };
        Ok(())
    }
}

/// Parses little-endian `f32`.
fn numbers<const N: usize>(params: &[u8]) -> Result<[f32; N], Refused> {
    let (values, []) = params.as_chunks() else {
        return Err(Refused);
    };
    let values: [[u8; 4]; N] = values.try_into().map_err(|_| Refused)?;
    Ok(values.map(f32::from_le_bytes))
}

/// Encodes position and orientation of the flange.
fn pose(body: &Body, turn: impl Fn(&Frame) -> [f64; 3]) -> Vec<u8> {
    let flange = body.placed().flange;
    [floats(&flange.position), floats(&turn(&flange))].concat()
}

/// Encodes values as little-endian `f32`.
fn floats(values: &[f64]) -> Vec<u8> {
    values.iter().flat_map(|&value| (value as f32).to_le_bytes()).collect()
}
