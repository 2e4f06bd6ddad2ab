// What rp2040js lacks, or has otherwise than the chip, and an adapter's image needs. Section numbers are those of the
// RP2040 datasheet.

// Corrects a chip that has just started. `rom` has the functions of the boot ROM that act on the flash or end the
// program: `erase(from, length)`, `program(to, bytes)` and `startBootLoader()`. `lockUp` stops the core.
export function correct(rp2040, { revision, uniqueId, rom, lockUp }) {
  quieten(rp2040);
  faultBelowMemory(rp2040, lockUp);
  latchInterrupts(rp2040);
  answerAborts(rp2040);
  addCacheControl(rp2040);
  fireAlarmsOnTime(rp2040);
  setRevision(rp2040, revision);
  addUniqueId(rp2040, uniqueId);
  addRom(rp2040, rom);
}

// rp2040js warns of each access to what it does not model.
function quieten(rp2040) {
  rp2040.logger.warn = () => {};
  rp2040.logger.error = () => {};
}

// rp2040js warns of an access to nothing, and goes on. The bus ends it with an error there, which is a hard fault, and
// lockup at the entry of a hard fault and in its handler (ARMv6-M Architecture Reference Manual, B1.5.15). Here this holds
// below the memory, where a stack overflows.
function faultBelowMemory({ core, logger }, lockUp) {
  const HARD_FAULT = 3;
  let isPending = false;
  let isEntering = false;
  logger.warn = (_, message) => {
    if (!/ invalid memory address: 1fff|undefined address: 1fff/.test(message)) return;
    if (isEntering || core.IPSR === HARD_FAULT) lockUp();
    isPending = true;
    core.interruptsUpdated = true;
  };
  const { checkForInterrupts } = core;
  core.checkForInterrupts = () => {
    if (!isPending) return checkForInterrupts.call(core);
    isEntering = true;
    core.exceptionEntry(HARD_FAULT);
    isEntering = false;
    isPending = false;
    return true;
  };
}

// rp2040js takes the level of an interrupt for its pending state: one that a program has set pending is lost when the
// peripheral next looks at its own. The processor latches it until its handler starts, and again if the level is high at
// the handler's end (ARMv6-M Architecture Reference Manual, B3.4).
function latchInterrupts({ core, ppb }) {
  const NVIC_ICPR = 0x280;
  const FIRST = 16;
  const bitOf = (exception) => (exception < FIRST ? 0 : 1 << (exception - FIRST));
  let levels = 0;
  const pend = (bits) => {
    core.pendingInterrupts |= bits;
    core.interruptsUpdated = true;
    if (core.waiting && core.checkForInterrupts()) core.waiting = false;
  };
  core.setInterrupt = (interrupt, isHigh) => {
    const bit = 1 << interrupt;
    const rises = isHigh && (levels & bit) === 0;
    levels = isHigh ? levels | bit : levels & ~bit;
    if (rises) pend(bit);
  };
  const { exceptionEntry, exceptionReturn } = core;
  core.exceptionEntry = (exception) => {
    core.pendingInterrupts &= ~bitOf(exception);
    exceptionEntry.call(core, exception);
  };
  core.exceptionReturn = (value) => {
    const bit = bitOf(core.IPSR);
    exceptionReturn.call(core, value);
    if ((levels & bit) !== 0) pend(bit);
  };
  const { writeUint32 } = ppb;
  ppb.writeUint32 = (offset, value) => {
    writeUint32.call(ppb, offset, value);
    if (offset === NVIC_ICPR) core.pendingInterrupts &= ~value | levels;
  };
}

// rp2040js reads CHAN_ABORT as all ones: a program that waits for the end of an abort never leaves. An abort takes no
// time here. It must also end the channel's wait for its peripheral.
function answerAborts(rp2040) {
  const CHAN_ABORT = 0x444;
  const { dma } = rp2040;
  const { readUint32 } = dma;
  dma.readUint32 = (offset) => (offset === CHAN_ABORT ? 0 : readUint32.call(dma, offset));
}

// rp2040js has no control registers of the flash cache and reads them as all ones. A program that waits for the end of
// a read in the background never leaves. There is none here.
function addCacheControl(rp2040) {
  rp2040.peripherals[0x14000] = { readUint32: () => 0, writeUint32Atomic: () => {} };
}

