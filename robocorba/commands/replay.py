"""robocorba replay: shows a recording in the terminal, as a picture or as a video, without a server."""

from __future__ import annotations

import io
import itertools
import math
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.live import Live

from robocorba.commands.options import only_for
from robocorba.commands.reporting import reporting
from robocorba.commands.simulation_tables import Tables, elevators, robots, sheets, with_note
from robocorba.commands.tables import print_json, show
from robocorba.commands.waiting import StopSignal, progress
from robocorba.commands.watch import SHOW_INTERVAL_S
from robocorba.errors.simulation import InvalidRecording
from robocorba.map_editor.spatial.floor_update import FloorView
from robocorba.simulation.robot_scans import LastScan, from_sensor
from robocorba.system.extras import require_extra
from robocorba.system.output_files import check_output, write_outputs
from robocorba.system.printing import Console, echo
from robocorba.system.settings import InvalidSetting

if TYPE_CHECKING:
    from robocorba.simulation.recording import Recording

#: Maximum number of pictures of a video: more than a day at 10 a second.
MAX_PICTURES = 1_000_000
#: How long a scan is drawn [s].
SCAN_AGE_S = 1.0
#: Renders a floor as PNG, at a time after the start of the recording [s].
Draw = Callable[[float, FloorView], bytes]


def replay(
    context: typer.Context,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Recording to play.")],
    floor: Annotated[list[str] | None, typer.Option(metavar="F", help="Show only this floor. Repeatable.")] = None,
    speed: Annotated[
        float, typer.Option(metavar="X", min=0.01, max=1000.0, help="Playback speed; 2: twice as fast as recorded.")
    ] = 1.0,
    at: Annotated[
        float | None, typer.Option(metavar="S", min=0.0, help="Show only the state at this time after the start [s].")
    ] = None,
    png: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Draw the state at --at, or at the end, in this PNG file, replacing it."),
    ] = None,
    video: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write a video of one floor to this MP4 file, replacing it.")
    ] = None,
    fps: Annotated[int, typer.Option(metavar="N", min=1, max=60, help="Frames per second of the video.")] = 10,
    width: Annotated[int, typer.Option(metavar="PX", help="Width of the picture or video [pixels].")] = 960,
    json: Annotated[bool, typer.Option("--json", help="Print the state at --at, or at the end, as JSON.")] = False,
) -> None:
    """Play a recording as tables, or write a picture or a video of it."""
    only_for("tables", not (png or video), context, "json")
    only_for("--video", video, context, "fps")
    only_for("--png and --video", png or video, context, "width")
    only_for("tables and --png", png or not video, context, "at")
    only_for("--video and tables without --at", video or (not png and at is None), context, "speed")
    with reporting("replay"):
        require_extra("films" if png or video else "recordings", "recordings")
        from robocorba.simulation.recording import Recording

        for output in filter(None, (png, video)):
            check_output(output, [file])
        recording = Recording(file)
        if not recording.count:
            raise InvalidRecording(str(file), "contains no updates")
        at_s = math.inf if at is None else at
        if png:
            draw_one(recording, one_of(recording, floor or []), at_s, png, width)
        if video:
            film(recording, one_of(recording, floor or []), video, speed, fps, width)
        if png or video:
            return
        if json:
            print_json(recorded_tables(recording.at(at_s, floor or [])))
        elif at is None and Console().is_terminal:
            show_live(recording, floor or [], speed)
        else:
            show(*sheets(recorded_tables(recording.at(at_s, floor or []))))


def one_of(recording: Recording, floors: Sequence[str]) -> str:
    """The chosen floor, or the first one. Raises InvalidSetting for more than one."""
    if len(floors) > 1:
        raise InvalidSetting("--floor", ", ".join(floors), "a picture shows one floor")
    return floors[0] if floors else recording.floors[0]


def recorded_tables(views: Mapping[str, FloorView]) -> Tables:
    """Tables of recorded floors."""
    return {"robots": robots(views.values()), "elevators": elevators(views.values())}


def show_live(recording: Recording, floors: Sequence[str], speed: float) -> None:
    """Play a recording as tables in the terminal. Raises UnknownFloor, InvalidRecording."""
    stop = StopSignal()
    began = time.monotonic()
    with Live(auto_refresh=False) as live:
        for at_s, views in recording.sampled(SHOW_INTERVAL_S * speed, floors):
            if stop.wait(began + at_s / speed - time.monotonic()):
                return
            note = f"{at_s:.1f} s of {recording.duration_s:.1f} s"
            live.update(with_note(recorded_tables(views), note, "bold"), refresh=True)
    if not recording.is_complete:
        echo("the recording ends here: its recorder was killed, or is still recording")


def draw_one(recording: Recording, floor: str, at_s: float, file: Path, width_px: int) -> None:
    """Draw a floor at a time as a PNG file. Raises UnknownFloor, InvalidPicture, InvalidRecording, OutputError."""
    picture = painting(recording, floor, width_px)(min(at_s, recording.duration_s), recording.at(at_s, [floor])[floor])
    write_outputs({file: picture})
    echo(f"drew {file}")


def film(recording: Recording, floor: str, file: Path, speed: float, fps: int, width_px: int) -> None:
    """Convert a recording to a video, until stopped.

    Raises UnknownFloor, InvalidPicture, InvalidRecording, InvalidSetting, OutputError."""
    from PIL import Image  # imported here, since it takes a second to load

    from robocorba.console.video import VideoFile

    pictures = recording.duration_s / speed * fps
    if pictures > MAX_PICTURES:
        least = recording.duration_s * fps / MAX_PICTURES
        reason = (
            f"the film would have {pictures:.0f} pictures, at most {MAX_PICTURES}: choose {math.ceil(least)} or more"
        )
        raise InvalidSetting("--speed", f"{speed:g}", reason)
    stop, draw = StopSignal(), painting(recording, floor, width_px)
    size = Image.open(io.BytesIO(draw(0.0, recording.at(0.0, [floor])[floor]))).size
    with VideoFile(file, *size, fps) as video, progress(recording.duration_s) as bar:
        for at_s, views in recording.sampled(speed / fps, [floor]):
            video.add(draw(at_s, views[floor]))
            bar(at_s, f"{video.count} pictures")
            if stop.wait(0.0):
                break
    echo(f"wrote {file}: {video.count / fps:.1f} s, {video.count} pictures of {video.size[0]} x {video.size[1]}")


def painting(recording: Recording, floor: str, width_px: int) -> Draw:
    """A function that draws a floor on the recorded map, at times that never fall."""
    from robocorba.simulation.picture import FloorPainter

    painter, scans = FloorPainter(recording.building), scans_at(recording, floor)
    return lambda at_s, view: painter.png(view, scans(at_s), width_px, f"{view.floor}, {at_s:.1f} s")


def scans_at(recording: Recording, floor: str) -> Callable[[float], list[LastScan]]:
    """A function that returns the scans of the second before a time after the start [s], of each sensor the last one;
    times never fall."""
    coming = itertools.chain(recording.scans(floor), [None])
    following = [next(coming)]
    last: dict[tuple[object, ...], tuple[float, LastScan]] = {}

    def at(at_s: float) -> list[LastScan]:
        while (found := following[0]) and found[0] <= at_s:
            seen_s, scan = found
            last.update({(scan.robot, *scan.sensor): (seen_s, from_sensor(scan))})
            following[0] = next(coming)
        return [scan for seen_s, scan in last.values() if seen_s >= at_s - SCAN_AGE_S]

    return at
