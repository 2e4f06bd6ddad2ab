//! Decoded instructions.
//!
//! The program counter is known when an instruction is decoded: operands that depend on it are constants here.

/// The number of a core register, 0 to 15.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Reg(u8);

impl Reg {
    pub(super) const SP: Self = Self(13);
    pub(super) const LR: Self = Self(14);
    pub(super) const PC: Self = Self(15);

    /// The register in the lowest four bits.
    pub(super) const fn new(bits: u32) -> Self {
        Self((bits & 15) as u8)
    }

    #[inline(always)]
    pub(super) const fn index(self) -> usize {
        (self.0 & 15) as usize
    }
}

/// The condition of a branch or of an instruction in an IT block (A7.3): 0 (EQ) to 14 (AL).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Condition(pub(super) u8);

/// A data-processing operation with two operands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Alu {
    And,
    Bic,
    Orr,
    Orn,
    Eor,
    Add,
    Adc,
    Sub,
    Sbc,
    Rsb,
}

/// The effect of an expanded constant on the carry flag (A5.3.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Carry {
    Keep,
    Clear,
    Set,
}

/// The kind of a shift (A7.4.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ShiftKind {
    Lsl,
    Lsr,
    Asr,
    Ror,
    /// By one bit, through the carry flag.
    Rrx,
}

/// A shift by a constant: 0 to 31 for LSL, 1 to 32 for LSR and ASR, 1 to 31 for ROR, 1 for RRX.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Shift {
    pub(super) kind: ShiftKind,
    pub(super) amount: u8,
}

/// The conversion of a loaded value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LoadKind {
    Byte,
    SignedByte,
    Half,
    SignedHalf,
    Word,
}

/// The time at which the offset is added to the base register, and write-back.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Index {
    /// Offset addressing: without write-back.
    Offset,
    /// Pre-indexed: added before the access, with write-back.
    Pre,
    /// Post-indexed: added after the access, with write-back.
    Post,
}

/// A sign or zero extension (A7.7.181 and others).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Extend {
    SignedByte,
    SignedByte16,
    SignedHalf,
    Byte,
    Byte16,
    Half,
}

/// The treatment of results in a parallel addition or subtraction (A5.3.14).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Parallel {
    /// Modulo, setting the GE flags.
    Modulo,
    /// Saturating.
    Saturate,
    /// Halving.
    Halve,
}

/// The lanes that a parallel operation adds and subtracts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Lanes {
    Add16,
    Sub16,
    /// ASX: the top is the sum, the bottom the difference, with the halves of the second operand exchanged.
    AddSub,
    /// SAX: the top is the difference, the bottom the sum, with the halves of the second operand exchanged.
    SubAdd,
    Add8,
    Sub8,
}

/// A multiplication with a 64-bit result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Long {
    Smull,
    Umull,
    Smlal,
    Umlal,
    Umaal,
    /// SMLAL of halves: true for the top half of the first and of the second operand.
    SmlalHalf {
        n_top: bool,
        m_top: bool,
    },
    /// SMLALD and SMLSLD: exchange of the second operand's halves, and subtraction of the products.
    SmlalDual {
        exchange: bool,
        subtract: bool,
    },
}

/// A signed multiplication of halves or of most significant words, with an accumulator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Signed {
    /// SMLAxy, SMULxy.
    Half { n_top: bool, m_top: bool },
    /// SMLAWy, SMULWy.
    Wide { m_top: bool },
    /// SMLAD, SMLSD, SMUAD, SMUSD.
    Dual { exchange: bool, subtract: bool },
    /// SMMLA, SMMLS, SMMUL.
    Most { round: bool, subtract: bool },
}

/// The kind of a system instruction (B5.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Hint {
    /// NOP, YIELD, DBG, PLD, PLI, and the barriers: all accesses are in order in this model.
    Nop,
    Wfe,
    Wfi,
    Sev,
    /// ISB: a pending exception is taken before the next instruction.
    Isb,
}

/// The transfer of several registers, at least one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Multiple {
    /// The base.
    pub(super) n: Reg,
    /// A bit for each register.
    pub(super) registers: u16,
    /// Before the base, and not from it on.
    pub(super) decrement: bool,
    pub(super) write_back: bool,
}

