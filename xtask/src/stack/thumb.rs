//! What a Thumb instruction does to the stack, and where it calls.
//!
//! Encodings are those of the ARMv7-M Architecture Reference Manual (DDI 0403), section A7.7, of which ARMv6-M has a part.

/// What counts of an instruction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Effect {
    /// Nothing does.
    None,
    /// The stack grows by so many bytes.
    Grow(u32),
    /// The stack grows by what is in a register.
    GrowByRegister,
    /// The function at this address is called.
    Call(u32),
    /// What is at this address goes on, in this function or in another.
    Jump(u32),
    /// What a register or memory points at is called, or goes on.
    Pointer,
}

/// Whether an instruction that begins with this halfword has a second one.
pub(crate) fn is_wide(first: u16) -> bool {
    first >= 0xE800
}

/// What a short instruction does, that is at this address.
pub(crate) fn narrow(address: u32, code: u16) -> Effect {
    const LR: u16 = 14 << 3;
    match code {
        // PUSH (T1)
        0xB400..=0xB5FF => Effect::Grow(4 * (code & 0x1FF).count_ones()),
        // SUB (SP minus immediate) (T1)
        0xB080..=0xB0FF => Effect::Grow(4 * u32::from(code & 0x7F)),
        // ADD (SP plus register) (T2), MOV (register) (T1) to SP
        _ if code & 0xFF87 == 0x4485 || code & 0xFF87 == 0x4685 => Effect::GrowByRegister,
        // B (T1); the two last conditions are UDF and SVC
        0xD000..=0xDDFF => Effect::Jump(target(address, u32::from(code & 0xFF) << 1, 9)),
        // B (T2)
        0xE000..=0xE7FF => Effect::Jump(target(address, u32::from(code & 0x7FF) << 1, 12)),
        // BX (T1), BLX (register) (T1)
        _ if code & 0xFF87 == 0x4780 || (code & 0xFF87 == 0x4700 && code & 0x78 != LR) => Effect::Pointer,
        _ => Effect::None,
    }
}

/// What a long instruction does, that is at this address.
pub(crate) fn wide(address: u32, first: u16, second: u16) -> Effect {
    const SP: u16 = 13;
    const PC: u16 = 15;
    let to = (second >> 8) & 0xF;
    match first {
        // PUSH (T2)
        0xE92D => Effect::Grow(4 * second.count_ones()),
        // STR (immediate) (T4) and so PUSH (T3), before an address that goes down
        0xF84D if second & 0x0F00 == 0x0D00 => Effect::Grow(u32::from(second & 0xFF)),
        // STRD (immediate) (T1), in the same way
        0xE96D => Effect::Grow(4 * u32::from(second & 0xFF)),
        // VPUSH (T1, T2)
        0xED2D | 0xED6D if second & 0x0E00 == 0x0A00 => Effect::Grow(4 * u32::from(second & 0xFF)),
        // SUB (SP minus immediate) (T2)
        0xF1AD | 0xF1BD | 0xF5AD | 0xF5BD if to == SP => Effect::Grow(expanded(immediate(first, second))),
        // SUB (SP minus immediate) (T3)
        0xF2AD | 0xF6AD if to == SP => Effect::Grow(immediate(first, second)),
        // SUB (SP minus register) (T1)
        0xEBAD | 0xEBBD if to == SP => Effect::GrowByRegister,
        // LDR (immediate, literal, register) (T2 to T4) to PC; from SP it is the end of the function
        0xF850..=0xF85F | 0xF8D0..=0xF8DF if second >> 12 == PC && first & 0xF != SP => Effect::Pointer,
        // BL (T1), B (T3, T4)
        0xF000..=0xF7FF => match second & 0xD000 {
            0xD000 => Effect::Call(far(address, first, second)),
            0x9000 => Effect::Jump(far(address, first, second)),
            // Other conditions are other instructions.
            0x8000 if (first >> 6) & 0xE != 0xE => Effect::Jump(near(address, first, second)),
            _ => Effect::None,
        },
        _ => Effect::None,
    }
}

/// The target of BL and B (T4).
fn far(address: u32, first: u16, second: u16) -> u32 {
    let bit = |code: u16, n: u16| u32::from((code >> n) & 1);
    let s = bit(first, 10);
    let i1 = 1 ^ bit(second, 13) ^ s;
    let i2 = 1 ^ bit(second, 11) ^ s;
    let low = u32::from(first & 0x3FF) << 12 | u32::from(second & 0x7FF) << 1;
    target(address, s << 24 | i1 << 23 | i2 << 22 | low, 25)
}

/// The target of B (T3).
fn near(address: u32, first: u16, second: u16) -> u32 {
    let bit = |code: u16, n: u16| u32::from((code >> n) & 1);
    let high = bit(first, 10) << 20 | bit(second, 11) << 19 | bit(second, 13) << 18;
    let low = u32::from(first & 0x3F) << 12 | u32::from(second & 0x7FF) << 1;
    target(address, high | low, 21)
}

