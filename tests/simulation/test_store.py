"""The simulation server's store."""

from __future__ import annotations

from pathlib import Path

import pytest

from robocorba.errors.services import AlreadyRunning, ServiceError
from robocorba.errors.simulation import InvalidMission, StaleMission, UnknownMission
from robocorba.simulation.store import MAX_DOCUMENT, AdministratorSettings, ClientRecord, Mission, SimulationStore
from robocorba.simulation.world_record import (
    CabinRecord,
    ObjectRecord,
    ReservationRecord,
    RideRecord,
    RobotRecord,
    WorldRecord,
)
from tests.simulation.places import robot


def test_all_records_are_restored(tmp_path: Path) -> None:
    world = WorldRecord(
        9,
        {"A": RobotRecord("L1", 1.0, 2.0, 0.5, ("T1", 1.1, 2.2), 3)},
        {"L1/T1": ObjectRecord("L1", 0.1, 0.2, 0.3, ("L1", 0.0, 0.0, 0.0))},
        {"E1": CabinRecord("L1", [RideRecord("A", "L1", "L2", 0.4, 7.5, True, "table", 2)])},
        reservations=[ReservationRecord("A", (("L1", ((0.0, 0.1), (1.0, 0.0), (1.0, 1.0))),), 60.0, None)],
    )
    description = robot("A")
    with SimulationStore(tmp_path / "file") as store:
        assert (store.world(), store.clients(), store.settings()) == (None, [], None)
        store.save_administrator("digest")
        store.save_client(ClientRecord.of("key", 12.5, description))
        store.save_client(ClientRecord.of("other", 13.5, robot("B")))
        store.forget_client("other")
        store.save_world(world)
        store.save_settings(AdministratorSettings(5, 0.0, True))
        assert store.put_mission(Mission("M", 0, b"plan")) == 1
    with SimulationStore(tmp_path / "file") as store:
        assert store.world() == world
        assert [(record.key, record.since, record.description) for record in store.clients()] == [
            ("key", 12.5, description)
        ]
        assert store.settings() == AdministratorSettings(5, 0.0, True)
        assert store.missions() == [Mission("M", 1, b"plan")]
        assert store.administrator() == "digest"
        with pytest.raises(AlreadyRunning):
            SimulationStore(tmp_path / "file")


def test_a_mission_is_changed_only_from_its_latest_version(tmp_path: Path) -> None:
    with SimulationStore(tmp_path / "file") as store:
        assert store.put_mission(Mission("M", 0, b"1")) == 1
        assert store.put_mission(Mission("M", 1, b"2")) == 2
        for stale in (0, 1, 3):
            with pytest.raises(StaleMission) as wrong:
                store.put_mission(Mission("M", stale, b"3"))
            assert wrong.value.current == 2
        assert store.missions() == [Mission("M", 2, b"2")]
        store.remove_mission("M")
        with pytest.raises(UnknownMission):
            store.remove_mission("M")
        for name, document in (("", b""), ("x" * 201, b""), ("M", bytes(MAX_DOCUMENT + 1))):
            with pytest.raises(InvalidMission):
                store.put_mission(Mission(name, 0, document))


def test_another_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"something else, but long enough for a header" * 9)
    with pytest.raises(ServiceError):
        SimulationStore(tmp_path / "file")
