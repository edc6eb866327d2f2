"""Robot processes forked from one that has loaded all modules and kernels: thirty start in seconds.

python -m bench.missions.nursery prints a line when it is ready. For each line of JSON on stdin, [FILE, ARGUMENT, ...],
it forks a process that runs `robocorba robot ARGUMENT ...` with its output in FILE, and prints the process id. It ends
with its stdin, and the robots end with it."""

from __future__ import annotations

import faulthandler
import gc
import os
import random
import signal
import sys
from collections.abc import Sequence
from pathlib import Path

from robocorba.clients import robot
from robocorba.kinematics.inverse import InverseKinematics
from robocorba.missions import carry_planning
from robocorba.supervision.child import bind_to_parent
from robocorba.testing.json_process import answer_lines


def fork(command: Sequence[str]) -> int:
    """Fork a robot; returns its process id."""
    if pid := os.fork():
        return pid
    code = 1
    try:
        bind_to_parent(signal.SIGTERM)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        random.seed()
        out, *arguments = command
        for descriptor, file, flags in ((0, os.devnull, os.O_RDONLY), (1, out, os.O_CREAT | os.O_WRONLY)):
            os.dup2(os.open(file, flags, 0o600), descriptor)
        os.dup2(1, 2)
        faulthandler.register(signal.SIGUSR1)  # prints the stacks of all threads
        robot.main(arguments)
        code = 0
    except BaseException as error:
        print(f"robot: {error}", file=sys.stderr)
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


if __name__ == "__main__":
    carry_planning.warm_up()
    InverseKinematics()
    gc.freeze()
    if len(list(Path("/proc/self/task").iterdir())) > 1:
        sys.exit("nursery: a fork would lose the threads that run already; set OPENBLAS_NUM_THREADS=1")
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # children are reaped automatically
    answer_lines(fork)
