//! The Thumb instruction set: encodings to operations (ARM DDI 0403E, A5).
//!
//! The names of the tables follow the manual. An UNPREDICTABLE encoding with forbidden registers is refused.

use super::op::{
    Alu, Carry, Condition, Extend, Hint, Index, Lanes, LoadKind, Long, Multiple, Op, Parallel, Reg, Shift, ShiftKind,
    Signed,
};

/// No shift.
const UNSHIFTED: Shift = Shift {
    kind: ShiftKind::Lsl,
    amount: 0,
};

/// Returns true if this halfword begins a 32-bit instruction (A5.1).
pub(super) fn is_wide(first: u32) -> bool {
    first >> 11 >= 0b11101
}

/// Decodes a 16-bit instruction. Inside an IT block, most of them do not set the flags.
pub(super) fn decode_16(pc: u32, code: u32, in_it: bool) -> Op {
    let (low, mid) = (Reg::new(code & 7), Reg::new(code >> 3 & 7));
    let high = Reg::new(code >> 8 & 7);
    let s = !in_it;
    let pc = pc.wrapping_add(4);
    match code >> 10 {
        0b000000..0b000110 => {
            let shift = immediate_shift(code >> 11, code >> 6 & 31);
            move_shifted(s, low, mid, shift)
        }
        0b000110 | 0b000111 => {
            let alu = if code >> 9 & 1 == 0 { Alu::Add } else { Alu::Sub };
            if code >> 10 & 1 == 0 {
                alu_register(alu, s, low, mid, Reg::new(code >> 6 & 7), UNSHIFTED)
            } else {
                alu_immediate(alu, s, low, mid, code >> 6 & 7, Carry::Keep)
            }
        }
        0b001000 | 0b001001 => move_immediate(s, high, code & 0xff, Carry::Keep),
        0b001010 | 0b001011 => Op::CmpImm {
            n: high,
            imm: code & 0xff,
        },
        0b001100 | 0b001101 => alu_immediate(Alu::Add, s, high, high, code & 0xff, Carry::Keep),
        0b001110 | 0b001111 => alu_immediate(Alu::Sub, s, high, high, code & 0xff, Carry::Keep),
        0b010000 => data_processing_16(code >> 6 & 15, s, low, mid),
        0b010001 => special_data(pc, code),
        0b010010 | 0b010011 => Op::LdrLiteral {
            t: high,
            address: (pc & !3).wrapping_add((code & 0xff) * 4),
        },
        0b010100..0b011000 => load_store_register_16(code >> 9 & 7, low, mid, Reg::new(code >> 6 & 7)),
        0b011000..0b101000 => load_store_immediate_16(code),
        0b101000 | 0b101001 => Op::MovImm {
            d: high,
            imm: (pc & !3).wrapping_add((code & 0xff) * 4),
        },
        0b101010 | 0b101011 => Op::AddImm {
            d: high,
            n: Reg::SP,
            imm: (code & 0xff) * 4,
        },
        0b101100..0b110000 => miscellaneous_16(pc, code),
        0b110000 | 0b110001 => multiple(Op::StoreMultiple, high, code & 0xff, false, true),
        0b110010 | 0b110011 => {
            let write_back = code >> high.index() & 1 == 0;
            multiple(Op::LoadMultiple, high, code & 0xff, false, write_back)
        }
        0b110100..0b111000 => match code >> 8 & 15 {
            0b1110 => Op::Undefined,
            0b1111 => Op::Svc,
            condition => Op::BranchIf {
                condition: Condition(condition as u8),
                target: pc.wrapping_add(sign_extend(code & 0xff, 8) << 1),
            },
        },
        // Only the unconditional branch remains: 32-bit encodings were handled before.
        _ => Op::Branch {
            target: pc.wrapping_add(sign_extend(code & 0x7ff, 11) << 1),
        },
    }
}

/// A5.2.2.
fn data_processing_16(opcode: u32, s: bool, dn: Reg, m: Reg) -> Op {
    let alu = |alu| alu_register(alu, s, dn, dn, m, UNSHIFTED);
    let test = |alu| Op::TestReg {
        alu,
        n: dn,
        m,
        shift: UNSHIFTED,
    };
    let shift = |kind| Op::ShiftReg {
        kind,
        s,
        d: dn,
        n: dn,
        m,
    };
    match opcode {
        0b0000 => alu(Alu::And),
        0b0001 => alu(Alu::Eor),
        0b0010 => shift(ShiftKind::Lsl),
        0b0011 => shift(ShiftKind::Lsr),
        0b0100 => shift(ShiftKind::Asr),
        0b0101 => alu(Alu::Adc),
        0b0110 => alu(Alu::Sbc),
        0b0111 => shift(ShiftKind::Ror),
        0b1000 => test(Alu::And),
        0b1001 => alu_immediate(Alu::Rsb, s, dn, m, 0, Carry::Keep),
        0b1010 => Op::CmpReg { n: dn, m },
        0b1011 => test(Alu::Add),
        0b1100 => alu(Alu::Orr),
        0b1101 if s => Op::MulS { d: dn, n: dn, m },
        0b1101 => Op::Mul { d: dn, n: dn, m },
        0b1110 => alu(Alu::Bic),
        _ => Op::Mvn {
            s,
            d: dn,
            m,
            shift: UNSHIFTED,
        },
    }
}

