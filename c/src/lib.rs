//! armwire for C: clients and devices of the three protocols, in memory of the caller.
//!
//! | Module | Contents |
//! |---|---|
//! | [`status`], [`fault`] | errors, their details and texts |
//! | [`event`], [`config`] | structures common to all protocols |
//! | `memory` | the boundary: pointers from C become references, or an error |
//! | `client`, `device` | the behaviour common to all clients and to all devices |
//! | `functions` | the functions of C that all protocols have |
//! | `ling`, `alpha1`, `xarm` | the functions and messages of a protocol |
//!
//! `armwire.h` is generated from this crate. Functions take `Option<&mut T>` where C passes `T *`: NULL is an error,
//! all other pointers must be valid.
#![no_std]

#[cfg(not(any(feature = "ling", feature = "alpha1", feature = "xarm")))]
compile_error!("a library without a protocol: enable the feature ling, alpha1 or xarm");

#[cfg(feature = "alpha1")]
pub mod alpha1;
mod client;
pub mod config;
mod device;
pub mod event;
pub mod fault;
mod functions;
#[cfg(feature = "ling")]
pub mod ling;
mod memory;
#[cfg(all(panic = "abort", not(test)))]
mod panic;
pub mod status;
pub mod text;
pub mod version;
#[cfg(feature = "xarm")]
pub mod xarm;
