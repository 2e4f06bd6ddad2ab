//! Robot arms and their adapters from a program on a PC: ports, blocking calls, and errors with remedies.
//!
//! A [port](Port) gives a [`Connection`], which opens an arm on it as a [`Ling`] or an [`Alpha1`]. An [`XArm`] has a
//! host of its own. The adapter between this computer and an arm is an [`Adapter`].
//!
//! ```
//! use std::time::Duration;
//!
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
//! let reached = arm.move_and_wait(&target, Duration::from_secs(10))?;
//! assert!(target.is_reached_by(&reached));
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
//! [`follow::Follow`], for teleoperation, and [`replay::Replay`] decide its moves: both are without I/O.
//!
//! # The newest pose
//!
//! A [`Reader`] reads the pose of an arm in a thread of its own: [`latest`](Reader::latest) never waits, and
//! [`at`](Reader::at) has the pose at the time of an image. Commands go on through the [`Shared`] arm.
//!
//! # Errors
//!
//! An [`Error`] says what was wrong, and where. As in [`armwire`], its text has the cause, and `source` returns none. It
//! has no words of a certain program: a program puts its own in at each [`Remedy`]. It does no I/O:
//! [`Connection::explain`] asks the adapter for what only that knows. Text from outside in it is escaped: see [`Outside`].
//!
//! # Features
//!
//! `hid`, on by default, opens an Alpha1 that is a HID device. Without it such a port is [`Error::Disabled`].
#![forbid(unsafe_code)]

pub mod adapter;
mod alpha1;
mod available;
mod can;
pub mod control;
pub mod describe;
mod error;
pub mod follow;
mod goal;
mod hid;
mod legacy;
mod line;
pub mod line_holder;
mod ling;
mod link;
mod outside;
mod pace;
mod port;
mod port_holder;
mod reader;
mod received;
pub mod replay;
mod serial;
pub mod settings;
mod shared;
pub mod stamps;
mod stop;
pub mod stopwatch;
mod tap;
mod tcp;
mod text;
mod xarm;

/// The crate of the protocols, whose types are those of arms.
pub use armwire;
/// The crate of the adapter, whose types are those of its control port.
pub use armwire_bridge as bridge;

pub use adapter::RECOVERY;
pub use alpha1::Alpha1;
pub use available::{PortInfo, has_serial_port, ports};
pub use control::{Adapter, Hold};
pub use describe::{Arm, Fact, Protocol};
pub use error::{Error, Silence, TorqueOffEffect};
pub use goal::{Deviation, Limits};
pub use hid::Selector;
pub use ling::{Ling, Stream};
pub use link::{Interrupt, LineErrors, Link};
pub use outside::Outside;
pub use port::{Connection, Options, Port, open};
pub use reader::{Counts, NoPose, OnPose, Pose, Rate, Readable, Reader, Reading, Stamping, XArmPose};
pub use received::Missing;
pub use shared::Shared;
pub use tap::Tap;
pub use tcp::TcpAddress;
pub use text::{Remedy, Text};
pub use xarm::XArm;
