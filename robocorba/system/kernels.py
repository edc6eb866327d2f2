"""Functions compiled by numba, and its cache, which keeps what they are compiled to in the folder of `kernel_store`."""

from __future__ import annotations

import contextlib
import logging
import os
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.core import config
from numba.core.caching import FunctionCache
from numba.extending import register_jitable

from robocorba.system.kernel_store import OPTIONS, lock, store

#: Timeout for another process to write [s]. It takes milliseconds.
WRITE_LIMIT_S = 5.0

F = TypeVar("F", bound=Callable[..., Any])

_log = logging.getLogger(__name__)

# numba takes settings from a file .numba_config.yaml in the current directory: now, and before each compilation.
config._config_fname = os.devnull
config.reload_config()


def _load_numba() -> None:
    """Load numba's functions for arrays without scipy.linalg, which takes each process a fifth of a second of a core.

    numba imports it to see whether there is a BLAS, which no kernel of ours needs. Those of others that use it still
    load it."""
    from numba.np import linalg

    ask, linalg.ensure_blas = linalg.ensure_blas, lambda: None
    try:
        import numba.np.arraymath  # noqa: F401
    finally:
        linalg.ensure_blas = ask


_load_numba()


class KernelCache(FunctionCache):
    """The compiled signatures of a function. A damaged file or a full disk costs a compilation.

    numba reads and writes the index of a function's signatures without a lock: of two processes that do so at once one
    would lose its entry, or find the code of the other's signature under its own. Here they take turns."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._cache_file._source_stamp = ""  # not when the file was written: the folder is for what is in it

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled signature, None if it has to be compiled."""
        try:
            return super().load_overload(sig, target_context)
        except Exception as error:  # whatever a damaged file leads to
            _log.warning("%r is damaged (%s) and is compiled again", self, type(error).__name__)
            with contextlib.suppress(OSError), self._writing():
                self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compiled signature; on a full disk it is compiled again at the next start."""
        try:
            with self._writing():
                super().save_overload(sig, data)
        except OSError as error:
            _log.warning("can't keep a compiled kernel in %s: %s", self.cache_path, error)

    def _writing(self) -> AbstractContextManager[None]:
        return lock(Path(self.cache_path).parents[1] / "writing.lock", WRITE_LIMIT_S)


def kernel(function: F) -> F:
    """Compile a function at its first call, to run without the interpreter's lock.

    A kernel that calls another one with a literal integer or truth value, such as f(0), has it compiled for this value
    alone; for f(np.int64(0)) or f(bool(1)) it is not."""
    compiled = numba.njit(**OPTIONS)(function)
    if folder := store().folder:
        vars(config)["CACHE_DIR"] = str(folder)  # before each: when it compiles, numba reads its environment anew
        cache = KernelCache(function)
        if Path(cache.cache_path).is_relative_to(folder):  # numba goes elsewhere if it can't write there
            compiled._cache = cache
    return cast(F, compiled)


def inner_kernel(function: F) -> F:
    """Compile a function as a part of the kernels that call it, which saves a third of the time for its own use by
    Python; called from Python it is interpreted."""
    return register_jitable(**OPTIONS)(function)
