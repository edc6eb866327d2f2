"""Each tutorial of docs/ on one machine, followed as its reader does."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Iterator

import pytest

from robocorba.claimed_ports import claimed_ports
from tests.system.tutorial import TUTORIALS, Reader, sections

pytestmark = [pytest.mark.system, pytest.mark.slow, pytest.mark.full]

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


def test_every_tutorial_is_followed() -> None:
    """That of two machines, by test_tutorials_elsewhere.py."""
    assert {page.stem for page in TUTORIALS.glob("*.md")} == {*ON_ONE_MACHINE, "two-machines"}
