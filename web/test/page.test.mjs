// The page with its virtual arm, in headless Chromium.
import assert from 'node:assert/strict';
import fs from 'node:fs';
import path from 'node:path';
import { after, before, test } from 'node:test';
import { crc32 } from 'node:zlib';
import { counter, launch, open, poll, position, ready, state, text } from './browser.mjs';
import { fakeSerial } from './fake_serial.mjs';
import { serve } from './server.mjs';

const folder = process.env.ARMWIRE_PAGE;
const screenshots = process.env.ARMWIRE_SCREENSHOTS;
const SIZES = [[1280, 800], [768, 1024], [390, 844]];
// Widths of telephones, tablets and computers, and those at which the layout changes.
const WIDTHS = [320, 360, 390, 400, 401, 480, 620, 621, 768, 999, 1000, 1280];
// Time in which a stop takes effect and the page shows it, in milliseconds.
const REST = 400;

let browser;
let server;

before(async () => {
  server = await serve(folder);
  browser = await launch();
});

after(async () => {
  await browser?.close();
  await server?.close();
});

// Lets time pass on the page. Its clock stands otherwise, so that no result depends on the speed of this machine.
const waitOn = (page) => (milliseconds) => page.clock.runFor(milliseconds);

const rest = (page) => waitOn(page)(REST);

const until = (page, what, read, is) => poll(waitOn(page), what, read, is);

// A test that fails for any error of the page.
function pageTest(name, act, options = {}) {
  test(name, async () => {
    const { context, page, problems } = await open(browser, server.address, { stopClock: true, ...options });
    await ready(waitOn(page), page);
    await act(page, context);
    assert.deepEqual(problems, []);
    await context.close();
  });
}

// Asserts that the arm has stopped.
async function assertStill(page, axis) {
  await rest(page);
  const at = await position(page, axis);
  await rest(page);
  // A reading has a noise of a tick.
  const later = await position(page, axis);
  assert.ok(Math.abs(later - at) < 0.3, `the arm still moves: ${at} to ${later}`);
}

const moves = (page, axis, from) => until(page, 'motion', () => position(page, axis), (value) => Math.abs(value - from) > 3);

pageTest('the virtual arm is connected at the start', async (page) => {
  assert.match(await text(page, '#connection-text'), /^Virtual arm · ADFS251205123456 · v6\.10$/);
  await until(page, 'servos', () => text(page, '#servos'), (value) => value === 'all normal');
  await until(page, 'status', () => text(page, '#status'), (value) => value === 'locked');
  assert.equal(await position(page, 0), 0);
});

pageTest('a key moves the arm while it is down', async (page) => {
  await page.keyboard.down('KeyQ');
  await moves(page, 0, 0);
  assert.ok(await page.locator('.jog[data-axis="0"][data-direction="1"]').evaluate((button) => button.classList.contains('held')));
  await page.keyboard.up('KeyQ');
  await assertStill(page, 0);
  assert.ok(await position(page, 0) > 3);
  assert.equal(await position(page, 1), 0);
});

pageTest('the other row of keys moves the other way', async (page) => {
  await page.keyboard.down('KeyS');
  await until(page, 'motion', () => position(page, 1), (value) => value < -3);
  await page.keyboard.up('KeyS');
  await assertStill(page, 1);
});

pageTest('a button moves the arm while it is pressed', async (page) => {
  await page.locator('.jog[data-axis="6"][data-direction="1"]').hover();
  await page.mouse.down();
  await moves(page, 6, 0);
  await page.mouse.up();
  await assertStill(page, 6);
});

pageTest('a button moves the arm while Space is down on it', async (page) => {
  await page.locator('.jog[data-axis="3"][data-direction="-1"]').focus();
  await page.keyboard.down('Space');
  await moves(page, 3, 0);
  await page.keyboard.up('Space');
  await assertStill(page, 3);
});

pageTest('a touch moves the arm while it lasts', async (page, context) => {
  const button = page.locator('.jog[data-axis="2"][data-direction="1"]');
  await button.scrollIntoViewIfNeeded();
  const { x, y } = await button.boundingBox();
  const touch = await context.newCDPSession(page);
  await touch.send('Input.dispatchTouchEvent', { type: 'touchStart', touchPoints: [{ x: x + 20, y: y + 15 }] });
  await moves(page, 2, 0);
  await touch.send('Input.dispatchTouchEvent', { type: 'touchEnd', touchPoints: [] });
  await assertStill(page, 2);
}, { viewport: { width: 390, height: 844 }, hasTouch: true });

