"""The files of a system in its state folder: roles, records, the naming service's data, and backups."""

from __future__ import annotations

import os
import shutil
import stat
import subprocess
import threading
from pathlib import Path

import msgspec
import psutil
import pytest

from robocorba.errors.files import LimitExceeded, OutputError
from robocorba.errors.maps import MapFileError
from robocorba.errors.services import AlreadyRunning, ServiceError
from robocorba.events.channel_store import ChannelStore, Peer
from robocorba.events.seen_events import SeenEvents
from robocorba.map_editor.changes import Change, ElementKey
from robocorba.map_editor.model import ElementKind, Floor
from robocorba.map_editor.store import MapStore
from robocorba.simulation.store import Mission, SimulationStore
from robocorba.system.claimed_ports import claimed_ports
from robocorba.system.damaged_files import LAST_BACKUP
from robocorba.system.names import CONSOLE
from robocorba.system.roles import Role
from robocorba.system.settings import Address, InvalidSetting, RoleNaming, Settings, robot_keys, role_file
from robocorba.system.state_folder import ProcessRecord, StateFolder, SystemRecord, started_s
from robocorba.system.supervision.access import Access, remove_access
from robocorba.system.supervision.backups import back_up, restore
from robocorba.system.supervision.naming_data import intact_part, mend_naming_data
from testkit.buildings import two_floors
from tests.damage import damage

ADDRESS = Address("127.0.0.1", 2809)


def read(state: Path, role: Role = Role.OPERATOR, naming: str | None = None) -> Address:
    return Settings.read(naming, state, {}, role).naming


def test_each_role_has_a_file_that_only_this_user_reads_and_keys_last(tmp_path: Path) -> None:
    assert read(tmp_path) == ADDRESS
    access = Access.create(tmp_path, ADDRESS)
    for role in Role:
        naming = RoleNaming.read(role_file(tmp_path, role))
        assert (naming.role, naming.key, str(naming)) == (role, access.key(role), str(ADDRESS))
        assert naming.setting == str(role_file(tmp_path, role))
        assert naming.key not in repr(naming)
        assert read(tmp_path, role) == read(tmp_path, naming=str(role_file(tmp_path, role))) == access.naming(role)
    assert read(tmp_path) == access.naming(Role.OPERATOR)
    assert read(tmp_path, naming="127.0.0.1:2809") == ADDRESS
    assert {stat.S_IMODE(file.stat().st_mode) for file in (tmp_path / "access").iterdir()} == {0o600}
    assert len({access.key(role) for role in Role}) == len(Role)
    keys = Access.create(tmp_path, ADDRESS).keys
    remove_access(tmp_path)
    assert not role_file(tmp_path, Role.OPERATOR).exists()
    assert Access.create(tmp_path, Address("10.0.0.1", 2810)).keys == keys
    assert str(RoleNaming.read(role_file(tmp_path, Role.ROBOT))) == "10.0.0.1:2810"


def test_a_robot_has_a_file_of_its_own_until_it_is_removed(tmp_path: Path) -> None:
    access = Access.create(tmp_path, ADDRESS)
    files = {name: access.robot(name) for name in ("A", ".hidden", "a.b", "Ä b%")}
    keys = robot_keys(access.folder)
    assert {name: RoleNaming.read(file).key for name, file in files.items()} == keys
    assert {RoleNaming.read(file).role for file in files.values()} == {Role.ROBOT}
    assert {stat.S_IMODE(file.stat().st_mode) for file in files.values()} == {0o600}
    assert len({*keys.values(), access.key(Role.ROBOT)}) == 5
    assert access.robot("A") == files["A"]
    Access.create(tmp_path, Address("10.0.0.1", 2810))
    assert robot_keys(access.folder) == keys
    assert str(RoleNaming.read(files["A"])) == "10.0.0.1:2810"
    files["A"].unlink()
    access.robot("A")
    assert robot_keys(access.folder)["A"] != keys["A"]
    for name in ("", "a/b", "x" * 201, "Ä" * 60):
        with pytest.raises(ServiceError):
            access.robot(name)


def test_what_is_no_file_of_a_role_is_refused(tmp_path: Path) -> None:
    file, at = tmp_path / "x.ior", "corbaloc:iiop:1.2@127.0.0.1"
    with pytest.raises(InvalidSetting, match="No such file"):
        RoleNaming.read(file)
    for text in (
        *("", "IOR:00", f"{at}:2809/MapEditor"),
        *(f"{at}:2809/access/king/{'0' * 64}", f"{at}:70000/access/robot/{'0' * 64}"),
    ):
        file.write_text(text)
        with pytest.raises(InvalidSetting):
            RoleNaming.read(file)
    Access.create(tmp_path, ADDRESS)
    (tmp_path / "access" / "keys.json").write_text('{"robot": "short"}')
    with pytest.raises(ServiceError, match=r"keys.json is damaged"):
        Access.create(tmp_path, ADDRESS)


