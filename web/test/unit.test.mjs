// Tests of the engine and of the modules that need no browser.
import assert from 'node:assert/strict';
import fs from 'node:fs';
import path from 'node:path';
import { test } from 'node:test';
import { pathToFileURL } from 'node:url';
import { crc32 } from 'node:zlib';

const folder = process.env.ARMWIRE_PAGE;
const load = (name) => import(pathToFileURL(path.join(folder, name)));
const { CABLES, FAULTS, percent, rateAt, rates, UNPLUGGED_RATES } = await load('cable.js');
const { Engine, AXES } = await load('engine.js');
const { FrameLog, hex, keyOf } = await load('frames.js');
const { Holds, KEYS } = await load('holds.js');
const { distanceToSee, forward, identity, lookAt, multiply, perspective, place, pose, rotation } = await load('kinematics.js');
const { motionText } = await load('motion_text.js');
const { History, range } = await load('plots.js');

const near = (a, b) => assert.ok(a.length === b.length && a.every((value, i) => Math.abs(value - b[i]) < 1e-9), `${a} is not ${b}`);
const engine = () => Engine.load(fs.readFileSync(path.join(folder, 'armwire.wasm')));

// Runs the session and the virtual arm of an engine against each other, in virtual time.
class Bench {
  constructor(engine) {
    this.engine = engine;
    this.now = 0;
    // Poses are exact.
    engine.startVirtual(1, 'ideal');
    engine.startSession(0);
  }

  run(millis) {
    for (let i = 0; i < millis; i++) {
      this.now += 1000;
      const bytes = this.engine.virtualTransmit(this.now);
      if (bytes.length > 0) this.engine.receive(this.now, bytes);
      for (let frame; (frame = this.engine.transmit(this.now)).length > 0; ) this.engine.virtualReceive(this.now, frame);
    }
  }

  records() {
    const records = [];
    for (let record; (record = this.engine.takeRecord()); ) records.push(record);
    return records;
  }
}

test('a session reads the identity and position of the virtual arm', async () => {
  const bench = new Bench(await engine());
  assert.ok(bench.engine.positions().every(Number.isNaN));
  assert.equal(bench.engine.serial(), '');
  bench.run(1000);
  assert.equal(bench.engine.state(), 'answering');
  assert.equal(bench.engine.serial(), 'ADFS251205123456');
  assert.equal(bench.engine.firmware(), 'v6.10');
  assert.equal(bench.engine.status(), 'locked');
  assert.deepEqual(bench.engine.positions(), [0, 0, 0, 0, 0, 0, 0]);
  assert.deepEqual(bench.engine.temperatures(), new Array(10).fill(25));
  assert.equal(bench.engine.stroke(), 50);
  assert.equal(bench.engine.selfCheck(), 0x3ff);
});

// The answer with the joints, all at these ticks, and this status.
const joints = (ticks, status) => {
  const body = Buffer.alloc(18);
  body.set([0x06, 0x00, 15]);
  for (let joint = 0; joint < 6; joint++) body.writeUInt16LE(ticks, 3 + 2 * joint);
  body.writeUInt16LE(500, 15);
  body[17] = status;
  return Uint8Array.from([0xaa, ...body, crc32(body) & 0xff, 0xff]);
};

test('rows of readings have their verdicts', async () => {
  const rows = fs.readFileSync(new URL('../../protocol/tests/effects.txt', import.meta.url), 'utf8');
  const isTorque = (row) => row.startsWith('torque');
  for (const row of rows.split('\n').filter(isTorque)) {
    const [effect, status, ticks, change, laterStatus, laterTicks, verdict] = row.split(/ +/);
    const session = await engine();
    session.startSession(0);
    let requested = Infinity;
    for (let millis = 0; millis < 1200; millis++) {
      const now = 1000 * millis;
      if (millis === 500) session.setTorque(now, effect === 'torque-on');
      for (let frame; (frame = session.transmit(now)).length > 0; ) {
        if (frame[1] === 0x05) requested = Math.min(requested, millis);
        if (frame[1] !== 0x06 || frame[2] !== 0x00) continue;
        const hasChanged = millis - requested >= Number(change);
        session.receive(now, joints(Number(hasChanged ? laterTicks : ticks), Number.parseInt(hasChanged ? laterStatus : status, 16)));
      }
    }
    assert.equal(session.torqueState(), verdict.replace('-', ' '), row);
  }
});

