"""robocorba record: records the running simulation to a file."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated

import typer

from robocorba.commands.options import Floors, Force, Naming, connected, served_building
from robocorba.commands.waiting import RESOLVE_TIMEOUT_S, RETRY_TIMEOUT_S, Outage, StopSignal, progress
from robocorba.console.corba.live_system import LiveSystem, live_system
from robocorba.errors.services import NotReachable
from robocorba.map_editor.model import Building
from robocorba.simulation.corba.remote_database import RemoteFloors
from robocorba.simulation.system_changes import SystemChanges
from robocorba.system.extras import require_extra
from robocorba.system.printing import echo

#: Interval between requests for changes [s].
POLL_INTERVAL_S = 0.05
#: Time for which the command retries while a server does not answer [s].
OUTAGE_LIMIT_S = 30.0
#: Writes what was received at a POSIX time [s].
Write = Callable[[SystemChanges, float], None]


def record(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Recording to write, such as monday.mcap.")],
    floor: Floors = None,
    seconds: Annotated[float, typer.Option(metavar="S", min=0.0, help="Length [s]; 0: until Ctrl-C.")] = 0.0,
    scans: Annotated[bool, typer.Option("--scans/--no-scans", help="Record scans of robots' sensors.")] = True,
    foxglove: Annotated[
        bool, typer.Option("--foxglove", help="Write messages for Foxglove, not for `replay`.")
    ] = False,
    force: Force = False,
    naming: Naming = None,
) -> None:
    """Record floors, postures, scans and missions of the running simulation, until Ctrl-C or SIGTERM."""
    with connected("record", naming) as orb:
        require_extra("foxglove" if foxglove else "recordings", "recordings")
        floors = floor or []
        RemoteFloors(orb, floors).follow(RESOLVE_TIMEOUT_S)  # reports errors before a file is created
        stop = StopSignal()
        recording = foxglove_file if foxglove else compact_file
        with (
            contextlib.closing(live_system(orb, floors, with_scans=scans)) as system,
            recording(file, served_building(orb, RESOLVE_TIMEOUT_S), force) as write,
        ):
            record_changes(system, write, seconds, stop)


@contextlib.contextmanager
def compact_file(file: Path, building: Building, overwrite: bool) -> Iterator[Write]:
    """Writes a compact recording. Raises InvalidRecording."""
    from robocorba.simulation.recording import Recorder

    recorder = Recorder(file, building, overwrite)
    try:
        with recorder:
            yield recorder.write_changes
    finally:
        echo(f"wrote {file}: {recorder.count} updates, {recorder.size} bytes")


@contextlib.contextmanager
def foxglove_file(file: Path, building: Building, overwrite: bool) -> Iterator[Write]:
    """Writes Foxglove's messages. Raises InvalidRecording."""
    from robocorba.bridges.foxglove.files import FoxgloveFile

    with contextlib.closing(FoxgloveFile(file, building, overwrite)) as written:
        yield written.write_changes
    echo(f"wrote {file}: {file.stat().st_size} bytes")


def record_changes(
    system: LiveSystem, write: Write, seconds: float, stop: StopSignal, outage_limit_s: float = OUTAGE_LIMIT_S
) -> None:
    """Record changes until stopped. Raises UnknownFloor, InvalidRecording, NotReachable."""
    outage = Outage(outage_limit_s)
    began = time.time()
    count = 0
    with progress(seconds) as bar:
        for passed_s in stop.ticks(POLL_INTERVAL_S, seconds):
            try:
                changes = system.follow(RETRY_TIMEOUT_S)
                outage.note_answer()
            except NotReachable as error:
                bar(passed_s, outage.note_failure(error))
                continue
            write(changes, began + passed_s)
            count += sum(len(each) for each in changes)
            simulated_s = max((update.time for update in changes.updates), default=0.0)
            bar(passed_s, f"simulated time {simulated_s:.1f} s, {count} messages")
