"""Processes that are forked from the warm parent: as if each had been started alone."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import subprocess
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, TypeAlias

import psutil
import pytest

from robocorba.errors.services import StartFailed
from robocorba.supervision.launch import ModuleRun
from robocorba.supervision.output import Pipe
from robocorba.supervision.starter import Child, Starter
from robocorba.supervision.warm_parent import ENVIRONMENT
from robocorba.testing.processes import command_line

Run: TypeAlias = "Callable[[Callable[[Place], Awaitable[None]]], None]"
PROGRAM = "tests.supervision.forked_program"
#: Whatever it runs on: a condition is waited for at most this long [s].
LIMIT_S = 60.0
ROOT = Path(__file__).parents[2]


class Place:
    """A starter, and what the processes that it started have printed."""

    def __init__(self, folder: Path) -> None:
        self.starter, self.folder = Starter(), folder
        self._children: list[Child] = []
        self._reading: list[asyncio.Task[None]] = []

    async def start(self, *arguments: str) -> tuple[Child, asyncio.Queue[str]]:
        pipe, lines = await Pipe.open(), asyncio.Queue[str]()
        with pipe.write_end() as output:
            child = await self.starter.start(ModuleRun(PROGRAM, arguments), self.folder, output)
        self._children.append(child)
        self._reading.append(asyncio.create_task(pipe.read(lines.put_nowait)))
        return child, lines

    async def close(self) -> None:
        for child in self._children:
            child.send_signal(signal.SIGKILL)
            await child.wait()
        await asyncio.wait(self._reading, timeout=LIMIT_S)
        await self.starter.close()

    async def look(self, *arguments: str) -> tuple[Child, dict[str, Any]]:
        """A started process, and what it tells of itself."""
        child, lines = await self.start(*arguments)
        return child, json.loads(await asyncio.wait_for(lines.get(), LIMIT_S))

    @property
    def warm_parent(self) -> psutil.Process:
        (found,) = [child for child in children() if "robocorba.supervision.warm_parent" in command_line(child)]
        return found


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    monkeypatch.setenv("PYTHONPATH", str(ROOT))

    async def in_place(test: Callable[[Place], Awaitable[None]]) -> None:
        place = Place(tmp_path)
        try:
            await test(place)
        finally:
            await place.close()

    return lambda test: asyncio.run(in_place(test))


#: Children of this process that were there before a test, such as the one that multiprocessing starts in another test.
_earlier: list[psutil.Process] = []


@pytest.fixture(autouse=True)
def earlier() -> None:
    _earlier[:] = psutil.Process().children()


def children() -> list[psutil.Process]:
    """The children of this process since the beginning of the test. Zombies are children, too."""
    return [child for child in psutil.Process().children() if child not in _earlier]


async def until(condition: Callable[[], bool]) -> None:
    async def poll() -> None:
        while not condition():
            await asyncio.sleep(0.01)

    await asyncio.wait_for(poll(), LIMIT_S)


def test_a_fork_is_as_if_started_alone(run: Run, tmp_path: Path) -> None:
    async def test(place: Place) -> None:
        child, seen = await place.look("--name", "a b")
        assert seen["pid"] == seen["session"] == child.pid
        assert seen["parent"] == os.getpid()
        assert seen["folder"] == str(tmp_path)
        assert seen["arguments"] == ["--name", "a b"]
        assert seen["descriptors"] == [0, 1, 2]
        assert seen["threads"] == 1
        assert seen["preloaded_in"] == [place.warm_parent.pid]
        process = psutil.Process(child.pid)
        assert command_line(process) == ModuleRun(PROGRAM, ("--name", "a b")).title
        assert process.name() == Path(sys.executable).name
        child.send_signal(signal.SIGTERM)
        assert await asyncio.wait_for(child.wait(), LIMIT_S) == -signal.SIGTERM

    run(test)


def test_a_module_is_loaded_in_advance(run: Run) -> None:
    async def test(place: Place) -> None:
        place.starter.prepare(ModuleRun(PROGRAM))
        _, seen = await place.look()
        assert seen["preloaded_in"] == [place.warm_parent.pid]

    run(test)


def test_a_module_that_is_missing_is_reported_by_its_start(run: Run) -> None:
    async def test(place: Place) -> None:
        missing = ModuleRun("tests.supervision.missing")
        place.starter.prepare(missing)
        with pytest.raises(StartFailed, match=missing.name):
            await place.starter.start(missing, place.folder, 1)
        await place.look()

    run(test)


def test_an_end_while_a_module_is_loaded_leaves_nothing(run: Run) -> None:
    async def test(place: Place) -> None:
        child, _ = await place.look("ends")
        await child.wait()
        place.starter.prepare(ModuleRun("tests.supervision.forked_slowly"))
        await asyncio.sleep(0)
        await place.close()
        assert children() == []

    run(test)


def test_forks_have_random_numbers_of_their_own_and_their_exit_codes(run: Run) -> None:
    async def test(place: Place) -> None:
        looks = [await place.look("ends") for _ in range(3)]
        for kind in range(2):
            assert len({seen["randoms"][kind] for _, seen in looks}) == 3
        assert [await asyncio.wait_for(child.wait(), LIMIT_S) for child, _ in looks] == [3, 3, 3]

    run(test)


def test_a_dead_warm_parent_comes_back_and_disturbs_nobody(run: Run) -> None:
    async def test(place: Place) -> None:
        first, _ = await place.look()
        former = place.warm_parent
        former.kill()
        second, seen = await place.look()  # at once: the new one may not have loaded anything
        assert seen["preloaded_in"] == [place.warm_parent.pid] != [former.pid]
        assert not first.ended.done()
        first.send_signal(signal.SIGKILL)
        assert await asyncio.wait_for(first.wait(), LIMIT_S) == -signal.SIGKILL
        assert not second.ended.done()

    run(test)


def test_many_forks_leave_nothing(run: Run) -> None:
    async def test(place: Place) -> None:
        await place.look("ends")
        warm = place.warm_parent

        def counts() -> list[int]:
            here = psutil.Process()
            return [here.num_fds(), here.num_threads(), warm.num_fds(), warm.num_threads()]

        before = counts()
        for _ in range(20):
            child, _ = await place.look("ends")
            await asyncio.wait_for(child.wait(), LIMIT_S)
        await until(lambda: all(now <= then for now, then in zip(counts(), before, strict=True)))
        assert children() == [warm]
        assert warm.children() == []

    run(test)


def test_what_can_not_be_loaded_is_named(run: Run, tmp_path: Path) -> None:
    async def test(place: Place) -> None:
        with pytest.raises(StartFailed, match="no_such_module"):
            await place.starter.start(ModuleRun("robocorba.no_such_module"), tmp_path, 1)
        _, seen = await place.look()
        assert seen["parent"] == os.getpid()

    run(test)


def test_a_start_that_is_cancelled_leaves_no_process(run: Run) -> None:
    async def test(place: Place) -> None:
        await place.look("ends")
        started = asyncio.create_task(place.start("cancelled"))
        await asyncio.sleep(0)
        started.cancel()
        await asyncio.wait({started})
        await place.look("ends")  # after the cancelled one
        await until(lambda: children() == [place.warm_parent])

    run(test)


SERVERS = ["map_editor", "simulation", "virtual_sensor", "event_channel"]


def test_loaded_servers_can_be_forked() -> None:
    """No thread, ORB, SQLite handle or socket exists before the fork."""
    names = [*(f"robocorba.servers.{name}" for name in SERVERS), "robocorba.clients.robot", "robocorba.clients.console"]
    script = (
        "import os, sys\n"
        "from pathlib import Path\n"
        "from robocorba.supervision.warm_parent import check_forkable, load, pipes\n"
        "before = set(os.listdir('/proc/self/fd'))\n"
        "for name in sys.argv[1:]: load(name)\n"
        "check_forkable()\n"
        "from robocorba.corba import orb\n"
        "assert not orb._one_orb.locked()\n"
        "own = {str(end) for pair in pipes() for end in pair}  # which each process renews\n"
        "assert len(set(os.listdir('/proc/self/fd')) - own) == len(before), os.listdir('/proc/self/fd')\n"
    )
    subprocess.run(["env", *ENVIRONMENT, sys.executable, "-c", script, *names], check=True, timeout=600)
