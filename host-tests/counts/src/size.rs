//! The decoders of the protocols that are switched on, their clients too if those are, and nothing else. What is not called
//! is not linked.
#![no_std]
#![no_main]

use core::panic::PanicInfo;

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    loop {}
}

#[cortex_m_rt::entry]
fn main() -> ! {
    #[cfg(feature = "ling")]
    ling();
    #[cfg(feature = "xarm")]
    xarm();
    #[cfg(feature = "alpha1")]
    alpha1();
    loop {
        core::hint::spin_loop();
    }
}

#[cfg(feature = "ling")]
fn ling() {
    use armwire::ling::{Ling, MAX_FRAME, Request};

    static RAM: calls::Ram<{ calls::size::<Ling, MAX_FRAME>() }> = calls::ram();
    calls::call_all::<Ling, MAX_FRAME>(&RAM, Request::ReadJoints);
}

#[cfg(feature = "xarm")]
fn xarm() {
    use armwire::xarm::{MAX_FRAME, Request, XArm};

    static RAM: calls::Ram<{ calls::size::<XArm, MAX_FRAME>() }> = calls::ram();
    calls::call_all::<XArm, MAX_FRAME>(&RAM, Request::Heartbeat);
}

#[cfg(feature = "alpha1")]
fn alpha1() {
    use armwire::alpha1::{Alpha1, MAX_FRAME, Request};

    static RAM: calls::Ram<{ calls::size::<Alpha1, MAX_FRAME>() }> = calls::ram();
    calls::call_all::<Alpha1, MAX_FRAME>(&RAM, Request::Stop);
}

#[cfg(any(feature = "ling", feature = "xarm", feature = "alpha1"))]
mod calls {
    use core::hint::black_box;
    use core::sync::atomic::AtomicU8;

    use armwire::Protocol;

    /// As much RAM as a client or decoder takes, in bytes. It stands for one, so that none has to be made at compile time.
    pub(crate) type Ram<const N: usize> = [AtomicU8; N];

    pub(crate) const fn ram<const N: usize>() -> Ram<N> {
        [const { AtomicU8::new(0) }; N]
    }

    pub(crate) const fn size<P: Protocol, const N: usize>() -> usize {
        #[cfg(feature = "client")]
        return size_of::<armwire::Client<P, N>>();
        #[cfg(not(feature = "client"))]
        size_of::<armwire::Decoder<P, N>>()
    }

    /// Calls what a client has, with values that the compiler knows nothing about, and so all that the decoder has for it.
    #[cfg(feature = "client")]
    pub(crate) fn call_all<P: Protocol, const N: usize>(ram: &[AtomicU8], request: P::Request) {
        use armwire::{Client, Config, Input, Micros};

        black_box(ram);
        let now = black_box(Micros(0));
        let mut client = Client::<P, N>::new(black_box(Config::DEFAULT));
        let client = black_box(&mut client);
        black_box(client.submit(black_box(request)).is_ok());
        black_box(client.poll_transmit(now));
        let _ = client.transmitted(now, black_box(0));
        black_box(client.poll_timeout());
        let received = [0; 64];
        for mut input in black_box([Input::Bytes(black_box(&received)), Input::Idle, Input::Tick]) {
            while let Some(event) = client.handle(now, &mut input) {
                black_box(event);
            }
        }
        client.cancel(now);
    }

    /// Calls what a decoder has for bytes and for silence.
    #[cfg(not(feature = "client"))]
    pub(crate) fn call_all<P: Protocol, const N: usize>(ram: &[AtomicU8], _: P::Request) {
        use armwire::Decoder;

        black_box(ram);
        let mut decoder = Decoder::<P, N>::new();
        let decoder = black_box(&mut decoder);
        let expect = black_box(P::REQUESTS);
        let received = [0; 64];
        let mut bytes = black_box(&received[..]);
        while let Some(next) = decoder.decode(&mut bytes, expect) {
            black_box(next.is_ok());
        }
        black_box(decoder.idle(expect));
    }
}
