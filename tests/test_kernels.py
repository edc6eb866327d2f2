"""Compiled kernels: which edits change their digests, the folder that keeps them, and the files of each."""

from __future__ import annotations

import os
import queue
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numba
import pytest
from numba.core.caching import IndexDataCacheFile

from robocorba.system import kernel_cache, kernel_store
from robocorba.system.kernel_cache import KernelCache, SharedWork
from robocorba.system.kernel_digests import KernelSource, kernel_sources, sources_digest
from robocorba.system.kernel_store import KernelStore, cache_folder, lock, store

GRIDS = '''"""Grids."""
from typing import NamedTuple

import numpy as np

from house.kernels import kernel
from house.units import METRE

#: Width.
WIDTH = 3 * METRE
LOW, HIGH = 1, 2
SPARE = 7


class Grid(NamedTuple):
    first: int


@kernel
def column(grid: Grid, x: float) -> int:
    """The column."""
    return int(x / WIDTH) + grid.first


@kernel
def other(x):
    return np.floor(x)


def plain():
    return SPARE
'''
SEARCH = """from __future__ import annotations

from house import units
from house.grids import column as column_of
from house.kernels import kernel


@kernel
def search(grid, x):
    return column_of(grid, x)


@kernel
def alone(x):
    return x


def helper():
    return units.METRE
"""
FILES = {
    "__init__.py": "",
    "kernels.py": "def kernel(function):\n    return function\n",
    "units.py": "METRE = 1.0\nINCH = 0.0254\n",
    "grids.py": GRIDS,
    "search.py": SEARCH,
}
KERNELS = {"grids.column", "grids.other", "search.search", "search.alone"}


def digests(folder: Path, environment: str = "", **changed: str) -> dict[str, str]:
    """Digest of each kernel of the package `house` without its name, with other contents of some modules."""
    root = folder / "house"
    root.mkdir(exist_ok=True)
    for name, text in (FILES | {f"{module}.py": text for module, text in changed.items()}).items():
        (root / name).write_text(text)
    return {name.removeprefix("house."): source.digest for name, source in kernel_sources(root, environment).items()}


@pytest.mark.parametrize(
    ("module", "old", "new", "changed"),
    [
        ("grids", "int(x / WIDTH)", "int(x // WIDTH)", {"grids.column", "search.search"}),
        ("grids", "3 * METRE", "4 * METRE", {"grids.column", "search.search"}),
        ("units", "METRE = 1.0", "METRE = 2.0", {"grids.column", "search.search"}),
        ("grids", "first: int", "first: float", {"grids.column", "search.search"}),
        ("grids", "class Grid(NamedTuple)", "class Grid(NamedTuple, Generic)", {"grids.column", "search.search"}),
        ("grids", "import numpy as np", "import jax.numpy as np", {"grids.other"}),
        ("grids", "SPARE = 7", "SPARE = 7\nif SPARE:\n    WIDTH = 9", {"grids.column", "grids.other", "search.search"}),
        ("grids", "LOW, HIGH = 1, 2", "LOW, WIDTH = 1, 2", {"grids.column", "search.search"}),
        ("search", "from house.grids import column as", "from house.grids import other as", {"search.search"}),
        ("search", "return x\n", "return units.METRE\n", {"search.alone"}),
        ("search", "@kernel\ndef alone(x):\n    return x", "@kernel\ndef alone(y):\n    return y", {"search.alone"}),
        # What kernels are not compiled from:
        ("grids", "SPARE = 7", "SPARE = 8", set()),
        ("grids", "return SPARE", "return -SPARE", set()),
        ("grids", "#: Width.", "#: Width, with a comment\n# of two lines.", set()),
        ("grids", '"""The column."""', '"""The column of a point."""', set()),
        ("grids", "LOW, HIGH = 1, 2", "LOW, HIGH = 1, 3", set()),
        ("units", "INCH = 0.0254", "INCH = 1 / 39.37", set()),
        ("kernels", "return function", "return print or function", set()),
        ("search", "units.METRE", "units.INCH", set()),
    ],
)
def test_an_edit_changes_what_it_concerns(tmp_path: Path, module: str, old: str, new: str, changed: set[str]) -> None:
    before = digests(tmp_path)
    assert before.keys() == KERNELS
    assert len(set(before.values())) == len(KERNELS)
    text = FILES[f"{module}.py"]
    assert text.count(old) == 1
    after = digests(tmp_path, **{module: text.replace(old, new)})
    assert {name for name in KERNELS if before[name] != after[name]} == changed


