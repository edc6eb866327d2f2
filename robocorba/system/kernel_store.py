"""The folder of all compiled kernels: where it is, what belongs there, and what is complete.

A kernel has files of its own, named by its digest, so versions and checkouts share what they have in common.
"""

from __future__ import annotations

import contextlib
import fcntl
import functools
import hashlib
import json
import logging
import os
import platform
import shutil
import sys
import tempfile
import time
import uuid
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from typing import Any

import platformdirs

from robocorba.system.kernel_digests import DIGITS, KernelSource, kernel_sources, sources_digest
from robocorba.system.private_files import exposure, make_folder

#: How kernels are compiled. Division by zero yields inf or NaN, as in numpy: a kernel that can raise costs reference
#: counting for all arrays in each call.
OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
#: Packages whose versions kernels depend on.
COMPILER = ("numba", "llvmlite", "numpy")
#: Maximum number of files, some 250 MB; one version of RoboCorba has 700.
MAX_FILES = 5_000
#: Locks: of the process that writes a kernel, and of the one that compiles all.
WRITING, COMPILING = LOCKS = ("writing.lock", "compiling.lock")
#: Time to compile a kernel, without those that it calls: about this [s], and this for each character of its syntax tree
#: and theirs.
BASE_S, S_PER_SIZE = 0.15, 2.2e-5
#: Interval between attempts to lock a file [s].
_INTERVAL_S = 0.01

_log = logging.getLogger(__name__)


class KernelStore:
    """The kernels of the package in the folder `root`, on disk in `folder`; None if no folder is writable."""

    def __init__(self, root: Path, folder: Path | None) -> None:
        self._root, self.folder = root, folder

    @functools.cached_property
    def sources(self) -> dict[str, KernelSource]:
        """The source of each kernel, such as "robocorba.map_editor.spatial.grids.row_of"."""
        environment = f"{OPTIONS} {self._compiler}"
        name = f"sources-{_digest(self._all_sources, environment)}.json"
        with contextlib.suppress(OSError, ValueError, TypeError):  # it takes half a second to read them
            if self.folder:
                known = json.loads((self.folder / name).read_text())
                os.utime(self.folder / name)
                return {kernel: KernelSource(*source) for kernel, source in known.items()}
        found = kernel_sources(self._root, environment)
        self._write(name, found)
        return found

    @property
    def missing(self) -> list[str]:
        """The kernels that have not been compiled on this machine for any signature."""
        files = [path.name for path in self.folder.glob("*.nbi")] if self.folder else []
        known = {digest for name in files for digest in name.split(".py")[0].split("-")[-1:]}
        return [name for name, source in self.sources.items() if source.digest not in known]

    @property
    def is_complete(self) -> bool:
        """Whether all kernels of this version have been compiled on this machine. Does not load the compiler."""
        try:
            os.utime(self._completed)
        except OSError:
            return False
        return True

    def set_complete(self, seconds: dict[str, float]) -> None:
        """All kernels are compiled; `seconds` each took [s], for those that were not there before."""
        self._write(self._completed.name, self.expected_seconds() | seconds)
        self.remove_old()

    def expected_seconds(self) -> dict[str, float]:
        """About how long each kernel takes to compile [s]: what it took for the version that was completed last, else
        an estimate from its size."""
        expected = {name: BASE_S + source.size * S_PER_SIZE for name, source in self.sources.items()}
        for path in sorted(self.folder.glob("complete-*.json") if self.folder else (), key=_used_at):
            with contextlib.suppress(OSError, ValueError, AttributeError):
                known = json.loads(path.read_text()).items()
                expected |= {name: float(seconds) for name, seconds in known if name in expected}
        return expected

    def remove_old(self) -> None:
        """Remove what was used longest ago, beyond MAX_FILES. A kernel's files are used together. Those of this version
        come last: by a clock that was set back, they may seem to be the oldest."""
        if not self.folder:
            return
        ours = {source.digest for source in self.sources.values()}
        groups: dict[str, list[Path]] = {}
        for path in self.folder.iterdir():
            if path.name in LOCKS:
                continue
            groups.setdefault(path.name.partition(".py")[0], []).append(path)
        count = 0
        for _, _, _, paths in sorted(
            (
                (name.rpartition("-")[2] in ours, max(map(_used_at, paths)), name, paths)
                for name, paths in groups.items()
            ),
            reverse=True,
        ):
            count += len(paths)
            if count > MAX_FILES:
                for path in paths:
                    shutil.rmtree(path, ignore_errors=True) if path.is_dir() else path.unlink(missing_ok=True)

    @functools.cached_property
    def _all_sources(self) -> str:
        return sources_digest(self._root)

    @functools.cached_property
    def _compiler(self) -> str:
        versions = [f"{package} {metadata.version(package)}" for package in COMPILER]
        return " ".join([f"Python {sys.version_info[0]}.{sys.version_info[1]}", *versions])

    @property
    def _completed(self) -> Path:
        key = _digest(self._all_sources, f"{OPTIONS} {self._compiler} {_processor()}")
        return (self.folder or Path("nowhere")) / f"complete-{key}.json"

    def _write(self, name: str, content: object) -> None:
        """Write a file at once: others may read it meanwhile. Without a folder, or on a full disk, do nothing."""
        if self.folder:
            new = self.folder / f"{name}.tmp.{uuid.uuid4().hex}"
            with contextlib.suppress(OSError):
                new.write_text(json.dumps(content))
                new.replace(self.folder / name)


@functools.lru_cache
def store() -> KernelStore:
    """The kernels of RoboCorba, in NUMBA_CACHE_DIR, else in the user's cache folder."""
    return KernelStore(Path(__file__).parents[1], cache_folder())


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
    return None


@contextlib.contextmanager
def lock(path: Path, limit_s: float) -> Iterator[None]:
    """Hold a lock between processes; without it after `limit_s` [s], or where the file system has no locks."""
    deadline = time.monotonic() + limit_s
    with path.open("a") as file:
        while True:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except OSError as error:
                if not isinstance(error, BlockingIOError) or time.monotonic() > deadline:
                    break
            time.sleep(_INTERVAL_S)
        yield


def _processor() -> str:
    """Model and features of this machine's processor: kernels use what it has."""
    with contextlib.suppress(OSError):
        first = Path("/proc/cpuinfo").read_text().partition("\n\n")[0].splitlines()
        return "\n".join(line for line in first if line.startswith(("model name", "flags", "Features", "CPU ")))
    return platform.processor()


def _digest(*parts: str) -> str:
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:DIGITS]


def _used_at(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0
