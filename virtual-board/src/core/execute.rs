//! Execution of instructions (ARM DDI 0403E, A7.7 and B5.2).

use super::alu::{saturate_signed, saturate_unsigned, shift_c, signed_half};
use super::bus::Bus;
use super::decode::floating_point_mnemonic;
use super::dsp;
use super::fault::{Fault, Refusal, Trap};
use super::memory::Width;
use super::op::{Carry, Extend, Hint, Index, LoadKind, Long, Multiple, Op, Reg, Shift, Signed};
use super::state::{Cpu, control};

/// Values whose load into the PC returns from the exception, in handler mode (B1.5.8).
const EXC_RETURN: u32 = 0xf000_0000;

/// CPACR: full or privileged access to CP10.
const CP10_SHIFT: u32 = 20;

impl Cpu {
    /// Executes an instruction. `next` is the address of the following one in memory; the result is the address of the
    /// next one to execute. A fault leaves everything except memory unchanged.
    #[inline(always)]
    pub(super) fn execute(&mut self, bus: &mut dyn Bus, op: &Op, next: u32) -> Result<u32, Trap> {
        match *op {
            Op::MovImm { d, imm } => self.set(d, imm),
            Op::MovImmS { d, imm, carry } => {
                self.set(d, imm);
                self.flags.c = self.carry(carry);
                self.flags.set_nz(imm);
            }
            Op::MovTop { d, imm } => self.set(d, self.get(d) & 0xffff | u32::from(imm) << 16),
            Op::MovReg { d, m } => self.set_or_sp(d, self.get(m)),
            Op::MovRegS { d, m } => {
                self.set(d, self.get(m));
                self.flags.set_nz(self.get(m));
            }
            Op::AddImm { d, n, imm } => self.set_or_sp(d, self.get(n).wrapping_add(imm)),
            Op::AddImmS { d, n, imm } => {
                let sum = self.flags.add(self.get(n), imm, false);
                self.set(d, sum);
            }
            Op::SubImmS { d, n, imm } => {
                let difference = self.flags.add(self.get(n), !imm, true);
                self.set(d, difference);
            }
            Op::CmpImm { n, imm } => _ = self.flags.add(self.get(n), !imm, true),
            Op::AddReg { d, n, m } => self.set_or_sp(d, self.get(n).wrapping_add(self.get(m))),
            Op::AddRegS { d, n, m } => {
                let sum = self.flags.add(self.get(n), self.get(m), false);
                self.set(d, sum);
            }
            Op::SubReg { d, n, m } => self.set_or_sp(d, self.get(n).wrapping_sub(self.get(m))),
            Op::SubRegS { d, n, m } => {
                let difference = self.flags.add(self.get(n), !self.get(m), true);
                self.set(d, difference);
            }
            Op::CmpReg { n, m } => _ = self.flags.add(self.get(n), !self.get(m), true),
            Op::ShiftImmS { d, m, shift } => {
                let (result, carry) = self.flags.shift(self.get(m), shift);
                self.set(d, result);
                self.flags.set_nz(result);
                self.flags.c = carry;
            }
            Op::Uxtb { d, m } => self.set(d, self.get(m) & 0xff),
            Op::Uxth { d, m } => self.set(d, self.get(m) & 0xffff),
            Op::Ubfx { d, n, lsb, shift } => {
                self.set(d, self.get(n) >> (lsb & 31) & u32::MAX >> (shift & 31));
            }

            Op::Ldr { t, n, offset } => {
                let value = self.load::<4>(bus, self.get(n).wrapping_add(offset))?;
                self.set(t, value);
            }
            Op::Ldrh { t, n, offset } => {
                let value = self.load::<2>(bus, self.get(n).wrapping_add(offset))?;
                self.set(t, value);
            }
            Op::Ldrb { t, n, offset } => {
                let value = self.load::<1>(bus, self.get(n).wrapping_add(offset))?;
                self.set(t, value);
            }
            Op::Str { t, n, offset } => self.store::<4>(bus, self.get(n).wrapping_add(offset), self.get(t))?,
            Op::Strh { t, n, offset } => self.store::<2>(bus, self.get(n).wrapping_add(offset), self.get(t))?,
            Op::Strb { t, n, offset } => self.store::<1>(bus, self.get(n).wrapping_add(offset), self.get(t))?,
            Op::LdrReg { t, n, m, shift } => {
                let value = self.load::<4>(bus, self.indexed(n, m, shift))?;
                self.set(t, value);
            }
            Op::LdrbReg { t, n, m, shift } => {
                let value = self.load::<1>(bus, self.indexed(n, m, shift))?;
                self.set(t, value);
            }
            Op::StrReg { t, n, m, shift } => self.store::<4>(bus, self.indexed(n, m, shift), self.get(t))?,
            Op::StrbReg { t, n, m, shift } => self.store::<1>(bus, self.indexed(n, m, shift), self.get(t))?,
            Op::LdrLiteral { t, address } => {
                let value = self.load::<4>(bus, address)?;
                self.set(t, value);
            }

            Op::Branch { target } => return Ok(target),
            Op::BranchIf { condition, target } => {
                if self.flags.holds(condition.0) {
                    self.cycle += self.clock.taken;
                    return Ok(target);
                }
            }
            Op::CompareBranch { nonzero, n, target } => {
                if (self.get(n) != 0) == nonzero {
                    self.cycle += self.clock.taken;
                    return Ok(target);
                }
            }
            Op::BranchLink { target } => {
                self.set(Reg::LR, next | 1);
                return Ok(target);
            }
            Op::BranchLinkReg { m } => {
                let target = self.get(m);
                self.set(Reg::LR, next | 1);
                return self.branch_interworking(target);
            }
            Op::BranchReg { m } => return self.branch_returning(self.get(m)),
            Op::LoadMultiple(list) => return self.load_multiple(bus, list, next),
            Op::StoreMultiple(list) => self.store_multiple(bus, list)?,
            Op::Ldrd {
                index,
                t,
                t2,
                n,
                offset,
            } => {
                let (address, after) = self.index(index, n, offset);
                let first = self.load_aligned(bus, address)?;
                let second = self.load_aligned(bus, address.wrapping_add(4))?;
                self.set_or_sp(n, after);
                self.set(t, first);
                self.set(t2, second);
            }
            Op::Strd {
                index,
                t,
                t2,
                n,
                offset,
            } => {
                let (address, after) = self.index(index, n, offset);
                self.store_aligned(bus, address, self.get(t))?;
                self.store_aligned(bus, address.wrapping_add(4), self.get(t2))?;
                self.set_or_sp(n, after);
            }
            Op::AluImm {
                alu,
                s,
                d,
                n,
                imm,
                carry,
            } => {
                let carry = self.carry(carry);
                let result = self.flags.alu(alu, self.get(n), imm, carry, s);
                self.set_or_sp(d, result);
            }
            Op::AluReg { alu, s, d, n, m, shift } => {
                let (operand, carry) = self.flags.shift(self.get(m), shift);
                let result = self.flags.alu(alu, self.get(n), operand, carry, s);
                self.set_or_sp(d, result);
            }
            Op::It { state } => self.it = state,
            _ => return self.execute_rare(bus, op, next),
        }
        Ok(next)
    }

