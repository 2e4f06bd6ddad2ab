// The control port's messages, as far as the tests need them: postcard in COBS (`armwire_bridge::control`).

// Requests by their numbers.
export const IDENTIFY = [0];
export const GET_CONFIG = [2];
export const SAVE_CONFIG = [4];
export const GET_COUNTERS = [6];
export const SUBSCRIBE_FRAMES = [8, 1, 0];
export const RESTART = [9];
export const RESTART_INTO_BOOT_LOADER = [10];
export const setConfig = (config) => [3, ...config];

// Kinds of messages from the adapter, and of replies and events.
const REPLY = 0;
const EVENT = 1;
const FRAME = 0;

// The control port of an enumerated adapter.
export class Control {
  // Stamps of frames in microseconds of the adapter's clock, with their bytes.
  frames = [];

  #chip;
  #endpoint;
  #sequence = 0;
  #replies = new Map();
  #received = [];

  // The numbers of its endpoints from and to the adapter.
  constructor(chip, from, to) {
    this.#chip = chip;
    this.#endpoint = to;
    chip.usb.read(from, (packet) => this.#receive(packet));
  }

  // The bytes of the reply to a request, from its number on.
  request(request, millis = 500) {
    this.#sequence = (this.#sequence + 1) & 0x7f;
    const sequence = this.#sequence;
    this.#chip.usb.write(this.#endpoint, encode([sequence, ...request]));
    this.#chip.runUntil(() => this.#replies.has(sequence), millis, `the reply to ${request}`);
    const reply = this.#replies.get(sequence);
    this.#replies.delete(sequence);
    return reply;
  }

  #receive(packet) {
    for (const byte of packet) {
      if (byte !== 0) {
        this.#received.push(byte);
        continue;
      }
      this.#message(decode(this.#received));
      this.#received = [];
    }
  }

  #message(bytes) {
    const reader = new Reader(bytes);
    const kind = reader.byte();
    if (kind === REPLY) {
      const sequence = reader.byte();
      this.#replies.set(sequence, reader.rest());
    } else if (kind === EVENT) {
      const at = reader.varint();
      if (reader.byte() !== FRAME) return;
      // The initiator, or none.
      if (reader.byte() === 1) reader.byte();
      reader.varint();
      this.frames.push({ at, bytes: reader.rest() });
    }
  }
}

export class Reader {
  #bytes;
  #at = 0;

  constructor(bytes) {
    this.#bytes = bytes;
  }

  byte() {
    if (this.#at >= this.#bytes.length) throw new Error('the message is too short');
    return this.#bytes[this.#at++];
  }

  varint() {
    let value = 0;
    for (let factor = 1; ; factor *= 128) {
      const byte = this.byte();
      value += (byte & 0x7f) * factor;
      if (byte < 0x80) return value;
    }
  }

  text() {
    const length = this.varint();
    return Array.from({ length }, () => String.fromCharCode(this.byte())).join('');
  }

  rest() {
    return Array.from(this.#bytes.slice(this.#at));
  }
}

// COBS, for less than 254 bytes, with the zero at the end.
function encode(bytes) {
  const out = [];
  let block = [];
  for (const byte of [...bytes, 0]) {
    if (byte !== 0) {
      block.push(byte);
      continue;
    }
    out.push(block.length + 1, ...block);
    block = [];
  }
  return [...out, 0];
}

function decode(bytes) {
  const out = [];
  for (let at = 0; at < bytes.length; ) {
    const code = bytes[at];
    out.push(...bytes.slice(at + 1, at + code));
    at += code;
    if (at < bytes.length && code < 255) out.push(0);
  }
  return out;
}
