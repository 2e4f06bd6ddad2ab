//! The whole adapter, with any behaviour of its hosts, its arm and its buses: no byte is invented, altered or out of
//! order, every byte and every request is accounted for, and no overdue work is left.
#![no_main]

use armwire_bridge::UsbEvent;
use armwire_fuzz::adapter::{World, any_arm_bytes, any_arm_request, any_move_request};
use armwire_fuzz::{Result, Unstructured, any_good_config};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| {
    // A short input is skipped.
    let _ = check(&mut Unstructured::new(input));
});

fn check(u: &mut Unstructured<'_>) -> Result<()> {
    let config = any_good_config(u)?;
    let mut world = World::new(config, u.arbitrary()?);
    while !u.is_empty() {
        step(&mut world, u)?;
        world.check();
    }
    world.end();
    Ok(())
}

fn step(world: &mut World, u: &mut Unstructured<'_>) -> Result<()> {
    match u.int_in_range(0..=31)? {
        // The host on USB.
        0 => world.configured(u.arbitrary()?),
        1 => world.reset(),
        2 => world.usb_event(UsbEvent::Suspended),
        3 => world.usb_event(UsbEvent::Dtr(u.arbitrary()?)),
        4 => world.set_line_coding(u.arbitrary()?),
        5 => {
            // A valid line coding.
            let (is_fast, parity, has_two_stop_bits): (bool, u8, bool) = u.arbitrary()?;
            let [b0, b1, b2, b3] = if is_fast { 1_000_000 } else { 115_200_u32 }.to_le_bytes();
            world.set_line_coding([b0, b1, b2, b3, u8::from(has_two_stop_bits) * 2, parity % 3, 8]);
        }
        6 => world.usb_lost(u.arbitrary::<u8>()?.into()),
        7 => world.usb_sends(u.arbitrary()?),
        8 => world.usb_sends(&any_arm_request(u, world.arm_kind())?),
        9 => {
            // Three motion requests are a stream.
            let request = any_move_request(u)?;
            for _ in 0..3 {
                world.usb_sends(&request);
                world.uart_transmits();
            }
        }
        10 => {
            let packets = u.arbitrary::<u8>()?;
            if packets >= 0x80 {
                world.status();
            }
            (0..packets % 32).for_each(|_| world.usb_reads());
        }
        11 => world.control(u.arbitrary()?),
        // The arm, and the UART.
        12 => world.arm_sends(u.arbitrary()?),
        13 => world.arm_sends(&any_arm_bytes(u, world.arm_kind())?),
        14 => world.arm_answers(u.arbitrary()?),
        15 => world.line_idles(),
        16 => world.uart_errors(u.arbitrary()?),
        17 => _ = world.uart_transmits(),
        // Hosts on CAN.
        18 => world.can_sends(u.arbitrary()?),
        19 => world.can_sends(&any_arm_request(u, world.arm_kind())?),
        20 => {
            let request = any_move_request(u)?;
            for _ in 0..3 {
                world.can_sends(&request);
                while world.use_bus() {}
            }
        }
        21 => (0..4).for_each(|_| world.command(1, 2048, 25, 100)),
        22 => world.can_control(u.arbitrary()?),
        23 => world.command(u.arbitrary()?, u.arbitrary()?, u.arbitrary()?, u.arbitrary()?),
        24 => world.can_frame(u.arbitrary()?, u.arbitrary()?),
        25 => (0..u.arbitrary::<u8>()? % 64).for_each(|_| _ = world.use_bus()),
        26 => world.bus_off(u.arbitrary()?),
        27 => world.can_errors(u.arbitrary::<u8>()?.into(), u.arbitrary::<u8>()?.into()),
        // The firmware, and the time.
        28 => _ = world.act(u.arbitrary()?),
        29 => world.wait(u.arbitrary::<u16>()?.into()),
        30 => world.wait_until_due(),
        _ => world.wait(u64::from(u.arbitrary::<u8>()?) * 4_000),
    }
    Ok(())
}
