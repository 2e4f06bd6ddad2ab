"""Runs one scene with one program, and prints the result.

Usage: scene.py PROGRAM SCENE
"""

import importlib
import sys

from scenes import SCENES, run

if __name__ == "__main__":
    program, scene = sys.argv[1:]
    print(run(importlib.import_module(f"programs.{program}").Program, SCENES[scene]))
