"""robocorba watch: shows the simulation server in the terminal, and films its floors."""

from __future__ import annotations

import contextlib
import io
import math
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated

import typer
from rich.live import Live

from robocorba.commands.options import Floors, Naming, connected, only_for
from robocorba.commands.simulation_tables import RunningSimulation, Tables, as_json, sheets, with_note
from robocorba.commands.tables import print_json, show
from robocorba.commands.waiting import RESOLVE_TIMEOUT_S, RETRY_TIMEOUT_S, Outage, StopSignal, progress
from robocorba.errors.services import NotReachable
from robocorba.orb.orb import Orb
from robocorba.simulation.corba.remote_database import RemoteDatabase
from robocorba.simulation.corba.remote_simulation import simulation_server
from robocorba.system.extras import require_extra
from robocorba.system.printing import Console, echo, line
from robocorba.system.settings import InvalidSetting

#: Interval between updates of the tables in a terminal [s].
SHOW_INTERVAL_S = 0.25


def watch(
    context: typer.Context,
    floor: Floors = None,
    once: Annotated[bool, typer.Option("--once", help="Print the tables once and exit.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print JSON once and exit.")] = False,
    video: Annotated[Path | None, typer.Option(metavar="FILE", help="Film one floor into this MP4 file.")] = None,
    seconds: Annotated[
        float, typer.Option(metavar="S", min=0.0, help="Length of the video [s]; 0: until Ctrl-C.")
    ] = 0.0,
    fps: Annotated[int, typer.Option(metavar="N", min=1, max=60, help="Frames per second of the video.")] = 10,
    width: Annotated[int, typer.Option(metavar="PX", min=200, max=4096, help="Width of the video [pixels].")] = 960,
    naming: Naming = None,
) -> None:
    """Show the simulation server, robots, elevators and sensors, live, until Ctrl-C."""
    only_for("--video", video, context, "seconds", "fps", "width")
    only_for("tables", not video, context, "once", "json")
    floors = floor or []
    with connected("watch", naming) as orb:
        if video:
            film(Camera(orb, floors, width), video, seconds, fps, StopSignal())
            return
        with contextlib.closing(RunningSimulation(orb, floors)) as simulation:
            tables = simulation.read(RESOLVE_TIMEOUT_S)
            if json:
                print_json(as_json(tables))
            elif once:
                show(*sheets(tables))
            else:
                follow(simulation, tables, StopSignal())


def follow(simulation: RunningSimulation, tables: Tables, stop: StopSignal) -> None:
    """Show tables until stopped, in a terminal in the place of the former ones, in a pipe one after the other with an
    empty line between. Raises UnknownFloor, NotReachable."""
    outage, is_terminal = Outage(), Console().is_terminal
    with Live(auto_refresh=False) if is_terminal else contextlib.nullcontext() as live:
        for _ in stop.ticks(SHOW_INTERVAL_S if is_terminal else 1.0):
            note, was_active = "", outage.is_active
            try:
                tables = simulation.read()
                outage.note_answer()
            except NotReachable as error:
                note = outage.note_failure(error)
                if not (live or was_active):
                    line(f"robocorba watch: {error}; waiting", err=True)
            if live:
                live.update(with_note(tables, note), refresh=True)
            elif not note:
                show(*sheets(tables))
                echo()


class Camera:
    """Pictures of a floor, by default the first, rendered by the simulation server."""

    def __init__(self, orb: Orb, floors: Sequence[str], width_px: int) -> None:
        if len(floors) > 1:
            raise InvalidSetting("--floor", ", ".join(floors), "a video shows one floor")
        self._width_px = width_px
        self._database = RemoteDatabase(orb, RETRY_TIMEOUT_S)
        # The first picture of a floor takes two seconds of a processor that others may use.
        self._server = simulation_server(orb, RETRY_TIMEOUT_S, call_timeout_s=60.0)
        self._floor = floors[0] if floors else ""

    def png(self, resolve_timeout_s: float = RETRY_TIMEOUT_S) -> bytes:
        """Render the floor now. Raises UnknownFloor, InvalidPicture, NotReachable."""
        if not self._floor:
            self._database.set_resolve_timeout(resolve_timeout_s)
            self._floor = self._database.floors()[0]
        self._server.resolve_timeout_s = resolve_timeout_s
        return bytes(self._server.call(lambda server: server.renderFloor(self._floor, self._width_px)))


def film(
    camera: Camera, file: Path, seconds: float, fps: int, stop: StopSignal, clock: Callable[[], float] = time.monotonic
) -> None:
    """Film the running simulation; the video is playable however the recording ends. While no picture arrives, the
    video shows the one before. clock: monotonic [s].

    Raises UnknownFloor, InvalidPicture, OutputError, ServiceError without the extra films."""
    require_extra("films", "films")
    from PIL import Image  # imported here, since it takes a second to load

    from robocorba.console.video import VideoFile

    outage, limit_s = Outage(), seconds or math.inf
    tick_s, ticked_at = 0.0, clock()
    picture = camera.png(RESOLVE_TIMEOUT_S)
    video = VideoFile(file, *Image.open(io.BytesIO(picture)).size, fps)

    def passed_s(least_s: float = 0.0) -> float:
        return min(tick_s + max(least_s, clock() - ticked_at), limit_s)

    try:
        with video, progress(seconds) as bar:
            video.show(picture, 0.0)
            try:
                for tick in stop.ticks(1 / fps, seconds):
                    tick_s, ticked_at = tick, clock()
                    try:
                        picture, note = camera.png(), ""
                        outage.note_answer()
                    except NotReachable as error:
                        note = outage.note_failure(error)
                    else:
                        video.show(picture, passed_s())  # it may have arrived long after the tick
                    bar(passed_s(), note or f"{video.count} pictures")
            finally:
                video.hold(passed_s(1 / fps))
    finally:
        width, height = video.size
        echo(f"wrote {file}: {video.count / fps:.1f} s, {video.count} pictures of {width} x {height}")
