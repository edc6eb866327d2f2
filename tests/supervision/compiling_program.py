"""Stands in for the process that compiles kernels. COMPILE_AS says what it does, KERNELS in which folder."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path


def keep(name: str) -> None:
    path = Path(os.environ["KERNELS"]) / "house_0" / f"grids.{name}-1.py311.nbi"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch()


if __name__ == "__main__":
    if os.environ["COMPILE_AS"] == "wait":
        time.sleep(600.0)
    keep("first")
    if os.environ["COMPILE_AS"] == "fail":
        sys.exit("out of memory")
    if os.environ["COMPILE_AS"] != "on a full disk":
        keep("second")