const STOPS = {
  'Escape': (page) => page.keyboard.press('Escape'),
  'a modifier': (page) => page.keyboard.down('Control'),
  'losing the focus': (page) => page.evaluate(() => dispatchEvent(new Event('blur'))),
  'hiding the page': (page) => page.evaluate(() => document.dispatchEvent(new Event('visibilitychange'))),
  'switching motion off': (page) => page.locator('#enable').uncheck(),
  'the help': (page) => page.locator('#help').click(),
};
for (const [what, stop] of Object.entries(STOPS)) {
  pageTest(`${what} stops a held axis`, async (page) => {
    await page.keyboard.down('KeyW');
    await moves(page, 1, 0);
    await stop(page);
    await assertStill(page, 1);
  });
}

pageTest('the stop button keeps the torque and says how the arm stopped', async (page) => {
  await page.locator('#stop').click();
  await until(page, 'stop', () => text(page, '#block'), (value) => value.startsWith('Stopped. The gripper holds its reading'));
  assert.equal(await text(page, '#status'), 'locked');
  await page.keyboard.down('KeyW');
  await moves(page, 1, 0);
  await page.keyboard.press('Escape');
  await assertStill(page, 1);
  await until(page, 'stop', () => text(page, '#block'), (value) => value === 'Stopped. Hold a key or button to move.');
}, { plant: 'typical' });

pageTest('nothing moves while motion is off', async (page) => {
  await page.locator('#enable').uncheck();
  await page.keyboard.down('KeyE');
  await rest(page);
  assert.equal(await position(page, 2), 0);
  assert.equal(await text(page, '#block'), 'Motion is off. Enable it to move the arm.');
});

pageTest('torque goes off only after a long press', async (page) => {
  await page.locator('#torque-off').click();
  await rest(page);
  assert.equal(await text(page, '#status'), 'locked');
  await page.locator('#torque-off').hover();
  await page.mouse.down();
  await until(page, 'status', () => text(page, '#status'), (value) => value === 'idle');
  await page.mouse.up();
  await page.keyboard.down('KeyE');
  await rest(page);
  assert.equal(await text(page, '#block'), 'Torque is off: the arm does not move.');
  await page.keyboard.up('KeyE');
  await page.locator('#torque-on').click();
  await until(page, 'status', () => text(page, '#status'), (value) => value === 'locked');
});

pageTest('a noisy cable causes errors, and a good one none', async (page) => {
  await page.locator('[name=cable][value=noisy]').check({ force: true });
  await until(page, 'bad checksums', () => counter(page, 'bad checksums'), (value) => value > 0);
  await until(page, 'rows', () => page.locator('#frame-rows tr.error').count(), (value) => value > 0);
  assert.match(await text(page, '#frame-rows tr.error .meaning >> nth=0'), /checksum|frame|end mark|length|idle|answer/);
  assert.equal(await page.locator('#counters .bad').filter({ hasText: 'bad checksums' }).count(), 1);
  const faults = async () => Number(await text(page, '#fault-corrupt-count'));
  await until(page, 'faults', faults, (value) => value > 0);
  await page.locator('[name=cable][value=good]').check({ force: true });
  await rest(page);
  const bad = await counter(page, 'bad checksums');
  await rest(page);
  assert.equal(await counter(page, 'bad checksums'), bad);
});

pageTest('a slider sets a rate and deselects the cable', async (page) => {
  const slider = page.locator('#fault-drop');
  await slider.focus();
  await page.keyboard.press('End');
  assert.equal(await text(page, '[for=fault-drop] >> nth=1'), '10 %');
  assert.equal(await slider.getAttribute('aria-valuetext'), '10 % of the bytes');
  assert.equal(await page.locator('[name=cable]:checked').count(), 0);
  await until(page, 'unanswered', () => counter(page, 'unanswered requests'), (value) => value > 0);
});

pageTest('an unplugged arm is silent and answers after reconnection', async (page) => {
  await page.locator('[name=cable][value=unplugged]').check({ force: true });
  await until(page, 'state', () => state(page), (value) => value === 'silent');
  await until(page, 'text', () => text(page, '#connection-text'), (value) => value === 'Virtual arm · no answer');
  assert.equal(await text(page, '#block'), 'No fresh reading: the arm does not move.');
  await page.locator('[name=cable][value=good]').check({ force: true });
  await ready(waitOn(page), page);
});