/// A5.2.3: with any register.
fn special_data(pc: u32, code: u32) -> Op {
    let m = Reg::new(code >> 3);
    let dn = Reg::new(code & 7 | code >> 4 & 8);
    match code >> 8 & 3 {
        0 => match (dn, m) {
            (Reg::PC, Reg::PC) => Op::Unpredictable,
            (Reg::PC, _) => Op::AddPc { m, pc },
            (_, Reg::PC) => Op::AddImm { d: dn, n: dn, imm: pc },
            _ => Op::AddReg { d: dn, n: dn, m },
        },
        1 if dn == Reg::PC || m == Reg::PC => Op::Unpredictable,
        1 => Op::CmpReg { n: dn, m },
        2 => match (dn, m) {
            (Reg::PC, Reg::PC) => Op::Branch { target: pc },
            (Reg::PC, _) => Op::MovPc { m },
            (_, Reg::PC) => Op::MovImm { d: dn, imm: pc },
            _ => Op::MovReg { d: dn, m },
        },
        _ if code & 7 != 0 || m == Reg::PC => Op::Unpredictable,
        _ if code >> 7 & 1 == 0 => Op::BranchReg { m },
        _ => Op::BranchLinkReg { m },
    }
}

/// A5.2.4, opA 0101.
fn load_store_register_16(opcode: u32, t: Reg, n: Reg, m: Reg) -> Op {
    let load = |kind| Op::LoadReg {
        kind,
        t,
        n,
        m,
        shift: 0,
    };
    match opcode {
        0b000 => Op::StrReg { t, n, m, shift: 0 },
        0b001 => Op::StoreReg {
            kind: LoadKind::Half,
            t,
            n,
            m,
            shift: 0,
        },
        0b010 => Op::StrbReg { t, n, m, shift: 0 },
        0b011 => load(LoadKind::SignedByte),
        0b100 => Op::LdrReg { t, n, m, shift: 0 },
        0b101 => load(LoadKind::Half),
        0b110 => Op::LdrbReg { t, n, m, shift: 0 },
        _ => load(LoadKind::SignedHalf),
    }
}

/// A5.2.4, opA 0110 to 1001.
fn load_store_immediate_16(code: u32) -> Op {
    let (t, n) = (Reg::new(code & 7), Reg::new(code >> 3 & 7));
    let (sp_t, sp_offset) = (Reg::new(code >> 8 & 7), (code & 0xff) * 4);
    let offset = code >> 6 & 31;
    match code >> 11 {
        0b01100 => Op::Str {
            t,
            n,
            offset: offset * 4,
        },
        0b01101 => Op::Ldr {
            t,
            n,
            offset: offset * 4,
        },
        0b01110 => Op::Strb { t, n, offset },
        0b01111 => Op::Ldrb { t, n, offset },
        0b10000 => Op::Strh {
            t,
            n,
            offset: offset * 2,
        },
        0b10001 => Op::Ldrh {
            t,
            n,
            offset: offset * 2,
        },
        0b10010 => Op::Str {
            t: sp_t,
            n: Reg::SP,
            offset: sp_offset,
        },
        _ => Op::Ldr {
            t: sp_t,
            n: Reg::SP,
            offset: sp_offset,
        },
    }
}

/// A5.2.5.
fn miscellaneous_16(pc: u32, code: u32) -> Op {
    let (d, m) = (Reg::new(code & 7), Reg::new(code >> 3 & 7));
    let sp = |imm| Op::AddImm {
        d: Reg::SP,
        n: Reg::SP,
        imm,
    };
    match code >> 6 & 0x3f {
        0b000000 | 0b000001 => sp((code & 0x7f) * 4),
        0b000010 | 0b000011 => sp(((code & 0x7f) * 4).wrapping_neg()),
        0b001000 => extend(Extend::SignedHalf, d, m, 0),
        0b001001 => extend(Extend::SignedByte, d, m, 0),
        0b001010 => extend(Extend::Half, d, m, 0),
        0b001011 => extend(Extend::Byte, d, m, 0),
        // CBZ and CBNZ.
        0b000100..=0b000111 | 0b001100..=0b001111 | 0b100100..=0b100111 | 0b101100..=0b101111 => Op::CompareBranch {
            nonzero: code >> 11 & 1 != 0,
            n: d,
            target: pc.wrapping_add((code >> 9 & 1) << 6 | (code >> 3 & 31) << 1),
        },
        0b010000..=0b010111 => multiple(
            Op::StoreMultiple,
            Reg::SP,
            code & 0xff | (code & 0x100) << 6,
            true,
            true,
        ),
        0b110000..=0b110111 => multiple(
            Op::LoadMultiple,
            Reg::SP,
            code & 0xff | (code & 0x100) << 7,
            false,
            true,
        ),
        0b011001 if code & 0xffe8 == 0xb660 => Op::Cps {
            disable: code >> 4 & 1 != 0,
            primask: code >> 1 & 1 != 0,
            faultmask: code & 1 != 0,
        },
        0b101000 => Op::Rev { d, m },
        0b101001 => Op::Rev16 { d, m },
        0b101011 => Op::Revsh { d, m },
        0b111000..=0b111011 => Op::Bkpt,
        0b111100..=0b111111 => match code & 0xff {
            state if state & 15 != 0 => if_then(state),
            hint => Op::Hint(hint_16(hint >> 4)),
        },
        _ => Op::Undefined,
    }
}

fn hint_16(hint: u32) -> Hint {
    match hint {
        2 => Hint::Wfe,
        3 => Hint::Wfi,
        4 => Hint::Sev,
        // NOP, YIELD; reserved hints execute as NOP.
        _ => Hint::Nop,
    }
}

/// IT (A7.7.38).
fn if_then(state: u32) -> Op {
    let (condition, mask) = (state >> 4, state & 15);
    if condition == 15 || condition == 14 && mask.count_ones() != 1 {
        return Op::Unpredictable;
    }
    Op::It { state: state as u8 }
}

