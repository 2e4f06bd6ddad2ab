// The pins that the adapter's image uses, on an emulated Pico: `cargo xtask pico`.
import assert from 'node:assert/strict';
import fs from 'node:fs';
import test from 'node:test';
import * as control from './control.mjs';
import { Pico } from './pico.mjs';
import { Line, Serial, enumerate } from './session.mjs';

// The UART to the arm and the LED (`boards/src/list.rs`).
const PINS = [4, 5, 25];

// Records each pin whose function or pad the program changes, also for an instant.
function watch(pico) {
  const changed = new Set();
  pico.core.rp2040.gpio.forEach((pin, number) => {
    for (const register of ['ctrl', 'padValue']) {
      let value = pin[register];
      Object.defineProperty(pin, register, {
        get: () => value,
        set: (written) => {
          if (written !== value) changed.add(number);
          value = written;
        },
      });
    }
  });
  return () => [...changed].sort((a, b) => a - b);
}

test('image takes only the pins of its board', async () => {
  const pico = new Pico(fs.readFileSync(process.env.ARMWIRE_IMAGE));
  const taken = watch(pico);
  pico.runFor(20);
  const { control: port } = enumerate(pico);
  const serial = new Serial(pico);
  const line = await Line.start(pico);
  try {
    serial.write([0xaa, 0x06, 0x00, 0x01, 0xfe, 0x9a, 0xff]);
    pico.runUntil(() => line.answers.length === 1, 100, 'the answer');
    assert.deepEqual(port.request(control.SAVE_CONFIG, 2_000), [0]);
    pico.runFor(1_000);
  } finally {
    await line.end();
  }
  assert.deepEqual(taken(), PINS);
});
