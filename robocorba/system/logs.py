"""Logs: one rotating file per process in STATE/logs, one line per event.

    2026-03-01T12:00:00.123+01:00 WARNING map_editor the naming service does not answer

Line breaks in messages and tracebacks are escaped. Warnings and errors also go to stderr, without tracebacks. Logging
never raises: what a full disk does not hold is lost, and the next line that fits is preceded by one with their number.
"""

from __future__ import annotations

import contextlib
import io
import logging
import select
import sys
import threading
from datetime import datetime
from logging.handlers import RotatingFileHandler
from pathlib import Path
from types import TracebackType
from typing import Any

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.services import ServiceError

#: Size of a log file [bytes].
MAX_BYTES = 5 * 1024 * 1024
#: Number of rotated files kept for each process.
OLD_FILES = 3
#: Size of the end of a log file that `last_lines` reads [bytes].
MAX_TAIL = 512 * 1024

#: All control characters, whatever some reader treats as a line break, the characters that overrule the direction of
#: text, by which a line could be shown in another order, and surrogates, which can't be written. All but the first 32,
#: which JSON escapes itself, are escaped in a form that is valid in JSON too.
_ESCAPES = {code: f"\\x{code:02x}" for code in range(32)}
_ESCAPES |= {code: f"\\u{code:04x}" for code in (*range(127, 160), *range(0x2028, 0x202F), *range(0x2066, 0x206A))}
_ESCAPES |= {code: f"\\u{code:04x}" for code in range(0xD800, 0xE000)}
_ESCAPES |= {ord("\n"): "\\n", ord("\r"): "\\r", ord("\t"): "\\t"}


def setup(name: str, folder: Path, with_stderr: bool = True) -> None:
    """Log this process to `folder`/`name`.log from INFO up, and with `with_stderr` to stderr from WARNING up.

    Uncaught exceptions of all threads are logged too. Raises ServiceError."""
    root = logging.getLogger()
    for old in root.handlers[:]:
        root.removeHandler(old)
        old.close()
    root.setLevel(logging.INFO)
    root.addHandler(_file(name, folder))
    stderr = _Stderr()
    stderr.setLevel(logging.WARNING)
    if with_stderr:
        root.addHandler(stderr)
    logging.captureWarnings(True)
    sys.excepthook = _log_uncaught
    threading.excepthook = lambda args: _log_uncaught(args.exc_type, args.exc_value, args.exc_traceback)


def open_log(name: str, folder: Path) -> logging.Logger:
    """A log file on behalf of a process that writes none, such as omniNames. Raises ServiceError."""
    log = logging.getLogger(f"process.{name}")
    for old in log.handlers[:]:
        log.removeHandler(old)
        old.close()
    log.addHandler(_file(name, folder))
    log.propagate = False
    return log


def last_lines(file: Path, count: int) -> list[str]:
    """The last lines of a log, the oldest first; fewer where MAX_TAIL or two files hold no more."""
    lines: list[str] = []
    for part in (file, file.with_name(f"{file.name}.1")):
        if len(lines) < count:
            lines = _tail(part) + lines
    return lines[max(0, len(lines) - count) :]


def _tail(file: Path) -> list[str]:
    try:
        with file.open("rb") as log:
            size = log.seek(0, 2)
            log.seek(max(0, size - MAX_TAIL))
            lines = log.read(MAX_TAIL).split(b"\n")
    except OSError:
        return []
    if size > MAX_TAIL:
        del lines[0]  # a part of a line
    return [one_line(line.decode(errors="backslashreplace")) for line in lines if line]


def one_line(text: str) -> str:
    """`text` with all line breaks and control characters escaped."""
    return text.translate(_ESCAPES)


def _file(name: str, folder: Path) -> logging.Handler:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handler = _LogFile(
            folder / f"{name}.log",
            maxBytes=MAX_BYTES,
            backupCount=OLD_FILES,
            encoding="utf-8",
            errors="backslashreplace",
        )
    except OSError as error:
        raise ServiceError(f"can't write {folder / name}.log: {error.strerror}") from None
    handler.process = name
    return handler


class _LogFile(RotatingFileHandler):
    """Counts lines that can't be written. process: named in each line."""

    process = ""
    _lost = 0

    def format(self, record: logging.LogRecord) -> str:
        time = datetime.fromtimestamp(record.created).astimezone().isoformat(timespec="milliseconds")
        return f"{time} {record.levelname} {self.process} {one_line(super().format(record))}"

    def emit(self, record: logging.LogRecord) -> None:
        lost, self._lost = self._lost, 0
        if lost:
            text = "%d lines before this one are missing: the disk was full, or the file could not be written"
            self._end_line()
            attributes = {"levelno": logging.WARNING, "levelname": "WARNING", "msg": text, "args": (lost,)}
            super().emit(logging.makeLogRecord(attributes))
            if self._lost:  # it still is
                self._lost = lost + 1
                return
        super().emit(record)

    def _end_line(self) -> None:
        """End a line of which only a part was written."""
        with contextlib.suppress(OSError), open(self.baseFilename, "r+b") as file:
            file.seek(-1, io.SEEK_END)
            if file.read(1) != b"\n":
                file.write(b"\n")

    def handleError(self, record: logging.LogRecord) -> None:
        if isinstance(sys.exc_info()[1], OSError):
            self._lost += 1
        else:
            super().handleError(record)

    def _open(self) -> io.TextIOWrapper:
        # Without a buffer, which would keep what a full disk refuses and add every further line to it.
        raw: Any = io.FileIO(self.baseFilename, self.mode)
        return io.TextIOWrapper(raw, self.encoding, self.errors, write_through=True)


class _Stderr(logging.StreamHandler):  # Python 3.10 has no StreamHandler[...]
    """Never waits for a reader of stderr: a full pipe that nobody reads would hold up each thread that logs, such as
    one that stops a robot. What does not fit is left out and counted; the log file has it."""

    _lost = 0

    def format(self, record: logging.LogRecord) -> str:
        # Characters have up to four bytes: with a line before it, it fits into PIPE_BUF bytes.
        return f"{record.levelname} {one_line(record.getMessage())}"[:1000]

    def emit(self, record: logging.LogRecord) -> None:
        if not _accepts_line(self.stream):
            self._lost += 1
            return
        lost, self._lost = self._lost, 0
        if lost:
            self.stream.write(f"WARNING {lost} lines before this one are missing: they were not read in time\n")
        super().emit(record)


def _accepts_line(stream: Any) -> bool:
    """Whether a line can be written at once: a pipe that accepts anything accepts PIPE_BUF bytes."""
    writable = select.poll()
    try:
        writable.register(stream, select.POLLOUT)
        return bool(writable.poll(0))
    except (OSError, TypeError, ValueError):  # no descriptor, which a test may have put here
        return True


def _log_uncaught(
    kind: type[BaseException], error: BaseException | None, traceback: TracebackType | None = None
) -> None:
    if error is None or not issubclass(kind, Exception):
        sys.__excepthook__(kind, error or kind(), traceback)
    elif isinstance(error, RoboCorbaError):
        logging.getLogger().critical("%s", error)
    else:
        logging.getLogger().critical("%s: %s", kind.__name__, error, exc_info=(kind, error, traceback))
