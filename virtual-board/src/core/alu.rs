//! Arithmetic of the manual's pseudo-code (ARM DDI 0403E, D6.5 and A7.4).

use super::op::{Alu, Shift, ShiftKind};

/// The condition flags of the APSR, stored as the values that determine them.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Flags {
    /// Bit 31 is N.
    pub(super) n: u32,
    /// Z is set when this is 0.
    pub(super) z: u32,
    pub(super) c: bool,
    /// Bit 31 is V.
    pub(super) v: u32,
}

/// For each condition, a mask of the NZCV values for which it holds (A7.3).
const CONDITIONS: [u16; 16] = conditions();

const fn conditions() -> [u16; 16] {
    let mut table = [0; 16];
    let mut nzcv = 0;
    while nzcv < 16 {
        let (n, z, c, v) = (nzcv & 8 != 0, nzcv & 4 != 0, nzcv & 2 != 0, nzcv & 1 != 0);
        let holds = [z, c, n, v, c && !z, n == v, n == v && !z, true];
        let mut condition = 0;
        while condition < 16 {
            // AL has no opposite.
            let inverted = condition & 1 != 0 && condition != 15;
            if holds[condition / 2] != inverted {
                table[condition] |= 1 << nzcv;
            }
            condition += 1;
        }
        nzcv += 1;
    }
    table
}

impl Flags {
    /// The flags from the lowest four bits, N first.
    pub(super) fn new(nzcv: u32) -> Self {
        Self {
            n: nzcv << 28,
            z: !nzcv & 4,
            c: nzcv & 2 != 0,
            v: nzcv << 31,
        }
    }

    /// The flags in the lowest four bits, N first.
    #[inline(always)]
    pub(super) fn nzcv(self) -> u32 {
        self.n >> 31 << 3 | u32::from(self.z == 0) << 2 | u32::from(self.c) << 1 | self.v >> 31
    }

    /// Sets N and Z for this result.
    #[inline(always)]
    pub(super) fn set_nz(&mut self, result: u32) {
        self.n = result;
        self.z = result;
    }

    #[inline(always)]
    pub(super) fn holds(self, condition: u8) -> bool {
        CONDITIONS[usize::from(condition & 15)] >> self.nzcv() & 1 != 0
    }

    /// AddWithCarry(), setting all flags.
    #[inline(always)]
    pub(super) fn add(&mut self, a: u32, b: u32, carry: bool) -> u32 {
        let sum = u64::from(a) + u64::from(b) + u64::from(carry);
        let result = sum as u32;
        self.set_nz(result);
        self.c = sum >> 32 != 0;
        self.v = (a ^ result) & (b ^ result);
        result
    }

    /// A data-processing operation. `carry` is the carry flag after its second operand.
    #[inline(always)]
    pub(super) fn alu(&mut self, alu: Alu, a: u32, b: u32, carry: bool, set: bool) -> u32 {
        let old = *self;
        let result = match alu {
            Alu::And => self.logical(a & b, carry),
            Alu::Bic => self.logical(a & !b, carry),
            Alu::Orr => self.logical(a | b, carry),
            Alu::Orn => self.logical(a | !b, carry),
            Alu::Eor => self.logical(a ^ b, carry),
            Alu::Add => self.add(a, b, false),
            Alu::Adc => self.add(a, b, old.c),
            Alu::Sub => self.add(a, !b, true),
            Alu::Sbc => self.add(a, !b, old.c),
            Alu::Rsb => self.add(!a, b, true),
        };
        if !set {
            *self = old;
        }
        result
    }

    #[inline(always)]
    fn logical(&mut self, result: u32, carry: bool) -> u32 {
        self.set_nz(result);
        self.c = carry;
        result
    }

    /// Shift_C() by a constant: the result and the carry.
    #[inline(always)]
    pub(super) fn shift(self, value: u32, shift: Shift) -> (u32, bool) {
        shift_c(value, shift.kind, shift.amount.into(), self.c)
    }
}

