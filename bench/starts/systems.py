"""Systems of two versions, to be measured side by side: the code of this checkout, and that of an earlier commit."""

from __future__ import annotations

import contextlib
import functools
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import psutil

from robocorba.system.claimed_ports import claimed_ports
from testkit.json_process import ROOT, ProcessFailed
from testkit.processes import Launcher, Running, drain, real_system

#: The last commit before the warm parent.
BASE = "0b73a1a"
OURS = "ours"
#: Time for a system to settle after its start [s].
SETTLE_S = 3.0
#: Servers by their objects. `robocorba up` starts them by default.
SERVERS = {
    "map_editor": "MapEditor",
    "simulation": "SimulationServer",
    "sensor_s1": "VirtualSensors/s1",
    "events_main": "EventChannels/main",
}
T = TypeVar("T")


@dataclass(frozen=True)
class Version:
    """A version of RoboCorba. source: the folder that is first on the import path of its processes. cache: of compiled
    kernels, which stay for the next run; versions do not share one, since each may remove what it does not know."""

    name: str
    source: Path
    cache: Path


def versions(base: str) -> list[Version]:
    """This checkout, and beside it a commit, unless `base` is empty. Raises ProcessFailed."""
    ours = Version(OURS, ROOT, _lasting_folder(OURS))
    return [ours, _checked_out(base)] if base else [ours]


def _lasting_folder(name: str) -> Path:
    """A folder that stays for the next run."""
    folder = Path(tempfile.gettempdir()) / f"robocorba-bench-{os.getuid()}" / name
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _checked_out(commit: str) -> Version:
    """The version of a commit, with its files and stubs in a folder.

    Files are as old as the commit, and stay where they are, so that its compiled kernels stay valid."""
    found = subprocess.run(
        ["git", "rev-parse", "--verify", f"{commit}^{{commit}}"], cwd=ROOT, capture_output=True, text=True
    )
    if found.returncode:
        raise ProcessFailed(f"{commit} is no commit of this repository: {found.stderr.strip()}")
    lasting = _lasting_folder(found.stdout.strip())
    folder = lasting / "source"
    if not (folder / "robocorba" / "stubs").is_dir():
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        with subprocess.Popen(["git", "archive", found.stdout.strip()], cwd=ROOT, stdout=subprocess.PIPE) as archive:
            subprocess.run(["tar", "-x"], cwd=folder, stdin=archive.stdout, check=True)
        subprocess.run([sys.executable, "idl/make_stubs.py", "robocorba/stubs"], cwd=folder, check=True)
    return Version(commit, folder, lasting / "cache")


class System:
    """A `robocorba up` of a version."""

    def __init__(self, version: Version, running: Running, launch: Launcher) -> None:
        self.version, self.running, self.launch = version, running, launch
        self._up = psutil.Process(running.process.pid)

    @property
    def processes(self) -> list[psutil.Process]:
        """`robocorba up`, and all below it."""
        return [self._up, *self._up.children(recursive=True)]

    def cpu_s(self) -> float:
        """CPU time of all its processes so far, those that have ended included [s]."""
        spent = 0.0
        for process in self.processes:
            with contextlib.suppress(psutil.NoSuchProcess):
                spent += sum(process.cpu_times()[:4])  # of the process and of its children that have ended
        return spent

    def endpoint(self, server: str) -> str:
        """HOST:PORT where a server listens."""
        return next(process.endpoint for process in self.running.record().processes if process.name == server)

    def is_running(self, server: str) -> bool:
        """Whether the supervisor considers a server ready."""
        return any(row.name == server and row.state == "running" for row in self.running.record().processes)


@contextlib.contextmanager
def system(version: Version, state: Path, *options: str, **environment: str) -> Iterator[System]:
    """A system that has just become ready. environment: added to that of this process and of its version."""
    state.mkdir(parents=True, exist_ok=True)
    with claimed_ports() as port, Launcher(state.parent) as launch:
        own = {"PYTHONPATH": str(version.source), "XDG_CACHE_HOME": str(version.cache)}
        start = functools.partial(launch, **{**own, **environment})
        running = real_system(start, state, port, *options)
        try:
            yield System(version, running.wait_ready(), launch)
        finally:
            if running.process.poll() is None:
                drain(running.process)
                running.stop()


@contextlib.contextmanager
def systems(base: str, folder: Path, *options: str) -> Iterator[list[System]]:
    """Systems of both versions at the same time, each with its state in a folder named after it."""
    with contextlib.ExitStack() as stack:
        found = []
        for version in versions(base):
            one = stack.enter_context(system(version, folder / version.name / "state", *options))
            drain(one.running.process)
            found.append(one)
        time.sleep(SETTLE_S)
        yield found


def load() -> float:
    """Number of processes that ran or waited for a core, on average over the last minute."""
    return os.getloadavg()[0]


def median(values: Sequence[float]) -> float:
    return float(statistics.median(values))


def ratio(found: dict[str, T], value: Callable[[T], float]) -> float | None:
    """Our value by that of the base; None without a base."""
    ours, *base = found.values()
    return value(ours) / value(base[0]) if base else None
