"""Map files of browsers: uploaded ones read, the building written as a download, with what the conversion loses."""

from __future__ import annotations

import base64
import binascii
import contextlib
import io
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from robocorba.console.arguments import InvalidArguments
from robocorba.errors.maps import MapFileError
from robocorba.map_editor.model import Building, with_topology
from robocorba.system.extras import require_extra

#: Maximum number of uploaded files.
MAX_FILES = 64


def decoded(text: Any, what: str) -> bytes:
    """The bytes of a base64 text. Raises InvalidArguments."""
    try:
        return base64.b64decode(text, validate=True)
    except (binascii.Error, TypeError, ValueError):
        raise InvalidArguments(f"{what} is not base64 text") from None


def read_upload(files: Mapping[str, str], unknown: str, specks: str, topology: bool, radius_m: float) -> dict[str, Any]:
    """The building in uploaded files, by name in base64: a map, and the pictures and maps that it names.

    unknown, specks: as in read_map. topology: generate roads for floors without, for robots of `radius_m`.
    Returns `document` (a native map file), `format`, `summary`, `losses` and `warnings` (sentences).
    Raises InvalidArguments, MapFileError."""
    # Imported here and below: the formats and the generator take most of a second to load.
    from robocorba.map_editor import checking, native
    from robocorba.map_editor.formats import read_map

    with tempfile.TemporaryDirectory(prefix="robocorba-upload-") as folder:
        main = _store(files, Path(folder))
        with _names_without_folder():
            imported = read_map(main, unknown=unknown, specks=specks, absolute_paths=False)
    building, notes = imported.building, []
    for floor, entry in building.floors.items() if topology else ():
        if not entry.topological.edges:
            building, note = _with_roads(building, floor, radius_m)
            notes.append(note)
    return {
        "document": native.dumps(building),
        "format": imported.format,
        "summary": summary(building),
        "losses": [*imported.losses, *notes],
        "warnings": list(checking.summaries(checking.blocked(building))),
    }


def downloads() -> list[dict[str, Any]]:
    """The formats of `write_download`: `name`, `title`, and whether they consist of `cells`."""
    from robocorba.map_editor.formats import written_formats

    return [{"name": name, "title": each.title, "cells": each.has_cells} for name, each in written_formats().items()]


def write_download(building: Building, format: str, resolution_m: float, image: str) -> dict[str, Any]:
    """The building in a format: `name` of the file, `content` in base64, `losses`. Several files become one archive.

    Raises InvalidArguments for an unknown format, MapFileError."""
    from robocorba.map_editor.formats import export_map, written_formats

    known = written_formats()
    if format not in known:
        raise InvalidArguments(f"the format {format[:40]!r} can't be written; there are {', '.join(known)}")
    stem = "".join(letter if letter.isalnum() or letter in "-_" else "_" for letter in building.name)[:60] or "building"
    exported = export_map(building, stem + known[format].suffix, format, resolution_m=resolution_m, image=image)
    name, content = _packed(stem, exported.files)
    return {"name": name, "content": base64.b64encode(content).decode(), "losses": list(exported.losses)}


def summary(building: Building) -> str:
    """How much there is in a building."""
    floors = building.floors.values()
    walls = sum(len(entry.geometrical.walls) for entry in floors)
    nodes = sum(len(entry.topological.nodes) for entry in floors)
    edges = sum(len(entry.topological.edges) for entry in floors)
    elevators = len(building.elevators)
    return f"{len(floors)} floors, {walls} walls, {nodes} nodes, {edges} edges, {elevators} elevators"


def _store(files: Mapping[str, str], folder: Path) -> Path:
    """Write the files into a folder; the one to read first."""
    if not 0 < len(files) <= MAX_FILES:
        raise InvalidArguments(f"{len(files)} files are given; give 1 to {MAX_FILES}")
    maps: dict[Path, bytes] = {}
    for given, text in files.items():
        name = Path(given.replace("\\", "/")).name
        if not name or name.startswith("."):
            raise InvalidArguments(f"{given[:80]!r} is not a file name")
        path, content = folder / name, decoded(text, name[:80])
        try:
            path.write_bytes(content)
        except (OSError, ValueError) as error:
            raise InvalidArguments(f"{name[:80]}: {getattr(error, 'strerror', None) or error}") from None
        if path.suffix.lower() in (".yaml", ".yml", ".json"):
            maps[path] = content
    lists = [path for path, content in maps.items() if b"ros_maps" in content]
    found = lists or list(maps)
    if not found:
        raise InvalidArguments(
            "none of the files is a map: choose the .yaml file, and the pictures that it names with it"
        )
    if len(found) > 1:
        raise InvalidArguments(
            f"{len(found)} maps are given ({', '.join(path.name for path in found)[:200]}); choose one"
        )
    return found[0]


@contextlib.contextmanager
def _names_without_folder() -> Iterator[None]:
    """Errors name the file alone: the folder is the console's own."""
    try:
        yield
    except MapFileError as error:
        raise MapFileError(Path(error.file).name, error.line, error.key, error.reason) from None


def _packed(stem: str, files: Mapping[Path, bytes]) -> tuple[str, bytes]:
    if len(files) == 1:
        ((path, content),) = files.items()
        return path.name, content
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as target:
        for path, content in files.items():
            target.writestr(path.name, content)
    return f"{stem}.zip", archive.getvalue()


def _with_roads(building: Building, floor: str, radius_m: float) -> tuple[Building, str]:
    require_extra("maps", "generated topological maps")
    from robocorba.map_editor.topology import topological_map

    nodes = tuple(building.floors[floor].topological.nodes.values())
    roads = topological_map(building, floor, radius_m, nodes)
    note = f"{floor}: generated {len(roads.nodes) - len(nodes)} nodes and {len(roads.edges)} edges"
    return with_topology(building, floor, roads), note
