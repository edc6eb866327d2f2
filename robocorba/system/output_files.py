"""Output files of commands: what people may have edited is not replaced without --force, and an input never is.

Pictures and films can be made again from their source, so they replace earlier ones; they too never replace an input.
"""

from __future__ import annotations

import os
import stat
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path

from robocorba.errors.files import OutputError


def check_output(output: str | Path, inputs: Iterable[str | Path] = (), replace: bool = True) -> None:
    """Raise OutputError if an output is one of the inputs or a folder that holds one, or exists and may not be
    replaced. Devices and pipes hold nothing that could be lost."""
    real = Path(os.path.realpath(output))
    for source in inputs:
        read = Path(os.path.realpath(source))
        if real == read or real in read.parents or _is_same(real, read):
            raise OutputError(output, "this is the input itself, which is never overwritten; choose another name")
    if not replace and (real.is_file() or real.is_dir()):
        raise OutputError(output, "exists already; choose another name, or replace it with --force")


def write_outputs(contents: Mapping[Path, bytes], inputs: Iterable[str | Path] = (), replace: bool = True) -> None:
    """Write files, each at once; if one of them may not be replaced, none. Files that have their content already may
    always be written. Raises OutputError."""
    sources = tuple(inputs)
    for path, content in contents.items():
        check_output(path, sources, replace or path.is_dir() or _holds(path, content))
    for path, content in contents.items():
        try:
            _write(Path(os.path.realpath(path)), content)
        except (OSError, ValueError) as error:
            raise OutputError(path, getattr(error, "strerror", None) or str(error)) from None


def _is_same(first: Path, second: Path) -> bool:
    """Whether two names are links to one file."""
    try:
        return first.samefile(second)
    except OSError:
        return False


def _holds(path: Path, content: bytes) -> bool:
    try:
        return path.is_file() and path.stat().st_size == len(content) and path.read_bytes() == content
    except OSError:
        return False


def _write(path: Path, content: bytes) -> None:
    """Replace a file by a complete new one, which has its mode. A device or a pipe is written to."""
    found = path.stat() if path.exists() else None
    if found and not stat.S_ISREG(found.st_mode):
        path.write_bytes(content)
        return
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name[:100]}.")
    fresh = Path(name)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        fresh.chmod(stat.S_IMODE(found.st_mode) if found else 0o644)
        fresh.replace(path)
    finally:
        fresh.unlink(missing_ok=True)
