"""Kernels are compiled by several processes, once on a machine."""

from __future__ import annotations

import functools
import logging
import os
from pathlib import Path

import psutil
import pytest

from robocorba.commands.compiling import LINE_INTERVAL_S, TITLE, Lines, text_of
from robocorba.system import kernel_cache
from robocorba.system.kernel_store import KernelStore
from robocorba.system.supervision import compilation, compile_worker
from robocorba.system.supervision.compilation import CompilationProgress, Progress, compile_kernels, worker_count
from testkit.processes import is_running

ROOT = Path(__file__).parents[2]
SOURCE = "@kernel\ndef first(x):\n    return x\n\n\n@kernel\ndef second(x):\n    return first(x)\n"


@pytest.fixture
def kernels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> KernelStore:
    """Those of a package of two kernels, which stand-ins compile."""
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("COMPILE_AS", "well")
    monkeypatch.setattr(compilation, "WORKER", "tests.supervision.compiling_program")
    monkeypatch.setattr(compilation, "worker_count", lambda kernels: 2)
    for folder in ("house", "cache", "logs"):
        (tmp_path / folder).mkdir()
    (tmp_path / "house" / "grids.py").write_text(SOURCE)
    return KernelStore(tmp_path / "house", tmp_path / "cache")


def test_all_are_compiled_once(tmp_path: Path, kernels: KernelStore) -> None:
    seen: list[CompilationProgress] = []
    assert compile_kernels(seen.append, tmp_path / "logs", kernels)
    assert seen[0] == CompilationProgress(0, 2, 0.0, None)
    assert seen[-1] == CompilationProgress(2, 2, 1.0, 0.0)
    assert kernels.is_complete
    assert kernels.expected_seconds() == {"house.grids.first": 4.0, "house.grids.second": 0.5}  # by two processes
    seen.clear()
    assert compile_kernels(seen.append, tmp_path / "logs", kernels)
    assert not seen


def test_nothing_is_started_if_only_others_have_changed(tmp_path: Path, kernels: KernelStore) -> None:
    assert kernels.folder
    for source in kernels.sources.values():
        (kernels.folder / f"grids-{source.digest}.py311.nbi").touch()
    assert compile_kernels(pytest.fail, tmp_path / "logs", kernels)
    assert kernels.is_complete


@pytest.mark.parametrize(("way", "reason"), [("fail", "exit code 1 (out of memory)"), ("wait", "not compiled after")])
def test_a_failure_is_reported_and_nothing_is_complete(
    tmp_path: Path,
    kernels: KernelStore,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    way: str,
    reason: str,
) -> None:
    monkeypatch.setenv("COMPILE_AS", way)
    if way == "wait":
        monkeypatch.setattr(compilation, "LIMIT_S", 0.1)
    with caplog.at_level(logging.ERROR):
        assert not compile_kernels(lambda progress: None, tmp_path / "logs", kernels)
    assert reason in caplog.text
    assert not kernels.is_complete


def test_an_interrupt_ends_the_processes(tmp_path: Path, kernels: KernelStore, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COMPILE_AS", "wait")
    others = psutil.Process().children(recursive=True)  # of earlier tests
    children: list[psutil.Process] = []

    def interrupt(progress: CompilationProgress) -> None:
        children.extend(set(psutil.Process().children(recursive=True)).difference(others))
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        compile_kernels(interrupt, tmp_path / "logs", kernels)
    assert len(children) >= 2
    assert not any(map(is_running, children))
    assert not kernels.is_complete


def test_progress_by_the_expected_times_and_its_text() -> None:
    now = [100.0]
    progress = Progress({"a": 6.0, "b": 3.0, "c": 1.0}, 2, lambda: now[0])
    assert progress.now == CompilationProgress(0, 3, 0.0, None)
    progress.read("ready\n")
    assert progress.now.seconds_left == pytest.approx(5.0)  # as expected of two processes
    now[0] += 5.0
    progress.read("ready\n")  # the second process begins
    assert progress.now.seconds_left == pytest.approx(55.0)
    now[0] += 7.0
    progress.read("a 4.5\n")
    assert progress.now == CompilationProgress(1, 3, 0.6, pytest.approx(12.5 / 0.7 * 0.4))
    progress.read("a 1.25\n")  # for another signature
    progress.read("elsewhere 3.0\n")
    assert progress.now.done == 1
    assert progress.seconds["a"] == 5.75
    for name in "bc":
        progress.read(f"{name} 1\n")
    assert progress.now == CompilationProgress(3, 3, 1.0, 0.0)
    assert Progress({}).now == CompilationProgress(0, 0, 1.0, None)
    assert text_of(CompilationProgress(0, 136, 0.0, None)) == "0 of 136"
    assert text_of(CompilationProgress(45, 136, 0.4, 20.4)) == "45 of 136, about 20 s left"
    now, lines = [0.0], list[str]()  # where there is no terminal
    writer = Lines(lines.append, lambda: now[0])
    for done in range(3):
        writer.report(CompilationProgress(done, 3, done / 3, None))
        now[0] += LINE_INTERVAL_S / 2
    assert lines == [f"{TITLE}: 0 of 3", f"{TITLE}: 2 of 3"]


def test_workers_share_the_steps(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def count(cores: int, gigabytes: float, kernels: int) -> int:
        monkeypatch.setattr(os, "sched_getaffinity", lambda process: set(range(cores)))
        memory = type("Memory", (), {"available": int(gigabytes * 1e9)})
        monkeypatch.setattr(psutil, "virtual_memory", lambda: memory)
        return worker_count(kernels)

    assert count(2, 8.0, 136) == 2
    assert count(64, 64.0, 136) == compilation.MAX_WORKERS
    assert count(4, 1.3, 136) == 2
    assert count(1, 0.1, 136) == 1
    assert count(8, 8.0, 3) == 3
    done: list[str] = []

    def begin_second() -> None:
        done.append("first")
        compile_worker.main(str(tmp_path))

    names = list(compile_worker.STEPS)  # large steps come first, and what needs them last
    assert (names[0], names[-1]) == ("drives", "all queries")
    monkeypatch.setattr(kernel_cache, "shared_work", None)  # restored at the end
    others = {name: functools.partial(done.append, name) for name in ("second", "third")}
    monkeypatch.setattr(compile_worker, "STEPS", {"first": begin_second, **others})
    compile_worker.main(str(tmp_path))
    assert done == ["first", "second", "third"]


def test_a_worker_prints_what_it_compiles(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    import numba
    from numba.core import event

    def inner(x):
        return x + 1

    called = numba.njit(inner)

    def outer(x):
        return called(x)

    dispatcher = numba.njit(outer)
    for each, name in ((called, "0a"), (dispatcher, "0b")):
        each._cache = kernel_cache.KernelCache(each.py_func, tmp_path, name)
    with event.install_listener("numba:compile", compile_worker.Listener()):
        assert dispatcher(1) == 2
    names = [line.rpartition(" ")[0].rpartition(".")[2] for line in capsys.readouterr().out.splitlines()]
    assert names == ["inner", "outer"]
