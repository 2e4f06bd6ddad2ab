// The USB controller, whose host is the virtual board.
//
// rp2040js completes each transfer when the program arms its endpoint: a packet cannot be left unfetched, and no data
// toggle is looked at. Here the board has a copy of what the host can notice, and says what a token did to an endpoint
// (4.1.2.6).
import { Event } from './messages.mjs';

// Registers that the host can notice, by their numbers in USB events.
const ADDR_ENDP = 0x00;
const SOF_RD = 0x48;
const SIE_CTRL = 0x4c;
const SIE_STATUS = 0x50;
const EP_ABORT = 0x60;
const EP_ABORT_DONE = 0x64;
const EP_STALL_ARM = 0x68;
const USB_MUXING = 0x74;
const NOTICED = [ADDR_ENDP, SIE_CTRL, EP_ABORT, EP_STALL_ARM, USB_MUXING];

// Registers that rp2040js does not have.
const USBPHY_DIRECT = 0x7c;
const USBPHY_DIRECT_OVERRIDE = 0x80;
const DP_PULLUP_EN = 1 << 1;
const DP_PULLUP_EN_OVERRIDE_EN = 1 << 2;

// Bits of SIE_STATUS.
const SUSPENDED = 1 << 4;
const RESUME = 1 << 11;
const LINE_STATE = 3 << 2;
const BUS_RESET = 1 << 19;

// The interrupt at the start of a frame, in INTR.
const DEV_SOF = 1 << 17;

// TO_DIGITAL_PAD of USB_MUXING; and the function of a pin that is D+ then, with an output that is off and an input that
// counts as high (2.19.6.1).
const TO_DIGITAL_PAD = 1 << 2;
const DP = 15;
const USB_DP = 8;
const OUTPUT_OFF = 2;
const INPUT_HIGH = 3;
// The values of USB_MUXING in USB events: at the PHY, at pins, and at pins that show an idle bus.
const AT_PHY = 0;
const AT_PINS = 1;
const IDLE = 2;

// Offsets in the memory: the controls of endpoints, of their buffers, and their end.
const ENDPOINTS = 0x08;
const BUFFERS = 0x80;
const END = 0x100;
// Bits of a buffer's control.
const LENGTH = 0x3ff;
const AVAILABLE = 1 << 10;
const STALL = 1 << 11;
const FULL = 1 << 15;

// The last revision with RP2040-E2.
const REVISION_B1 = 1;
const ALL = 0xffffffff;