/// Shift_C(): shifts by 0 to 255 bits. The result and the carry.
#[inline(always)]
pub(super) fn shift_c(value: u32, kind: ShiftKind, amount: u32, carry: bool) -> (u32, bool) {
    if amount == 0 {
        return (value, carry);
    }
    match kind {
        ShiftKind::Lsl => {
            let wide = u64::from(value).checked_shl(amount).unwrap_or(0);
            (wide as u32, wide >> 32 & 1 != 0)
        }
        ShiftKind::Lsr => {
            // One bit more at the bottom: the last one shifted out.
            let wide = (u64::from(value) << 1).checked_shr(amount).unwrap_or(0);
            ((wide >> 1) as u32, wide & 1 != 0)
        }
        ShiftKind::Asr => {
            let wide = (i64::from(value as i32) << 1) >> amount.min(33);
            ((wide >> 1) as u32, wide & 1 != 0)
        }
        ShiftKind::Ror => {
            let result = value.rotate_right(amount % 32);
            (result, result >> 31 != 0)
        }
        ShiftKind::Rrx => (value >> 1 | u32::from(carry) << 31, value & 1 != 0),
    }
}

/// SignedSatQ(): the value limited to a signed integer of `bits` bits, and true if it was limited.
pub(super) fn saturate_signed(value: i64, bits: u8) -> (i32, bool) {
    let limit = 1_i64 << (bits - 1);
    let result = value.clamp(-limit, limit - 1);
    (result as i32, result != value)
}

/// UnsignedSatQ(): the value limited to an unsigned integer of `bits` bits, and true if it was limited.
pub(super) fn saturate_unsigned(value: i64, bits: u8) -> (u32, bool) {
    let result = value.clamp(0, (1 << bits) - 1);
    (result as u32, result != value)
}

