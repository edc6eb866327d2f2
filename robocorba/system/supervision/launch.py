"""Start child processes: with which import path, bound to the life of this process, watched by their output."""

from __future__ import annotations

import contextlib
import os
import queue
import shlex
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from robocorba.system.background import Background

#: Time from SIGTERM to SIGKILL [s].
GRACE_PERIOD_S = 15.0
#: Runs a module as `python -P -m` does; that option came with Python 3.11.
_WITHOUT_CURRENT_DIRECTORY = (
    "import sys; sys.path.remove(''); import runpy; sys.argv.pop(0); "
    "runpy.run_module(sys.argv[0], run_name='__main__', alter_sys=True)"
)
_RUN_MODULE = ("-P", "-m") if sys.version_info >= (3, 11) else ("-c", _WITHOUT_CURRENT_DIRECTORY)


@dataclass(frozen=True)
class ModuleRun:
    """A module of RoboCorba to run with arguments: its function `main(arguments)`, or `python -m`."""

    name: str
    arguments: tuple[str, ...] = ()

    @property
    def title(self) -> str:
        """What lists of processes show."""
        return shlex.join(module_command(self.name, *self.arguments))


def module_command(module: str, *arguments: str) -> tuple[str, ...]:
    """The command line that runs a module with this interpreter. The current directory is not on its import path, so a
    file there can't replace a module."""
    return (sys.executable, *_RUN_MODULE, module, *arguments)


def bound_command(*command: str, cores: Sequence[int] = ()) -> tuple[str, ...]:
    """The command line that runs `command`, on `cores` or on all, and is killed when this process ends. Start it in the
    main thread: the kernel kills it when the thread that started it ends."""
    child = str(Path(__file__).with_name("child.py"))
    # -I -S: a bare interpreter starts in 20 ms and ignores the environment.
    return (sys.executable, "-I", "-S", child, str(os.getpid()), ",".join(map(str, cores)), *command)


class ChildProcess(subprocess.Popen[str]):
    """A command bound to this process, running inside a `with`: SIGTERM ends it, SIGKILL after `grace_period_s`.

    Ctrl-C in the terminal does not reach it. Start it in the main thread, see `bound_command`. options: as of
    subprocess.Popen; its stdin is empty by default."""

    def __init__(
        self, *command: str, cores: Sequence[int] = (), grace_period_s: float = GRACE_PERIOD_S, **options: Any
    ) -> None:
        self._grace_period_s = grace_period_s
        options = {"stdin": subprocess.DEVNULL, **options}
        super().__init__(bound_command(*command, cores=cores), text=True, start_new_session=True, **options)

    def __exit__(self, *raised: object) -> None:
        self.terminate()
        try:
            self.wait(self._grace_period_s)
        except subprocess.TimeoutExpired:
            self.kill()
            self.wait()

    @property
    def is_running(self) -> bool:
        return self.poll() is None


class LoggedProcess(ChildProcess):
    """A child process that is read line by line; its stderr is appended to `log`. Options as of ChildProcess."""

    def __init__(self, log: Path, *command: str, **options: Any) -> None:
        self.log = log
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        with log.open("a") as stderr:
            super().__init__(*command, stdout=subprocess.PIPE, stderr=stderr, **options)
        # Without its reader the process is of no use: readers of lines find its end.
        self._reader = Background(f"stdout of {log.stem}", self._read, lambda reason: self._lines.put(""))
        self._reader.start()

    def __exit__(self, *raised: object) -> None:
        super().__exit__(*raised)
        if self.stdin is not None:
            with contextlib.suppress(OSError):
                self.stdin.close()
        self._reader.join(self._grace_period_s)

    def read_line(self, timeout_s: float) -> str:
        """The next line of its stdout, with its newline; empty if it has ended. Raises TimeoutError."""
        try:
            line = self._lines.get(timeout=max(0.0, timeout_s))
        except queue.Empty:
            raise TimeoutError(f"no line within {timeout_s:g} s") from None
        if not line:
            self._lines.put(line)  # for the next call
        return line

    def log_tail(self, size: int = 2000) -> str:
        """The last `size` characters of its log."""
        return self.log.read_text(errors="replace")[-size:]

    def _read(self) -> None:
        assert self.stdout is not None
        with self.stdout as lines:
            for line in lines:
                self._lines.put(line)
        self._lines.put("")
