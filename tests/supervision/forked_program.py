"""A module for the warm parent: tells what its process looks like as a line of JSON, then waits for its end.

With the argument "ends" it exits with 3."""

from __future__ import annotations

import json
import os
import random
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

preloaded_in: list[int] = []


def preload() -> None:
    preloaded_in.append(os.getpid())


def main(arguments: Sequence[str]) -> None:
    descriptors = [int(file.name) for file in list(Path("/proc/self/fd").iterdir()) if file.exists()]  # but its own
    seen = {
        "pid": os.getpid(),
        "parent": os.getppid(),
        "session": os.getsid(0),
        "folder": str(Path.cwd()),
        "arguments": sys.argv[1:],
        "descriptors": sorted(descriptors),
        "threads": len(list(Path("/proc/self/task").iterdir())),
        "randoms": [random.random(), float(np.random.random())],
        "preloaded_in": preloaded_in,
    }
    print(json.dumps(seen), flush=True)
    if "ends" in arguments:
        sys.exit(3)
    time.sleep(600)