const LOST = 'The port is closed, and is opened when it is back: The device has been lost.';
const BACK = 'The port is back. Motion is off until you enable it.';
const UNKNOWN_ARM = 'Motion stays off until the arm has told its serial number: it may be another arm.';
const OTHER = 'Another arm is on this port: ADFS251205654321, before ADFS251205123456. Motion is off until you enable it.';

const kinds = (page) => page.evaluate(() => window.fakeSerial.kinds());
const isOpen = (page) => page.evaluate(() => window.fakeSerial.isOpen());
const plugIn = (page, device = {}) => page.evaluate((device) => window.fakeSerial.plugIn(device), device);
const isVirtual = (connection) => connection.startsWith('Virtual arm · ADFS');
const connection = (page, is) => until(page, 'connection', () => text(page, '#connection-text'), is);
const notice = (page, is) => until(page, 'notice', () => page.locator('#notice-text').textContent(), (value) => value === is);

// A test that begins when the port of a moving arm is lost. `reads` are the kinds of frames before the motion.
function lossTest(name, act) {
  pageTest(name, async (page) => {
    await page.locator('#reconnect').click();
    await connection(page, (value) => value === 'USB 1209:0001 · ADFS251205123456 · v6.10');
    await rest(page);
    const reads = await kinds(page);
    await page.locator('#enable').check();
    await page.keyboard.down('KeyQ');
    await moves(page, 0, 0);
    assert.ok((await kinds(page)).length > reads.length);
    await page.evaluate(() => window.fakeSerial.unplug());
    await notice(page, LOST);
    assert.equal(await page.locator('.jog.held').count(), 0);
    await act(page, reads);
  }, { script: fakeSerial });
}

lossTest('a lost port is opened when it is back, and only reads are sent before a motion', async (page, reads) => {
  await plugIn(page);
  await notice(page, BACK);
  await connection(page, (value) => value === 'USB 1209:0001 · ADFS251205123456 · v6.10');
  assert.ok(!(await page.locator('#enable').isChecked()));
  await assertStill(page, 0);
  await page.locator('#enable').check();
  await assertStill(page, 0);
  assert.deepEqual(await kinds(page), reads);
  await page.keyboard.up('KeyQ');
  await page.keyboard.down('KeyQ');
  await moves(page, 0, 0);
});

lossTest('motion stays off until the arm of a lost port is known', async (page) => {
  await plugIn(page, { info: [] });
  await notice(page, BACK);
  await page.locator('#enable').click();
  await notice(page, UNKNOWN_ARM);
  assert.ok(!(await page.locator('#enable').isChecked()));
  await page.keyboard.up('KeyQ');
  await page.keyboard.down('KeyQ');
  await assertStill(page, 0);
});
lossTest('another arm on a port that is back is named', async (page, reads) => {
  const body = [0x01, 0x00, 24, ...Buffer.from('ADFS251205654321'), 0, 0, 0, 0, 0, 0, 0, 0];
  await plugIn(page, { info: [0xaa, ...body, crc32(Uint8Array.from(body)) & 0xff, 0xff] });
  await notice(page, OTHER);
  await rest(page);
  assert.ok(!(await page.locator('#enable').isChecked()));
  assert.deepEqual(await kinds(page), reads);
});

lossTest('a port with other USB ids is not the lost one', async (page) => {
  await plugIn(page, { product: 2 });
  await rest(page);
  assert.equal(await text(page, '#notice-text'), LOST);
  assert.ok(!(await isOpen(page)));
});

lossTest('a connection elsewhere ends the wait for a lost port', async (page) => {
  await page.locator('#virtual').click();
  await connection(page, isVirtual);
  await plugIn(page);
  await rest(page);
  assert.ok(isVirtual(await text(page, '#connection-text')));
  assert.ok(!(await isOpen(page)));
});

lossTest('a connection elsewhere while a lost port is opened closes the port', async (page) => {
  await page.evaluate(() => {
    window.fakeSerial.plugIn();
    document.getElementById('virtual').click();
  });
  await connection(page, isVirtual);
  await rest(page);
  assert.ok(!(await isOpen(page)));
});

