"""What lies in the state folder of a running system, whose processes write, replace and remove files meanwhile."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import NamedTuple


class StateFile(NamedTuple):
    """content: empty for a folder. mode: the permissions."""

    path: Path
    content: bytes
    mode: int


def state_files(folder: Path) -> list[StateFile]:
    """Of the folder, and of all that is in it; without what has gone since the folder was listed."""
    found = []
    for path in (folder, *folder.rglob("*")):
        with contextlib.suppress(FileNotFoundError):
            content = path.read_bytes() if path.is_file() else b""
            found.append(StateFile(path, content, path.stat().st_mode & 0o777))
    return found
