// An RP2040 that runs an image from its flash: rp2040js, with three corrections that embassy needs.
//
// Not covered: the boot ROM, which rp2040js does not have, and the second stage of the boot loader. A receive interrupt
// comes with each byte, where the chip waits for 28 bytes or a pause.
import { ConsoleLogger, LogLevel, Simulator } from 'rp2040js';

const FLASH = 0x10000000;
const FLASH_END = 0x11000000;
// Behind the 256 bytes of the second stage.
const VECTOR_TABLE = 0x10000100;
const CYCLE_NANOS = 8;
// The longest step in sleep, so that bytes from outside wake the chip in time.
const SLEEP_NANOS = 5_000;

export class Chip {
  // A chip with the program of this ELF file in its flash, at the program's reset vector.
  constructor(elf) {
    const { clock, rp2040 } = new Simulator();
    this.clock = clock;
    this.core = rp2040.core;
    load(elf, rp2040.flash);
    this.core.VTOR = VECTOR_TABLE;
    this.core.reset();
    wakeOnSev(rp2040);
    this.uarts = rp2040.uart.map((uart) => new Uart(uart, clock));
  }

  // Runs the program for this many nanoseconds of its own time.
  run(nanos) {
    const { clock, core } = this;
    const end = clock.nanos + nanos;
    while (clock.nanos < end) {
      if (core.waiting) clock.tick(Math.min(clock.nanosToNextAlarm || SLEEP_NANOS, SLEEP_NANOS));
      else clock.tick(core.executeInstruction() * CYCLE_NANOS);
    }
  }
}

// The line at a UART of the chip: bytes take their time, and none is lost unnoticed.
class Uart {
  // Bytes that the program sent, and bytes that it has read.
  sent = 0;
  read = 0;
  onByte = () => {};

  #uart;
  #clock;
  #incoming = [];

  constructor(uart, clock) {
    this.#uart = uart;
    this.#clock = clock;
    uart.onByte = (byte) => {
      this.sent += 1;
      this.onByte(byte);
    };
    keepRegisters(uart);
    paceTransmitter(uart, clock);
    const { readUint32 } = uart;
    uart.readUint32 = (offset) => {
      if (offset === UARTDR && !uart.rxFIFO.empty) this.read += 1;
      return readUint32.call(uart, offset);
    };
  }

  // Puts bytes on the line to the chip, behind those that are on it.
  send(bytes) {
    const isIdle = this.#incoming.length === 0;
    this.#incoming.push(...bytes);
    if (isIdle) this.#schedule();
  }

  // True if the program has received all bytes for the chip.
  get isRead() {
    return this.#incoming.length === 0 && this.#uart.rxFIFO.empty;
  }

  // True during a transmission of the chip.
  get isSending() {
    return (this.#uart.flags & BUSY) !== 0;
  }

  #arrive() {
    if (this.#uart.rxFIFO.full) throw new Error('the receive FIFO overruns: the program does not keep up');
    this.#uart.feedByte(this.#incoming.shift());
    this.#schedule();
  }

  #schedule() {
    if (this.#incoming.length === 0) return;
    this.#clock.createAlarm(() => this.#arrive()).schedule(byteNanos(this.#uart));
  }
}

const UARTDR = 0x00;
const UARTIFLS = 0x34;
const UARTDMACR = 0x48;
const TXINTR = 1 << 5;
const TXFF = 1 << 5;
const BUSY = 1 << 3;
const TXFE = 1 << 7;
const FIFO = 32;
const TX_LEVELS = [FIFO / 8, FIFO / 4, FIFO / 2, (FIFO * 3) / 4, (FIFO * 7) / 8];

// Ten bits.
function byteNanos(uart) {
  return 1e10 / uart.baudRate;
}

// Writes the loadable segments of an ELF file into the flash.
function load(elf, flash) {
  const [headers, count] = [elf.readUInt32LE(28), elf.readUInt16LE(44)];
  for (let n = 0; n < count; n++) {
    const header = headers + 32 * n;
    const [type, offset, , address, size] = [0, 4, 8, 12, 16].map((field) => elf.readUInt32LE(header + field));
    if (type === 1 && size > 0 && address >= FLASH && address < FLASH_END) {
      flash.set(elf.subarray(offset, offset + size), address - FLASH);
    }
  }
}

// rp2040js only logs SEV. The chip sets its event register, which the next WFE clears and does not sleep. Without it
// embassy's executor sleeps for ever when it is woken between its last look and its WFE.
function wakeOnSev(rp2040) {
  const logger = new ConsoleLogger(LogLevel.Error);
  logger.info = (_, message) => {
    if (message === 'SEV') rp2040.core.eventRegistered = true;
  };
  rp2040.logger = logger;
}

// rp2040js has neither UARTIFLS nor UARTDMACR and reads them as all ones, which embassy takes for a transfer by DMA: its
// interrupt handler then returns at once. Here they keep what is written.
function keepRegisters(uart) {
  const registers = new Map([
    [UARTIFLS, 0x12],
    [UARTDMACR, 0],
  ]);
  const { readUint32, writeUint32 } = uart;
  uart.readUint32 = (offset) => registers.get(offset) ?? readUint32.call(uart, offset);
  uart.writeUint32 = (offset, value) => {
    if (registers.has(offset)) registers.set(offset, value);
    else writeUint32.call(uart, offset, value);
  };
}

// rp2040js sends a byte in no time and raises the transmit interrupt whenever it looks at it, so a driver that leaves the
// interrupt enabled never leaves its handler. On the chip a byte takes ten bits, the FIFO holds 32, and the interrupt
// rises when the FIFO drains to the level in UARTIFLS.
function paceTransmitter(uart, clock) {
  let level = 0;
  let free = 0;
  const { writeUint32 } = uart;
  uart.checkInterrupts = () => uart.rp2040.setInterrupt(uart.irq, (uart.interruptStatus & uart.interruptMask) !== 0);
  const sent = (byte) => {
    level -= 1;
    if (level === TX_LEVELS[uart.readUint32(UARTIFLS) & 7]) {
      uart.interruptStatus |= TXINTR;
      uart.checkInterrupts();
    }
    uart.onByte(byte);
  };
  uart.writeUint32 = (offset, value) => {
    if (offset !== UARTDR) return writeUint32.call(uart, offset, value);
    if (level === FIFO) throw new Error('the transmit FIFO overruns: the program does not look at TXFF');
    level += 1;
    free = Math.max(free, clock.nanos) + byteNanos(uart);
    clock.createAlarm(() => sent(value & 0xff)).schedule(free - clock.nanos);
  };
  const receiver = Object.getOwnPropertyDescriptor(Object.getPrototypeOf(uart), 'flags').get;
  Object.defineProperty(uart, 'flags', {
    get: () => (receiver.call(uart) & ~TXFE) | (level === 0 ? TXFE : BUSY) | (level === FIFO ? TXFF : 0),
  });
}
