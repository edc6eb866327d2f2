"""Functions compiled by numba, and their cache on disk.

numba detects a stale kernel only by the function's own file, and fails on cached types that no longer exist. So each
package has one cache folder for each digest of its kernel sources: the modules with kernels, and the modules that these
import. Other edits keep the cache.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import tempfile
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
import platformdirs

#: Cache folders kept. Older ones stay so that two checkouts do not invalidate each other's cache.
MAX_KEPT = 60

_ROOT = Path(__file__).parent
_IMPORT = re.compile(r"^from robocorba\.([\w.]+) import ", re.MULTILINE)

F = TypeVar("F", bound=Callable[..., Any])


def kernel(function: F) -> F:
    """Compile a function at its first call, to run without the interpreter's lock. NUMBA_CACHE_DIR overrides the cache.

    Division by zero yields inf or NaN, as in numpy: a kernel that can raise costs reference counting for all arrays in
    each call."""
    if "NUMBA_CACHE_DIR" not in os.environ:
        folder = _folder(Path(function.__code__.co_filename).parent)
        if folder:
            numba.config.CACHE_DIR = str(folder)  # type: ignore[attr-defined]
    return cast(F, numba.njit(nogil=True, cache=True, error_model="numpy")(function))


@lru_cache
def _folder(package: Path) -> Path | None:
    """Cache folder of a package's kernels, created if missing; None if no folder is writable."""
    digest = hashlib.sha256(numba.__version__.encode())
    for source in _sources(package):
        digest.update(source.read_bytes())
    name = digest.hexdigest()[:16]
    for root in (platformdirs.user_cache_path("robocorba"), Path(tempfile.gettempdir()) / f"robocorba-{os.getuid()}"):
        folder = root / "kernels" / name
        try:
            folder.mkdir(parents=True, exist_ok=True)
            os.utime(folder)
            with tempfile.TemporaryFile(dir=folder):
                pass
        except OSError:
            continue
        _remove_old(folder.parent)
        return folder
    return None


def _sources(package: Path) -> list[Path]:
    """Modules that the kernels of a package are compiled from, sorted."""
    found: set[Path] = set()
    waiting = [source for source in package.glob("*.py") if "@kernel\n" in source.read_text()]
    while waiting:
        source = waiting.pop()
        if source in found:
            continue
        found.add(source)
        for name in _IMPORT.findall(source.read_text()):
            module = _ROOT.joinpath(*name.split("."))
            waiting += module.glob("*.py") if module.is_dir() else [module.with_suffix(".py")]
    return sorted(found)


def _remove_old(kernels: Path) -> None:
    folders = sorted(kernels.iterdir(), key=lambda folder: folder.stat().st_mtime, reverse=True)
    for folder in folders[MAX_KEPT:]:
        shutil.rmtree(folder, ignore_errors=True)
