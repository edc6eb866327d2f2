"""Processes on machines whose wall clocks are wrong, or are set while they run."""

from __future__ import annotations

import contextlib
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from testkit.processes import Launcher, forked_processes

SOURCE = Path(__file__).with_name("wrong_clock.c")
HOUR_S, YEAR_S = 3600.0, 365 * 86400.0
#: How far a clock is set, or is ahead [s].
JUMPS_S = (1.0, -1.0, HOUR_S, -HOUR_S, YEAR_S, -YEAR_S)


class Clocks:
    """How far the clocks of processes are ahead; see wrong_clock.c."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def set(self, pid: int, ahead_s: float) -> None:
        """Set the clock of a process."""
        self._write(str(pid), ahead_s)

    def set_others(self, ahead_s: float) -> None:
        """Set the clocks of all processes that have not been set, also of those to be started."""
        self._write("all", ahead_s)

    def _write(self, name: str, ahead_s: float) -> None:
        new = self._folder / "new"
        new.write_text(str(ahead_s))
        new.replace(self._folder / name)


@contextlib.contextmanager
def wrong_clocks(folder: Path) -> Iterator[Clocks]:
    """The clocks of the processes that are started inside the `with`."""
    library, clocks = folder / "wrong_clock.so", folder / "clocks"
    clocks.mkdir()
    try:
        command = ("cc", "-O2", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", "-o", str(library), str(SOURCE))
        subprocess.run(command, check=True)
    except FileNotFoundError:
        pytest.skip("no C compiler is installed")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("LD_PRELOAD", str(library))
        patch.setenv("CLOCKS", str(clocks))
        patch.setattr(Launcher, "nursery", None)  # its forks would have the right clock
        with forked_processes():
            yield Clocks(clocks)
