"""Each tutorial of docs/, followed as its reader does."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from robocorba.claimed_ports import claimed_ports
from robocorba.testing.actual_robot import running_stand_in
from robocorba.testing.namespaces import Namespace
from tests.system.tutorial import Reader, sections

pytestmark = [pytest.mark.system, pytest.mark.slow]

TUTORIALS = Path(__file__).resolve().parents[2] / "docs" / "tutorials"
#: Those on one machine.
ON_ONE_MACHINE = ("first-hour", "your-own-map", "your-own-robot", "your-own-cooperative-icon")
#: Another system on this machine has the console's port.
OPTIONS = {"--console ": "--console --console-port 0 "}
#: The reader installs a package; here it goes into a folder of the test, not into the suite's environment.
INSTALLED_ALONE = "--quiet --disable-pip-version-check --no-build-isolation --no-deps"


@pytest.fixture(scope="module")
def readers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[str], Reader]]:
    """The reader of each tutorial, who begins with its first test."""
    with contextlib.ExitStack() as stack:

        @functools.cache
        def reader(name: str) -> Reader:
            folder, plugins = tmp_path_factory.mktemp(name), str(tmp_path_factory.mktemp("plugins"))
            naming = f"127.0.0.1:{stack.enter_context(claimed_ports())}"
            environment = {"ROBOCORBA_NAMING": naming, "PYTHONPATH": plugins}
            options = {**OPTIONS, "--quiet .": f"{INSTALLED_ALONE} --target {plugins} ."}
            return stack.enter_context(Reader(TUTORIALS / f"{name}.md", folder, environment, options=options))

        yield reader


@pytest.mark.parametrize(
    ("name", "section"),
    [(name, section) for name in ON_ONE_MACHINE for section in sections(TUTORIALS / f"{name}.md")],
)
def test_the_reader_gets_to_the_end(readers: Callable[[str], Reader], name: str, section: str) -> None:
    readers(name).follow(section)


def test_two_machines(tmp_path: Path) -> None:
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
        with Reader(TUTORIALS / "two-machines.md", tmp_path, {}, terminals) as reader:
            reader.follow()


def test_a_real_smartpal(tmp_path: Path) -> None:
    """The stand-in is the robot."""
    with running_stand_in(tmp_path / "robot") as robot, claimed_ports() as port:
        options = {"192.168.4.211:5005": str(robot.naming)}
        (tmp_path / "reader").mkdir()
        environment = {"ROBOCORBA_NAMING": f"127.0.0.1:{port}"}
        page = TUTORIALS.parent / "real-smartpal.md"
        with Reader(page, tmp_path / "reader", environment, options=options) as reader:
            reader.follow()


def test_every_tutorial_is_followed() -> None:
    assert {page.stem for page in TUTORIALS.glob("*.md")} == {
        *ON_ONE_MACHINE,
        "two-machines",
    }
