"""What a module of this folder declares as its FORMAT, so that import, export, help and menus know it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from robocorba.errors.maps import MapFileError
from robocorba.map_editor.losses import Exported, Imported
from robocorba.map_editor.model import Building
from robocorba.map_editor.yaml_file import YamlFile


class ReadOptions(NamedTuple):
    """How pictures are read. unknown: what unknown cells count as, "blocked" or "free". specks: which occupied or
    unknown regions of one cell are removed, none ("keep"), those beside "walls", or "all". absolute_paths: whether a
    map may name files outside of its folder."""

    unknown: str = "blocked"
    specks: str = "walls"
    absolute_paths: bool = True

    def check(self, path: str) -> None:
        """Raise MapFileError if a value is not supported."""
        supported = {"unknown": ("blocked", "free"), "specks": ("keep", "walls", "all")}
        for name, allowed in supported.items():
            value = getattr(self, name)
            if value not in allowed:
                raise MapFileError(path, 0, name, f"{value!r} is not supported; {', '.join(allowed)} are")


class MapFormat(NamedTuple):
    """A kind of map files.

    name: in `--format` and Imported.format; two formats that are read may share it. title: for menus. files: what its
    files hold, for the manual. has_cells: its files are pictures of cells, so the options for pictures concern it.

    mark: how its files look, as in "a ROS map (image:)". recognises: whether parsed YAML is of this format. read: makes
    a building of it; None if the format is only written.

    suffix: of a file that is written. write: makes the files of a building, with the side of a cell [m] and the kind
    of pictures ("pgm" or "png"); None if the format is only read."""

    name: str
    title: str
    files: str
    has_cells: bool = False
    mark: str = ""
    recognises: Callable[[Any], bool] = lambda data: False
    read: Callable[[YamlFile, ReadOptions], Imported] | None = None
    suffix: str = ".yaml"
    write: Callable[[Building, Path, float, str], Exported] | None = None
