"""A hiccup of the computer is no loss of the arm: the plugins for LeRobot while a process is stopped."""

import logging
import multiprocessing
import os
import random
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from test_lerobot import errors, follower, leader, plugin, wait_until

from armwire import sim

# A stop that ends while the answer of the arm is there, or that is short, makes no pose too old: there may be more.
STOPS, MOST_STOPS, SEED = 4, 40, 5
# Duration of a stop, and the time before it, in seconds. The newest pose is too old after 0.1 s.
STOPPED_S = (0.05, 0.8)
BEFORE_S = (0.0, 0.02)
STEP_S = 0.01
# A wait that a stop does not exceed on any computer.
LONG_S = 20.0
WAITS = "waits for the next one"


class Warned(logging.Handler):
    """The warnings of waits."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.texts: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        if WAITS in record.getMessage():
            self.texts.append(record.getMessage())


def step(robot: Any, teleoperator: Any) -> None:
    """A step of LeRobot's programs."""
    robot.get_observation()
    robot.send_action(teleoperator.get_action())


def teleoperate(connection: Connection, port: str, leader_port: str, folder: Path) -> None:
    """Make steps until something is received. Send the waits of both arms after each, and the warnings at the end."""
    warned = Warned()
    logging.getLogger().addHandler(warned)
    robot, teleoperator = (
        make(port, folder, observation_timeout_s=LONG_S) for make, port in ((follower, port), (leader, leader_port))
    )
    teleoperator.connect()
    robot.connect()
    while not connection.poll(STEP_S):
        step(robot, teleoperator)
        connection.send((robot.waits, teleoperator.waits, None))
    robot.disconnect()
    teleoperator.disconnect()
    connection.send((robot.waits, teleoperator.waits, warned.texts))


def serve(connection: Connection) -> None:
    """Serve a virtual arm until something is received."""
    with sim.ling() as virtual:
        connection.send(virtual.port)
        connection.recv()


@contextmanager
def started(run: Callable[..., None], *arguments: object) -> Iterator[tuple[int, Connection]]:
    """A process of its own, which is ended."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=run, args=(theirs, *arguments))
    process.start()
    theirs.close()
    assert process.pid is not None
    try:
        yield process.pid, ours
    finally:
        process.kill()
        process.join()


def stop(pid: int, chance: random.Random) -> None:
    """Stop a process at a random moment, and continue it."""
    time.sleep(chance.uniform(*BEFORE_S))
    os.kill(pid, signal.SIGSTOP)
    time.sleep(chance.uniform(*STOPPED_S))
    os.kill(pid, signal.SIGCONT)


def test_stopped_program_goes_on(tmp_path: Path) -> None:
    with (
        sim.ling() as virtual,
        sim.ling(leader=True, plant="ideal") as hand,
        started(teleoperate, virtual.port, hand.port, tmp_path) as (pid, program),
    ):

        def waits() -> int:
            """The number of waits after a new step."""
            while program.poll():
                program.recv()
            of_follower, of_leader, _ = program.recv()
            return int(of_follower + of_leader)

        chance = random.Random(SEED)
        stops = 0
        while waits() == 0 or stops < STOPS:
            assert stops < MOST_STOPS
            stop(pid, chance)
            stops += 1
        program.send(None)
        warned = None
        while warned is None:
            of_follower, of_leader, warned = program.recv()
    # One warning of each arm that was waited for.
    for port, number in ((virtual.port, of_follower), (hand.port, of_leader)):
        assert sum(text.startswith(port) for text in warned) == min(number, 1)


def test_stopped_arm_is_observed_when_it_goes_on(tmp_path: Path) -> None:
    warned = Warned()
    logging.getLogger().addHandler(warned)
    with started(serve) as (pid, arm):
        robot = follower(arm.recv(), tmp_path, action_timeout_s=0, observation_timeout_s=LONG_S)
        robot.connect()
        chance = random.Random(SEED)
        for _ in range(STOPS):
            stopping = threading.Thread(target=stop, args=(pid, chance))
            stopping.start()
            while stopping.is_alive():
                robot.get_observation()
                time.sleep(STEP_S)
            stopping.join()
            robot.get_observation()
        robot.disconnect()
    logging.getLogger().removeHandler(warned)
    assert robot.waits >= 2
    assert len(warned.texts) == 1


class Old:
    """What is too old for a number of waits, each of which takes longer by a hiccup. Its clock is virtual."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, waits: int, hiccup_s: float) -> None:
        self.waits, self.hiccup_s = waits, hiccup_s
        self.now = 0.0
        monkeypatch.setattr(plugin.patience, "time", SimpleNamespace(monotonic=lambda: self.now))

    def newest(self) -> str:
        if self.waits > 0:
            raise TimeoutError("too old")
        return "new"

    def wait(self, seconds: float) -> None:
        self.waits -= 1
        self.now += seconds + self.hiccup_s


def test_wait_without_a_hiccup_ends_in_time(monkeypatch: pytest.MonkeyPatch) -> None:
    old = Old(monkeypatch, waits=1000, hiccup_s=0)
    with pytest.raises(TimeoutError, match=r"too old, after a wait of 1 s"):
        plugin.patience.Patience(1.0).get(old.newest, old.wait)
    assert old.now == pytest.approx(1.0)


def test_hiccup_in_a_wait_does_not_end_it(monkeypatch: pytest.MonkeyPatch) -> None:
    old = Old(monkeypatch, waits=3, hiccup_s=5)
    patience = plugin.patience.Patience(1.0)
    assert patience.get(old.newest, old.wait) == "new"
    assert patience.waits == 1


def observe_always(observe: Callable[[], object]) -> None:
    """Observe until an error."""
    while True:
        observe()


def is_observed(observe: Callable[[], object]) -> bool:
    """True if the newest pose is not too old."""
    try:
        observe()
    except TimeoutError:
        return False
    return True


def test_silent_arm_ends_the_wait_after_its_time(tmp_path: Path) -> None:
    with sim.ling() as virtual:
        robot, teleoperator = (make(virtual.port, tmp_path, observation_timeout_s=0.05) for make in (follower, leader))
        for device, observe in ((robot, robot.get_observation), (teleoperator, teleoperator.get_action)):
            virtual.set_faults(sim.Faults())
            device.connect()
            virtual.set_faults(sim.Faults(drop=1_000_000))
            with pytest.raises(TimeoutError, match=r"pose is .* ms old, .* after a wait of 0\.05 s"):
                observe_always(observe)
            # The arm is back, and so are its poses.
            virtual.set_faults(sim.Faults())
            wait_until(lambda observe=observe: is_observed(observe))
            device.disconnect()


def test_lost_port_ends_the_wait_at_once(tmp_path: Path) -> None:
    with sim.ling() as virtual:
        robot = follower(virtual.port, tmp_path, action_timeout_s=0, observation_timeout_s=LONG_S)
        robot.connect()
        virtual.set_faults(sim.Faults(drop=1_000_000))

        def lose() -> None:
            wait_until(lambda: robot.waits > 0)
            virtual.close()

        lost = threading.Thread(target=lose)
        lost.start()
        with pytest.raises(errors.DeviceNotConnectedError, match="was it unplugged"):
            observe_always(robot.get_observation)
        lost.join()
        assert robot.waits == 1
        robot.disconnect()