export class Usb {
  #machine;
  #rp2040;
  #controller;
  #revision;
  // True once an endpoint was held on a chip with RP2040-E2: all answer with NAK from then on.
  #isStuck = false;
  // True during a reset of the bus.
  #isReset = false;
  #registers = new Map([
    [USBPHY_DIRECT, 0],
    [USBPHY_DIRECT_OVERRIDE, 0],
  ]);

  constructor(machine, rp2040, revision) {
    this.#machine = machine;
    this.#revision = revision;
    this.#rp2040 = rp2040;
    this.#controller = rp2040.usbCtrl;
    this.#reportRegisters();
    this.#controller.DPRAMUpdated = (offset) => this.#memoryWritten(offset);
  }

  // The bus is reset.
  resetBus() {
    this.#isReset = true;
    this.#raise(BUS_RESET);
  }

  endReset() {
    this.#isReset = false;
  }

  // A frame starts.
  startFrame(number) {
    this.#controller.sofFrameNumber = number;
    this.#controller.intRaw |= DEV_SOF;
    this.#controller.checkInterrupts();
  }

  // The bus has been idle for 3 ms.
  suspend() {
    this.#raise(SUSPENDED);
  }

  // The host has woken the bus.
  resume() {
    this.#raise(RESUME);
  }

  // A request. The controller accepts it always, and leaves a stall with it (4.1.2.6).
  setup(request) {
    this.#controller.epStallArm = 0;
    this.#controller.sendSetupPacket(request);
  }

  // The host has sent a packet to an endpoint.
  output(endpoint, packet) {
    const buffer = BUFFERS + 8 * endpoint + 4;
    const control = this.#control(buffer) & ~(AVAILABLE | LENGTH);
    this.#rp2040.usbDPRAM.set(packet, this.#controller.getEndpointBufferOffset(endpoint, true));
    this.#rp2040.usbDPRAMView.setUint32(buffer, control | FULL | packet.length, true);
    this.#controller.indicateBufferReady(endpoint, true);
  }

  // The host has fetched the packet of an endpoint.
  fetched(endpoint) {
    const buffer = BUFFERS + 8 * endpoint;
    this.#rp2040.usbDPRAMView.setUint32(buffer, this.#control(buffer) & ~(AVAILABLE | FULL), true);
    this.#controller.indicateBufferReady(endpoint, false);
  }

  // The transactions of these endpoints have ended: they answer with NAK from now on.
  aborted(endpoints) {
    this.#controller.epAbortDone |= endpoints;
  }

  #raise(status) {
    this.#controller.sieStatus |= status;
    this.#controller.sieStatusUpdated();
  }

  #control(offset) {
    return this.#rp2040.usbDPRAMView.getUint32(offset, true);
  }

  #reportRegisters() {
    const controller = this.#controller;
    const { readUint32, writeUint32 } = controller;
    controller.readUint32 = (offset) => {
      const value = this.#registers.get(offset) ?? readUint32.call(controller, offset);
      // rp2040js has no start of frame for a device.
      if (offset === SOF_RD) controller.intRaw &= ~DEV_SOF;
      if (offset === SOF_RD) controller.checkInterrupts();
      return offset === SIE_STATUS && this.#isReset ? value & ~LINE_STATE : value;
    };
    controller.writeUint32 = (offset, value) => {
      if (this.#registers.has(offset)) return this.#registers.set(offset, value);
      const done = controller.epAbortDone;
      // rp2040js does not clear SUSPENDED.
      if (offset === SIE_STATUS) controller.sieStatus &= ~(controller.rawWriteValue & SUSPENDED);
      writeUint32.call(controller, offset, value);
      // rp2040js ends an abort at once. The chip waits for the end of a transaction.
      if (offset === EP_ABORT) controller.epAbortDone = done;
      if (offset === EP_ABORT && value !== 0 && this.#revision <= REVISION_B1) this.#isStuck = true;
      const number = NOTICED.indexOf(offset);
      if (number < 0) return;
      const { events } = this.#machine;
      events.byte(Event.USB);
      events.byte(number);
      events.word(this.#noticed(offset, value));
      this.#machine.stop();
    };
  }

  #noticed(offset, value) {
    if (offset === EP_ABORT && this.#isStuck) return ALL;
    if (offset !== USB_MUXING) return value;
    if ((value & TO_DIGITAL_PAD) === 0) return AT_PHY;
    const pin = this.#rp2040.gpio[DP];
    const isIdle =
      pin.functionSelect === USB_DP && pin.outputEnableOverride === OUTPUT_OFF && pin.inputOverride === INPUT_HIGH;
    const pullsUp =
      (this.#registers.get(USBPHY_DIRECT) & DP_PULLUP_EN) !== 0 &&
      (this.#registers.get(USBPHY_DIRECT_OVERRIDE) & DP_PULLUP_EN_OVERRIDE_EN) !== 0;
    return isIdle && pullsUp ? IDLE : AT_PINS;
  }

  #memoryWritten(offset) {
    if (offset < ENDPOINTS || offset >= END) return;
    const isBuffer = offset >= BUFFERS;
    const { events } = this.#machine;
    events.byte(isBuffer ? Event.BUFFER : Event.ENDPOINT);
    // Twice the number of the endpoint, and one for OUT.
    events.byte((offset - (isBuffer ? BUFFERS : 0)) >> 2);
    const control = this.#control(offset);
    events.word(control);
    if (isBuffer) {
      const endpoint = (offset - BUFFERS) >> 3;
      const isIn = (offset & 4) === 0;
      const from = this.#controller.getEndpointBufferOffset(endpoint, false);
      const length = isIn && (control & AVAILABLE) !== 0 ? control & LENGTH : 0;
      events.bytes(this.#rp2040.usbDPRAM.subarray(from, from + length));
    }
    this.#machine.stop();
  }
}
