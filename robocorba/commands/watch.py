"""robocorba watch: the simulation server in the terminal, and films of its floors."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from omniORB import CORBA
from rich.console import Console
from rich.live import Live

from robocorba.commands.reporting import reporting
from robocorba.commands.scene import System, SystemTables, as_json, as_tables, show
from robocorba.commands.waiting import FIND_AGAIN_S, FIND_S, Absence, Stop, progress
from robocorba.corba.calls import describe
from robocorba.corba.conversion import errors as idl_errors
from robocorba.corba.orb import Orb
from robocorba.corba.remote.floors import CALL_LIMIT_S
from robocorba.errors.services import NotReachable
from robocorba.settings import InvalidSetting, Settings
from robocorba.stubs import RoboCorba

#: How often tables are shown, without a terminal printed.
SHOW_INTERVAL_S, PRINT_INTERVAL_S = 0.25, 1.0
#: Longest drawing of a picture; the first one of a floor takes a while.
PICTURE_LIMIT_S = 15.0


def watch(
    floor: Annotated[list[str] | None, typer.Option(metavar="F", help="Show this floor only; repeatable.")] = None,
    once: Annotated[bool, typer.Option("--once", help="Print it once and end.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print it once, as JSON.")] = False,
    video: Annotated[Path | None, typer.Option(metavar="FILE", help="Film a floor into this MP4 file.")] = None,
    seconds: Annotated[float, typer.Option(metavar="S", min=0.0, help="Film so long; 0: until Ctrl-C.")] = 0.0,
    fps: Annotated[int, typer.Option(metavar="N", min=1, max=60, help="Pictures a second of the video.")] = 10,
    width: Annotated[int, typer.Option(metavar="PX", help="Width of the video.")] = 960,
    naming: Annotated[
        str | None, typer.Option(metavar="HOST:PORT", help="The naming service [ROBOCORBA_NAMING, 127.0.0.1:2809].")
    ] = None,
) -> None:
    """Show the simulation server, its robots, elevators and sensors, until Ctrl-C."""
    floors = floor or []
    with reporting("watch"), Orb(Settings.read(naming=naming).naming) as orb:
        stop = Stop()
        if video:
            film(Camera(orb, floors, width), video, seconds, fps, stop)
            return
        system = System(orb, floors)
        scene = system.look(FIND_S)
        if json:
            print(as_json(scene))
        elif once:
            show(scene)
        elif Console().is_terminal:
            show_live(system, scene, stop)
        else:
            print_tables(system, scene, stop)


def show_live(system: System, scene: SystemTables, stop: Stop) -> None:
    """Tables on the terminal, until the stop. Raises UnknownFloor, NotReachable."""
    absence = Absence()
    with Live(as_tables(scene), auto_refresh=False) as live:
        for _ in stop.ticks(SHOW_INTERVAL_S):
            try:
                scene, note = system.look(), ""
                absence.end()
            except NotReachable as wrong:
                note = absence.go_on(wrong)
            live.update(as_tables(scene, note), refresh=True)


def print_tables(system: System, scene: SystemTables, stop: Stop) -> None:
    """Tables into a pipe or a file, each with an empty line behind it, until the stop. Raises as above."""
    absence = Absence()
    for _ in stop.ticks(PRINT_INTERVAL_S):
        try:
            scene = system.look()
            absence.end()
        except NotReachable as wrong:
            if not absence.is_on:
                typer.echo(f"robocorba watch: {wrong}; waiting", err=True)
            absence.go_on(wrong)
            continue
        show(scene)
        print(flush=True)


class Camera:
    """Pictures of a floor, by default of the lowest, drawn by the simulation server."""

    def __init__(self, orb: Orb, floors: Sequence[str], width_px: int) -> None:
        if len(floors) > 1:
            raise InvalidSetting("--floor", ", ".join(floors), "a video shows one floor")
        self._orb, self._width_px = orb, width_px
        self._server: Any = None
        self._floor = floors[0] if floors else ""

    def png(self, find_s: float = FIND_AGAIN_S) -> bytes:
        """The floor now. Raises UnknownFloor, InvalidPicture, NotReachable."""
        try:
            if not self._floor:
                database = self._orb.resolve("OmniDatabase", RoboCorba.OmniDatabase, find_s, CALL_LIMIT_S)
                self._floor = database.floors()[0]
            if self._server is None:
                interface = RoboCorba.SimulationServer
                self._server = self._orb.resolve("SimulationServer", interface, find_s, PICTURE_LIMIT_S)
            return bytes(self._server.renderFloor(self._floor, self._width_px))
        except CORBA.UserException as wrong:
            raise (idl_errors.domain_error(wrong) or wrong) from None
        except CORBA.SystemException as wrong:
            self._server = None
            raise NotReachable(f"the simulation server does not answer ({describe(wrong)})") from None


def film(camera: Camera, file: Path, seconds: float, fps: int, stop: Stop) -> None:
    """Make a video of what happens now; one that plays, whatever ends it.

    Raises UnknownFloor, InvalidPicture, VideoError, NotReachable."""
    from PIL import Image  # here and below: what pictures need takes a second to load

    from robocorba.video import VideoFile

    absence, most = Absence(), round(seconds * fps) or math.inf
    picture = camera.png(FIND_S)
    video = VideoFile(file, *Image.open(io.BytesIO(picture)).size, fps)
    try:
        with video, progress(seconds) as bar:
            for passed_s in stop.ticks(1 / fps, seconds):
                try:
                    picture, note = camera.png(), ""
                    absence.end()
                except NotReachable as wrong:
                    note = absence.go_on(wrong)
                due = min(round(passed_s * fps) + 1, most)
                video.add(picture, times=int(due) - video.count)
                bar(passed_s, note or f"{video.count} pictures")
    finally:
        width, height = video.size
        typer.echo(f"wrote {file}: {video.count / fps:.1f} s, {video.count} pictures of {width} x {height}")
