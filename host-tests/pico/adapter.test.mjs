// The adapter's image on an emulated Pico: `cargo xtask pico`.
import assert from 'node:assert/strict';
import test from 'node:test';
import * as control from './control.mjs';
import { Line, Serial, enumerate, start } from './session.mjs';

// Requests of the Ling arm: its kind and versions, and its joints.
const READ_INFO = [0xaa, 0x01, 0x00, 0x01, 0xfe, 0x23, 0xff];
const READ_JOINTS = [0xaa, 0x06, 0x00, 0x01, 0xfe, 0x9a, 0xff];
// All joints to their centres, the gripper half open; and the torque off.
const CENTRE = [0x00, 0x08, 0xe8, 0x03];
const MOVE = [0xaa, 0x06, 0x03, 0x1c, ...Array(6).fill(CENTRE).flat(), 0xf4, 0x01, 0xe8, 0x03, 0x6a, 0xff];
const TORQUE_OFF = [0xaa, 0x05, 0x00, 0x01, 0x00, 0x6f, 0xff];
const SERIAL_NUMBER = 'E6616408431A2B3C';

// Kinds of replies.
const DONE = 0;
const IDENTITY = 2;
const CONFIG = 4;
const BAD_CONFIG = 5;
// The refusal of a configuration on an adapter without CAN.
const NO_CAN = 8;

const POLL_HZ = 200;
const POLL_MICROS = 1e6 / POLL_HZ;
// The chip's time with polls.
const SECONDS = Number(process.env.ARMWIRE_POLL_SECONDS ?? 2);

// The configuration in force, in bytes.
function configOf(port) {
  const [kind, ...config] = port.request(control.GET_CONFIG);
  assert.equal(kind, CONFIG);
  return config;
}

// The configuration with another rate of polls, whose kind is the second byte, 0 for none.
function withPolls(config, hertz) {
  assert.equal(config[1], 0);
  return [config[0], 1, (hertz & 0x7f) | 0x80, hertz >> 7, ...config.slice(2)];
}

test('host enumerates the adapter by its serial number', () => {
  const { device, string } = enumerate(start());
  assert.deepEqual([...device.slice(8, 12)], [0x09, 0x12, 0x01, 0x00]);
  assert.deepEqual([1, 2, 3].map(string), ['armwire', 'armwire adapter', SERIAL_NUMBER]);
});

test('control port identifies a Pico', () => {
  const { control: port } = enumerate(start());
  const reader = new control.Reader(port.request(control.IDENTIFY));
  assert.equal(reader.byte(), IDENTITY);
  assert.ok(reader.varint() >= 6);
  const [, , board, serial] = [reader.text(), reader.text(), reader.text(), reader.text()];
  assert.deepEqual([board, serial], ['pico', SERIAL_NUMBER]);
  const [canFd, noCan] = reader.rest();
  assert.deepEqual([canFd, noCan], [0, 1]);
});

test('settings of the CAN bus are refused by name', () => {
  const { control: port } = enumerate(start());
  const config = configOf(port);
  // The third byte is the node id, behind the polls that are off; the ninth switches commands on.
  for (const place of [2, 8]) {
    const onCan = config.with(place, 1);
    assert.deepEqual(port.request(control.setConfig(onCan)), [BAD_CONFIG, NO_CAN]);
    assert.deepEqual(configOf(port), config);
  }
  const polled = withPolls(config, POLL_HZ);
  assert.deepEqual(port.request(control.setConfig(polled)), [DONE]);
});

test('bytes between host and arm are balanced', async () => {
  const pico = start();
  enumerate(pico);
  const serial = new Serial(pico);
  const line = await Line.start(pico);
  let expected = 0;
  try {
    for (let n = 0; n < 100; n++) {
      // Pieces of every length, also across the requests.
      const requests = [...READ_INFO, ...READ_JOINTS, ...READ_INFO];
      const cut = n % requests.length;
      serial.write(requests.slice(0, cut));
      serial.write(requests.slice(cut));
      expected += 3;
      pico.runUntil(() => line.answers.length === expected, 100, `answer ${expected}`);
    }
    pico.runFor(2);
  } finally {
    const counts = await line.end();
    assert.equal(counts.received, serial.sent, 'bytes that the host sent and the arm received');
    assert.equal(counts.sent, serial.received.length, 'bytes that the arm sent and the host received');
  }
});

test('polls start at their slots and answers are stamped', async () => {
  const pico = start();
  const { control: port } = enumerate(pico);
  const line = await Line.start(pico);
  try {
    assert.deepEqual(port.request(control.SUBSCRIBE_FRAMES), [DONE]);
    const config = withPolls(configOf(port), POLL_HZ);
    assert.deepEqual(port.request(control.setConfig(config)), [DONE]);
    pico.runFor(1_000 * SECONDS);
    const { requests, answers } = line;
    const { frames } = port;
    assert.ok(requests.length >= SECONDS * POLL_HZ - 10, `${requests.length} polls`);
    const intervals = requests.slice(1).map((at, n) => at - requests[n]);
    const off = intervals.reduce((most, interval) => Math.max(most, Math.abs(interval - POLL_MICROS)), 0);
    assert.ok(off <= 2, `an interval of polls is ${off} µs off`);
    assert.ok(answers.length - frames.length <= 1, `${answers.length} answers, ${frames.length} frames`);
    const errors = frames.map(({ at }, n) => Math.abs(at - answers[n])).sort((a, b) => a - b);
    const worst = errors[Math.floor(0.999 * (errors.length - 1))];
    assert.ok(worst <= 2, `99.9 % of stamps are within ${worst} µs`);
    console.log(`${requests.length} polls, at most ${off.toFixed(1)} µs off; 99.9 % of stamps within ${worst.toFixed(1)} µs`);
  } finally {
    await line.end();
  }
});

