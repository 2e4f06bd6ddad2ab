//! Hosts on USB and on CAN, polls and cyclic commands share the arm as `docs/safety.md` promises: an answer goes to the
//! initiator that asked, the line is free again in time, the torque goes off in time and only then, and all that is lost is
//! counted. The fuzzer chooses what `host-tests/tests/adapter_runs.rs` draws at random.
#![no_main]

use armwire_host_tests::adapter;
use armwire_host_tests::random::Random;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| {
    adapter::run(Random::chosen(input));
});
