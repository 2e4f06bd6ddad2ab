"""The examples as separate processes, with virtual arms."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import armwire
from armwire import sim

EXAMPLES = Path(__file__).parent.parent / "examples"


def run(*words: str) -> str:
    # Enter, for the example that asks before it moves the arm.
    done = subprocess.run(
        [sys.executable, "-B", *words], input="\n", capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def example(name: str, *arguments: str) -> str:
    return run(str(EXAMPLES / name), *arguments)


def test_move_prints_the_arms_position(virtual: sim.VirtualLing) -> None:
    output = example("move.py", virtual.port)
    assert "ADFS251205123456" in output
    assert "faulty servos: ()" in output
    np.testing.assert_allclose(virtual.joints().joints_deg, [0, 10, -20, 0, 0, 45], atol=0.3)


def interrupted(virtual: sim.VirtualLing, name: str, *arguments: str) -> str:
    """Press Ctrl-C in an example while the arm moves and is read, and return its standard error."""
    # A shell's background job inherits SIGINT as ignored, and so would the example.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    command = [sys.executable, "-B", str(EXAMPLES / name), *arguments]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        signal.signal(signal.SIGINT, before)
        assert process.stdin is not None
        process.stdin.write("\n")
        process.stdin.flush()
        begun = virtual.joints().ticks[0]
        while virtual.joints().ticks[0] == begun and process.poll() is None:
            time.sleep(0.005)
        requests = virtual.requests()
        while virtual.requests() == requests and process.poll() is None:
            time.sleep(0.005)
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=60)
    return error


def assert_rests(virtual: sim.VirtualLing) -> None:
    with armwire.Ling(virtual.port) as arm:
        # The gripper goes on to its goal.
        assert arm.read_velocities_deg_s()[:9].max() == 0
        assert arm.read_joints().is_holding is True


def test_ctrl_c_in_move_stops_the_arm(virtual: sim.VirtualLing) -> None:
    with armwire.Ling(virtual.port) as arm:
        arm.set_torque(False)
        virtual.push_joints_deg([90, 0, 0, 0, 0, 0])
    # From there to zero it takes some seconds.
    assert "Ctrl-C stopped the arm" in interrupted(virtual, "move.py", virtual.port)
    assert_rests(virtual)
    assert 2060 < virtual.joints().ticks[0] < 3072


def test_ctrl_c_in_follow_stops_the_arm(virtual: sim.VirtualLing) -> None:
    with sim.ling(plant="ideal", leader=True) as leader:
        leader.push_joints_deg([170] * 6)
        interrupted(virtual, "follow.py", leader.port, virtual.port, "30")
    assert_rests(virtual)


def test_script_for_the_sdk_runs(virtual: sim.VirtualLing) -> None:
    assert "'firmware_version': '6.1.0'" in example("from_the_sdk.py", virtual.port)
    assert virtual.joints().gripper == pytest.approx(1000, abs=5)


def test_follower_follows(virtual: sim.VirtualLing) -> None:
    with sim.ling(plant="ideal", leader=True) as leader:
        leader.push_joints_deg([10, -20, 30, 0, 45, -60])
        example("follow.py", leader.port, virtual.port, "2")
        np.testing.assert_array_equal(virtual.joints().ticks, leader.joints().ticks)


def test_latencies_are_drawn(virtual: sim.VirtualLing, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    example("latencies.py", virtual.port, str(tmp_path / "figure.png"))
    assert (tmp_path / "figure.png").read_bytes().startswith(b"\x89PNG")


def test_recording_has_stamps(board: Path, tmp_path: Path) -> None:
    output = example("record.py", f"control:{board / 'control'}", "1", str(tmp_path / "recording.npz"))
    assert "every 5000 µs" in output
    recording = np.load(tmp_path / "recording.npz")
    assert recording["joints_deg"].shape == (recording["stamp_us"].size, 6)


def test_test_without_hardware_passes() -> None:
    assert "3 passed" in run("-m", "pytest", "-p", "no:cacheprovider", str(EXAMPLES / "without_hardware.py"))


def test_every_example_is_run() -> None:
    text = Path(__file__).read_text(encoding="utf-8")
    for path in EXAMPLES.glob("*.py"):
        assert path.name in text, path
