"""The folder of compiled kernels: where it is, for which sources, and whether all are there.

numba's own cache notices a changed kernel by the file that defines it, not by the functions, constants and types that
it is compiled from. So all kernels of one version are in a folder of their own, named by a digest of all these files.
"""

from __future__ import annotations

import contextlib
import fcntl
import functools
import hashlib
import logging
import os
import platform
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from importlib import metadata
from pathlib import Path
from typing import Any

import platformdirs

from robocorba.system.private_files import exposure, make_folder

#: How kernels are compiled. Division by zero yields inf or NaN, as in numpy: a kernel that can raise costs reference
#: counting for all arrays in each call. Nothing calls them as C functions.
OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
#: Maximum number of versions in the folder, 17 MB each.
MAX_VERSIONS = 7
_KERNEL = re.compile(r"^@kernel\ndef (\w+)(.*?)(?=\n\n\n|\Z)", re.DOTALL | re.MULTILINE)
_IMPORT = re.compile(r"^\s*from (\S+) import (\([^)]*\)|[^\n]*)|^\s*import (\S+)", re.MULTILINE)
#: What is removed: versions, and files and folders of former releases.
_OURS = re.compile(r"[0-9a-f]{16,20}|(sources|complete)-.*\.json|.*\.nb[ic]")

_log = logging.getLogger(__name__)


class KernelStore:
    """The kernels of the package in the folder `root`, on disk in a folder within `cache`; None if none is writable."""

    def __init__(self, root: Path, cache: Path | None) -> None:
        self._root, self._cache = root, cache
        digest = hashlib.sha256(f"{root.resolve()} {OPTIONS} {_compiler()} {_processor()}".encode())
        for path in sources(root):
            digest.update(f"{path.relative_to(root)}\0".encode() + path.read_bytes())
        self.folder = cache / digest.hexdigest()[:20] if cache else None

    @functools.cached_property
    def _sizes(self) -> dict[str, int]:
        found: dict[str, int] = {}
        for path in sources(self._root):
            module = ".".join(path.relative_to(self._root.parent).with_suffix("").parts)
            found |= {f"{module}.{name}": len(text) for name, text in _KERNEL.findall(path.read_text())}
        return found

    @property
    def missing(self) -> dict[str, int]:
        """The kernels, such as "robocorba.planning.world.unpack", that have not been compiled for any signature, and
        the size of each [characters]."""
        files = self.folder.glob("*/*.nbi") if self.folder else ()
        compiled = {f"{path.parent.name.rpartition('_')[0]}.{path.name.split('-')[0]}" for path in files}
        return {name: size for name, size in self._sizes.items() if ".".join(name.split(".")[-3:]) not in compiled}

    @property
    def is_complete(self) -> bool:
        """Whether all kernels of this version have been compiled on this machine. Does not load the compiler."""
        if not self.folder or not (self.folder / "complete").exists():
            return False
        with contextlib.suppress(OSError):
            os.utime(self.folder)
        return True

    def set_complete(self) -> None:
        """All kernels are compiled. Removes the versions that were used longest ago, beyond MAX_VERSIONS."""
        if not self._cache or not self.folder:
            return
        with contextlib.suppress(OSError):  # on a full disk the next start looks for them again
            make_folder(self.folder)
            (self.folder / "complete").touch()
            found = [path for path in self._cache.iterdir() if _OURS.fullmatch(path.name) and path != self.folder]
            versions = sorted((path for path in found if path.is_dir()), key=_used_at, reverse=True)
            for path in found:
                if path not in versions:
                    path.unlink(missing_ok=True)
            for path in versions[MAX_VERSIONS - 1 :]:
                shutil.rmtree(path, ignore_errors=True)


@functools.lru_cache
def store() -> KernelStore:
    """The kernels of RoboCorba, in NUMBA_CACHE_DIR, else in the user's cache folder."""
    return KernelStore(Path(__file__).parents[1], cache_folder())


def sources(root: Path) -> list[Path]:
    """The modules of a package that define kernels, and those of the package that they import, directly or not."""
    written = (path for path in root.rglob("*.py") if path.relative_to(root).parts[0] != "stubs")
    waiting = [path for path in written if "\n@kernel\n" in path.read_text()]
    found = set(waiting)
    while waiting:
        for module, names, plain in _IMPORT.findall(waiting.pop().read_text()):
            submodules = [f"{module}.{name}" for name in re.findall(r"\w+", names)]
            for path in filter(None, (_path(root, name) for name in (module or plain, *submodules))):
                if path not in found:
                    found.add(path)
                    waiting.append(path)
    return sorted(found)


def _path(root: Path, module: str) -> Path | None:
    """The file of a module of the package; None for other modules and names."""
    package, *names = module.split(".")
    path = root.joinpath(*names)
    files = (path / "__init__.py", path.with_suffix(".py")) if package == root.name else ()
    return next((file for file in files if file.is_file()), None)


def cache_folder() -> Path | None:
    """The folder of all compiled kernels, created if missing; None if no folder is writable.

    What is in it is run. So a folder in which others could replace something is not used, such as one in the folder of
    temporary files that another user has created."""
    if chosen := os.environ.get("NUMBA_CACHE_DIR"):
        folders = [Path(chosen).absolute()]
    else:
        roots = platformdirs.user_cache_path("robocorba"), Path(tempfile.gettempdir()) / f"robocorba-{os.getuid()}"
        folders = [root / "kernels" for root in roots]
    for folder in folders:
        with contextlib.suppress(OSError):
            make_folder(folder)
            folder = folder.resolve()
            if reason := exposure(folder):
                _log.warning("compiled kernels are not kept in %s: %s", folder, reason)
                continue
            with tempfile.TemporaryFile(dir=folder):
                return folder
    _log.warning("compiled kernels are not kept: no folder is writable (%s)", ", ".join(map(str, folders)))
    return None


@contextlib.contextmanager
def lock(
    path: Path, limit_s: float, interval_s: float = 0.01, meanwhile: Callable[[], None] = lambda: None
) -> Iterator[None]:
    """Hold a lock between processes; without it after `limit_s` [s], or where the file system has no locks. Tries at
    intervals [s], and calls `meanwhile` before each."""
    deadline = time.monotonic() + limit_s
    with path.open("a") as file:
        while True:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except OSError as error:
                if not isinstance(error, BlockingIOError) or time.monotonic() > deadline:
                    break
            meanwhile()
            time.sleep(interval_s)
        yield


def _compiler() -> str:
    versions = [f"{package} {metadata.version(package)}" for package in ("numba", "llvmlite", "numpy")]
    return " ".join([f"Python {sys.version_info[0]}.{sys.version_info[1]}", *versions])


def _processor() -> str:
    """Model and features of this machine's processor: kernels use what it has."""
    with contextlib.suppress(OSError):
        first = Path("/proc/cpuinfo").read_text().partition("\n\n")[0].splitlines()
        return "\n".join(line for line in first if line.startswith(("model name", "flags", "Features", "CPU ")))
    return platform.processor()


def _used_at(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0
