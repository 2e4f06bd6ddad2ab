//! The xArm.

use armwire::xarm::{Command, Reply, State, Transactions, XArm};

use super::show;
use crate::call::ask;
use crate::describe::torque_source;
use crate::link::{Line, Link};
use crate::problem::Problem;

pub(super) fn run(link: &mut Link<XArm, impl Line>) -> Result<(), Problem> {
    let mut transactions = Transactions::new();
    let mut last = State::OK;
    for (name, command) in [
        ("version", Command::ReadVersion),
        ("serial", Command::ReadSerials),
        ("torque", Command::ReadTorqueSource),
    ] {
        let Some((state, reply)) = ask(link, &mut transactions, command)? else {
            continue;
        };
        // Invalid is what was asked for, not the arm.
        last = State(state.0 & !State::INVALID.0);
        match reply {
            Reply::Version(text) => match text.version() {
                Ok(version) => {
                    show(
                        "arm",
                        format_args!("xArm, {} axes, type {}", version.axes, version.kind),
                    )?;
                    show("hardware", version.arm)?;
                    show("control box", version.control_box)?;
                    show("firmware", version.firmware)?;
                }
                Err(error) => {
                    show("arm", "xArm")?;
                    show(name, format_args!("{text} ({error})"))?;
                }
            },
            Reply::Serials(serials) => show(name, serials)?,
            Reply::TorqueSource(source) => show(name, torque_source(source))?,
            _ => show(name, format_args!("not told (state {state})"))?,
        }
    }
    show("state", last)
}