/// Decodes a 32-bit instruction.
pub(super) fn decode_32(pc: u32, first: u32, second: u32) -> Op {
    let op2 = first >> 4 & 0x7f;
    let pc = pc.wrapping_add(4);
    match (first >> 11 & 3, op2) {
        (0b01 | 0b11, 0x40..) => Op::Coprocessor {
            first: first as u16,
            second: second as u16,
        },
        (0b01, 0x20..) => data_processing_shifted(first, second),
        (0b01, _) if op2 >> 2 & 1 == 0 => load_store_multiple(first, second),
        (0b01, _) => load_store_dual(pc, first, second),
        (0b10, _) if second >> 15 != 0 => branches_and_control(pc, first, second),
        (0b10, _) if op2 >> 5 & 1 == 0 => data_processing_immediate(first, second),
        (0b10, _) => data_processing_plain(pc, first, second),
        (_, 0x30..=0x37) => multiply(first, second),
        (_, 0x38..=0x3f) => multiply_long(first, second),
        (_, 0x20..=0x2f) => data_processing_register(first, second),
        _ if op2 & 1 != 0 => load_single(pc, first, second),
        _ if op2 >> 4 & 1 == 0 => store_single(first, second),
        _ => Op::Undefined,
    }
}

/// A5.3.1.
fn data_processing_immediate(first: u32, second: u32) -> Op {
    let (n, d) = (Reg::new(first), Reg::new(second >> 8));
    let s = first >> 4 & 1 != 0;
    let Some((imm, carry)) = expand_immediate(immediate_12(first, second)) else {
        return Op::Unpredictable;
    };
    let opcode = first >> 5 & 15;
    let Some(alu) = alu_of(opcode) else {
        return Op::Undefined;
    };
    if d == Reg::PC && s && matches!(alu, Alu::And | Alu::Eor | Alu::Add | Alu::Sub) {
        return match alu {
            _ if n == Reg::PC || n == Reg::SP && matches!(alu, Alu::And | Alu::Eor) => Op::Unpredictable,
            Alu::Sub => Op::CmpImm { n, imm },
            _ => Op::TestImm { alu, n, imm, carry },
        };
    }
    match alu {
        Alu::Orr | Alu::Orn if n == Reg::PC && is_limited(d) => Op::Unpredictable,
        Alu::Orr if n == Reg::PC => move_immediate(s, d, imm, carry),
        Alu::Orn if n == Reg::PC => move_immediate(s, d, !imm, carry),
        _ if is_wrong_operand(alu, d, n) => Op::Unpredictable,
        _ => alu_immediate(alu, s, d, n, imm, carry),
    }
}

/// A5.3.3.
fn data_processing_plain(pc: u32, first: u32, second: u32) -> Op {
    let (n, d) = (Reg::new(first), Reg::new(second >> 8));
    let imm = immediate_12(first, second);
    let imm_16 = first << 12 & 0xf000 | imm;
    let lsb = second >> 10 & 0x1c | second >> 6 & 3;
    let low = second & 31;
    // From SSAT on, two bits must be zero.
    let bad = is_limited(d) || is_limited(n) || first >> 10 & 1 != 0 || second >> 5 & 1 != 0;
    match first >> 4 & 31 {
        0b00000 | 0b01010 if d == Reg::PC || d == Reg::SP && n != Reg::SP => Op::Unpredictable,
        0b00000 if n == Reg::PC => Op::MovImm {
            d,
            imm: (pc & !3).wrapping_add(imm),
        },
        0b00000 => Op::AddImm { d, n, imm },
        0b01010 if n == Reg::PC => Op::MovImm {
            d,
            imm: (pc & !3).wrapping_sub(imm),
        },
        0b01010 => Op::AddImm {
            d,
            n,
            imm: imm.wrapping_neg(),
        },
        0b00100 | 0b01100 if is_limited(d) => Op::Unpredictable,
        0b00100 => Op::MovImm { d, imm: imm_16 },
        0b01100 => Op::MovTop { d, imm: imm_16 as u16 },
        0b10110 if n == Reg::PC && !is_limited(d) && low >= lsb && first >> 10 & 1 == 0 && second >> 5 & 1 == 0 => {
            Op::Bfc {
                d,
                mask: bit_mask(lsb, low),
            }
        }
        _ if bad => Op::Unpredictable,
        0b10000 | 0b10010 => saturate(first, second, true),
        0b11000 | 0b11010 => saturate(first, second, false),
        0b10110 if low >= lsb => Op::Bfi {
            d,
            n,
            lsb: lsb as u8,
            mask: bit_mask(lsb, low),
        },
        0b10100 | 0b11100 if lsb + low < 32 => {
            let (lsb, shift) = (lsb as u8, (31 - low) as u8);
            match first >> 7 & 1 {
                0 => Op::Sbfx { d, n, lsb, shift },
                _ => Op::Ubfx { d, n, lsb, shift },
            }
        }
        0b10100 | 0b11100 | 0b10110 => Op::Unpredictable,
        _ => Op::Undefined,
    }
}

/// SSAT, USAT, SSAT16, USAT16.
fn saturate(first: u32, second: u32, signed: bool) -> Op {
    let (n, d) = (Reg::new(first), Reg::new(second >> 8));
    let amount = second >> 10 & 0x1c | second >> 6 & 3;
    let shift = immediate_shift(if first >> 5 & 1 == 0 { 0 } else { 2 }, amount);
    let bits = (second & 31) as u8 + u8::from(signed);
    match (first >> 5 & 1 != 0 && amount == 0, signed) {
        (true, _) if second >> 4 & 1 != 0 => Op::Unpredictable,
        (true, true) => Op::Ssat16 { d, n, bits },
        (true, false) => Op::Usat16 { d, n, bits },
        (false, true) => Op::Ssat { d, n, shift, bits },
        (false, false) => Op::Usat { d, n, shift, bits },
    }
}

