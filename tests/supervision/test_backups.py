"""Backups of a state folder whose servers may write meanwhile."""

from __future__ import annotations

import shutil
import threading
from pathlib import Path

import pytest

from robocorba.damaged_files import LAST_BACKUP
from robocorba.errors.files import LimitExceeded, OutputExists, OutputIsInput
from robocorba.errors.maps import MapFileError
from robocorba.errors.services import AlreadyRunning, ServiceError
from robocorba.events.channel_store import ChannelStore, Peer
from robocorba.events.seen_events import SeenEvents
from robocorba.maps.changes import Change, ElementKey
from robocorba.maps.model import ElementKind, Floor
from robocorba.maps.store import MapStore
from robocorba.simulation.store import Mission, SimulationStore
from robocorba.supervision.backups import back_up, restore
from robocorba.supervision.folder import StateFolder
from robocorba.testing.buildings import two_floors
from tests.damage import damage

NAMES = b"port 1\npersistent 01\ncreate 02\n"


@pytest.fixture
def state(tmp_path: Path) -> Path:
    """The state folder of a system that has ended, with something in each file."""
    state = tmp_path / "state"
    with StateFolder(state).locked():
        StateFolder(state).write_links({"lab": ["hall"]})
    (state / "channels").mkdir()
    (state / "omninames" / "omninames.dat").write_bytes(NAMES)
    with SimulationStore(state / "simulation.sqlite") as simulation:
        simulation.put_mission(Mission("M", 0, b"plan"))
    with ChannelStore(state / "channels" / "lab.sqlite") as channel:
        channel.save_peer(Peer("hall"))
    with SeenEvents(state / "channels" / "lab.seen") as seen:
        seen.add("hall", 7, 7)
    with MapStore.create(state / "map.sqlite", two_floors()) as building:
        rename(building, 2)
    return state


def rename(store: MapStore, version: int) -> None:
    """An edit."""
    key = ElementKey(ElementKind.FLOOR, "", "L9")
    former = None if version == 2 else Floor("L9", 9, float(version - 1))
    store.commit([Change(version, key, former, Floor("L9", 9, float(version)))], version, ("a", "a"))


def check(state: Path) -> None:
    """All that the fixture has written is there."""
    assert StateFolder(state).links() == {"lab": ["hall"]}
    assert (state / "omninames" / "omninames.dat").read_bytes() == NAMES
    with SimulationStore(state / "simulation.sqlite") as simulation:
        assert simulation.missions() == [Mission("M", 1, b"plan")]
    with ChannelStore(state / "channels" / "lab.sqlite") as channel:
        assert channel.peers() == [Peer("hall")]
    with SeenEvents(state / "channels" / "lab.seen") as seen:
        assert seen.has_seen("hall", 7)
    with MapStore(state / "map.sqlite") as building:
        assert building.load().version == 2


def test_a_backup_restores_everything_and_keeps_the_former_state(state: Path, tmp_path: Path) -> None:
    file = tmp_path / "backup"
    content = back_up(state, file)
    assert file.stat().st_mode & 0o077 == 0
    assert set(content.files) == {
        *("simulation.sqlite", "map.sqlite", "links.json", "channels/lab.sqlite", "channels/lab.seen"),
        "omninames/omninames.dat",
    }
    for name in content.files:
        damage(state / name)
    former = restore(file, state)
    check(state)
    assert former is not None and set(content.files) <= {
        path.relative_to(former).as_posix() for path in former.rglob("*")
    }
    assert restore(file, tmp_path / "elsewhere") is None
    check(tmp_path / "elsewhere")
    with pytest.raises(OutputExists, match="exists"):
        back_up(state, file)
    back_up(state, file, overwrite=True)


def test_servers_write_meanwhile(state: Path, tmp_path: Path) -> None:
    """Each backup holds whole transactions, all that were made before it, and those of a log that is in use."""
    done, ended = [2], threading.Event()

    def edit() -> None:
        while not ended.is_set():
            rename(store, done[0] + 1)
            done[0] += 1

    with MapStore(state / "map.sqlite") as store, SimulationStore(state / "simulation.sqlite") as simulation:
        editing = threading.Thread(target=edit)
        editing.start()
        try:
            for number in range(5):
                simulation.put_mission(Mission(str(number), 0, b""))
                before = done[0]
                back_up(state, tmp_path / f"backup{number}")
                after = done[0] + 1
                target = tmp_path / str(number)
                restore(tmp_path / f"backup{number}", target)
                with MapStore(target / "map.sqlite") as copy:
                    found = copy.load()
                    assert before <= found.version <= after
                    assert found.building.floors["L9"].floor.elevation == float(found.version)
                with SimulationStore(target / "simulation.sqlite") as copy_of_simulation:
                    assert len(copy_of_simulation.missions()) == number + 2
        finally:
            ended.set()
            editing.join()


