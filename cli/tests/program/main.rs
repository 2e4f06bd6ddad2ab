//! The built program, as a user runs it. One test program: each costs a link.
#![cfg(unix)]
#![forbid(unsafe_code)]

mod adapter;
mod alpha1;
mod bench;
mod bus;
mod call;
mod can;
mod common;
mod decode;
mod foreign;
#[cfg(target_os = "linux")]
mod hangup;
mod help;
mod legacy;
mod link;
mod list;
mod monitor;
mod motion;
mod park;
mod pty;
#[cfg(feature = "recordings")]
mod recordings;
#[cfg(feature = "recordings")]
mod replay;
#[cfg(all(feature = "selftest", target_os = "linux"))]
mod selftest;
#[cfg(feature = "shell")]
mod shell;
mod signals;
mod sim_ling;
mod sim_so101;
mod sim_xarm;
mod stop;
mod tcp;
mod teleop;
mod update;
mod versions;
mod xarm;
