// The frames on the line as a table: the newest of each message, or all in order.

const MAX_ROWS = 200;
const SHOWN = 60;
const ERRORS = ['unknown', 'noise', 'unanswered'];
const ARROWS = { sent: '→', received: '←', unknown: '←', noise: '←', unanswered: '·' };
const DIRECTIONS = { sent: 'to the arm', received: 'from the arm', unknown: 'from the arm', noise: 'from the arm', unanswered: 'nothing' };
const WINDOW = 2;

export const isError = (record) => ERRORS.includes(record.event);

export const hex = (bytes) => Array.from(bytes, (byte) => byte.toString(16).toUpperCase().padStart(2, '0')).join(' ');

// Records with the same key are the same message: command and function of a frame, otherwise the kind of error.
export function keyOf({ event, bytes, text }) {
  if (event === 'sent' || event === 'received' || event === 'unknown') return `${event} ${bytes[1]} ${bytes[2]}`;
  // Returns the text without its numbers.
  return `${event} ${text.replace(/0x[0-9a-f]+|\d+/g, '#')}`;
}

// The rows of the table, independent of the page.
export class FrameLog {
  rows = [];
  messages = new Map();
  total = 0;
  errors = 0;

  // `time` is in seconds.
  add(record, time) {
    const row = { ...record, time };
    this.total += 1;
    if (isError(record)) this.errors += 1;
    this.rows.push(row);
    if (this.rows.length > 2 * MAX_ROWS) this.rows.splice(0, MAX_ROWS);
    const key = keyOf(record);
    const message = this.messages.get(key) ?? { count: 0, recent: [] };
    message.count += 1;
    message.newest = row;
    message.recent.push(time);
    this.messages.set(key, message);
  }

  // Returns the newest record of each message, with its count and recent rate. Errors come first, then each request
  // with its answer.
  byMessage(time) {
    for (const message of this.messages.values()) {
      while (message.recent.length > 0 && message.recent[0] < time - WINDOW) message.recent.shift();
    }
    const rows = [...this.messages.values()].map(({ newest, count, recent }) => ({ ...newest, count, rate: recent.length / WINDOW }));
    return rows.sort((a, b) => isError(b) - isError(a) || compare(a.bytes, b.bytes) || (a.event === 'sent' ? -1 : 1));
  }

  // Returns all records, the newest first.
  inOrder() {
    return this.rows.slice(-MAX_ROWS).reverse();
  }

  clear() {
    this.rows = [];
    this.messages.clear();
    this.total = 0;
    this.errors = 0;
  }
}

// Compares by command, then by function.
function compare(a, b) {
  for (const i of [1, 2]) if (a[i] !== b[i]) return (a[i] ?? 0) - (b[i] ?? 0);
  return 0;
}

export class FrameTable {
  #body;
  #summary;
  #options;
  log = new FrameLog();

  // `options()` returns `{ byMessage, errorsOnly }`.
  constructor(body, summary, options) {
    this.#body = body;
    this.#summary = summary;
    this.#options = options;
  }

  // Draws the state at `time`, in seconds.
  draw(time) {
    const { byMessage, errorsOnly } = this.#options();
    const rows = byMessage ? this.log.byMessage(time) : this.log.inOrder();
    const shown = rows.filter((row) => !errorsOnly || isError(row)).slice(0, SHOWN);
    // Rows are reused, so that a user can read and select them.
    while (this.#body.rows.length > shown.length) this.#body.deleteRow(-1);
    shown.forEach((row, i) => fill(this.#body.rows[i] ?? emptyRow(this.#body), row, byMessage));
    const { total, errors } = this.log;
    this.#summary.textContent = `${total.toLocaleString('en')} rows, ${errors.toLocaleString('en')} of them errors`;
  }
}

function emptyRow(body) {
  const row = body.insertRow();
  for (const name of ['when', 'direction', 'bytes', 'meaning']) row.insertCell().className = name;
  return row;
}

function fill(element, row, byMessage) {
  const [when, direction, bytes, meaning] = element.cells;
  element.className = isError(row) ? 'error' : row.event;
  set(when, byMessage ? `${row.count.toLocaleString('en')}${rateText(row.rate)}` : row.time.toFixed(3));
  set(direction, ARROWS[row.event]);
  direction.title = DIRECTIONS[row.event];
  set(bytes, hex(row.bytes));
  set(meaning, row.text);
}

const rateText = (rate) => (rate === 0 ? '' : ` · ${rate.toFixed(rate < 10 ? 1 : 0)}/s`);

function set(cell, text) {
  if (cell.textContent !== text) cell.textContent = text;
}
