"""numba's cache of one kernel, in files named by the kernel's digest.

numba's own names its files by the path of the source, and detects a stale kernel only by that file: it would run
callers with an outdated callee, and compile again what has only moved. It also writes the index of a kernel's
signatures without a lock: of two processes that do so at once one would lose its entry, or find the code of the other's
signature under its own. Here they take turns.
"""

from __future__ import annotations

import contextlib
import logging
import os
from pathlib import Path
from typing import Any

from numba.core import config
from numba.core.caching import CompileResultCacheImpl, FunctionCache, _CacheLocator

from robocorba.system.kernel_store import WRITING, lock

#: Timeout for another process to write [s]. It takes milliseconds.
WRITE_LIMIT_S = 5.0
#: Timeout for another worker to compile a kernel that this one needs, too [s]. The largest takes 20 s on a busy core.
CLAIM_LIMIT_S = 120.0

_log = logging.getLogger(__name__)

# numba takes settings from a file .numba_config.yaml in the current directory: now, and before each compilation.
config._config_fname = os.devnull
config.reload_config()


class _Place(_CacheLocator):
    """Where the files of a kernel are, as numba asks for it."""

    def __init__(self, folder: Path, digest: str) -> None:
        self._folder, self._digest = folder, digest

    def get_cache_path(self) -> str:
        return str(self._folder)

    def get_source_stamp(self) -> str:
        return self._digest

    def get_disambiguator(self) -> str:
        return self._digest


class KernelCache(FunctionCache):
    """The compiled signatures of a function."""

    def __init__(self, function: Any, folder: Path, digest: str) -> None:
        class Locator(_Place):
            @classmethod
            def from_function(cls, py_func: Any, py_file: str) -> _Place:
                return cls(folder, digest)

        implementation: Any = type("Implementation", (CompileResultCacheImpl,), {"_locator_classes": [Locator]})
        self._impl_class = implementation
        super().__init__(function)
        self.name = f"{function.__module__}.{function.__qualname__}"
        self._folder = folder
        self._index = folder / f"{self._impl.filename_base}.nbi"

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled signature, None if it has to be compiled."""
        found = self._load(sig, target_context)
        if found is None and shared_work and shared_work.claim(self.name):
            found = self._load(sig, target_context)
            if found is not None:
                shared_work.release(self.name)
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compiled signature; on a full disk it is compiled again at the next start."""
        try:
            with lock(self._folder / WRITING, WRITE_LIMIT_S):
                super().save_overload(sig, data)
        except OSError as error:
            _log.warning("can't keep a compiled kernel in %s: %s", self._folder, error)
        finally:
            if shared_work:
                shared_work.release(self.name)

    def _load(self, sig: Any, target_context: Any) -> Any:
        try:
            found = super().load_overload(sig, target_context)
            if found is not None:
                os.utime(self._index)
            return found
        except Exception as error:  # whatever a damaged file leads to
            _log.warning("%s is damaged (%s) and is compiled again", self._index.name, type(error).__name__)
            with contextlib.suppress(OSError):
                self._index.unlink()
            return None


class SharedWork:
    """What several processes compile together: one that needs a kernel waits while another compiles it.

    folder: of their own, empty at first."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._held: dict[str, contextlib.ExitStack] = {}

    def take(self, step: str) -> bool:
        """Whether this process is the first one that takes this step."""
        try:
            (self._folder / f"{step}.taken").touch(exist_ok=False)
        except FileExistsError:
            return False
        return True

    def claim(self, name: str) -> bool:
        """Wait until no other process compiles a kernel; it can't be claimed again. False: this one has claimed it."""
        if name in self._held:
            return False
        with contextlib.ExitStack() as stack:
            stack.enter_context(lock(self._folder / f"{name}.lock", CLAIM_LIMIT_S))
            self._held[name] = stack.pop_all()
        return True

    def release(self, name: str) -> None:
        """Let others load the kernel."""
        if name in self._held:
            self._held.pop(name).close()


#: Set in processes that compile together.
shared_work: SharedWork | None = None
