// A Raspberry Pi Pico that runs the adapter's image: the emulated chip of the example with its flash, the functions of
// its boot ROM that the image calls, and a host on USB.
import { Chip } from '../../examples/rp2040/emulator/chip.mjs';
import { correct } from '../../virtual-board/rp2040/corrections.mjs';
import { Usb } from './usb.mjs';

// The UART of the arm.
const ARM = 1;
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
    correct(rp2040, {
      uniqueId: UNIQUE_ID,
      rom: {
        erase: (from, length) => {
          this.beforeFlash();
          rp2040.flash.fill(0xff, from, from + length);
          this.stall((length / SECTOR) * ERASE_NANOS);
        },
        program: (to, bytes) => {
          this.beforeFlash();
          // Programming clears bits only.
          for (let n = 0; n < bytes.length; n++) rp2040.flash[to + n] &= bytes[n];
          this.stall((bytes.length / 256) * WRITE_NANOS);
        },
        startBootLoader: () => this.resets.push('boot loader'),
      },
    });
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
