"""Compiled kernels: for which sources they are kept, the folder that keeps them, and numba's cache in it."""

from __future__ import annotations

import itertools
import os
import queue
import runpy
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numba
import pytest
from numba.core import config
from numba.core.caching import IndexDataCacheFile

from robocorba.system import kernel_store, kernels
from robocorba.system.kernel_store import KernelStore, cache_folder, lock, store
from robocorba.system.kernels import KernelCache

FILES = {
    "grids.py": "from house import units\nfrom house.kernels import kernel\n\n\n"
    "@kernel\ndef first(x):\n    return x * units.METRE\n\n\n@kernel\ndef second(x):\n    return first(x)\n",
    "kernels.py": "def kernel(function):\n    return function\n",
    "units.py": "from house.deep.types import (\n    Grid,\n)\n\nMETRE = 1.0\n",
    "deep/types.py": "import house.far\n\nclass Grid:\n    pass\n",
    "far.py": "",
    "plain.py": "from house.grids import first\n",
    "stubs/made.py": "",
}


@pytest.fixture
def house(tmp_path: Path) -> Path:
    """A package with two kernels."""
    for name, text in FILES.items():
        path = tmp_path / "house" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    (tmp_path / "cache").mkdir()
    return tmp_path / "house"


def open_store(house: Path) -> KernelStore:
    return KernelStore(house, house.parent / "cache")


def test_kernels_are_those_of_their_sources_a_compiler_and_a_processor(house: Path) -> None:
    """Of their own modules, and of what these import; other edits keep them."""
    before = open_store(house).folder
    for name, text in FILES.items():
        (house / name).write_text(text + "#\n")
        assert (open_store(house).folder == before) == (name in ("plain.py", "stubs/made.py")), name
        (house / name).write_text(text)
        assert open_store(house).folder == before
    for what in ("_compiler", "_processor"):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(kernel_store, what, lambda: "another")
            assert open_store(house).folder != before


def test_what_is_missing_and_when_all_are_there(house: Path) -> None:
    kernels = open_store(house)
    assert kernels.folder
    sizes = kernels.missing
    assert sizes.keys() == {"house.grids.first", "house.grids.second"}
    assert sizes["house.grids.first"] > sizes["house.grids.second"] > 0
    for name in ("house_0123456789/grids.first-7.py311.nbi", "other_01/grids.second-7.py311.nbi"):
        (kernels.folder / name).parent.mkdir(parents=True)
        (kernels.folder / name).touch()
    assert kernels.missing.keys() == {"house.grids.second"}
    for each, is_complete in ((open_store(house), True), (KernelStore(house, None), False)):
        assert not each.is_complete
        each.set_complete()
        assert each.is_complete is is_complete
    assert open_store(house).is_complete
    assert len(KernelStore(house, None).missing) == 2


@pytest.mark.parametrize("ahead_s", [1.0, -1.0, 365 * 86400.0, -365 * 86400.0])
def test_versions_that_were_used_longest_ago_make_room(house: Path, ahead_s: float) -> None:
    """Whatever the clock was when others were used, this version stays, and so does what others made."""
    cache = house.parent / "cache"
    others = [cache / f"{number:020x}" for number in range(10)]
    for number, path in enumerate(others):
        path.mkdir()
        os.utime(path, (0, time.time() + ahead_s - number))
    for name in ("0123456789abcdef", "house_0123456789"):
        (cache / name).mkdir()
        os.utime(cache / name, (0, 0))
    for name in ("grids.first-0a.py311.nbi", "grids.first-0a.py311.1.nbc", "sources-0c.json", "writing.lock"):
        (cache / name).touch()
    kernels = open_store(house)
    kernels.set_complete()
    assert kernels.is_complete
    kept = {path.name for path in [*others[: kernel_store.MAX_VERSIONS - 1], kernels.folder] if path}
    assert {path.name for path in cache.iterdir()} == kept | {"house_0123456789", "writing.lock"}


