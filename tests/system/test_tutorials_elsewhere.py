"""The pages of docs/ for more than one machine, followed as their reader does."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from robocorba.claimed_ports import claimed_ports
from robocorba.testing.actual_robot import running_stand_in
from robocorba.testing.namespaces import Namespace
from tests.system.tutorial import TUTORIALS, Reader, sections

pytestmark = [pytest.mark.system, pytest.mark.slow, pytest.mark.full]


@contextmanager
def two_machines(page: Path, folder: Path) -> Iterator[Reader]:
    try:
        one, two = Namespace(), Namespace()
    except OSError as error:
        pytest.skip(f"needs network namespaces: {error}")
    with one, two:
        one.ip("link", "add", "eth0", "type", "veth", "peer", "name", "eth0", "netns", two.path)
        for number, machine in enumerate((one, two), 1):
            machine.ip("address", "add", f"10.60.0.{number}/24", "dev", "eth0")
            machine.ip("link", "set", "eth0", "up")
        terminals = {"one": one.command(), "listener": one.command(), "two": two.command()}
        with Reader(page, folder, {}, terminals) as reader:
            yield reader


@contextmanager
def real_smartpal(page: Path, folder: Path) -> Iterator[Reader]:
    """The stand-in is the robot."""
    with running_stand_in(folder / "robot") as robot, claimed_ports() as port:
        (folder / "reader").mkdir()
        options = {"192.168.4.211:5005": str(robot.naming)}
        with Reader(page, folder / "reader", {"ROBOCORBA_NAMING": f"127.0.0.1:{port}"}, options=options) as reader:
            yield reader


#: Each page, and the machines of its reader.
PAGES = {
    "two-machines": (TUTORIALS / "two-machines.md", two_machines),
    "real-smartpal": (TUTORIALS.parent / "real-smartpal.md", real_smartpal),
}


@pytest.fixture(scope="module")
def readers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[str], Reader]]:
    """The reader of each page, who begins with its first test."""
    with ExitStack() as stack:

        @functools.cache
        def reader(name: str) -> Reader:
            page, place = PAGES[name]
            return stack.enter_context(place(page, tmp_path_factory.mktemp(name)))

        yield reader


@pytest.mark.parametrize(
    ("name", "section"), [(name, section) for name, (page, _) in PAGES.items() for section in sections(page)]
)
def test_the_reader_gets_to_the_end(readers: Callable[[str], Reader], name: str, section: str) -> None:
    readers(name).follow(section)