    /// Executes a less frequent instruction.
    #[inline(never)]
    fn execute_rare(&mut self, bus: &mut dyn Bus, op: &Op, next: u32) -> Result<u32, Trap> {
        match *op {
            Op::TestImm { alu, n, imm, carry } => {
                let carry = self.carry(carry);
                self.flags.alu(alu, self.get(n), imm, carry, true);
            }
            Op::TestReg { alu, n, m, shift } => {
                let (operand, carry) = self.flags.shift(self.get(m), shift);
                self.flags.alu(alu, self.get(n), operand, carry, true);
            }
            Op::MovShift { s, d, m, shift } => {
                let (result, carry) = self.flags.shift(self.get(m), shift);
                self.set_logical(s, d, result, carry);
            }
            Op::Mvn { s, d, m, shift } => {
                let (result, carry) = self.flags.shift(self.get(m), shift);
                self.set_logical(s, d, !result, carry);
            }
            Op::ShiftReg { kind, s, d, n, m } => {
                let (result, carry) = shift_c(self.get(n), kind, self.get(m) & 0xff, self.flags.c);
                self.set_logical(s, d, result, carry);
            }
            Op::Extend { kind, d, m, rotation } => self.set(d, extended(kind, self.get(m), rotation)),
            Op::ExtendAdd {
                kind,
                d,
                n,
                m,
                rotation,
            } => {
                let (a, b) = (self.get(n), extended(kind, self.get(m), rotation));
                let sum = match kind {
                    Extend::Byte16 | Extend::SignedByte16 => dsp::add_halves(a, b),
                    _ => a.wrapping_add(b),
                };
                self.set(d, sum);
            }
            Op::Sbfx { d, n, lsb, shift } => {
                // The field's top bit goes to bit 31, and back.
                let left = self.get(n) << (shift - lsb);
                self.set(d, (left as i32 >> shift) as u32);
            }
            Op::Bfi { d, n, lsb, mask } => {
                self.set(d, self.get(d) & !mask | self.get(n) << lsb & mask);
            }
            Op::Bfc { d, mask } => self.set(d, self.get(d) & !mask),
            Op::Clz { d, m } => self.set(d, self.get(m).leading_zeros()),
            Op::Rev { d, m } => self.set(d, self.get(m).swap_bytes()),
            Op::Rev16 { d, m } => self.set(d, self.get(m).swap_bytes().rotate_right(16)),
            Op::Revsh { d, m } => self.set(d, i32::from((self.get(m) as u16).swap_bytes() as i16) as u32),
            Op::Rbit { d, m } => self.set(d, self.get(m).reverse_bits()),
            Op::Pkh { d, n, m, shift, top } => {
                let shifted = self.flags.shift(self.get(m), shift).0;
                let (high, low) = if top {
                    (self.get(n), shifted)
                } else {
                    (shifted, self.get(n))
                };
                self.set(d, high & 0xffff_0000 | low & 0xffff);
            }
            Op::Ssat { d, n, shift, bits } => {
                let value = self.signed_shift(n, shift);
                let (result, limited) = saturate_signed(value, bits);
                self.set(d, result as u32);
                self.q |= limited;
            }
            Op::Usat { d, n, shift, bits } => {
                let value = self.signed_shift(n, shift);
                let (result, limited) = saturate_unsigned(value, bits);
                self.set(d, result);
                self.q |= limited;
            }
            Op::Ssat16 { d, n, bits } => {
                let value = self.get(n);
                let [low, high] = [false, true].map(|top| saturate_signed(signed_half(value, top).into(), bits));
                self.set(d, (high.0 as u32) << 16 | low.0 as u32 & 0xffff);
                self.q |= low.1 || high.1;
            }
            Op::Usat16 { d, n, bits } => {
                let value = self.get(n);
                let [low, high] = [false, true].map(|top| saturate_unsigned(signed_half(value, top).into(), bits));
                self.set(d, high.0 << 16 | low.0);
                self.q |= low.1 || high.1;
            }
            Op::SaturatingAdd {
                d,
                n,
                m,
                double,
                subtract,
            } => {
                let (result, limited) = dsp::saturating_add(self.get(m), self.get(n), double, subtract);
                self.set(d, result);
                self.q |= limited;
            }
            Op::Parallel {
                how,
                lanes,
                unsigned,
                d,
                n,
                m,
            } => {
                let (result, ge) = dsp::parallel(how, lanes, unsigned, self.get(n), self.get(m));
                self.set(d, result);
                self.ge = ge.unwrap_or(self.ge);
            }
            Op::Sel { d, n, m } => {
                let from_n = dsp::byte_mask(self.ge);
                self.set(d, self.get(n) & from_n | self.get(m) & !from_n);
            }
            Op::Usad8 { d, n, m } => self.set(d, dsp::absolute_differences(self.get(n), self.get(m))),
            Op::Usada8 { d, n, m, a } => {
                let sum = dsp::absolute_differences(self.get(n), self.get(m));
                self.set(d, self.get(a).wrapping_add(sum));
            }

            Op::Mul { d, n, m } => self.set(d, self.get(n).wrapping_mul(self.get(m))),
            Op::MulS { d, n, m } => {
                let result = self.get(n).wrapping_mul(self.get(m));
                self.set(d, result);
                self.flags.set_nz(result);
            }
            Op::Mla { d, n, m, a } => {
                self.set(d, self.get(a).wrapping_add(self.get(n).wrapping_mul(self.get(m))));
            }
            Op::Mls { d, n, m, a } => {
                self.set(d, self.get(a).wrapping_sub(self.get(n).wrapping_mul(self.get(m))));
            }
            Op::MulSigned { kind, d, n, m, a } => self.multiply_signed(kind, d, n, m, a),
            Op::MulLong { kind, low, high, n, m } => {
                let accumulator = u64::from(self.get(high)) << 32 | u64::from(self.get(low));
                let result = multiply_long(kind, self.get(n), self.get(m), accumulator);
                self.set(low, result as u32);
                self.set(high, (result >> 32) as u32);
            }
            Op::Sdiv { d, n, m } => {
                let (dividend, divisor) = (self.get(n) as i32, self.get(m) as i32);
                self.begin_division(dividend.unsigned_abs(), divisor.unsigned_abs())?;
                // The minimum divided by -1 is itself.
                let quotient = if divisor == 0 {
                    0
                } else {
                    dividend.wrapping_div(divisor)
                };
                self.set(d, quotient as u32);
            }
            Op::Udiv { d, n, m } => {
                let (dividend, divisor) = (self.get(n), self.get(m));
                self.begin_division(dividend, divisor)?;
                self.set(d, dividend.checked_div(divisor).unwrap_or(0));
            }

            Op::Load {
                kind,
                index,
                t,
                n,
                offset,
            } => {
                let (address, after) = self.index(index, n, offset);
                let value = self.load_kind(bus, kind, address)?;
                self.set_or_sp(n, after);
                self.set_or_sp(t, value);
            }
            Op::LoadReg { kind, t, n, m, shift } => {
                let value = self.load_kind(bus, kind, self.indexed(n, m, shift))?;
                self.set_or_sp(t, value);
            }
            Op::LoadLiteral { kind, t, address } => {
                let value = self.load_kind(bus, kind, address)?;
                self.set_or_sp(t, value);
            }
            Op::LoadPc { index, n, offset } => {
                let (address, after) = self.index(index, n, offset);
                let target = self.load_aligned(bus, address)?;
                self.set_or_sp(n, after);
                return self.branch_returning(target);
            }
            Op::LoadPcReg { n, m, shift } => {
                let target = self.load_aligned(bus, self.indexed(n, m, shift))?;
                return self.branch_returning(target);
            }
            Op::LoadPcLiteral { address } => {
                let target = self.load_aligned(bus, address)?;
                return self.branch_returning(target);
            }
            Op::Store {
                kind,
                index,
                t,
                n,
                offset,
            } => {
                let (address, after) = self.index(index, n, offset);
                self.store_kind(bus, kind, address, self.get(t))?;
                self.set_or_sp(n, after);
            }
            Op::StoreReg { kind, t, n, m, shift } => {
                self.store_kind(bus, kind, self.indexed(n, m, shift), self.get(t))?;
            }
            Op::LoadUser { kind, t, n, offset } => {
                let address = self.get(n).wrapping_add(offset.into());
                let value = self.load_elsewhere(bus, address, kind_width(kind), false)?;
                self.set(t, signed(kind, value));
            }
            Op::StoreUser { kind, t, n, offset } => {
                let address = self.get(n).wrapping_add(offset.into());
                self.store_elsewhere(bus, address, self.get(t), kind_width(kind), false)?;
            }
            Op::LdrdLiteral { t, t2, address } => {
                let first = self.load_aligned(bus, address)?;
                let second = self.load_aligned(bus, address.wrapping_add(4))?;
                self.set(t, first);
                self.set(t2, second);
            }
            Op::Ldrex { kind, t, n, offset } => {
                let address = self.exclusive_address(kind, n, offset)?;
                let value = self.load_kind(bus, kind, address)?;
                self.exclusive = true;
                self.set(t, value);
            }
            Op::Strex { kind, d, t, n, offset } => {
                let address = self.exclusive_address(kind, n, offset)?;
                if self.exclusive {
                    self.store_kind(bus, kind, address, self.get(t))?;
                }
                let failed = !std::mem::take(&mut self.exclusive);
                self.set(d, failed.into());
            }
            Op::Clrex => self.exclusive = false,

            Op::MovPc { m } => return Ok(self.get(m) & !1),
            Op::AddPc { m, pc } => return Ok(pc.wrapping_add(self.get(m)) & !1),
            Op::TableBranch { half, n, m, pc } => {
                let (table, index) = (n.map_or(pc, |n| self.get(n)), self.get(m));
                let offset = if half {
                    self.load::<2>(bus, table.wrapping_add(index << 1))?
                } else {
                    self.load::<1>(bus, table.wrapping_add(index))?
                };
                return Ok(pc.wrapping_add(2 * offset));
            }

            Op::Hint(hint) => self.hint(hint),
            Op::Svc => return Err(Trap::SupervisorCall),
            Op::Bkpt => return Err(Fault::Breakpoint.into()),
            Op::Cps {
                disable,
                primask,
                faultmask,
            } => self.change_masks(disable, primask, faultmask),
            Op::Mrs { d, register } => {
                let value = self.read_special(register)?;
                self.set(d, value);
            }
            Op::Msr { n, register, mask } => self.write_special(register, mask, self.get(n))?,
            Op::Coprocessor { first, second } => return Err(self.coprocessor(first, second)),
            Op::Unpredictable => return Err(Refusal::Unpredictable.into()),
            // Undefined instructions, and those handled as frequent.
            _ => return Err(Fault::Undefined.into()),
        }
        Ok(next)
    }

