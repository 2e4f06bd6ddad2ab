use armwire::driver::{CallError, Clock};
use armwire::ling::arrival::{Arrived, Tolerances};
use armwire::ling::{Arm, Info, Move, Stop, Stroke, TemperatureLimit, Torque};
use armwire::time::Duration;
use embedded_io_async::{Read, Write};

/// Moves, and makes the pose the zero position if the arm reaches it within 10 s. Returns the arm's kind, and true if
/// it did.
async fn tour<P: Read + Write>(
    arm: &mut Arm<P, impl Clock>,
    target: Move,
) -> Result<(Info, bool), CallError<P::Error>> {
    let info = arm.read_info().await?;
    if arm.read_stroke().await? != Stroke::Mm50 {
        arm.set_stroke(Stroke::Mm50).await?;
    }
    arm.set_temperature_limit(TemperatureLimit::FACTORY).await?;
    arm.set_torque(Torque::On).await?;
    let arrived = arm.move_and_wait(target, Tolerances::MOVE, Duration::from_millis(10_000)).await?;
    if !matches!(arrived, Arrived::AtTarget(_)) {
        arm.stop(&mut Stop::after(&target)).await?;
        return Ok((info, false));
    }
    // One velocity per servo, in ticks per second: a joint may have two servos, and its last ticks take long.
    let velocities = arm.read_velocities().await?;
    let is_still = velocities.as_slice().iter().all(|&velocity| velocity < 20);
    if is_still {
        arm.set_zero().await?; // switches the torque off: a load that the arm holds falls
    }
    Ok((info, is_still))
}
