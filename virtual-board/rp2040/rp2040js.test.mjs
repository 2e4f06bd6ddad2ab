// What rp2040js does otherwise than the chip, and is corrected for (`docs/rp2040js.md`). A test that fails shows that a
// correction is no longer needed.
import assert from 'node:assert/strict';
import { createRequire } from 'node:module';
import test from 'node:test';

const emulator = new URL('../../examples/rp2040/emulator/package.json', import.meta.url);
const { RP2040 } = createRequire(emulator)('rp2040js');

const ALL_ONES = 0xffffffff;
const UART0 = 0x40034000;
const UARTDR = UART0 + 0x00;
const UARTFR = UART0 + 0x18;
const UARTIBRD = UART0 + 0x24;
const UARTCR = UART0 + 0x30;
const UARTIFLS = UART0 + 0x34;
const UARTIMSC = UART0 + 0x38;
const UARTRIS = UART0 + 0x3c;
const UARTICR = UART0 + 0x44;
const UARTDMACR = UART0 + 0x48;
const ENABLED = 0x301;
const TXFE = 1 << 7;
const TXFF = 1 << 5;
const BUSY = 1 << 3;
const TXINTR = 1 << 5;
const DREQ_UART0 = { tx: 20, rx: 21 };

// A chip without a program.
function chip() {
  const chip = new RP2040();
  for (const level of ['warn', 'error', 'info', 'debug']) chip.logger[level] = () => {};
  return chip;
}

test('WFE sleeps after SEV', () => {
  const { core } = chip();
  const RAM = 0x20000000;
  core.rp2040.writeUint32(RAM, 0xbf20bf40);
  core.PC = RAM;
  core.executeInstruction();
  core.executeInstruction();
  assert.equal(core.waiting, true);
});

test('interrupt that a program sets pending is lost', () => {
  const NVIC_ISPR = 0xe000e200;
  const TIMER = 1 << 3;
  const rp2040 = chip();
  rp2040.writeUint32(NVIC_ISPR, TIMER);
  assert.equal(rp2040.core.pendingInterrupts & TIMER, TIMER);
  rp2040.setInterrupt(3, false);
  assert.equal(rp2040.core.pendingInterrupts & TIMER, 0);
});

test('access to nothing is no fault', () => {
  const { core } = chip();
  const RAM = 0x20000000;
  // push {r0}
  core.rp2040.writeUint32(RAM + 16, 0xb401);
  core.PC = RAM + 16;
  core.SP = RAM;
  core.executeInstruction();
  assert.equal(core.PC, RAM + 18);
  assert.equal(core.SP, RAM - 4);
});

test('UART has neither UARTIFLS nor UARTDMACR', () => {
  const rp2040 = chip();
  for (const register of [UARTIFLS, UARTDMACR]) {
    rp2040.writeUint32(register, 0);
    assert.equal(rp2040.readUint32(register), ALL_ONES);
  }
});

test('UART sends bytes in no time', () => {
  const rp2040 = chip();
  let sent = 0;
  rp2040.uart[0].onByte = () => (sent += 1);
  rp2040.writeUint32(UARTCR, ENABLED);
  for (let n = 0; n < 100; n++) rp2040.writeUint32(UARTDR, n);
  assert.equal(sent, 100);
  assert.equal(rp2040.readUint32(UARTFR) & (TXFE | TXFF | BUSY), TXFE);
});

test('transmit interrupt cannot be cleared', () => {
  const rp2040 = chip();
  rp2040.writeUint32(UARTIMSC, TXINTR);
  rp2040.writeUint32(UARTICR, TXINTR);
  assert.equal(rp2040.readUint32(UARTRIS) & TXINTR, TXINTR);
});

test('UART requests transfers without regard to its FIFOs', () => {
  const rp2040 = chip();
  rp2040.writeUint32(UARTDMACR, 0);
  rp2040.writeUint32(UARTCR, ENABLED);
  assert.equal(rp2040.dma.dreq[DREQ_UART0.tx], true);
  rp2040.writeUint32(UARTDMACR, 3);
  rp2040.uart[0].feedByte(1);
  assert.ok(!rp2040.dma.dreq[DREQ_UART0.rx]);
});

