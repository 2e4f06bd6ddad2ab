import subprocess
import sys
from pathlib import Path
from zlib import crc32

import numpy as np
import pytest

import armwire
from armwire import MotionStatus, joints_file, sim

pytest.importorskip("matplotlib")
from armwire import plot

DEFINITION = Path(__file__).parents[2] / "cli/src/recording/joint_state.ros2msg"


def run(*arguments: str) -> str:
    program = "from armwire._command import main; main()"
    command = [sys.executable, "-c", program, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=30).stdout


def monitored(port: str, count: int) -> str:
    return run("monitor", port, "--csv", f"--count={count}")


def draw(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "armwire.plot", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)


def test_csv_of_the_command_is_read_and_drawn(virtual: sim.VirtualLing, tmp_path: Path) -> None:
    with armwire.Ling(virtual.port) as arm:
        arm.move_deg([90, -45, 0, 0, 0, 10], gripper_permille=1000, speed_deg_s=10)
    (tmp_path / "motion.csv").write_text(monitored(virtual.port, 10))
    readings = plot.read_csv(tmp_path / "motion.csv")
    assert readings.joints_deg.shape == (10, 6)
    assert (np.diff(readings.time_s) > 0).all()
    # A busy computer may miss an answer.
    answered = np.isfinite(readings.latency_us)
    joints = readings.joints_deg[answered, 0]
    assert (np.diff(joints) >= 0).all()
    assert joints[-1] > joints[0]
    assert readings.gripper_permille[answered].max() <= 1000
    for option, name in ((), "joints.png"), (("--latencies",), "latencies.svg"):
        figure = tmp_path / name
        assert draw(str(tmp_path / "motion.csv"), "--save", str(figure), *option).returncode == 0
        assert figure.stat().st_size > 1000


def test_recording_of_the_command_is_read_and_drawn(virtual: sim.VirtualLing, tmp_path: Path) -> None:
    with armwire.Ling(virtual.port) as arm:
        arm.move_deg([90, -45, 0, 0, 0, 10], gripper_permille=1000, speed_deg_s=10)
    path, figure = tmp_path / "motion.mcap", tmp_path / "motion.png"
    run("record", virtual.port, str(path), "--count", "50")
    motion = plot.read_mcap(path)
    assert motion.joints_deg.shape == (len(motion.time_s), 6)
    assert motion.time_s[0] == 0
    assert (np.diff(motion.time_s) > 0).all()
    assert (np.diff(motion.joints_deg[:, 0]) >= 0).all()
    assert motion.joints_deg[-1, 0] > motion.joints_deg[0, 0]
    assert np.nanmax(motion.gripper_mm) <= 50
    assert draw(str(path), "--save", str(figure)).returncode == 0
    assert figure.stat().st_size > 1000
    for option, text in (
        (["--topic", "/leader/joint_states"], "no poses on /leader/joint_states; there are: /frames, /joint_states"),
        (["--latencies"], "a recording has no latencies"),
    ):
        drawn = draw(str(path), "--save", str(figure), *option)
        assert drawn.returncode == 1
        assert text in drawn.stderr
        assert "Traceback" not in drawn.stderr


def test_recording_of_another_program_is_drawn_by_its_joints(tmp_path: Path) -> None:
    from mcap_ros2.writer import Writer

    path, file, figure = tmp_path / "model.mcap", tmp_path / "joints.toml", tmp_path / "figure.png"
    names = ["finger", "elbow", "joint1", "joint3", "joint4", "joint5", "joint6"]
    with path.open("wb") as out:
        writer = Writer(out)
        schema = writer.register_msgdef("sensor_msgs/msg/JointState", DEFINITION.read_text())
        for second in range(3):
            position = [-0.01 * second, 90 - second, *[0.0] * 5]
            header = {"stamp": {"sec": second, "nanosec": 0}, "frame_id": ""}
            message = {"header": header, "name": names, "position": position, "velocity": [], "effort": []}
            writer.write_message("/joint_states", schema, message, log_time=second, publish_time=second)
        writer.finish()  # type: ignore[no-untyped-call]
    file.write_text(
        "[arm.joints]\n"
        'joint2 = { name = "elbow", factor = -57.29577951308232, offset = 90 }\n'
        'gripper = { name = "finger", factor = 0.5, offset = -0.025 }\n'
    )
    motion = plot.read_mcap(path, joints=joints_file.read(file))
    np.testing.assert_allclose(motion.joints_deg[:, 1], [0, 1, 2])
    np.testing.assert_allclose(motion.gripper_mm, [50, 30, 10])
    assert draw(str(path), "--save", str(figure), "--joints", str(file)).returncode == 0
    assert figure.stat().st_size > 1000
    with pytest.raises(ValueError, match="must be joint1, joint2, "):
        plot.read_mcap(path)
    file.write_text("[arm.joints]\njoint1 = { factor = nan }\n")
    drawn = draw(str(path), "--save", str(figure), "--joints", str(file))
    assert (drawn.returncode, drawn.stderr.count("\n")) == (1, 1)
    assert 'joints.toml: "arm": joint1: factor NaN is not within 1e-9 to 1e9' in drawn.stderr


