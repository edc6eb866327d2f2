"""The files of a system in its state folder."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import msgspec
import psutil
import pytest

from robocorba.claimed_ports import claimed_ports
from robocorba.errors.services import AlreadyRunning, ServiceError
from robocorba.settings import Address
from robocorba.supervision.console import CONSOLE
from robocorba.supervision.folder import ProcessRecord, StateFolder, SystemRecord, started_s
from tests.damage import damage


def record(*names: str) -> SystemRecord:
    processes = [
        ProcessRecord(name, "running", 7, f"127.0.0.1:{port}", (), 0.0, 0) for port, name in enumerate(names, 9001)
    ]
    return SystemRecord("127.0.0.1:2809", 1, 0.0, tuple(processes))


def test_the_address_of_the_console() -> None:
    assert record("simulation", CONSOLE, "robot_R1").console_address == "http://127.0.0.1:9002/"
    assert record("simulation", "robot_console").console_address == ""


def test_a_system_is_known_to_run_also_after_the_clock_was_set(monkeypatch: pytest.MonkeyPatch) -> None:
    """The kernel says when a process was started since the boot; since 1970 it was at another time then."""
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


def test_damaged_ports_are_those_of_the_killed_system_else_chosen_again(folder: StateFolder) -> None:
    with claimed_ports() as port, folder.locked():
        naming = Address("127.0.0.1", port)
        given = folder.ports(["a", "b"], naming)
        content = damage(folder.path / "ports.json")
        assert folder.ports(["a", "b"], naming) == given
        assert (folder.path / "ports.json.damaged").read_bytes() == content
        processes = tuple(
            ProcessRecord(name, "running", 7, f"127.0.0.1:{given[other]}", ("x",), 0.0, 0)
            for name, other in (("a", "b"), ("b", "a"))
        )
        folder.write_record(SystemRecord(str(naming), 1, 0.0, processes))
        damage(folder.path / "ports.json")
        assert folder.ports(["a", "b"], naming) == {"a": given["b"], "b": given["a"]}


def test_damaged_links_are_set_aside(folder: StateFolder, caplog: pytest.LogCaptureFixture) -> None:
    with folder.locked():
        folder.write_links({"lab": ["hall"]})
        damage(folder.path / "links.json")
        assert folder.links() == {}
    assert "links.json is damaged" in caplog.text and "links.json.damaged" in caplog.text


def test_a_damaged_record_is_set_aside_by_its_owner_only(folder: StateFolder) -> None:
    with folder.locked():
        folder.write_record(record("simulation"))
        damage(folder.path / "up.json")
        with pytest.raises(ServiceError, match="damaged"):
            folder.read_record()
        with pytest.raises(AlreadyRunning), folder.locked():
            pass
        folder.set_damaged_record_aside()
        assert folder.read_record() is None
        assert (folder.path / "up.json.damaged").exists()


def test_the_folder_is_private(folder: StateFolder) -> None:
    with folder.locked():
        folder.write_links({})
    for path in (folder.path, *folder.path.iterdir()):
        assert path.stat().st_mode & 0o077 == 0, path
