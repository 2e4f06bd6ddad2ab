"""The table of programs and scenes on a page, between two comments."""

import re
from concurrent.futures import Executor
from pathlib import Path

from runs import HERE, Pythons, run, settled
from scenes import SCENES

START, END = "<!-- programs: start -->\n", "<!-- programs: end -->\n"
# The files in `programs`, with the name and the package of each program.
PROGRAMS = {
    "lerobot_bus": ("LeRobot", "lerobot"),
    "feetech_servo_sdk": ("feetech-servo-sdk", "feetech-servo-sdk"),
    "ftservo_python_sdk": ("ftservo-python-sdk", "ftservo-python-sdk"),
    "rustypot_controller": ("rustypot", "rustypot"),
    "st3215_buses": ("st3215-bus", "st3215-bus"),
    "feetech_cli_controller": ("feetech-cli", "feetech-cli"),
}
FOLLOWER = "lerobot_follower"


def checked(page: Path, pythons: Pythons, workers: Executor, is_new: bool) -> str:
    """The page with the results of all scenes and programs. New ones do not depend on those of the page."""
    before, rest = page.read_text().split(START)
    old, after = rest.split(END)
    return before + START + section({} if is_new else cells(old), pythons, workers) + END + after


def section(old: dict[str, list[str]], pythons: Pythons, workers: Executor) -> str:
    """The section, where `old` has the cells of each row that are expected."""

    def cell(program: str, scene: str, title: str) -> str:
        expected = dict(zip(PROGRAMS, old.get(title, []), strict=False)).get(program)
        return settled(
            f"{program}, {scene}", lambda: run(pythons.of(program), HERE / "scene.py", program, scene), expected
        )

    results = {
        scene.title: [workers.submit(cell, program, name, scene.title) for program in PROGRAMS]
        for name, scene in SCENES.items()
    }
    expected = "\n".join(f"{step}|{result}" for step, (result, *_) in old.items() if step.startswith("`")) or None
    steps = workers.submit(settled, FOLLOWER, lambda: run(pythons.most, HERE / f"{FOLLOWER}.py"), expected)
    versions, date = pinned()
    names = [f"{name} {versions[package]}" for name, package in PROGRAMS.values()]
    rows = [[title, *(one.result() for one in row)] for title, row in results.items()]
    follower = [line.split("|") for line in steps.result().splitlines()]
    return (
        f"\nVersions were last raised on {date}.\n\n"
        + table(["Scene", *names], rows)
        + "\n"
        + table(["Step of LeRobot's `SOFollower`", "Result"], follower)
        + "\n"
    )


def pinned() -> tuple[dict[str, str], str]:
    """The versions of the lists of requirements, and the date at which they were last raised."""
    lists = "".join((HERE / name).read_text() for name in ("requirements.txt", "requirements-ftservo.txt"))
    (date,) = re.findall(r"last raised on (\S+)\.\n", lists)
    return dict(re.findall(r"^(\S+)==(\S+)$", lists, re.MULTILINE)), date


def table(head: list[str], rows: list[list[str]]) -> str:
    """A table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return (
        "".join("| " + " | ".join(line) + " |\n" for line in lines).replace("| --- ", "|---").replace("--- |", "---|")
    )


def cells(section: str) -> dict[str, list[str]]:
    """The rows of the tables, by their first cell."""
    rows = (line.strip("| ").split(" | ") for line in section.splitlines() if line.startswith("| "))
    return {first: rest for first, *rest in rows}