def test_joint_that_is_there_twice_is_refused(tmp_path: Path) -> None:
    from mcap_ros2.writer import Writer

    path = tmp_path / "twice.mcap"
    names = [*(f"joint{number}" for number in range(1, 7)), "joint2"]
    with path.open("wb") as out:
        writer = Writer(out)
        schema = writer.register_msgdef("sensor_msgs/msg/JointState", DEFINITION.read_text())
        header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
        message = {"header": header, "name": names, "position": [0.0] * 7, "velocity": [], "effort": []}
        writer.write_message("/joint_states", schema, message, log_time=0, publish_time=0)
        writer.finish()  # type: ignore[no-untyped-call]
    with pytest.raises(ValueError, match="a joint is there twice"):
        plot.read_mcap(path)


def test_recording_that_ends_early_is_read_as_far_as_it_goes(virtual: sim.VirtualLing, tmp_path: Path) -> None:
    path, cut = tmp_path / "motion.mcap", tmp_path / "cut.mcap"
    run("record", virtual.port, str(path), "--count", "50")
    whole, written = plot.read_mcap(path), path.read_bytes()
    # Its index is missing, as if `record` had been killed.
    for missing in (1, 20, 40, 100):
        cut.write_bytes(written[:-missing])
        assert plot.read_mcap(cut).time_s.tolist() == whole.time_s.tolist()
    cut.write_bytes(written[: len(written) // 8])
    with pytest.raises(ValueError, match="no poses"):
        plot.read_mcap(cut)


def test_file_that_cannot_be_drawn_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "broken.mcap").write_bytes(b"\x89MCAP0\r\n broken")
    for name in ("broken.mcap", "missing.csv"):
        drawn = draw(str(tmp_path / name), "--save", str(tmp_path / "figure.png"))
        assert drawn.returncode == 1
        assert name in drawn.stderr
        assert drawn.stderr.count("\n") == 1


def test_other_csv_is_an_error(tmp_path: Path) -> None:
    other = tmp_path / "other.csv"
    other.write_text("a,b\n1,2\n")
    with pytest.raises(ValueError, match="no column time_s: is it from `armwire monitor --csv`"):
        plot.read_csv(other)
    header = "time_s," + ",".join(f"joint_{joint}_deg" for joint in range(1, 7)) + ",gripper_percent,latency_us\n"
    other.write_text(header + "0,0,0,0,0,0,0,0,0\n0,x,0,0,0,0,0,0,0\n")
    with pytest.raises(ValueError, match="line 3: could not convert"):
        plot.read_csv(other)
    # The arm did not answer.
    other.write_text(header + "0,0,0,0,0,0,0,0,5\n1,,,,,,,,\n")
    assert np.isfinite(plot.read_csv(other).joints_deg[:, 0]).tolist() == [True, False]


def test_figure_has_one_unit_for_the_gripper() -> None:
    with pytest.raises(ValueError, match="draw one of them"):
        plot.joints([0], np.zeros((1, 6)), [500], gripper_mm=[25])


def test_figure_has_each_joints_values() -> None:
    angles = np.arange(60).reshape(10, 6)
    figure = plot.joints(np.arange(10), angles, np.full(10, 500))
    upper, lower = figure.axes
    for joint, line in enumerate(upper.get_lines()):
        assert line.get_label() == f"joint {joint + 1}"
        np.testing.assert_array_equal(line.get_ydata(), angles[:, joint])
    np.testing.assert_array_equal(lower.get_lines()[0].get_ydata(), np.full(10, 500))
    assert (upper.get_ylabel(), lower.get_xlabel()) == ("angle in degrees", "time in seconds")
    with pytest.raises(ValueError, match="joints have shape"):
        plot.joints([0, 1], angles)


def test_recording_is_drawn_by_its_own_clock() -> None:
    frame = bytes.fromhex("AA06000F0008000800080008000800080000016FFF")
    telemetry = [armwire.Telemetry(stamp, "poll", frame, None) for stamp in (5_000_000, 5_010_000)]
    telemetry.insert(1, armwire.Telemetry(5_005_000, None, b"", {"event": "bus_off", "off": True}))
    recorded = armwire.JointRecording.of(telemetry)
    assert recorded.status.tolist() == [MotionStatus.LOCKED] * 2
    np.testing.assert_array_equal(recorded.joints_rad, np.zeros((2, 6)))
    (line, *_) = plot.recording(recorded).axes[0].get_lines()
    assert np.asarray(line.get_xdata()).tolist() == pytest.approx([0, 0.01])
    assert armwire.JointRecording.of([]).joints_deg.shape == (0, 6)
    assert armwire.JointRecording.of([]).time_s.shape == (0,)


def test_latencies_mark_median_and_99th_percentile() -> None:
    figure = plot.latencies(np.arange(1, 101), title="reads")
    labels = [line.get_label() for line in figure.axes[0].get_lines()]
    assert labels == ["50 %: 50 µs", "99 %: 99 µs"]
    with pytest.raises(ValueError, match="no durations"):
        plot.latencies([])


def test_histogram_of_an_adapter_has_its_counts() -> None:
    counts = np.arange(16)
    (stairs,) = plot.adapter_latencies(counts, title="answer").axes[0].patches
    values, edges, _ = stairs.get_data()  # type: ignore[attr-defined]
    np.testing.assert_array_equal(values, counts)
    assert (edges[0], edges[-1]) == (1, 65536)


def test_recording_has_nan_for_an_invalid_position() -> None:
    body = bytes.fromhex("06000F" + "0010" + "0008" * 5 + "000001")
    frame = b"\xaa" + body + bytes([crc32(body) & 0xFF, 0xFF])
    recorded = armwire.JointRecording.of([armwire.Telemetry(0, None, frame, None)])
    assert recorded.ticks[0, 0] == 4096
    assert np.isnan(recorded.joints_deg[0]).tolist() == [True] + [False] * 5
