"""Bags of ROS 2 (rosbag2) out of recordings, written without ROS."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

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


class BagTopics:
    """Topics of a bag (robocorba.bridges.ros2.messages.Topics)."""

    def __init__(self, writer: Writer) -> None:
        self._store = get_typestore(Stores.ROS2_JAZZY)  # later releases of ROS have the same definitions
        self._writer = writer
        self._connections: dict[str, Connection] = {}

    def make(self, name: str, /, **fields: Any) -> Any:
        return self._store.types[name](**fields)

    def array(self, values: np.ndarray) -> Any:
        return values

    def publish(self, topic: str, type: str, message: Any, time_s: float, is_latched: bool = False) -> None:
        connection = self._connections.get(topic)
        if connection is None:
            connection = self._writer.add_connection(
                topic, type, typestore=self._store, offered_qos_profiles=[_qos(is_latched)]
            )
            self._connections[topic] = connection
        self._writer.write(connection, nanoseconds(time_s), self._store.serialize_cdr(message, type))

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
    # The version of the format is that of Iron and later releases.
    with _translating(folder), Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        publisher = RosPublisher(BagTopics(writer), recording.building, robots, "", frames, resolution_m)
        for changes in recording.changes():
            publisher.publish(changes)


def _is_bag(folder: Path) -> bool:
    """Whether a folder holds a bag and nothing else."""
    metadata = folder / "metadata.yaml"
    if not metadata.is_file():
        return False
    return all(file == metadata or file.suffix in (".mcap", ".db3", ".zstd") for file in folder.iterdir())


def _qos(is_latched: bool) -> Qos:
    """What the live topics have, too."""
    never = QosTime(9_223_372_036, 854_775_807)
    return Qos(
        QosHistory.KEEP_LAST,
        1 if is_latched else 10,
        QosReliability.RELIABLE,
        QosDurability.TRANSIENT_LOCAL if is_latched else QosDurability.VOLATILE,
        never,
        never,
        QosLiveliness.AUTOMATIC,
        never,
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