lossTest('a port that is back but busy is offered again', async (page) => {
  await plugIn(page, { isBusy: true });
  await notice(page, 'Failed to open serial port.');
  await connection(page, isVirtual);
  assert.ok(await page.locator('#reconnect').isVisible());
});

pageTest('frames have a meaning, by message and in order', async (page) => {
  const frame = 'AA 06 00 01 FE 9A FF';
  for (const meaning of ['self-check', 'read joints', 'joints: +0.00° +0.00°', 'stroke: 50 mm', frame]) {
    await until(page, `row with ${meaning}`, () => text(page, '#frame-rows'), (rows) => rows.includes(meaning));
  }
  await page.locator('[name=rows][value=order]').check({ force: true });
  await until(page, 'rows', () => page.locator('#frame-rows tr').count(), (count) => count > 40);
  assert.match(await text(page, '#frame-rows .when >> nth=0'), /^\d+\.\d{3}$/);
  await page.locator('#pause').click();
  const paused = await page.locator('#frame-rows').innerText();
  await rest(page);
  assert.equal(await page.locator('#frame-rows').innerText(), paused);
});

const urdf = (body) => ({ name: 'robot.urdf', mimeType: 'application/xml', buffer: Buffer.from(body) });

pageTest('a URDF replaces the drawing, and its names are escaped', async (page) => {
  const name = '&lt;img src=x onerror=alert(1)&gt;';
  await page.locator('#urdf').setInputFiles(urdf(`<robot name="${name}">
    <link name="a"><visual><geometry><mesh filename="package://a.stl"/></geometry></visual></link>
    <link name="b"><visual><geometry><box size="0.1 0.1 0.4"/></geometry></visual></link>
    <joint name="j" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0 0 0.2"/><axis xyz="0 1 0"/></joint></robot>`));
  await until(page, 'notice', () => text(page, '#notice-text'), (value) => value !== '');
  assert.equal(await text(page, '#notice-text'), 'robot.urdf: 1 of its 1 joints follow the arm. 1 meshes are not loaded: cylinders between the joints replace them.');
  assert.equal(await text(page, '#model-name'), '<img src=x onerror=alert(1)>');
  assert.equal(await page.locator('img').count(), 0);
});

// Files that two of the usual parsers load, and what the page says of each.
const arm = (joint, more = '') => `<robot name="r"><link name="a"/><link name="b"/>
  <joint name="j" type="revolute"><parent link="a"/><child link="b"/>${joint}</joint>${more}</robot>`;
const follows = (count) => `robot.urdf: ${count} of its ${count} joints follow the arm.`;
const GOOD = {
  'a fixed joint with an axis of zeros': [
    arm('<axis xyz="0 0 1"/>', '<link name="tool"/><joint name="t" type="fixed"><parent link="b"/><child link="tool"/><axis xyz="0 0 0"/></joint>'),
    follows(1),
  ],
  'a floating joint with an axis that is none': [
    arm('<axis xyz="0 0 1"/>', '<link name="c"/><joint name="f" type="floating"><parent link="b"/><child link="c"/><axis xyz=""/></joint>'),
    follows(1),
  ],
  'a moving joint with an axis of zeros': [arm('<axis xyz="0 0 0"/>'), follows(1)],
  'hyphens in a comment': [arm('<!-- ---- the base ---- -->'), follows(1)],
  'a prefix without its namespace': [arm('', '<xacro:property name="x" value="1"/><gazebo x:y="1"/>'), follows(1)],
  'a declaration behind blank lines': [`\n  <?xml version="1.0" encoding="gbk"?>${arm('')}`, follows(1)],
  'a declaration of no version': [`<?xml version="0.0" ?>${arm('')}`, follows(1)],
  'a joint to a link of another file': [
    '<robot name="r"><link name="b"/><joint name="j" type="fixed"><parent link="a"/><child link="b"/></joint></robot>',
    follows(0),
  ],
  'limits without an end': [arm('<limit lower="-inf" upper="inf" effort="1" velocity="1"/>'), follows(1)],
  'a colour of three numbers': [
    '<robot name="r"><link name="a"><visual><geometry><sphere radius="0.1"/></geometry><material name="m"><color rgba="1 0 0"/></material></visual></link></robot>',
    follows(0),
  ],
  'a link with two parents': [
    arm('', '<joint name="k" type="fixed"><parent link="a"/><child link="b"/></joint>'),
    `${follows(1)} Joints that close a loop are left out: k.`,
  ],
  'limits beyond the ticks': [
    arm('<limit lower="-3.15" upper="3.14159" effort="1" velocity="1"/>'),
    `${follows(1)} The arm ends at −180.00° and 179.91°, inside the limits of j.`,
  ],
  'more shapes than are drawn': [
    `<robot name="r"><link name="a">${'<visual><geometry><sphere radius="0.1"/></geometry></visual>'.repeat(1001)}</link></robot>`,
    `${follows(0)} 1 of its shapes is not drawn: the maximum is 1000.`,
  ],
};
pageTest('a URDF that other programs load is drawn', async (page) => {
  for (const [what, [body, notice]] of Object.entries(GOOD)) {
    await page.locator('#urdf').setInputFiles(urdf(body));
    await until(page, `notice for ${what}`, () => page.locator('#notice-text').textContent(), (value) => value === notice);
    await page.locator('#notice-close').click();
  }
});

