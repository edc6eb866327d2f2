"""Functions that numba compiles, and where they are kept between runs.

numba looks only at a function's own file to see whether a cached kernel is stale, and fails on cached types that no
longer exist. So each package has a cache folder for each state of the sources that its kernels are compiled from: the
modules with kernels, and the modules that these import functions and constants from. Other edits keep the cache.
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

#: Folders of older states that are kept, so that two checkouts don't compile in turn.
MOST_KEPT = 12

_ROOT = Path(__file__).parent
_IMPORT = re.compile(r"^from robocorba\.([\w.]+) import ", re.MULTILINE)

F = TypeVar("F", bound=Callable[..., Any])


def kernel(function: F) -> F:
    """Compile a function when it is first called, to run without the interpreter's lock; NUMBA_CACHE_DIR wins.

    What is divided by zero is inf or NaN, as in numpy: where it could raise, numba counts the references to all arrays
    of each call up and down."""
    if "NUMBA_CACHE_DIR" not in os.environ:
        folder = _folder(Path(function.__code__.co_filename).parent)
        if folder:
            numba.config.CACHE_DIR = str(folder)  # type: ignore[attr-defined]
    return cast(F, numba.njit(nogil=True, cache=True, error_model="numpy")(function))


@lru_cache
def _folder(package: Path) -> Path | None:
    """Where the kernels of a package are kept, made where it is not there; None where nothing can be written."""
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
        _forget_old(folder.parent)
        return folder
    return None


def _sources(package: Path) -> list[Path]:
    """The modules that the kernels of a package are compiled from, sorted."""
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


def _forget_old(kernels: Path) -> None:
    states = sorted(kernels.iterdir(), key=lambda state: state.stat().st_mtime, reverse=True)
    for state in states[MOST_KEPT:]:
        shutil.rmtree(state, ignore_errors=True)
