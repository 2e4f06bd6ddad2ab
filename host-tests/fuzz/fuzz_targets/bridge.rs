//! The whole adapter, whatever its hosts, its arm, its buses and the time do: no byte is invented, altered or put out of
//! order, every byte and every request is accounted for, and nothing that is late is left undone.
#![no_main]

use armwire_bridge::UsbEvent;
use armwire_bridge::control::MAX_FRAME;
use armwire_fuzz::adapter::{World, any_arm_bytes, any_move_request};
use armwire_fuzz::config::{any_good_config, any_request};
use armwire_fuzz::{Arbitrary, Result, Unstructured};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| {
    // Too short an input is none.
    let _ = check(&mut Unstructured::new(input));
});

#[derive(Arbitrary)]
enum Step<'a> {
    /// The host on USB.
    Configured(bool),
    Reset,
    Suspended,
    Dtr(bool),
    LineCoding([u8; 7]),
    GoodLineCoding {
        fast: bool,
        parity: u8,
        two: bool,
    },
    Lost(u8),
    UsbBytes(&'a [u8]),
    UsbRequest,
    /// Requests that move the arm, one after the other: three are a stream.
    UsbStreams,
    UsbTakes(u8),
    Control,
    /// The arm, and the UART.
    ArmBytes(&'a [u8]),
    ArmSays,
    ArmAnswers(&'a [u8]),
    Idle,
    UartErrors([u8; 4]),
    UartTakes(u8),
    /// Hosts on CAN.
    CanBytes(&'a [u8]),
    CanRequest,
    CanStreams,
    CommandStreams,
    CanControl,
    Command {
        skip: u8,
        joints: u16,
        speed: u8,
        gripper: u8,
    },
    CanFrame {
        id: u16,
        data: &'a [u8],
    },
    CanMoves(u8),
    BusOff(bool),
    CanErrors(u8, u8),
    /// Firmware, and the time.
    Act {
        done: bool,
    },
    Wait(u16),
    WaitUntilDue,
    WaitLong(u8),
}

fn check(u: &mut Unstructured<'_>) -> Result<()> {
    let config = any_good_config(u)?;
    let mut world = World::new(config, u.arbitrary()?);
    while !u.is_empty() {
        match u.arbitrary()? {
            Step::Configured(is) => world.configured(is),
            Step::Reset => world.reset(),
            Step::Suspended => {
                world.bridge.usb_event(UsbEvent::Suspended, world.now);
            }
            Step::Dtr(high) => {
                world.bridge.usb_event(UsbEvent::Dtr(high), world.now);
            }
            Step::LineCoding(coding) => world.line_coding(coding),
            Step::GoodLineCoding { fast, parity, two } => {
                let [b0, b1, b2, b3] = if fast { 1_000_000 } else { 115_200_u32 }.to_le_bytes();
                world.line_coding([b0, b1, b2, b3, u8::from(two) * 2, parity % 3, 8]);
            }
            Step::Lost(len) => world.usb_lost(len.into()),
            Step::UsbBytes(bytes) => world.usb_says(bytes),
            Step::UsbRequest => {
                let request = world.any_arm_request(u)?;
                world.usb_says(&request);
            }
            Step::UsbStreams => {
                let request = any_move_request(u)?;
                for _ in 0..3 {
                    world.usb_says(&request);
                    world.uart_takes(MAX_FRAME);
                }
            }
            Step::UsbTakes(packets) => {
                if packets >= 0x80 {
                    world.status();
                }
                (0..packets % 32).for_each(|_| world.usb_takes());
            }
            Step::Control => {
                let request = any_request(u)?;
                world.control_sends(request);
            }
            Step::ArmBytes(bytes) => world.arm_says(bytes),
            Step::ArmSays => {
                let bytes = any_arm_bytes(u, world.bridge.config().arm)?;
                world.arm_says(&bytes);
            }
            Step::ArmAnswers(data) => world.arm_answers(data),
            Step::Idle => world.line_idles(),
            Step::UartErrors(errors) => world.uart_errors(errors),
            Step::UartTakes(room) => {
                world.uart_takes(room.into());
            }
            Step::CanBytes(pdu) => world.can_says(pdu),
            Step::CanRequest => {
                let request = world.any_arm_request(u)?;
                world.can_says(&request);
            }
            Step::CanStreams => {
                let request = any_move_request(u)?;
                for _ in 0..3 {
                    world.can_says(&request);
                    while world.can_moves() {}
                }
            }
            Step::CommandStreams => {
                for _ in 0..4 {
                    world.command(1, 2048, 25, 100);
                }
            }
            Step::CanControl => {
                let request = any_request(u)?;
                world.can_asks(request);
            }
            Step::Command {
                skip,
                joints,
                speed,
                gripper,
            } => world.command(skip, joints, speed, gripper),
            Step::CanFrame { id, data } => world.can_frame(id, data),
            Step::CanMoves(frames) => {
                (0..frames % 64).for_each(|_| {
                    world.can_moves();
                });
            }
            Step::BusOff(off) => world.bus_off(off),
            Step::CanErrors(bus, overruns) => world.can_errors(bus.into(), overruns.into()),
            Step::Act { done } => {
                world.act(done);
            }
            Step::Wait(micros) => world.wait(micros.into()),
            Step::WaitUntilDue => world.wait_until_due(),
            Step::WaitLong(millis) => world.wait(u64::from(millis) * 4_000),
        }
        world.check();
    }
    world.end();
    Ok(())
}
