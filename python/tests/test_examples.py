"""The examples as separate processes, with virtual arms."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from armwire import sim

EXAMPLES = Path(__file__).parent.parent / "examples"


def run(*words: str) -> str:
    done = subprocess.run([sys.executable, "-B", *words], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def example(name: str, *arguments: str) -> str:
    return run(str(EXAMPLES / name), *arguments)


def test_move_prints_the_arms_position(virtual: sim.VirtualLing) -> None:
    output = example("move.py", virtual.port)
    assert "ADFS251205123456" in output
    assert "faulty servos: ()" in output
    np.testing.assert_allclose(virtual.joints().joints_deg, [0, 10, -20, 0, 0, 45], atol=0.3)


def test_script_for_the_sdk_runs(virtual: sim.VirtualLing) -> None:
    assert "'firmware_version': '6.1.0'" in example("from_the_sdk.py", virtual.port)
    assert virtual.joints().gripper == pytest.approx(1000, abs=5)


def test_follower_follows(virtual: sim.VirtualLing) -> None:
    with sim.ling(leader=True) as leader:
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
