"""Makes maps of the ROS map_server: a YAML file and a picture for each floor."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from PIL import Image

from robocorba.errors.maps import GridTooLarge, MapFileError
from robocorba.map_editor.formats.files import floor_paths
from robocorba.map_editor.formats.floor_grid import floor_grid
from robocorba.map_editor.formats.grid import FREE, OCCUPIED, UNKNOWN, Canvas
from robocorba.map_editor.formats.ros_picture import FREE_BELOW, OCCUPIED_ABOVE
from robocorba.map_editor.losses import Exported, Losses
from robocorba.map_editor.model import Building


def export(building: Building, path: Path, resolution_m: float, image: str) -> Exported:
    """A YAML file and a picture for each floor. Raises MapFileError if the grid would be too large."""
    if not 1e-3 <= resolution_m <= 10:
        raise MapFileError(str(path), 0, "resolution", "expected metres per cell, from 0.001 to 10")
    if image not in ("pgm", "png"):
        raise MapFileError(str(path), 0, "image", f"{image!r} is not supported; pgm and png are")
    shade_of = np.empty(3, np.uint8)
    shade_of[[FREE, OCCUPIED, UNKNOWN]] = 254, 0, 205  # as map_saver of ROS writes them
    losses = Losses()
    files: dict[Path, bytes] = {}
    for floor, target in floor_paths(building, path, ".yaml").items():
        canvas = _drawn(building, floor, resolution_m, target)
        shades = shade_of[canvas.cells]
        picture = target.with_suffix(f".{image}")
        drawn = io.BytesIO()
        Image.fromarray(shades).save(drawn, format="PPM" if image == "pgm" else "PNG")
        files |= {target: _yaml(picture.name, canvas).encode(), picture: drawn.getvalue()}
        _report(building, floor, losses)
    losses.add(f"shapes are drawn in cells of {resolution_m:g} m; names and heights are not kept")
    return Exported(files, losses.sentences())


def _drawn(building: Building, floor: str, resolution_m: float, target: Path) -> Canvas:
    try:
        return floor_grid(building, floor, resolution_m)
    except GridTooLarge as error:
        raise MapFileError(str(target), 0, "resolution", str(error)) from None


def _yaml(picture: str, canvas: Canvas) -> str:
    x, y = canvas.origin
    quoted = "'" + picture.replace("'", "''") + "'"
    return (
        f"image: {quoted}\nmode: trinary\nresolution: {canvas.cell_m!r}\norigin: [{x!r}, {y!r}, 0.0]\nnegate: 0\n"
        f"occupied_thresh: {OCCUPIED_ABOVE}\nfree_thresh: {FREE_BELOW}\n"
    )


def _report(building: Building, floor: str, losses: Losses) -> None:
    entry = building.floors[floor]
    if entry.topological.nodes:
        losses.add("nodes and edges are left out: {names}", floor)
    if entry.geometrical.areas:
        losses.add("areas are left out: {names}", floor)
    for map_object in entry.geometrical.objects.values():
        if map_object.mass:
            losses.add("masses of objects are not kept: {names}", f"{floor} {map_object.name}")
    for door in entry.geometrical.doors.values():
        state = "locked doors became walls: {names}" if door.locked else "doors became gaps in the walls: {names}"
        losses.add(state, f"{floor} {door.name}")
    for elevator in building.elevators.values():
        if floor in elevator.floors():
            losses.add(
                "elevators became the walls of their shafts, open at the landing: {names}", f"{floor} {elevator.name}"
            )