/// An instruction. `d` is the destination, `n` and `m` are operands, `t` is the transferred register, as in the manual.
// A line for each, as in the tables of the manual.
#[rustfmt::skip]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Op {
    // Not executed.
    /// UNDEFINED, UDF.
    Undefined,
    /// UNPREDICTABLE by the manual.
    Unpredictable,
    /// A coprocessor instruction by its halfwords, among them those of the FPU.
    Coprocessor { first: u16, second: u16 },

    // Data processing, the most frequent forms.
    MovImm { d: Reg, imm: u32 },
    MovImmS { d: Reg, imm: u32, carry: Carry },
    MovTop { d: Reg, imm: u16 },
    MovReg { d: Reg, m: Reg },
    MovRegS { d: Reg, m: Reg },
    /// ADD, and SUB as an addition of the complement.
    AddImm { d: Reg, n: Reg, imm: u32 },
    AddImmS { d: Reg, n: Reg, imm: u32 },
    SubImmS { d: Reg, n: Reg, imm: u32 },
    CmpImm { n: Reg, imm: u32 },
    AddReg { d: Reg, n: Reg, m: Reg },
    AddRegS { d: Reg, n: Reg, m: Reg },
    SubReg { d: Reg, n: Reg, m: Reg },
    SubRegS { d: Reg, n: Reg, m: Reg },
    CmpReg { n: Reg, m: Reg },
    ShiftImmS { d: Reg, m: Reg, shift: Shift },

    // Data processing, all other forms.
    AluImm { alu: Alu, s: bool, d: Reg, n: Reg, imm: u32, carry: Carry },
    AluReg { alu: Alu, s: bool, d: Reg, n: Reg, m: Reg, shift: Shift },
    /// TST, TEQ, CMN: only the flags of the operation.
    TestImm { alu: Alu, n: Reg, imm: u32, carry: Carry },
    TestReg { alu: Alu, n: Reg, m: Reg, shift: Shift },
    MovShift { s: bool, d: Reg, m: Reg, shift: Shift },
    Mvn { s: bool, d: Reg, m: Reg, shift: Shift },
    ShiftReg { kind: ShiftKind, s: bool, d: Reg, n: Reg, m: Reg },

    // Bits, extensions, saturation.
    Uxtb { d: Reg, m: Reg },
    Uxth { d: Reg, m: Reg },
    Extend { kind: Extend, d: Reg, m: Reg, rotation: u8 },
    ExtendAdd { kind: Extend, d: Reg, n: Reg, m: Reg, rotation: u8 },
    /// Bits from `lsb`; `shift` is 32 minus the number of bits.
    Ubfx { d: Reg, n: Reg, lsb: u8, shift: u8 },
    Sbfx { d: Reg, n: Reg, lsb: u8, shift: u8 },
    Bfi { d: Reg, n: Reg, lsb: u8, mask: u32 },
    Bfc { d: Reg, mask: u32 },
    Clz { d: Reg, m: Reg },
    Rev { d: Reg, m: Reg },
    Rev16 { d: Reg, m: Reg },
    Revsh { d: Reg, m: Reg },
    Rbit { d: Reg, m: Reg },
    Pkh { d: Reg, n: Reg, m: Reg, shift: Shift, top: bool },
    /// To a signed integer of this number of bits.
    Ssat { d: Reg, n: Reg, shift: Shift, bits: u8 },
    /// To an unsigned integer of this number of bits.
    Usat { d: Reg, n: Reg, shift: Shift, bits: u8 },
    Ssat16 { d: Reg, n: Reg, bits: u8 },
    Usat16 { d: Reg, n: Reg, bits: u8 },
    /// QADD, QSUB, QDADD, QDSUB: with `m` and `n` of the manual.
    SaturatingAdd { d: Reg, n: Reg, m: Reg, double: bool, subtract: bool },
    Parallel { how: Parallel, lanes: Lanes, unsigned: bool, d: Reg, n: Reg, m: Reg },
    Sel { d: Reg, n: Reg, m: Reg },
    Usad8 { d: Reg, n: Reg, m: Reg },
    Usada8 { d: Reg, n: Reg, m: Reg, a: Reg },

    // Multiplication and division.
    Mul { d: Reg, n: Reg, m: Reg },
    MulS { d: Reg, n: Reg, m: Reg },
    Mla { d: Reg, n: Reg, m: Reg, a: Reg },
    Mls { d: Reg, n: Reg, m: Reg, a: Reg },
    /// With an accumulator, or without one.
    MulSigned { kind: Signed, d: Reg, n: Reg, m: Reg, a: Option<Reg> },
    MulLong { kind: Long, low: Reg, high: Reg, n: Reg, m: Reg },
    Sdiv { d: Reg, n: Reg, m: Reg },
    Udiv { d: Reg, n: Reg, m: Reg },

    // Loads and stores, the most frequent forms.
    Ldr { t: Reg, n: Reg, offset: u32 },
    Ldrh { t: Reg, n: Reg, offset: u32 },
    Ldrb { t: Reg, n: Reg, offset: u32 },
    Str { t: Reg, n: Reg, offset: u32 },
    Strh { t: Reg, n: Reg, offset: u32 },
    Strb { t: Reg, n: Reg, offset: u32 },
    LdrReg { t: Reg, n: Reg, m: Reg, shift: u8 },
    LdrbReg { t: Reg, n: Reg, m: Reg, shift: u8 },
    StrReg { t: Reg, n: Reg, m: Reg, shift: u8 },
    StrbReg { t: Reg, n: Reg, m: Reg, shift: u8 },
    LdrLiteral { t: Reg, address: u32 },

    // Loads and stores, all other forms.
    Load { kind: LoadKind, index: Index, t: Reg, n: Reg, offset: i16 },
    LoadReg { kind: LoadKind, t: Reg, n: Reg, m: Reg, shift: u8 },
    LoadLiteral { kind: LoadKind, t: Reg, address: u32 },
    /// Loads of the program counter.
    LoadPc { index: Index, n: Reg, offset: i16 },
    LoadPcReg { n: Reg, m: Reg, shift: u8 },
    LoadPcLiteral { address: u32 },
    Store { kind: LoadKind, index: Index, t: Reg, n: Reg, offset: i16 },
    StoreReg { kind: LoadKind, t: Reg, n: Reg, m: Reg, shift: u8 },
    /// LDRT, STRT and similar ones: unprivileged accesses.
    LoadUser { kind: LoadKind, t: Reg, n: Reg, offset: u8 },
    StoreUser { kind: LoadKind, t: Reg, n: Reg, offset: u8 },
    Ldrd { index: Index, t: Reg, t2: Reg, n: Reg, offset: i16 },
    LdrdLiteral { t: Reg, t2: Reg, address: u32 },
    Strd { index: Index, t: Reg, t2: Reg, n: Reg, offset: i16 },
    /// LDMIA and POP, or LDMDB.
    LoadMultiple(Multiple),
    /// STMIA, or STMDB and PUSH.
    StoreMultiple(Multiple),
    Ldrex { kind: LoadKind, t: Reg, n: Reg, offset: u16 },
    Strex { kind: LoadKind, d: Reg, t: Reg, n: Reg, offset: u16 },
    Clrex,

    // Branches.
    Branch { target: u32 },
    BranchIf { condition: Condition, target: u32 },
    CompareBranch { nonzero: bool, n: Reg, target: u32 },
    BranchLink { target: u32 },
    BranchLinkReg { m: Reg },
    /// BX, with interworking and exception return.
    BranchReg { m: Reg },
    /// MOV PC: without interworking.
    MovPc { m: Reg },
    /// ADD PC.
    AddPc { m: Reg, pc: u32 },
    /// TBB or TBH. The offsets count from `pc`; without `n` the table is there, too.
    TableBranch { half: bool, n: Option<Reg>, m: Reg, pc: u32 },

    // System.
    It { state: u8 },
    Hint(Hint),
    Svc,
    Bkpt,
    Cps { disable: bool, primask: bool, faultmask: bool },
    Mrs { d: Reg, register: u8 },
    Msr { n: Reg, register: u8, mask: u8 },
}

impl Op {
    /// Returns true for an unconditional branch, outside an IT block.
    pub(super) fn leads_elsewhere(self) -> bool {
        match self {
            Self::Branch { .. } | Self::BranchReg { .. } | Self::MovPc { .. } | Self::AddPc { .. } => true,
            Self::LoadPc { .. } | Self::LoadPcReg { .. } | Self::LoadPcLiteral { .. } | Self::TableBranch { .. } => {
                true
            }
            Self::LoadMultiple(Multiple { registers, .. }) => registers >> 15 != 0,
            _ => false,
        }
    }
}
