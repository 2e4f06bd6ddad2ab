use armwire::alpha1::{Address, Angle, Arm, Interval, Led, MoveTime, Offset, ServoId};
use armwire::driver::{CallError, Clock};
use embedded_io_async::{Read, Write};

/// Increases a servo's zero offset by 1°, moves the servo, and changes its id. Returns false if its offset is at the
/// maximum.
async fn servo<P: Read + Write>(
    arm: &mut Arm<P, impl Clock>,
    servo: ServoId,
    target: Angle,
    free: ServoId,
) -> Result<bool, CallError<P::Error>> {
    println!("version {:02x?}", arm.read_servo_version(servo).await?);
    let thirds = arm.read_servo_offset(servo).await?;
    let Ok(offset) = Offset::new(thirds.saturating_add(3)) else {
        return Ok(false);
    };
    arm.set_servo_offset(servo, offset).await?;
    let (second, lock) = (MoveTime::new(50), Interval::new(50));
    arm.move_servo(Address::One(servo), target, second, lock).await?;
    arm.set_servo_led(Address::All, Led(0)).await?;
    let angles = arm.read_servo_angles(servo).await?; // switches the motor off
    println!("at {}°", angles.actual);
    arm.change_servo_id(servo, free).await?;
    arm.release_servo(Address::All).await?; // a load that they hold falls
    Ok(true)
}
