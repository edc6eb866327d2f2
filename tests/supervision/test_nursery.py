"""Forked commands are like those that are started alone."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from robocorba.supervision.launch import ModuleRun, module_command
from robocorba.testing.nursery import ForkedProcess, Nursery
from robocorba.testing.processes import ROBOCORBA, Launcher, read_json

ROOT = Path(__file__).parents[2]
LIMIT_S = 60.0


@pytest.fixture(scope="module")
def nursery() -> Iterator[Nursery]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(ROOT))
        with Nursery() as nursery:
            yield nursery


@pytest.fixture
def options(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    return {"cwd": tmp_path, "env": {**os.environ, "ROBOCORBA_STATE": str(tmp_path / "no system")}, **pipes}


@pytest.mark.parametrize("arguments", [("status",), ("status", "--nonsense"), ("path", "--help")])
def test_forks_are_like_commands(
    nursery: Nursery, tmp_path: Path, options: dict[str, Any], arguments: tuple[str, ...]
) -> None:
    forked = nursery.start((ROBOCORBA, *arguments), **options)
    assert isinstance(forked, ForkedProcess)
    with Launcher(tmp_path) as launch:  # which has no nursery here
        alone = launch(ROBOCORBA, *arguments, ROBOCORBA_STATE=str(tmp_path / "no system"))
        assert forked.communicate(timeout=LIMIT_S) == alone.communicate(timeout=LIMIT_S)
        assert forked.returncode == alone.returncode


def look(nursery: Nursery, options: dict[str, Any], *arguments: str) -> tuple[ForkedProcess, dict[str, Any]]:
    process = ForkedProcess(nursery, ModuleRun("tests.supervision.forked_program", arguments), "a title", **options)
    assert process.stdout
    return process, read_json(process.stdout.readline())


def test_it_is_a_child_of_this_process(nursery: Nursery, options: dict[str, Any], tmp_path: Path) -> None:
    process, seen = look(nursery, options, "some", "arguments")
    assert (seen["pid"], seen["session"], seen["parent"]) == (process.pid, process.pid, os.getpid())
    assert (seen["folder"], seen["arguments"]) == (str(tmp_path), ["some", "arguments"])
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(0.01)
    process.kill()
    assert process.wait(LIMIT_S) == -signal.SIGKILL
    process.communicate()
    process, _ = look(nursery, options, "ends")
    process.communicate(timeout=LIMIT_S)
    assert process.returncode == 3


def test_what_is_not_forked(nursery: Nursery, options: dict[str, Any]) -> None:
    client = module_command("robocorba.testing.simulation_client", "127.0.0.1:2809")
    for command in ((sys.executable, "-c", ""), ("omniNames", "-start"), (ROBOCORBA, "--help"), client):
        assert nursery.start(command, **options) is None
    options["env"]["NUMBA_CACHE_DIR"] = "/elsewhere"
    assert nursery.start((ROBOCORBA, "status"), **options) is None