    #[inline(always)]
    fn carry(&self, carry: Carry) -> bool {
        match carry {
            Carry::Keep => self.flags.c,
            Carry::Clear => false,
            Carry::Set => true,
        }
    }

    /// The result of a move, and its flags.
    fn set_logical(&mut self, s: bool, d: Reg, result: u32, carry: bool) {
        self.set_or_sp(d, result);
        if s {
            self.flags.set_nz(result);
            self.flags.c = carry;
        }
    }

    fn signed_shift(&self, n: Reg, shift: Shift) -> i64 {
        i64::from(self.flags.shift(self.get(n), shift).0 as i32)
    }

    #[inline(always)]
    fn indexed(&self, n: Reg, m: Reg, shift: u8) -> u32 {
        self.get(n).wrapping_add(self.get(m) << (shift & 31))
    }

    /// The address of an access, and the new value of its base register.
    #[inline(always)]
    fn index(&self, index: Index, n: Reg, offset: i16) -> (u32, u32) {
        let base = self.get(n);
        let sum = base.wrapping_add_signed(offset.into());
        match index {
            Index::Offset => (sum, base),
            Index::Pre => (sum, sum),
            Index::Post => (base, sum),
        }
    }

    fn load_kind(&mut self, bus: &mut dyn Bus, kind: LoadKind, address: u32) -> Result<u32, Trap> {
        let value = match kind {
            LoadKind::Byte | LoadKind::SignedByte => self.load::<1>(bus, address),
            LoadKind::Half | LoadKind::SignedHalf => self.load::<2>(bus, address),
            LoadKind::Word => self.load::<4>(bus, address),
        };
        value.map(|value| signed(kind, value))
    }