// rp2040js rounds the time to an alarm down, so that it comes up to a microsecond before its time.
function fireAlarmsOnTime(rp2040) {
  const ALARM0 = 0x10;
  const ALARM3 = 0x1c;
  const timer = rp2040.peripherals[0x40054];
  const { writeUint32 } = timer;
  timer.writeUint32 = (offset, value) => {
    writeUint32.call(timer, offset, value);
    if (offset < ALARM0 || offset > ALARM3) return;
    const { nanos } = rp2040.clock;
    const micros = (value - Math.floor(nanos / 1000)) >>> 0;
    // The alarm comes when the counter reaches the value, not while it has it.
    const delay = (micros === 0 ? 2 ** 32 : micros) * 1000 - (nanos % 1000);
    timer.alarms[(offset - ALARM0) / 4].clockAlarm.schedule(delay);
  };
}

// The revision of the chip in CHIP_ID (2.20.2), which is B1 in rp2040js.
function setRevision(rp2040, revision) {
  const CHIP_ID = 0x00;
  const REVISION = 28;
  const info = rp2040.peripherals[0x40000];
  const { readUint32 } = info;
  info.readUint32 = (offset) => {
    const value = readUint32.call(info, offset);
    return offset === CHIP_ID ? ((value & ~(0xf << REVISION)) | (revision << REVISION)) >>> 0 : value;
  };
}

// The answer of the flash to the command for its unique id. rp2040js answers 0.
function addUniqueId(rp2040, id) {
  const READ_UNIQUE_ID = 0x4b;
  const DUMMY_BYTES = 4;
  const ENABLE = 0x08;
  const DATA = 0x60;
  const ssi = rp2040.peripherals[0x18000];
  const { readUint32, writeUint32 } = ssi;
  let read = -1;
  ssi.writeUint32 = (offset, value) => {
    if (offset === ENABLE) read = -1;
    if (offset === DATA && (value & 0xff) === READ_UNIQUE_ID) read = 0;
    writeUint32.call(ssi, offset, value);
  };
  ssi.readUint32 = (offset) => {
    if (offset !== DATA || read < 0) return readUint32.call(ssi, offset);
    const byte = id[read - DUMMY_BYTES] ?? 0;
    read += 1;
    return byte;
  };
}

// rp2040js has no boot ROM. Here its table of functions leads to breakpoints, at which this program does the work
// (2.8.3).
function addRom(rp2040, { erase, program, startBootLoader }) {
  const { core } = rp2040;
  const { registers } = core;
  const rom = new DataView(rp2040.bootrom.buffer);
  const functions = {
    IF: () => {},
    EX: () => {},
    FC: () => {},
    CX: () => {},
    C4: () => {
      for (let n = 0; n < registers[2]; n += 4) {
        rp2040.writeUint32(registers[0] + n, rp2040.readUint32(registers[1] + n));
      }
    },
    RE: () => erase(registers[0], registers[1]),
    RP: () => {
      const [to, from, length] = registers;
      program(to, Uint8Array.from({ length }, (_, n) => rp2040.readUint8(from + n)));
    },
    UB: () => startBootLoader(),
  };
  const codes = Object.keys(functions);
  const LOOKUP = 0x40;
  const FIRST = 0x80;
  const BKPT = 0xbe00;
  const BX_LR = 0x4770;
  rom.setUint16(0x18, LOOKUP | 1, true);
  const place = (address, number) => {
    rom.setUint16(address, BKPT | number, true);
    rom.setUint16(address + 2, BX_LR, true);
  };
  place(LOOKUP, 0xff);
  codes.forEach((_, n) => place(FIRST + 4 * n, n));
  rp2040.onBreak = (number) => {
    if (number === 0xff) {
      const code = String.fromCharCode(registers[1] & 0xff, registers[1] >> 8);
      const at = codes.indexOf(code);
      if (at < 0) throw new Error(`the boot ROM has no function ${code} here`);
      registers[0] = (FIRST + 4 * at) | 1;
    } else if (codes[number]) {
      functions[codes[number]]();
    } else {
      throw new Error(`breakpoint ${number} at ${core.PC.toString(16)}`);
    }
  };
}
