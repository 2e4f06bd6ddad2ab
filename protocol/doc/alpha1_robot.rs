use armwire::alpha1::{Action, Arm, OLDEST_FIRMWARE, OffsetTool, Text, UsbType};
use armwire::driver::{CallError, Clock};
use armwire::time::Duration;
use embedded_io_async::{Read, Write};

/// Moves the robot and waits until it has arrived, then plays the action of this name. Returns false if the robot's
/// firmware is too old.
async fn robot<P: Read + Write>(
    arm: &mut Arm<P, impl Clock>,
    clock: impl Clock,
    action: Action,
    name: Text<'_>,
) -> Result<bool, CallError<P::Error>> {
    let firmware = arm.read_firmware_version().await?;
    if firmware.text < OLDEST_FIRMWARE {
        let hardware = arm.read_hardware_version(|version| version.to_string()).await?;
        println!("{hardware} with firmware {firmware}");
        return Ok(false);
    }
    arm.act(action).await?;
    // The robot does not report arrival: its states report whether a servo is powered, moving or not.
    let time = action.time.duration().as_millis() as u64;
    clock.wait_until(clock.now() + Duration::from_millis(time)).await;
    println!("powered: {:032b}", arm.read_servo_states().await?.bits());

    arm.play(name).await?;
    arm.stop().await?;
    arm.set_offset_tool(OffsetTool::Disconnect).await?;
    arm.set_usb_type(UsbType::SerialPort).await?;
    Ok(true)
}