/// A5.3.4.
fn branches_and_control(pc: u32, first: u32, second: u32) -> Op {
    let s = first >> 10 & 1;
    let (j1, j2) = (second >> 13 & 1, second >> 11 & 1);
    if second >> 12 & 1 != 0 {
        let (i1, i2) = (1 ^ j1 ^ s, 1 ^ j2 ^ s);
        let offset = s << 24 | i1 << 23 | i2 << 22 | (first & 0x3ff) << 12 | (second & 0x7ff) << 1;
        let target = pc.wrapping_add(sign_extend(offset, 25));
        return if second >> 14 & 1 == 0 {
            Op::Branch { target }
        } else {
            Op::BranchLink { target }
        };
    }
    if second >> 14 & 1 != 0 {
        return Op::Undefined;
    }
    let condition = first >> 6 & 15;
    if condition < 14 {
        let offset = s << 20 | j2 << 19 | j1 << 18 | (first & 0x3f) << 12 | (second & 0x7ff) << 1;
        return Op::BranchIf {
            condition: Condition(condition as u8),
            target: pc.wrapping_add(sign_extend(offset, 21)),
        };
    }
    let (n, d) = (Reg::new(first), Reg::new(second >> 8));
    match first >> 4 & 0x7f {
        0b0111000 | 0b0111001 if is_limited(n) => Op::Unpredictable,
        0b0111000 | 0b0111001 => Op::Msr {
            n,
            register: second as u8,
            mask: (second >> 10 & 3) as u8,
        },
        0b0111010 => match second & 0xff {
            0..16 => Op::Hint(hint_16(second & 15)),
            _ => Op::Hint(Hint::Nop),
        },
        0b0111011 => match second >> 4 & 15 {
            0b0010 => Op::Clrex,
            0b0100 | 0b0101 => Op::Hint(Hint::Nop),
            0b0110 => Op::Hint(Hint::Isb),
            _ => Op::Undefined,
        },
        0b0111110 | 0b0111111 if is_limited(d) => Op::Unpredictable,
        0b0111110 | 0b0111111 => Op::Mrs {
            d,
            register: second as u8,
        },
        _ => Op::Undefined,
    }
}

/// A5.3.5.
fn load_store_multiple(first: u32, second: u32) -> Op {
    let n = Reg::new(first);
    let write_back = first >> 5 & 1 != 0;
    let load = first >> 4 & 1 != 0;
    let decrement = match first >> 7 & 3 {
        0b01 => false,
        0b10 => true,
        _ => return Op::Undefined,
    };
    let base_in_list = write_back && second >> n.index() & 1 != 0;
    let forbidden = if load { 0x2000 } else { 0xa000 };
    let pc_and_lr = second & 0xc000 == 0xc000;
    if n == Reg::PC || second.count_ones() < 2 || second & forbidden != 0 || base_in_list || load && pc_and_lr {
        return Op::Unpredictable;
    }
    let op = if load { Op::LoadMultiple } else { Op::StoreMultiple };
    multiple(op, n, second, decrement, write_back)
}

fn multiple(op: fn(Multiple) -> Op, n: Reg, registers: u32, decrement: bool, write_back: bool) -> Op {
    match registers as u16 {
        0 => Op::Unpredictable,
        registers => op(Multiple {
            n,
            registers,
            decrement,
            write_back,
        }),
    }
}

/// A5.3.6.
fn load_store_dual(pc: u32, first: u32, second: u32) -> Op {
    let (n, t, t2) = (Reg::new(first), Reg::new(second >> 12), Reg::new(second >> 8));
    let load = first >> 4 & 1 != 0;
    let write_back = first >> 5 & 1 != 0;
    let pre = first >> 8 & 1 != 0;
    let add = first >> 7 & 1 != 0;
    let offset = ((second & 0xff) * 4) as i16;
    if pre || write_back {
        let wrong_base = if load { n == Reg::PC && write_back } else { n == Reg::PC };
        let base_is_lost = write_back && (n == t || n == t2);
        if is_limited(t) || is_limited(t2) || wrong_base || base_is_lost || load && t == t2 {
            return Op::Unpredictable;
        }
        let offset = if add { offset } else { -offset };
        let index = index(pre, write_back);
        return match (load, n) {
            (true, Reg::PC) => Op::LdrdLiteral {
                t,
                t2,
                address: (pc & !3).wrapping_add_signed(offset.into()),
            },
            (true, _) => Op::Ldrd {
                index,
                t,
                t2,
                n,
                offset,
            },
            (false, _) => Op::Strd {
                index,
                t,
                t2,
                n,
                offset,
            },
        };
    }
    exclusive_or_table(pc, first, second)
}

/// The other half of A5.3.6: LDREX, STREX, TBB, TBH and similar ones.
fn exclusive_or_table(pc: u32, first: u32, second: u32) -> Op {
    let (n, t, t2, m) = registers(first, second);
    let (sized, load, opcode) = (first >> 7 & 1 != 0, first >> 4 & 1 != 0, second >> 4 & 15);
    if sized && opcode < 2 && load {
        if is_limited(m) || n == Reg::SP || second >> 8 != 0xf0 {
            return Op::Unpredictable;
        }
        return Op::TableBranch {
            half: opcode == 1,
            n: (n != Reg::PC).then_some(n),
            m,
            pc,
        };
    }
    // The word form has an offset, and its status register in another field.
    let (kind, offset, d) = match (sized, opcode) {
        (false, _) => (LoadKind::Word, (second & 0xff) as u16 * 4, t2),
        (true, 0b0100) => (LoadKind::Byte, 0, m),
        (true, 0b0101) => (LoadKind::Half, 0, m),
        _ => return Op::Undefined,
    };
    let has_status = !load;
    let wrong_status = has_status && (is_limited(d) || d == n || d == t);
    // Unused register fields must be ones.
    let unused_are_ones = (t2 == Reg::PC || has_status && !sized) && (m == Reg::PC || has_status || !sized);
    if is_limited(t) || n == Reg::PC || wrong_status || !unused_are_ones {
        return Op::Unpredictable;
    }
    if load {
        Op::Ldrex { kind, t, n, offset }
    } else {
        Op::Strex { kind, d, t, n, offset }
    }
}