test('the reason against motion is shown: another robot, an unknown status', async () => {
  const bessica = fs.readFileSync(new URL('../../protocol/tests/bessica.bin', import.meta.url));
  for (const [answer, block, text] of [
    [bessica, 'another robot', /not an Alicia-D/],
    [joints(2048, 0x42), 'unknown status', /No document explains the status/],
    [joints(2048, 0x01), null, /Hold a key/],
  ]) {
    const session = await engine();
    session.startSession(0);
    session.enableMotion(0, true);
    let [now, isRead] = [0, false];
    for (; !isRead; now += 1000) {
      for (let frame; (frame = session.transmit(now)).length > 0; ) {
        isRead = frame[1] === 0x06 && frame[2] === 0x00;
        if (isRead) session.receive(now, answer);
      }
    }
    assert.equal(session.block(now), block);
    assert.match(motionText(session.block(now), session.stopState(), session.torqueState()).text, text);
  }
});

test('a failed stop is shown before the torque', async () => {
  const bench = new Bench(await engine());
  bench.run(1000);
  const session = bench.engine;
  let { now } = bench;
  session.setTorque(now, false);
  session.stop(now + 100_000);
  // The cable is out.
  for (; now < 8_000_000; now += 1000) while (session.transmit(now).length > 0);
  assert.deepEqual([session.stopState(), session.torqueState()], ['failed', 'no reading']);
  const { text, isWarning } = motionText(null, session.stopState(), session.torqueState());
  assert.match(text, /may still move/);
  assert.ok(isWarning);
});

test('the plant of the virtual arm is a text, and a wrong one changes nothing', async () => {
  const bench = new Bench(await engine());
  assert.throws(() => bench.engine.startVirtual(1, 'sag=201'), { message: "'sag=201': expected sag=N with N from 0 to 200" });
  assert.throws(() => bench.engine.startVirtual(1, 'gremlins'), { message: /^unknown word 'gremlins': expected ideal, typical, / });
  bench.run(500);
  assert.equal(bench.engine.positions()[1], 0);
  bench.engine.startVirtual(1, 'sag=26');
  bench.run(500);
  assert.equal(Math.round(bench.engine.positions()[1] / (2 * Math.PI) * 4096), -26);
});

test('a held axis moves and a released one stops', async () => {
  const bench = new Bench(await engine());
  bench.engine.setSpeed(1);
  bench.engine.enableMotion(0, true);
  bench.run(500);
  bench.engine.hold(bench.now, 1, -1);
  bench.run(500);
  bench.engine.release(bench.now);
  bench.run(200);
  const [j1, j2] = bench.engine.positions();
  assert.equal(j1, 0);
  assert.ok(j2 < -0.45 && j2 > -0.55, `${j2} rad after half a second at 1 rad/s`);
  bench.run(500);
  assert.equal(bench.engine.positions()[1], j2);
});

test('an invalid argument is an error', async () => {
  const bench = new Bench(await engine());
  assert.throws(() => bench.engine.hold(0, AXES, 1), /axis 7 does not exist/);
  assert.throws(() => bench.engine.setSpeed(100), /out of range/);
  assert.throws(() => bench.engine.setSpeed(Number.NaN), /out of range/);
});

test('bytes beyond the size of the buffer are all counted', async () => {
  const bench = new Bench(await engine());
  bench.engine.receive(0, new Uint8Array(10_000).fill(0x55));
  const counters = bench.engine.counters();
  assert.equal(counters[bench.engine.counterLabels.indexOf('bytes from the arm')], 10_000);
  assert.equal(counters[bench.engine.counterLabels.indexOf('bytes outside of frames')], 10_000);
});

test('records have bytes, meaning and time', async () => {
  const bench = new Bench(await engine());
  bench.run(300);
  const [sent, received] = bench.records();
  assert.deepEqual([sent.event, hex(sent.bytes), sent.text], ['sent', 'AA 01 00 01 FE 23 FF', 'read information']);
  assert.equal(received.event, 'received');
  assert.match(received.text, /^arm: Ling follower, serial: ADFS251205123456,/);
  assert.ok(received.at > sent.at && sent.at >= 100_000);
});

