"""Map files of RoboCorba and of other systems. The content selects the format to read. Manual: docs/formats.md.

A module of this folder with a FORMAT (a MapFormat) is a format: nothing else has to name it."""

from __future__ import annotations

import pkgutil
from importlib import import_module
from pathlib import Path

from robocorba.errors.maps import MapFileError
from robocorba.map_editor.formats.map_format import MapFormat, ReadOptions
from robocorba.map_editor.losses import Exported, Imported
from robocorba.map_editor.model import Building
from robocorba.map_editor.yaml_file import read_yaml
from robocorba.system.output_files import write_outputs

__all__ = [
    "Exported",
    "Imported",
    "MapFormat",
    "export_map",
    "known_formats",
    "read_map",
    "write_map",
    "written_formats",
]


def known_formats() -> list[MapFormat]:
    """The formats that the modules of this folder declare, in the order of the modules' names."""
    modules = (import_module(f"{__name__}.{found.name}") for found in pkgutil.iter_modules(__path__))
    return [module.FORMAT for module in modules if isinstance(getattr(module, "FORMAT", None), MapFormat)]


def written_formats() -> dict[str, MapFormat]:
    """The formats that `export_map` makes, by name."""
    return {known.name: known for known in known_formats() if known.write}


def read_map(
    path: str | Path, *, unknown: str = "blocked", specks: str = "walls", absolute_paths: bool = True
) -> Imported:
    """Read a map of any readable format, such as a native map, an Open-RMF building.yaml or a ROS map_server YAML.

    The options are for ROS maps. `unknown` cells count as "blocked" or "free". `specks` of 0.05 m
    or less: "keep" them, or remove those beside "walls", or "all". Without `absolute_paths` the map
    can name files in its folder or below only: for maps of others, who must not read any file.
    Raises MapFileError with file, line, key and reason if the file is invalid or of another format."""
    options = ReadOptions(unknown, specks, absolute_paths)
    options.check(str(path))
    file = read_yaml(path)
    readable = [known for known in known_formats() if known.read]
    for known in readable:
        if known.read and known.recognises(file.data):
            return known.read(file, options)
    raise MapFileError(str(path), 1, "", "neither " + " nor ".join(known.mark for known in readable))


def write_map(
    building: Building, path: str | Path, format: str, *, resolution_m: float = 0.05, image: str = "pgm"
) -> Exported:
    """Write the files of `export_map`, in place of those that exist. Raises MapFileError, OutputError."""
    exported = export_map(building, path, format, resolution_m=resolution_m, image=image)
    write_outputs(exported.files)
    return exported


def export_map(
    building: Building, path: str | Path, format: str, *, resolution_m: float = 0.05, image: str = "pgm"
) -> Exported:
    """A building in one of the written formats, as files that are not written yet, with a sentence for each loss.

    native and openrmf make one file, `path`. ros makes a YAML file and a picture for each floor, nav2 a
    GeoJSON file for each floor. With one floor the name is that of `path`, else its stem, `-` and
    the floor. `resolution_m` (side of a cell) and `image` (pgm or png) are for ros. Raises
    MapFileError for an impossible format, resolution or image."""
    known = written_formats()
    write = known[format].write if format in known else None
    if write is None:
        raise MapFileError(str(path), 0, "", f"{format!r} can't be written; formats: {', '.join(known)}")
    return write(building, Path(path), resolution_m, image)
