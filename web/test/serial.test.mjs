// The page with an adapter on WebSerial: the shipped image on the virtual board, with a pty as the serial port.
//
// Chromium finds ports by their names in /sys/class/tty, so the pty is mounted over one of them. This test runs in its own
// mount namespace, and fails with the reason if mounting is refused.
import assert from 'node:assert/strict';
import { execFileSync, spawn } from 'node:child_process';
import { once } from 'node:events';
import fs from 'node:fs';
import os from 'node:os';
import path from 'node:path';
import readline from 'node:readline';
import { after, before, test } from 'node:test';
import { setTimeout } from 'node:timers/promises';
import { chromium } from 'playwright-core';
import { ARGUMENTS, EXECUTABLE, counter, open, poll, position, ready, text } from './browser.mjs';
import { serve } from './server.mjs';

const { ARMWIRE_PAGE, ARMWIRE_DEMO, ARMWIRE_IMAGE, ARMWIRE_COMMAND } = process.env;
const PORT = '/dev/ttyS0';
const POLICIES = '/etc/chromium/policies';
// Bytes of a move, and of any other request of the page.
const MOVE = 34;
const OTHER = 7;

const folder = fs.mkdtempSync(path.join(os.tmpdir(), 'armwire-web-'));
const arm = path.join(folder, 'arm');
const control = `control:${path.join(folder, 'control')}`;
let board;
let server;

function mount(...words) {
  try {
    execFileSync('mount', words, { stdio: ['ignore', 'ignore', 'pipe'] });
  } catch (error) {
    throw new Error(`WebSerial cannot be tested: \`mount ${words.join(' ')}\` is refused: ${error.stderr}`);
  }
}

const armwire = (...words) => execFileSync(ARMWIRE_COMMAND, words, { encoding: 'utf8' });

// Starts a board and mounts its pty over the port.
async function start() {
  board = spawn(ARMWIRE_DEMO, ['--image', ARMWIRE_IMAGE, '--serve', arm, '--control', control.slice('control:'.length)], {
    stdio: ['ignore', 'pipe', 'inherit'],
  });
  const lines = readline.createInterface({ input: board.stdout })[Symbol.asyncIterator]();
  assert.ok(!(await lines.next()).done, 'the virtual board does not start');
  mount('--bind', fs.realpathSync(arm), PORT);
}

async function stop() {
  // The browser may have the port open.
  execFileSync('umount', ['--lazy', PORT]);
  board.kill('SIGINT');
  await once(board, 'exit');
}

before(async () => {
  server = await serve(ARMWIRE_PAGE);
  fs.mkdirSync(POLICIES, { recursive: true });
  mount('-t', 'tmpfs', 'tmpfs', POLICIES);
  fs.mkdirSync(path.join(POLICIES, 'managed'));
  const policy = { SerialAllowAllPortsForUrls: [new URL(server.address).origin] };
  fs.writeFileSync(path.join(POLICIES, 'managed', 'serial.json'), JSON.stringify(policy));
});

after(async () => {
  await server?.close();
  fs.rmSync(folder, { recursive: true, force: true });
});

// The adapter runs in real time.
const until = (what, read, is) => poll(setTimeout, what, read, is);

// A test with its own board and browser, connected, with motion enabled.
function serialTest(name, act) {
  test(name, async () => {
    await start();
    const process = await chromium.launchServer({ executablePath: EXECUTABLE, args: ARGUMENTS });
    const browser = await chromium.connect(process.wsEndpoint());
    try {
      const { page, problems } = await open(browser, server.address);
      await ready(setTimeout, page);
      await page.locator('#reconnect').click();
      await until('port', () => page.evaluate(() => document.body.dataset.port), (port) => port === 'serial');
      await ready(setTimeout, page);
      await act(page, process);
      assert.deepEqual(problems, []);
    } finally {
      await process.kill();
      await stop();
    }
  });
}

