"""Where a building of several floors goes when a format holds one floor a file, and how files are written."""

from __future__ import annotations

import re
from pathlib import Path

from robocorba.errors.maps import MapFileError
from robocorba.maps.model import Building


def floor_paths(building: Building, path: str | Path, suffix: str) -> dict[str, Path]:
    """A file for each floor: `path` itself with `suffix` where there is one floor, else its stem, `-` and the floor.

    Characters that do not belong in a file name become `_`."""
    base = Path(path)
    stem = base.name.removesuffix(base.suffix)
    if len(building.floors) == 1:
        return {name: base.with_name(stem + suffix) for name in building.floors}
    found: dict[str, Path] = {}
    for name in building.floors:
        label = re.sub(r"[^\w.-]", "_", name)[:80]
        target = base.with_name(f"{stem}-{label}{suffix}")
        if target in found.values():
            target = base.with_name(f"{stem}-{label}_{len(found) + 1}{suffix}")
        found[name] = target
    return found


def write_file(path: Path, content: bytes) -> None:
    """Write a file. Raises MapFileError where it can't be written."""
    try:
        path.write_bytes(content)
    except OSError as wrong:
        raise MapFileError(str(path), 0, "", wrong.strerror or str(wrong)) from None
