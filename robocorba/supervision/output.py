"""What supervised processes print: warnings go to the supervisor's log, and `ready` says that a process serves."""

from __future__ import annotations

import logging

from robocorba.errors.services import NotReachable

#: What a process prints that is ready by its own account.
READY = "ready"

_log = logging.getLogger(__name__)
_LEVELS = {"WARNING": logging.WARNING, "ERROR": logging.ERROR, "CRITICAL": logging.CRITICAL}


def relay(name: str, line: str) -> None:
    """Log a line of a process with its own level; lines without one are warnings."""
    level, _, text = line.partition(" ")
    text = text if level in _LEVELS else line
    _log.log(_LEVELS.get(level, logging.WARNING), "%s: %s", name, text)


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