    fn store_kind(&mut self, bus: &mut dyn Bus, kind: LoadKind, address: u32, value: u32) -> Result<(), Trap> {
        match kind {
            LoadKind::Byte | LoadKind::SignedByte => self.store::<1>(bus, address, value),
            LoadKind::Half | LoadKind::SignedHalf => self.store::<2>(bus, address, value),
            LoadKind::Word => self.store::<4>(bus, address, value),
        }
    }

    /// The lowest address of several registers, and the base after them.
    fn extent(&self, list: Multiple) -> (u32, u32) {
        let base = self.get(list.n);
        let bytes = 4 * list.registers.count_ones();
        match list.decrement {
            true => (base.wrapping_sub(bytes), base.wrapping_sub(bytes)),
            false => (base, base.wrapping_add(bytes)),
        }
    }

    /// LDM, LDMDB, POP (A7.7.41, A7.7.42, A7.7.99).
    fn load_multiple(&mut self, bus: &mut dyn Bus, list: Multiple, next: u32) -> Result<u32, Trap> {
        let (mut address, after) = self.extent(list);
        let mut loaded = self.r;
        for number in bits(list.registers) {
            loaded[number] = self.load_aligned(bus, address)?;
            address = address.wrapping_add(4);
        }
        let pc = std::mem::replace(&mut loaded[15], self.r[15]);
        self.r = loaded;
        if list.write_back {
            self.set(list.n, after);
        }
        if list.registers >> 15 != 0 {
            self.branch_returning(pc)
        } else {
            Ok(next)
        }
    }

