"""The warm parent: a process of one thread that has loaded the modules of the servers, and forks each server.

A fork shares what is loaded, so a server starts within a fraction of a second, and has only what it changes for itself.
`starter.py` starts this process with one end of a socket, and asks for processes with requests as JSON:

    {"module": "robocorba.servers.simulation", "arguments": [...], "cwd": "/...", "title": "..."}
        with a descriptor for the output, or three for stdin, stdout and stderr: forks a process that calls the
        module's main(arguments); answered by {"pid": 123} or {"error": "..."}. With "environment", it has that one
    {"module": "robocorba.servers.simulation"}
        loads the module; answered by {}

A module may have a function `preload()`, which compiles or loads its kernels. The new process is a child of the process
that asked, which must be a subreaper (PR_SET_CHILD_SUBREAPER): it does not depend on this one. Not the standard
library's forkserver: its processes are children of the fork server, so that nobody learns how they ended once that has
ended, nor are they killed with the process that asked for them.
"""

from __future__ import annotations

import contextlib
import fcntl
import gc
import importlib
import json
import logging
import os
import random
import signal
import socket
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import setproctitle

from robocorba.system.settings import replace_environment
from robocorba.system.supervision.child import bind_to_parent

#: Maximum length of a request [bytes].
MAX_REQUEST = 128 * 1024
#: Libraries would start threads for linear algebra when they are loaded; after a fork these are missing.
ENVIRONMENT = ("OPENBLAS_NUM_THREADS=1", "OMP_NUM_THREADS=1", "MKL_NUM_THREADS=1")


def serve(channel: socket.socket) -> Callable[[], object] | None:
    """Carry out requests until the other end of the socket is closed. In a new process, returns what it has to run."""
    supervisor = os.getppid()
    while True:
        data, descriptors, _, _ = socket.recv_fds(channel, MAX_REQUEST, 3)
        if not data:
            return None
        request = json.loads(data)
        answer: dict[str, Any] = {}
        try:
            module = load(request["module"])
            if descriptors:
                check_forkable()
                pid = _fork()
                if not pid:
                    channel.close()
                    return lambda: _become(module, request, descriptors, supervisor)
                answer = {"pid": pid}
        except Exception as error:
            answer = {"error": f"{type(error).__name__}: {error}"}
        for descriptor in descriptors:
            os.close(descriptor)
        channel.send(json.dumps(answer).encode())


def load(name: str) -> Any:
    """The module, imported and with its kernels loaded."""
    if name in sys.modules:
        return sys.modules[name]
    module = importlib.import_module(name)
    getattr(module, "preload", lambda: None)()
    return module


def check_forkable() -> None:
    """Raises RuntimeError unless this process can be forked: a new process would lack all threads but one, and share
    sockets, files and the states of random generators."""
    if (threads := len(list(Path("/proc/self/task").iterdir()))) > 1:
        raise RuntimeError(f"the warm parent has {threads} threads")


def _fork() -> int:
    """Fork a process whose parent will be the supervisor. Returns its process id, in the new process 0."""
    gc.freeze()  # collections in the new process would write to, and so copy, what is shared
    reading, writing = os.pipe()
    between = os.fork()
    if between:
        os.close(writing)
        os.waitpid(between, 0)  # from here on the new process is a child of the supervisor
        with os.fdopen(reading, "rb") as pipe:
            answer = pipe.read()
        if not answer:
            raise OSError("no process was made")
        return int(answer)
    os.close(reading)
    try:
        pid = os.fork()
    except OSError:
        os._exit(1)
    if pid:
        os.write(writing, str(pid).encode())
        os._exit(0)
    os.close(writing)
    return 0


def _become(module: Any, request: dict[str, Any], descriptors: Sequence[int], supervisor: int) -> object:
    """Be as if started alone, then run the module's main."""
    os.setsid()  # Ctrl-C in the terminal reaches only the supervisor
    _redirect(*descriptors)
    separate()
    _bind_to(supervisor)
    os.chdir(request["cwd"])
    sys.argv = [module.__file__, *request["arguments"]]
    set_title(request["title"])
    if environment := request.get("environment"):
        replace_environment(environment)
    return module.main(request["arguments"])


def _redirect(*descriptors: int) -> None:
    """Make these stdin, stdout and stderr; one alone is for the output. They are closed."""
    if len(descriptors) == 1:
        descriptors = (os.open(os.devnull, os.O_RDONLY), *descriptors)
    for target, source in zip((0, 1, 2), (*descriptors, descriptors[-1]), strict=False):
        os.dup2(source, target)
    for source in descriptors:
        os.close(source)


def separate() -> None:
    """Share nothing with the process that this one was forked from: neither pipes, nor random numbers to come."""
    for read_end, write_end in pipes():
        _renew(read_end, write_end)
    random.seed()
    if numpy := sys.modules.get("numpy"):
        numpy.random.seed()


def set_title(title: str) -> None:
    """What lists of processes show of this process."""
    setproctitle.setproctitle(title)
    setproctitle.setthreadtitle(Path(sys.executable).name)  # which is the short name of the process


def pipes() -> list[tuple[int, int]]:
    """Read and write end of each pipe of this process to itself. omniORB opens some when it is loaded, to wake its
    threads."""
    ends: dict[str, list[int]] = {}
    for file in list(Path("/proc/self/fd").iterdir()):
        with contextlib.suppress(OSError):  # the folder's own descriptor is closed
            if (target := str(file.readlink())).startswith("pipe:"):
                ends.setdefault(target, []).append(int(file.name))
    pairs = [sorted(pair, key=_can_write) for pair in ends.values() if len(pair) == 2]
    return [
        (read_end, write_end) for read_end, write_end in pairs if not _can_write(read_end) and _can_write(write_end)
    ]


def _can_write(descriptor: int) -> bool:
    return fcntl.fcntl(descriptor, fcntl.F_GETFL) & os.O_ACCMODE != os.O_RDONLY


def _renew(*ends: int) -> None:
    """Replace both ends of a pipe by those of a new one; processes that share one would wake each other."""
    for former, end in zip(ends, os.pipe(), strict=True):
        os.set_blocking(end, os.get_blocking(former))
        os.dup2(end, former, os.get_inheritable(former))
        os.close(end)


def _bind_to(supervisor: int) -> None:
    """End with the process that asked for this one; wait until that is the parent."""
    deadline = time.monotonic() + 10.0
    while os.getppid() != supervisor:
        if time.monotonic() > deadline:
            sys.exit("the supervisor has ended, or is no subreaper")
        time.sleep(0.001)
    bind_to_parent(signal.SIGKILL)
    if os.getppid() != supervisor:
        sys.exit("the supervisor has ended")


def _exit() -> None:
    """End without the interpreter's finalisation, which would write to, and so copy, all that is shared: 0.05 s."""
    logging.shutdown()
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):
            stream.flush()
    os._exit(0)


def main(channel: socket.socket) -> None:
    """Carry out requests; in a new process run what was asked for, and never return."""
    gc.disable()
    with channel:
        run = serve(channel)
    if run:
        gc.enable()
        run()
        _exit()


if __name__ == "__main__":
    main(socket.socket(fileno=int(sys.argv[1])))
