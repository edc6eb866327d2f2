"""File names for formats with one file per floor."""

from __future__ import annotations

import re
from pathlib import Path

from robocorba.map_editor.model import Building


def floor_paths(building: Building, path: str | Path, suffix: str) -> dict[str, Path]:
    """A file for each floor: `path` with `suffix` if there is one floor, else its stem, `-` and the floor.

    Characters that are not allowed in a file name become `_`."""
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
