use armwire::driver::{CallError, Clock};
use armwire::ling::{Arm, Info, Move, Stroke, TemperatureLimit, Torque};
use armwire::time::Duration;
use embedded_io_async::{Read, Write};

/// Moves, and makes the pose the zero position if the arm reaches it within 10 s. Returns the arm's kind, and true if
/// it did.
async fn tour<P: Read + Write>(
    arm: &mut Arm<P, impl Clock>,
    clock: impl Clock,
    target: Move,
) -> Result<(Info, bool), CallError<P::Error>> {
    let info = arm.read_info().await?;
    if arm.read_stroke().await? != Stroke::Mm50 {
        arm.set_stroke(Stroke::Mm50).await?;
    }
    arm.set_temperature_limit(TemperatureLimit::FACTORY).await?;
    arm.set_torque(Torque::On).await?;
    arm.move_to(target).await?;

    let deadline = clock.now() + Duration::from_millis(10_000);
    while clock.now() < deadline {
        let near = target.are_joints_reached_by(&arm.read_joints().await?);
        // One velocity per servo: a joint may have two servos.
        let still = arm.read_velocities().await?.as_slice().iter().all(|&speed| speed == 0);
        if near && still {
            arm.set_zero().await?; // switches the torque off: a load that the arm holds falls
            return Ok((info, true));
        }
    }
    Ok((info, false))
}
