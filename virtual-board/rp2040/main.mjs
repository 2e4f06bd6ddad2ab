// The chip of a virtual board: reads commands from stdin, writes events to stdout. It ends with its input.
import { Command, Event, receive } from './messages.mjs';
import { Machine } from './machine.mjs';

let machine = null;

for (let commands = receive(); commands; commands = receive()) {
  while (!commands.isEmpty) {
    if (!machine) machine = start(commands);
    else act(commands);
  }
  machine.events.send();
}

function start(commands) {
  if (commands.byte() !== Command.START) throw new Error('the first command is START');
  const cycleNanos = commands.number();
  const revision = commands.byte();
  const uniqueId = commands.bytes();
  const crashes = Array.from({ length: commands.word() }, () => commands.word());
  return new Machine({ cycleNanos, revision, uniqueId, crashes, flash: commands.bytes() });
}

function act(commands) {
  const { uart, usb } = machine;
  const command = commands.byte();
  switch (command) {
    case Command.RUN:
      return run(commands.number());
    case Command.RESET:
      return machine.restart(commands.byte(), commands.byte() !== 0);
    case Command.HOLD:
      return machine.hold(commands.byte() !== 0);
    case Command.FLASH:
      return machine.writeFlash(commands.word(), commands.bytes());
    case Command.FLASH_DONE:
      return machine.endFlash();
    case Command.RECEIVED:
      return uart.receive(commands.byte(), commands.byte());
    case Command.TAKEN:
      return uart.take();
    case Command.SENT:
      return uart.rest();
    case Command.BUS_RESET:
      return usb.resetBus();
    case Command.BUS_RESET_DONE:
      return usb.endReset();
    case Command.START_OF_FRAME:
      return usb.startFrame(commands.word());
    case Command.SETUP:
      return usb.setup(commands.bytes());
    case Command.OUT:
      return usb.output(commands.byte(), commands.bytes());
    case Command.IN_DONE:
      return usb.fetched(commands.byte());
    case Command.SUSPEND:
      return usb.suspend();
    case Command.RESUME:
      return usb.resume();
    case Command.ABORTED:
      return usb.aborted(commands.word());
    case Command.READ:
      return machine.read(commands.word());
    case Command.WRITE:
      return machine.write(commands.word(), commands.word());
    case Command.MOVE_STACK:
      return machine.moveStack(commands.word(), commands.word());
    default:
      throw new Error(`there is no command ${command}`);
  }
}

// Runs the chip. An error of the emulator ends the run.
function run(until) {
  try {
    machine.run(until);
  } catch (error) {
    machine.events.byte(Event.FAILED);
    machine.events.bytes(Buffer.from(error.stack));
  }
}
