"""Kernels are compiled once on a machine, by one process."""

from __future__ import annotations

import contextlib
import logging
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from robocorba.commands.compiling import LINE_INTERVAL_S, TITLE, lines
from robocorba.system.kernel_store import KernelStore, lock
from robocorba.system.supervision import compilation
from robocorba.system.supervision.compilation import Progress, compile_kernels
from testkit.processes import eventually, is_running

pytestmark = [pytest.mark.system, pytest.mark.full]

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
    kernels = KernelStore(tmp_path / "house", tmp_path / "cache")
    monkeypatch.setenv("KERNELS", str(kernels.folder))
    return kernels


def fail(progress: Progress) -> None:
    pytest.fail(f"it compiles {progress}")


def test_all_are_compiled_once(tmp_path: Path, kernels: KernelStore) -> None:
    seen: list[str] = []
    assert compile_kernels(lambda progress: seen.append(str(progress)), tmp_path / "logs", kernels)
    assert seen[0] == "0 of 2"
    assert kernels.is_complete
    assert compile_kernels(fail, tmp_path / "logs", kernels)


def test_who_waits_for_another_process_reports_its_progress_and_compiles_nothing(
    tmp_path: Path, kernels: KernelStore
) -> None:
    folder = kernels.folder
    assert folder
    part = folder / "house_0"
    part.mkdir(parents=True)
    other = contextlib.ExitStack()
    other.enter_context(lock(folder.parent / "compiling.lock", 60.0))
    seen: list[str] = []

    def report(progress: Progress) -> None:
        if len(seen) == 1:
            (part / "grids.first-1.py311.nbi").touch()
        if len(seen) == 3:
            kernels.set_complete()
            other.close()
        seen.append(str(progress).partition(",")[0])

    assert compile_kernels(report, tmp_path / "logs", kernels)
    assert seen[:4] == ["0 of 2", "0 of 2", "1 of 2", "1 of 2"]
    assert not list((tmp_path / "logs").iterdir())


@pytest.mark.parametrize(
    ("way", "reason"),
    [
        ("fail", "exit code 1 (out of memory)"),
        ("wait", "not compiled after"),
        ("on a full disk", "1 compiled kernels can't be kept"),
    ],
)
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
    progress.update({"a", "b"})
    assert (progress.share, str(progress)) == (0.05, "1 of 3")
    now[0] += 20.0
    progress.update({"b", "elsewhere"})
    assert (progress.share, str(progress)) == (0.65, "2 of 3, about 16 s left")
    assert str(Progress({})) == "0 of 0, about 1 s left"
    later, written = [0.0], list[str]()  # where there is no terminal
    report = lines(written.append, lambda: later[0])
    for missing in ({"b"}, {"b"}, set[str]()):
        progress.update(missing)
        report(progress)
        later[0] += LINE_INTERVAL_S / 2
    assert written == [f"{TITLE}: 2 of 3, about 16 s left", f"{TITLE}: 3 of 3, about 1 s left"]


HALVES = """
import os, sys, time
from robocorba.system.supervision import compile_worker

def write(text):
    os.write(1, f"{{text}}\\n".encode())

def wait():
    write(os.getpid())
    time.sleep(600.0)

compile_worker.STEPS = {steps}
compile_worker.main()
"""


def run_halves(steps: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", HALVES.format(steps=steps)]
    return subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_each_half_does_its_steps() -> None:
    output, _ = run_halves("((lambda: write('one'),), (lambda: write('two'), lambda: write('three')))").communicate(
        timeout=120.0
    )
    assert sorted(output.split()) == ["one", "three", "two"]


def test_it_fails_when_a_half_does() -> None:
    workers = [run_halves(steps) for steps in ("((lambda: sys.exit(3),), ())", "((), (lambda: sys.exit(3),))")]
    for worker in workers:
        worker.communicate(timeout=120.0)
        assert worker.returncode


def test_both_halves_end_when_it_is_killed() -> None:
    with run_halves("((wait,), (wait,))") as worker:
        assert worker.stdout
        pids = [int(worker.stdout.readline()) for _ in range(2)]
        halves = [psutil.Process(pid) for pid in pids]
        worker.kill()
        assert worker.pid in pids
        eventually(lambda: not any(map(is_running, halves)))
