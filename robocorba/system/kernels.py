"""Functions compiled by numba. What they are compiled to is kept on disk, see `kernel_cache`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

from robocorba.system.kernel_cache import KernelCache
from robocorba.system.kernel_store import OPTIONS, store

F = TypeVar("F", bound=Callable[..., Any])


def _load_numba() -> None:
    """Load numba's functions for arrays without scipy.linalg, which takes each process a third of a second of a core.

    numba imports it to see whether there is a BLAS, which no kernel of ours needs. Those of others that use it still
    load it."""
    from numba.np import linalg

    ask, linalg.ensure_blas = linalg.ensure_blas, lambda: None
    try:
        import numba.np.arraymath  # noqa: F401
    finally:
        linalg.ensure_blas = ask


_load_numba()


def kernel(function: F) -> F:
    """Compile a function at its first call, to run without the interpreter's lock."""
    compiled = numba.njit(**OPTIONS)(function)
    source = store().sources.get(f"{function.__module__}.{function.__qualname__}")
    if source and (folder := store().folder):
        compiled._cache = KernelCache(function, folder, source.digest)
    return cast(F, compiled)
