"""The sample buildings that travel with the package."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from robocorba.errors.maps import MapFileError
from robocorba.map_editor import native
from robocorba.map_editor.model import Building

#: five-floors: an office building with three elevators; paper-scene: two rooms, a table, two sub-networks.
SAMPLES = ("five-floors", "paper-scene")


def sample_path(name: str) -> Path:
    """The native map file of a sample. Raises MapFileError, which lists the samples, if the name is unknown."""
    if name not in SAMPLES:
        raise MapFileError(name, 0, "", f"unknown sample building; known are {', '.join(SAMPLES)}")
    return Path(str(files("robocorba") / "samples" / f"{name}.yaml"))


def map_file(map: str | Path) -> Path:
    """The file of a map that is given as a file or as a sample's name."""
    return sample_path(str(map)) if str(map) in SAMPLES else Path(map)


def sample_files() -> dict[str, Path]:
    """The maps, programs and fleets that travel with the package, by the names of their files."""
    folder = Path(str(files("robocorba") / "samples"))
    return {file.name: file for file in sorted(folder.iterdir()) if file.suffix in (".json", ".yaml")}


def load_sample(name: str) -> Building:
    """A sample building, read and checked. Raises MapFileError, which lists the samples, if the name is unknown."""
    return native.load(sample_path(name))
