// The messages between this process and the virtual board: `virtual-board/src/rp2040/messages.rs`. Each has its length
// in front, numbers are little-endian.
import fs from 'node:fs';

const STDIN = 0;
const STDOUT = 1;
const LENGTH = 4;

// The numbers of commands from the virtual board. START is the first of all; RUN, READ and WRITE have an answer.
export const Command = {
  RUN: 0,
  START: 1,
  RESET: 2,
  HOLD: 3,
  FLASH: 4,
  FLASH_DONE: 5,
  RECEIVED: 6,
  TAKEN: 7,
  SENT: 8,
  BUS_RESET: 9,
  SETUP: 10,
  OUT: 11,
  IN_DONE: 12,
  SUSPEND: 13,
  RESUME: 14,
  ABORTED: 15,
  READ: 16,
  WRITE: 17,
  MOVE_STACK: 18,
  BUS_RESET_DONE: 19,
  START_OF_FRAME: 20,
};

// The numbers of events for it. STOPPED or FAILED ends a run, VALUE answers READ and WRITE.
export const Event = {
  STOPPED: 0,
  BYTE: 1,
  UART: 2,
  USB: 3,
  BUFFER: 4,
  ENDPOINT: 5,
  ERASE: 6,
  PROGRAM: 7,
  RESET: 8,
  BOOT_LOADER: 9,
  CRASH: 10,
  VALUE: 11,
  FAILED: 12,
};

// The next batch of commands; null at the end.
export function receive() {
  const length = read(LENGTH);
  return length && new Reader(read(length.readUInt32LE(0)));
}

function read(length) {
  const bytes = Buffer.alloc(length);
  for (let at = 0; at < length; ) {
    const count = fs.readSync(STDIN, bytes, at, length - at);
    if (count === 0) return null;
    at += count;
  }
  return bytes;
}

class Reader {
  #bytes;
  #at = 0;

  constructor(bytes) {
    this.#bytes = bytes;
  }

  get isEmpty() {
    return this.#at === this.#bytes.length;
  }

  byte() {
    return this.#bytes.readUInt8(this.#skip(1));
  }

  word() {
    return this.#bytes.readUInt32LE(this.#skip(4));
  }

  number() {
    return this.#bytes.readDoubleLE(this.#skip(8));
  }

  bytes() {
    const length = this.word();
    const at = this.#skip(length);
    return this.#bytes.subarray(at, at + length);
  }

  #skip(length) {
    const at = this.#at;
    this.#at += length;
    return at;
  }
}

// A batch of events.
export class Writer {
  #buffer = Buffer.alloc(64 * 1024);
  #at = LENGTH;

  byte(value) {
    this.#at = this.#buffer.writeUInt8(value, this.#at);
  }

  word(value) {
    this.#at = this.#buffer.writeUInt32LE(value >>> 0, this.#at);
  }

  number(value) {
    this.#at = this.#buffer.writeDoubleLE(value, this.#at);
  }

  bytes(bytes) {
    this.word(bytes.length);
    this.#buffer.set(bytes, this.#at);
    this.#at += bytes.length;
  }

  // Sends the batch.
  send() {
    this.#buffer.writeUInt32LE(this.#at - LENGTH, 0);
    for (let at = 0; at < this.#at; ) at += fs.writeSync(STDOUT, this.#buffer, at, this.#at - at);
    this.#at = LENGTH;
  }
}
