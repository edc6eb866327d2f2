"""Kernels are compiled once on a machine, by one process."""

from __future__ import annotations

import logging
import threading
from pathlib import Path
from typing import Any

import psutil
import pytest

from robocorba.commands.compiling import LINE_INTERVAL_S, TITLE, Lines
from robocorba.system.kernel_store import KernelStore, lock
from robocorba.system.supervision import compilation, compile_worker
from robocorba.system.supervision.compilation import Progress, compile_kernels
from testkit.processes import is_running

ROOT = Path(__file__).parents[2]
SOURCE = "\n@kernel\ndef first(x):\n    return x\n\n\n@kernel\ndef second(x):\n    return first(x)\n"


@pytest.fixture
def kernels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> KernelStore:
    """Those of a package of two kernels, which a stand-in compiles."""
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("COMPILE_AS", "well")
    monkeypatch.setattr(compilation, "WORKER", "tests.supervision.compiling_program")
    for folder in ("house", "cache", "logs"):
        (tmp_path / folder).mkdir()
    (tmp_path / "house" / "grids.py").write_text(SOURCE)
    return KernelStore(tmp_path / "house", tmp_path / "cache")


def fail(progress: Progress) -> None:
    pytest.fail(f"it compiles {progress}")


def test_all_are_compiled_once(tmp_path: Path, kernels: KernelStore) -> None:
    seen: list[str] = []
    assert compile_kernels(lambda progress: seen.append(str(progress)), tmp_path / "logs", kernels)
    assert (seen[0], seen[-1]) == ("0 of 2", "2 of 2, about 1 s left")
    assert kernels.is_complete
    assert compile_kernels(fail, tmp_path / "logs", kernels)


def test_who_waits_for_another_process_compiles_nothing(tmp_path: Path, kernels: KernelStore) -> None:
    begun, folder = threading.Event(), kernels.folder
    assert folder

    def compile_meanwhile() -> None:
        with lock(folder.parent / "compiling.lock", 60.0):
            begun.set()
            threading.Event().wait(0.2)
            kernels.set_complete()

    other = threading.Thread(target=compile_meanwhile)
    other.start()
    assert begun.wait(60.0)
    assert compile_kernels(fail, tmp_path / "logs", kernels)
    other.join(60.0)


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


def test_an_interrupt_ends_the_process(tmp_path: Path, kernels: KernelStore, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COMPILE_AS", "wait")
    others = psutil.Process().children(recursive=True)  # of earlier tests
    children: list[psutil.Process] = []

    def interrupt(progress: Progress) -> None:
        children.extend(set(psutil.Process().children(recursive=True)).difference(others))
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        compile_kernels(interrupt, tmp_path / "logs", kernels)
    assert children
    assert not any(map(is_running, children))
    assert not kernels.is_complete


def test_progress_and_its_text() -> None:
    now = [100.0]
    progress = Progress({"a": 600, "b": 350, "c": 50}, lambda: now[0])
    now[0] += 10.0
    progress.add("c")
    assert (progress.share, str(progress)) == (0.05, "1 of 3")
    now[0] += 20.0
    for name in ("a", "a", "elsewhere"):  # also for another signature
        progress.add(name)
    assert (progress.share, str(progress)) == (0.65, "2 of 3, about 16 s left")
    assert str(Progress({})) == "0 of 0, about 1 s left"
    later, lines = [0.0], list[str]()  # where there is no terminal
    writer = Lines(lines.append, lambda: later[0])
    for name in "bac":
        writer.report(progress)
        progress.add(name)
        later[0] += LINE_INTERVAL_S / 2
    assert lines == [f"{TITLE}: 2 of 3, about 16 s left", f"{TITLE}: 3 of 3, about 1 s left"]


def test_the_process_prints_what_it_compiles(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import numba

    @numba.njit
    def inner(x: Any) -> Any:
        return x + 1

    @numba.njit
    def outer(x: Any) -> Any:
        return inner(x)

    monkeypatch.setattr(compile_worker, "STEPS", (lambda: outer(1),))
    monkeypatch.setattr(compile_worker.gc, "set_threshold", lambda threshold: None)
    compile_worker.main()
    names = [line.rpartition(".")[2] for line in capsys.readouterr().out.splitlines()]
    assert names == ["inner", "outer"]