def test_where_the_folder_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    """What is in it is run, so nobody else may write to it: also not to one in the folder of temporary files."""
    (tmp_path / "file").touch()  # no folder can be created in it
    for name in ("shared", "planted"):
        (tmp_path / name).mkdir()
        (tmp_path / name).chmod(0o777)
    for name, found in (("chosen", tmp_path / "chosen"), ("file", None), ("shared", None)):
        monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / name))
        assert cache_folder() == found
    assert f"others can write to {tmp_path / 'shared'}" in caplog.text
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    monkeypatch.setattr(kernel_store.platformdirs, "user_cache_path", lambda name: tmp_path / "user" / name)
    assert cache_folder() == tmp_path / "user" / "robocorba" / "kernels"
    monkeypatch.setattr(kernel_store.platformdirs, "user_cache_path", lambda name: tmp_path / "file")
    monkeypatch.setattr(kernel_store.tempfile, "gettempdir", lambda: str(tmp_path))
    own = tmp_path / f"robocorba-{os.getuid()}" / "kernels"
    assert cache_folder() == own and own.parent.stat().st_mode & 0o077 == 0
    own.parent.chmod(0o777)
    assert cache_folder() is None
    own.parent.chmod(0o700)
    own.rmdir()
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
    assert store().missing == {}


def doubled(x: Any) -> Any:
    return x + x


def compiled(cache: Path, function: Any = doubled) -> Any:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(numba.config, "CACHE_DIR", str(cache / "version"))
        dispatcher: Any = numba.njit(function)
        dispatcher._cache = KernelCache(function)
        return dispatcher


def hits(dispatcher: Any) -> int:
    return int(sum(dispatcher.stats.cache_hits.values()))


def test_two_that_write_at_once_both_keep_their_signature(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    results = []
    for argument in (2, 2.0):
        dispatcher = compiled(tmp_path / str(argument))
        dispatcher(argument)
        results += dispatcher.overloads.values()
    (whole, real), first, second = results, compiled(tmp_path)._cache, compiled(tmp_path)._cache
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


def test_a_source_that_is_written_again_keeps_its_kernels(tmp_path: Path) -> None:
    """As by an installation, or by git on the way to another branch and back."""
    source = tmp_path / "source.py"
    source.write_text("def same(x):\n    return x\n")
    found = []
    for written_at in (1.0, 2.0):
        os.utime(source, (written_at, written_at))
        dispatcher = compiled(tmp_path, runpy.run_path(str(source))["same"])
        found.append((dispatcher(2), hits(dispatcher)))
    assert found == [(2, 0), (2, 1)]


def test_damaged_files_are_replaced(tmp_path: Path) -> None:
    compiled(tmp_path)(2)
    for pattern, content in itertools.product(("*.nbi", "*.nbc"), (b"", b"damaged", bytes(100))):
        (path,) = tmp_path.rglob(pattern)
        path.write_bytes(content)
        again = compiled(tmp_path), compiled(tmp_path)
        assert [(each(2), hits(each)) for each in again] == [(4, 0), (4, 1)], (pattern, content)


def test_kernels_run_where_they_cannot_be_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    full = compiled(tmp_path)
    for path in sorted(tmp_path.rglob("*"), reverse=True):
        path.rmdir()
    (tmp_path / "version").touch()  # no folder can be created in it
    assert full(2) == 4
    monkeypatch.setattr(kernels, "store", lambda: SimpleNamespace(folder=tmp_path / "version"))
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")  # restored at the end
    assert kernels.kernel(doubled)(2) == 4
    assert not list(Path(__file__).parent.rglob("*.nb?"))  # nor elsewhere


def test_a_file_in_the_current_folder_sets_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / ".numba_config.yaml").write_text("disable_jit: 1")
    monkeypatch.chdir(tmp_path)
    config.reload_config()
    assert not vars(config)["DISABLE_JIT"]
    code = "from robocorba.system import kernels; import numba; print(numba.core.config.DISABLE_JIT)"
    assert subprocess.check_output([sys.executable, "-c", code], text=True, timeout=60).strip() == "0"
