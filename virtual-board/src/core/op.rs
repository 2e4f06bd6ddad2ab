//! Instructions as they are executed: what encodings decode to.
//!
//! The program counter is known when an instruction is decoded, so an operand that depends on it is a constant here.

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

/// What an expanded constant does to the carry flag (A5.3.2).
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

/// What a load does with what it read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LoadKind {
    Byte,
    SignedByte,
    Half,
    SignedHalf,
    Word,
}

/// When the offset is added to the base register, and whether the register keeps the sum.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Index {
    /// Added, not kept.
    Offset,
    /// Added before the access, and kept.
    Pre,
    /// Added after the access, and kept.
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

/// How a parallel addition or subtraction treats its results (A5.3.14).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Parallel {
    /// Modulo, setting the GE flags.
    Modulo,
    /// Saturating.
    Saturate,
    /// Halving.
    Halve,
}

/// Which lanes a parallel operation adds and subtracts.
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
    /// SMLAL of halves: of the first operand, of the second operand, whether each is the top one.
    SmlalHalf {
        n_top: bool,
        m_top: bool,
    },
    /// SMLALD and SMLSLD: whether the halves of the second operand are exchanged, whether the products are subtracted.
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

/// What stands in a system instruction (B5.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Hint {
    /// NOP, YIELD, DBG, PLD, PLI, and the barriers: all accesses are in order here.
    Nop,
    Wfe,
    Wfi,
    Sev,
    /// ISB: what was pended before it is taken before the next instruction.
    Isb,
}

