"""Start child processes: with which import path, bound to the life of this process, watched by their output."""

from __future__ import annotations

import contextlib
import os
import queue
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import TypeVar

#: Time from SIGTERM to SIGKILL [s].
END_LIMIT_S = 15.0
#: Runs a module as `python -P -m` does; that option came with Python 3.11.
_WITHOUT_CURRENT_DIRECTORY = (
    "import sys; sys.path.remove(''); import runpy; sys.argv.pop(0); "
    "runpy.run_module(sys.argv[0], run_name='__main__', alter_sys=True)"
)
_RUN_MODULE = ("-P", "-m") if sys.version_info >= (3, 11) else ("-c", _WITHOUT_CURRENT_DIRECTORY)
_CHILD = str(Path(__file__).with_name("child.py"))

S = TypeVar("S", bound="ChildProcess")


def module_command(module: str, *arguments: str) -> tuple[str, ...]:
    """The command line that runs a module with this interpreter. The current directory is not on its import path, so a
    file there can't replace a module."""
    return (sys.executable, *_RUN_MODULE, module, *arguments)


def bound_command(*command: str, cores: Sequence[int] = ()) -> tuple[str, ...]:
    """The command line that runs `command`, on `cores` or on all, and is killed when this process ends. Start it in the
    main thread: the kernel kills it when the thread that started it ends."""
    # -I -S: a bare interpreter starts in 20 ms and ignores the environment.
    return (sys.executable, "-I", "-S", _CHILD, str(os.getpid()), ",".join(map(str, cores)), *command)


class ChildProcess:
    """A command bound to this process, running inside a `with`: SIGTERM ends it, after END_LIMIT_S SIGKILL.

    Its stderr is appended to `log`. Ctrl-C in the terminal does not reach it. Start it in the main thread, see
    `bound_command`. environment: replaces that of this process. Without `has_stdin` its stdin is empty."""

    def __init__(
        self,
        log: Path,
        *command: str,
        cwd: Path | None = None,
        environment: Mapping[str, str] | None = None,
        cores: Sequence[int] = (),
        pass_fds: Sequence[int] = (),
        has_stdin: bool = False,
    ) -> None:
        self.log = log
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        with log.open("a") as stderr:
            self._process = subprocess.Popen(
                bound_command(*command, cores=cores),
                cwd=cwd,
                env=environment,
                stdin=subprocess.PIPE if has_stdin else subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=stderr,
                text=True,
                pass_fds=pass_fds,
                start_new_session=True,
            )
        self._reader = threading.Thread(target=self._read, name=f"stdout of {log.stem}", daemon=True)
        self._reader.start()

    def __enter__(self: S) -> S:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._process.terminate()
        try:
            self._process.wait(END_LIMIT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._process.stdin is not None:
            with contextlib.suppress(OSError):
                self._process.stdin.close()
        self._reader.join(END_LIMIT_S)

    @property
    def pid(self) -> int:
        return self._process.pid

    @property
    def is_running(self) -> bool:
        return self._process.poll() is None

    def write_line(self, line: str) -> None:
        """Write a line to its stdin. Raises OSError where it has ended."""
        assert self._process.stdin is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()

    def read_line(self, timeout_s: float) -> str:
        """The next line of its stdout, with its newline; empty where it has ended. Raises TimeoutError."""
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
        assert self._process.stdout is not None
        with self._process.stdout as lines:
            for line in lines:
                self._lines.put(line)
        self._lines.put("")
