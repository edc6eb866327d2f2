"""Private parts of omniORBpy that this system uses, and corrections of faults of omniORB and the C library: all of them
are in this file.

Seen in omniORB 4.3.3 and omniORBpy 4.3.3. tests/orb/test_workarounds.py fails where a part is gone or a fault is cured;
then what stands here for it can go, too.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import omniORB
from omniORB import CORBA, WTHREAD_CREATED, WorkerThread, addWThreadHook, interceptors
from omniORB import tcInternal as tc

# ---- types: tcInternal and typeMapping ----
#
# omniORBpy describes each type of the stubs by a tuple, documented in the source of its tcInternal only. No other
# way says how values are to be read, and checked before they are (see bounded_any, texts). To report: reading by
# recursion without a limit ends the process, as does a type or a reference whose texts are empty or not UTF-8.


def named_type(repository_id: str) -> Any:
    """The descriptor of a type of the stubs."""
    return omniORB.typeMapping[repository_id]


def has_stubs(repository_id: str) -> bool:
    """Whether there are stubs of an interface."""
    return repository_id in omniORB.objrefMapping


def operations_of(servant: Any) -> dict[str, Any]:
    """By their names, what goes in, comes out and is raised by the operations of a servant or its class."""
    return getattr(servant, "_omni_op_d", {})


def read_arguments_as(servant: Any, described: Callable[[str, Any], Any]) -> None:
    """Let a servant's class read the arguments of each operation by other descriptors."""
    servant._omni_op_d = {
        name: (described(name, arguments), *rest) for name, (arguments, *rest) in operations_of(servant).items()
    }


def operation_of(interface: Any, operation: str) -> Any:
    """The same of an operation of an interface as `operations_of` has it, for `invoke_described`."""
    return getattr(interface, f"_d_{operation}")


def invoke_described(reference: Any, operation: str, described: Any, arguments: tuple[Any, ...]) -> Any:
    """Call an operation by other descriptors than those of the stubs."""
    return reference._obj.invoke(operation, described, arguments)


def descriptor_of(typecode: Any) -> Any:
    return typecode._d


class DescribedType(CORBA.TypeCode):
    """For omniORB.cdrUnmarshal: a type by its descriptor, which need not be one of CORBA."""

    def __init__(self, descriptor: Any) -> None:
        self._d, self._k = descriptor, CORBA.tk_any


# ---- values of types without stubs ----


def unknown_value(repository_id: str, base: Any) -> type:
    """The class for a valuetype, made when the first value arrives. base: a descriptor with the base class at [1];
    tv_null, an integer, for none.

    omniORBpy has such a function, but it confuses isinstance with issubclass for a valuetype that derives from another
    unknown one, and tries to make a class that Python refuses. Then an assertion of its core fails, and threads of the
    process hang or spin. To report: createUnknownValue in omniORB/__init__.py."""
    known = omniORB.UnknownValueBase if base == tc.tv_null else base[1]
    bases = (known,) if issubclass(known, omniORB.UnknownValueBase) else (omniORB.UnknownValueBase, known)
    return type("UnknownValue", bases, {"_NP_RepositoryId": repository_id})


def correct_omniorb() -> None:
    """Correct the ORB of this process.

    An enumeration may come without a repository id, which CORBA leaves optional in types; Combat, for one, sends none.
    omniORBpy knows the empty id as that of CORBA::Object, and reads a reference in place of the enumerator. To report:
    the entries "" of typeMapping and typeCodeMapping."""
    omniORB.createUnknownValue = unknown_value
    omniORB.typeMapping.pop("", None)
    tc.typeCodeMapping.pop("", None)


# ---- connections that arrive while a process starts ----
#
# omniORB accepts calls as soon as its first adapter exists, and answers OBJECT_NOT_EXIST, which means permanently gone,
# for objects that are not active yet. So the threads of connections wait before they read the first request. To report:
# an adapter in state HOLDING should hold calls of unknown keys.

#: Whether connections are served; at first they are.
_serves = threading.Event()
_serves.set()


def _await_service() -> None:
    _serves.wait()


@functools.cache
def let_connections_wait() -> None:
    """Make `hold_connections` possible; to be called before the ORB starts."""
    with contextlib.suppress(CORBA.BAD_INV_ORDER):  # others have started one already: then no connection waits
        interceptors.addAssignUpcallThread(_await_service)


def hold_connections() -> None:
    """Serve no connection until `serve_connections`; to be called before the first adapter exists."""
    _serves.clear()


def serve_connections() -> None:
    _serves.set()


# ---- memory ----


def return_freed_memory() -> bool:
    """Let this process return freed blocks of 4 MiB and more, and the ends of heaps, to the operating system, and have
    at most four heaps; False where the C library has no such settings.

    After large blocks were freed, glibc takes blocks of up to 32 MB from the heaps of threads, which keep them, and has
    up to eight heaps for each core. Ten clients that asked for large pictures once made a server keep 250 MB for good;
    beside other work, when many threads wait for the same heap, a sensor server kept 220 MB with the first setting
    alone."""
    settings = {-3: 4 * 2**20, -1: 4 * 2**20, -8: 4}  # M_MMAP_THRESHOLD, M_TRIM_THRESHOLD, M_ARENA_MAX of mallopt(3)
    try:
        mallopt = ctypes.CDLL(None).mallopt
        return all(mallopt(parameter, value) for parameter, value in settings.items())
    except (AttributeError, OSError):
        return False


def trim() -> None:
    """Return the free pages of all heaps, also those in the middle, for example of thousands of connections that have
    ended: 17 of 30 MB in a channel. It takes up to 10 ms. Only where `return_freed_memory` is True."""
    ctypes.CDLL(None).malloc_trim(0)


# ---- threads that execute calls ----
#
# They must end before Python does: one that still releases what it has of Python aborts the process. To report:
# ORB.destroy() returns before they have ended.

#: The kernel's ids of those that have begun; more than there may be connections.
_begun: deque[int] = deque(maxlen=8192)


def _note(change: object, thread: WorkerThread) -> None:
    if change == WTHREAD_CREATED:
        _begun.append(threading.get_native_id())


addWThreadHook(_note)


def wait_for_call_threads() -> None:
    """Wait until they have ended, once the ORB has, at most for 5 s. Other systems than Linux are not waited for."""
    listing, latest = Path("/proc/self/task"), time.monotonic() + 5.0
    while _begun and time.monotonic() < latest and listing.is_dir():
        living = {path.name for path in listing.iterdir()}
        while _begun and str(_begun[-1]) not in living:
            _begun.pop()
        if _begun:
            time.sleep(0.001)
