// A chip that runs until the virtual board has to act.
import { start } from '../../examples/rp2040/emulator/chip.mjs';
import { correct } from './corrections.mjs';
import { Event, Writer } from './messages.mjs';
import { Uart } from './uart.mjs';
import { Usb } from './usb.mjs';

// The number of the arm's UART.
const ARM = 1;
const FLASH = 0x10000000;
const RAM = 0x20000000;
const WATCHDOG = 0x40058;
// SysTick, the NVIC and the other registers of the core (ARMv6-M, B3.2).
const SYSTEM_CONTROL = 0xe000e000;

// Reasons for holding the core.
const BY_BOARD = 1 << 0;
const BY_FLASH = 1 << 1;
const BY_BOOT_LOADER = 1 << 2;
const BY_LOCKUP = 1 << 3;

export class Machine {
  // For the virtual board, at its next stop.
  events = new Writer();

  #cycleNanos;
  #revision;
  #uniqueId;
  // The functions that run only in a crash: a 1 for each halfword of the flash.
  #crashes;
  #crashed = false;
  #instructions = 0;
  #busyNanos = 0;
  #isStopped = false;
  #held = 0;
  // The board's time at which the chip started.
  #origin = 0;
  #clock;
  #rp2040;

  constructor({ cycleNanos, revision, uniqueId, crashes, flash }) {
    this.#cycleNanos = cycleNanos;
    this.#revision = revision;
    this.#uniqueId = uniqueId;
    this.#crashes = new Uint8Array(flash.length / 2);
    for (const address of crashes) this.#crashes[(address - FLASH) >> 1] = 1;
    this.#start((bytes) => bytes.set(flash));
  }

  // Runs until this time of the board, or until the board has to act. Ends the batch of events.
  run(until) {
    this.#isStopped = false;
    const clock = this.#clock;
    const { core } = this.#rp2040;
    const end = until - this.#origin;
    while (clock.nanos < end && !this.#isStopped) {
      if (this.#held !== 0 || core.waiting) {
        const left = end - clock.nanos;
        clock.tick(clock.nextAlarm ? Math.min(clock.nanosToNextAlarm, left) : left);
      } else if (this.#isCrash(core.PC)) {
        this.#crash(core.PC);
      } else {
        const nanos = core.executeInstruction() * this.#cycleNanos;
        this.#instructions += 1;
        this.#busyNanos += nanos;
        clock.tick(nanos);
      }
    }
    this.events.byte(Event.STOPPED);
    this.events.number(Math.ceil(this.#now));
    this.events.number(this.#instructions);
    this.events.number(Math.round(this.#busyNanos));
  }

  // Ends the run after this instruction.
  stop() {
    this.#isStopped = true;
  }

  // Starts the chip again, for this reason in the watchdog's register. The RAM and the flash keep their content, and so do
  // the watchdog's scratch registers, of which the ROM clears one.
  restart(reason, isByRom) {
    const before = this.#rp2040;
    this.#origin = this.#now;
    this.#held &= BY_BOARD;
    this.#crashed = false;
    this.#start((flash) => flash.set(before.flash));
    this.#rp2040.sram.set(before.sram);
    const watchdog = this.#rp2040.peripherals[WATCHDOG];
    watchdog.reason = reason;
    if (reason !== 0) watchdog.scratchData.set(before.peripherals[WATCHDOG].scratchData);
    if (isByRom) watchdog.scratchData[4] = 0;
  }

  // Holds the core, or releases it.
  hold(isHeld) {
    this.#hold(BY_BOARD, isHeld);
  }

  // Moves the top of the stack to this address, with this number of bytes.
  moveStack(to, bytes) {
    const { core, sram } = this.#rp2040;
    const from = core.SP - RAM;
    sram.copyWithin(to - RAM, from, from + bytes);
    core.SP = to;
  }

  // Writes bytes of the flash, as its own operations do.
  writeFlash(offset, bytes) {
    this.#rp2040.flash.set(bytes, offset);
  }

  // The operation of the flash has ended.
  endFlash() {
    this.#hold(BY_FLASH, false);
  }

  // Reports the word at an address, if there is one.
  read(address) {
    const isThere = this.#has(address);
    this.events.byte(Event.VALUE);
    this.events.byte(isThere ? 1 : 0);
    this.events.word(isThere ? this.#rp2040.readUint32(address) : 0);
  }

  // Writes a word, and reports whether there is one at the address.
  write(address, value) {
    const isThere = this.#has(address);
    if (isThere) this.#rp2040.writeUint32(address, value);
    this.events.byte(Event.VALUE);
    this.events.byte(isThere ? 1 : 0);
    this.events.word(value);
  }

  get #now() {
    return this.#origin + this.#clock.nanos;
  }

  #start(fill) {
    const { clock, rp2040 } = start(fill);
    this.#clock = clock;
    this.#rp2040 = rp2040;
    correct(rp2040, {
      revision: this.#revision,
      uniqueId: this.#uniqueId,
      lockUp: () => this.#hold(BY_LOCKUP, true),
      rom: {
        erase: (from, length) => {
          this.events.byte(Event.ERASE);
          this.events.word(from);
          this.events.word(length);
          this.#waitForFlash();
        },
        program: (to, bytes) => {
          this.events.byte(Event.PROGRAM);
          this.events.word(to);
          this.events.bytes(bytes);
          this.#waitForFlash();
        },
        startBootLoader: () => {
          this.events.byte(Event.BOOT_LOADER);
          this.#hold(BY_BOOT_LOADER, true);
          this.stop();
        },
      },
    });
    // rp2040js leaves the reset to its user.
    const watchdog = rp2040.peripherals[WATCHDOG];
    watchdog.onWatchdogTrigger = () => {
      watchdog.alarm.enable = false;
      this.events.byte(Event.RESET);
      this.events.byte(watchdog.reason);
      this.stop();
    };
    this.uart = new Uart(this, rp2040.uart[ARM]);
    this.usb = new Usb(this, rp2040, this.#revision);
  }

  #waitForFlash() {
    this.#hold(BY_FLASH, true);
    this.stop();
  }

  #hold(reason, isHeld) {
    if (isHeld) this.#held |= reason;
    else this.#held &= ~reason;
  }

  #isCrash(address) {
    return this.#crashes[(address - FLASH) >>> 1] === 1 && !this.#crashed;
  }

  // The run continues after it.
  #crash(address) {
    this.#crashed = true;
    this.events.byte(Event.CRASH);
    this.events.word(address);
    this.stop();
  }

  #has(address) {
    const { flash, sram, usbDPRAM } = this.#rp2040;
    const memories = [
      [FLASH, flash.length],
      [RAM, sram.length],
      [0x50100000, usbDPRAM.length],
    ];
    const isMemory = memories.some(([start, length]) => address >= start && address + 4 <= start + length);
    const isCore = address >>> 12 === SYSTEM_CONTROL >>> 12;
    return isMemory || isCore || (address >>> 14) << 2 in this.#rp2040.peripherals;
  }
}