/// A5.3.7.
fn load_single(pc: u32, first: u32, second: u32) -> Op {
    let (n, t) = (Reg::new(first), Reg::new(second >> 12));
    let signed = first >> 8 & 1 != 0;
    let kind = match (first >> 5 & 3, signed) {
        (0, false) => LoadKind::Byte,
        (0, true) => LoadKind::SignedByte,
        (1, false) => LoadKind::Half,
        (1, true) => LoadKind::SignedHalf,
        (2, false) => LoadKind::Word,
        _ => return Op::Undefined,
    };
    let addressing = match addressing(pc, first, second) {
        Ok(addressing) => addressing,
        Err(wrong) => return wrong,
    };
    if t == Reg::PC && kind != LoadKind::Word {
        // PLD, PLI, and unallocated hints. None of them has write-back.
        return match addressing {
            Addressing::Immediate(Index::Offset, _) | Addressing::Register(..) | Addressing::Literal(_) => {
                Op::Hint(Hint::Nop)
            }
            _ => Op::Unpredictable,
        };
    }
    if t == Reg::SP && kind != LoadKind::Word {
        return Op::Unpredictable;
    }
    let base_is_lost = matches!(addressing, Addressing::Immediate(Index::Pre | Index::Post, _)) && n == t;
    match addressing {
        _ if base_is_lost => Op::Unpredictable,
        Addressing::User(_) if is_limited(t) => Op::Unpredictable,
        Addressing::User(offset) => Op::LoadUser { kind, t, n, offset },
        Addressing::Literal(address) if t == Reg::PC => Op::LoadPcLiteral { address },
        Addressing::Literal(address) if kind == LoadKind::Word && t != Reg::SP => Op::LdrLiteral { t, address },
        Addressing::Literal(address) => Op::LoadLiteral { kind, t, address },
        Addressing::Register(m, shift) if t == Reg::PC => Op::LoadPcReg { n, m, shift },
        Addressing::Register(m, shift) => match kind {
            LoadKind::Word if t != Reg::SP => Op::LdrReg { t, n, m, shift },
            LoadKind::Byte => Op::LdrbReg { t, n, m, shift },
            _ => Op::LoadReg { kind, t, n, m, shift },
        },
        Addressing::Immediate(index, offset) if t == Reg::PC => Op::LoadPc { index, n, offset },
        Addressing::Immediate(index, offset) => {
            let plain = index == Index::Offset && t != Reg::SP;
            let sum = offset as u32;
            match kind {
                LoadKind::Word if plain => Op::Ldr { t, n, offset: sum },
                LoadKind::Half if plain => Op::Ldrh { t, n, offset: sum },
                LoadKind::Byte if plain => Op::Ldrb { t, n, offset: sum },
                _ => Op::Load {
                    kind,
                    index,
                    t,
                    n,
                    offset,
                },
            }
        }
    }
}

/// A5.3.10.
fn store_single(first: u32, second: u32) -> Op {
    let (n, t) = (Reg::new(first), Reg::new(second >> 12));
    let kind = match first >> 5 & 3 {
        0 => LoadKind::Byte,
        1 => LoadKind::Half,
        2 => LoadKind::Word,
        _ => return Op::Undefined,
    };
    if n == Reg::PC {
        return Op::Undefined;
    }
    let addressing = match addressing(0, first, second) {
        Ok(addressing) => addressing,
        Err(wrong) => return wrong,
    };
    if t == Reg::PC || t == Reg::SP && kind != LoadKind::Word {
        return Op::Unpredictable;
    }
    match addressing {
        Addressing::User(_) if is_limited(t) => Op::Unpredictable,
        Addressing::User(offset) => Op::StoreUser { kind, t, n, offset },
        Addressing::Register(m, shift) => match kind {
            LoadKind::Word => Op::StrReg { t, n, m, shift },
            LoadKind::Byte => Op::StrbReg { t, n, m, shift },
            _ => Op::StoreReg { kind, t, n, m, shift },
        },
        Addressing::Immediate(Index::Offset, offset) => {
            let offset = offset as u32;
            match kind {
                LoadKind::Word => Op::Str { t, n, offset },
                LoadKind::Half => Op::Strh { t, n, offset },
                _ => Op::Strb { t, n, offset },
            }
        }
        Addressing::Immediate(..) if n == t => Op::Unpredictable,
        Addressing::Immediate(index, offset) => Op::Store {
            kind,
            index,
            t,
            n,
            offset,
        },
        // A store has no literal: the base register is not R15.
        Addressing::Literal(_) => Op::Undefined,
    }
}

/// The addressing mode of a load or store of one register.
enum Addressing {
    Immediate(Index, i16),
    Register(Reg, u8),
    Literal(u32),
    /// With an offset to add, unprivileged.
    User(u8),
}

/// The common addressing modes of loads and stores of one register. `pc` is the base for R15.
fn addressing(pc: u32, first: u32, second: u32) -> Result<Addressing, Op> {
    let n = Reg::new(first);
    let imm_12 = (second & 0xfff) as i16;
    let imm_8 = (second & 0xff) as i16;
    if n == Reg::PC {
        let offset = if first >> 7 & 1 != 0 { imm_12 } else { -imm_12 };
        return Ok(Addressing::Literal((pc & !3).wrapping_add_signed(offset.into())));
    }
    if first >> 7 & 1 != 0 {
        return Ok(Addressing::Immediate(Index::Offset, imm_12));
    }
    let (pre, add, write_back) = (second >> 10 & 1 != 0, second >> 9 & 1 != 0, second >> 8 & 1 != 0);
    match (second >> 11 & 1, pre, add, write_back) {
        (0, ..) if second >> 6 & 31 != 0 => Err(Op::Undefined),
        (0, ..) => match Reg::new(second) {
            m if is_limited(m) => Err(Op::Unpredictable),
            m => Ok(Addressing::Register(m, (second >> 4 & 3) as u8)),
        },
        (_, true, true, false) => Ok(Addressing::User(imm_8 as u8)),
        (_, false, _, false) => Err(Op::Undefined),
        _ => Ok(Addressing::Immediate(
            index(pre, write_back),
            if add { imm_8 } else { -imm_8 },
        )),
    }
}

