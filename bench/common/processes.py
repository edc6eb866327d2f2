"""The processes of a bench: spoken to by lines of JSON, and ended with whoever started them."""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import queue
import signal
import subprocess
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
PR_SET_PDEATHSIG = 1
END_LIMIT_S = 10.0

_libc = ctypes.CDLL(None)


class ProcessFailed(Exception):
    """A process of a bench did not answer in time, or ended."""


class Process:
    """A running command, on some cores or on all. Its stderr is kept in `log`; it gets SIGTERM where this process dies
    before it."""

    def __init__(
        self,
        command: Sequence[str],
        log: Path,
        cores: Sequence[int] = (),
        environment: Mapping[str, str] | None = None,
        pass_fds: Sequence[int] = (),
    ) -> None:
        self.what = " ".join(command[-4:])
        self._log = log
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()

        def before_it_runs() -> None:
            _libc.prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
            if cores:
                os.sched_setaffinity(0, cores)

        with log.open("w") as errors:
            self._process = subprocess.Popen(
                command,
                cwd=ROOT,
                env={**os.environ, **(environment or {})},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
                pass_fds=pass_fds,
                preexec_fn=before_it_runs,
                start_new_session=True,  # Ctrl-C is ours; we end it
            )
        self._reader = threading.Thread(target=self._read, name=f"from {self.what}", daemon=True)
        self._reader.start()

    def __enter__(self) -> Process:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._process.terminate()
        try:
            self._process.wait(END_LIMIT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait(END_LIMIT_S)
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):
            self._process.stdin.close()
        self._reader.join(END_LIMIT_S)

    @property
    def pid(self) -> int:
        return self._process.pid

    def say(self, value: Any) -> None:
        """Raises ProcessFailed where it has ended."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(value) + "\n")
            self._process.stdin.flush()
        except OSError:
            raise ProcessFailed(f"{self.what} ended: {self._last_words()}") from None

    def hear(self, limit_s: float) -> Any:
        """Its next line. Raises ProcessFailed."""
        try:
            line = self._lines.get(timeout=limit_s)
        except queue.Empty:
            raise ProcessFailed(f"{self.what} did not answer within {limit_s:g} s: {self._last_words()}") from None
        if not line:
            raise ProcessFailed(f"{self.what} ended: {self._last_words()}")
        return json.loads(line)

    def ask(self, value: Any, limit_s: float = 5.0) -> Any:
        """Say something, and hear the answer. Raises ProcessFailed."""
        self.say(value)
        return self.hear(limit_s)

    def _last_words(self) -> str:
        return self._log.read_text(errors="replace")[-2000:]

    def _read(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as lines:
            for line in lines:
                self._lines.put(line)
        self._lines.put("")
