//! Robot arms and their adapters from a program on a PC: ports, blocking calls, and errors with remedies.
//!
//! A [port](Port) gives a [`Connection`], which opens an arm on it as a [`Ling`] or an [`Alpha1`]. An [`XArm`] has a
//! host of its own. The adapter between this computer and an arm is an [`Adapter`].
//!
//! ```
//! use std::time::Duration;
//!
//! use armwire::ling::arrival::Tolerances;
//! use armwire::ling::{GripperSpeed, Move, Position, Speed};
//!
//! # use std::sync::atomic::{AtomicBool, Ordering};
//! # use armwire_sim::{ling::{Config, LingArm}, pty::Pty, serve::serve};
//! # let (pty, stop) = (Pty::open(None)?, AtomicBool::new(false));
//! # let path = pty.path().to_str().unwrap().to_owned();
//! # let mut virtual_arm = LingArm::new(Config::follower());
//! # std::thread::scope(|scope| -> Result<(), Box<dyn std::error::Error>> {
//! # let serving = scope.spawn(|| serve(&mut virtual_arm, &pty, &stop));
//! # let result = (|| -> Result<(), Box<dyn std::error::Error>> {
//! # let port = path.as_str();
//! // `port` is such as "/dev/ttyUSB0", "COM3", "can:can0/3" or "tcp:arm.local:4000".
//! let mut arm = armwire_host::open(port)?.ling()?;
//! let pose = arm.read_joints()?;
//! let mut joints = pose.positions()?.map(|position| (position, Speed::MAX));
//! joints[5] = (Position::from_radians(0.1)?, Speed::new(300)?);
//! let target = Move { joints, gripper: (pose.opening()?, GripperSpeed(1000)) };
//! let reached = arm.move_and_wait(&target, Tolerances::MOVE, Duration::from_secs(10))?;
//! assert_eq!(target.away(&reached, &Tolerances::MOVE), None);
//! # Ok(())
//! # })();
//! # stop.store(true, Ordering::Relaxed);
//! # serving.join().unwrap()?;
//! # result
//! # })
//! # .map_err(|error| error.to_string())?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Motion
//!
//! A Ling arm is moved only if its last reading did not show the torque off, and keeps its last grip in a stop. An
//! [interrupt](Ling::set_interrupt), such as a check for Ctrl-C, ends a call and stops the arm that
//! [`move_and_wait`](Ling::move_and_wait) moves. A stop is not an emergency stop: keep a switch in the arm's supply.
//!
//! A program that sends a move every few milliseconds takes a [`Stream`] of the arm, which waits for no answer.
//! [`follow::Follow`], for teleoperation, [`replay::Replay`] and [`trajectory::Trajectory`] decide its moves. They are
//! sources of targets of one [`engine::Engine`], without I/O and without a clock.
//!
//! # The newest pose
//!
//! A [`Reader`] reads the pose of an arm in a thread of its own: [`latest`](Reader::latest) never waits, and
//! [`at`](Reader::at) has the pose at the time of an image. Commands go on through the [`Shared`] arm.
//!
//! # Joints of other programs
//!
//! A robot's model, a data set or another program may have other names, units and zeros of the joints: a
//! [joints file](joints_file) has them, with limits.
//!
//! # A protocol of your own
//!
//! [`Connection::raw`] opens a port, other than a HID device, for another protocol: a [`RawPort`] has its bytes, with the
//! lock, the errors, the [interrupt](RawPort::set_interrupt) and the [tap](Tap) that the arms have.
//!
//! # Errors
//!
//! An [`Error`] says what was wrong, and where. As in [`armwire`], its text has the cause, and `source` returns none. It
//! has no words of a certain program: a program puts its own in at each [`Remedy`]. It does no I/O:
//! [`Connection::explain`] asks the adapter and the system for what only those know. Text from outside in it is escaped:
//! see [`Outside`].
//!
//! # Features
//!
//! `hid`, on by default, opens an Alpha1 that is a HID device. Without it such a port is [`Error::Disabled`].
// docs.rs shows the feature that an item needs. This is unstable, and used there only.
#![cfg_attr(docsrs, feature(doc_cfg))]
#![forbid(unsafe_code)]

mod arm;
pub mod describe;
mod error;
mod motion;
mod ports;
mod reader;
mod time;

/// The crate of the protocols, whose types are those of arms.
pub use armwire;
/// The crate of the adapter, whose types are those of its control port.
pub use armwire_bridge as bridge;

pub use arm::alpha1::Alpha1;
pub use arm::joints_file;
pub use arm::known::Known;
pub use arm::ling::{Ling, ModeSwitching, MotionReadings, Parking, Stream, StreamReading, Switching, Wait};
pub use arm::park_poses::ParkPoses;
pub use arm::pose::{OnPose, Pose, XArmPose};
pub use arm::shared::Shared;
pub use arm::xarm::XArm;
pub use describe::{Arm, Fact, Protocol};
pub use error::no_control::NoControl;
pub use error::no_pose::NoPose;
pub use error::outside::Outside;
pub use error::received::Missing;
pub use error::text::{Remedy, Text};
pub use error::{Error, SilentMotion, TorqueOffEffect};
pub use motion::axes::{AXES, Axes, Off, Tolerance};
pub use motion::goal::{Limits, Target, TrackingLimit, Way};
pub use motion::{engine, follow, replay, trajectory};
pub use ports::adapter::RECOVERY;
pub use ports::available::{PortInfo, ports};
pub use ports::control::{Adapter, ReservedLine};
pub use ports::hid::Selector;
pub use ports::interrupt::Interrupt;
pub use ports::link::{LineErrors, Link};
pub use ports::port::{Connection, Options, Port, open};
pub use ports::raw_port::RawPort;
pub use ports::system::has_serial_port;
pub use ports::tap::Tap;
pub use ports::tcp::TcpAddress;
pub use ports::{adapter, control, line_reservation, settings};
pub use reader::{Counts, Readable, Reader, Reading, Stamping};
pub use time::rate::Rate;
pub use time::silence::SilenceLimit;
pub use time::{stamps, stopwatch};
