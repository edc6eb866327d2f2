"""Files with an object reference that is a right: who can read the file may call the object."""

from __future__ import annotations

import contextlib
import os
import re
from pathlib import Path
from typing import Any

from robocorba.errors.services import ServiceError
from robocorba.orb.orb import Orb


def write_reference(orb: Orb, reference: Any, file: Path) -> None:
    """Write a reference to a file that only this user can read; replaces it atomically. Raises ServiceError."""
    new = file.with_suffix(".new")
    try:
        new.unlink(missing_ok=True)  # a former one may have another mode
        with open(os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as out:
            out.write(orb.uri(reference))
        new.replace(file)
    except OSError as error:
        raise ServiceError(f"can't write {file}: {error.strerror}") from None


def key_in_file(file: Path, prefix: str) -> str:
    """What follows `prefix` in the key of the reference in a file, 32 letters, digits or - _; empty if none."""
    with contextlib.suppress(OSError, ValueError):
        content = bytes.fromhex(file.read_text().removeprefix("IOR:"))
        found = re.search(re.escape(prefix.encode()) + rb"([A-Za-z0-9_-]{32})", content)
        return found[1].decode() if found else ""
    return ""
