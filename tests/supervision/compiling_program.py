"""Stands in for the processes that compile kernels. COMPILE_AS says what they do."""

from __future__ import annotations

import os
import sys
import time

if __name__ == "__main__":
    print("ready", flush=True)
    if os.environ["COMPILE_AS"] == "wait":
        time.sleep(600.0)
    print("house.grids.first 1.5\nsome library says so\nhouse.grids.first 0.5", flush=True)
    if os.environ["COMPILE_AS"] == "fail":
        sys.exit("out of memory")
    print("house.grids.second 0.25", flush=True)