test('abort of a DMA channel never ends', () => {
  const CHAN_ABORT = 0x50000444;
  const rp2040 = chip();
  rp2040.writeUint32(CHAN_ABORT, 1);
  assert.equal(rp2040.readUint32(CHAN_ABORT), ALL_ONES);
});

test('flash cache has no registers', () => {
  const STREAM_CTR = 0x14000018;
  assert.equal(chip().readUint32(STREAM_CTR), ALL_ONES);
});

test('alarm comes before its time', () => {
  const ALARM0 = 0x40054010;
  const TIMERAWL = 0x40054028;
  const INTR = 0x40054034;
  const rp2040 = chip();
  rp2040.clock.tick(500);
  rp2040.writeUint32(ALARM0, 2);
  rp2040.clock.tick(1_000);
  assert.equal(rp2040.readUint32(TIMERAWL), 1);
  assert.equal(rp2040.readUint32(INTR), 1);
});

test('flash has no unique id', () => {
  const DATA = 0x18000060;
  const rp2040 = chip();
  rp2040.writeUint32(DATA, 0x4b);
  const answer = Array.from({ length: 13 }, () => rp2040.readUint32(DATA));
  assert.deepEqual(answer, Array(13).fill(0));
});

test('packet leaves without a token of the host', () => {
  const ENDPOINT_1_IN = 0x50100008;
  const BUFFER_1_IN = 0x50100088;
  const AVAILABLE = 1 << 10;
  const rp2040 = chip();
  rp2040.writeUint32(ENDPOINT_1_IN, (1 << 31) | 0x180);
  rp2040.writeUint32(BUFFER_1_IN, (1 << 15) | AVAILABLE | 3);
  assert.equal(rp2040.readUint32(BUFFER_1_IN) & AVAILABLE, 0);
});

test('SETUP packet leaves a stall', () => {
  const EP_STALL_ARM = 0x50110068;
  const rp2040 = chip();
  rp2040.writeUint32(EP_STALL_ARM, 3);
  rp2040.usbCtrl.sendSetupPacket(new Uint8Array(8));
  assert.equal(rp2040.readUint32(EP_STALL_ARM), 3);
});

test('SUSPENDED stays', () => {
  const SIE_STATUS = 0x50110050;
  const SUSPENDED = 1 << 4;
  const rp2040 = chip();
  rp2040.usbCtrl.sieStatus |= SUSPENDED;
  rp2040.writeUint32(SIE_STATUS, SUSPENDED);
  assert.equal(rp2040.readUint32(SIE_STATUS) & SUSPENDED, SUSPENDED);
});

test('abort of an endpoint ends at once', () => {
  const EP_ABORT = 0x50110060;
  const EP_ABORT_DONE = 0x50110064;
  const rp2040 = chip();
  rp2040.writeUint32(EP_ABORT, 1);
  assert.equal(rp2040.readUint32(EP_ABORT_DONE), 1);
});

test('reset erases the flash and leaves peripherals', () => {
  const rp2040 = chip();
  rp2040.flash[0] = 1;
  rp2040.writeUint32(UARTIBRD, 67);
  rp2040.reset();
  assert.equal(rp2040.flash[0], 0xff);
  assert.equal(rp2040.readUint32(UARTIBRD), 67);
});

test('device learns of no frame, and of no line in reset', () => {
  const USB = 0x50110000;
  const SIE_STATUS = USB + 0x50;
  const USBPHY_DIRECT = USB + 0x7c;
  const INTR = USB + 0x8c;
  const LINE_STATE = 3 << 2;
  const BUS_RESET = 1 << 19;
  const DEV_SOF = 1 << 17;
  const rp2040 = chip();
  const { usbCtrl } = rp2040;
  usbCtrl.sieStatus |= BUS_RESET;
  usbCtrl.sieStatusUpdated();
  rp2040.writeUint32(SIE_STATUS, BUS_RESET);
  assert.notEqual(rp2040.readUint32(SIE_STATUS) & LINE_STATE, 0);
  assert.equal(rp2040.readUint32(USBPHY_DIRECT), ALL_ONES);
  rp2040.clock.tick(2_000_000);
  assert.equal(rp2040.readUint32(INTR) & DEV_SOF, 0);
});
