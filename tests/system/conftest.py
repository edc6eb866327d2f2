"""Real processes, each ended with its test or module; several runs of the suite can go on at the same time."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from subprocess import Popen

import pytest

from robocorba.map_editor import native
from robocorba.orb.orb import Orb
from robocorba.system.claimed_ports import claimed_ports
from robocorba.system.settings import Address
from robocorba.system.supervision.launch import module_command
from testkit.buildings import two_floors
from testkit.processes import ROBOCORBA, Launcher, Running, forked_processes, real_system
from testkit.ros2_environment import claimed_domain

HERE = Path(__file__).resolve().parent
ECHO_UP = module_command("tests.system.echo_up")


@pytest.fixture(scope="session", autouse=True)
def servers_of_tests() -> Iterator[None]:
    """Servers that only tests have are modules of this folder, and of the checkout."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", f"{HERE}{os.pathsep}{HERE.parents[1]}", prepend=os.pathsep)
        yield


@pytest.fixture(scope="session", autouse=True)
def nursery(servers_of_tests: None) -> Iterator[None]:
    """Processes of tests are forks, except where `alone` is used."""
    with forked_processes():
        yield


@pytest.fixture
def alone() -> Iterator[None]:
    """All processes of a test start as those of users do."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Launcher, "nursery", None)
        yield


@pytest.fixture
def naming_port() -> Iterator[int]:
    """A port for a naming service; the 14 after it are free as well."""
    with claimed_ports() as port:
        yield port


@pytest.fixture
def launch(tmp_path: Path) -> Iterator[Launcher]:
    """Starts a command in a folder of the test; what it starts is killed, with all its children, at the test's end."""
    with Launcher(tmp_path) as launcher:
        yield launcher


@pytest.fixture
def echo_up(launch: Launcher, tmp_path: Path, naming_port: int) -> Callable[..., Running]:
    """Starts a system whose only server is the echo server; several times in one test it is the same system."""

    def start(limit_s: float = 20.0, port: int = naming_port, hang_limit_s: float = 0.0, **environment: str) -> Running:
        naming = Address("127.0.0.1", port)
        process = launch(*ECHO_UP, str(tmp_path / "state"), str(naming), str(limit_s), str(hang_limit_s), **environment)
        return Running(process, tmp_path / "state", naming)

    return start


@pytest.fixture
def robocorba_up(launch: Launcher, tmp_path: Path, naming_port: int) -> Callable[..., Running]:
    """Starts `robocorba up` with the real servers; more arguments may follow."""
    return lambda *arguments: real_system(launch, tmp_path / "state", naming_port, *arguments)


@pytest.fixture
def domain() -> Iterator[int]:
    """A ROS domain that no other test has."""
    with claimed_domain() as domain:
        yield domain


@pytest.fixture
def client(naming_port: int) -> Iterator[Orb]:
    """This test's ORB, for the naming service of its port."""
    with Orb(Address("127.0.0.1", naming_port), call_timeout_s=60.0) as orb:
        yield orb


@pytest.fixture(scope="module")
def system(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """The real servers on the building of testkit.buildings.two_floors, one system for a module."""
    folder = tmp_path_factory.mktemp("system")
    native.save(two_floors(), folder / "two-floors.yaml")
    with claimed_ports() as port, Launcher(folder) as launch:
        options = ("--building", "two-floors.yaml", "--subnets", "main")
        yield real_system(launch, folder / "state", port, *options).wait_ready()


@pytest.fixture
def robocorba(launch: Launcher, system: Running) -> Callable[..., Popen[str]]:
    """Starts `robocorba` with arguments, for `system`, in the folder of the test."""
    places = {"ROBOCORBA_NAMING": str(system.naming), "ROBOCORBA_STATE": str(launch.folder / "state")}
    return lambda *arguments: launch(ROBOCORBA, *arguments, **places)


@pytest.fixture(scope="module")
def system_orb(system: Running) -> Iterator[Orb]:
    """The ORB of a module that uses `system`; such a module can't use `client`, a process has one ORB."""
    with Orb(system.naming) as orb:
        yield orb