test('a noisy cable changes counters, faults and records', async () => {
  const bench = new Bench(await engine());
  bench.engine.setFaults(rates(CABLES.noisy));
  bench.run(5000);
  const counters = Object.fromEntries(bench.engine.counterLabels.map((label, nth) => [label, bench.engine.counters()[nth]]));
  assert.ok(counters.answers > 0 && counters['unanswered requests'] > 0 && counters['bad checksums'] > 0, JSON.stringify(counters));
  assert.ok(bench.engine.faults()[1] > 0);
  assert.ok(bench.records().some(({ event, text }) => event === 'noise' && text.startsWith('checksum')));
});

test('a slow cable makes answers take longer', async () => {
  const bench = new Bench(await engine());
  bench.run(1000);
  const [, , before] = bench.engine.answerTimes();
  bench.engine.setFaults(rates(CABLES.slow));
  bench.run(5000);
  const [, , longest] = bench.engine.answerTimes();
  assert.ok(before <= 2000 && longest > 20_000, `${before} µs before, ${longest} µs with delays`);
});

test('an unplugged arm is silent', async () => {
  const bench = new Bench(await engine());
  bench.run(500);
  bench.engine.setFaults(UNPLUGGED_RATES);
  bench.run(2000);
  assert.equal(bench.engine.state(), 'silent');
  assert.equal(bench.engine.block(bench.now), 'disabled');
});

test('rates grow tenfold with each quarter of a slider', () => {
  assert.deepEqual([0, 25, 50, 75, 100].map(rateAt), [0, 100, 1000, 10_000, 100_000]);
  assert.deepEqual([0, 10, 1234, 100_000].map(percent), ['none', '0.001 %', '0.12 %', '10 %']);
  for (const places of Object.values(CABLES)) assert.deepEqual(Object.keys(places), FAULTS);
});

test('two keys in opposite directions hold no axis', () => {
  const holds = new Holds();
  const changes = [];
  holds.onchange = (...change) => changes.push(change);
  holds.press('a', 2, 1);
  holds.press('b', 2, 1);
  holds.press('c', 2, -1);
  holds.press('d', 2, -1);
  holds.release('a');
  holds.release('b');
  holds.releaseAll();
  assert.deepEqual(changes, [[2, 1], [2, 0], [2, -1], [2, 0]]);
});

test('releasing all stops every axis once', () => {
  const holds = new Holds();
  holds.press('a', 0, 1);
  holds.press('b', 6, -1);
  const changes = [];
  holds.onchange = (...change) => changes.push(change);
  holds.releaseAll();
  holds.releaseAll();
  holds.release('a');
  assert.deepEqual(changes, [[0, 0], [6, 0]]);
});

test('every axis has a key for each direction', () => {
  const held = [...KEYS.values()].map(([axis, direction]) => `${axis} ${direction}`);
  assert.equal(new Set(held).size, 2 * AXES);
});

test('a pose turns about fixed axes, roll first', () => {
  near(multiply(pose([1, 2, 3], [Math.PI / 2, 0, Math.PI / 2]), [0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]).slice(4, 7), [0, 0, 1]);
  near(place(pose([1, 2, 3], [0.1, 0.2, 0.3])), [1, 2, 3]);
  near(rotation([0, 0, 5], 0), identity());
});

test('links follow their joints, and mimics theirs', () => {
  const joint = (name, type, parent, child, at, more) => ({ name, type, parent, child, origin: pose(at, [0, 0, 0]), axis: [0, 0, 1], mimic: null, ...more });
  const model = {
    root: 'base',
    joints: [
      joint('turn', 'revolute', 'base', 'arm', [0, 0, 1]),
      joint('slide', 'prismatic', 'arm', 'hand', [2, 0, 0]),
      joint('copy', 'prismatic', 'hand', 'finger', [0, 0, 0], { mimic: { joint: 'slide', multiplier: 2, offset: 1 } }),
    ],
  };
  const links = forward(model, new Map([['turn', Math.PI / 2], ['slide', 0.5]]));
  near(place(links.get('hand')), [0, 2, 1.5]);
  near(place(links.get('finger')), [0, 2, 3.5]);
});

test('the view looks at its target', () => {
  const view = lookAt([3, 0, 0], [0, 0, 0]);
  near([view[12], view[13], view[14]], [0, 0, -3]);
});