def process(name: str, address: str, *arguments: str) -> ProcessRecord:
    return ProcessRecord(name, "running", 7, address, arguments, 0.0, 0)


def record(*names: str) -> SystemRecord:
    processes = (process(name, f"127.0.0.1:{port}") for port, name in enumerate(names, 9001))
    return SystemRecord("127.0.0.1:2809", 1, 0.0, tuple(processes))


def test_a_system_is_known_to_run_and_its_console_by_its_address(monkeypatch: pytest.MonkeyPatch) -> None:
    assert record("simulation", CONSOLE, "robot_R1").console_address == "http://127.0.0.1:9002/"
    assert record("simulation", "robot_console").console_address == ""
    # The kernel says when a process was started since the boot; since 1970 it was at another time then.
    running = SystemRecord("127.0.0.1:2809", os.getpid(), started_s(os.getpid()), ())
    booted = psutil.boot_time()
    for ahead_s in (1.0, -3600.0, 365 * 86400.0):
        monkeypatch.setattr("psutil._pslinux.boot_time", lambda ahead_s=ahead_s: booted + ahead_s)
        assert running.is_alive
    assert not msgspec.structs.replace(running, created=running.created + 0.01).is_alive
    ended = subprocess.Popen(["true"])
    ended.wait()
    assert not msgspec.structs.replace(running, pid=ended.pid).is_alive


@pytest.fixture
def folder(tmp_path: Path) -> StateFolder:
    return StateFolder(tmp_path / "state")


def test_damaged_files_are_set_aside_by_the_owner_of_the_folder_only(
    folder: StateFolder, caplog: pytest.LogCaptureFixture
) -> None:
    ports, links, up = (folder.path / f"{name}.json" for name in ("ports", "links", "up"))
    with claimed_ports() as port, folder.locked():
        naming = Address("127.0.0.1", port)
        given = folder.ports(["a", "b"], naming)
        content = damage(ports)
        assert folder.ports(["a", "b"], naming) == given
        assert (folder.path / "ports.json.damaged").read_bytes() == content
        processes = (process(name, f"127.0.0.1:{given[other]}", "x") for name, other in (("a", "b"), ("b", "a")))
        folder.write_record(SystemRecord(str(naming), 1, 0.0, tuple(processes)))
        damage(ports)
        assert folder.ports(["a", "b"], naming) == {"a": given["b"], "b": given["a"]}  # of the killed system
        folder.write_links({"lab": ["hall"]})
        for path in (folder.path, *folder.path.iterdir()):
            assert path.stat().st_mode & 0o077 == 0, path
        damage(links)
        assert folder.links() == {}
        damage(up)
        with pytest.raises(ServiceError, match="damaged"):
            folder.read_record()
        with pytest.raises(AlreadyRunning), folder.locked():
            pass
        folder.set_damaged_record_aside()
        assert folder.read_record() is None
    for path in (ports, links, up):
        assert f"{path} is damaged" in caplog.text
        assert path.with_name(f"{path.name}.damaged").exists()


HEADER = b"port 2809\npersistent 7670036b0100337f\ncreate 4e616d6553657276696365\n"
LINES = (
    HEADER
    + b"create 7670036b0100337f00000001\n"
    + b"bind IOR:01 RoboCorba  ncontext IOR:02\n"
    + b"bind IOR:02 with\\ space k\\ind nobject IOR:03\n"
    + "bind IOR:02 \xfcn\x1bi  nobject IOR:03\n".encode()
    + b"unbind IOR:02 with\\ space \ndestroy IOR:02\n"
)


@pytest.fixture
def data(tmp_path: Path) -> Path:
    file = tmp_path / "omninames.dat"
    file.write_bytes(LINES)
    return file


def test_what_omninames_writes_is_left_alone_up_to_a_damage(data: Path, caplog: pytest.LogCaptureFixture) -> None:
    mend_naming_data(data.parent)
    mend_naming_data(data.parent / "missing")
    assert data.read_bytes() == LINES and list(data.parent.iterdir()) == [data]
    assert caplog.text == ""
    for cut in range(1, 40):
        data.write_bytes(LINES[:-cut])
        mend_naming_data(data.parent)
        kept = data.read_bytes()
        assert LINES.startswith(kept) and kept.endswith(b"\n") and len(kept) <= len(LINES) - cut
        assert intact_part(kept) == kept
    data.write_bytes(LINES.replace(b"bind IOR:02 with", b"bi\0d IOR:02 with"))
    mend_naming_data(data.parent)
    assert data.read_bytes() == LINES[: LINES.index(b"bind IOR:02 with")]
    assert "omninames.dat is damaged (line 6)" in caplog.text and "4 later changes are lost" in caplog.text