def test_the_compiler_counts_and_whole_modules_where_it_is_unclear_what_is_used(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    first, second = digests(tmp_path / "a"), digests(tmp_path / "b")
    assert first == second
    assert sources_digest(tmp_path / "a" / "house") == sources_digest(tmp_path / "b" / "house")
    assert not set(first.values()) & set(digests(tmp_path / "a", "numba 1.0").values())
    digests(tmp_path / "a", units=FILES["units.py"] + "# nothing\n")
    assert sources_digest(tmp_path / "a" / "house") != sources_digest(tmp_path / "b" / "house")
    whole = SEARCH.replace("return x\n", "return units.METRE\n")
    before = digests(tmp_path, search=whole)
    after = digests(tmp_path, search=whole, units=FILES["units.py"].replace("0.0254", "0.03"))
    assert before["search.alone"] != after["search.alone"]
    star = SEARCH.replace("from house import units", "from .units import *").replace("return x\n", "return METRE\n")
    before = digests(tmp_path, search=star)
    after = digests(tmp_path, search=star, units=FILES["units.py"].replace("1.0", "2.0"))
    assert before["search.alone"] != after["search.alone"]


TWO_KERNELS = "@kernel\ndef first(x):\n    return x\n\n\n@kernel\ndef second(x):\n    return first(x)\n"


@pytest.fixture
def house(tmp_path: Path) -> Path:
    """A package with two kernels."""
    house = tmp_path / "house"
    house.mkdir()
    (house / "grids.py").write_text(TWO_KERNELS)
    (tmp_path / "cache").mkdir()
    return house


def open_store(house: Path) -> KernelStore:
    return KernelStore(house, house.parent / "cache")


def touch_all(kernels: KernelStore) -> None:
    assert kernels.folder
    for name, source in kernels.sources.items():
        (kernels.folder / f"{name}-{source.digest}.py311.nbi").touch()


def test_sources_are_read_once_unless_they_are_damaged_or_changed(house: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    known, changed = open_store(house).sources, {"changed": KernelSource("d", 1)}
    assert known.keys() == {"house.grids.first", "house.grids.second"}
    (path,) = (house.parent / "cache").glob("sources-*.json")
    path.write_text("{")
    assert open_store(house).sources == known
    monkeypatch.setattr(kernel_store, "kernel_sources", lambda root, environment: changed)
    assert open_store(house).sources == known
    (house / "grids.py").write_text(TWO_KERNELS + "# edited\n")
    assert open_store(house).sources == changed


def test_what_is_missing_and_how_long_it_takes(house: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The expected time is that of the last version, else from the size."""
    first, second, third = (f"house.grids.{name}" for name in ("first", "second", "third"))
    kernels, expected = open_store(house), open_store(house).expected_seconds()
    assert (set(kernels.missing), kernels.is_complete) == ({first, second}, False)
    assert 0.0 < expected[first] < expected[second]  # which is compiled from both
    touch_all(kernels)
    assert kernels.missing == []
    open_store(house).set_complete({first: 3.0})
    assert open_store(house).is_complete
    assert open_store(house).expected_seconds() == {first: 3.0, second: expected[second]}
    with monkeypatch.context() as patch:
        patch.setattr(kernel_store, "_processor", lambda: "another")
        assert not open_store(house).is_complete
    (house / "other.py").write_text("")
    assert not open_store(house).is_complete
    (house / "grids.py").write_text(TWO_KERNELS.replace("return first(x)", "return -first(x)"))
    assert open_store(house).missing == [second]
    (house / "grids.py").write_text(TWO_KERNELS.replace("second", "third"))
    assert open_store(house).expected_seconds().keys() == {first, third}
    assert open_store(house).expected_seconds()[first] == 3.0
    kept_nowhere = KernelStore(house, None)
    kept_nowhere.set_complete({})
    assert not kept_nowhere.is_complete
    assert len(kept_nowhere.missing) == 2
    assert kept_nowhere.expected_seconds().keys() == kept_nowhere.sources.keys()


def test_what_was_used_longest_ago_makes_room(house: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kernels = open_store(house)
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
def test_kernels_stay_when_the_clock_is_set(house: Path, monkeypatch: pytest.MonkeyPatch, ahead_s: float) -> None:
    """While others have been used with the other time."""
    kernels = open_store(house)
    assert kernels.folder
    touch_all(kernels)
    ours = {path.name for path in kernels.folder.glob("*.nb?")}
    monkeypatch.setattr(kernel_store, "MAX_FILES", len(ours) + 1)
    for number in range(5):
        path = kernels.folder / f"grids.first-{number}.py311.nbi"
        path.touch()
        os.utime(path, (0, time.time() - ahead_s))
    kernels.remove_old()
    assert kernels.missing == []
    assert len(list(kernels.folder.glob("*.nb?"))) <= len(ours) + 1


def test_where_the_folder_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    """What is in it is run, so nobody else may write to it."""
    (tmp_path / "file").touch()
    (tmp_path / "shared").mkdir()
    (tmp_path / "shared").chmod(0o777)
    for name, found in (("chosen", tmp_path / "chosen"), ("file", None), ("shared", None)):
        monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / name))
        assert cache_folder() == found
    assert f"others can write to {tmp_path / 'shared'}" in caplog.text
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    monkeypatch.setattr(kernel_store.platformdirs, "user_cache_path", lambda name: tmp_path / "user" / name)
    assert cache_folder() == tmp_path / "user" / "robocorba" / "kernels"


def test_a_temporary_folder_of_somebody_else_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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


def test_a_lock_is_waited_for_until_it_is_free_or_the_limit_has_passed(tmp_path: Path) -> None:
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
        for limit_s in (0.0, 0.05):
            began = time.monotonic()
            with lock(tmp_path / "lock", limit_s):
                assert time.monotonic() - began >= limit_s  # it went on without the lock, not before
        order.put("first")
    waiting.join(60.0)
    assert [order.get(timeout=0.0) for _ in range(2)] == ["first", "second"]


def test_all_kernels_are_compiled_before_they_are_needed() -> None:
    """The fixture `kernels` of the whole suite has compiled what `up` compiles."""
    assert store().missing == []


def doubled(x: Any) -> Any:
    return x + x


def compiled(folder: Path, digest: str = "0a") -> Any:
    dispatcher = numba.njit(doubled)
    dispatcher._cache = KernelCache(doubled, folder, digest)
    return dispatcher


def result_of(folder: Path, argument: Any) -> Any:
    """What the function is compiled to for an argument."""
    folder.mkdir()
    dispatcher = compiled(folder)
    dispatcher(argument)
    (result,) = dispatcher.overloads.values()
    return result


def hits(dispatcher: Any) -> int:
    return int(sum(dispatcher.stats.cache_hits.values()))


def test_kernels_of_one_digest_share_their_files(tmp_path: Path) -> None:
    first, second, other = compiled(tmp_path), compiled(tmp_path), compiled(tmp_path, "0b")
    assert [each(2) for each in (first, second, other)] == [4, 4, 4]
    assert [hits(each) for each in (first, second, other)] == [0, 1, 0]
    assert {path.name.split("-")[1][:2] for path in tmp_path.glob("*.nb?")} == {"0a", "0b"}


def test_two_that_write_at_once_both_keep_their_signature(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = compiled(tmp_path)._cache, compiled(tmp_path)._cache
    whole, real = result_of(tmp_path / "whole", 2), result_of(tmp_path / "real", 2.0)
    writing = threading.Thread(target=second.save_overload, args=(real.signature.args, real))
    load_index = IndexDataCacheFile._load_index

    def load_while_the_other_writes(index: Any) -> Any:
        found = load_index(index)
        if threading.current_thread() is threading.main_thread():
            writing.start()
            writing.join(0.2)  # without a lock, it would write in this time
        return found

    with monkeypatch.context() as patch:
        patch.setattr(IndexDataCacheFile, "_load_index", load_while_the_other_writes)
        first.save_overload(whole.signature.args, whole)
    writing.join(60.0)
    loaded = compiled(tmp_path)
    assert (loaded(2), loaded(2.5)) == (4, 5.0)
    assert hits(loaded) == 2


def test_damaged_files_are_replaced(tmp_path: Path) -> None:
    compiled(tmp_path)(2)
    for pattern in ("*.nbi", "*.nbc"):
        (path,) = tmp_path.glob(pattern)
        path.write_bytes(b"damaged")
        again = compiled(tmp_path)
        assert (again(2), hits(again)) == (4, 0)
        again = compiled(tmp_path)
        assert (again(2), hits(again)) == (4, 1)
    (tmp_path / "folder").touch()
    assert compiled(tmp_path / "folder")(2) == 4  # it runs although it can't be kept


def test_who_needs_what_another_one_compiles_loads_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    result = result_of(tmp_path / "before", 2)
    shared = tmp_path / "shared"
    shared.mkdir()
    other, needed = SharedWork(shared), compiled(tmp_path)
    assert other.claim(needed._cache.name)
    assert not other.claim(needed._cache.name)  # it is compiled for a second signature
    another = SharedWork(shared)
    taken = [other.take("a"), another.take("a"), another.take("b"), other.take("b")]
    assert taken == [True, False, True, False]
    monkeypatch.setattr(kernel_cache, "shared_work", SharedWork(shared))
    waiting = threading.Thread(target=needed, args=(2,))
    waiting.start()
    waiting.join(0.2)
    assert waiting.is_alive()
    compiled(tmp_path)._cache.save_overload(result.signature.args, result)
    other.release(needed._cache.name)
    waiting.join(60.0)
    assert hits(needed) == 1


def test_a_file_in_the_current_folder_sets_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / ".numba_config.yaml").write_text("disable_jit: 1")
    monkeypatch.chdir(tmp_path)
    numba.core.config.reload_config()
    assert not numba.core.config.DISABLE_JIT
    code = "from robocorba.system import kernels; import numba; print(numba.core.config.DISABLE_JIT)"
    assert subprocess.check_output([sys.executable, "-c", code], text=True, timeout=60).strip() == "0"
