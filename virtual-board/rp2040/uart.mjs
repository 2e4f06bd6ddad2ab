// The registers and FIFOs of the arm's UART. The virtual board has the shift registers and the line.
import { keepRegisters, requestTransfers } from '../../examples/rp2040/emulator/chip.mjs';
import { Event } from './messages.mjs';

const UARTDR = 0x00;
// The registers of the line coding and UARTCR.
const SETTINGS = [0x24, 0x28, 0x2c, 0x30];
const FIFO = 32;

// The pads of the pins, that of GP4, which sends to the arm, and its pull-up (2.19.6.3).
const PADS = 0x4001c;
const TX_PAD = 0x04 + 4 * 4;
const PULL_UP = 1 << 3;

// Bits of UARTFR.
const BUSY = 1 << 3;
const TXFF = 1 << 5;
const TXFE = 1 << 7;

// Errors of a received byte: bits of RECEIVED, UARTDR and UARTRIS in the same order (4.2.8). The last one lost a byte.
const ERRORS = 4;
const OVERRUN = 1 << 3;
const DR_ERRORS_AT = 8;
const RIS_ERRORS_AT = 7;

export class Uart {
  #uart;
  #machine;
  // Bytes in the transmit FIFO, and whether a byte is on the line.
  #level = 0;
  #isBusy = false;
  #isOneWire = false;
  #transmitter = { isFull: () => this.#level === FIFO, onRoom: () => {} };

  constructor(machine, uart) {
    this.#machine = machine;
    this.#uart = uart;
    keepRegisters(uart);
    this.#watchPad();
    this.#takeBytes();
    this.#showFlags();
    this.#reportSettings();
    requestTransfers(uart, this.#transmitter);
  }

  // A byte has arrived, with these errors.
  receive(byte, errors) {
    const uart = this.#uart;
    uart.interruptStatus |= errors << RIS_ERRORS_AT;
    if ((errors & OVERRUN) !== 0 || uart.rxFIFO.full) {
      uart.interruptStatus |= OVERRUN << RIS_ERRORS_AT;
      uart.checkInterrupts();
    } else {
      uart.feedByte(byte | (errors << DR_ERRORS_AT));
    }
  }

  // The shift register has taken a byte.
  take() {
    this.#level -= 1;
    this.#isBusy = true;
    this.#transmitter.onRoom();
  }

  // The shift register is empty.
  rest() {
    this.#isBusy = false;
  }

  // rp2040js sends a byte in no time. On the chip the FIFO has 32 bytes.
  #takeBytes() {
    const uart = this.#uart;
    const { writeUint32 } = uart;
    uart.writeUint32 = (offset, value) => {
      if (offset !== UARTDR) return writeUint32.call(uart, offset, value);
      if (this.#level === FIFO) throw new Error('the transmit FIFO overruns: the program does not look at TXFF');
      this.#level += 1;
      const { events } = this.#machine;
      events.byte(Event.BYTE);
      events.byte(value & 0xff);
      // The board looks for it at the end of the byte that is on the line.
      if (!this.#isBusy) this.#machine.stop();
    };
    // rp2040js raises the transmit interrupt at every check.
    uart.checkInterrupts = () => uart.rp2040.setInterrupt(uart.irq, (uart.interruptStatus & uart.interruptMask) !== 0);
  }

  #showFlags() {
    const uart = this.#uart;
    const receiver = Object.getOwnPropertyDescriptor(Object.getPrototypeOf(uart), 'flags').get;
    Object.defineProperty(uart, 'flags', {
      get: () => {
        const isEmpty = this.#level === 0;
        const busy = this.#isBusy || !isEmpty;
        return (receiver.call(uart) & ~TXFE) | (isEmpty ? TXFE : 0) | (busy ? BUSY : 0) | (this.#level === FIFO ? TXFF : 0);
      },
    });
  }

  #reportSettings() {
    const uart = this.#uart;
    const { writeUint32 } = uart;
    uart.writeUint32 = (offset, value) => {
      writeUint32.call(uart, offset, value);
      if (SETTINGS.includes(offset)) this.#report();
    };
  }

  // The UART has no mode for one wire. A program that drives the wire at times only pulls it up: then it is connected
  // to both pins.
  #watchPad() {
    const pads = this.#uart.rp2040.peripherals[PADS];
    const { writeUint32 } = pads;
    pads.writeUint32 = (offset, value) => {
      writeUint32.call(pads, offset, value);
      if (offset !== TX_PAD) return;
      this.#isOneWire = (value & PULL_UP) !== 0;
      this.#report();
    };
  }

  #report() {
    const uart = this.#uart;
    const { events } = this.#machine;
    events.byte(Event.UART);
    events.word(uart.intDivisor * 64 + uart.fracDivisor);
    events.word(uart.rp2040.clkPeri);
    events.word(uart.lineCtrlRegister);
    events.word(uart.ctrlRegister);
    events.byte(this.#isOneWire ? 1 : 0);
    this.#machine.stop();
  }
}
