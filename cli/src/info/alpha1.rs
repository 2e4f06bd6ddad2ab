//! The Alpha1.

use armwire::alpha1::{Alpha1, OLDEST_FIRMWARE, Request, Response};

use super::show;
use crate::describe::running;
use crate::error::Error;
use crate::link::{Line, Link};

pub(super) fn run(link: &mut Link<Alpha1, impl Line>) -> Result<(), Error> {
    for request in [
        Request::ReadHardwareVersion,
        Request::ReadFirmwareVersion,
        Request::ReadServoStates,
    ] {
        link.call(request, tell)?.unwrap_or(Ok(()))?;
    }
    Ok(())
}

fn tell(response: Response<'_>) -> Result<(), Error> {
    match response {
        Response::HardwareVersion(version) => {
            show("arm", "Alpha1")?;
            show("hardware", version)
        }
        Response::FirmwareVersion(version) => {
            let text = version.text.escape_ascii();
            let oldest = OLDEST_FIRMWARE.escape_ascii();
            match version.outcome.is_success() {
                true if version.text < OLDEST_FIRMWARE => show(
                    "firmware",
                    format_args!("{text}, before {oldest}, the first for this protocol"),
                ),
                true => show("firmware", text),
                false => show("firmware", "not told, the robot failed to"),
            }
        }
        Response::ServoStates(states) => show("running", format_args!("servos {}", running(states))),
        _ => Ok(()),
    }
}
