"""The files of a compiled kernel: shared, written in turns, and replaced when they are damaged."""

from __future__ import annotations

import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import numba
import pytest
from numba.core.caching import IndexDataCacheFile

from robocorba import kernel_cache
from robocorba.kernel_cache import KernelCache, SharedWork


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


def test_a_kernel_runs_though_it_can_not_be_kept(tmp_path: Path) -> None:
    (tmp_path / "folder").touch()  # in the place of the folder
    dispatcher = compiled(tmp_path / "folder")
    assert dispatcher(2) == 4


def test_a_step_is_taken_once(tmp_path: Path) -> None:
    first, second = SharedWork(tmp_path), SharedWork(tmp_path)
    assert [first.take("a"), second.take("a"), second.take("b"), first.take("b")] == [True, False, True, False]


def test_who_needs_what_another_one_compiles_loads_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    result = result_of(tmp_path / "before", 2)
    shared = tmp_path / "shared"
    shared.mkdir()
    other, needed = SharedWork(shared), compiled(tmp_path)
    assert other.claim(needed._cache.name)
    assert not other.claim(needed._cache.name)  # it is compiled for a second signature
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
    code = "from robocorba import kernels; import numba; print(numba.core.config.DISABLE_JIT)"
    assert subprocess.check_output([sys.executable, "-c", code], text=True, timeout=60).strip() == "0"
