//! Hosts on USB and on CAN, polls and cyclic commands share the arm as `docs/safety.md` promises: an answer goes to its
//! initiator, the line becomes free in time, the torque goes off in time and only then, and all losses are counted. The
//! fuzzer makes the choices that `host-tests/tests/adapter_runs.rs` draws at random.
#![no_main]

use armwire_host_tests::adapter;
use armwire_host_tests::random::Random;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| {
    adapter::run(Random::chosen(input));
});
