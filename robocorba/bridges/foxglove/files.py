"""MCAP files with Foxglove's messages."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

import foxglove

from robocorba import __version__
from robocorba.bridges.foxglove.publisher import FoxglovePublisher
from robocorba.errors.simulation import InvalidRecording
from robocorba.map_editor.model import Building
from robocorba.simulation.recording import CHUNK_S, Recording
from robocorba.simulation.system_changes import SystemChanges


class FoxgloveFile:
    """An MCAP file that a publisher writes, until `close`; an existing file is kept unless `overwrite`.

    Raises InvalidRecording if it can't be written."""

    def __init__(self, path: Path, building: Building, overwrite: bool = False) -> None:
        self.path = path
        context = foxglove.Context()
        with _translating(path):
            self._writer = foxglove.open_mcap(path, allow_overwrite=overwrite, context=context)
            self._writer.write_metadata("robocorba", {"version": __version__})
        self.publisher = FoxglovePublisher(context, building)
        self._flushed_at_s = 0.0

    def write_changes(self, changes: SystemChanges, at_s: float) -> None:
        """Add what was received at POSIX time `at_s` [s]; the messages have simulated times. The file so far survives a
        kill of this process, but for about a second. Raises InvalidRecording."""
        with _translating(self.path):
            self.publisher.publish(changes)
            if not 0.0 <= at_s - self._flushed_at_s < CHUNK_S:
                self._flushed_at_s = at_s
                self._writer.flush()

    def close(self) -> None:
        """Finish the file. Raises InvalidRecording."""
        with _translating(self.path):
            self._writer.close()


def convert(recording: Recording, path: Path, overwrite: bool = False) -> None:
    """Write a recording as an MCAP file with Foxglove's messages. Raises InvalidRecording."""
    with contextlib.closing(FoxgloveFile(path, recording.building, overwrite)) as file:
        for changes in recording.changes():
            file.publisher.publish(changes)


@contextlib.contextmanager
def _translating(path: Path) -> Iterator[None]:
    """Raise InvalidRecording for an OSError."""
    try:
        yield
    except OSError as error:
        raise InvalidRecording(path, error.strerror or str(error).partition(" (os error")[0]) from None
