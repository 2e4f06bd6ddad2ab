// A host on the emulated USB controller.
//
// rp2040js completes each transfer when the program arms its endpoint: a packet cannot be left unfetched, and no data
// toggle is looked at. Here an armed endpoint stays armed until the host sends a token to it (RP2040 datasheet
// 4.1.2.6), and the host checks the toggles.
const AVAILABLE = 1 << 10;
const STALL = 1 << 11;
const DATA1 = 1 << 13;
const FULL = 1 << 15;
const LENGTH = 0x3ff;
const ENABLED = 1 << 31;
const BUFFERS = 0x80;
const SETUP_RECEIVED = 1 << 17;
const PACKET = 64;

export class Usb {
  #chip;
  #controller;
  #memory;
  // The number of the next packet of each endpoint, by its address.
  #toggles = new Map();
  // Packets for endpoints, by number, that the device has not accepted yet.
  #outgoing = new Map();
  // Endpoints that the host reads, by number, with the function that takes each packet.
  #readers = new Map();

  constructor(chip, controller) {
    this.#chip = chip;
    this.#controller = controller;
    this.#memory = chip.core.rp2040.usbDPRAMView;
    controller.DPRAMUpdated = () => {};
  }

  // Resets the bus: the host uses no endpoint, and toggles begin again.
  reset() {
    this.#toggles.clear();
    this.#outgoing.clear();
    this.#readers.clear();
    this.#controller.resetDevice();
    this.#chip.runFor(30);
  }

  // Reads an endpoint from now on.
  read(endpoint, take) {
    this.#readers.set(endpoint, take);
  }

  // Sends bytes to an endpoint, in packets.
  write(endpoint, bytes) {
    const queue = this.#outgoing.get(endpoint) ?? [];
    for (let n = 0; n < bytes.length; n += PACKET) queue.push(Uint8Array.from(bytes.slice(n, n + PACKET)));
    this.#outgoing.set(endpoint, queue);
  }

  // True if the device has accepted all bytes for the endpoint.
  isWritten(endpoint) {
    return (this.#outgoing.get(endpoint)?.length ?? 0) === 0;
  }

  // Sends a token to each endpoint that the host uses.
  poll() {
    for (const [endpoint, take] of this.#readers) {
      const packet = this.#in(endpoint);
      if (packet instanceof Uint8Array) take(packet);
    }
    for (const [endpoint, queue] of this.#outgoing) {
      if (queue.length > 0 && this.#out(endpoint, queue[0]) === 'accepted') queue.shift();
    }
  }

  // A request with an answer of the device. Returns the answer; null if the device stalls.
  requestIn(type, request, value, index, length) {
    this.#setup(type, request, value, index, length);
    const answer = [];
    for (;;) {
      const packet = this.#await(() => this.#in(0));
      if (packet === 'stalled') return null;
      answer.push(...packet);
      if (packet.length < PACKET || answer.length >= length) break;
    }
    this.#await(() => this.#out(0, new Uint8Array(0), DATA1));
    return Uint8Array.from(answer);
  }

  // A request with data of the host, at most one packet. Returns true if the device accepts it.
  requestOut(type, request, value, index, data = []) {
    this.#setup(type, request, value, index, data.length);
    if (data.length > 0 && this.#await(() => this.#out(0, Uint8Array.from(data))) === 'stalled') return false;
    this.#toggles.set(0x80, DATA1);
    return this.#await(() => this.#in(0)) !== 'stalled';
  }

  // Begins a request and leaves it after this many polls of its first stage.
  abandon(type, request, value, index, length, polls) {
    this.#setup(type, request, value, index, length);
    for (let n = 0; n < polls; n++) {
      this.#chip.step();
      if ((type & 0x80) !== 0) this.#in(0);
    }
  }

  // Clears the halt of an endpoint, whose toggle begins again.
  clearHalt(address) {
    const isDone = this.requestOut(0x02, 1, 0, address);
    this.#toggles.set(address, 0);
    return isDone;
  }

  // Sets the configuration again: all toggles begin again.
  setConfiguration() {
    const isDone = this.requestOut(0, 9, 1, 0);
    for (const address of this.#toggles.keys()) this.#toggles.set(address, 0);
    return isDone;
  }

  #setup(type, request, value, index, length) {
    const packet = [type, request, value & 0xff, value >> 8, index & 0xff, index >> 8, length & 0xff, length >> 8];
    this.#toggles.set(0x80, DATA1);
    this.#toggles.set(0, DATA1);
    // The controller accepts a SETUP packet always, and leaves a stall with it.
    this.#controller.epStallArm = 0;
    this.#controller.sendSetupPacket(Uint8Array.from(packet));
  }

  // Sends a token until the device does not answer with NAK.
  #await(token) {
    let answer = null;
    this.#chip.runUntil(() => (answer = token()) !== 'nak', 500, 'the answer of endpoint 0');
    return answer;
  }

  #isStalled(endpoint, control, bit) {
    return (control & STALL) !== 0 && (endpoint !== 0 || (this.#controller.epStallArm & bit) !== 0);
  }

  #isEnabled(endpoint, isOut) {
    return endpoint === 0 || (this.#memory.getUint32(8 * endpoint + (isOut ? 4 : 0), true) & ENABLED) !== 0;
  }

  // An IN token: a packet, 'nak' or 'stalled'.
  #in(endpoint) {
    const at = BUFFERS + 8 * endpoint;
    const control = this.#memory.getUint32(at, true);
    if (!this.#isEnabled(endpoint, false)) return 'nak';
    if (this.#isStalled(endpoint, control, 1)) return 'stalled';
    if ((control & AVAILABLE) === 0) return 'nak';
    const address = 0x80 | endpoint;
    const toggle = this.#toggles.get(address) ?? 0;
    const from = this.#controller.getEndpointBufferOffset(endpoint, false);
    const packet = this.#chip.core.rp2040.usbDPRAM.slice(from, from + (control & LENGTH));
    this.#memory.setUint32(at, control & ~(AVAILABLE | FULL), true);
    this.#controller.indicateBufferReady(endpoint, false);
    if ((control & DATA1) !== toggle) {
      // The host takes it for a repetition.
      throw new Error(`the packet in endpoint ${endpoint} has the wrong data toggle at ${this.#chip.millis} ms`);
    }
    this.#toggles.set(address, toggle ^ DATA1);
    return packet;
  }

  // An OUT token with a packet: 'accepted', 'nak' or 'stalled'.
  #out(endpoint, packet, toggle = this.#toggles.get(endpoint) ?? 0) {
    const at = BUFFERS + 8 * endpoint + 4;
    const control = this.#memory.getUint32(at, true);
    if (!this.#isEnabled(endpoint, true)) return 'nak';
    if (this.#isStalled(endpoint, control, 2)) return 'stalled';
    if ((control & AVAILABLE) === 0) return 'nak';
    if ((control & DATA1) !== toggle) {
      throw new Error(`endpoint ${endpoint} expects the other data toggle at ${this.#chip.millis} ms`);
    }
    this.#chip.core.rp2040.usbDPRAM.set(packet, this.#controller.getEndpointBufferOffset(endpoint, true));
    this.#memory.setUint32(at, (control & ~(AVAILABLE | LENGTH)) | FULL | packet.length, true);
    this.#controller.indicateBufferReady(endpoint, true);
    this.#toggles.set(endpoint, toggle ^ DATA1);
    return 'accepted';
  }
}
