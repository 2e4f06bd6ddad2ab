//! The public entry points of decoder, client and device, each a function of its own with a name to read.
//!
//! `cargo xtask stack` links it and adds up, from the machine code, what each takes of the stack at worst. It is not run.
//!
//! What an entry point returns lies on its caller's stack, and so does what it is given by value and does not fit in
//! registers: neither is counted.
#![no_std]
#![no_main]

use core::panic::PanicInfo;

use armwire::{
    BufferTooShort, Busy, Client, Config, Decoder, Device, Event, Framing, Heard, Input, Micros, Noise, Protocol,
};

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    loop {}
}

/// The entry points for a protocol. It is a macro because a function with a name for the linker cannot be generic.
macro_rules! entry_points {
    ($name:literal, $module:ident, $protocol:path, $max_frame:expr) => {
        mod $module {
            use super::*;

            type P = $protocol;
            const N: usize = $max_frame;

            #[unsafe(export_name = concat!("Decoder<", $name, ">::new"))]
            fn decoder_new() -> Decoder<P, N> {
                Decoder::new()
            }

            #[unsafe(export_name = concat!("Decoder<", $name, ">::space"))]
            fn decoder_space(decoder: &mut Decoder<P, N>) -> &mut [u8] {
                decoder.space()
            }

            #[unsafe(export_name = concat!("Decoder<", $name, ">::commit"))]
            fn decoder_commit(decoder: &mut Decoder<P, N>, n: usize) -> bool {
                decoder.commit(n).is_ok()
            }

            #[unsafe(export_name = concat!("Decoder<", $name, ">::push"))]
            fn decoder_push<'b>(decoder: &mut Decoder<P, N>, bytes: &'b [u8]) -> &'b [u8] {
                decoder.push(bytes)
            }

            #[unsafe(export_name = concat!("Decoder<", $name, ">::next"))]
            fn decoder_next(
                decoder: &mut Decoder<P, N>,
                expect: <P as Framing>::Expect,
            ) -> Option<Result<<P as Framing>::Frame<'_>, Noise>> {
                decoder.next(expect)
            }

            #[unsafe(export_name = concat!("Decoder<", $name, ">::decode"))]
            fn decoder_decode<'a, 'b: 'a>(
                decoder: &'a mut Decoder<P, N>,
                bytes: &mut &'b [u8],
                expect: <P as Framing>::Expect,
            ) -> Option<Result<<P as Framing>::Frame<'a>, Noise>> {
                decoder.decode(bytes, expect)
            }

            #[unsafe(export_name = concat!("Decoder<", $name, ">::need"))]
            fn decoder_need(decoder: &Decoder<P, N>, expect: <P as Framing>::Expect) -> usize {
                decoder.need(expect)
            }

            #[unsafe(export_name = concat!("Decoder<", $name, ">::idle"))]
            fn decoder_idle(decoder: &mut Decoder<P, N>, expect: <P as Framing>::Expect) -> Option<Noise> {
                decoder.idle(expect)
            }

            #[unsafe(export_name = concat!("Decoder<", $name, ">::pending"))]
            fn decoder_pending(decoder: &Decoder<P, N>) -> usize {
                decoder.pending()
            }

            #[unsafe(export_name = concat!("Decoder<", $name, ">::broken"))]
            fn decoder_broken(decoder: &Decoder<P, N>) -> Option<Noise> {
                decoder.broken()
            }

            #[unsafe(export_name = concat!("Client<", $name, ">::new"))]
            fn client_new(config: Config) -> Client<P, N> {
                Client::new(config)
            }

            // The error gives the request back.
            #[allow(clippy::result_large_err)]
            #[unsafe(export_name = concat!("Client<", $name, ">::submit"))]
            fn client_submit(
                client: &mut Client<P, N>,
                request: <P as Protocol>::Request,
            ) -> Result<(), Busy<<P as Protocol>::Request>> {
                client.submit(request)
            }

            #[unsafe(export_name = concat!("Client<", $name, ">::cancel"))]
            fn client_cancel(client: &mut Client<P, N>, now: Micros) {
                client.cancel(now);
            }

            #[unsafe(export_name = concat!("Client<", $name, ">::is_idle"))]
            fn client_is_idle(client: &Client<P, N>) -> bool {
                client.is_idle()
            }

            #[unsafe(export_name = concat!("Client<", $name, ">::poll_transmit"))]
            fn client_poll_transmit(client: &mut Client<P, N>, now: Micros) -> Option<&[u8]> {
                client.poll_transmit(now)
            }

            #[unsafe(export_name = concat!("Client<", $name, ">::transmitted"))]
            fn client_transmitted(client: &mut Client<P, N>, now: Micros, n: usize) {
                let _ = client.transmitted(now, n);
            }

            #[unsafe(export_name = concat!("Client<", $name, ">::poll_timeout"))]
            fn client_poll_timeout(client: &Client<P, N>) -> Option<Micros> {
                client.poll_timeout()
            }

            #[unsafe(export_name = concat!("Client<", $name, ">::handle"))]
            fn client_handle(client: &mut Client<P, N>, now: Micros, input: &mut Input<'_>) -> Option<Event<P>> {
                client.handle(now, input)
            }

            #[unsafe(export_name = concat!("Device<", $name, ">::new"))]
            fn device_new() -> Device<P, N> {
                Device::new()
            }

            #[unsafe(export_name = concat!("Device<", $name, ">::handle"))]
            fn device_handle(device: &mut Device<P, N>, input: &mut Input<'_>) -> Option<Heard<P>> {
                device.handle(input)
            }

            #[unsafe(export_name = concat!("Device<", $name, ">::respond"))]
            fn device_respond(
                device: &Device<P, N>,
                response: &<P as Protocol>::Response,
                out: &mut [u8],
            ) -> Result<usize, BufferTooShort> {
                device.respond(response, out)
            }
        }
    };
}

entry_points!("Ling", ling, armwire::ling::Ling, armwire::ling::MAX_FRAME);
entry_points!(
    "Legacy",
    legacy,
    armwire::ling::legacy::Legacy,
    armwire::ling::legacy::MAX_FRAME
);
entry_points!("XArm", xarm, armwire::xarm::XArm, armwire::xarm::MAX_FRAME);
entry_points!("Alpha1", alpha1, armwire::alpha1::Alpha1, armwire::alpha1::MAX_FRAME);
