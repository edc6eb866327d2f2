"""robocorba record: records the changes of floors of the running simulation to a file."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from robocorba.commands.options import Naming, connected
from robocorba.commands.waiting import RESOLVE_TIMEOUT_S, RETRY_TIMEOUT_S, Outage, StopSignal, progress
from robocorba.corba.remote.omni_database import RemoteFloors
from robocorba.errors.services import NotReachable
from robocorba.maps import native
from robocorba.printing import echo
from robocorba.simulation.recording import Recorder
from robocorba.stubs import RoboCorba

#: Interval between requests for changes [s].
POLL_INTERVAL_S = 0.05
#: Maximum gap between two recorded updates of a floor [s].
MAX_GAP_S = 1.0
#: Time for which the command retries while a server does not answer [s].
OUTAGE_LIMIT_S = 30.0


def record(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="The recording to write, such as monday.mcap.")],
    floor: Annotated[list[str] | None, typer.Option(metavar="F", help="Record this floor only; repeatable.")] = None,
    seconds: Annotated[float, typer.Option(metavar="S", min=0.0, help="Duration [s]; 0: until Ctrl-C.")] = 0.0,
    force: Annotated[bool, typer.Option("--force", help="Overwrite an existing file.")] = False,
    naming: Naming = None,
) -> None:
    """Record changes of floors of the running simulation, up to 20 times a second, until Ctrl-C or SIGTERM or for
    --seconds."""
    with connected("record", naming) as orb:
        stop = StopSignal()
        floors = floor or []
        RemoteFloors(orb, floors).follow(RESOLVE_TIMEOUT_S)  # reports errors before a file is created
        editor = orb.resolve("MapEditor", RoboCorba.MapEditor, RESOLVE_TIMEOUT_S)
        recorder = Recorder(file, native.loads(editor.exportMap(), "the served map"), overwrite=force)
        try:
            with recorder:
                record_changes(RemoteFloors(orb, floors), recorder, seconds, stop)
        finally:
            echo(f"wrote {file}: {recorder.count} updates, {recorder.size} bytes")


def record_changes(
    floors: RemoteFloors, recorder: Recorder, seconds: float, stop: StopSignal, outage_limit_s: float = OUTAGE_LIMIT_S
) -> None:
    """Record changes until stopped. Raises UnknownFloor, InvalidRecording, NotReachable."""
    outage = Outage(outage_limit_s)
    began = time.time()
    written_at: dict[str, float] = {}
    with progress(seconds) as bar:
        for passed_s in stop.ticks(POLL_INTERVAL_S, seconds):
            try:
                updates = floors.follow(RETRY_TIMEOUT_S)
                outage.note_answer()
            except NotReachable as error:
                bar(passed_s, outage.note_failure(error))
                continue
            for update in updates:
                # Unchanged floors are recorded too, if rarely, to record the passing of time.
                if update.version != update.since or passed_s - written_at[update.floor] >= MAX_GAP_S:
                    recorder.write(update, began + passed_s)
                    written_at[update.floor] = passed_s
            simulated_s = max((update.time for update in updates), default=0.0)
            bar(passed_s, f"simulated time {simulated_s:.1f} s, {recorder.count} updates, {recorder.size} bytes")
