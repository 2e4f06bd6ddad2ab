//! The xArm.

use armwire::xarm::{Reply, Request, State, XArm};

use super::show;
use crate::call::ask;
use crate::describe::torque_source;
use crate::error::Error;
use crate::link::{Line, Link};

pub(super) fn run(link: &mut Link<XArm, impl Line>) -> Result<(), Error> {
    let mut last = State::OK;
    for (name, request) in [
        ("version", Request::ReadVersion),
        ("serial", Request::ReadSerials),
        ("torque", Request::ReadTorqueSource),
    ] {
        let told = ask(link, request, |state, reply| {
            // Invalid is what was asked for, not the arm.
            last = State(state.0 & !State::INVALID.0);
            tell(name, state, reply)
        })?;
        told.unwrap_or(Ok(()))?;
    }
    show("state", last)
}

fn tell(name: &str, state: State, reply: Reply<'_>) -> Result<(), Error> {
    match reply {
        Reply::Version(text) => match text.version() {
            Ok(version) => {
                show(
                    "arm",
                    format_args!("xArm, {} axes, type {}", version.axes, version.kind),
                )?;
                show("hardware", version.arm)?;
                show("control box", version.control_box)?;
                show("firmware", version.firmware)
            }
            Err(error) => {
                show("arm", "xArm")?;
                show(name, format_args!("{text} ({error})"))
            }
        },
        Reply::Serials(serials) => show(name, serials),
        Reply::TorqueSource(source) => show(name, torque_source(source)),
        _ => show(name, format_args!("not told (state {state})")),
    }
}
