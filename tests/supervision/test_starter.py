"""Child processes: started alone or forked from a warm parent, their lines, descriptors, and their end."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest

from robocorba.errors.services import NotReachable, StartFailed
from robocorba.system.supervision.hangs import HangLimit, watch_for_hang
from robocorba.system.supervision.launch import LoggedProcess, ModuleRun
from robocorba.system.supervision.output import Pipe
from robocorba.system.supervision.starter import Child, Starter
from robocorba.system.supervision.warm_parent import ENVIRONMENT
from testkit.json_process import checkout_command
from testkit.nursery import ForkedProcess, Nursery
from testkit.processes import ROBOCORBA, Launcher, command_line, eventually, is_running
from tests.waits import until

pytestmark = [pytest.mark.system, pytest.mark.full]

PROGRAM = "tests.supervision.forked_program"
#: Whatever it runs on: a condition is waited for at most this long [s].
LIMIT_S = 60.0
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module", autouse=True)
def python_path() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(ROOT))
        yield


class Place:
    """A starter, and what the processes that it started have printed."""

    def __init__(self, folder: Path) -> None:
        self.starter, self.folder = Starter(), folder
        self._children, self._reading = list[Child](), list[asyncio.Task[None]]()
        self._earlier = psutil.Process().children()

    async def start(self, *arguments: str) -> tuple[Child, asyncio.Queue[str]]:
        pipe, lines = await Pipe.open(), asyncio.Queue[str]()
        with pipe.write_end() as output:
            child = await self.starter.start(ModuleRun(PROGRAM, arguments), self.folder, output)
        self._children.append(child)
        self._reading.append(asyncio.create_task(pipe.read(lines.put_nowait)))
        return child, lines

    async def aclose(self) -> None:
        for child in self._children:
            child.send_signal(signal.SIGKILL)
            await child.wait()
        await asyncio.wait(self._reading, timeout=LIMIT_S)
        await self.starter.close()

    async def look(self, *arguments: str) -> tuple[Child, dict[str, Any]]:
        """A started process, and what it tells of itself."""
        child, lines = await self.start(*arguments)
        return child, json.loads(await asyncio.wait_for(lines.get(), LIMIT_S))

    def children(self) -> list[psutil.Process]:
        """The children of this process since the beginning of the test. Zombies are children, too."""
        return [child for child in psutil.Process().children() if child not in self._earlier]

    @property
    def warm_parent(self) -> psutil.Process:
        module = "robocorba.system.supervision.warm_parent"
        (found,) = [child for child in self.children() if module in command_line(child)]
        return found


def in_place(test: Callable[[Place], Awaitable[None]]) -> Callable[[Path], None]:
    """A test that runs in an event loop."""

    async def run(folder: Path) -> None:
        async with contextlib.aclosing(Place(folder)) as place:
            await test(place)

    return lambda tmp_path: asyncio.run(run(tmp_path))


@in_place
async def test_a_fork_is_as_if_started_alone(place: Place) -> None:
    child, seen = await place.look("--name", "a b")
    assert seen["pid"] == seen["session"] == child.pid
    assert seen["parent"] == os.getpid()
    assert seen["folder"] == str(place.folder)
    assert seen["arguments"] == ["--name", "a b"]
    assert seen["descriptors"] == [0, 1, 2]
    assert seen["threads"] == 1
    assert seen["preloaded_in"] == [place.warm_parent.pid]
    process = psutil.Process(child.pid)
    assert command_line(process) == ModuleRun(PROGRAM, ("--name", "a b")).title
    assert process.name() == Path(sys.executable).name
    child.send_signal(signal.SIGTERM)
    assert await asyncio.wait_for(child.wait(), LIMIT_S) == -signal.SIGTERM


@in_place
async def test_a_module_is_loaded_in_advance_and_one_that_is_missing_is_reported_by_its_start(place: Place) -> None:
    place.starter.prepare(ModuleRun(PROGRAM))
    missing = ModuleRun("tests.supervision.missing")
    place.starter.prepare(missing)
    for absent in (missing, ModuleRun("robocorba.no_such_module")):
        with pytest.raises(StartFailed, match=absent.name):
            await place.starter.start(absent, place.folder, 1)
    _, seen = await place.look()
    assert seen["preloaded_in"] == [place.warm_parent.pid]


@in_place
async def test_forks_have_random_numbers_of_their_own_and_their_exit_codes(place: Place) -> None:
    looks = [await place.look("ends") for _ in range(3)]
    for kind in range(2):
        assert len({seen["randoms"][kind] for _, seen in looks}) == 3
    assert [await asyncio.wait_for(child.wait(), LIMIT_S) for child, _ in looks] == [3, 3, 3]
    # An end while a module is loaded leaves nothing.
    place.starter.prepare(ModuleRun("tests.supervision.forked_slowly"))
    await asyncio.sleep(0)
    await place.aclose()
    assert place.children() == []


@in_place
async def test_a_dead_warm_parent_comes_back_and_disturbs_nobody(place: Place) -> None:
    first, _ = await place.look()
    former = place.warm_parent
    former.kill()
    second, seen = await place.look()  # at once: the new one may not have loaded anything
    assert seen["preloaded_in"] == [place.warm_parent.pid] != [former.pid]
    assert not first.ended.done()
    first.send_signal(signal.SIGKILL)
    assert await asyncio.wait_for(first.wait(), LIMIT_S) == -signal.SIGKILL
    assert not second.ended.done()


@in_place
async def test_many_forks_and_a_start_that_is_cancelled_leave_nothing(place: Place) -> None:
    await place.look("ends")
    warm = place.warm_parent

    def counts() -> list[int]:
        here = psutil.Process()
        return [here.num_fds(), here.num_threads(), warm.num_fds(), warm.num_threads()]

    before = counts()
    for _ in range(20):
        child, _ = await place.look("ends")
        await asyncio.wait_for(child.wait(), LIMIT_S)
    started = asyncio.create_task(place.start("cancelled"))
    await asyncio.sleep(0)
    started.cancel()
    await asyncio.wait({started})
    await place.look("ends")  # after the cancelled one
    await until(lambda: all(now <= then for now, then in zip(counts(), before, strict=True)))
    await until(lambda: place.children() == [warm])
    assert warm.children() == []


SERVERS = ["map_editor", "simulation", "virtual_sensor", "event_channel"]


def test_loaded_servers_can_be_forked() -> None:
    """No thread, ORB, SQLite handle or socket exists before the fork."""
    names = [*(f"robocorba.servers.{name}" for name in SERVERS), "robocorba.clients.robot", "robocorba.clients.console"]
    script = (
        "import os, sys\n"
        "from pathlib import Path\n"
        "from robocorba.system.supervision.warm_parent import check_forkable, load, pipes\n"
        "before = set(os.listdir('/proc/self/fd'))\n"
        "for name in sys.argv[1:]: load(name)\n"
        "check_forkable()\n"
        "from robocorba.orb import orb\n"
        "assert not orb._one_orb.locked()\n"
        "own = {str(end) for pair in pipes() for end in pair}  # which each process renews\n"
        "assert len(set(os.listdir('/proc/self/fd')) - own) == len(before), os.listdir('/proc/self/fd')\n"
    )
    subprocess.run(["env", *ENVIRONMENT, sys.executable, "-c", script, *names], check=True, timeout=600)


ECHO = "import sys\nfor line in sys.stdin: print(line, end='', flush=True)"
STUBBORN = (
    "import signal, time\nsignal.signal(signal.SIGTERM, signal.SIG_IGN)\nprint('ready', flush=True)\ntime.sleep(60)"
)
PARENT = """
import sys
from pathlib import Path
from robocorba.system.supervision.launch import LoggedProcess
child = LoggedProcess(Path(sys.argv[1]), "sleep", "60")
print(child.pid, flush=True)
sys.stdin.read()
"""


def test_lines_environment_and_end_of_a_child(tmp_path: Path) -> None:
    with LoggedProcess(tmp_path / "log", sys.executable, "-c", ECHO, stdin=subprocess.PIPE) as child:
        assert child.stdin
        child.stdin.write("one\n")
        child.stdin.flush()
        assert child.read_line(60.0) == "one\n"
        with pytest.raises(TimeoutError):
            child.read_line(0.01)
        psutil.Process(child.pid).kill()
        assert child.read_line(60.0) == child.read_line(60.0) == ""
    assert not child.is_running
    # Output that can't be read is the end of a process: its readers would wait for lines that never come.
    code = "import sys, time; sys.stdout.buffer.write(b'\\xff\\n'); sys.stdout.flush(); time.sleep(60)"
    with LoggedProcess(tmp_path / "log", sys.executable, "-c", code) as child:
        assert child.read_line(60.0) == ""
    code = "import os, sys; print(os.sched_getaffinity(0), os.getcwd(), dict(os.environ)); sys.exit('out of order')"
    core = max(os.sched_getaffinity(0))
    command = (sys.executable, "-c", code)
    with LoggedProcess(tmp_path / "log", *command, cwd=tmp_path, env={"A": "b"}, cores=(core,)) as child:
        printed = child.read_line(60.0)
    assert printed.startswith(f"{{{core}}} {tmp_path} ")
    assert "'A': 'b'" in printed
    assert "PATH" not in printed
    assert child.log_tail(6) == "order\n"
    with LoggedProcess(tmp_path / "log", sys.executable, "-c", STUBBORN, grace_period_s=0.2) as child:
        assert child.read_line(60.0) == "ready\n"
    assert not child.is_running
    command = [sys.executable, "-c", PARENT, str(tmp_path / "log")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        child = psutil.Process(int(parent.stdout.readline()))
        assert is_running(child)
        parent.kill()
    eventually(lambda: not is_running(child))


def test_defects_end_neither_the_reading_nor_the_watch() -> None:
    handled: list[str] = []

    def handle(line: str) -> None:
        if line == "bad":
            raise ValueError("a fault")
        handled.append(line)

    async def read() -> None:
        pipe = await Pipe.open()
        with pipe.write_end() as output:
            os.write(output, b"one\nbad\ntwo\n")
        await asyncio.wait_for(pipe.read(handle), LIMIT_S)

    asyncio.run(read())
    assert handled == ["one", "two"]
    process, errors = Process(), [ValueError("a fault")]

    def is_alive() -> None:
        raise errors.pop() if errors else NotReachable("it hangs")

    watch = watch_for_hang(process, is_alive, HangLimit(0.3))  # type: ignore[arg-type]
    assert "was killed: no answer" in asyncio.run(asyncio.wait_for(watch, LIMIT_S))
    assert process.is_killed


class Process:
    """A process that notes that it was killed."""

    pid = os.getpid()
    is_killed = False

    def send_signal(self, number: int) -> None:
        self.is_killed = True


@pytest.fixture(scope="module")
def nursery() -> Iterator[Nursery]:
    with Nursery() as nursery:
        yield nursery


@pytest.mark.parametrize("arguments", [("status", "--nonsense"), ("path", "--help")])
def test_forks_are_like_commands_unless_their_environment_is_another(
    nursery: Nursery, tmp_path: Path, arguments: tuple[str, ...]
) -> None:
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    environment = {**os.environ, "ROBOCORBA_STATE": str(tmp_path / "no system")}
    forked = nursery.start((ROBOCORBA, *arguments), cwd=tmp_path, env=environment, **pipes)
    assert isinstance(forked, ForkedProcess)
    with Launcher(tmp_path) as launch:  # which has no nursery here
        alone = launch(ROBOCORBA, *arguments, ROBOCORBA_STATE=str(tmp_path / "no system"))
        assert forked.communicate(timeout=LIMIT_S) == alone.communicate(timeout=LIMIT_S)
        assert forked.returncode == alone.returncode
    client = checkout_command("testkit.simulation_client", "127.0.0.1:2809")
    for command in ((sys.executable, "-c", ""), ("omniNames", "-start"), (ROBOCORBA, "--help"), client):
        assert nursery.start(command, cwd=tmp_path, env=environment, **pipes) is None
    environment["NUMBA_CACHE_DIR"] = "/elsewhere"
    assert nursery.start((ROBOCORBA, *arguments), cwd=tmp_path, env=environment, **pipes) is None
