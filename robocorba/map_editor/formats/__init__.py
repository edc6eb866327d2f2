"""Map files of RoboCorba and of other systems. The content selects the format to read. Manual: docs/formats.md."""

from __future__ import annotations

from pathlib import Path

from robocorba.errors.maps import MapFileError
from robocorba.map_editor import native
from robocorba.map_editor.formats import nav2, openrmf, openrmf_export, ros_export, ros_floors, ros_map
from robocorba.map_editor.losses import Exported, Imported
from robocorba.map_editor.model import Building
from robocorba.map_editor.yaml_file import read_yaml
from robocorba.system.output_files import write_outputs

#: Formats that `export_map` makes.
WRITTEN = ("native", "openrmf", "ros", "nav2")

__all__ = ["WRITTEN", "Exported", "Imported", "export_map", "read_map", "write_map"]


def read_map(
    path: str | Path, *, unknown: str = "blocked", specks: str = "walls", absolute_paths: bool = True
) -> Imported:
    """Read a native map, an Open-RMF building.yaml, a ROS map_server YAML or a list of ROS maps.

    The options are for ROS maps. `unknown` cells count as "blocked" or "free". `specks` of 0.05 m
    or less: "keep" them, or remove those beside "walls", or "all". Without `absolute_paths` the map
    can name files in its folder or below only: for maps of others, who must not read any file.
    Raises MapFileError with file, line, key and reason if the file is invalid or of another format."""
    options = ros_map.RosOptions(unknown, specks, absolute_paths)
    options.check(str(path))
    file = read_yaml(path)
    if native.is_native(file.data):
        return Imported(native.load(path), "native")
    if openrmf.is_openrmf(file.data):
        return openrmf.read(file)
    if ros_floors.is_ros_floors(file.data):
        return ros_floors.read(file, options)
    if ros_map.is_ros_map(file.data):
        return ros_map.read(file, options)
    raise MapFileError(
        str(path),
        1,
        "",
        "neither a RoboCorba map (robocorba: 1) nor an Open-RMF building (levels:) nor a ROS map (image:) "
        "nor a list of ROS maps (ros_maps: 1)",
    )


def write_map(
    building: Building,
    path: str | Path,
    format: str,
    *,
    resolution_m: float = ros_export.DEFAULT_RESOLUTION_M,
    image: str = "pgm",
) -> Exported:
    """Write the files of `export_map`, in place of those that exist. Raises MapFileError, OutputError."""
    exported = export_map(building, path, format, resolution_m=resolution_m, image=image)
    write_outputs(exported.files)
    return exported


def export_map(
    building: Building,
    path: str | Path,
    format: str,
    *,
    resolution_m: float = ros_export.DEFAULT_RESOLUTION_M,
    image: str = "pgm",
) -> Exported:
    """A building in one of the formats WRITTEN, as files that are not written yet, with a sentence for each loss.

    native and openrmf make one file, `path`. ros makes a YAML file and a picture for each floor, nav2 a
    GeoJSON file for each floor. With one floor the name is that of `path`, else its stem, `-` and
    the floor. `resolution_m` (side of a cell) and `image` (pgm or png) are for ros. Raises
    MapFileError for an impossible format, resolution or image."""
    if format == "native":
        return Exported({Path(path): native.dumps(building).encode()})
    if format == "openrmf":
        text, losses = openrmf_export.dumps(building)
        return Exported({Path(path): text.encode()}, losses)
    if format == "ros":
        return ros_export.export(building, path, resolution_m, image)
    if format == "nav2":
        return nav2.export(building, path)
    raise MapFileError(str(path), 0, "", f"{format!r} can't be written; formats: {', '.join(WRITTEN)}")