test('each sphere is in view from the distance for all', () => {
  const target = [0.1, 0, 0.3];
  let seed = 1;
  const random = () => { seed = (seed * 48271) % 2147483647; return seed / 2147483647; };
  for (let nth = 0; nth < 200; nth++) {
    const [aspect, azimuth, elevation] = [0.3 + 3 * random(), 7 * random(), 1.6 * random() - 0.1];
    const spheres = Array.from({ length: 5 }, () => [random() - 0.5, random() - 0.5, random(), 0.2 * random()]);
    const direction = [Math.cos(elevation) * Math.cos(azimuth), Math.cos(elevation) * Math.sin(azimuth), Math.sin(elevation)];
    const distance = distanceToSee(spheres, target, direction, 0.62, aspect);
    const eye = target.map((value, i) => value + distance * direction[i]);
    const camera = multiply(perspective(0.62, aspect, 0.001, 100), lookAt(eye, target));
    // Points on each sphere, in the coordinates of the view: -1 to 1 is seen.
    for (const [x, y, z, radius] of spheres) {
      for (let i = 0; i < 50; i++) {
        const [turn, up] = [7 * random(), 2 * random() - 1];
        const across = radius * Math.sqrt(1 - up * up);
        const [a, b, , w] = multiply(camera, [x + across * Math.cos(turn), y + across * Math.sin(turn), z + radius * up, 1, ...Array(12).fill(0)]);
        assert.ok(w > 0 && Math.max(Math.abs(a), Math.abs(b)) / w <= 1 + 1e-9, `sphere ${[x, y, z, radius]} from ${eye}`);
      }
    }
  }
});

test('a range has its minimum span and stays within its limits', () => {
  assert.deepEqual(range([], 10, [-100, 100]), [-5, 5]);
  assert.deepEqual(range([[0, 98]], 10, [-100, 100]), [93, 100]);
  const [low, high] = range([[0, 0], [1, 100]], 10, [-200, 200]);
  assert.ok(low < 0 && high > 100);
});

test('a history keeps the last seconds', () => {
  const history = new History();
  for (let i = 0; i < 10_000; i++) history.push(i / 50, i);
  assert.ok(history.samples.length >= 20 * 50 && history.samples.length < 2000);
  assert.equal(history.samples.at(-1)[1], 9999);
});

const record = (event, bytes, text) => ({ event, bytes: Uint8Array.from(bytes), text, at: 0 });

test('messages are counted by command and function, errors by kind', () => {
  const log = new FrameLog();
  for (let i = 0; i < 3; i++) log.add(record('received', [0xaa, 6, 0, 15, i], 'joints'), i / 10);
  log.add(record('sent', [0xaa, 6, 0, 1], 'read joints'), 0.5);
  log.add(record('noise', [0x12], 'checksum 0x12, expected 0x34'), 0.6);
  log.add(record('noise', [0x13], 'checksum 0x56, expected 0x78'), 0.7);
  const rows = log.byMessage(1).map(({ event, count, text }) => [event, count, text]);
  assert.deepEqual(rows, [['noise', 2, 'checksum 0x56, expected 0x78'], ['sent', 1, 'read joints'], ['received', 3, 'joints']]);
  assert.deepEqual([log.total, log.errors], [6, 2]);
  assert.deepEqual(log.inOrder().map(({ time }) => time), [0.7, 0.6, 0.5, 0.2, 0.1, 0]);
});

test('a rate covers the last seconds only', () => {
  const log = new FrameLog();
  for (let i = 0; i < 100; i++) log.add(record('sent', [0xaa, 6, 0], ''), i / 50);
  assert.equal(log.byMessage(1.98)[0].rate, 50);
  assert.equal(log.byMessage(10)[0].rate, 0);
});

test('the size of the log is limited', () => {
  const log = new FrameLog();
  for (let i = 0; i < 5000; i++) log.add(record('sent', [0xaa, 6, 0], ''), i);
  assert.ok(log.rows.length <= 400);
  assert.equal(log.inOrder()[0].time, 4999);
  assert.equal(keyOf(record('noise', [], 'line went idle with 3 bytes missing')), keyOf(record('noise', [], 'line went idle with 9 bytes missing')));
});