async function moveOn(page) {
  await page.locator('#enable').check();
  await page.keyboard.down('KeyQ');
  await until('motion', () => position(page, 0), (value) => value > 5);
}

const counters = () => Object.fromEntries([...armwire('counters', control).matchAll(/^(\w+) +(\d+)$/gm)].map(([, name, value]) => [name, Number(value)]));

// Asserts that the adapter received whole requests only: the numbers of bytes match.
function assertWhole() {
  const { host_to_arm_bytes: bytes, requests_usb: usb, requests_adapter: own, refused_bytes: refused } = counters();
  const requests = usb + own;
  assert.ok(requests > 20 && refused === 0, `${requests} requests, ${refused} bytes refused`);
  assert.equal((bytes - OTHER * requests) % (MOVE - OTHER), 0, `${bytes} bytes are no ${requests} whole requests`);
}

// Joints and status, read by another program.
const readState = () => armwire('info', arm).split('\n').filter((line) => /^(joints|status) /.test(line));

serialTest('an adapter is identified, moved and stopped', async (page) => {
  await until('text', () => text(page, '#connection-text'), (value) => value === 'Serial port · ADFS251205123456 · v6.10');
  assert.equal(await text(page, '#block'), 'Motion is off. Enable it to move the arm.');
  await moveOn(page);
  await page.keyboard.up('KeyQ');
  await until('stop', async () => {
    const from = await position(page, 0);
    await setTimeout(400);
    return await position(page, 0) - from;
  }, (moved) => moved === 0);
  assert.equal(await counter(page, 'bytes outside of frames'), 0);
  await page.locator('#virtual').click();
  await until('text', () => text(page, '#connection-text'), (value) => value.startsWith('Virtual arm'));
  assertWhole();
});

// The angles of the joints in a state, in degrees, and the noise of the readings of an arm at rest.
const angles = ([joints]) => [...joints.matchAll(/[-+]\d+\.\d+/g)].map(([angle]) => Number(angle));
const REST = 0.3;

serialTest('a tab closed in motion leaves whole frames and an arm at rest', async (page) => {
  armwire('config', control, 'set', 'host-timeout.torque-off=on');
  await moveOn(page);
  await page.close();
  const before = await until('rest', async () => {
    const [from, to] = [readState(), readState()];
    return [from, to];
  }, ([from, to]) => from[1] === to[1] && angles(from).every((angle, joint) => Math.abs(angle - angles(to)[joint]) < REST));
  assert.ok(angles(before[0]).some((angle) => Math.abs(angle) > 2), before[0][0]);
  assertWhole();
});

serialTest('a browser killed in motion is a silent host, and the torque goes off', async (page, process) => {
  armwire('config', control, 'set', 'host-timeout.torque-off=on');
  await moveOn(page);
  await process.kill();
  await until('silence', () => counters().host_silences, (silences) => silences === 1);
  assertWhole();
  assert.match(readState()[1], /^status +idle$/);
});

// The test sends the event of a device that is plugged in. The port has the same object as before.
serialTest('a lost port is opened when it is back, and no move is sent before motion is enabled', async (page) => {
  await moveOn(page);
  await stop();
  await until('notice', () => text(page, '#notice-text'), (value) => value.startsWith('The port is closed, and is opened when it is back: '));
  await start();
  await page.evaluate(async () => {
    const [port] = await navigator.serial.getPorts();
    port.dispatchEvent(new Event('connect', { bubbles: true }));
  });
  await until('notice', () => text(page, '#notice-text'), (value) => value === 'The port is back. Motion is off until you enable it.');
  await until('text', () => text(page, '#connection-text'), (value) => value === 'Serial port · ADFS251205123456 · v6.10');
  await setTimeout(1000);
  const { host_to_arm_bytes: bytes, requests_usb: usb, requests_adapter: own } = counters();
  assert.ok(usb > 20);
  assert.equal(bytes, OTHER * (usb + own));
  await page.keyboard.up('KeyQ');
  await moveOn(page);
});