/// A half of a register as a signed integer.
#[inline(always)]
pub(super) fn signed_half(value: u32, top: bool) -> i32 {
    if top { value as i32 >> 16 } else { value as i16 as i32 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shifted(value: u32, kind: ShiftKind, amount: u32, carry: bool) -> (u32, bool) {
        shift_c(value, kind, amount, carry)
    }

    #[test]
    fn shifts_by_zero_keep_the_carry() {
        for kind in [ShiftKind::Lsl, ShiftKind::Lsr, ShiftKind::Asr, ShiftKind::Ror] {
            assert_eq!(shifted(0x8000_0001, kind, 0, true), (0x8000_0001, true));
            assert_eq!(shifted(0x8000_0001, kind, 0, false), (0x8000_0001, false));
        }
    }

    #[test]
    fn shifts_by_register_width_leave_the_last_bit() {
        assert_eq!(shifted(0x0000_0001, ShiftKind::Lsl, 32, false), (0, true));
        assert_eq!(shifted(0x8000_0000, ShiftKind::Lsl, 32, true), (0, false));
        assert_eq!(shifted(0x8000_0000, ShiftKind::Lsr, 32, false), (0, true));
        assert_eq!(shifted(0x0000_0001, ShiftKind::Lsr, 32, true), (0, false));
        assert_eq!(shifted(0x8000_0000, ShiftKind::Asr, 32, false), (0xffff_ffff, true));
        assert_eq!(shifted(0x7fff_ffff, ShiftKind::Asr, 32, true), (0, false));
        assert_eq!(shifted(0x8000_0001, ShiftKind::Ror, 32, false), (0x8000_0001, true));
    }

    #[test]
    fn shifts_beyond_register_width_leave_nothing() {
        for amount in [33, 64, 65, 255] {
            assert_eq!(shifted(u32::MAX, ShiftKind::Lsl, amount, true), (0, false));
            assert_eq!(shifted(u32::MAX, ShiftKind::Lsr, amount, true), (0, false));
            assert_eq!(shifted(0x8000_0000, ShiftKind::Asr, amount, false), (0xffff_ffff, true));
        }
        assert_eq!(shifted(0x0000_0003, ShiftKind::Ror, 33, false), (0x8000_0001, true));
        assert_eq!(shifted(0x4000_0000, ShiftKind::Ror, 255, false), (0x8000_0000, true));
    }

    #[test]
    fn shift_by_one_takes_the_edge_bits() {
        assert_eq!(shifted(0x8000_0001, ShiftKind::Lsl, 1, false), (2, true));
        assert_eq!(shifted(0x8000_0001, ShiftKind::Lsr, 1, false), (0x4000_0000, true));
        assert_eq!(shifted(0x8000_0001, ShiftKind::Asr, 1, false), (0xc000_0000, true));
        assert_eq!(shifted(0x0000_0001, ShiftKind::Rrx, 1, true), (0x8000_0000, true));
        assert_eq!(shifted(0x8000_0000, ShiftKind::Rrx, 1, false), (0x4000_0000, false));
    }

    #[test]
    fn addition_sets_carry_and_overflow() {
        for (a, b, carry, result, nzcv) in [
            (0x7fff_ffff, 0x0000_0001, false, 0x8000_0000, 0b1001),
            (0xffff_ffff, 0x0000_0001, false, 0x0000_0000, 0b0110),
            (0x8000_0000, 0x8000_0000, false, 0x0000_0000, 0b0111),
            (0xffff_ffff, 0xffff_ffff, true, 0xffff_ffff, 0b1010),
            (0x7fff_ffff, 0x7fff_ffff, true, 0xffff_ffff, 0b1001),
            (0x0000_0000, 0x0000_0000, false, 0x0000_0000, 0b0100),
            // 0 - 0 and 0 - 1: the carry is the inverse of the borrow.
            (0x0000_0000, !0x0000_0000, true, 0x0000_0000, 0b0110),
            (0x0000_0000, !0x0000_0001, true, 0xffff_ffff, 0b1000),
            (0x8000_0000, !0x0000_0001, true, 0x7fff_ffff, 0b0011),
        ] {
            let mut flags = Flags::new(0);
            assert_eq!(flags.add(a, b, carry), result, "{a:#x} + {b:#x} + {carry}");
            assert_eq!(flags.nzcv(), nzcv, "{a:#x} + {b:#x} + {carry}");
        }
    }

    #[test]
    fn flags_survive_every_combination() {
        for nzcv in 0..16 {
            assert_eq!(Flags::new(nzcv).nzcv(), nzcv);
        }
    }

    #[test]
    fn conditions_hold_as_the_manual_lists_them() {
        let holding = |nzcv| (0..15).filter(|c| Flags::new(nzcv).holds(*c)).collect::<Vec<u8>>();
        // NE, CC, PL, VC, LS, GE, GT, AL
        assert_eq!(holding(0b0000), [1, 3, 5, 7, 9, 10, 12, 14]);
        // EQ, CC, PL, VC, LS, GE, LE, AL
        assert_eq!(holding(0b0100), [0, 3, 5, 7, 9, 10, 13, 14]);
        // NE, CS, PL, VC, HI, GE, GT, AL
        assert_eq!(holding(0b0010), [1, 2, 5, 7, 8, 10, 12, 14]);
        // NE, CC, MI, VC, LS, LT, LE, AL
        assert_eq!(holding(0b1000), [1, 3, 4, 7, 9, 11, 13, 14]);
        // NE, CC, MI, VS, LS, GE, GT, AL
        assert_eq!(holding(0b1001), [1, 3, 4, 6, 9, 10, 12, 14]);
    }

    #[test]
    fn saturation_stops_at_the_limits() {
        assert_eq!(saturate_signed(127, 8), (127, false));
        assert_eq!(saturate_signed(128, 8), (127, true));
        assert_eq!(saturate_signed(-129, 8), (-128, true));
        assert_eq!(saturate_signed(i64::from(i32::MAX) + 1, 32), (i32::MAX, true));
        assert_eq!(saturate_signed(1, 1), (0, true));
        assert_eq!(saturate_unsigned(256, 8), (255, true));
        assert_eq!(saturate_unsigned(-1, 8), (0, true));
        assert_eq!(saturate_unsigned(1, 0), (0, true));
    }
}
