"""Folders that nobody else can use."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from robocorba import private_files
from robocorba.errors.services import ServiceError
from robocorba.private_files import claim_state, exposure, make_folder

#: A user who is not this one.
OTHER = 12345


@pytest.fixture(autouse=True)
def umask() -> Iterator[None]:
    former = os.umask(0o022)
    yield
    os.umask(former)


def mode(path: Path) -> int:
    return path.stat().st_mode & 0o7777


def test_a_new_folder_and_what_is_made_later_are_private(tmp_path: Path) -> None:
    claim_state(tmp_path / "a" / "state")
    (tmp_path / "a" / "state" / "file").touch()
    assert mode(tmp_path / "a" / "state") == 0o700
    assert mode(tmp_path / "a" / "state" / "file") == 0o600


def test_the_folder_of_an_earlier_release_is_mended(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    state = tmp_path / "state"
    (state / "logs").mkdir(parents=True)
    for name in ("lock", "simulation.sqlite", "simulation.sqlite-wal", "up.json"):
        (state / name).touch()
    (state / "link.json").symlink_to(tmp_path / "elsewhere")
    (tmp_path / "elsewhere").touch()
    claim_state(state)
    assert "was open to other users" in caplog.text
    for path in (state, *state.iterdir()):
        assert path.is_symlink() or mode(path) & 0o077 == 0, path
    assert mode(tmp_path / "elsewhere") == 0o644
    caplog.clear()
    claim_state(state)
    assert caplog.text == ""


def test_a_folder_that_is_there_for_more_keeps_its_mode(tmp_path: Path) -> None:
    """--state /tmp by mistake must not lock everybody out of it."""
    for name, before in (("project", 0o755), ("sticky", 0o1755)):
        os.umask(0o022)
        folder = tmp_path / name
        folder.mkdir()
        (folder / "thesis.tex").touch()
        (folder / "simulation.sqlite").touch()
        folder.chmod(before)
        claim_state(folder)
        assert mode(folder) == before
        assert mode(folder / "thesis.tex") == 0o644
        assert mode(folder / "simulation.sqlite") == 0o600


def test_a_folder_that_others_can_write_to_is_refused(tmp_path: Path) -> None:
    shared = tmp_path / "shared"
    shared.mkdir()
    (shared / "thesis.tex").touch()
    shared.chmod(0o1777)
    with pytest.raises(ServiceError, match="others can write"):
        claim_state(shared)
    assert mode(shared) == 0o1777


def test_a_folder_of_another_user_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(private_files.os, "geteuid", lambda: OTHER)
    if tmp_path.stat().st_uid == 0:
        monkeypatch.setattr(private_files, "_trusted", lambda: (OTHER,))
    with pytest.raises(ServiceError, match="belongs to user"):
        claim_state(tmp_path)


def test_who_could_replace_something(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make_folder(tmp_path / "a" / "b")
    assert mode(tmp_path / "a") == mode(tmp_path / "a" / "b") == 0o700
    assert exposure(tmp_path / "a" / "b") == ""
    (tmp_path / "a").chmod(0o1777)  # as /tmp
    assert exposure(tmp_path / "a" / "b") == ""
    assert exposure(tmp_path / "a") == f"others can write to {tmp_path / 'a'}"
    (tmp_path / "a").chmod(0o777)
    assert exposure(tmp_path / "a" / "b") == f"others can write to {tmp_path / 'a'}"
    (tmp_path / "a").chmod(0o755)
    (tmp_path / "link").symlink_to(tmp_path / "a" / "b")
    assert exposure(tmp_path / "link") == ""
    monkeypatch.setattr(private_files, "_trusted", lambda: (OTHER,))
    assert "belongs to" in exposure(tmp_path / "a" / "b")


def test_a_group_of_this_user_alone_is_nobody_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tmp_path.chmod(0o770)
    monkeypatch.setattr(private_files, "_is_own_group", lambda group: True)
    assert exposure(tmp_path) == ""
    monkeypatch.setattr(private_files, "_is_own_group", lambda group: False)
    assert exposure(tmp_path) == f"others can write to {tmp_path}"
