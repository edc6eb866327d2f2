"""Stands in for the process that compiles kernels. COMPILE_AS says what it does."""

from __future__ import annotations

import os
import sys
import time

if __name__ == "__main__":
    if os.environ["COMPILE_AS"] == "wait":
        time.sleep(600.0)
    print("house.grids.first\nsome library says so", flush=True)
    if os.environ["COMPILE_AS"] == "fail":
        sys.exit("out of memory")
    print("house.grids.second", flush=True)
