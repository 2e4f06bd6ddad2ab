// A Raspberry Pi Pico that runs the adapter's image: the emulated chip of the example with its flash, the functions of
// its boot ROM that the image calls, and a host on USB.
import { Chip } from '../../examples/rp2040/emulator/chip.mjs';
import { Usb } from './usb.mjs';

// The UART of the arm.
const ARM = 1;
const FLASH = 0x10000000;
const SECTOR = 4096;
// The longest time that the erase of a sector and the write of a page usually take (W25Q16JV, 9.6).
const ERASE_NANOS = 45_000_000;
const WRITE_NANOS = 400_000;
const UNIQUE_ID = [0xe6, 0x61, 0x64, 0x08, 0x43, 0x1a, 0x2b, 0x3c];

export class Pico extends Chip {
  // The image in this ELF file, started.
  constructor(elf) {
    super(elf);
    this.elf = elf;
    const { rp2040 } = this.core;
    quieten(rp2040);
    answerAborts(rp2040);
    addCacheControl(rp2040);
    fireAlarmsOnTime(rp2040);
    this.addRom(rp2040);
    addUniqueId(rp2040);
    this.arm = this.uarts[ARM];
    this.usb = new Usb(this, rp2040.usbCtrl);
    // Why the program asked for a reset, which rp2040js leaves to its user.
    this.resets = [];
    // Called before an erase or a write. An error ends the run there: a power cut.
    this.beforeFlash = () => {};
    const watchdog = rp2040.peripherals[0x40058];
    watchdog.onWatchdogTrigger = () => {
      this.resets.push(watchdog.reason === 1 ? 'timeout' : 'request');
      watchdog.alarm.enable = false;
    };
  }

  // The chip after a reset, by the watchdog or a power cut. A reset keeps the RAM, a power cut does not.
  restarted({ keepsRam = this.resets.length > 0 } = {}) {
    const next = new Pico(this.elf);
    next.core.rp2040.flash.set(this.core.rp2040.flash);
    if (keepsRam) {
      next.core.rp2040.sram.set(this.core.rp2040.sram);
      next.core.rp2040.peripherals[0x40058].reason = this.core.rp2040.peripherals[0x40058].reason;
    }
    return next;
  }

  // rp2040js has no boot ROM. Here its table of functions leads to breakpoints, at which this program does the work
  // (RP2040 datasheet 2.8.3).
  addRom(rp2040) {
    const { core } = this;
    const rom = new DataView(rp2040.bootrom.buffer);
    const registers = core.registers;
    const memory = (address) => rp2040.readUint8(address);
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
      RE: () => {
        this.beforeFlash();
        const [from, length] = registers;
        rp2040.flash.fill(0xff, from, from + length);
        this.stall((length / SECTOR) * ERASE_NANOS);
      },
      RP: () => {
        this.beforeFlash();
        const [to, from, length] = registers;
        // Programming clears bits only.
        for (let n = 0; n < length; n++) rp2040.flash[to + n] &= memory(from + n);
        this.stall((length / 256) * WRITE_NANOS);
      },
      UB: () => this.resets.push('boot loader'),
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

  // The core waits for the flash. Peripherals and the DMA go on.
  stall(nanos) {
    this.clock.tick(nanos);
  }

  // Runs until the condition is met, for at most this many milliseconds.
  runUntil(condition, millis, what) {
    const end = this.clock.nanos + millis * 1e6;
    while (!condition()) {
      if (this.clock.nanos >= end || this.resets.length > 1) throw new Error(`not within ${millis} ms: ${what}`);
      this.step();
    }
  }

  // Runs for this many milliseconds, or until the program resets the chip.
  runFor(millis) {
    const end = this.clock.nanos + millis * 1e6;
    while (this.clock.nanos < end && this.resets.length === 0) this.step();
  }

  // A host asks an endpoint some ten thousand times a second.
  step() {
    this.run(25_000);
    this.usb.poll();
  }

  get millis() {
    return this.clock.nanos / 1e6;
  }
}

// rp2040js warns of each access to what it does not model.
function quieten(rp2040) {
  rp2040.logger.warn = () => {};
  rp2040.logger.error = () => {};
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

// The answer of the flash to the command for its unique id. rp2040js answers 0.
function addUniqueId(rp2040) {
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
    const byte = UNIQUE_ID[read - DUMMY_BYTES] ?? 0;
    read += 1;
    return byte;
  };
}

export { FLASH, UNIQUE_ID };
