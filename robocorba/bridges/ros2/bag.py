"""Bags of ROS 2 (rosbag2) out of recordings, written without ROS."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
from rosbags.interfaces import Connection, Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import StoragePlugin, Writer, WriterError
from rosbags.typesys import Stores, get_typestore

from robocorba.bridges.ros2.frames import Frames
from robocorba.bridges.ros2.messages import nanoseconds
from robocorba.bridges.ros2.publisher import RosPublisher
from robocorba.errors.simulation import InvalidRecording
from robocorba.map_editor.formats.floor_grid import DEFAULT_RESOLUTION_M
from robocorba.simulation.recording import Recording

#: Messages that a player keeps for slow subscribers.
DEPTH = 10
#: Version of the format: that of Iron and later releases.
_VERSION: Final = 9
#: Messages of this and later releases of ROS have these definitions.
_DEFINITIONS = Stores.ROS2_JAZZY
#: Files of a bag.
_METADATA, _BAG_SUFFIXES = "metadata.yaml", (".mcap", ".db3", ".zstd")
_NEVER = QosTime(9_223_372_036, 854_775_807)


class _BagTypes:
    """Messages as the library for bags defines them."""

    def __init__(self) -> None:
        self.store = get_typestore(_DEFINITIONS)

    def make(self, name: str, /, **fields: Any) -> Any:
        return self.store.types[name](**fields)

    def array(self, values: np.ndarray) -> Any:
        return values


class _BagTopics:
    """Topics of a bag."""

    def __init__(self, writer: Writer) -> None:
        self.types = _BagTypes()
        self._writer = writer
        self._connections: dict[str, Connection] = {}

    def publish(self, topic: str, type: str, message: Any, time_s: float, is_latched: bool = False) -> None:
        connection = self._connections.get(topic)
        if connection is None:
            connection = self._writer.add_connection(
                topic, type, typestore=self.types.store, offered_qos_profiles=[_qos(is_latched)]
            )
            self._connections[topic] = connection
        self._writer.write(connection, nanoseconds(time_s), self.types.store.serialize_cdr(message, type))

    def close(self, topic: str) -> None:
        """A topic of a bag has no end."""


def convert(
    recording: Recording,
    folder: Path,
    robots: Collection[str] | None = None,
    frames: Frames = Frames(),  # noqa: B008
    resolution_m: float = DEFAULT_RESOLUTION_M,
    overwrite: bool = False,
) -> None:
    """Write a recording as a bag, a folder with an MCAP file. Times of its messages are simulated.

    robots: names of those that are written; None for all. resolution_m: side of the cells of maps. overwrite: replace a
    bag, but no folder with anything else in it. Raises InvalidRecording, GridTooLarge."""
    if overwrite and _is_bag(folder):
        shutil.rmtree(folder)
    with _translating(folder), Writer(folder, version=_VERSION, storage_plugin=StoragePlugin.MCAP) as writer:
        publisher = RosPublisher(_BagTopics(writer), recording.building, robots, "", frames, resolution_m)
        for changes in recording.changes():
            publisher.publish(changes)


def _is_bag(folder: Path) -> bool:
    """Whether a folder holds a bag and nothing else."""
    if not (folder / _METADATA).is_file():
        return False
    return all(file.name == _METADATA or file.suffix in _BAG_SUFFIXES for file in folder.iterdir())


def _qos(is_latched: bool) -> Qos:
    """What the live topics have, too."""
    return Qos(
        QosHistory.KEEP_LAST,
        1 if is_latched else DEPTH,
        QosReliability.RELIABLE,
        QosDurability.TRANSIENT_LOCAL if is_latched else QosDurability.VOLATILE,
        _NEVER,
        _NEVER,
        QosLiveliness.AUTOMATIC,
        _NEVER,
        False,
    )


@contextlib.contextmanager
def _translating(folder: Path) -> Iterator[None]:
    """Raise InvalidRecording for errors of writing."""
    try:
        yield
    except WriterError as error:
        raise InvalidRecording(folder, str(error)) from None
    except OSError as error:
        raise InvalidRecording(folder, error.strerror or str(error)) from None
