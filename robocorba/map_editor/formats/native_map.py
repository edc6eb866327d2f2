"""The map file of RoboCorba itself (docs/map-file.md)."""

from __future__ import annotations

from pathlib import Path

from robocorba.map_editor import native
from robocorba.map_editor.formats.map_format import MapFormat, ReadOptions
from robocorba.map_editor.losses import Exported, Imported
from robocorba.map_editor.model import Building
from robocorba.map_editor.yaml_file import YamlFile


def _read(file: YamlFile, options: ReadOptions) -> Imported:
    return Imported(native.checked(file), FORMAT.name)


def _write(building: Building, path: Path, resolution_m: float, image: str) -> Exported:
    return Exported({path: native.dumps(building).encode()})


FORMAT = MapFormat(
    name="native",
    title="RoboCorba map (.yaml)",
    files="one; nothing is lost (docs/map-file.md)",
    mark="a RoboCorba map (robocorba: 1)",
    recognises=native.is_native,
    read=_read,
    write=_write,
)
