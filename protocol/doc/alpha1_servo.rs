use armwire::alpha1::{Address, Angle, Arm, Interval, Led, MoveTime, Offset, Outcome, ServoId};
use armwire::driver::{CallError, Clock};
use embedded_io_async::{Read, Write};

/// Increases a servo's zero offset by 1°, moves the servo, and changes its id. Returns true if everything succeeded.
async fn servo<P: Read + Write>(
    arm: &mut Arm<P, impl Clock>,
    servo: ServoId,
    target: Angle,
    free: ServoId,
) -> Result<bool, CallError<P::Error>> {
    let (outcome, version) = arm.read_servo_version(servo).await?;
    println!("{outcome:?}: {version:02x?}");
    // The offset is invalid after a failure.
    let (Outcome::Success, thirds) = arm.read_servo_offset(servo).await? else {
        return Ok(false);
    };
    let Ok(offset) = Offset::new(thirds.saturating_add(3)) else {
        return Ok(false);
    };
    if arm.set_servo_offset(servo, offset).await? == Outcome::Failure {
        return Ok(false);
    }
    let (second, lock) = (MoveTime::new(50), Interval::new(50));
    arm.move_servo(Address::One(servo), target, second, lock).await?;
    arm.set_servo_led(Address::All, Led(0)).await?;
    let (outcome, _target, actual) = arm.read_servo_angles(servo).await?; // switches the motor off
    println!("{outcome:?}: {actual}°");
    let changed = arm.change_servo_id(servo, free).await?;
    arm.release_servo(Address::All).await?; // a load that they hold falls
    Ok(changed.is_success())
}
