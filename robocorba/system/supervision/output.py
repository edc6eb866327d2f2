"""What supervised processes print: warnings go to the supervisor's log, and `ready` says that a process serves."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
from collections.abc import Callable, Iterator

from robocorba.errors.services import NotReachable

#: What a process prints that is ready by its own account.
READY = "ready"

_log = logging.getLogger(__name__)


def relay(name: str, line: str) -> None:
    """Log a line of a process with its own level; lines without one are warnings."""
    levels = {"WARNING": logging.WARNING, "ERROR": logging.ERROR, "CRITICAL": logging.CRITICAL}
    level, _, text = line.partition(" ")
    text = text if level in levels else line
    _log.log(levels.get(level, logging.WARNING), "%s: %s", name, text)


class Pipe:
    """A pipe from a process to the event loop. Not that of asyncio's subprocesses: some Python versions consider a
    process alive while others hold the pipe's write end."""

    def __init__(self, reader: asyncio.StreamReader, write_end: int) -> None:
        self._reader, self._write_end = reader, write_end

    @classmethod
    async def open(cls) -> Pipe:
        read_end, write_end = os.pipe()
        reader = asyncio.StreamReader()
        await asyncio.get_running_loop().connect_read_pipe(
            lambda: asyncio.StreamReaderProtocol(reader), os.fdopen(read_end, "rb", 0)
        )
        return cls(reader, write_end)

    @contextlib.contextmanager
    def write_end(self) -> Iterator[int]:
        """The descriptor for the process that writes; closed here at the end of the `with`."""
        try:
            yield self._write_end
        finally:
            os.close(self._write_end)

    async def read(self, handle: Callable[[str], None]) -> None:
        """Call `handle` with each line that is not empty, until all processes that write have ended."""
        rest = b""
        while chunk := await self._reader.read(65536):
            *lines, rest = (rest + chunk).split(b"\n")
            if len(rest) > 16 * 1024:  # longer lines are split
                lines, rest = [*lines, rest], b""
            for line in lines:
                _handle(line, handle)
        _handle(rest, handle)


def _handle(line: bytes, handle: Callable[[str], None]) -> None:
    if text := line.decode(errors="backslashreplace").strip():
        try:
            handle(text)
        except Exception:  # nobody would read on, and the process would stop at a full pipe
            _log.exception("a line that a process has printed was not handled")


class ReadyLine:
    """Receives what a process prints; `probe` fails until the line `ready`. ignored: the beginning of lines that are
    not logged, empty for none."""

    def __init__(self, name: str, ignored: str = "") -> None:
        self._name, self._ignored, self._is_ready = name, ignored, False

    def __call__(self, line: str) -> None:
        if line == READY:
            self._is_ready = True
        elif not self._ignored or not line.startswith(self._ignored):
            relay(self._name, line)

    def probe(self) -> None:
        """Raises NotReachable before `ready`, and again after a success: a restarted process has to print it again."""
        if not self._is_ready:
            raise NotReachable(f"{self._name} is not ready")
        self._is_ready = False
