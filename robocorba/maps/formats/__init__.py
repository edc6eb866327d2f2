"""Map files of RoboCorba and of other systems. The content selects the format to read. Manual: docs/formats.md."""

from __future__ import annotations

from pathlib import Path

from robocorba.errors.maps import MapFileError
from robocorba.maps import native
from robocorba.maps.formats import nav2, openrmf, openrmf_export, ros_export, ros_floors, ros_map
from robocorba.maps.formats.files import write_file
from robocorba.maps.losses import Exported, Imported
from robocorba.maps.model import Building
from robocorba.maps.yaml_file import read_yaml

#: Formats that `write_map` writes.
WRITTEN = ("native", "openrmf", "ros", "nav2")

__all__ = ["WRITTEN", "Exported", "Imported", "read_map", "write_map"]


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
    """Write a building in one of the formats WRITTEN. Returns the files, and a sentence for each kind of loss.

    native and openrmf write `path`. ros writes a YAML file and a picture for each floor, nav2 a
    GeoJSON file for each floor. With one floor the name is that of `path`, else its stem, `-` and
    the floor. `resolution_m` (side of a cell) and `image` (pgm or png) are for ros. Raises
    MapFileError if a file can't be written."""
    if format == "native":
        native.save(building, path)
        return Exported((Path(path),))
    if format == "openrmf":
        text, losses = openrmf_export.dumps(building)
        write_file(Path(path), text.encode())
        return Exported((Path(path),), losses)
    if format == "ros":
        return ros_export.write(building, path, resolution_m, image)
    if format == "nav2":
        return nav2.write(building, path)
    raise MapFileError(str(path), 0, "", f"{format!r} can't be written; formats: {', '.join(WRITTEN)}")