/// An instruction. `d` is the destination, `n` and `m` are operands, `t` is what is loaded or stored, as in the manual.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Op {
    // Not executed.
    /// UNDEFINED, UDF.
    Undefined,
    /// UNPREDICTABLE by the manual.
    Unpredictable,
    /// A coprocessor instruction by its halfwords, among them those of the FPU.
    Coprocessor {
        first: u16,
        second: u16,
    },

    // Data processing, the most frequent forms.
    MovImm {
        d: Reg,
        imm: u32,
    },
    MovImmS {
        d: Reg,
        imm: u32,
        carry: Carry,
    },
    MovTop {
        d: Reg,
        imm: u16,
    },
    MovReg {
        d: Reg,
        m: Reg,
    },
    MovRegS {
        d: Reg,
        m: Reg,
    },
    /// ADD, and SUB of the complement.
    AddImm {
        d: Reg,
        n: Reg,
        imm: u32,
    },
    AddImmS {
        d: Reg,
        n: Reg,
        imm: u32,
    },
    SubImmS {
        d: Reg,
        n: Reg,
        imm: u32,
    },
    CmpImm {
        n: Reg,
        imm: u32,
    },
    AddReg {
        d: Reg,
        n: Reg,
        m: Reg,
    },
    AddRegS {
        d: Reg,
        n: Reg,
        m: Reg,
    },
    SubReg {
        d: Reg,
        n: Reg,
        m: Reg,
    },
    SubRegS {
        d: Reg,
        n: Reg,
        m: Reg,
    },
    CmpReg {
        n: Reg,
        m: Reg,
    },
    ShiftImmS {
        d: Reg,
        m: Reg,
        shift: Shift,
    },

    // Data processing, all other forms.
    AluImm {
        alu: Alu,
        s: bool,
        d: Reg,
        n: Reg,
        imm: u32,
        carry: Carry,
    },
    AluReg {
        alu: Alu,
        s: bool,
        d: Reg,
        n: Reg,
        m: Reg,
        shift: Shift,
    },
    /// TST, TEQ, CMN: the flags of the operation.
    TestImm {
        alu: Alu,
        n: Reg,
        imm: u32,
        carry: Carry,
    },
    TestReg {
        alu: Alu,
        n: Reg,
        m: Reg,
        shift: Shift,
    },
    MovShift {
        s: bool,
        d: Reg,
        m: Reg,
        shift: Shift,
    },
    Mvn {
        s: bool,
        d: Reg,
        m: Reg,
        shift: Shift,
    },
    ShiftReg {
        kind: ShiftKind,
        s: bool,
        d: Reg,
        n: Reg,
        m: Reg,
    },

    // Bits, extensions, saturation.
    Uxtb {
        d: Reg,
        m: Reg,
    },
    Uxth {
        d: Reg,
        m: Reg,
    },
    Extend {
        kind: Extend,
        d: Reg,
        m: Reg,
        rotation: u8,
    },
    ExtendAdd {
        kind: Extend,
        d: Reg,
        n: Reg,
        m: Reg,
        rotation: u8,
    },
    /// Bits from `lsb`; `shift` is 32 minus the number of bits.
    Ubfx {
        d: Reg,
        n: Reg,
        lsb: u8,
        shift: u8,
    },
    Sbfx {
        d: Reg,
        n: Reg,
        lsb: u8,
        shift: u8,
    },
    Bfi {
        d: Reg,
        n: Reg,
        lsb: u8,
        mask: u32,
    },
    Bfc {
        d: Reg,
        mask: u32,
    },
    Clz {
        d: Reg,
        m: Reg,
    },
    Rev {
        d: Reg,
        m: Reg,
    },
    Rev16 {
        d: Reg,
        m: Reg,
    },
    Revsh {
        d: Reg,
        m: Reg,
    },
    Rbit {
        d: Reg,
        m: Reg,
    },
    Pkh {
        d: Reg,
        n: Reg,
        m: Reg,
        shift: Shift,
        top: bool,
    },
    /// To a signed integer of so many bits.
    Ssat {
        d: Reg,
        n: Reg,
        shift: Shift,
        bits: u8,
    },
    /// To an unsigned integer of so many bits.
    Usat {
        d: Reg,
        n: Reg,
        shift: Shift,
        bits: u8,
    },
    Ssat16 {
        d: Reg,
        n: Reg,
        bits: u8,
    },
    Usat16 {
        d: Reg,
        n: Reg,
        bits: u8,
    },
    /// QADD, QSUB, QDADD, QDSUB: `m` and `n` as there.
    SaturatingAdd {
        d: Reg,
        n: Reg,
        m: Reg,
        double: bool,
        subtract: bool,
    },
    Parallel {
        how: Parallel,
        lanes: Lanes,
        unsigned: bool,
        d: Reg,
        n: Reg,
        m: Reg,
    },
    Sel {
        d: Reg,
        n: Reg,
        m: Reg,
    },
    Usad8 {
        d: Reg,
        n: Reg,
        m: Reg,
    },
    Usada8 {
        d: Reg,
        n: Reg,
        m: Reg,
        a: Reg,
    },

    // Multiplication and division.
    Mul {
        d: Reg,
        n: Reg,
        m: Reg,
    },
    MulS {
        d: Reg,
        n: Reg,
        m: Reg,
    },
    Mla {
        d: Reg,
        n: Reg,
        m: Reg,
        a: Reg,
    },
    Mls {
        d: Reg,
        n: Reg,
        m: Reg,
        a: Reg,
    },
    /// With an accumulator, or without one.
    MulSigned {
        kind: Signed,
        d: Reg,
        n: Reg,
        m: Reg,
        a: Option<Reg>,
    },
    MulLong {
        kind: Long,
        low: Reg,
        high: Reg,
        n: Reg,
        m: Reg,
    },
    Sdiv {
        d: Reg,
        n: Reg,
        m: Reg,
    },
    Udiv {
        d: Reg,
        n: Reg,
        m: Reg,
    },

    // Loads and stores, the most frequent forms.
    Ldr {
        t: Reg,
        n: Reg,
        offset: u32,
    },
    Ldrh {
        t: Reg,
        n: Reg,
        offset: u32,
    },
    Ldrb {
        t: Reg,
        n: Reg,
        offset: u32,
    },
    Str {
        t: Reg,
        n: Reg,
        offset: u32,
    },
    Strh {
        t: Reg,
        n: Reg,
        offset: u32,
    },
    Strb {
        t: Reg,
        n: Reg,
        offset: u32,
    },
    LdrReg {
        t: Reg,
        n: Reg,
        m: Reg,
        shift: u8,
    },
    LdrbReg {
        t: Reg,
        n: Reg,
        m: Reg,
        shift: u8,
    },
    StrReg {
        t: Reg,
        n: Reg,
        m: Reg,
        shift: u8,
    },
    StrbReg {
        t: Reg,
        n: Reg,
        m: Reg,
        shift: u8,
    },
    LdrLiteral {
        t: Reg,
        address: u32,
    },

    // Loads and stores, all other forms.
    Load {
        kind: LoadKind,
        index: Index,
        t: Reg,
        n: Reg,
        offset: i16,
    },
    LoadReg {
        kind: LoadKind,
        t: Reg,
        n: Reg,
        m: Reg,
        shift: u8,
    },
    LoadLiteral {
        kind: LoadKind,
        t: Reg,
        address: u32,
    },
    /// Loads of the program counter.
    LoadPc {
        index: Index,
        n: Reg,
        offset: i16,
    },
    LoadPcReg {
        n: Reg,
        m: Reg,
        shift: u8,
    },
    LoadPcLiteral {
        address: u32,
    },
    Store {
        kind: LoadKind,
        index: Index,
        t: Reg,
        n: Reg,
        offset: i16,
    },
    StoreReg {
        kind: LoadKind,
        t: Reg,
        n: Reg,
        m: Reg,
        shift: u8,
    },
    /// LDRT, STRT and the like: as an unprivileged access.
    LoadUser {
        kind: LoadKind,
        t: Reg,
        n: Reg,
        offset: u8,
    },
    StoreUser {
        kind: LoadKind,
        t: Reg,
        n: Reg,
        offset: u8,
    },
    Ldrd {
        index: Index,
        t: Reg,
        t2: Reg,
        n: Reg,
        offset: i16,
    },
    LdrdLiteral {
        t: Reg,
        t2: Reg,
        address: u32,
    },
    Strd {
        index: Index,
        t: Reg,
        t2: Reg,
        n: Reg,
        offset: i16,
    },
    /// LDMIA and POP, or LDMDB.
    LoadMultiple {
        n: Reg,
        registers: u16,
        decrement: bool,
        write_back: bool,
    },
    /// STMIA, or STMDB and PUSH.
    StoreMultiple {
        n: Reg,
        registers: u16,
        decrement: bool,
        write_back: bool,
    },
    Ldrex {
        kind: LoadKind,
        t: Reg,
        n: Reg,
        offset: u16,
    },
    Strex {
        kind: LoadKind,
        d: Reg,
        t: Reg,
        n: Reg,
        offset: u16,
    },
    Clrex,

    // Branches.
    Branch {
        target: u32,
    },
    BranchIf {
        condition: Condition,
        target: u32,
    },
    CompareBranch {
        nonzero: bool,
        n: Reg,
        target: u32,
    },
    BranchLink {
        target: u32,
    },
    BranchLinkReg {
        m: Reg,
    },
    /// BX, with interworking and exception return.
    BranchReg {
        m: Reg,
    },
    /// MOV PC: without interworking.
    MovPc {
        m: Reg,
    },
    /// ADD PC.
    AddPc {
        m: Reg,
        pc: u32,
    },
    /// TBB or TBH. The offsets count from `pc`; the table is there, too, without `n`.
    TableBranch {
        half: bool,
        n: Option<Reg>,
        m: Reg,
        pc: u32,
    },

    // System.
    It {
        state: u8,
    },
    Hint(Hint),
    Svc,
    Bkpt,
    Cps {
        disable: bool,
        primask: bool,
        faultmask: bool,
    },
    Mrs {
        d: Reg,
        register: u8,
    },
    Msr {
        n: Reg,
        register: u8,
        mask: u8,
    },
}

impl Op {
    /// Whether another instruction than the next one in memory always follows, outside an IT block.
    pub(super) fn leads_elsewhere(self) -> bool {
        match self {
            Self::Branch { .. } | Self::BranchReg { .. } | Self::MovPc { .. } | Self::AddPc { .. } => true,
            Self::LoadPc { .. } | Self::LoadPcReg { .. } | Self::LoadPcLiteral { .. } | Self::TableBranch { .. } => {
                true
            }
            Self::LoadMultiple { registers, .. } => registers >> 15 != 0,
            _ => false,
        }
    }
}