def test_a_log_without_its_database_is_not_applied_to_a_restored_one(state: Path, tmp_path: Path) -> None:
    back_up(state, tmp_path / "backup")
    with MapStore(state / "map.sqlite") as store:
        rename(store, 3)
        (tmp_path / "log").write_bytes((state / "map.sqlite-wal").read_bytes())
    (state / "map.sqlite").unlink()
    shutil.copy(tmp_path / "log", state / "map.sqlite-wal")
    others = state / "other" / "deeper" / "app.sqlite-wal"
    others.parent.mkdir(parents=True)
    others.write_bytes(b"of another program")
    restore(tmp_path / "backup", state)
    check(state)
    assert others.read_bytes() == b"of another program"


def test_nothing_is_restored_under_a_running_system(state: Path, tmp_path: Path) -> None:
    back_up(state, tmp_path / "backup")
    with StateFolder(state).locked(), pytest.raises(AlreadyRunning):
        restore(tmp_path / "backup", state)
    with MapStore(state / "map.sqlite"), pytest.raises(AlreadyRunning):
        restore(tmp_path / "backup", state)
    check(state)


@pytest.mark.parametrize("at", [0, 300, 1500, -400])
def test_a_damaged_backup_changes_nothing(state: Path, tmp_path: Path, at: int) -> None:
    file = tmp_path / "backup"
    back_up(state, file)
    damage(file, at % file.stat().st_size)
    with pytest.raises(ServiceError, match="damaged") as refused:
        restore(file, state)
    assert "\n" not in str(refused.value)
    check(state)


def test_what_is_no_backup_changes_nothing(state: Path, tmp_path: Path) -> None:
    for name, content in (("text", b"hello"), ("empty", b"")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(ServiceError, match="no backup of RoboCorba"):
            restore(tmp_path / name, state)
    for name in ("missing", "state"):
        with pytest.raises(ServiceError, match="there is no backup"):
            restore(tmp_path / name, state)
    check(state)


def test_a_backup_that_does_not_fit_on_the_disk_changes_nothing(
    state: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "backup"
    back_up(state, file)
    usage = shutil.disk_usage(tmp_path)._replace(free=1000)
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: usage)
    with pytest.raises(LimitExceeded, match=r"backup: \S+ has \d+ bytes \(free in the state folder\), at most 1000"):
        restore(file, state)
    check(state)


def test_a_backup_does_not_replace_what_it_saves(state: Path) -> None:
    with pytest.raises(OutputIsInput):
        back_up(state, state / "map.sqlite", overwrite=True)
    check(state)


def test_a_damaged_database_is_not_backed_up(state: Path, tmp_path: Path) -> None:
    damage(state / "map.sqlite")
    with pytest.raises(ServiceError, match=r"map\.sqlite is damaged"):
        back_up(state, tmp_path / "backup")
    assert not (tmp_path / "backup").exists()
    assert not (state / LAST_BACKUP).exists()


def test_nothing_to_back_up(tmp_path: Path) -> None:
    with pytest.raises(ServiceError, match="nothing to back up"):
        back_up(tmp_path / "missing", tmp_path / "backup")


def test_who_refuses_a_damaged_file_names_the_last_backup(state: Path, tmp_path: Path) -> None:
    file = tmp_path / "monday's backup"
    back_up(state, file)
    for name in ("map.sqlite", "simulation.sqlite", "channels/lab.sqlite"):
        damage(state / name)
    advice = f"robocorba restore '{tmp_path}/monday'\"'\"'s backup'"
    with pytest.raises(MapFileError) as of_map:
        MapStore(state / "map.sqlite")
    with pytest.raises(ServiceError) as of_simulation:
        SimulationStore(state / "simulation.sqlite")
    with pytest.raises(ServiceError) as of_channel:
        ChannelStore(state / "channels" / "lab.sqlite")
    for refused in (of_map, of_simulation, of_channel):
        assert advice in str(refused.value) and "\n" not in str(refused.value)
    file.unlink()
    with pytest.raises(MapFileError, match="no longer at"):
        MapStore(state / "map.sqlite")
