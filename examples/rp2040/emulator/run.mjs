// Runs the RP2040 example against a virtual arm: node run.mjs ARMWIRE ELF
//
// ARMWIRE is the armwire command, ELF the example's image. The arm is identified, moved, followed, unplugged and plugged in
// again. At the end each side must have received all bytes of the other.
import assert from 'node:assert/strict';
import fs from 'node:fs';
import os from 'node:os';
import path from 'node:path';
import { setTimeout as sleep } from 'node:timers/promises';
import { Arm } from './arm.mjs';
import { Chip } from './chip.mjs';

const [armwire, elf] = process.argv.slice(2);
const SLICE_NANOS = 200_000;
// The chip's clock runs at a quarter of real time or slower: on a busy machine the arm's answers are still in time.
const PACE = 4;
const UNPLUGGED_NANOS = 500_000_000;
const TIMEOUT_MS = 60_000;

// Expected log lines, in this order. Joint positions may appear between `moving` and `arrived`.
const EXPECTED = [
  /^waiting for an arm$/,
  /^arm ADFS251205123456, firmware v6\.10$/,
  /^joints \[2048, 2048, 2048, 2048, 2048, 2048\] gripper 0 /,
  /^moving$/,
  /^arrived$/,
  /^moving$/,
  /^arrived$/,
  /^joints .* gripper 0 /, // the arm is unplugged here
  /^arm lost: the arm did not answer in 3 attempts$/,
  /^waiting for an arm$/,
  /^arm ADFS251205123456, firmware v6\.10$/,
  /^joints .* gripper 0 /,
];
const UNPLUG_AFTER = 8;
const WRIST_GOAL = 2048 + 341;

const folder = fs.mkdtempSync(path.join(os.tmpdir(), 'armwire-rp2040-'));
const arm = await Arm.start(armwire, path.join(folder, 'arm'));
try {
  await play(new Chip(fs.readFileSync(elf)), arm);
} finally {
  arm.process.kill();
  fs.rmSync(folder, { recursive: true });
}

async function play(chip, arm) {
  const [log, line] = chip.uarts;
  let plugged = true;
  let plugAt = Infinity;
  let dropped = 0;
  let toArm = [];
  line.onByte = (byte) => {
    if (plugged) toArm.push(byte);
    else dropped += 1;
  };

  // The number of expected lines that were logged, the text of the next line, and the positions of a motion.
  let logged = 0;
  let text = '';
  let path = [];
  log.onByte = (byte) => {
    if (byte !== 10) {
      text += String.fromCharCode(byte);
      return;
    }
    const entry = text.trimEnd();
    text = '';
    console.log(`${(chip.clock.nanos / 1e6).toFixed(3).padStart(10)} ms  ${entry}`);
    if (EXPECTED[logged - 1]?.source === '^moving$' && entry.startsWith('joints')) {
      path.push(entry);
      return;
    }
    assert.match(entry, EXPECTED[logged]);
    logged += 1;
    if (entry === 'arrived') {
      checkPath(path, logged === 5 ? 500 : 0);
      path = [];
    }
    if (logged === UNPLUG_AFTER) {
      // The answer was read, and the next request follows 20 ms later: the line is idle.
      plugged = false;
      plugAt = chip.clock.nanos + UNPLUGGED_NANOS;
    }
  };

  const start = performance.now();
  while (logged < EXPECTED.length) {
    chip.run(SLICE_NANOS);
    // Plugged in between two frames: the arm receives whole frames only.
    if (chip.clock.nanos >= plugAt && !line.isSending) plugged = true;
    // A frame is written at once: a pause would count as an idle line.
    if (toArm.length > 0 && !line.isSending) {
      arm.write(Buffer.from(toArm));
      toArm = [];
    }
    line.send(arm.read());
    const elapsed = performance.now() - start;
    assert.ok(elapsed < TIMEOUT_MS, `no log line after "${EXPECTED[logged - 1]}"`);
    await sleep(Math.max(0, (chip.clock.nanos / 1e6) * PACE - elapsed));
  }

  const counts = await arm.end();
  assert.ok(line.isRead && toArm.length === 0 && dropped > 0);
  assert.equal(counts.received, line.sent - dropped, 'bytes that the chip sent and the arm received');
  assert.equal(counts.sent, line.read, 'bytes that the arm sent and the chip received');
  console.log(`chip to arm ${counts.received} bytes, ${dropped} more while unplugged; arm to chip ${counts.sent} bytes`);
  console.log('1 passed, 0 failed');
}

// Checks the logged positions of a motion: the wrist never turns back, and wrist and gripper reach their goals.
function checkPath(path, opening) {
  const states = path.map((entry) => entry.match(/\d+/g).map(Number));
  const wrists = states.map(([, , , , , wrist]) => wrist);
  assert.ok(wrists.every((wrist, n) => n === 0 || wrist >= wrists[n - 1]), `the wrist turns back: ${wrists}`);
  const [, , , , , wrist, gripper] = states.at(-1);
  assert.ok(Math.abs(wrist - WRIST_GOAL) <= 3, `the wrist is at ${wrist}`);
  assert.ok(Math.abs(gripper - opening) <= 10, `the gripper is at ${gripper}`);
  assert.ok(path.length > 2, 'the motion has no intermediate positions');
}