const BAD = {
  'no <xml': 'the file is not XML',
  '<sdf/>': 'the file is not a URDF: its root is <sdf>, must be <robot>',
  '<robot/>': 'the robot has no links',
  '<robot><link/></robot>': 'a <link> has no name',
  '<robot><link name="a"/><link name="b"/></robot>': 'the robot has 2 links without a parent, must be 1',
  '<robot><link name="a"/><joint name="j" type="spin"/></robot>': 'joint j: its type is spin, must be one of revolute, continuous, prismatic, fixed, floating, planar',
  '<robot><link name="a"/><joint name="j" type="fixed"><parent link="a"/><child link="c"/></joint></robot>': 'joint j: its child c is not a link',
  '<robot><link name="a"/><link name="b"/><link name="c"/><joint name="j" type="fixed"><parent link="b"/><child link="c"/></joint><joint name="k" type="fixed"><parent link="c"/><child link="b"/></joint></robot>': 'the joints form a cycle',
  '<robot><link name="a"><visual><geometry><box size="1 2"/></geometry></visual></link></robot>': '<box size="1 2"> must be 3 numbers',
};
pageTest('an invalid URDF is an error with a reason', async (page) => {
  const before = await text(page, '#model-name');
  for (const [body, error] of Object.entries(BAD)) {
    await page.locator('#urdf').setInputFiles(urdf(body));
    await until(page, `notice for ${body}`, () => page.locator('#notice-text').textContent(), (value) => value === error);
    await page.locator('#notice-close').click();
  }
  assert.equal(await text(page, '#model-name'), before);
});

// The drawing, without the figures and buttons over it.
async function drawing(page) {
  await page.evaluate(() => {
    for (const id of ['facts', 'view-tools']) document.getElementById(id).style.opacity = 0;
  });
  return page.locator('#arm').screenshot();
}

// The share of different pixels in two drawings.
const difference = (page, drawings) => page.evaluate(async (drawings) => {
  const [before, after] = await Promise.all(drawings.map(async (drawing) => {
    const bytes = Uint8Array.from(atob(drawing), (character) => character.charCodeAt(0));
    const image = await createImageBitmap(new Blob([bytes], { type: 'image/png' }));
    const context = new OffscreenCanvas(image.width, image.height).getContext('2d');
    context.drawImage(image, 0, 0);
    return context.getImageData(0, 0, image.width, image.height).data;
  }));
  let count = 0;
  for (let i = 0; i < before.length; i += 4) {
    if ([0, 1, 2].some((colour) => Math.abs(before[i + colour] - after[i + colour]) > 16)) count += 1;
  }
  return 4 * count / before.length;
}, drawings.map((drawing) => drawing.toString('base64')));

// Drags a file over the page and drops it there.
async function drop(page, { name, mimeType, buffer }) {
  const transfer = await page.evaluateHandle(({ name, mimeType, body }) => {
    const transfer = new DataTransfer();
    transfer.items.add(new File([body], name, { type: mimeType }));
    return transfer;
  }, { name, mimeType, body: buffer.toString() });
  for (const event of ['dragenter', 'dragover']) await page.dispatchEvent('body', event, { dataTransfer: transfer });
  assert.ok(await page.locator('#drop-here').isVisible());
  await page.dispatchEvent('body', 'drop', { dataTransfer: transfer });
  assert.ok(!(await page.locator('#drop-here').isVisible()));
}