test('silent host ends with torque off', () => {
  const pico = start();
  const { control: port } = enumerate(pico);
  // The last byte of the configuration: switch the torque off.
  port.request(control.setConfig([...configOf(port).slice(0, -1), 1]));
  const serial = new Serial(pico);
  const sent = [];
  pico.arm.onByte = (byte) => sent.push(byte);
  for (let n = 0; n < 20; n++) {
    serial.write(MOVE);
    pico.runFor(20);
  }
  assert.equal(sent.length, serial.sent);
  pico.runFor(1_500);
  assert.deepEqual(sent.slice(serial.sent), TORQUE_OFF);
});

test('saved configuration survives a power cut', () => {
  const pico = start();
  const { control: port } = enumerate(pico);
  const config = withPolls(configOf(port), POLL_HZ);
  port.request(control.setConfig(config));
  assert.deepEqual(port.request(control.SAVE_CONFIG, 2_000), [DONE]);
  const next = pico.restarted({ keepsRam: false });
  next.runFor(20);
  assert.deepEqual(configOf(enumerate(next).control), config);
});

test('power cut during a save keeps one of both', () => {
  for (let operations = 0; ; operations++) {
    const pico = start();
    const { control: port } = enumerate(pico);
    const old = configOf(port);
    const config = withPolls(old, POLL_HZ);
    port.request(control.setConfig(config));
    let left = operations;
    pico.beforeFlash = () => {
      if (left === 0) throw new PowerCut();
      left -= 1;
    };
    let isCut = false;
    try {
      port.request(control.SAVE_CONFIG, 2_000);
    } catch (error) {
      if (!(error instanceof PowerCut)) throw error;
      isCut = true;
    }
    const next = pico.restarted({ keepsRam: false });
    next.runFor(20);
    const found = configOf(enumerate(next).control);
    const expected = isCut ? [old, config] : [config];
    assert.ok(expected.some((one) => one.join() === found.join()), `after ${operations} operations: ${found}`);
    if (!isCut) {
      assert.ok(operations > 1, `a save takes ${operations} operations`);
      return;
    }
  }
});

class PowerCut extends Error {}

test('host abandons requests and begins others', () => {
  const pico = start();
  const { config, control: port } = enumerate(pico);
  const { usb } = pico;
  for (let n = 0; n < 10; n++) {
    // After the SETUP packet, after a packet of the answer, and before the data of the host.
    usb.abandon(0x80, 6, 0x200, 0, 255, n);
    usb.abandon(0x21, 0x20, 0, 0, 7, n);
    assert.deepEqual(usb.requestIn(0x80, 6, 0x200, 0, 255), config);
  }
  port.request(control.IDENTIFY);
});

test('host clears a halt and repeats the configuration', () => {
  const pico = start();
  const { control: port } = enumerate(pico);
  const { usb } = pico;
  for (let n = 0; n < 4; n++) {
    port.request(control.IDENTIFY);
    for (const address of [0x83, 0x02]) assert.ok(usb.clearHalt(address));
    port.request(control.IDENTIFY);
    port.request(control.IDENTIFY);
    assert.ok(usb.setConfiguration());
  }
});

test('host restarts the adapter', () => {
  const pico = start();
  const { control: port } = enumerate(pico);
  assert.deepEqual(port.request(control.RESTART), [DONE]);
  pico.runUntil(() => pico.resets.length > 0, 500, 'the reset');
  assert.deepEqual(pico.resets, ['request']);
  const next = pico.restarted();
  next.runFor(20);
  enumerate(next);
});

test('host starts the boot loader', () => {
  const pico = start();
  const { control: port } = enumerate(pico);
  assert.deepEqual(port.request(control.RESTART_INTO_BOOT_LOADER), [DONE]);
  pico.runUntil(() => pico.resets.length > 0, 500, 'the reset');
  const next = pico.restarted();
  next.runFor(20);
  assert.deepEqual(next.resets, ['boot loader']);
});

test('watchdog restarts a chip that hangs', () => {
  const pico = start();
  enumerate(pico);
  // An endless loop in place of the next instruction.
  const hang = 0x20003000;
  pico.core.rp2040.writeUint32(hang, 0xe7fee7fe);
  pico.core.PC = hang;
  pico.core.PM = true;
  pico.runUntil(() => pico.resets.length > 0, 3_000, 'the reset');
  assert.deepEqual(pico.resets, ['timeout']);
  const next = pico.restarted();
  next.runFor(20);
  enumerate(next);
});
