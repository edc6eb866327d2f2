"""The folder of compiled kernels: what is known of it, what is complete, and what is removed."""

from __future__ import annotations

import os
import queue
import threading
import time
from pathlib import Path

import pytest

from robocorba import kernel_store
from robocorba.kernel_digests import KernelSource
from robocorba.kernel_store import KernelStore, cache_folder, lock, store

SOURCE = "@kernel\ndef first(x):\n    return x\n\n\n@kernel\ndef second(x):\n    return first(x)\n"


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A package with two kernels."""
    root = tmp_path / "house"
    root.mkdir()
    (root / "grids.py").write_text(SOURCE)
    (tmp_path / "cache").mkdir()
    return root


def opened(root: Path) -> KernelStore:
    return KernelStore(root, root.parent / "cache")


def compile_all(kernels: KernelStore) -> None:
    assert kernels.folder
    for name, source in kernels.sources.items():
        (kernels.folder / f"{name}-{source.digest}.py311.nbi").touch()


def test_sources_are_read_once(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    known = opened(root).sources
    assert known.keys() == {"house.grids.first", "house.grids.second"}
    monkeypatch.setattr(kernel_store, "kernel_sources", lambda root, environment: {"changed": KernelSource("d", 1)})
    assert opened(root).sources == known
    (root / "grids.py").write_text(SOURCE + "# edited\n")
    assert opened(root).sources == {"changed": KernelSource("d", 1)}


def test_damaged_sources_are_read_again(root: Path) -> None:
    known = opened(root).sources
    (path,) = (root.parent / "cache").glob("sources-*.json")
    path.write_text("{")
    assert opened(root).sources == known


def test_complete_until_a_source_or_the_processor_changes(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert not opened(root).is_complete
    opened(root).set_complete({})
    assert opened(root).is_complete
    with monkeypatch.context() as patch:
        patch.setattr(kernel_store, "_processor", lambda: "another")
        assert not opened(root).is_complete
    (root / "other.py").write_text("")
    assert not opened(root).is_complete


def test_missing_kernels(root: Path) -> None:
    kernels = opened(root)
    assert set(kernels.missing) == {"house.grids.first", "house.grids.second"}
    compile_all(kernels)
    assert kernels.missing == []
    (root / "grids.py").write_text(SOURCE.replace("return first(x)", "return -first(x)"))
    assert opened(root).missing == ["house.grids.second"]


def test_expected_time_is_that_of_the_last_version_else_from_the_size(root: Path) -> None:
    first, second = "house.grids.first", "house.grids.second"
    expected = opened(root).expected_seconds()
    assert 0.0 < expected[first] < expected[second]  # which is compiled from both
    opened(root).set_complete({first: 3.0})
    assert opened(root).expected_seconds() == {first: 3.0, second: expected[second]}
    (root / "grids.py").write_text(SOURCE.replace("second", "third"))
    assert opened(root).expected_seconds().keys() == {first, "house.grids.third"}
    assert opened(root).expected_seconds()[first] == 3.0


def test_what_was_used_longest_ago_makes_room(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kernels = opened(root)
    assert kernels.folder
    ages_s = {
        "grids.first-0a.py311.nbi": 5.0,  # used: its data stay as well
        "grids.first-0a.py311.1.nbc": 15.0,
        "grids.first-0b.py311.nbi": 16.0,
        "grids.first-0b.py311.1.nbc": 16.0,
        "complete-0c.json": 17.0,
        "writing.lock": 15.0,
    }
    for name, age_s in ages_s.items():
        (kernels.folder / name).touch()
        os.utime(kernels.folder / name, (0, time.time() - age_s))
    (kernels.folder / "0123456789abcdef").mkdir()  # as former versions made them
    monkeypatch.setattr(kernel_store, "MAX_FILES", 4)
    kernels.remove_old()
    kept = {path.name for path in kernels.folder.iterdir() if not path.name.startswith("sources-")}
    assert kept == {"0123456789abcdef", "grids.first-0a.py311.1.nbc", "grids.first-0a.py311.nbi", "writing.lock"}
    monkeypatch.setattr(kernel_store, "MAX_FILES", 0)
    kernels.remove_old()
    assert [path.name for path in kernels.folder.iterdir()] == ["writing.lock"]


@pytest.mark.parametrize("ahead_s", [1.0, -1.0, 3600.0, -3600.0, 365 * 86400.0, -365 * 86400.0])
def test_kernels_of_this_version_stay_when_the_clock_is_set(
    root: Path, monkeypatch: pytest.MonkeyPatch, ahead_s: float
) -> None:
    """While others have been used with the other time."""
    kernels = opened(root)
    assert kernels.folder
    compile_all(kernels)
    ours = {path.name for path in kernels.folder.glob("*.nb?")}
    monkeypatch.setattr(kernel_store, "MAX_FILES", len(ours) + 1)
    for number in range(5):
        path = kernels.folder / f"grids.first-{number}.py311.nbi"
        path.touch()
        os.utime(path, (0, time.time() - ahead_s))
    kernels.remove_old()
    assert kernels.missing == []
    assert len(list(kernels.folder.glob("*.nb?"))) <= len(ours) + 1


def test_without_a_folder_nothing_is_kept(root: Path) -> None:
    kernels = KernelStore(root, None)
    kernels.set_complete({})
    assert not kernels.is_complete
    assert len(kernels.missing) == 2
    assert kernels.expected_seconds().keys() == kernels.sources.keys()


def test_where_the_folder_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "chosen"))
    assert cache_folder() == tmp_path / "chosen"
    (tmp_path / "file").touch()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file"))
    assert cache_folder() is None
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    monkeypatch.setattr(kernel_store.platformdirs, "user_cache_path", lambda name: tmp_path / "user" / name)
    assert cache_folder() == tmp_path / "user" / "robocorba" / "kernels"


def test_a_folder_that_others_can_write_to_is_not_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """What is in it is run."""
    (tmp_path / "shared").mkdir()
    (tmp_path / "shared").chmod(0o777)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "shared"))
    assert cache_folder() is None
    assert f"others can write to {tmp_path / 'shared'}" in caplog.text


def test_a_folder_of_somebody_else_among_temporary_files_is_not_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    (tmp_path / "file").touch()  # no folder can be created in it
    monkeypatch.setattr(kernel_store.platformdirs, "user_cache_path", lambda name: tmp_path / "file")
    monkeypatch.setattr(kernel_store.tempfile, "gettempdir", lambda: str(tmp_path))
    own = tmp_path / f"robocorba-{os.getuid()}" / "kernels"
    assert cache_folder() == own and own.parent.stat().st_mode & 0o077 == 0
    own.parent.chmod(0o777)
    assert cache_folder() is None
    own.parent.chmod(0o700)
    own.rmdir()
    (tmp_path / "planted").mkdir(mode=0o777)
    (tmp_path / "planted").chmod(0o777)
    own.symlink_to(tmp_path / "planted")
    assert cache_folder() is None


def test_a_lock_is_waited_for_until_it_is_free(tmp_path: Path) -> None:
    """Two holders never overlap: the second begins when the first has ended."""
    held, order = threading.Event(), queue.SimpleQueue[str]()

    def wait() -> None:
        held.wait(60.0)
        with lock(tmp_path / "lock", 60.0):
            order.put("second")

    waiting = threading.Thread(target=wait)
    waiting.start()
    with lock(tmp_path / "lock", 60.0):
        held.set()
        with pytest.raises(queue.Empty):
            order.get(timeout=0.1)  # it has not got it
        order.put("first")
    waiting.join(60.0)
    assert [order.get(timeout=0.0) for _ in range(2)] == ["first", "second"]


@pytest.mark.parametrize("limit_s", [0.0, 0.05])
def test_a_lock_is_waited_for_only_so_long(tmp_path: Path, limit_s: float) -> None:
    with lock(tmp_path / "lock", 60.0):
        began = time.monotonic()
        with lock(tmp_path / "lock", limit_s):
            assert time.monotonic() - began >= limit_s  # it went on without the lock, not before


def test_all_kernels_are_compiled_before_they_are_needed() -> None:
    """The fixture `kernels` of the whole suite has compiled what `up` compiles."""
    assert store().missing == []
