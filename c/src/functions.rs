//! The functions of C that all protocols have, and those of requests. They differ by protocol in names and types only.
//!
//! A call of a macro has each name in full, so that a search finds it. The caller imports the names in the bodies.

/// A client in memory of C, and the functions common to all clients. The body lists their names.
macro_rules! client {
    (
        $(#[$client_doc:meta])*
        $client:ident: $state:ty, $words:ident = $len:literal, tag $tag:literal, response $response:ty;
        $(#[$init_doc:meta])*
        $init:ident($config:expr, $messages:expr);
        $poll:ident;
        $transmitted:ident;
        $space:ident;
        $received:ident;
        $receive:ident;
        $idle:ident;
        $(#[$cancel_doc:meta])*
        $cancel:ident;
        $fault:ident;
    ) => {
        /// Size of a client, in words of 64 bits.
        pub const $words: usize = $len;

        $(#[$client_doc])*
        #[repr(C)]
        pub struct $client {
            opaque: [u64; $words],
        }

        // SAFETY: an array of `u64` in a `repr(C)` structure.
        unsafe impl memory::Memory for $client {
            type Value = $state;
            const TAG: u32 = memory::tag($tag);
        }

        $(#[$init_doc])*
        ///
        /// ARMWIRE_STATUS_VERSION if header and library differ, ARMWIRE_STATUS_OUT_OF_RANGE if the baud rate is 0.
        #[unsafe(no_mangle)]
        pub extern "C" fn $init(
            client: Option<&mut $client>,
            version: u32,
            config: Option<&ArmwireConfig>,
        ) -> ArmwireStatus {
            let state = State::new(version, config, $config, $messages);
            state.and_then(|state| memory::init(client, state)).into()
        }

        /// The next action. Call it again after every event except WAIT, after bytes were received or transmitted, and
        /// at `until_us` of a WAIT event. `now_us` is the time of a monotonic clock.
        #[unsafe(no_mangle)]
        pub extern "C" fn $poll(
            client: Option<&mut $client>,
            now_us: u64,
            event: Option<&mut ArmwireEvent>,
            response: Option<&mut $response>,
        ) -> ArmwireStatus {
            let (Some(event), Some(response)) = (event, response) else {
                return ArmwireStatus::Null;
            };
            let client = memory::open(client);
            client.map(|client| client.poll(now_us, event, response, <$response>::set)).into()
        }

        /// The line accepted the first `len` bytes of a TRANSMIT event.
        ///
        /// ARMWIRE_STATUS_OUT_OF_RANGE if `len` exceeds the remaining bytes. Nothing counts as transmitted then.
        #[unsafe(no_mangle)]
        pub extern "C" fn $transmitted(client: Option<&mut $client>, now_us: u64, len: usize) -> ArmwireStatus {
            memory::open(client).and_then(|client| client.transmitted(now_us, len)).into()
        }

        /// Free space for a read or DMA. Report the number of bytes with `received`, before any other call. Never
        /// empty after a WAIT event.
        #[unsafe(no_mangle)]
        pub extern "C" fn $space(
            client: Option<&mut $client>,
            space: Option<&mut *mut u8>,
            len: Option<&mut usize>,
        ) -> ArmwireStatus {
            memory::open(client).and_then(|client| client.space(space, len)).into()
        }

        /// The first `len` bytes of `space` arrived.
        ///
        /// ARMWIRE_STATUS_OUT_OF_RANGE if `len` exceeds the free space. Nothing is accepted then.
        #[unsafe(no_mangle)]
        pub extern "C" fn $received(client: Option<&mut $client>, now_us: u64, len: usize) -> ArmwireStatus {
            memory::open(client).and_then(|client| client.received(now_us, len)).into()
        }

        /// Copies in as many of the received bytes as fit and writes their number to `taken`. Poll until WAIT, then
        /// pass in the rest.
        ///
        /// # Safety
        ///
        /// `bytes` is NULL, or has `len` bytes.
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $receive(
            client: Option<&mut $client>,
            now_us: u64,
            bytes: *const u8,
            len: usize,
            taken: Option<&mut usize>,
        ) -> ArmwireStatus {
            // SAFETY: guaranteed by the caller.
            let bytes = unsafe { memory::bytes(bytes, len) };
            memory::take(client, bytes, taken, |client, bytes| client.receive(now_us, bytes)).into()
        }

        /// The UART reported an idle line. Never call it for a gap between USB packets.
        #[unsafe(no_mangle)]
        pub extern "C" fn $idle(client: Option<&mut $client>) -> ArmwireStatus {
            memory::open(client).map(State::idle).into()
        }

        $(#[$cancel_doc])*
        #[unsafe(no_mangle)]
        pub extern "C" fn $cancel(client: Option<&mut $client>) -> ArmwireStatus {
            memory::open(client).map(State::cancel).into()
        }

        /// The last rejected value or length, with its range.
        #[unsafe(no_mangle)]
        pub extern "C" fn $fault(client: Option<&mut $client>, fault: Option<&mut ArmwireFault>) -> ArmwireStatus {
            memory::open(client).and_then(|client| client.fault(fault)).into()
        }
    };
}

/// Functions that submit a request. Each stands with its parameters, and the request made of them or the error of a
/// value.
macro_rules! requests {
    ($client:ident; $($(#[$doc:meta])* $name:ident($($value:ident: $type:ty),*) => $request:expr;)*) => {
        $(
            $(#[$doc])*
            #[unsafe(no_mangle)]
            pub extern "C" fn $name(client: Option<&mut $client>, $($value: $type),*) -> ArmwireStatus {
                memory::open(client).and_then(|client| client.submit($request)).into()
            }
        )*
    };
}

/// A device in memory of C, and the functions common to all devices. The body lists their names, and has the function
/// that writes a response.
macro_rules! device {
    (
        $(#[$device_doc:meta])*
        $device:ident: $state:ty, $words:ident = $len:literal, tag $tag:literal, request $request:ty;
        $init:ident($messages:expr);
        $poll:ident($set:expr);
        $respond:item
        $space:ident;
        $received:ident;
        $receive:ident;
        $idle:ident;
        $fault:ident;
    ) => {
        /// Size of a device, in words of 64 bits.
        pub const $words: usize = $len;

        $(#[$device_doc])*
        #[repr(C)]
        pub struct $device {
            opaque: [u64; $words],
        }

        // SAFETY: an array of `u64` in a `repr(C)` structure.
        unsafe impl memory::Memory for $device {
            type Value = $state;
            const TAG: u32 = memory::tag($tag);
        }

        /// Initializes a device. `version` is ARMWIRE_VERSION.
        ///
        /// ARMWIRE_STATUS_VERSION if header and library differ.
        #[unsafe(no_mangle)]
        pub extern "C" fn $init(device: Option<&mut $device>, version: u32) -> ArmwireStatus {
            State::new(version, $messages).and_then(|state| memory::init(device, state)).into()
        }

        /// The next event. Call it again after every event except WAIT, and after bytes were received.
        #[unsafe(no_mangle)]
        pub extern "C" fn $poll(
            device: Option<&mut $device>,
            event: Option<&mut ArmwireEvent>,
            request: Option<&mut $request>,
        ) -> ArmwireStatus {
            let (Some(event), Some(request)) = (event, request) else {
                return ArmwireStatus::Null;
            };
            memory::open(device).map(|device| device.poll(event, request, $set)).into()
        }

        $respond

        /// Free space for a read or DMA. Report the number of bytes with `received`, before any other call. Never
        /// empty after a WAIT event.
        #[unsafe(no_mangle)]
        pub extern "C" fn $space(
            device: Option<&mut $device>,
            space: Option<&mut *mut u8>,
            len: Option<&mut usize>,
        ) -> ArmwireStatus {
            memory::open(device).and_then(|device| device.space(space, len)).into()
        }

        /// The first `len` bytes of `space` arrived.
        ///
        /// ARMWIRE_STATUS_OUT_OF_RANGE if `len` exceeds the free space. Nothing is accepted then.
        #[unsafe(no_mangle)]
        pub extern "C" fn $received(device: Option<&mut $device>, len: usize) -> ArmwireStatus {
            memory::open(device).and_then(|device| device.received(len)).into()
        }

        /// Copies in as many of the received bytes as fit and writes their number to `taken`. Poll until WAIT, then
        /// pass in the rest.
        ///
        /// # Safety
        ///
        /// `bytes` is NULL, or has `len` bytes.
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $receive(
            device: Option<&mut $device>,
            bytes: *const u8,
            len: usize,
            taken: Option<&mut usize>,
        ) -> ArmwireStatus {
            // SAFETY: guaranteed by the caller.
            let bytes = unsafe { memory::bytes(bytes, len) };
            memory::take(device, bytes, taken, State::receive).into()
        }

        /// The UART reported an idle line. Never call it for a gap between USB packets.
        #[unsafe(no_mangle)]
        pub extern "C" fn $idle(device: Option<&mut $device>) -> ArmwireStatus {
            memory::open(device).map(State::idle).into()
        }

        /// The last rejected value or length, with its range.
        #[unsafe(no_mangle)]
        pub extern "C" fn $fault(device: Option<&mut $device>, fault: Option<&mut ArmwireFault>) -> ArmwireStatus {
            memory::open(device).and_then(|device| device.fault(fault)).into()
        }
    };
}

pub(crate) use {client, device, requests};