    /// STM, STMDB, PUSH (A7.7.159, A7.7.160, A7.7.101).
    fn store_multiple(&mut self, bus: &mut dyn Bus, list: Multiple) -> Result<(), Trap> {
        let (mut address, after) = self.extent(list);
        for number in bits(list.registers) {
            self.store_aligned(bus, address, self.r[number & 15])?;
            address = address.wrapping_add(4);
        }
        if list.write_back {
            self.set(list.n, after);
        }
        Ok(())
    }

    /// The address of LDREX and STREX, which must be aligned.
    fn exclusive_address(&self, kind: LoadKind, n: Reg, offset: u16) -> Result<u32, Fault> {
        let address = self.get(n).wrapping_add(offset.into());
        if address.is_multiple_of(kind_width(kind).bytes()) {
            Ok(address)
        } else {
            Err(Fault::Unaligned)
        }
    }

    /// BLXWritePC() (A2.3.1): without the T bit, the next instruction is an INVSTATE fault.
    #[inline(always)]
    fn branch_interworking(&mut self, target: u32) -> Result<u32, Trap> {
        if target & 1 == 0 {
            self.thumb = false;
            self.request_service();
        }
        Ok(target & !1)
    }

    /// BXWritePC() and LoadWritePC() (A2.3.1): in handler mode, some values cause an exception return.
    #[inline(always)]
    fn branch_returning(&mut self, target: u32) -> Result<u32, Trap> {
        if target >= EXC_RETURN && self.exception != 0 {
            return Err(Trap::ExceptionReturn(target));
        }
        self.branch_interworking(target)
    }

