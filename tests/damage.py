"""Damage to files, as a disk may do it."""

from __future__ import annotations

import random
from pathlib import Path


def damage(file: Path, at: int = 0) -> bytes:
    """Overwrite 200 bytes of a file from `at` on; its content then."""
    content = bytearray(file.read_bytes())
    content[at : at + 200] = random.Random(1).randbytes(200)
    file.write_bytes(content)
    return bytes(content)
