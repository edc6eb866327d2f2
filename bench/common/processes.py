"""The processes of a bench, which exchange lines of JSON with it."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from robocorba.supervision.launch import LoggedProcess

ROOT = Path(__file__).resolve().parents[2]


class ProcessFailed(Exception):
    """A process of a bench did not answer in time, or ended."""


class Process(LoggedProcess):
    """A command in the repository, on some cores or on all. environment: added to that of this process."""

    def __init__(
        self,
        command: Sequence[str],
        log: Path,
        cores: Sequence[int] = (),
        environment: Mapping[str, str] | None = None,
        pass_fds: Sequence[int] = (),
    ) -> None:
        self._name = " ".join(command[-4:])
        both = {**os.environ, **(environment or {})}
        options = {"cwd": ROOT, "env": both, "cores": cores, "pass_fds": pass_fds, "stdin": subprocess.PIPE}
        super().__init__(log, *command, **options)

    def send(self, value: Any) -> None:
        """Send a value. Raises ProcessFailed where the process has ended."""
        try:
            self.write_line(json.dumps(value))
        except OSError:
            raise ProcessFailed(f"{self._name} ended: {self.log_tail()}") from None

    def receive(self, limit_s: float) -> Any:
        """Receive the next value. Raises ProcessFailed."""
        try:
            line = self.read_line(limit_s)
        except TimeoutError:
            raise ProcessFailed(f"{self._name} did not answer within {limit_s:g} s: {self.log_tail()}") from None
        if not line:
            raise ProcessFailed(f"{self._name} ended: {self.log_tail()}")
        return json.loads(line)

    def ask(self, value: Any, limit_s: float = 5.0) -> Any:
        """Send a value and receive the answer. Raises ProcessFailed."""
        self.send(value)
        return self.receive(limit_s)