    /// Signed multiplications with 32-bit results.
    fn multiply_signed(&mut self, kind: Signed, d: Reg, n: Reg, m: Reg, a: Option<Reg>) {
        let (n, m) = (self.get(n), self.get(m));
        let accumulator = i64::from(a.map_or(0, |a| self.get(a)) as i32);
        let (value, overflows) = match kind {
            Signed::Half { n_top, m_top } => {
                let product = i64::from(signed_half(n, n_top)) * i64::from(signed_half(m, m_top));
                (product + accumulator, true)
            }
            Signed::Wide { m_top } => {
                let product = i64::from(n as i32) * i64::from(signed_half(m, m_top));
                ((product >> 16) + accumulator, true)
            }
            Signed::Dual { exchange, subtract } => (dsp::dual_product(n, m, exchange, subtract) + accumulator, true),
            Signed::Most { round, subtract } => {
                let product = i64::from(n as i32) * i64::from(m as i32);
                let wide = accumulator << 32;
                let sum = if subtract {
                    wide.wrapping_sub(product)
                } else {
                    wide.wrapping_add(product)
                };
                (sum.wrapping_add(if round { 1 << 31 } else { 0 }) >> 32, false)
            }
        };
        self.set(d, value as u32);
        self.q |= overflows && value != i64::from(value as i32);
    }

    fn hint(&mut self, hint: Hint) {
        match hint {
            Hint::Nop => {}
            Hint::Sev => self.event = true,
            Hint::Wfe => self.wait_for_event(),
            Hint::Wfi => self.wait_for_interrupt(),
            Hint::Isb => self.request_service(),
        }
    }

    /// CPS (B5.2.1). Without privilege it does nothing.
    fn change_masks(&mut self, disable: bool, primask: bool, faultmask: bool) {
        if !self.is_privileged() {
            return;
        }
        if primask {
            self.primask = disable;
        }
        if faultmask {
            self.set_faultmask(disable);
        }
        // Setting a mask cannot enable an exception.
        if !disable {
            self.request_service();
        }
    }

    fn set_faultmask(&mut self, on: bool) {
        if !on || self.execution_priority() > -1 {
            self.faultmask = on;
        }
    }

    /// MRS (B5.2.2).
    fn read_special(&self, register: u8) -> Result<u32, Trap> {
        let privileged = self.is_privileged();
        Ok(match register {
            0..=7 if register != 4 => {
                let apsr = if register & 4 == 0 {
                    self.xpsr() & 0xf80f_0000
                } else {
                    0
                };
                // IPSR without privilege, and EPSR always, read as zero.
                let ipsr = if register & 1 != 0 && privileged {
                    u32::from(self.exception)
                } else {
                    0
                };
                apsr | ipsr
            }
            8 if privileged => self.main_sp(),
            9 if privileged => self.process_sp(),
            16 if privileged => self.primask.into(),
            17 | 18 if privileged => self.basepri.into(),
            19 if privileged => self.faultmask.into(),
            20 => self.control.into(),
            8 | 9 | 16..=19 => 0,
            _ => return Err(Refusal::Unpredictable.into()),
        })
    }

