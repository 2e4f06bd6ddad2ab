import assert from 'node:assert/strict';
import { spawn } from 'node:child_process';
import fs from 'node:fs';
import readline from 'node:readline';

// The virtual arm on a pty: `armwire sim ling`.
export class Arm {
  static async start(armwire, link) {
    const arm = new Arm();
    arm.process = spawn(armwire, ['sim', 'ling', '--plant', 'ideal', '--pty', link], { stdio: ['ignore', 'pipe', 'inherit'] });
    arm.lines = readline.createInterface({ input: arm.process.stdout })[Symbol.asyncIterator]();
    // The first line of output shows that the pty is ready.
    assert.ok(!(await arm.lines.next()).done, 'the virtual arm does not start');
    arm.port = fs.openSync(link, fs.constants.O_RDWR | fs.constants.O_NOCTTY | fs.constants.O_NONBLOCK);
    return arm;
  }

  write(bytes) {
    assert.equal(fs.writeSync(this.port, bytes), bytes.length, 'the pty is full');
  }

  read() {
    const buffer = Buffer.alloc(4096);
    try {
      return buffer.subarray(0, fs.readSync(this.port, buffer));
    } catch (error) {
      if (error.code === 'EAGAIN') return buffer.subarray(0, 0);
      throw error;
    }
  }

  // Ends the arm, and returns its counts of received and sent bytes.
  async end() {
    this.process.kill('SIGINT');
    const { value } = await this.lines.next();
    const counts = /^(\d+) bytes in, (\d+) out, 0 not read; .* 0 unknown frames, 0 noise bytes/.exec(value);
    assert.ok(counts, `the arm ends with: ${value}`);
    return { received: Number(counts[1]), sent: Number(counts[2]) };
  }
}
