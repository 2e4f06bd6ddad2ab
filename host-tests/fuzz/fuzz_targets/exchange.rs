//! The exchange follows its rules: the request that an answer belongs to, the initiator that may send, the limits, and
//! no eviction. The oracle keeps every send.
#![no_main]

use armwire_fuzz::{Result, Unstructured};
use exchange_oracle::{Step, Who};
use libfuzzer_sys::fuzz_target;

#[allow(dead_code, unreachable_pub, reason = "the tests of the protocol crate have it, too")]
#[path = "../../../protocol/tests/exchange_oracle/mod.rs"]
mod exchange_oracle;

fuzz_target!(|input: &[u8]| {
    let mut u = Unstructured::new(input);
    let mut steps = Vec::new();
    while !u.is_empty() {
        // The rest may be too short for another step.
        let Ok(step) = any_step(&mut u) else { break };
        steps.push(step);
    }
    exchange_oracle::check(steps);
});

fn any_step(u: &mut Unstructured<'_>) -> Result<Step> {
    const KEYS: [u8; 5] = [0, 1, 2, 10, 11];
    const WHO: [Who; 3] = [Who::Usb, Who::Can, Who::Poll];
    Ok(match u.int_in_range(0..=8)? {
        0 | 2 => Step::Send(*u.choose(&KEYS)?, *u.choose(&WHO)?),
        1 => Step::Repeat(*u.choose(&KEYS)?, *u.choose(&WHO)?),
        3 => Step::GiveUp(*u.choose(&WHO)?),
        4 => Step::Answer(u.int_in_range(0..=7)?),
        7 => Step::Overtake(*u.choose(&KEYS)?, *u.choose(&WHO)?),
        8 => Step::Follow(*u.choose(&KEYS)?, *u.choose(&WHO)?),
        5 => Step::Frame(*u.choose(&KEYS)?, u.int_in_range(0..=3)?, u.int_in_range(0..=60)?),
        _ => Step::Wait(u.int_in_range(0..=200)?),
    })
}
