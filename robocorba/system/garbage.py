"""Python's search for cycles of objects, which stops all threads of the process while it runs."""

from __future__ import annotations

import gc
import threading
from collections.abc import Iterator
from contextlib import contextmanager

_lock = threading.Lock()
_pauses = 0


@contextmanager
def collections_paused() -> Iterator[None]:
    """Search for no cycles meanwhile, for code that makes millions of objects and no cycles: each search would traverse
    all of them again, for half a second in which no other call is answered. Thread-safe."""
    global _pauses
    with _lock:
        _pauses += 1
        if _pauses == 1:
            gc.disable()
    try:
        yield
    finally:
        with _lock:
            _pauses -= 1
            if not _pauses:
                gc.enable()
