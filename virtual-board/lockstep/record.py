#!/usr/bin/env python3
"""Records random instruction streams as an independent emulator executes them.

The emulator is QEMU's Cortex-M4, through the package `unicorn` of PyPI:

    python3 -m venv venv && venv/bin/pip install unicorn==2.1.4
    venv/bin/python record.py --seed 1 --streams 6000 --out trace.bin

The test `cortex_m4` replays `trace.bin`, or the file in the variable ARMWIRE_TRACE. For a soak, record more
streams with another seed into another file, and calls of the functions of an image:

    venv/bin/python record.py --seed 2 --streams 60000 --image firmware.elf --calls 100 --out soak.bin

There are two kinds of streams: instructions from the table below, which the manual (ARM DDI 0403E) permits; and any
32-bit encoding that the emulator executes. Encodings that the emulator calls undefined are recorded, too. A function of
an image is called with random arguments, and recorded if it returns without touching a peripheral.

Format, little-endian: "ARMWIRE2", then records:
    'S' seed:u32 halfwords:u8 code r0..r14:15*u32 xpsr:u32 digest:u32    a stream and the state after it
    'U' first:u16 second:u16                                             an undefined encoding
    'I' bytes:u32 contents                                               the flash for the calls that follow
    'C' seed:u32 entry:u32 r0..r14:15*u32 xpsr:u32 digest:u32            a call and the state after it
The state before a stream or call follows from its seed: see `Start`. The digest is Adler-32 of the RAM.
"""

import argparse
import random
import struct
import zlib

from unicorn import UC_ARCH_ARM, UC_ERR_INSN_INVALID, UC_HOOK_INTR, UC_MODE_MCLASS
from unicorn import UC_MODE_THUMB, UC_PROT_EXEC, UC_PROT_READ, Uc, UcError
from unicorn import arm_const as arm

PAGE = 0x1000
CODE, BEGIN = 0x0800_0000, 0x0800_0100
# Streams write to the first part of the page only: the rest need not be compared.
RAM, RAM_SIZE = 0x2000_0000, 0x400
# For functions of an image. They return to the end of the flash.
FLASH_SIZE, CALL_RAM_SIZE = 0x10_0000, 0x1_0000
RETURN = CODE + FLASH_SIZE - 0x100
REGISTERS = [getattr(arm, f"UC_ARM_REG_R{i}") for i in range(13)] + [arm.UC_ARM_REG_SP, arm.UC_ARM_REG_LR]
EDGES = [0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 0x7FFF_FFFF, 0x8000_0000, 0x8000_0001, 0xFFFF_FFFF]
UNDEFINED = "undefined"


