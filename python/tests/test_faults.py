"""Faults on the line, lost ports, and Ctrl-C."""

import os
import signal
import subprocess
import sys
import textwrap
import threading
import time

import pytest

import armwire
from armwire import errors, sim

# The target of `cargo xtask python --reads`.
READS = int(os.environ.get("ARMWIRE_READS", "2000"))
# Maximum duration of a read of a silent arm, plus a margin for a busy machine.
LONGEST_S = 2.0
POSE = [10.0, -20.0, 30.0, 0.0, 45.0, -90.0]


@pytest.mark.parametrize(
    "faults",
    [
        sim.Faults(drop=1000),
        sim.Faults(corrupt=1000),
        sim.Faults(duplicate=1000),
        sim.Faults(delay=1000),
        sim.Faults(noise=1000),
        sim.Faults(drop=200, corrupt=200, duplicate=200, delay=200, noise=200),
    ],
    ids=["drop", "corrupt", "duplicate", "delay", "noise", "all"],
)
def test_faults_never_produce_a_wrong_value(faults: sim.Faults) -> None:
    with sim.ling(plant="ideal", leader=True, turnaround_us=0, seed=7) as virtual, armwire.Ling(virtual.port) as arm:
        virtual.push_joints_deg(POSE)
        virtual.push_gripper_permille(321)
        truth = virtual.joints()
        virtual.set_faults(faults)
        correct = failed = 0
        longest = 0.0
        for _ in range(READS // 6 + 1):
            begun = time.monotonic()
            try:
                state = arm.read_joints()
            except (errors.NoAnswerError, errors.UnacceptableError, errors.RefusedError):
                failed += 1
            else:
                assert state == truth
                correct += 1
            longest = max(longest, time.monotonic() - begun)
        injected = virtual.injected()
    print(f"{correct} correct, {failed} without an answer, longest {longest:.3f} s, {injected}")
    assert correct > 0.9 * (correct + failed)
    assert longest < LONGEST_S
    assert sum(injected.counts()) > 0


def test_call_ends_if_every_byte_is_dropped() -> None:
    with sim.ling(plant="ideal") as virtual, armwire.Ling(virtual.port) as arm:
        virtual.set_faults(sim.Faults(drop=1_000_000))
        begun = time.monotonic()
        with pytest.raises(errors.AbsentError):
            arm.read_joints()
        assert time.monotonic() - begun < LONGEST_S


def test_unplugged_port_is_lost_and_stays_lost(virtual: sim.VirtualLing, arm: armwire.Ling) -> None:
    arm.read_joints()
    virtual.close()
    for _ in range(3):
        with pytest.raises(errors.PortLostError, match="was it unplugged"):
            arm.read_joints()


def test_port_lost_in_a_call_ends_the_call() -> None:
    with sim.ling(plant="ideal", turnaround_us=2_000_000) as virtual, armwire.Ling(virtual.port) as arm:
        timer = threading.Timer(0.05, virtual.close)
        timer.start()
        begun = time.monotonic()
        with pytest.raises((errors.PortLostError, errors.AbsentError)):
            arm.read_joints()
        assert time.monotonic() - begun < LONGEST_S
        timer.join()


def test_ctrl_c_ends_a_call_at_once() -> None:
    # An xArm's raw register waits 10 s for its answer; this server gives none.
    script = textwrap.dedent(
        """
        import signal, socket, time, armwire
        # A shell's background job inherits SIGINT as ignored.
        signal.signal(signal.SIGINT, signal.default_int_handler)
        server = socket.create_server(("127.0.0.1", 0))
        with armwire.XArm("127.0.0.1:%d" % server.getsockname()[1]) as arm:
            print("waiting", flush=True)
            begun = time.monotonic()
            try:
                arm.raw(42)
            except KeyboardInterrupt:
                print("interrupted after", time.monotonic() - begun, flush=True)
        """
    )
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "waiting\n"
        time.sleep(0.3)
        process.send_signal(signal.SIGINT)
        line = process.stdout.readline()
    assert line.startswith("interrupted after")
    assert float(line.split()[-1]) < 5
    assert process.returncode == 0


def test_handled_signal_does_not_end_a_call() -> None:
    handled: list[int] = []
    before = signal.signal(signal.SIGALRM, lambda number, frame: handled.append(number))
    try:
        with sim.ling(plant="ideal", turnaround_us=40_000) as virtual, armwire.Ling(virtual.port) as arm:
            signal.setitimer(signal.ITIMER_REAL, 0.01, 0.01)
            for _ in range(20):
                assert arm.read_joints().ticks == (2048,) * 6
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    assert len(handled) > 10


def test_command_is_in_the_package() -> None:
    def armwire_command(*args: str) -> subprocess.CompletedProcess[str]:
        program = [sys.executable, "-c", "from armwire._command import main; main()"]
        return subprocess.run([*program, *args], capture_output=True, text=True, check=False)

    with sim.ling(plant="ideal") as virtual:
        info = armwire_command("info", virtual.port)
        assert info.returncode == 0
        assert "Ling follower" in info.stdout
        call = armwire_command("call", "ling", virtual.port, "read-stroke")
        assert call.stdout == "stroke: 50 mm\n"
    missing = armwire_command("info", "/dev/no-such-port")
    assert missing.returncode == 1
    assert "no such port" in missing.stderr
    assert armwire_command("dance").returncode == 2


def test_command_ends_by_ctrl_c() -> None:
    program = [sys.executable, "-c", "from armwire._command import main; main()", "sim", "ling"]
    with subprocess.Popen(program, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert "is at" in process.stdout.readline()
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=10) == 0