def test_a_damaged_beginning_leads_to_the_earlier_state_else_to_none(data: Path) -> None:
    damaged, earlier = damage(data), data.with_suffix(".bak")
    for now, former, used in (
        (damaged, HEADER, HEADER),
        (damaged, None, None),
        (None, HEADER, HEADER),  # alone: omniNames would not start
        (None, b"damaged", None),
    ):
        for file, content in ((data, now), (earlier, former)):
            file.unlink(missing_ok=True)
            if content:
                file.write_bytes(content)
        mend_naming_data(data.parent)
        assert not earlier.exists()
        assert (data.read_bytes() if data.exists() else None) == used
    assert (data.parent / "omninames.dat.damaged").read_bytes() == damaged


def test_on_a_full_disk_nothing_is_lost(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    data.write_bytes(LINES[:-5])
    (data.parent / "omninames.bak").write_bytes(HEADER)
    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", fail)
        with pytest.raises(ServiceError, match="No space left"):
            mend_naming_data(data.parent)
    assert data.read_bytes() == LINES[:-5]
    mend_naming_data(data.parent)
    assert LINES.startswith(data.read_bytes()) and data.read_bytes().startswith(HEADER + b"create")


NAMES = b"port 1\npersistent 01\ncreate 02\n"


@pytest.fixture
def state(tmp_path: Path) -> Path:
    """The state folder of a system that has ended, with something in each file."""
    state = tmp_path / "state"
    with StateFolder(state).locked():
        StateFolder(state).write_links({"lab": ["hall"]})
    (state / "channels").mkdir()
    (state / "ports.json").write_text('{"naming": 12345}')
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


def test_a_backup_restores_all_and_keeps_what_was(state: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "backup"
    content = back_up(state, file)
    assert file.stat().st_mode & 0o077 == 0
    assert set(content.files) == {
        *("simulation.sqlite", "map.sqlite", "links.json", "channels/lab.sqlite", "channels/lab.seen"),
        *("omninames/omninames.dat", "ports.json"),
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
    with pytest.raises(OutputError, match="exists already"):
        back_up(state, file)
    back_up(state, file, overwrite=True)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    for folder, is_copy in ((state, False), (tmp_path / "robocorba-a", False), (tmp_path / "robocorba-b", True)):
        restore(file, folder)
        assert (folder / "ports.json").exists() is not is_copy


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


def test_a_bad_backup_changes_nothing(state: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "backup"

    def refused(error: type[Exception], match: str | None = None, name: str = "backup") -> str:
        with pytest.raises(error, match=match) as raised:
            restore(tmp_path / name, state)
        return str(raised.value)

    for name, content in (("text", b"hello"), ("empty", b"")):
        (tmp_path / name).write_bytes(content)
        refused(ServiceError, "no backup of RoboCorba", name)
    for name in ("missing", "state"):
        refused(ServiceError, "there is no backup", name)
    with pytest.raises(OutputError, match="the input itself"):
        back_up(state, state / "map.sqlite", overwrite=True)
    for at in (0, 300, 1500, -400):
        back_up(state, file, overwrite=True)
        damage(file, at % file.stat().st_size)
        assert "\n" not in refused(ServiceError, "damaged")
    back_up(state, file, overwrite=True)
    for running in (StateFolder(state).locked, lambda: MapStore(state / "map.sqlite")):
        with running():
            refused(AlreadyRunning)
    usage = shutil.disk_usage(tmp_path)._replace(free=1000)
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: usage)
    refused(LimitExceeded, r"backup: \S+ has \d+ bytes \(free in the state folder\), at most 1000")
    check(state)


def test_a_damaged_database_is_not_backed_up(state: Path, tmp_path: Path) -> None:
    damage(state / "map.sqlite")
    with pytest.raises(ServiceError, match=r"map\.sqlite is damaged"):
        back_up(state, tmp_path / "backup")
    with pytest.raises(ServiceError, match="nothing to back up"):
        back_up(tmp_path / "missing", tmp_path / "backup")
    assert not (tmp_path / "backup").exists()
    assert not (state / LAST_BACKUP).exists()


def test_who_refuses_a_damaged_file_names_the_last_backup(state: Path, tmp_path: Path) -> None:
    file = tmp_path / "monday's backup"
    back_up(state, file)
    for store, name, error in (
        (MapStore, "map.sqlite", MapFileError),
        (SimulationStore, "simulation.sqlite", ServiceError),
        (ChannelStore, "channels/lab.sqlite", ServiceError),
    ):
        damage(state / name)
        with pytest.raises(error) as refused:
            store(state / name)
        assert f"robocorba restore '{tmp_path}/monday'\"'\"'s backup'" in str(refused.value)
        assert "\n" not in str(refused.value)
    file.unlink()
    with pytest.raises(MapFileError, match="no longer at"):
        MapStore(state / "map.sqlite")