class Start:
    """The state before a stream: registers, flags and RAM from a xorshift generator."""

    def __init__(self, seed):
        self.state = seed
        self.registers = [self.register() for _ in range(15)]
        self.registers[13] = RAM + RAM_SIZE // 2
        self.apsr = self.next() & 0xF80F_0000
        self.ram = b"".join(struct.pack("<I", self.next()) for _ in range(RAM_SIZE // 4))

    def next(self):
        x = self.state
        x ^= x << 13 & 0xFFFF_FFFF
        x ^= x >> 17
        x ^= x << 5 & 0xFFFF_FFFF
        self.state = x
        return x

    def register(self):
        kind, value = self.next() >> 16 & 3, self.next()
        if kind == 0:
            return value
        if kind == 1:
            return value >> 8 & 0x3F
        if kind == 2:
            return EDGES[(value >> 8) % len(EDGES)]
        return RAM + RAM_SIZE // 2 + (value >> 8 & 0x7C)


# Bits of an encoding: 0 and 1 stand for themselves, d n m t s a h l for registers, all other letters for any bit.
# Low registers have three bits, others four and are neither SP nor PC.
REGISTER_LETTERS = "dnmtsahl"
PLAIN = [
    # 16-bit: shifts, additions, immediates, register operations.
    "00000iiiiimmmddd", "00001iiiiimmmddd", "00010iiiiimmmddd", "0001100mmmnnnddd", "0001101mmmnnnddd",
    "0001110iiinnnddd", "0001111iiinnnddd", "00100dddiiiiiiii", "00101nnniiiiiiii", "00110dddiiiiiiii",
    "00111dddiiiiiiii", "010000oooommmddd", "010001000mmmmddd", "010001010mmmmddd", "010001100mmmmddd",
    "0100011001101ddd", "1011001000mmmddd", "1011001001mmmddd", "1011001010mmmddd", "1011001011mmmddd",
    "1011101000mmmddd", "1011101001mmmddd", "1011101011mmmddd", "10101dddiiiiiiii", "10100dddiiiiiiii",
    # Data processing with a constant or a shifted register, with and without flags.
    *(f"11110i0{op}xnnnn0iiiddddiiiiiiii" for op in ["0000", "0001", "0010", "0011", "0100", "1000", "1010", "1011", "1101", "1110"]),
    *(f"1110101{op}xnnnn0iiiddddiiiimmmm" for op in ["0000", "0001", "0010", "0011", "0100", "1000", "1010", "1011", "1101", "1110"]),
    *(f"11110i0{op}1nnnn0iii1111iiiiiiii" for op in ["0000", "0100", "1000", "1101"]),
    *(f"1110101{op}1nnnn0iii1111iiiimmmm" for op in ["0000", "0100", "1000", "1101"]),
    "11110i00010x11110iiiddddiiiiiiii", "11110i00011x11110iiiddddiiiiiiii",
    "11101010010x11110iiiddddiiiimmmm", "11101010011x11110iiiddddiiiimmmm",
    "111010101100nnnn0iiiddddiix0mmmm",
    "11110i100000nnnn0iiiddddiiiiiiii", "11110i101010nnnn0iiiddddiiiiiiii",
    "11110i10000011110iiiddddiiiiiiii", "11110i10101011110iiiddddiiiiiiii",
    "11110i100100iiii0iiiddddiiiiiiii", "11110i101100iiii0iiiddddiiiiiiii",
    # Saturation and bit fields.
    "1111001100x0nnnn0iiiddddii0iiiii", "1111001110x0nnnn0iiiddddii0iiiii",
    "111100110100nnnn0iiiddddii0iiiii", "111100111100nnnn0iiiddddii0iiiii",
    "111100110110nnnn0iiiddddii0iiiii", "11110011011011110iiiddddii0iiiii",
    # Shifts by registers, extensions, parallel operations, bytes.
    "111110100ooxnnnn1111dddd0000mmmm",
    *(f"111110100{op}nnnn1111dddd10iimmmm" for op in ["000", "001", "010", "011", "100", "101"]),
    *(f"111110100{op}11111111dddd10iimmmm" for op in ["000", "001", "010", "011", "100", "101"]),
    *(f"111110101{op}nnnn1111dddd0{u}mmmm" for op in ["000", "001", "010", "100", "101", "110"] for u in ["000", "001", "010", "100", "101", "110"]),
    "111110101000nnnn1111dddd10iimmmm", "111110101010nnnn1111dddd1000mmmm",
    # Multiplication and division.
    "111110110000nnnnaaaadddd0000mmmm", "111110110000nnnn1111dddd0000mmmm", "111110110000nnnnaaaadddd0001mmmm",
    *(f"111110110{op}nnnn{a}dddd00{x}mmmm" for a in ["aaaa", "1111"] for op, x in
      [("001", "xx"), ("010", "0x"), ("011", "0x"), ("100", "0x"), ("101", "0x"), ("111", "00")]),
    "111110110110nnnnaaaadddd000xmmmm",
    *(f"111110111{op}nnnnllllhhhh{x}mmmm" for op, x in
      [("000", "0000"), ("010", "0000"), ("100", "0000"), ("110", "0000"), ("110", "0110"), ("100", "10xx"), ("100", "110x"), ("101", "110x")]),
    "111110111001nnnn1111dddd1111mmmm", "111110111011nnnn1111dddd1111mmmm",
    # Flags.
    "111100111000nnnn1000xx0000000000", "11110011111011111000dddd00000000",
]
TWICE = ["111110101011{m}1111dddd1000{m}", "111110101001{m}1111dddd10ii{m}"]
MEMORY = [
    "0101ooommmnnnttt", "0110xiiiiinnnttt", "0111xiiiiinnnttt", "1000xiiiiinnnttt", "1001xtttiiiiiiii",
    "1011010riiiiiiii", "10111100iiiiiiii", "11000nnniiiiiiii", "11001nnniiiiiiii", "01001tttiiiiiiii",
    *(f"11111000{kind}nnnntttt{how}" for kind in ["0000", "0001", "0010", "0011", "0100", "0101"] for how in
      ["000000iimmmm", "1100iiiiiiii", "1001iiiiiiii", "1011iiiiiiii", "1101iiiiiiii", "1111iiiiiiii", "1110iiiiiiii"]),
    *(f"11111001{kind}nnnntttt{how}" for kind in ["0001", "0011"] for how in
      ["000000iimmmm", "1100iiiiiiii", "1001iiiiiiii", "1011iiiiiiii", "1101iiiiiiii", "1111iiiiiiii", "1110iiiiiiii"]),
    *(f"111110001{kind}nnnntttt0000iiiiiiii" for kind in ["000", "001", "010", "011", "100", "101"]),
    *(f"111110011{kind}nnnntttt0000iiiiiiii" for kind in ["001", "011"]),
    "1110100pu1w0nnnnttttssss000000ii", "1110100pu1w1nnnnttttssss000000ii",
    "1110100010w0nnnn0i0iiiiiiiiiiiii", "1110100010w1nnnn0i0iiiiiiiiiiiii",
    "1110100100w0nnnn0i0iiiiiiiiiiiii", "1110100100w1nnnn0i0iiiiiiiiiiiii",
]


def is_misaligned(code, registers):
    """True if an instruction has an alignment fault (A3.2.1), which the emulator does not detect."""
    if code[0] >> 12 == 0b1100:
        return registers[code[0] >> 8 & 7] % 4 != 0
    n = code[0] & 15
    return code[0] >> 9 == 0b1110100 and n < 15 and registers[n] % 4 != 0


class Generator:
    def __init__(self, rng):
        self.rng = rng

    def fill(self, template, registers=None):
        """An encoding of a template. None if the manual does not permit it."""
        fields, out = {}, 0
        for letter in set(template) & set(REGISTER_LETTERS):
            count = template.count(letter)
            allowed = range(8) if count == 3 else [*range(13), 14]
            fields[letter] = self.rng.choice(allowed)
            if letter == "n" and registers is not None and self.rng.random() < 0.9:
                bases = [r for r in allowed if RAM + 0x80 <= registers[r] < RAM + RAM_SIZE - 0x80]
                fields[letter] = self.rng.choice(bases) if bases else fields[letter]
        left = {letter: template.count(letter) for letter in fields}
        for letter in template:
            if letter in fields:
                left[letter] -= 1
                bit = fields[letter] >> left[letter] & 1
            else:
                bit = int(letter) if letter in "01" else self.rng.getrandbits(1)
            out = out << 1 | bit
        halfwords = [out] if len(template) == 16 else [out >> 16, out & 0xFFFF]
        return halfwords if self.permitted(template, fields, halfwords) else None

    @staticmethod
    def permitted(template, fields, code):
        first, second = code[0], code[-1]
        n, t, s = fields.get("n"), fields.get("t"), fields.get("s")
        if template.startswith("11110i0") and second >> 15 == 0:
            # A replicated constant of zero.
            imm = (first >> 10 & 1) << 3 | second >> 12 & 7
            return not (imm in (1, 2, 3) and second & 0xFF == 0)
        if template.startswith("1111001101x0") or "ii0iiiii" in template and template.startswith("11110011"):
            lsb, low = second >> 10 & 0x1C | second >> 6 & 3, second & 31
            kind = first >> 4 & 0xF
            if kind in (4, 12):
                return lsb + low < 32
            if kind == 6:
                return low >= lsb
            if kind in (2, 10) and lsb == 0:
                return second & 0x10 == 0
            return True
        if template.startswith("111100111000"):
            return second >> 10 & 3 != 0
        if fields.get("l") is not None:
            return fields["l"] != fields["h"]
        if template.startswith("1110100pu"):
            if not (first >> 8 & 1 or first >> 5 & 1):
                return False
            if first >> 5 & 1 and n in (t, s):
                return False
            return not (first >> 4 & 1 and t == s)
        if template.startswith("11101001") or template.startswith("11101000"):
            if bin(second).count("1") < 2:
                return False
            return not (first >> 5 & 1 and second >> n & 1)
        if template.startswith("1111100") and len(code) == 2 and first >> 7 & 1 == 0 and second >> 11 & 1:
            return not (second >> 8 & 1 and n == t)
        if template.startswith("1100") or template.startswith("1011010") or template.startswith("10111100"):
            if first & 0xFF == 0 and not first >> 8 & 1 or first & 0x1FF == 0:
                return False
            # The base register among those stored is UNKNOWN, unless it is the lowest.
            return not template.startswith("11000") or first & ((2 << n) - 1) & (1 << n) == 0 or first & ((1 << n) - 1) == 0
        return True

    def plain(self):
        while True:
            if self.rng.random() < 0.05:
                m = self.rng.choice([*range(13), 14])
                template = self.rng.choice(TWICE).replace("{m}", f"{m:04b}")
            else:
                template = self.rng.choice(PLAIN)
            if code := self.fill(template):
                return code

    def memory(self, registers):
        while True:
            code = self.fill(self.rng.choice(MEMORY), registers)
            if code and not is_misaligned(code, registers):
                return code

    def exclusive(self, registers):
        """A load and a store of the same width at the same place, with or without CLREX between them."""
        bases = [r for r in [*range(13)] if RAM + 0x80 <= registers[r] < RAM + RAM_SIZE - 0x80 and registers[r] % 4 == 0]
        if not bases:
            return self.plain()
        n = self.rng.choice(bases)
        t, d, u = self.rng.sample([r for r in range(13) if r != n], 3)
        between = self.rng.choice([[], [], [0xF3BF, 0x8F2F]])
        kind = self.rng.randrange(3)
        if kind == 0:
            offset = self.rng.randrange(16)
            return [0xE850 | n, t << 12 | 0xF00 | offset, *between, 0xE840 | n, u << 12 | d << 8 | offset]
        return [0xE8D0 | n, t << 12 | 0xF00 | 0x3F + kind * 0x10, *between, 0xE8C0 | n, u << 12 | 0xF00 | 0x30 + kind * 0x10 | d]

    def if_then(self, registers):
        condition = self.rng.randrange(14)
        count = self.rng.randrange(1, 5)
        mask, base = 0, condition & 1
        for _ in range(count - 1):
            mask = mask << 1 | (base ^ self.rng.getrandbits(1))
        mask = (mask << 1 | 1) << (4 - count)
        code = [0xBF00 | condition << 4 | mask]
        while count:
            item = self.plain() if self.rng.random() < 0.7 else self.memory(registers)
            # MOVS is not permitted in an IT block. Aligned accesses are left out: their base register is not known yet.
            if len(item) == 1 and (item[0] >> 6 == 0 or item[0] >> 12 == 0b1100) or item[0] >> 9 == 0b1110100:
                continue
            code += item
            count -= 1
        return code

    def branch(self):
        over = sum((self.plain() for _ in range(self.rng.randrange(1, 3))), [])
        # Offsets count from the address of the branch plus 4.
        kind = self.rng.randrange(4)
        if kind == 0:
            return [0xD000 | self.rng.randrange(14) << 8 | len(over) - 1, *over]
        if kind == 1:
            return [0xB100 | self.rng.getrandbits(1) << 11 | len(over) - 1 << 3 | self.rng.randrange(8), *over] if len(over) > 0 else over
        if kind == 2:
            return [0xF000 | self.rng.randrange(14) << 6, 0x8000 | len(over), *over]
        return [0xE000 | len(over) - 1, *over]

    def any_encoding(self, registers):
        while True:
            first, second = self.rng.randrange(0xE800, 0x1_0000), self.rng.getrandbits(16)
            coprocessor = first >> 10 & 0b111011 == 0b111011
            # Branches, MSR, hints: they leave the stream, or change more than registers and memory.
            control = first >> 11 == 0b11110 and second >> 15
            # UNDEFINED in the manual, but executed by the emulator: element loads and stores (as hints), stores with R15
            # as their base, and exclusives that are not in A5.3.6.
            element = first & 0xFF10 == 0xF900
            store = first & 0xFF1F == 0xF80F
            exclusive = first & 0xFFE0 == 0xE8C0 and second >> 4 & 15 not in (0, 1, 4, 5)
            faults = is_misaligned([first], registers)
            if not (coprocessor or control or element or store or exclusive or faults):
                return [first, second]


class Emulator:
    def __init__(self, flash_size=PAGE, ram_size=PAGE):
        self.ram_size = ram_size
        self.uc = Uc(UC_ARCH_ARM, UC_MODE_THUMB | UC_MODE_MCLASS)
        self.uc.ctl_set_cpu_model(arm.UC_CPU_ARM_CORTEX_M4)
        self.uc.mem_map(CODE, flash_size, UC_PROT_READ | UC_PROT_EXEC)
        self.uc.mem_map(RAM, ram_size)
        self.exception = None
        # A hook on memory would make the emulator lose the state of IT blocks.
        self.uc.hook_add(UC_HOOK_INTR, self.interrupt)

    def interrupt(self, uc, number, _):
        self.exception = number
        uc.emu_stop()

    def start(self, start):
        # A write to xPSR does not change the GE flags: MSR APSR_nzcvqg, R0 sets them. Then CLREX and CPSIE I.
        prologue = struct.pack("<5H", 0xF380, 0x8C00, 0xF3BF, 0x8F2F, 0xB662)
        self.uc.mem_write(CODE, prologue)
        self.uc.ctl_flush_tb()
        self.uc.reg_write(arm.UC_ARM_REG_XPSR, 1 << 24)
        self.uc.reg_write(arm.UC_ARM_REG_R0, start.apsr)
        assert self.run(CODE, CODE + len(prologue)) is None
        for register, value in zip(REGISTERS, start.registers):
            self.uc.reg_write(register, value)
        self.uc.mem_write(RAM, start.ram.ljust(self.ram_size, b"\0"))

    def program(self, code):
        data = bytes(BEGIN - CODE) + struct.pack(f"<{len(code)}H", *code)
        self.uc.mem_write(CODE, data.ljust(PAGE, b"\0"))
        self.uc.ctl_flush_tb()

    def registers(self):
        return [self.uc.reg_read(register) for register in REGISTERS]

    def state(self):
        ram = self.uc.mem_read(RAM, self.ram_size)
        xpsr = self.uc.reg_read(arm.UC_ARM_REG_XPSR)
        return struct.pack("<17I", *self.registers(), xpsr, zlib.adler32(ram))

    def run(self, begin, end, limit=64):
        """Runs from begin to end. Returns None, or the reason for another end."""
        self.exception = None
        try:
            self.uc.emu_start(begin | 1, end, 0, limit)
        except UcError as error:
            return UNDEFINED if error.errno == UC_ERR_INSN_INVALID else str(error)
        if self.exception is not None:
            return self.exception
        return None if self.uc.reg_read(arm.UC_ARM_REG_PC) & ~1 == end else "another address"

    def attempt(self, address, code):
        """Executes these halfwords. Returns None, or the reason for a failure, after which the state is restored."""
        context, ram = self.uc.context_save(), self.uc.mem_read(RAM, PAGE)
        self.uc.mem_write(address, struct.pack(f"<{len(code)}H", *code))
        self.uc.ctl_flush_tb()
        failure = self.run(address, address + 2 * len(code))
        if failure is None and any(self.uc.mem_read(RAM + RAM_SIZE, PAGE - RAM_SIZE)):
            failure = "outside"
        # The emulator stores bits of SP that the core does not have.
        if self.uc.reg_read(arm.UC_ARM_REG_SP) % 4:
            failure = failure or "stack pointer"
        if failure is not None:
            self.uc.context_restore(context)
            self.uc.mem_write(RAM, bytes(ram))
        return failure


def stream(emulator, generator, rng, seed, length, any_encoding, undefined):
    start = Start(seed)
    emulator.start(start)
    emulator.program([])
    address, code = BEGIN, []
    while len(code) < length:
        registers = emulator.registers()
        choice = rng.random()
        if any_encoding:
            unit = generator.any_encoding(registers)
        elif choice < 0.5:
            unit = generator.plain()
        elif choice < 0.8:
            unit = generator.memory(registers)
        elif choice < 0.9:
            unit = generator.if_then(registers)
        elif choice < 0.97:
            unit = generator.branch()
        else:
            unit = generator.exclusive(registers)
        failure = emulator.attempt(address, unit)
        if failure is None:
            code += unit
            address += 2 * len(unit)
        elif any_encoding and failure == UNDEFINED:
            undefined.append(unit)
    # The complete stream again, from the start, without leftovers of failed attempts.
    emulator.start(start)
    emulator.program(code)
    if emulator.run(BEGIN, address) is not None:
        return None
    return b"S" + struct.pack("<IB", seed, len(code)) + struct.pack(f"<{len(code)}H", *code) + emulator.state()


class Image:
    """The flash and the functions of an ELF file."""

    def __init__(self, path):
        with open(path, "rb") as file:
            self.elf = file.read()
        self.flash = bytearray(b"\xff" * FLASH_SIZE)
        header, count = struct.unpack_from("<I", self.elf, 28)[0], struct.unpack_from("<H", self.elf, 44)[0]
        for i in range(count):
            kind, offset, _, address, size = struct.unpack_from("<IIIII", self.elf, header + 32 * i)
            at = address - CODE
            if kind == 1 and 0 <= at < FLASH_SIZE:
                self.flash[at : at + size] = self.elf[offset : offset + size]

    def functions(self):
        header, count = struct.unpack_from("<I", self.elf, 32)[0], struct.unpack_from("<H", self.elf, 48)[0]
        sections = [struct.unpack_from("<10I", self.elf, header + 40 * i) for i in range(count)]
        for _, kind, _, _, offset, size, *_ in sections:
            for at in range(offset, offset + size, 16) if kind == 2 else []:
                _, value, length, info, *_ = struct.unpack_from("<IIIB", self.elf, at)
                if info & 15 == 2 and length and CODE <= value < CODE + FLASH_SIZE:
                    yield value & ~1


def calls(image, rng, count):
    """Calls each function `count` times, and yields records of the calls that return."""
    emulator = Emulator(FLASH_SIZE, CALL_RAM_SIZE)
    emulator.uc.mem_write(CODE, bytes(image.flash))
    for entry in sorted(set(image.functions())):
        for _ in range(count):
            seed = rng.randrange(1, 1 << 32)
            start = Start(seed)
            start.registers[13], start.registers[14] = RAM + CALL_RAM_SIZE, RETURN | 1
            emulator.start(start)
            emulator.uc.mem_write(CODE, bytes(image.flash[:PAGE]))
            emulator.uc.ctl_flush_tb()
            if emulator.run(entry, RETURN, 20_000) is None:
                yield b"C" + struct.pack("<II", seed, entry) + emulator.state()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--streams", type=int, default=6000)
    parser.add_argument("--length", type=int, default=32, help="halfwords of a stream, at least")
    parser.add_argument("--any", type=float, default=0.2, help="share of streams with any encoding")
    parser.add_argument("--undefined", type=int, default=4000, help="undefined encodings to keep at most")
    parser.add_argument("--image", help="ELF file whose functions to call")
    parser.add_argument("--calls", type=int, default=20, help="calls of each function")
    parser.add_argument("--out", default="trace.bin")
    options = parser.parse_args()
    rng = random.Random(options.seed)
    emulator, generator, undefined, count = Emulator(), Generator(rng), [], 0
    with open(options.out, "wb") as out:
        out.write(b"ARMWIRE2")
        while count < options.streams:
            seed = rng.randrange(1, 1 << 32)
            record = stream(emulator, generator, rng, seed, options.length, rng.random() < options.any, undefined)
            if record is not None:
                out.write(record)
                count += 1
        for first, second in undefined[: options.undefined]:
            out.write(b"U" + struct.pack("<HH", first, second))
        if options.image:
            image = Image(options.image)
            out.write(b"I" + struct.pack("<I", FLASH_SIZE) + image.flash)
            for record in calls(image, rng, options.calls):
                out.write(record)


if __name__ == "__main__":
    main()
