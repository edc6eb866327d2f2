"""Run a program that ends when its parent ends: python child.py PARENT_PID CORES PROGRAM ARGUMENTS.

CORES: the cores to run on, such as 0,2; empty for all. This is a file of its own, started by a bare interpreter,
because code between fork and exec in a process with threads (preexec_fn) can deadlock. It imports nothing of RoboCorba.
"""

import ctypes
import os
import signal
import sys


def bind_to_parent(number: int) -> None:
    """Let the kernel send this signal to the present process when its parent ends."""
    ctypes.CDLL(None).prctl(1, number)  # PR_SET_PDEATHSIG


def main(parent: int, cores: str, command: list[str]) -> None:
    """Never returns: becomes `command`, or exits."""
    bind_to_parent(signal.SIGKILL)  # a program may ignore SIGTERM, and the parent is no longer there to kill it
    if os.getppid() != parent:
        sys.exit("the parent process has already ended")
    if cores:
        os.sched_setaffinity(0, map(int, cores.split(",")))
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # Python ignores SIGPIPE; the program starts with the default
    try:
        os.execvp(command[0], command)
    except OSError as error:
        sys.exit(f"can't run {command[0]}: {error.strerror}")


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2], sys.argv[3:])