pageTest('a dropped URDF changes the shape of the arm', async (page) => {
  await rest(page);
  const before = await drawing(page);
  assert.ok(await difference(page, [before, await drawing(page)]) < 0.001, 'the drawing changes by itself');
  await drop(page, urdf(`<robot name="dropped">
    <link name="a"><visual><geometry><box size="0.3 0.3 0.1"/></geometry></visual></link>
    <link name="b"><visual><geometry><box size="0.1 0.1 0.4"/></geometry></visual></link>
    <joint name="j" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0 0 0.2"/><axis xyz="0 1 0"/></joint></robot>`));
  await until(page, 'notice', () => text(page, '#notice-text'), (value) => value !== '');
  assert.equal(await text(page, '#notice-text'), 'robot.urdf: 1 of its 1 joints follow the arm.');
  assert.equal(await text(page, '#model-name'), 'dropped');
  await page.locator('#notice-close').click();
  await rest(page);
  assert.ok(await difference(page, [before, await drawing(page)]) > 0.02, 'the drawing has not changed');
});

// The share of a drawing that is red, and of its edge.
const redness = (page, drawing) => page.evaluate(async (drawing) => {
  const bytes = Uint8Array.from(atob(drawing), (character) => character.charCodeAt(0));
  const image = await createImageBitmap(new Blob([bytes], { type: 'image/png' }));
  const context = new OffscreenCanvas(image.width, image.height).getContext('2d');
  context.drawImage(image, 0, 0);
  const { data, width, height } = context.getImageData(0, 0, image.width, image.height);
  let [all, edge] = [0, 0];
  for (let i = 0; i < width * height; i++) {
    const [red, green, blue] = data.subarray(4 * i, 4 * i + 3);
    if (red < green + 60 || red < blue + 60) continue;
    const [x, y] = [i % width, Math.floor(i / width)];
    all += 1;
    if (Math.min(x, y, width - 1 - x, height - 1 - y) < 3) edge += 1;
  }
  return { all: all / (width * height), edge };
}, drawing.toString('base64'));

for (const [width, height] of SIZES) {
  pageTest(`an arm that unfolds stays in view at ${width}x${height}`, async (page) => {
    await page.locator('#urdf').setInputFiles(urdf(`<robot name="folded">
      <material name="red"><color rgba="1 0 0 1"/></material>
      <link name="a"/><link name="b"><visual><origin xyz="0 0 0.25"/><geometry><box size="0.1 0.1 0.5"/></geometry><material name="red"/></visual></link>
      <link name="c"><visual><origin xyz="0 0 -0.4"/><geometry><box size="0.1 0.1 0.8"/></geometry><material name="red"/></visual></link>
      <joint name="j" type="fixed"><parent link="a"/><child link="b"/></joint>
      <joint name="k" type="revolute"><parent link="b"/><child link="c"/><origin xyz="0 0 0.5"/><axis xyz="0 1 0"/></joint></robot>`));
    await until(page, 'notice', () => text(page, '#notice-text'), (value) => value !== '');
    await page.locator('#notice-close').click();
    await page.locator('#speed').focus();
    await page.keyboard.press('End');
    await page.locator('#speed').blur();
    for (const angle of [60, 120, 170]) {
      await page.keyboard.down('KeyQ');
      await until(page, 'motion', () => position(page, 0), (value) => value > angle);
      // A held link has another colour.
      await page.keyboard.up('KeyQ');
      await rest(page);
      await page.locator('#arm').scrollIntoViewIfNeeded();
      const { all, edge } = await redness(page, await drawing(page));
      assert.ok(all > 0.005, `${all} of the drawing is the arm`);
      assert.equal(edge, 0, `the arm leaves the view at ${angle}°`);
    }
  }, { viewport: { width, height } });
}

for (const width of [320, 390]) {
  pageTest(`the status does not cover the arm at a width of ${width}`, async (page) => {
    const [arm, ...over] = await Promise.all(['#arm', '#facts', '#view-tools'].map((part) => page.locator(part).boundingBox()));
    assert.ok(arm.height >= 180, `the arm has a height of ${arm.height}`);
    for (const { y, height } of over) assert.ok(y + height <= arm.y || y >= arm.y + arm.height, `${y} to ${y + height} covers ${JSON.stringify(arm)}`);
  }, { viewport: { width, height: 844 } });
}

