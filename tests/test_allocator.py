"""Memory that threads have freed goes back to the operating system."""

from __future__ import annotations

import subprocess
import sys

import pytest

from robocorba import allocator

#: Prints the private memory after twelve threads have held and freed large blocks [MB].
PROGRAM = """
import threading, psutil
from robocorba.allocator import return_freed_memory
assert return_freed_memory()
before = psutil.Process().memory_full_info().uss
kept = []
def hold():
    for _ in range(20):
        large = b"x" * 16_000_000
        kept.append(b"y" * 2000)  # above the large block, where both are in a heap
        del large
threads = [threading.Thread(target=hold) for _ in range(12)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
print((psutil.Process().memory_full_info().uss - before) / 1e6)
"""

#: Prints the private memory before and after `trim` [MB], once small blocks below one that stays were freed.
MANY_SMALL = """
import psutil
from robocorba.allocator import return_freed_memory, trim
assert return_freed_memory()
kept = [b"x" * 5000 for _ in range(5000)]
kept = kept[-1:]
process = psutil.Process()
print(process.memory_full_info().uss / 1e6)
trim()
print(process.memory_full_info().uss / 1e6)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="of glibc")
def test_freed_blocks_of_threads_are_returned() -> None:
    found = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True, timeout=120)
    assert float(found.stdout) < 2 * allocator.LARGE_BYTES / 1e6


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="of glibc")
def test_freed_pages_below_what_stays_are_returned() -> None:
    found = subprocess.run([sys.executable, "-c", MANY_SMALL], capture_output=True, text=True, check=True, timeout=120)
    before, after = map(float, found.stdout.split())
    assert after < before - 20.0
