"""Run a program that ends when its supervisor ends: python child.py SUPERVISOR_PID PROGRAM ARGUMENTS.

A file of its own, started by a bare interpreter, because code between fork and exec in a process with
threads (preexec_fn) can deadlock. It imports nothing of RoboCorba.
"""

import ctypes
import os
import signal
import sys

PR_SET_PDEATHSIG = 1


def main(supervisor: int, command: list[str]) -> None:
    """Never returns: becomes `command`, or exits."""
    # SIGKILL, because nobody is left to insist with when a SIGTERM is ignored.
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != supervisor:
        sys.exit("the supervisor has ended already")
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # this interpreter ignores it, the program shall decide itself
    try:
        os.execvp(command[0], command)
    except OSError as wrong:
        sys.exit(f"can't run {command[0]}: {wrong.strerror}")


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2:])
