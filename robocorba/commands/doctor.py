"""robocorba doctor: what a report of a defect needs, and what is wrong here."""

from __future__ import annotations

import os
import platform
import shutil
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import typer

from robocorba import __version__
from robocorba.commands import event_stats, status
from robocorba.commands.options import Json, Naming, State
from robocorba.commands.reporting import reporting
from robocorba.commands.tables import Sheet, print_json, show
from robocorba.orb.orb import OMNIORB, Orb
from robocorba.system.endpoints import is_free, user_of
from robocorba.system.extras import missing
from robocorba.system.instances import port_to_start
from robocorba.system.kernel_store import store
from robocorba.system.names import CHANNELS
from robocorba.system.settings import Address, Settings
from robocorba.system.state_folder import StateFolder, running_instances
from robocorba.system.supervision.system import find_omninames

#: Memory or disk space below which systems fail [bytes].
LOW = 256 * 2**20


def doctor(json: Json = False, naming: Naming = None, state: State = None) -> None:
    """Check versions, machine, state folder, ports, processes and channels, and print them for a bug report.

    Exit code 0 if nothing is wrong, else 1."""
    with reporting("doctor"):
        settings = Settings.read(naming=naming, state=state, choose_port=port_to_start)
        record = StateFolder(settings.state).read_record()
        facts, processes, channels = [*_versions(), *_machine(), *_places(settings)], [], {}
        if record is not None and record.is_alive:
            processes = status.check_objects(record)
            with Orb(Address.parse(record.naming)) as orb:
                channels = event_stats.query(orb, orb.names(CHANNELS))
    titles = ("what", "found", "problem")
    if json:
        found = [dict(zip(titles, fact, strict=True)) for fact in facts]
        channels = {name: event_stats.as_json(state) for name, state in channels.items()}
        print_json({"facts": found, "processes": processes, "channels": channels})
    else:
        more = [status.sheet_of(processes), *event_stats.sheets(channels)] if processes else []
        show(Sheet(titles, facts), *more)
    if any(problem for _, _, problem in facts) or not all(process.is_healthy for process in processes):
        raise typer.Exit(1)


# Facts: what, what was found, and what is wrong with it, empty if nothing is.


def _versions() -> Iterator[tuple[str, str, str]]:
    yield "robocorba", f"{__version__} in {Path(__file__).parents[1]}", ""
    yield "Python", f"{platform.python_version()}, {platform.platform()}", ""
    yield "omniORB", f"{OMNIORB}; {find_omninames()}", ""
    for extra in ("films", "maps", "smartpal", "console", "foxglove", "ros2"):
        if absent := missing(extra):
            yield f"extra {extra}", f"without {', '.join(absent)}", ""


def _machine() -> Iterator[tuple[str, str, str]]:
    free = psutil.virtual_memory().available
    cores = f"{len(os.sched_getaffinity(0))} cores, load {os.getloadavg()[0]:.1f}"
    yield "machine", f"{free / 2**30:.1f} GiB are free; {cores}", "too little memory" if free < LOW else ""
    yield "clock", time.strftime("%Y-%m-%d %H:%M:%S %z"), ""
    yield "kernels", "compiled" if store().is_complete else "not all compiled yet", ""


def _places(settings: Settings) -> Iterator[tuple[str, str, str]]:
    """State folder and ports."""
    folder, naming = settings.state, settings.naming
    is_used = naming.is_loopback and not is_free(naming.host, naming.port)
    used = user_of(naming.port) if is_used else "nothing on this machine"
    has_port = folder.exists() or not settings.instance
    where = f"{naming}, from {settings.origin}; used by {used}" if has_port else "a free port, which `up` will choose"
    yield "naming service", where, ""
    yield "instances that run", ", ".join(running_instances()) or "none", ""
    yield "state folder", str(folder) if folder.exists() else f"{folder}, which `robocorba up` makes", ""
    if folder.exists():
        free, damaged = shutil.disk_usage(folder).free, ", ".join(file.name for file in folder.rglob("*.damaged"))
        yield "disk", f"{free / 2**30:.1f} GiB are free", "too little" if free < LOW else ""
        yield "damaged files", damaged or "none", "docs/operations.md#damaged-files" if damaged else ""