/// Where an offset of so many bits, which has a sign, leads from this address.
fn target(address: u32, offset: u32, bits: u32) -> u32 {
    let unused = 32 - bits;
    let offset = ((offset << unused) as i32) >> unused;
    address.wrapping_add(4).wrapping_add_signed(offset)
}

/// The 12 bits of i:imm3:imm8.
fn immediate(first: u16, second: u16) -> u32 {
    u32::from(first & 0x400) << 1 | u32::from(second & 0x7000) >> 4 | u32::from(second & 0xFF)
}

/// ThumbExpandImm (A5.3.2).
fn expanded(immediate: u32) -> u32 {
    let byte = immediate & 0xFF;
    match immediate >> 8 {
        0 => byte,
        1 => byte * 0x0001_0001,
        2 => byte * 0x0100_0100,
        3 => byte * 0x0101_0101,
        _ => (byte | 0x80).rotate_right(immediate >> 7),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Code as LLVM's assembler makes it.
    fn effect(address: u32, code: &[u16]) -> Effect {
        match *code {
            [first] if !is_wide(first) => narrow(address, first),
            [first, second] if is_wide(first) => wide(address, first, second),
            _ => panic!("{code:x?} is no instruction"),
        }
    }

    #[test]
    fn what_is_pushed_or_subtracted_grows_the_stack() {
        for (grows, code, text) in [
            (12, &[0xB530][..], "push {r4, r5, lr}"),
            (24, &[0xB086], "sub sp, #24"),
            (16, &[0xE92D, 0x4310], "push.w {r4, r8, r9, lr}"),
            (4, &[0xF84D, 0xBD04], "str r11, [sp, #-4]!"),
            (16, &[0xE96D, 0x0104], "strd r0, r1, [sp, #-16]!"),
            (16, &[0xED2D, 0x8B04], "vpush {d8, d9}"),
            (592, &[0xF5AD, 0x7D14], "sub.w sp, sp, #592"),
            (1020, &[0xF5AD, 0x7D7F], "sub.w sp, sp, #1020"),
            (4096, &[0xF5AD, 0x5D80], "sub.w sp, sp, #4096"),
            (260, &[0xF5AD, 0x7D82], "sub.w sp, sp, #260"),
            (1004, &[0xF2AD, 0x3DEC], "subw sp, sp, #1004"),
            (3000, &[0xF6AD, 0x3DB8], "subw sp, sp, #3000"),
        ] {
            assert_eq!(effect(0, code), Effect::Grow(grows), "{text}");
        }
    }

    #[test]
    fn a_stack_that_grows_by_a_register_is_told() {
        for (code, text) in [
            (&[0x44B5][..], "add sp, r6"),
            (&[0x46B5], "mov sp, r6"),
            (&[0xEBAD, 0x0D04], "sub.w sp, sp, r4"),
        ] {
            assert_eq!(effect(0, code), Effect::GrowByRegister, "{text}");
        }
    }

    #[test]
    fn calls_and_jumps_lead_where_they_lead() {
        for (address, code, effect_, text) in [
            (0x203A, &[0xF7FE, 0xFFFE][..], Effect::Call(0x103A), "bl 0x103a"),
            (0x203E, &[0xF123, 0xFA27], Effect::Call(0x12_5490), "bl 0x125490"),
            (0x2056, &[0xF2FF, 0xD7F0], Effect::Call(0xF0_203A), "bl 0xf0203a"),
            (0x0100_205A, &[0xF4FF, 0xD7EE], Effect::Call(0x10_203A), "bl 0x10203a"),
            (0x10_2042, &[0xF7DF, 0xBFFA], Effect::Jump(0xE_203A), "b.w 0xe203a"),
            (0x2046, &[0xF000, 0xBA23], Effect::Jump(0x2490), "b.w 0x2490"),
            (0x204A, &[0xF47D, 0xAFD9], Effect::Jump(0), "bne.w 0"),
            (0x204E, &[0xF003, 0x8006], Effect::Jump(0x505E), "beq.w 0x505e"),
            (0x2052, &[0xE7F2], Effect::Jump(0x203A), "b 0x203a"),
            (0x2054, &[0xD0F1], Effect::Jump(0x203A), "beq 0x203a"),
        ] {
            assert_eq!(effect(address, code), effect_, "{text}");
        }
    }

    #[test]
    fn calls_through_pointers_are_told() {
        for (code, text) in [
            (&[0x4718][..], "bx r3"),
            (&[0x4788], "blx r1"),
            (&[0xF850, 0xF021], "ldr pc, [r0, r1, lsl #2]"),
        ] {
            assert_eq!(effect(0, code), Effect::Pointer, "{text}");
        }
    }

    #[test]
    fn returns_and_what_only_reads_sp_are_nothing() {
        for (code, text) in [
            (&[0x4770][..], "bx lr"),
            (&[0xBD10], "pop {r4, pc}"),
            (&[0xF85D, 0xFB04], "ldr pc, [sp], #4"),
            (&[0xF5AD, 0x7014], "sub.w r0, sp, #592"),
        ] {
            assert_eq!(effect(0, code), Effect::None, "{text}");
        }
    }
}