fn index(pre: bool, write_back: bool) -> Index {
    match (pre, write_back) {
        (true, false) => Index::Offset,
        (true, true) => Index::Pre,
        (false, _) => Index::Post,
    }
}

/// A5.3.11.
fn data_processing_shifted(first: u32, second: u32) -> Op {
    let (n, d, m) = (Reg::new(first), Reg::new(second >> 8), Reg::new(second));
    let s = first >> 4 & 1 != 0;
    let shift = immediate_shift(second >> 4 & 3, second >> 10 & 0x1c | second >> 6 & 3);
    let opcode = first >> 5 & 15;
    if second >> 15 != 0 {
        return Op::Unpredictable;
    }
    if opcode == 0b0110 {
        let top = second >> 5 & 1 != 0;
        return match s || second >> 4 & 1 != 0 {
            true => Op::Undefined,
            false if is_limited(d) || is_limited(n) || is_limited(m) => Op::Unpredictable,
            false => Op::Pkh { d, n, m, shift, top },
        };
    }
    let Some(alu) = alu_of(opcode) else {
        return Op::Undefined;
    };
    // MOV allows SP on one side (A7.7.77).
    let move_sp = alu == Alu::Orr && n == Reg::PC && !s && shift == UNSHIFTED && d != Reg::PC;
    if is_limited(m) && !(move_sp && m == Reg::SP && d != Reg::SP) {
        return Op::Unpredictable;
    }
    if d == Reg::PC && s && matches!(alu, Alu::And | Alu::Eor | Alu::Add | Alu::Sub) {
        return match alu {
            _ if n == Reg::PC || n == Reg::SP && matches!(alu, Alu::And | Alu::Eor) => Op::Unpredictable,
            Alu::Sub if shift == UNSHIFTED => Op::CmpReg { n, m },
            _ => Op::TestReg { alu, n, m, shift },
        };
    }
    match alu {
        Alu::Orr | Alu::Orn if n == Reg::PC && is_limited(d) && !move_sp => Op::Unpredictable,
        Alu::Orr if n == Reg::PC => move_shifted(s, d, m, shift),
        Alu::Orn if n == Reg::PC => Op::Mvn { s, d, m, shift },
        _ if is_wrong_operand(alu, d, n) => Op::Unpredictable,
        _ => alu_register(alu, s, d, n, m, shift),
    }
}

/// A5.3.12 to A5.3.15.
fn data_processing_register(first: u32, second: u32) -> Op {
    let (n, d, m) = (Reg::new(first), Reg::new(second >> 8), Reg::new(second));
    if second >> 12 != 15 {
        return Op::Undefined;
    }
    let (op1, op2) = (first >> 4 & 15, second >> 4 & 15);
    // R15 for `n` means no register.
    let without_n = op1 < 8 && op2 >= 8;
    if is_limited(d) || is_limited(m) || n == Reg::SP || n == Reg::PC && !without_n {
        return Op::Unpredictable;
    }
    match (op1, op2) {
        (0..8, 0) => Op::ShiftReg {
            kind: shift_kind(op1 >> 1),
            s: op1 & 1 != 0,
            d,
            n,
            m,
        },
        (0..6, 8..) if op2 < 12 => {
            let kind = [
                Extend::SignedHalf,
                Extend::Half,
                Extend::SignedByte16,
                Extend::Byte16,
                Extend::SignedByte,
                Extend::Byte,
            ][op1 as usize];
            let rotation = (op2 & 3) as u8 * 8;
            match n {
                Reg::PC => extend(kind, d, m, rotation),
                _ => Op::ExtendAdd {
                    kind,
                    d,
                    n,
                    m,
                    rotation,
                },
            }
        }
        (8.., 0..8) => parallel(op1 & 7, op2, d, n, m),
        (8, 8..12) => Op::SaturatingAdd {
            d,
            n,
            m,
            double: op2 & 1 != 0,
            subtract: op2 & 2 != 0,
        },
        // These encode their operand twice.
        (9 | 11, 8..12) if n != m => Op::Unpredictable,
        (9, 8) => Op::Rev { d, m },
        (9, 9) => Op::Rev16 { d, m },
        (9, 10) => Op::Rbit { d, m },
        (9, 11) => Op::Revsh { d, m },
        (10, 8) => Op::Sel { d, n, m },
        (11, 8) => Op::Clz { d, m },
        _ => Op::Undefined,
    }
}

/// A5.3.13 and A5.3.14.
fn parallel(op1: u32, op2: u32, d: Reg, n: Reg, m: Reg) -> Op {
    let lanes = match op1 {
        0b001 => Lanes::Add16,
        0b010 => Lanes::AddSub,
        0b110 => Lanes::SubAdd,
        0b101 => Lanes::Sub16,
        0b000 => Lanes::Add8,
        0b100 => Lanes::Sub8,
        _ => return Op::Undefined,
    };
    let how = match op2 & 3 {
        0 => Parallel::Modulo,
        1 => Parallel::Saturate,
        2 => Parallel::Halve,
        _ => return Op::Undefined,
    };
    Op::Parallel {
        how,
        lanes,
        unsigned: op2 & 4 != 0,
        d,
        n,
        m,
    }
}

