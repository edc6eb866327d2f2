"""One server, one naming service and a client: what references and names do when a process stops, hangs or dies."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import CosNaming
import pytest
from omniORB import CORBA

from robocorba.errors.services import NotReachable
from robocorba.orb.naming import corbaname
from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba
from robocorba.system.settings import Address
from robocorba.system.supervision.system import naming_service_command
from testkit.processes import eventually, hang

pytestmark = pytest.mark.system

Launch = Callable[..., subprocess.Popen[str]]


@pytest.fixture
def names(launch: Launch, tmp_path: Path, naming_port: int, client: Orb) -> subprocess.Popen[str]:
    """A naming service that answers."""
    process = launch(*naming_service_command(Address("127.0.0.1", naming_port), tmp_path))
    eventually(lambda: is_there(client), what="a naming service")
    return process


def is_there(orb: Orb) -> bool:
    try:
        orb.check_naming()
    except NotReachable:
        return False
    return True


@pytest.fixture
def serve(launch: Launch, tmp_path: Path, naming_port: int) -> Callable[..., subprocess.Popen[str]]:
    """Starts an echo server on the port that lies so far after the naming service's."""

    def start(offset: int = 1, **environment: str) -> subprocess.Popen[str]:
        arguments = ("--endpoint", f"127.0.0.1:{naming_port + offset}", "--naming", f"127.0.0.1:{naming_port}")
        server = str(Path(__file__).with_name("echo_server.py"))
        return launch(sys.executable, server, "--state", str(tmp_path / str(offset)), *arguments, **environment)

    return start


def resolve(client: Orb, timeout_s: float = 60.0) -> RoboCorba.PathPlanner:
    return client.resolve("PathPlanner", RoboCorba.PathPlanner, timeout_s)


def why_not(client: Orb) -> str:
    with pytest.raises(NotReachable) as error:
        resolve(client, 0.1)
    return str(error.value)


def pid_behind(client: Orb) -> int:
    return resolve(client)._get_mapVersion()


def test_any_client_finds_an_object_and_texts_of_any_size_arrive(
    names: object, serve: Callable, client: Orb, naming_port: int
) -> None:
    server = serve()
    planner = resolve(client)
    for floor in ("Erdgeschoß 一階 🛗", "x" * 3 * 1024 * 1024):
        with pytest.raises(RoboCorba.UnknownFloor) as unknown:
            planner.getPath(RoboCorba.Point(floor, 1.0, 2.0), RoboCorba.Point("", 0.0, 0.0))
        assert unknown.value.floorName == floor
    with pytest.raises(NotReachable, match="is not a IDL:RoboCorba/MapEditor"):
        client.resolve("PathPlanner", RoboCorba.MapEditor, timeout_s=60.0)
    # What a client does that has omniORB and the IDL, and nothing of ours.
    uri = corbaname(Address("127.0.0.1", naming_port), "RoboCorba/PathPlanner")
    orb = CORBA.ORB_init([], CORBA.ORB_ID)
    for text in (uri, f"corbaloc:iiop:127.0.0.1:{naming_port + 1}/PathPlanner"):
        assert orb.string_to_object(text)._narrow(RoboCorba.PathPlanner)._get_mapVersion() == server.pid


def test_a_server_that_was_there_before_the_naming_service_is_bound(
    serve: Callable, client: Orb, request: pytest.FixtureRequest
) -> None:
    server = serve()
    with pytest.raises(NotReachable):
        resolve(client, 0.5)
    request.getfixturevalue("names")
    assert pid_behind(client) == server.pid


def test_a_reference_works_again_after_kill_9_and_a_start_by_hand(names: object, serve: Callable, client: Orb) -> None:
    """It is never told that its object is gone, not even between the moments when the new process listens and when its
    servants are there."""
    server = serve()
    planner = resolve(client)
    assert planner._get_mapVersion() == server.pid
    server.kill()
    server.wait()
    with pytest.raises((CORBA.COMM_FAILURE, CORBA.TRANSIENT)):
        planner._get_mapVersion()
    eventually(lambda: "its server at 127.0.0.1:" in why_not(client), what="the right reason")
    again = serve(ECHO_MODE="slow")

    def answer() -> int:
        try:
            return planner._get_mapVersion()
        except (CORBA.TRANSIENT, CORBA.COMM_FAILURE):
            return 0

    assert eventually(answer, what="answers again") == again.pid
    assert pid_behind(client) == again.pid


def test_calls_to_what_hangs_end(names: subprocess.Popen[str], serve: Callable, client: Orb) -> None:
    server = serve()
    hasty = client.resolve("PathPlanner", RoboCorba.PathPlanner, call_timeout_s=0.3)
    hang(server.pid)
    with pytest.raises(CORBA.TIMEOUT):
        hasty._get_mapVersion()
    with pytest.raises(NotReachable, match="TIMEOUT"):
        resolve(client, 0.3)
    os.kill(server.pid, signal.SIGCONT)
    assert pid_behind(client) == server.pid
    hang(names.pid)
    with pytest.raises(NotReachable, match="TIMEOUT"):
        resolve(client, 0.3)
    os.kill(names.pid, signal.SIGCONT)


def test_stolen_naming_contexts_are_taken_back(
    names: object, serve: Callable, client: Orb, tmp_path: Path, naming_port: int
) -> None:
    """A stranger binds an object in their place, unbinds the context, or destroys it."""
    server = serve()
    assert pid_behind(client) == server.pid
    orb = CORBA.ORB_init([], CORBA.ORB_ID)

    def context(uri: str) -> Any:
        return orb.string_to_object(uri)._narrow(CosNaming.NamingContextExt)

    root, planner = context(f"corbaname::127.0.0.1:{naming_port}"), resolve(client)
    path, own = [CosNaming.NameComponent("RoboCorba", "")], [CosNaming.NameComponent("PathPlanner", "")]

    def bind_object() -> None:
        root.unbind(path)
        root.bind(path, planner)

    def destroy() -> None:
        inner = context(f"corbaname::127.0.0.1:{naming_port}#RoboCorba")
        inner.unbind(own)
        inner.destroy()

    def is_back() -> bool:
        try:
            return root.resolve([*path, *own])._is_equivalent(planner)
        except (CosNaming.NamingContext.NotFound, CosNaming.NamingContext.CannotProceed, CORBA.SystemException):
            return False

    for attack in (bind_object, lambda: root.unbind(path), destroy):
        attack()
        eventually(is_back, what="the name")
    said = (tmp_path / "1" / "logs" / "echo.log").read_text()
    assert f"RoboCorba again: an object at 127.0.0.1:{naming_port + 1} was bound to it" in said
