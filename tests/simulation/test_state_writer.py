"""What the state writer can't write waits, and is written together with what comes later."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from robocorba.errors.services import ServiceError
from robocorba.simulation import state_writer
from robocorba.simulation.state_writer import StateWriter
from robocorba.simulation.world_record import WorldRecord
from testkit.processes import eventually
from tests.waits import stays


class Disk:
    """A store that refuses everything while it is full."""

    def __init__(self) -> None:
        self.is_full = True
        self.attempts = 0
        self.world: WorldRecord | None = None
        self.forgotten: list[str] = []

    def save_world(self, world: WorldRecord) -> None:
        self._write()
        self.world = world

    def forget_client(self, key: str) -> None:
        self._write()
        self.forgotten.append(key)

    def _write(self) -> None:
        self.attempts += 1
        if self.is_full:
            raise ServiceError("no space left")


@pytest.fixture
def disk() -> Disk:
    return Disk()


@pytest.fixture
def writer(disk: Disk) -> Iterator[StateWriter]:
    """It is not started: it writes in the thread that waits."""
    writer = StateWriter(disk)  # type: ignore[arg-type]
    yield writer
    writer.close()


def world(version: int) -> WorldRecord:
    return WorldRecord(1.0, [], {}, {}, {}, map_version=version)


@pytest.mark.parametrize("is_replaced", [False, True])
def test_what_was_refused_is_written_with_what_comes_next(disk: Disk, writer: StateWriter, is_replaced: bool) -> None:
    """A newer record takes the place of one that was refused."""
    for change in (lambda: writer.forget("a"), lambda: writer.submit(world(1))):
        with pytest.raises(ServiceError, match="no space left"):
            writer.wait(change())
    disk.is_full = False
    if is_replaced:
        writer.submit(world(2))
    writer.wait(writer.forget("b"))
    assert (disk.forgotten, disk.world) == (["a", "b"], world(2 if is_replaced else 1))


def test_its_thread_tries_again_by_itself(disk: Disk, writer: StateWriter, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(state_writer, "RETRY_S", 0.01)
    writer.start()
    with pytest.raises(ServiceError, match="no space left"):
        writer.wait(writer.forget("a"))
    eventually(lambda: disk.attempts > 3, what="more attempts")
    disk.is_full = False
    eventually(lambda: disk.forgotten == ["a"], what="the attempt that succeeds")
    with_success = disk.attempts
    stays(lambda: disk.attempts == with_success)


def test_it_ends_though_the_disk_stays_full(disk: Disk, writer: StateWriter) -> None:
    writer.start()
    writer.submit(world(1))
    writer.close()
    assert disk.attempts >= 1
    disk.is_full = False