/// A5.3.16.
fn multiply(first: u32, second: u32) -> Op {
    let (n, a, d, m) = registers(first, second);
    let (top, swap) = (second >> 5 & 1 != 0, second >> 4 & 1 != 0);
    if is_limited(d) || is_limited(n) || is_limited(m) || a == Reg::SP || second >> 6 & 3 != 0 {
        return if second >> 6 & 3 != 0 {
            Op::Undefined
        } else {
            Op::Unpredictable
        };
    }
    let kind = match (first >> 4 & 7, top) {
        (0, false) if swap && a == Reg::PC => return Op::Unpredictable,
        (0, false) if swap => return Op::Mls { d, n, m, a },
        (0, false) if a == Reg::PC => return Op::Mul { d, n, m },
        (0, false) => return Op::Mla { d, n, m, a },
        (7, false) if swap => return Op::Undefined,
        (7, false) if a == Reg::PC => return Op::Usad8 { d, n, m },
        (7, false) => return Op::Usada8 { d, n, m, a },
        (1, _) => Signed::Half {
            n_top: top,
            m_top: swap,
        },
        (3, false) => Signed::Wide { m_top: swap },
        (2, false) => Signed::Dual {
            exchange: swap,
            subtract: false,
        },
        (4, false) => Signed::Dual {
            exchange: swap,
            subtract: true,
        },
        (5, false) => Signed::Most {
            round: swap,
            subtract: false,
        },
        (6, false) if a == Reg::PC => return Op::Unpredictable,
        (6, false) => Signed::Most {
            round: swap,
            subtract: true,
        },
        _ => return Op::Undefined,
    };
    Op::MulSigned {
        kind,
        d,
        n,
        m,
        a: (a != Reg::PC).then_some(a),
    }
}

/// A5.3.17.
fn multiply_long(first: u32, second: u32) -> Op {
    let (n, low, high, m) = registers(first, second);
    let op2 = second >> 4 & 15;
    let is_division = matches!(first >> 4 & 7, 1 | 3);
    if is_limited(n) || is_limited(m) || is_limited(high) || !is_division && (is_limited(low) || low == high) {
        return Op::Unpredictable;
    }
    let exchange = op2 & 1 != 0;
    let kind = match (first >> 4 & 7, op2) {
        (1 | 3, 15) if low != Reg::PC => return Op::Unpredictable,
        (1, 15) => return Op::Sdiv { d: high, n, m },
        (3, 15) => return Op::Udiv { d: high, n, m },
        (0, 0) => Long::Smull,
        (2, 0) => Long::Umull,
        (4, 0) => Long::Smlal,
        (4, 8..12) => Long::SmlalHalf {
            n_top: op2 & 2 != 0,
            m_top: op2 & 1 != 0,
        },
        (4, 12 | 13) => Long::SmlalDual {
            exchange,
            subtract: false,
        },
        (5, 12 | 13) => Long::SmlalDual {
            exchange,
            subtract: true,
        },
        (6, 0) => Long::Umlal,
        (6, 6) => Long::Umaal,
        _ => return Op::Undefined,
    };
    Op::MulLong { kind, low, high, n, m }
}

/// The four register fields of a 32-bit instruction: one in its first halfword, three in its second.
fn registers(first: u32, second: u32) -> (Reg, Reg, Reg, Reg) {
    let [a, b, c] = [12, 8, 0].map(|at| Reg::new(second >> at));
    (Reg::new(first), a, b, c)
}

/// R13 and R15, which most 32-bit instructions do not allow.
fn is_limited(register: Reg) -> bool {
    register == Reg::SP || register == Reg::PC
}

/// Returns true if a data-processing instruction does not allow these registers. ADD and SUB allow SP as operand and as
/// result.
fn is_wrong_operand(alu: Alu, d: Reg, n: Reg) -> bool {
    let with_sp = matches!(alu, Alu::Add | Alu::Sub) && n == Reg::SP;
    d == Reg::PC || n == Reg::PC || d == Reg::SP && !with_sp || n == Reg::SP && !with_sp
}

/// The operation of a data-processing opcode (A5.3.1, A5.3.11).
fn alu_of(opcode: u32) -> Option<Alu> {
    Some(match opcode {
        0b0000 => Alu::And,
        0b0001 => Alu::Bic,
        0b0010 => Alu::Orr,
        0b0011 => Alu::Orn,
        0b0100 => Alu::Eor,
        0b1000 => Alu::Add,
        0b1010 => Alu::Adc,
        0b1011 => Alu::Sbc,
        0b1101 => Alu::Sub,
        0b1110 => Alu::Rsb,
        _ => return None,
    })
}

/// The fastest form of a data-processing instruction with a constant.
fn alu_immediate(alu: Alu, s: bool, d: Reg, n: Reg, imm: u32, carry: Carry) -> Op {
    match (alu, s) {
        (Alu::Add, false) => Op::AddImm { d, n, imm },
        (Alu::Sub, false) => Op::AddImm {
            d,
            n,
            imm: imm.wrapping_neg(),
        },
        (Alu::Add, true) if d != Reg::SP => Op::AddImmS { d, n, imm },
        (Alu::Sub, true) if d != Reg::SP => Op::SubImmS { d, n, imm },
        _ => Op::AluImm {
            alu,
            s,
            d,
            n,
            imm,
            carry,
        },
    }
}

/// The fastest form of a data-processing instruction with registers.
fn alu_register(alu: Alu, s: bool, d: Reg, n: Reg, m: Reg, shift: Shift) -> Op {
    match (alu, s) {
        (Alu::Add, false) if shift == UNSHIFTED => Op::AddReg { d, n, m },
        (Alu::Sub, false) if shift == UNSHIFTED => Op::SubReg { d, n, m },
        (Alu::Add, true) if shift == UNSHIFTED && d != Reg::SP => Op::AddRegS { d, n, m },
        (Alu::Sub, true) if shift == UNSHIFTED && d != Reg::SP => Op::SubRegS { d, n, m },
        _ => Op::AluReg { alu, s, d, n, m, shift },
    }
}

