"""Teleoperates and records with LeRobot's own programs on virtual arms with a moving leader, and checks the results.

It records a second time while LeRobot's process is stopped again and again, with all cores busy.

Usage: record.py FOLDER

FOLDER receives the data set. LeRobot, armwire and the plugin must be installed: `cargo xtask lerobot` does this.
"""

import math
import os
import random
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from armwire import sim

FPS = 30
# Motion of the leader: amplitude of each joint and of the gripper, and the period.
AMPLITUDE_DEG = np.array([30.0, 20.0, 25.0, 10.0, 15.0, 40.0])
GRIPPER, GRIPPER_AMPLITUDE = 500, 400
PERIOD_S = 4.0
# Highest speed, of the joint with an amplitude of 40°.
FASTEST_DEG_S = 40 * 2 * math.pi / PERIOD_S
# Limits for the follower: the delay at this percentile of the samples while the leader moves, and the distance at rest.
MAX_DELAY_S = 0.15
PERCENTILE = 95
MAX_REST_DEG = 0.2
# Tolerance of a recorded pose: half a tick, plus the curvature of the motion between two samples.
RECORDED_DEG = 0.5
# Stops of LeRobot's process, and the times between them, in seconds. The seed makes them the same in each run.
STOPPED_S, BETWEEN_S, SEED = (0.05, 0.8), (0.2, 1.0), 5
EPISODES = 2
# Minimum number of frames of each: a stopped program has few.
FRAMES = 10
ROBOT = ["--robot.type=alicia_d_armwire", "--robot.id=follower", "--robot.speed_deg_s=200"]
TELEOP = ["--teleop.type=alicia_d_leader_armwire", "--teleop.id=leader"]


Poses = NDArray[np.float64]


class Hand:
    """A thread that moves a leader and records the poses of both arms."""

    def __init__(self, leader: sim.VirtualLing, follower: sim.VirtualLing) -> None:
        self.leader, self.follower = leader, follower
        self.moving = True
        self.ended = False
        self.samples: list[tuple[float, Poses, Poses]] = []
        self.thread = threading.Thread(target=self._run)
        self.thread.start()

    def _run(self) -> None:
        begun = time.monotonic()
        while not self.ended:
            phase = (time.monotonic() - begun) * 2 * math.pi / PERIOD_S
            if self.moving:
                self.leader.push_joints_deg(AMPLITUDE_DEG * math.sin(phase))
                self.leader.push_gripper_permille(round(GRIPPER + GRIPPER_AMPLITUDE * math.sin(phase)))
            poses = [np.append(arm.joints().joints_deg, arm.joints().gripper) for arm in (self.leader, self.follower)]
            self.samples.append((time.monotonic(), poses[0], poses[1]))
            time.sleep(0.005)

    def end(self) -> tuple[Poses, Poses, Poses]:
        """End the thread, and return times and poses of the leader and the follower."""
        self.ended = True
        self.thread.join()
        times, leader, follower = zip(*self.samples, strict=True)
        return np.array(times), np.array(leader), np.array(follower)


@contextmanager
def arms() -> Iterator[tuple[Hand, list[str]]]:
    """Start a moving leader and a follower, without weight, and yield them with their arguments for LeRobot."""
    with sim.ling(leader=True, plant="ideal") as leader, sim.ling(plant="ideal") as follower:
        hand = Hand(leader, follower)
        try:
            yield hand, [*ROBOT, f"--robot.port={follower.port}", *TELEOP, f"--teleop.port={leader.port}"]
        finally:
            hand.ended = True


def command(program: str, *arguments: str) -> list[str]:
    """Print and return a command of LeRobot from the environment of this Python."""
    print("$", program, *arguments, flush=True)
    return [str(Path(sys.executable).parent / program), *arguments]


def run(program: str, *arguments: str) -> None:
    """Run a program of LeRobot."""
    subprocess.run(command(program, *arguments), check=True, timeout=300)


def run_with_hiccups(begun: Callable[[], bool], program: str, *arguments: str) -> int:
    """Run a program of LeRobot on busy cores, and stop and continue it again and again from `begun` on.

    Returns:
        The number of stops.
    """
    chance = random.Random(SEED)
    stops = 0
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(os.cpu_count() or 1)]
    try:
        with subprocess.Popen(command(program, *arguments)) as process:
            while process.poll() is None:
                time.sleep(chance.uniform(*BETWEEN_S))
                if begun():
                    process.send_signal(signal.SIGSTOP)
                    time.sleep(chance.uniform(*STOPPED_S))
                    process.send_signal(signal.SIGCONT)
                    stops += 1
    finally:
        for load in busy:
            load.kill()
            load.wait()
    if process.returncode != 0:
        raise subprocess.CalledProcessError(process.returncode, program)
    return stops


def expect(what: str, holds: bool | np.bool) -> None:
    """Print a passed check, or end the program."""
    if not holds:
        sys.exit(f"FAILED: {what}")
    print(f"ok: {what}", flush=True)


