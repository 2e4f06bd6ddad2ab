use armwire::driver::{CallError, Clock};
use armwire::xarm::{Arm, Joint, ProtocolId, Raw, RotationRadius, TorqueSource};
use embedded_io_async::{Read, Write};

const READ_ERRORS: u8 = 15; // a register without a type of its own

/// Reboots an arm that reports an error. Returns the connection, the joint's radius of rotation, and true if the arm
/// was rebooted.
async fn tour<P: Read + Write>(
    mut arm: Arm<P, impl Clock>,
    joint: Joint,
) -> Result<(P, RotationRadius, bool), CallError<P::Error>> {
    arm.set_protocol(ProtocolId::Supervised);
    arm.heartbeat().await?;
    let is_known = arm.read_serials(|serials| serials.arm().is_some()).await?.value;
    let by_current = arm.read_torque_source().await?.value == TorqueSource::Current;
    if is_known && by_current {
        arm.reload_dynamics().await?;
    }
    let radius = arm.read_rotation_radius(joint).await?.value;
    let mut has_error = false;
    if let Ok(request) = Raw::new(READ_ERRORS, &[]) {
        // The numbers of the arm's error and warning, 0 for none.
        let errors = |answer: Raw| matches!(answer.params(), [error, _] if *error != 0);
        has_error = arm.raw(request, errors).await?.value;
    }
    if has_error {
        arm.reboot().await?; // after arm.shut_down() it must be switched on by hand
    }
    let _unknown = arm.counters().unknown;
    let (port, _clock) = arm.into_parts();
    Ok((port, radius, has_error))
}
