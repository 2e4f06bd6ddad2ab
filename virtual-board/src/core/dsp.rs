//! Arithmetic on halves and bytes of a register: the DSP extension (ARM DDI 0403E, A4.4.3, A4.4.4).

use super::alu::{saturate_signed, saturate_unsigned, signed_half};
use super::op::{Lanes, Parallel};

/// Adds each half.
pub(super) fn add_halves(a: u32, b: u32) -> u32 {
    let low = a.wrapping_add(b) & 0xffff;
    let high = (a >> 16).wrapping_add(b >> 16);
    high << 16 | low
}

/// A mask of the bytes whose bit of GE is set.
pub(super) fn byte_mask(ge: u8) -> u32 {
    (0..4).fold(0, |mask, byte| {
        mask | if ge >> byte & 1 != 0 { 0xff << (8 * byte) } else { 0 }
    })
}

/// The sum of the bytes' absolute differences.
pub(super) fn absolute_differences(a: u32, b: u32) -> u32 {
    let pairs = a.to_le_bytes().into_iter().zip(b.to_le_bytes());
    pairs.map(|(a, b)| u32::from(a.abs_diff(b))).sum()
}

/// The sum or difference of the products of both halves.
pub(super) fn dual_product(n: u32, m: u32, exchange: bool, subtract: bool) -> i64 {
    let m = if exchange { m.rotate_right(16) } else { m };
    let [low, high] = [false, true].map(|top| i64::from(signed_half(n, top)) * i64::from(signed_half(m, top)));
    if subtract { low - high } else { low + high }
}

/// QADD, QSUB, QDADD, QDSUB: `a` plus or minus `b`, optionally doubled; and true if anything was limited.
pub(super) fn saturating_add(a: u32, b: u32, double: bool, subtract: bool) -> (u32, bool) {
    let b = i64::from(b as i32);
    let (b, doubling_limited) = if double {
        saturate_signed(2 * b, 32)
    } else {
        (b as i32, false)
    };
    let (a, b) = (i64::from(a as i32), i64::from(b));
    let (result, limited) = saturate_signed(if subtract { a - b } else { a + b }, 32);
    (result as u32, limited || doubling_limited)
}

/// A parallel addition or subtraction: the result, and the GE flags if it sets them.
pub(super) fn parallel(how: Parallel, lanes: Lanes, unsigned: bool, n: u32, m: u32) -> (u32, Option<u8>) {
    let bits: u32 = if matches!(lanes, Lanes::Add8 | Lanes::Sub8) {
        8
    } else {
        16
    };
    let count = 32 / bits;
    let mask = u32::MAX >> (32 - bits);
    let element = |value: u32, lane: u32| {
        let field = value >> (bits * lane) & mask;
        let sign = if unsigned { 0 } else { field >> (bits - 1) };
        i64::from(field) - i64::from(sign) * (1 << bits)
    };
    let (mut result, mut ge) = (0, 0);
    for lane in 0..count {
        let subtract = match lanes {
            Lanes::Add16 | Lanes::Add8 => false,
            Lanes::Sub16 | Lanes::Sub8 => true,
            Lanes::AddSub => lane == 0,
            Lanes::SubAdd => lane == 1,
        };
        let exchange = matches!(lanes, Lanes::AddSub | Lanes::SubAdd);
        let (a, b) = (element(n, lane), element(m, if exchange { 1 - lane } else { lane }));
        let exact = if subtract { a - b } else { a + b };
        let kept = match how {
            Parallel::Modulo => exact,
            Parallel::Saturate if unsigned => saturate_unsigned(exact, bits as u8).0.into(),
            Parallel::Saturate => saturate_signed(exact, bits as u8).0.into(),
            Parallel::Halve => exact >> 1,
        };
        result |= (kept as u32 & mask) << (bits * lane);
        // A carry of an unsigned addition, otherwise a non-negative result.
        let greater_or_equal = if unsigned && !subtract {
            exact >> bits != 0
        } else {
            exact >= 0
        };
        if greater_or_equal {
            ge |= if bits == 8 { 1 } else { 3 } << (lane * bits / 8);
        }
    }
    (result, (how == Parallel::Modulo).then_some(ge))
}