def teleoperate() -> None:
    """Check the follower behind a moving leader, then at rest."""
    with arms() as (hand, ports):
        thread = threading.Thread(target=run, args=("lerobot-teleoperate", *ports, f"--fps={FPS}", "--teleop_time_s=8"))
        thread.start()
        while thread.is_alive() and not follows(hand):
            time.sleep(0.05)
        time.sleep(5)
        hand.moving = False
        time.sleep(1)
        settled = len(hand.samples) - 1
        thread.join()
        times, leader, follower = hand.end()
    moved = np.ptp(leader[:, :6], axis=0)
    expect(f"the leader moved by {moved.round(1).tolist()} degrees", bool((moved > 1.9 * AMPLITUDE_DEG).all()))
    begun = int(np.argmax(np.abs(follower[:, :6]).max(axis=1) > 1))
    # From half a second after the follower's start until the leader's stop.
    window = (times > times[begun] + 0.5) & (times < times[settled] - 1.1)
    expect(f"the follower followed for {np.ptp(times[window]):.1f} s", np.ptp(times[window]) > 3)
    error = np.abs(follower[window, :6] - leader[window, :6]).max(axis=1)
    median, largest = np.median(error), np.percentile(error, PERCENTILE)
    limit = FASTEST_DEG_S * MAX_DELAY_S
    expect(
        f"error of the farthest joint: median {median:.2f}°, percentile {PERCENTILE} {largest:.2f}°, limit "
        f"{limit:.1f}° at {FASTEST_DEG_S:.0f}°/s",
        bool(largest <= limit),
    )
    rest = np.abs(follower[settled, :6] - leader[settled, :6]).max()
    expect(f"error at rest: {rest:.2f}°", bool(rest <= MAX_REST_DEG))
    gripper = abs(follower[settled, 6] - leader[settled, 6])
    expect(f"error of the gripper at rest: {gripper:.0f} of 1000", bool(gripper <= 5))


def interpolated(poses: Poses) -> Poses:
    """Return the poses with linear interpolation, 20 poses per interval."""
    parts = np.linspace(0, 1, 20, endpoint=False)[:, None, None]
    return np.concatenate(poses[:-1] + parts * np.diff(poses, axis=0))


def follows(hand: Hand) -> bool:
    """Return true if the follower has begun to move."""
    return bool(np.abs(hand.follower.joints().joints_deg).max() > 1)


def recording(root: Path, episodes: int) -> list[str]:
    """Return the command that records episodes into this folder, without its arms. A data set there is removed."""
    if root.exists():
        shutil.rmtree(root)
    return [
        "lerobot-record",
        "--dataset.repo_id=armwire/wave",
        f"--dataset.root={root}",
        f"--dataset.fps={FPS}",
        f"--dataset.num_episodes={episodes}",
        "--dataset.episode_time_s=5",
        "--dataset.reset_time_s=0",
        "--dataset.single_task=wave",
        "--dataset.video=false",
        "--dataset.push_to_hub=false",
        "--play_sounds=false",
    ]


def record(folder: Path) -> None:
    """Record one episode and read it back."""
    from lerobot.datasets import LeRobotDataset

    root = folder / "armwire_wave"
    with arms() as (hand, ports):
        run(*recording(root, 1), *ports)
        _, leader, follower = hand.end()
    dataset = LeRobotDataset("armwire/wave", root=root)
    names = [*(f"joint{joint}.pos" for joint in range(1, 7)), "gripper.pos"]
    expect(
        f"{dataset.num_episodes} episode of {dataset.num_frames} frames at {dataset.fps} Hz is read back",
        dataset.num_episodes == 1 and dataset.fps == FPS and dataset.num_frames > 3 * FPS,
    )
    for feature in ("action", "observation.state"):
        expect(f"{feature} has {names}", dataset.features[feature]["names"] == names)
    table = dataset.hf_dataset.with_format("numpy")
    actions, states = np.stack(table["action"]), np.stack(table["observation.state"])
    ranges = np.ptp(actions[:, :6], axis=0)
    expect(f"actions span {ranges.round(1).tolist()} degrees", bool((ranges > 1.8 * AMPLITUDE_DEG).all()))
    expect(
        f"the gripper spans {actions[:, 6].min():.0f} to {actions[:, 6].max():.0f} of 1000",
        bool(actions[:, 6].min() < GRIPPER - 300 and actions[:, 6].max() > GRIPPER + 300),
    )
    for what, values, truth in (("action", actions, leader), ("state", states, follower)):
        path = interpolated(truth[:, :6])
        off = [np.abs(path - value[:6]).max(axis=1).min() for value in values]
        expect(f"each {what} is a pose of the arm, within {max(off):.2f}°", max(off) <= RECORDED_DEG)
    error = np.percentile(np.abs(states[FPS:, :6] - actions[FPS:, :6]).max(axis=1), PERCENTILE)
    limit = FASTEST_DEG_S * (MAX_DELAY_S + 1 / FPS)
    expect(f"states against actions: percentile {PERCENTILE} {error:.2f}°, limit {limit:.1f}°", error <= limit)


def record_with_hiccups(folder: Path) -> None:
    """Record episodes while LeRobot is stopped again and again, and read them back."""
    from lerobot.datasets import LeRobotDataset

    root = folder / "armwire_hiccups"
    with arms() as (hand, ports):
        stops = run_with_hiccups(lambda: follows(hand), *recording(root, EPISODES), *ports)
        hand.end()
    dataset = LeRobotDataset("armwire/wave", root=root)
    expect(
        f"{dataset.num_episodes} episodes of {dataset.num_frames} frames are read back, after {stops} stops",
        dataset.num_episodes == EPISODES and dataset.num_frames >= EPISODES * FRAMES and stops > EPISODES,
    )


def main(folder: str) -> None:
    """Run all checks."""
    teleoperate()
    record(Path(folder))
    record_with_hiccups(Path(folder))


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(sys.argv[1])
