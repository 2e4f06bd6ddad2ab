// The line of the page about the arm's motion.

const BLOCK_TEXTS = {
  disabled: 'Motion is off. Enable it to move the arm.',
  'no reading': 'No fresh reading: the arm does not move.',
  'torque off': 'Torque is off: the arm does not move.',
  'out of range': 'A position is out of range: the arm does not move.',
  'unknown status': 'No document explains the status: the arm does not move.',
  'another robot': 'This is not an Alicia-D, as its status shows: nothing moves or holds it.',
};
const STOP_TEXTS = {
  stopping: 'The arm is being stopped.',
  stopped: 'Stopped. Hold a key or button to move.',
  'grip may loosen': 'Stopped. The gripper holds its reading: a grip may have loosened.',
  'without torque': 'Torque is off: nothing was sent.',
  failed: 'The arm may still move. Switch its supply off.',
};
// A confirmed torque is in the status.
const TORQUE_TEXTS = {
  'not shown': 'The torque request was sent. The status does not show its effect.',
  contradicted: 'The torque request was sent. The status shows that it had no effect.',
  'no reading': 'The torque request was sent. No reading came to show its effect.',
};

// The text for a reason against motion, the state of the last stop, and that of the torque. A failed stop comes first.
export function motionText(block, stop, torque) {
  if (stop === 'failed') return { text: STOP_TEXTS.failed, isWarning: true };
  const torqueText = TORQUE_TEXTS[torque];
  if (torqueText !== undefined) return { text: torqueText, isWarning: true };
  const text = block ? BLOCK_TEXTS[block] : STOP_TEXTS[stop];
  return { text: text ?? 'Hold a key or button to move. Release it to stop.', isWarning: false };
}