fn move_immediate(s: bool, d: Reg, imm: u32, carry: Carry) -> Op {
    if s {
        Op::MovImmS { d, imm, carry }
    } else {
        Op::MovImm { d, imm }
    }
}

fn move_shifted(s: bool, d: Reg, m: Reg, shift: Shift) -> Op {
    match (s, shift == UNSHIFTED) {
        (false, true) => Op::MovReg { d, m },
        (true, true) => Op::MovRegS { d, m },
        (true, false) if shift.kind != ShiftKind::Rrx => Op::ShiftImmS { d, m, shift },
        _ => Op::MovShift { s, d, m, shift },
    }
}

fn extend(kind: Extend, d: Reg, m: Reg, rotation: u8) -> Op {
    match (kind, rotation) {
        (Extend::Byte, 0) => Op::Uxtb { d, m },
        (Extend::Half, 0) => Op::Uxth { d, m },
        _ => Op::Extend { kind, d, m, rotation },
    }
}

fn shift_kind(bits: u32) -> ShiftKind {
    match bits & 3 {
        0 => ShiftKind::Lsl,
        1 => ShiftKind::Lsr,
        2 => ShiftKind::Asr,
        _ => ShiftKind::Ror,
    }
}

/// DecodeImmShift() (A7.4.2).
fn immediate_shift(kind: u32, amount: u32) -> Shift {
    let (kind, amount) = match (shift_kind(kind), amount) {
        (kind @ (ShiftKind::Lsr | ShiftKind::Asr), 0) => (kind, 32),
        (ShiftKind::Ror, 0) => (ShiftKind::Rrx, 1),
        (kind, amount) => (kind, amount as u8),
    };
    Shift { kind, amount }
}

/// i:imm3:imm8.
fn immediate_12(first: u32, second: u32) -> u32 {
    (first >> 10 & 1) << 11 | (second >> 12 & 7) << 8 | second & 0xff
}

/// ThumbExpandImm_C() (A5.3.2). `None` if it is UNPREDICTABLE.
fn expand_immediate(imm: u32) -> Option<(u32, Carry)> {
    let byte = imm & 0xff;
    if imm >> 10 != 0 {
        let value = (0x80 | imm & 0x7f).rotate_right(imm >> 7);
        let carry = if value >> 31 != 0 { Carry::Set } else { Carry::Clear };
        return Some((value, carry));
    }
    let value = match imm >> 8 {
        0 => byte,
        _ if byte == 0 => return None,
        1 => byte << 16 | byte,
        2 => byte << 24 | byte << 8,
        _ => byte * 0x0101_0101,
    };
    Some((value, Carry::Keep))
}

fn bit_mask(lsb: u32, msb: u32) -> u32 {
    u32::MAX << lsb & u32::MAX >> (31 - msb)
}

fn sign_extend(value: u32, bits: u32) -> u32 {
    ((value << (32 - bits)) as i32 >> (32 - bits)) as u32
}

/// The mnemonic of a floating-point instruction (A6). `None` for another coprocessor.
pub(super) fn floating_point_mnemonic(first: u16, second: u16) -> Option<&'static str> {
    let (first, second) = (u32::from(first), u32::from(second));
    if second >> 9 & 7 != 0b101 || first >> 12 & 1 != 0 {
        return None;
    }
    let register_transfer = first >> 8 & 15 == 0b1110 && second >> 4 & 1 != 0;
    let (opc1, opc2, opc3) = (first >> 4 & 15, first & 15, second >> 6 & 3);
    Some(match first >> 8 & 15 {
        0b1110 if register_transfer => match (opc1 >> 1, opc1 & 1) {
            (0b111, 0) => "VMSR",
            (0b111, _) => "VMRS",
            _ => "VMOV",
        },
        0b1110 => match (opc1 & 0b1011, opc3 & 1) {
            (0b0000, 0) => "VMLA",
            (0b0000, _) => "VMLS",
            (0b0001, 0) => "VNMLS",
            (0b0001, _) => "VNMLA",
            (0b0010, 0) => "VMUL",
            (0b0010, _) => "VNMUL",
            (0b0011, 0) => "VADD",
            (0b0011, _) => "VSUB",
            (0b1000, _) => "VDIV",
            (0b1001, 0) => "VFNMS",
            (0b1001, _) => "VFNMA",
            (0b1010, 0) => "VFMA",
            (0b1010, _) => "VFMS",
            _ => match (opc2, opc3) {
                (_, 0 | 2) => "VMOV",
                (0, 1) => "VMOV",
                (0, _) => "VABS",
                (1, 1) => "VNEG",
                (1, _) => "VSQRT",
                (2, 1) => "VCVTB",
                (2, _) => "VCVTT",
                (4 | 5, 1) => "VCMP",
                (4 | 5, _) => "VCMPE",
                _ => "VCVT",
            },
        },
        0b1100 if opc1 & 0b1110 == 0b0100 => "VMOV",
        _ => match (first >> 7 & 3, first >> 4 & 1, first & 15) {
            (0b10, 0, 13) if first >> 5 & 1 != 0 => "VPUSH",
            (0b01, 1, 13) if first >> 5 & 1 != 0 => "VPOP",
            (_, 0, _) if first >> 8 & 1 != 0 && first >> 5 & 1 == 0 => "VSTR",
            (_, 1, _) if first >> 8 & 1 != 0 && first >> 5 & 1 == 0 => "VLDR",
            (_, 0, _) => "VSTM",
            _ => "VLDM",
        },
    })
}