    /// MSR (B5.2.3).
    fn write_special(&mut self, register: u8, mask: u8, value: u32) -> Result<(), Trap> {
        let privileged = self.is_privileged();
        self.request_service();
        match register {
            0..=3 => {
                if mask & 2 != 0 {
                    self.set_apsr(value);
                }
                if mask & 1 != 0 {
                    self.ge = (value >> 16 & 15) as u8;
                }
            }
            // IPSR and EPSR cannot be written.
            5..=7 => {}
            8 if privileged => self.set_main_sp(value),
            9 if privileged => self.set_process_sp(value),
            16 if privileged => self.primask = value & 1 != 0,
            17 if privileged => self.basepri = self.nvic.mask_priority(value),
            18 if privileged => {
                let priority = self.nvic.mask_priority(value);
                if priority != 0 && (priority < self.basepri || self.basepri == 0) {
                    self.basepri = priority;
                }
            }
            19 if privileged => self.set_faultmask(value & 1 != 0),
            20 if privileged => {
                // In handler mode, SPSEL cannot be changed.
                let writable = if self.exception == 0 {
                    control::UNPRIVILEGED | control::PROCESS_STACK
                } else {
                    control::UNPRIVILEGED
                };
                let kept = self.control & !writable;
                self.change_mode(self.exception, kept | value as u8 & writable);
            }
            8 | 9 | 16..=20 => {}
            _ => return Err(Refusal::Unpredictable.into()),
        }
        Ok(())
    }

    /// A coprocessor instruction: a fault without the coprocessor, a refusal for the FPU while it is enabled (B1.5.6,
    /// NOCP).
    fn coprocessor(&self, first: u16, second: u16) -> Trap {
        match floating_point_mnemonic(first, second) {
            Some(mnemonic) if self.scb.cpacr >> CP10_SHIFT & 3 != 0 => Refusal::FloatingPoint(mnemonic).into(),
            _ => Fault::NoCoprocessor.into(),
        }
    }
}

/// The indices of the set bits.
#[inline(always)]
fn bits(mut set: u16) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let bit = set.trailing_zeros();
        set &= set.wrapping_sub(1);
        (bit < 16).then_some(bit as usize)
    })
}

fn signed(kind: LoadKind, value: u32) -> u32 {
    match kind {
        LoadKind::SignedByte => i32::from(value as i8) as u32,
        LoadKind::SignedHalf => i32::from(value as i16) as u32,
        _ => value,
    }
}

fn kind_width(kind: LoadKind) -> Width {
    match kind {
        LoadKind::Byte | LoadKind::SignedByte => Width::Byte,
        LoadKind::Half | LoadKind::SignedHalf => Width::Half,
        LoadKind::Word => Width::Word,
    }
}

fn extended(kind: Extend, value: u32, rotation: u8) -> u32 {
    let value = value.rotate_right(rotation.into());
    match kind {
        Extend::Byte => value & 0xff,
        Extend::Half => value & 0xffff,
        Extend::Byte16 => value & 0x00ff_00ff,
        Extend::SignedByte => i32::from(value as i8) as u32,
        Extend::SignedHalf => i32::from(value as i16) as u32,
        Extend::SignedByte16 => {
            let [low, high] = [value, value >> 16].map(|half| u32::from(i16::from(half as i8) as u16));
            high << 16 | low
        }
    }
}

fn multiply_long(kind: Long, n: u32, m: u32, accumulator: u64) -> u64 {
    let unsigned = u64::from(n) * u64::from(m);
    let signed = (i64::from(n as i32) * i64::from(m as i32)) as u64;
    match kind {
        Long::Smull => signed,
        Long::Umull => unsigned,
        Long::Smlal => accumulator.wrapping_add(signed),
        Long::Umlal => accumulator.wrapping_add(unsigned),
        // The maximum of the sum is exactly the maximum of the type.
        Long::Umaal => unsigned + (accumulator >> 32) + (accumulator & 0xffff_ffff),
        Long::SmlalHalf { n_top, m_top } => {
            let product = i64::from(signed_half(n, n_top)) * i64::from(signed_half(m, m_top));
            accumulator.wrapping_add(product as u64)
        }
        Long::SmlalDual { exchange, subtract } => {
            accumulator.wrapping_add(dsp::dual_product(n, m, exchange, subtract) as u64)
        }
    }
}