// The visible texts that are wider than the box of an element around them.
const clipped = (page) => page.evaluate(() => {
  const found = [];
  const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (texts.nextNode()) {
    const { currentNode: node } = texts;
    if (!node.data.trim() || node.parentElement.closest('.unseen') || !node.parentElement.checkVisibility()) continue;
    const range = document.createRange();
    range.selectNodeContents(node);
    const rows = [...range.getClientRects()];
    for (let box = node.parentElement; box; box = box.parentElement) {
      if (getComputedStyle(box).display === 'inline') continue;
      const { left, right } = box.getBoundingClientRect();
      if (rows.some((row) => row.left < left - 1 || row.right > right + 1)) {
        found.push(`${JSON.stringify(node.data.trim())} in ${box.tagName}#${box.id}.${box.className}`);
        break;
      }
    }
  }
  return found;
});

for (const width of WIDTHS) {
  pageTest(`no text is clipped at a width of ${width}`, async (page) => {
    // The longest values. The clock stands: the page writes no others.
    await page.evaluate(() => {
      const write = (selector, value) => document.querySelectorAll(selector).forEach((element) => { element.textContent = value; });
      write('.axis-value', '−180.0°');
      write('#counters dd', '9,999,999');
      write('#cable output', '0.0063 %');
      write('#cable .count', '99,999');
    });
    assert.deepEqual(await clipped(page), []);
  }, { viewport: { width, height: 844 } });
}

pageTest('an invalid dropped URDF does not change the arm', async (page) => {
  const name = await text(page, '#model-name');
  await rest(page);
  const before = await drawing(page);
  await drop(page, urdf('<robot name="broken"><link name="a"/><link name="b"/></robot>'));
  const error = 'the robot has 2 links without a parent, must be 1';
  await until(page, 'notice', () => page.locator('#notice-text').textContent(), (value) => value === error);
  await page.locator('#notice-close').click();
  await rest(page);
  assert.equal(await text(page, '#model-name'), name);
  assert.ok(await difference(page, [before, await drawing(page)]) < 0.001, 'the drawing has changed');
});

pageTest('every control has a name and can be reached by Tab', async (page) => {
  const nameless = await page.evaluate(() => [...document.querySelectorAll('button, input')]
    .filter((control) => !(control.getAttribute('aria-label') || control.innerText?.trim() || control.labels?.[0]?.innerText.trim()))
    .map((control) => control.outerHTML));
  assert.deepEqual(nameless, []);
  const reached = new Set();
  for (let i = 0; i < 60; i++) {
    await page.keyboard.press('Tab');
    reached.add(await page.evaluate(() => document.activeElement.id || document.activeElement.getAttribute('aria-label')));
  }
  for (const control of ['connect', 'help', 'arm', 'enable', 'J1 base, up, hold', 'Grip gripper, down, hold', 'speed', 'torque-off', 'errors-only', 'fault-drop', 'urdf']) {
    assert.ok(reached.has(control), `${control} is not reached`);
  }
});

pageTest('keys of the page do nothing while the help is open', async (page) => {
  await page.keyboard.press('?');
  assert.ok(await page.locator('#help-dialog').isVisible());
  await page.keyboard.down('KeyQ');
  await rest(page);
  assert.equal(await position(page, 0), 0);
  await page.keyboard.up('KeyQ');
  await page.keyboard.press('Escape');
  assert.ok(!(await page.locator('#help-dialog').isVisible()));
});

for (const [width, height] of SIZES) {
  for (const colorScheme of ['light', 'dark']) {
    const size = `${width}x${height}-${colorScheme}`;
    pageTest(`the page fits ${size}`, async (page) => {
      await page.keyboard.down('KeyW');
      await page.keyboard.down('KeyU');
      await moves(page, 1, 0);
      await page.locator('[name=cable][value=noisy]').check({ force: true });
      await until(page, 'errors', () => counter(page, 'bytes outside of frames'), (value) => value > 0);
      const wide = await page.evaluate(() => document.documentElement.scrollWidth - document.documentElement.clientWidth);
      assert.equal(wide, 0, 'the page is wider than the window');
      const shot = await page.locator('#view').screenshot();
      assert.ok(shot.length > 5_000, `a drawing of ${shot.length} bytes is empty`);
      fs.mkdirSync(screenshots, { recursive: true });
      await page.evaluate(() => scrollTo(0, 0));
      await page.screenshot({ path: path.join(screenshots, `${size}.png`) });
    }, { viewport: { width, height }, colorScheme });
  }
}
