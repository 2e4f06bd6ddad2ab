//! Halts and reconfiguration: the adapter puts its data toggles back as the host does (USB 2.0, 9.1.1.5, 9.4.5, 9.4.10).
//!
//! A data toggle that is not reset loses the next packet: the receiver acknowledges it and discards it as a
//! retransmission. Each change is therefore made after an even and after an odd number of packets.

use std::fmt::Display;

use armwire_bridge::control::Request as ControlRequest;
use serde_json::json;

use super::bench::{Bench, at};
use super::descriptors::port_endpoints;
use super::report::{Passed, Trouble, ensure};
use super::usb::{Direction, Payload, Request};
use super::{Checked, Plan};

/// Requests to an endpoint (USB 2.0, 9.4.5, 9.4.9).
const GET_STATUS: u8 = 0;
const SET_FEATURE: u8 = 3;
const ENDPOINT_HALT: u16 = 0;

/// Repetitions of each change, with one packet more each time.
const TIMES: u8 = 4;

/// Clears halts on halted and on running endpoints.
pub(super) fn halts(bench: &mut Bench<'_>, _: &Plan) -> Checked {
    let (output, input) = port_endpoints(bench)?;
    for (direction, address) in [(Direction::Out, output), (Direction::In, input)] {
        each_toggle(bench, format_args!("clear-halt, {direction:?}"), |bench| {
            Ok(bench.usb.clear_halt(direction)?)
        })?;
        each_toggle(bench, format_args!("a halt, {direction:?}"), |bench| {
            let halt = Request {
                kind: 0x02,
                request: SET_FEATURE,
                value: ENDPOINT_HALT,
                index: address.into(),
                payload: Payload::Write(&[]),
            };
            bench.usb.control(&halt)?;
            expect_halt(bench, address, true)?;
            bench.usb.clear_halt(direction)?;
            expect_halt(bench, address, false)
        })?;
    }
    let text = "set and cleared, both ways, at both data toggles".to_owned();
    Ok(Passed::new(text, [("times", json!(4 * TIMES))]))
}

/// Selects the interface and the configuration again.
pub(super) fn reconfiguration(bench: &mut Bench<'_>, _: &Plan) -> Checked {
    each_toggle(bench, "SET_INTERFACE", |bench| Ok(bench.usb.set_interface()?))?;
    each_toggle(bench, "SET_CONFIGURATION", |bench| {
        bench.usb.set_configuration()?;
        bench.forget_session();
        // The adapter drops its host here, together with the line coding.
        bench.open()
    })?;
    let text = "interface and configuration selected again, at both data toggles".to_owned();
    Ok(Passed::new(text, [("times", json!(2 * TIMES))]))
}

/// Repeats a change and expects every single packet after it, on both pipes.
fn each_toggle(
    bench: &mut Bench<'_>,
    name: impl Display,
    change: impl Fn(&mut Bench<'_>) -> Result<(), Trouble>,
) -> Result<(), Trouble> {
    for packets in 1..=TIMES {
        let mut once = || {
            change(bench)?;
            for byte in 0..packets {
                bench.echo(&[0x40 + byte])?;
                bench.call(ControlRequest::Identify)?;
            }
            Ok(())
        };
        once().map_err(at(format_args!("{name}, {packets} packets")))?;
    }
    Ok(())
}

fn expect_halt(bench: &mut Bench<'_>, address: u8, halted: bool) -> Result<(), Trouble> {
    let status = bench.usb.control(&Request {
        kind: 0x82,
        request: GET_STATUS,
        value: 0,
        index: address.into(),
        payload: Payload::Read(2),
    })?;
    ensure(
        status == [halted.into(), 0],
        format_args!("GET_STATUS of endpoint {address:#04x} read {status:02X?}"),
    )
}
