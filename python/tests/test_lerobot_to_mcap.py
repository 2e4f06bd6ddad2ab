"""The converter of LeRobot data sets, with a small one of the vendor's plugin: our names, radians, gripper 0 to 100."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import armwire
from armwire import plot, sim

pytest.importorskip("mcap_ros2")
pyarrow = pytest.importorskip("pyarrow")
parquet = pytest.importorskip("pyarrow.parquet")

HERE = Path(__file__).parent
TOOL = HERE.parents[1] / "tools/lerobot_to_mcap.py"
VENDORS = HERE / "lerobot_radians"
LAST_DEG = np.degrees([0.02436, 0.01218, -0.00914, 0.0, 0.00609, 0.01827])


def convert(folder: Path, out: Path, *options: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(TOOL), str(folder), "0", "50", str(out), *options]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)


def refused(folder: Path, out: Path, *options: str) -> str:
    converted = convert(folder, out, *options)
    assert converted.returncode == 1, converted
    assert converted.stderr.count("\n") == 1, converted.stderr
    assert not out.exists()
    return converted.stderr


@pytest.fixture
def other(tmp_path: Path) -> Path:
    """A copy of the data set."""
    return Path(shutil.copytree(VENDORS, tmp_path / "other"))


def change(folder: Path, **changes: object) -> None:
    path = folder / "meta/info.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


def test_data_set_of_the_vendor_is_replayed_in_radians(virtual: sim.VirtualLing, tmp_path: Path) -> None:
    out = tmp_path / "episode.mcap"
    converted = convert(VENDORS, out)
    assert converted.stdout == "90 poses (radians, by robot_type 'alicia_d')\n", converted
    with armwire.Ling(virtual.port) as arm:
        arm.set_torque(True)
    program = "from armwire._command import main; main()"
    command = [sys.executable, "-c", program, "replay", str(out), virtual.port]
    subprocess.run(command, capture_output=True, check=True, timeout=60)
    with armwire.Ling(virtual.port) as arm:
        state = arm.read_joints()
    np.testing.assert_allclose(state.joints_deg, LAST_DEG, atol=0.1)
    assert state.gripper == 500


def test_robot_type_decides_the_units(other: Path, tmp_path: Path) -> None:
    change(other, robot_type="alicia_d_armwire")
    assert "degrees, by robot_type 'alicia_d_armwire'" in convert(other, tmp_path / "ours.mcap").stdout
    motion = plot.read_mcap(tmp_path / "ours.mcap")
    # The numbers of the data set, taken for degrees.
    np.testing.assert_allclose(motion.joints_deg[-1], np.radians(LAST_DEG), atol=1e-4)
    np.testing.assert_allclose(motion.gripper_mm, 2.5)
    error = refused(other, tmp_path / "no.mcap", "--unit", "radians")
    assert "the robot_type 'alicia_d_armwire' has degrees, and not --unit radians" in error


@pytest.mark.parametrize("robot_type", [None, "so100", 7])
def test_unknown_robot_type_needs_a_unit(other: Path, tmp_path: Path, robot_type: object) -> None:
    change(other, robot_type=robot_type)
    out = tmp_path / "out.mcap"
    error = refused(other, out)
    found = "no robot_type" if robot_type is None else f"the unknown robot_type {robot_type!r}"
    assert f"other/meta/info.json: {found}, and the names of actions tell no units" in error
    for choice in ("--unit degrees: degrees, ", "--unit radians: radians, ", "--joints FILE"):
        assert choice in error
    assert convert(other, out, "--unit", "radians").stdout == "90 poses (radians, by --unit)\n"
    motion = plot.read_mcap(out)
    np.testing.assert_allclose(motion.joints_deg[-1], LAST_DEG, atol=1e-2)
    np.testing.assert_allclose(motion.gripper_mm, 25)


def test_file_of_joints_has_other_names_and_units(other: Path, tmp_path: Path) -> None:
    names = [f"j{number}.pos" for number in range(1, 7)] + ["claw.pos"]
    info = json.loads((VENDORS / "meta/info.json").read_text())
    change(other, robot_type="unknown", features={"action": info["features"]["action"] | {"names": names}})
    lines = [f'joint{number} = {{ name = "j{number}", factor = -1 }}' for number in range(1, 7)]
    joints = tmp_path / "joints.toml"
    # From 0 (open) to 100 (closed), of 50 mm.
    joints.write_text("\n".join(["[a.joints]", *lines, 'gripper = { name = "claw", factor = -2000, offset = 100 }']))
    out = tmp_path / "out.mcap"
    assert "the actions are ['j1.pos', " in refused(other, out, "--unit", "radians")
    assert convert(other, out, "--joints", str(joints)).returncode == 0
    motion = plot.read_mcap(out)
    np.testing.assert_allclose(motion.joints_deg[-1], -LAST_DEG, atol=1e-2)
    np.testing.assert_allclose(motion.gripper_mm, 25)
    joints.write_text("[a.joints]\njoint1 = { factor = 0 }")
    error = refused(other, tmp_path / "wrong.mcap", "--joints", str(joints))
    assert 'joints.toml: "a": joint1: factor 0.0 is not within 1e-9 to 1e9' in error


def test_value_that_the_arm_cannot_have_is_named(other: Path, tmp_path: Path) -> None:
    (path,) = (other / "data").rglob("*.parquet")
    table = parquet.read_table(path)
    for value in (45.0, float("nan"), np.pi):
        actions = table["action"].to_pylist()
        actions[3][1] = value
        column = pyarrow.array(actions, table["action"].type)
        parquet.write_table(table.set_column(table.column_names.index("action"), "action", column), path)
        error = refused(other, tmp_path / "out.mcap")
        assert f"action 3 of episode 0: joint2.pos is {value:g}, which is {value:.4g} rad, not within" in error
        assert "are the units radians, by robot_type 'alicia_d'?" in error


def test_folder_without_a_data_set_is_named(other: Path, tmp_path: Path) -> None:
    assert "absent/meta/info.json: No such file" in refused(tmp_path / "absent", tmp_path / "out.mcap")
    change(other, features={})
    assert "other/meta/info.json: no names of actions: KeyError('action')" in refused(other, tmp_path / "out.mcap")
