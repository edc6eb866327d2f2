"""The memory allocator of the C library in processes whose connections have threads of their own.

glibc gives threads heaps of their own, up to eight for each core, and after large blocks were freed it takes blocks of
up to 32 MB from these heaps as well, which keep them. Ten clients that asked for large pictures once made a server keep
250 MB for good."""

from __future__ import annotations

import ctypes

#: Blocks of this size and more are returned to the operating system when they are freed, and so is the end of a heap.
LARGE_BYTES = 4 * 2**20
#: Maximum number of heaps.
HEAPS = 4
#: Interval between two calls of `trim` in a server [s].
TRIM_INTERVAL_S = 30.0
#: Parameters of mallopt(3).
_TRIM_THRESHOLD, _MMAP_THRESHOLD, _ARENA_MAX = -1, -3, -8


def return_freed_memory() -> bool:
    """Let this process return freed memory; False where the C library has no such settings."""
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError):
        return False
    settings = {_MMAP_THRESHOLD: LARGE_BYTES, _TRIM_THRESHOLD: LARGE_BYTES, _ARENA_MAX: HEAPS}
    accepted = [mallopt(parameter, value) for parameter, value in settings.items()]
    return all(accepted)


def trim() -> None:
    """Return the free pages of all heaps, also those in the middle, for example of thousands of connections that have
    ended: 17 of 30 MB in a channel. It takes up to 10 ms. Only where `return_freed_memory` is True."""
    ctypes.CDLL(None).malloc_trim(0)
