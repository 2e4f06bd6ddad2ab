// An adapter on a Pico, enumerated, with `armwire sim ling` on its UART.
import fs from 'node:fs';
import os from 'node:os';
import path from 'node:path';
import { Arm } from '../../examples/rp2040/emulator/arm.mjs';
import { Control } from './control.mjs';
import { Pico } from './pico.mjs';

const image = process.env.ARMWIRE_IMAGE;
const armwire = process.env.ARMWIRE;
if (!image || !armwire) throw new Error('ARMWIRE_IMAGE and ARMWIRE have to name the image and the command');

// The time that the arm takes for an answer.
const TURNAROUND_NANOS = 100_000;
// The longest real time that the virtual arm's process may take. The chip's time stands still meanwhile.
const PROCESS_MILLIS = 60_000;

const CDC = { serial: { in: 2, out: 1 }, control: { in: 3, out: 2 } };

// A chip just started, without a host.
export function start() {
  const pico = new Pico(fs.readFileSync(image));
  pico.runFor(20);
  return pico;
}

// Enumerates the adapter and opens its serial port. Returns its descriptors and its control port.
export function enumerate(pico) {
  const { usb } = pico;
  usb.reset();
  const device = usb.requestIn(0x80, 6, 0x100, 0, 18);
  usb.requestOut(0, 5, 7, 0);
  const config = usb.requestIn(0x80, 6, 0x200, 0, 255);
  const string = (number) => {
    const descriptor = usb.requestIn(0x80, 6, 0x300 | number, 0x409, 255);
    return Buffer.from(descriptor.slice(2)).toString('utf16le');
  };
  usb.requestOut(0, 9, 1, 0);
  // The program opens the port.
  usb.requestOut(0x21, 0x22, 1, 0);
  return { device, config, string, control: new Control(pico, CDC.control.in, CDC.control.out) };
}

// The serial port.
export class Serial {
  received = [];
  sent = 0;

  #usb;

  constructor(pico) {
    this.#usb = pico.usb;
    this.#usb.read(CDC.serial.in, (packet) => this.received.push(...packet));
  }

  write(bytes) {
    this.sent += bytes.length;
    this.#usb.write(CDC.serial.out, bytes);
  }
}

// A virtual arm on the line, which answers each frame after a fixed time of the chip.
export class Line {
  // Times of the chip in microseconds: the start of each request, and the end of each answer.
  requests = [];
  answers = [];

  #arm;
  #folder;

  static async start(pico) {
    const line = new Line();
    line.#folder = fs.mkdtempSync(path.join(os.tmpdir(), 'armwire-pico-'));
    line.#arm = await Arm.start(armwire, path.join(line.#folder, 'arm'));
    line.#connect(pico);
    return line;
  }

  #connect(pico) {
    const { clock, arm } = pico;
    const byteMicros = 10;
    let frame = [];
    // The lengths of the answers on their way.
    const lengths = [];
    arm.onByte = (byte) => {
      if (frame.length === 0) this.requests.push(clock.nanos / 1000 - byteMicros);
      frame.push(byte);
      if (frame.length < 4 || frame.length < 6 + frame[3]) return;
      const answer = this.#ask(Buffer.from(frame));
      frame = [];
      clock.createAlarm(() => {
        lengths.push(answer.length);
        arm.send(answer);
      }).schedule(TURNAROUND_NANOS);
    };
    arm.onArrival = () => {
      lengths[0] -= 1;
      if (lengths[0] > 0) return;
      lengths.shift();
      this.answers.push(clock.nanos / 1000);
    };
  }

  // The arm's answer, for which the real time is waited that its process takes.
  #ask(frame) {
    this.#arm.write(frame);
    const end = performance.now() + PROCESS_MILLIS;
    const answer = [];
    while (answer.length < 4 || answer.length < 6 + answer[3]) {
      answer.push(...this.#arm.read());
      if (performance.now() > end) throw new Error(`the virtual arm does not answer ${frame.toString('hex')}`);
    }
    return answer;
  }

  // Ends the arm, and returns its counts of received and sent bytes.
  async end() {
    try {
      return await this.#arm.end();
    } finally {
      fs.rmSync(this.#folder, { recursive: true });
    }
  }
}
